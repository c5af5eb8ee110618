"""KeepsState: what a TendonWorld offers for saving and restoring its state."""

from pathlib import Path

from . import checks
from .errors import UnknownId
from .snapshot import pack, unpack
from .state import State, capture, hash_of, put_back


class KeepsState:
    """Saving, restoring and hashing, in memory and by snapshots; part of TendonWorld."""

    def __init__(self):
        self._states: dict[int, State] = {}

    def save_state(self) -> int:
        """Keep all state of the tendons in memory; returns an id for restore_state and remove_state.

        Positions, velocities, the integrator's history, multipliers, friction anchors, contact planes,
        memberships of tunnels, rest lengths, forces, holds, the last step's contacts, length and gravity.
        Not: the options, and pybullet's bodies, for which p.saveState stands beside it; that in turn does not
        keep forces that were applied and not stepped yet, the time step, gravity, motor commands and
        bodies added or removed since.
        """
        number = self._next_number()
        self._states[number] = capture(self)
        return number

    def restore_state(self, state: int) -> None:
        """Put the state of save_state back; it can be put back any number of times.

        Together with p.restoreState the run then goes on with the same bits. Grips and attachments
        made since are released; those released since hold again, and their handles with them.
        Raises UnknownId, or StateMismatch where tendons, tunnels or obstacles were added, removed
        or replaced, or bodies that they refer to removed, since; then nothing has changed.
        """
        put_back(self, self._states[self._known_state(state)], "state", state)

    def remove_state(self, state: int) -> None:
        """Forget a saved state. Raises UnknownId or InvalidType."""
        del self._states[self._known_state(state)]

    def state_hash(self) -> str:
        """A hash of the whole state, options included: equal for equal bits."""
        return hash_of(self)

    def snapshot(self, path=None) -> bytes:
        """The state (see save_state) as bytes of a numpy npz file, written to `path` unless None.

        Versioned, without pickle: another version of its layout is refused. p.saveBullet stands beside it
        for the bodies.
        """
        data = pack(self)
        if path is not None:
            Path(checks.path("path", path)).write_bytes(data)
        return data

    def load_snapshot(self, source) -> None:
        """Put back a snapshot: the bytes, or the path of its file.

        The world must have been made of the same parts in the same order, as a script does that is
        run again: tendons (names, particles, materials, radii), tunnels and obstacles, on bodies of
        the same ids. Holds become those of the snapshot: handles of the same tendon, particle, kind
        and body go on, others are released, and what is missing is made (Tendon.holds). Raises
        InvalidType, SnapshotError for what cannot be read, is of another version or contradicts itself,
        or StateMismatch for what is of another world; then nothing has changed.
        """
        unpack(self, source)

    def _known_state(self, state) -> int:
        number = checks.integer("state", state)
        if number not in self._states:
            raise UnknownId("state", state, f"one of save_state, not removed: {list(self._states)}")
        return number
