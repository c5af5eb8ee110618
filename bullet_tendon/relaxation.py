"""Relaxation: static equilibrium of the tendons with the bodies held (TendonWorld.relax).

Owns: nothing; it takes steps of a Stepper, and takes them back by States. Goes with the core's room `world`.

Equilibrium is where an implicit step of endless length would end: without inertia, the step's
residual is the static one. A tendon that can touch nothing is taken there at once. Where there is
something to touch, positions must not jump over it: then steps of growing length are taken, each
from rest. They are shortened where particles move by more than a share of the radius, and of the room that
they have before they could meet anything, or where a step does not converge, and taken back where particles
could have passed through something. They are lengthened where particles move little (pseudo-transient
continuation, Kelley and Keyes 1998). Where bodies come to rest as
well, the steps grow from place to place: in short ones damping holds the tendons back, which Newton's matrix
of the bodies' equilibrium does not know. They begin short again where segments are slack.
"""

import math
from collections.abc import Callable

import numpy as np
from scipy.spatial import cKDTree

from . import _core
from .anchors import Attachment, Grip
from .bodies import Bodies
from .penetration import Surroundings
from .states import States
from .stepper import Stepper
from .tendon import Tendon

_ENDLESS = 1e4  # s: inertia M/dt^2 is then 1e-8 of M g per metre
_FOLLOWING = 1.0  # s: the longest step beside bodies that move; in longer ones nothing holds a slack tendon
_FIRST = 1 / 240  # s
# Of the radius, or of the room, moved in a step: shorter above, longer below; what the next is to move by.
_FARTHEST, _NEAREST, _AIM = 0.5, 0.1, 0.35
_GROWTH = 4.0
_DEPTH = 2.5e-4  # of the radius, of contacts at rest: half of what a step may leave
_LOST = 1e4  # of its length, from where it was: nothing holds the tendon


