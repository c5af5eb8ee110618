"""State of a world: taken out and put back, in memory (save_state) or for a file (snapshot.py).

The core hands out all that changes in it as bytes; beside them go the holds, because handles are
Python's, and what the world is made of, because a state can only be put back where that is the same.
"""

import dataclasses
import hashlib

import numpy as np

from .errors import StateMismatch

_PARTS = ("tendons", "tunnels", "obstacles")


@dataclasses.dataclass(frozen=True)
class State:
    """What a world was like.

    core: the core's bytes; last_step: length [s] and gravity (3,) [m/s^2] of the last step, with which it is
    solved again where it has to be; parts, links: what has to be the same; holds: handles, and what they
    stood for.
    """

    core: bytes
    last_step: tuple[float, tuple]
    parts: tuple
    links: tuple
    holds: tuple


def parts_of(world) -> tuple:
    """What a world is made of, as far as the core does not know it itself (by _PARTS)."""
    tendons = tuple((t._slot, t.name) for t in world.tendons)
    tunnels = tuple((t.slot, t.name, t.bodyUniqueId, t.linkIndex) for t in world.tunnels)
    return tendons, tunnels, world._obstacles.listing()


def capture(world) -> State:
    world._bodies.keep_contacts(world._core)
    holds = tuple((hold, hold._settings()) for t in world.tendons for hold in t.holds)
    last_step = world._dt, world._last_gravity
    return State(world._core.save(), last_step, parts_of(world), world._bodies.marked_links(), holds)


def put_back(world, state: State, argument: str, value) -> None:
    """Take a state of this world, or raise StateMismatch and change nothing."""
    require_parts(world, state.parts, argument, value)
    alive = world._bodies.marked_links()
    gone = [
        link
        for slot, link in enumerate(state.links)
        if link is not None and (slot >= len(alive) or alive[slot] != link or world._bodies.is_gone(slot))
    ]
    if gone and _refers(world, state, {state.links.index(link) for link in gone}):
        raise StateMismatch(argument, value, f"of bodies that are still there, not {gone[0][:2]}")
    restore_core(world, state.core, argument, value)
    world._dt, world._last_gravity = state.last_step
    retake_holds(world, state.holds)


def take_back(world, state: State) -> None:
    """Undo what a call did that is then refused: the parts are what they were, whatever pybullet holds."""
    restore_core(world, state.core, "state", "before the call")
    world._dt, world._last_gravity = state.last_step
    retake_holds(world, state.holds)


def retake_holds(world, holds) -> None:
    """Make the holds (handle, settings), which the core has already, those of the world's tendons."""
    for tendon in world.tendons:
        for hold in tendon.holds:
            hold._let_go()
    for hold, settings in holds:
        hold._take_again(settings)


def require_parts(world, parts: tuple, argument: str, value) -> None:
    for what, have, want in zip(_PARTS, parts_of(world), parts, strict=True):
        if have != want:
            raise StateMismatch(argument, value, f"of a world with the {what} {have}, not {want}")


def restore_core(world, core: bytes, argument: str, value) -> None:
    try:
        world._core.restore(core)
    except RuntimeError as problem:
        raise StateMismatch(argument, value, str(problem)) from None


def hash_of(world) -> str:
    """Hash of the core's state, of the parts, of all holds and of the options."""
    state = capture(world)
    holds = [(h._tendon.name, h.particle, {k: _plain(v) for k, v in s.items()}) for h, s in state.holds]
    bodies = [state.links[slot][:2] for slot in sorted(world._links_in_use())]
    digest = hashlib.blake2b(state.core, digest_size=16)
    digest.update(repr((state.parts, bodies, holds, world.options)).encode())
    return digest.hexdigest()


def _refers(world, state: State, slots: set[int]) -> bool:
    """Whether anything would refer to the slots after the state was put back."""
    attached = {getattr(hold, "link_slot", None) for hold, _ in state.holds}
    tunnels = {t.link_slot for t in world.tunnels}
    return bool(slots & (attached | tunnels | world._obstacles.link_slots()))


def _plain(value):
    return value.tolist() if isinstance(value, np.ndarray) else value
