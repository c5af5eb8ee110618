"""world.relax: static equilibrium of the tendons with the bodies held.

Equilibrium is where an implicit step of endless length would end: without inertia, the step's
residual is the static one. A tendon that can touch nothing is taken there at once. Where there is
something to touch, positions must not jump over it: then steps of growing length are taken, each
from rest, short while particles move by more than a share of the radius and doubled when they do not
(pseudo-transient continuation, Kelley and Keyes 1998).
"""

import numpy as np

from .holds import Attachment
from .state import capture, take_back

_ENDLESS = 1e4  # s: inertia M/dt^2 is then 1e-8 of M g per metre
_FIRST = 1 / 240  # s
_FARTHEST, _NEAREST = 0.5, 0.1  # of the radius, moved in a step: shorter above, longer below
_GROWTH = 4.0
_DEPTH = 2.5e-4  # of the radius, of contacts at rest: half of what a step may leave
_LOST = 1e4  # of its length, from where it was: nothing holds the tendon


def relax(world, tolerance: float, max_steps: int) -> None:
    """See TendonWorld.relax."""
    _, gravity = world._step_and_gravity()
    world._bodies.require_alive()
    core = world._core
    kept = capture(world)
    start = {t: t.positions for t in world.tendons}
    alone = len(start) == 1 and not world._obstacles and not world.tunnels
    for t in world.tendons:
        if alone:
            _lay_out(world, t, gravity)
        core.guess_multipliers(t._slot, gravity)
    dt = _ENDLESS if alone else _FIRST
    iterations, residual, settled = 0, np.inf, not start
    for _ in range(max_steps):
        before = {t: t.positions for t in start}
        try:
            if not world._solve(dt, gravity, held=True):
                settled = False
                take_back(world, kept)
                break
        except BaseException:
            take_back(world, kept)
            raise
        iterations += world.report.iterations
        moved = {t: np.abs(t.positions - x).max() for t, x in before.items()}
        residual = max([world.report.residual, *(_inertia(t, moved[t], dt, gravity) for t in start)])
        for t in start:
            core.stop(t._slot)
        if any(_lost(t, x) for t, x in start.items()):
            settled = False
            take_back(world, kept)
            break
        settled = residual <= tolerance or max(moved.values()) == 0.0  # at its rounding
        if world.report.converged and settled and _depth(world) <= _DEPTH:
            break
        ratio = max((moved[t] / t.radius for t in start), default=0.0)
        dt = dt / _GROWTH if ratio > _FARTHEST and not alone else dt
        dt = min(dt * _GROWTH, _ENDLESS) if ratio < _NEAREST else dt
    world.report.iterations, world.report.residual = iterations, float(residual)
    world.report.converged = bool(world.report.converged and settled)


def _depth(world) -> float:
    """Of the deepest contact, in radii of its tendon [-]."""
    contacts = world.contacts
    radii = {t.name: t.radius for t in world.tendons}
    return max((-c["distance"] / radii[c["tendon"]] for c in contacts if c["normal_force"] > 0), default=0.0)


def _lost(tendon, start) -> bool:
    return np.abs(tendon.positions - start).max() > _LOST * tendon.rest_length


def _inertia(tendon, moved: float, dt: float, gravity) -> float:
    """Inertia force of the step over the largest force at hand [-]: what keeps it from equilibrium."""
    masses = tendon.masses
    at_hand = max(np.abs(tendon.tension).max(), masses.sum() * np.linalg.norm(gravity), 1e-300)
    return float(masses.max() * moved / dt**2 / at_hand)


def _lay_out(world, tendon, gravity) -> None:
    """Put a tendon that touches nothing where its segments have their rest lengths, hanging.

    Newton's method for a stiff tendon starts well from any shape without strain, and badly from a
    compressed one. Between two holds nearer than the tendon is long it is laid as a V along the load,
    free ends straight along it, and where holds are farther apart straight between them.
    """
    x, rest = tendon.positions, tendon._core.rest(tendon._slot)
    held = {i: _point_of(world, hold) for i, hold in tendon._holds.items()}
    held = {i: point for i, point in held.items() if point is not None}
    if not held:
        return
    forces = np.array([tendon._core.force(tendon._slot, i) for i in range(len(x))])
    load = (forces + tendon.masses[:, None] * np.array(gravity)).sum(axis=0)
    where = sorted(held)
    for i, j in zip(where[:-1], where[1:], strict=True):
        x[i : j + 1] = _span(held[i], held[j], rest[i:j], load)
    size = np.linalg.norm(load)
    for end, arc in ((where[0], rest[: where[0]][::-1]), (where[-1], rest[where[-1] :])):
        order = slice(end, None, -1) if end == where[0] and len(arc) == end else slice(end, None)
        reach = np.concatenate([[0.0], np.cumsum(arc)])[:, None]
        x[order] = held[end] + reach * load / size if size > 0 else x[order] + held[end] - x[end]
    tendon._core.set_state(tendon._slot, x, np.zeros_like(x))


def _point_of(world, hold):
    """Where a rigid hold takes its particle (3,), or None for a soft one."""
    if isinstance(hold, Attachment):
        origin, axes = world._bodies.frame(hold.bodyUniqueId, hold.linkIndex)
        return origin + axes @ hold.position
    return hold.target if hold.stiffness is None else None


def _span(a, b, rest, load) -> np.ndarray:
    """(m+1, 3) particles from a to b: straight, or a V along the load where the tendon is longer."""
    arc = np.concatenate([[0.0], np.cumsum(rest)]) / rest.sum()
    chord, length = b - a, rest.sum()
    depth = length**2 - chord @ chord
    if depth <= 0:
        return a + arc[:, None] * chord
    across = load - chord * (load @ chord) / max(chord @ chord, 1e-300)
    if np.linalg.norm(across) <= 1e-9 * np.linalg.norm(load) or not np.any(across):
        across = np.cross(chord, np.eye(3)[np.argmin(np.abs(chord))])
    apex = 0.5 * (a + b) + 0.5 * np.sqrt(depth) * across / max(np.linalg.norm(across), 1e-300)
    first, second = np.minimum(2 * arc, 1)[:, None], np.maximum(2 * arc - 1, 0)[:, None]
    return a + first * (apex - a) + second * (b - apex)