class Relaxation:
    """Brings tendons to rest among bodies.

    alone: there is nothing to touch, not even another tendon. surroundings: tells what there is, where it is
    now.
    """

    def __init__(
        self,
        core: _core.World,
        stepper: Stepper,
        states: States,
        bodies: Bodies,
        tendons: tuple[Tendon, ...],
        alone: bool,
        surroundings: Callable[[], Surroundings],
    ):
        self._core, self._stepper, self._states, self._bodies = core, stepper, states, bodies
        self._tendons, self._alone, self._surroundings = tendons, alone, surroundings
        self._around: Surroundings | None = None  # while `run` runs
        self._mass = {t: float(t.masses.sum()) for t in tendons}  # [kg]
        self._heaviest = {t: float(t.masses.max()) for t in tendons}  # particle [kg]
        self._last_dt = _FIRST  # of the last step of `follow` [s]
        self._before_it: _core.Checkpoint | None = None  # before the last step
        self.taken = 0  # steps so far

    def run(self, tolerance: float, max_steps: int) -> None:
        """See TendonWorld.relax."""
        _, gravity = self._stepper.step_and_gravity()
        self._around = self._surroundings()
        kept = self._states.capture()
        start = {t: t.positions for t in self._tendons}
        try:
            self._bodies.read()
            for t in self._tendons:
                if self._alone:
                    self._lay_out(t, gravity)
                t._core.guess_multipliers(t._slot, gravity)
            first = _ENDLESS if self._alone else _FIRST
            settled, iterations, residual = self._descend(start, gravity, tolerance, max_steps, first)
        except BaseException:
            self._states.take_back(kept)
            raise
        if settled is None:  # nothing holds a tendon, or a step could not be solved
            self._states.take_back(kept)
        else:
            self._bodies.rest()
        report = self._stepper.report
        report.iterations, report.residual, report.tolerance = iterations, float(residual), tolerance
        report.converged = bool(report.converged and settled)

    def follow(self, gravity, tolerance: float, max_steps: int, at_hand: float = 0.0) -> bool:
        """Bring the tendons to rest from where they are, after bodies have moved a little; whether they are.

        The bodies are where they were read last. at_hand: the largest force on them [N]. The tolerance is of
        that where it is larger than the tendons' own: a slack tendon has no force, and nothing that is small
        beside it. Nothing is taken back. Raises what Stepper.hold raises.
        """
        start = {t: t.positions for t in self._tendons}
        # Nothing but inertia holds segments that are slack.
        is_slack = any(_has_slack(t, x) for t, x in start.items())
        first = _FIRST if is_slack else min(_ENDLESS, self._last_dt)
        settled, *_ = self._descend(start, gravity, tolerance, max_steps, first, at_hand, follows=True)
        return bool(settled)

    def _descend(
        self,
        start: dict[Tendon, np.ndarray],
        gravity,
        tolerance: float,
        max_steps: int,
        first: float,
        at_hand: float = 0.0,
        follows: bool = False,
    ) -> tuple:
        """Steps from rest until the residual is small: settled (None: take it back), iterations, residual.

        A step that leaps is taken back, and shortened. One that was not solved descends as well: it is kept,
        but beside bodies that move, on which what it lets through a bone would act. There, a step that goes
        back is halved: contacts are those of where it began, and those of two places can lead to each other
        for ever. What is remembered of contacts is that of where it began, too: where it ended, bone that has
        pressed may have let go.

        first: length of the first step [s]. at_hand: see follow. follows: bodies have moved. Then tendons
        move with them, however short a step is, and the residual does not count forces of damping.
        """
        stepper, dt = self._stepper, first
        pull = math.hypot(*gravity)
        weights = {t: self._mass[t] * pull for t in start}
        iterations, residual, settled, before = 0, np.inf, not start, start
        leapt = np.inf  # of the last step, if that was taken back
        last_motion = np.zeros(sum(x.size for x in start.values()))
        ways = dict.fromkeys(start, 0.0)  # the sum of all motions: from the start, it is no farther
        lost = {t: _LOST * t.rest_length for t in start}
        for count in range(max_steps):
            self._last_dt = dt
            self.taken += 1
            before_it = self._before_it = stepper.checkpoint(self._before_it)
            report = stepper.hold(dt, gravity, at_hand)
            if report is None:
                return None, iterations, residual
            iterations += report.iterations
            now = {t: t.positions for t in start}
            moved = {t: np.abs(x - before[t]).max() for t, x in now.items()}
            # Contacts are those of where the step began: farther away there can be others. Beside bodies that
            # move, no force may change with them.
            leap = ratio = max((moved[t] / t.radius for t in start), default=0.0)
            is_near = ratio <= (_NEAREST if follows else _FARTHEST)
            if ratio > _NEAREST and not follows:
                ratio, leap = self._shares_of_room(before, now)
            if self._goes_astray(report.converged, leap, dt, follows, leapt):
                stepper.take_back(before_it)
                settled, leapt = False, leap
                dt = min(_FIRST, dt / _GROWTH) if follows else dt / _GROWTH
                continue
            leapt = np.inf
            for t, x in now.items():
                ways[t] += moved[t]
                if ways[t] > lost[t] and np.abs(x - start[t]).max() > lost[t]:
                    return None, iterations, residual
            forces = {t: max(float(np.abs(t.tension).max()), weights[t], 1e-300) for t in start}  # at hand
            # What keeps it from equilibrium in this step alone: inertia and damping. Beside bodies that move,
            # the next step is a longer one in any case.
            passing = [self._heaviest[t] * moved[t] / dt**2 / forces[t] for t in start]
            if not follows:
                passing += [_damping(t, last, now[t], dt) / forces[t] for t, last in before.items()]
            residual = max([report.residual, *passing])
            own = max(forces.values(), default=0.0)
            residual *= min(1.0, own / at_hand) if at_hand > 0 else 1.0
            last, before = before, now
            for t in start:
                t._core.stop(t._slot)
            is_rounded = max(moved.values(), default=0.0) == 0.0 and dt >= _FIRST
            settled = report.converged and is_near and (residual <= tolerance or is_rounded)
            is_at_rest = settled and self._core.pressed_depth() <= _DEPTH
            if is_at_rest and count > 0:
                break
            if follows and not is_at_rest:
                motion = np.concatenate([(x - last[t]).ravel() for t, x in now.items()])
                if _goes_back(motion, last_motion):
                    stepper.take_back(before_it)
                    self._core.carry_tendons(0.5 * motion)
                    before, motion = {t: t.positions for t in start}, 0 * motion
                last_motion = motion
            dt = self._next_step(dt, report.converged, ratio, follows)
            if is_at_rest:  # after one step: `follow` begins with a longer one, in which less is damped
                self._last_dt = dt
                break
        return settled, iterations, residual

    def _goes_astray(self, converged: bool, leap: float, dt: float, follows: bool, leapt: float) -> bool:
        """Whether a step has to be taken back, in which something could have passed through something.

        leap: share of the way by which that could be. leapt: that of a longer step from there which was taken
        back, else infinite. A hold that is led away takes its particles along however short a step is.
        """
        if follows:
            return not converged
        is_led = dt <= _FIRST and leap > 0.5 * leapt
        return leap > 1 and not (converged and (self._alone or is_led))

    def _next_step(self, dt: float, converged: bool, ratio: float, follows: bool) -> float:
        """Length of the step [s] after one of dt that moved a tendon by this share of its room."""
        if not converged:
            return dt / _GROWTH
        if _NEAREST <= ratio <= _FARTHEST and not self._alone:
            return dt
        change = 1 / _GROWTH if ratio > _FARTHEST and not self._alone else _GROWTH
        if not (self._alone or follows):  # from rest, the way grows with the square of the time
            aimed = math.sqrt(_AIM / max(ratio, 1e-300))
            change = min(max(aimed, 1 / _GROWTH), _GROWTH)
        return min(dt * change, _FOLLOWING if follows else _ENDLESS)

    def _shares_of_room(self, before: dict, now: dict) -> tuple[float, float]:
        """Largest motion of a particle over its room, and over the way by which it could pass something.

        The room is a radius, or as far as it meets nothing. What it could pass is farther away than a radius.
        The room of a tendon that is alone is its length, and the way twice that.
        """
        if self._alone:
            share = max(np.abs(now[t] - x).max() / t.rest_length for t, x in before.items())
            return share, 0.5 * share
        most = leap = 0.0
        for t, x in before.items():
            motion = np.linalg.norm(now[t] - x, axis=1)
            gaps = self._around.gaps(x, 10 * motion.max())
            for other, y in before.items():
                if other is not t:
                    gaps = np.minimum(gaps, _gaps_between(x, y) - other.radius)
            between = gaps - t.radius
            room = np.minimum(np.append(between, np.inf), np.append(np.inf, between))
            most = max(most, float((motion / np.maximum(0.5 * room, t.radius)).max()))  # others move, too
            leap = max(leap, float((motion / np.maximum(room, t.radius)).max()))
        return most, leap

    def _lay_out(self, tendon: Tendon, gravity) -> None:
        """Put a tendon that touches nothing where its segments have their rest lengths, hanging.

        Newton's method for a stiff tendon starts well from any shape without strain, and badly from a
        compressed one. Between two holds nearer than the tendon is long it is laid as a V along the load,
        free ends straight along it, and where holds are farther apart straight between them.
        """
        x, rest = tendon.positions, tendon._core.rest(tendon._slot)
        held = {i: self._point_of(anchor) for i, anchor in tendon._anchors.items()}
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

    def _point_of(self, anchor):
        """Where a rigid anchor takes its particle (3,), or None for a soft one."""
        if isinstance(anchor, Attachment):
            origin, axes = self._bodies.frame(anchor.bodyUniqueId, anchor.linkIndex)
            return origin + axes @ anchor.position
        return anchor.target if isinstance(anchor, Grip) and anchor.stiffness is None else None


def _gaps_between(x, y) -> np.ndarray:
    """(n-1,) bounds from below of the distances of the segments of x (n, 3) from those of y (m, 3) [m]."""
    halves, longest = (0.5 * np.linalg.norm(np.diff(at, axis=0), axis=1) for at in (x, y))
    nearest = cKDTree(y).query(x)[0]
    return np.minimum(nearest[:-1], nearest[1:]) - halves - longest.max()


def _has_slack(tendon: Tendon, x) -> bool:
    """Whether a segment is shorter than at rest, with the particles at x (n, 3)."""
    ways = x[1:] - x[:-1]
    return bool((np.einsum("ij,ij->i", ways, ways) < tendon._core.rest(tendon._slot) ** 2).any())


def _goes_back(motion, last) -> bool:
    """Whether a motion (3 n) undoes most of the last one."""
    return motion @ last < -0.5 * max(motion @ motion, last @ last)


def _damping(tendon: Tendon, x, x_new, dt: float) -> float:
    """Largest force of damping in taut segments, in a step of dt from x to x_new (n, 3) [N]."""
    if tendon.material.damping == 0:
        return 0.0
    before, after = (np.linalg.norm(np.diff(at, axis=0), axis=1) for at in (x, x_new))
    rates = np.abs(after - before) / tendon._core.rest(tendon._slot) / dt
    fastest = float(rates[tendon.tension > 0].max(initial=0.0))
    return tendon.material.damping * fastest**tendon.material.damping_exponent


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
