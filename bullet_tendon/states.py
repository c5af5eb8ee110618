"""States: a world's state taken out and put back, in memory (save_state) or for a file (snapshot).

Owns: the states saved in memory, and the format of snapshots. The core gives all that changes in it as bytes.
Beside them go the anchors, because handles are Python's, and what the world is made of, because a state can
only be put back where that is the same. Goes with the core's room `world` (checkpoint).

A snapshot is a numpy npz file, versioned and without pickle. Everything in it that Python reads is checked,
with or without a digest that fits; its core's bytes are checked by the core.
"""

import dataclasses
import hashlib
import io
import zipfile
from pathlib import Path

import numpy as np

from . import _core, checks
from .anchors import Attachment, Grip, Line, LinkAnchor, Numbers
from .bodies import Bodies
from .errors import InvalidType, SnapshotError, StateMismatch, UnknownId
from .obstacles import Obstacles
from .stepper import Stepper
from .tendon import Tendon
from .tunnels import Tunnel

_PARTS = ("tendons", "tunnels", "obstacles")
VERSION = 42  # raised whenever an array, or the core's layout, changes
_GRIP, _ATTACHMENT, _LINE = 0, 1, 2  # kinds of holds
_ON_LINKS = {_ATTACHMENT: Attachment, _LINE: Line}
_NO_LINK = (-1, -2)  # of a slot that is not in use
_MOST_NUMBER = 2**30  # of a hold; the core's are of 32 bits, and more are going to be made

# Name: kind of numbers and shape, None for any length.
_ARRAYS = {
    "version": ("i", ()),
    "core": ("u", (None,)),
    "tendons": ("U", (None,)),
    "tendon_slots": ("i", (None,)),
    "tunnels": ("U", (None,)),
    "tunnel_slots": ("i", (None, 3)),  # slot, body, link
    "obstacles": ("i", (None, 3)),  # body, link, shape
    "links": ("i", (None, 2)),  # body, link
    "hold_places": ("i", (None, 6)),  # tendon, particle, kind, number, body, link
    "hold_numbers": ("f", (None, 9)),  # point 3, stiffness, damping, direction 3, largest force; NaN: none
    "digest": ("u", (32,)),
}


@dataclasses.dataclass(frozen=True)
class State:
    """What a world was like.

    core: the core's bytes; parts, links: what has to be the same; anchors: handles, and what they stood for.
    """

    core: bytes
    parts: tuple
    links: tuple
    anchors: tuple


class States:
    """Saves and restores a world that is made of these parts."""

    def __init__(
        self,
        core: _core.World,
        bodies: Bodies,
        obstacles: Obstacles,
        tendons: dict[int, Tendon],
        tunnels: dict[int, Tunnel],
        numbers: Numbers,
        stepper: Stepper,
    ):
        self._core, self._bodies, self._obstacles = core, bodies, obstacles
        self._by_slot, self._tunnels = tendons, tunnels
        self._numbers, self._stepper = numbers, stepper
        self._saved: dict[int, State] = {}

    def save(self) -> int:
        """See TendonWorld.save_state."""
        number = self._numbers.next()
        self._saved[number] = self.capture()
        return number

    def restore(self, number: int) -> None:
        """See TendonWorld.restore_state."""
        state = self._saved[self._known(number)]
        self._require_parts(state.parts, "state", number)
        alive = self._bodies.marked_links()
        gone = [
            link
            for slot, link in enumerate(state.links)
            if link is not None and (slot >= len(alive) or alive[slot] != link or self._bodies.is_gone(slot))
        ]
        if gone and self._refers(state, {state.links.index(link) for link in gone}):
            raise StateMismatch("state", number, f"of bodies that are still there, not {gone[0][:2]}")
        self._restore_core(state.core, "state", number)
        self._restore_anchors(state.anchors)

    def remove(self, number: int) -> None:
        """See TendonWorld.remove_state."""
        del self._saved[self._known(number)]

    def capture(self) -> State:
        """The state now."""
        self._bodies.keep_contacts()
        anchors = tuple((anchor, anchor._settings()) for t in self._tendons() for anchor in t.holds)
        links = self._bodies.marked_links()
        return State(self._core.save(), self._parts(), links, anchors)

    def take_back(self, state: State) -> None:
        """Undo what a call did that is then refused: parts are what they were, whatever pybullet holds."""
        self._restore_core(state.core, "state", "before the call")
        self._restore_anchors(state.anchors)

    def hash(self, in_use: set[int]) -> str:
        """See TendonWorld.state_hash. in_use: slots of the links that something refers to."""
        state = self.capture()
        anchors = [
            (a._tendon.name, a.particle, {k: _plain(v) for k, v in settings.items()})
            for a, settings in state.anchors
        ]
        bodies = [state.links[slot][:2] for slot in sorted(in_use)]
        digest = hashlib.blake2b(state.core, digest_size=16)
        digest.update(repr((state.parts, bodies, anchors, self._stepper.options)).encode())
        return digest.hexdigest()

    def snapshot(self, path=None) -> bytes:
        """See TendonWorld.snapshot."""
        data = self._pack()
        if path is not None:
            Path(checks.path("path", path)).write_bytes(data)
        return data

    def load_snapshot(self, source) -> None:
        """See TendonWorld.load_snapshot."""
        data = _read(source)
        shown = "bytes" if isinstance(source, (bytes, bytearray)) else source
        self._require_parts(_parts_of(data), "source", shown)
        missing = self._missing_links(data["links"], shown)
        self._require_anchors(data, shown)
        before = self._core.save()
        self._restore_core(data["core"].tobytes(), "source", shown)
        if not self._core_agrees(data):
            self._core.restore(before)
            raise SnapshotError(
                "source", shown, "a snapshot whose core has the links and holds of its tables"
            )
        for body, link in missing:
            self._bodies.slot(body, link)
        rows = zip(data["hold_places"], data["hold_numbers"], strict=True)
        self._restore_anchors([self._anchor(*row) for row in rows])
        for number in data["hold_places"][:, 3].tolist():
            self._numbers.skip(number)

    def _tendons(self) -> tuple[Tendon, ...]:
        return tuple(self._by_slot.values())

    def _parts(self) -> tuple:
        """What the world is made of, as far as the core does not know it itself (by _PARTS)."""
        tendons = tuple((t._slot, t.name) for t in self._tendons())
        tunnels = tuple((t.slot, t.name, t.bodyUniqueId, t.linkIndex) for t in self._tunnels.values())
        return tendons, tunnels, self._obstacles.listing()

    def _known(self, number) -> int:
        checked = checks.integer("state", number)
        if checked not in self._saved:
            raise UnknownId("state", number, f"one of save_state, not removed: {list(self._saved)}")
        return checked

    def _require_parts(self, parts: tuple, argument: str, value) -> None:
        for what, have, want in zip(_PARTS, self._parts(), parts, strict=True):
            if have != want:
                raise StateMismatch(argument, value, f"of a world with the {what} {have}, not {want}")

    def _restore_core(self, core: bytes, argument: str, value) -> None:
        try:
            self._core.restore(core)
        except RuntimeError as problem:
            raise StateMismatch(argument, value, str(problem)) from None

    def _restore_anchors(self, anchors) -> None:
        """Anchors (handle, settings) become the tendons'; the core has them already."""
        for tendon in self._tendons():
            for anchor in tendon.holds:
                anchor._forget()
        for anchor, settings in anchors:
            anchor._restore(settings)

    def _refers(self, state: State, slots: set[int]) -> bool:
        """Whether anything would refer to the slots after the state was put back."""
        attached = {getattr(anchor, "link_slot", None) for anchor, _ in state.anchors}
        tunnels = {t.link_slot for t in self._tunnels.values()}
        return bool(slots & (attached | tunnels | self._obstacles.link_slots()))

    def _pack(self) -> bytes:
        self._bodies.keep_contacts()
        tendons, tunnels, obstacles = self._parts()
        links = [key[:2] if key else _NO_LINK for key in self._bodies.marked_links()]
        places, numbers = [], []
        for index, tendon in enumerate(self._tendons()):
            for anchor in tendon.holds:
                place, values = _packed(anchor)
                places.append((index, anchor.particle, *place))
                numbers.append(values)
        arrays = {
            "version": np.array(VERSION),
            "core": np.frombuffer(self._core.save(), np.uint8),
            "tendons": np.array([name for _, name in tendons], dtype=str),
            "tendon_slots": np.array([slot for slot, _ in tendons], dtype=int),
            "tunnels": np.array([name for _, name, *_ in tunnels], dtype=str),
            "tunnel_slots": _table([(slot, *where) for slot, _, *where in tunnels], 3),
            "obstacles": _table([(b, i, shape) for b, i, *shapes in obstacles for shape in shapes], 3),
            "links": _table(links, 2),
            "hold_places": _table(places, 6),
            "hold_numbers": np.array(numbers, dtype=float).reshape(-1, 9),
        }
        file = io.BytesIO()
        np.savez(file, **arrays, digest=digest_of(arrays))
        return file.getvalue()

    def _core_agrees(self, data) -> bool:
        """Whether the core that was restored has no more links than the table, and every hold of it."""
        if len(self._core.wrenches()) > len(data["links"]):
            return False
        tendons = self._tendons()
        try:
            for index, _, _, number, *_ in data["hold_places"].tolist():
                self._core.anchor_force(tendons[index]._slot, number)
        except KeyError:
            return False
        return True

    def _anchor(self, place, values) -> tuple[Grip | LinkAnchor, dict]:
        """The handle for an anchor of the snapshot: the world's own where it has one, and its settings."""
        index, particle, kind, number, body, link = map(int, place)
        tendon = self._tendons()[index]
        own = tendon._anchors.get(particle)
        if kind in _ON_LINKS:
            made = _ON_LINKS[kind]
            fits = isinstance(own, made) and (own.bodyUniqueId, own.linkIndex) == (body, link)
            where = (body, link, values[:3].copy(), self._bodies.slot(body, link))
            anchor = own if fits else made(tendon, particle, number, *where)
            anchor._position = values[:3].copy()
            return anchor, {"number": number}
        settings = {
            "number": number,
            "stiffness": None if np.isnan(values[3]) else float(values[3]),
            "damping": float(values[4]),
            "target": values[:3].copy(),
            "direction": None if np.isnan(values[5]) else values[5:8].copy(),
            "max_force": None if np.isnan(values[8]) else float(values[8]),
        }
        anchor = own if isinstance(own, Grip) else Grip.__new__(Grip)
        if anchor is not own:
            super(Grip, anchor).__init__(tendon, particle, number)
        return anchor, settings

    def _missing_links(self, links, shown) -> list:
        """Links of the snapshot that the world does not know yet, in the order of their slots."""
        have = [key[:2] if key else _NO_LINK for key in self._bodies.marked_links()]
        want = [tuple(row) for row in links.tolist()]
        if have[: len(want)] != want[: len(have)] or _NO_LINK in want[len(have) :]:
            raise StateMismatch(
                "source", shown, "of a world whose tendons touch the same links, in the same order"
            )
        for body, link in want:
            if (body, link) != _NO_LINK:
                try:
                    self._bodies.require(body, link)
                except UnknownId:
                    allowed = f"of links that are there, not link {link} of body {body}"
                    raise StateMismatch("source", shown, allowed) from None
        return want[len(have) :]

    def _require_anchors(self, data, shown) -> None:
        """Raise SnapshotError where an anchor is none that a tendon of this world could have."""
        tendons = self._tendons()
        links = {tuple(row) for row in data["links"].tolist()} - {_NO_LINK}
        for place, values in zip(data["hold_places"].tolist(), data["hold_numbers"], strict=True):
            index, particle, kind, _, *where = place
            there = index < len(tendons) and particle < tendons[index].particles
            if kind in _ON_LINKS:
                fits = there and tuple(where) in links
            else:
                fits = there and _could_be_clamped(tendons[index], particle, values[5:8])
            if not fits:
                raise SnapshotError("source", shown, f"a snapshot of holds that there can be, not {place}")


def _packed(anchor) -> tuple[tuple, np.ndarray]:
    settings, values = anchor._settings(), np.full(9, np.nan)
    if isinstance(anchor, LinkAnchor):
        values[:3] = settings["position"]
        kind = _LINE if isinstance(anchor, Line) else _ATTACHMENT
        return (kind, settings["number"], settings["bodyUniqueId"], settings["linkIndex"]), values
    values[:3], values[4] = settings["target"], settings["damping"]
    if settings["stiffness"] is not None:
        values[3] = settings["stiffness"]
    if settings["direction"] is not None:
        values[5:8] = settings["direction"]
    if settings["max_force"] is not None:
        values[8] = settings["max_force"]
    return (_GRIP, settings["number"], -1, -1), values


def _could_be_clamped(tendon, particle: int, direction) -> bool:
    if np.isnan(direction).all():
        return True
    is_end = particle in (0, tendon.particles - 1)
    is_unit = abs(np.linalg.norm(direction) - 1) < 1e-9
    return is_end and is_unit and tendon.material.bending_stiffness > 0


def _parts_of(data) -> tuple:
    tendons = tuple(zip(data["tendon_slots"].tolist(), data["tendons"].tolist(), strict=True))
    tunnels = tuple(
        (slot, name, *where)
        for name, (slot, *where) in zip(data["tunnels"].tolist(), data["tunnel_slots"].tolist(), strict=True)
    )
    shapes: dict[tuple, list] = {}
    for body, link, shape in data["obstacles"].tolist():
        shapes.setdefault((body, link), []).append(shape)
    return tendons, tunnels, tuple((*key, *numbers) for key, numbers in shapes.items())


def _read(source) -> dict[str, np.ndarray]:
    """The arrays of a snapshot, each of its kind and shape, and undamaged; or SnapshotError."""
    if isinstance(source, (bytes, bytearray)):
        shown, raw = "bytes", bytes(source)
    else:
        try:
            shown = checks.path("source", source)
        except InvalidType:
            raise InvalidType("source", source, "the bytes or the path of a snapshot") from None
        try:
            raw = Path(shown).read_bytes()
        except (OSError, ValueError) as problem:
            raise SnapshotError("source", shown, f"a file that can be read ({problem})") from None
    if not zipfile.is_zipfile(
        io.BytesIO(raw)
    ):  # numpy would take it for a pickle, and recommend to load that
        raise SnapshotError("source", shown, "a snapshot, a numpy npz file")
    try:
        with np.load(io.BytesIO(raw), allow_pickle=False) as file:
            data = {name: file[name] for name in file.files}
    except Exception as problem:  # of zipfile, zlib, struct, numpy and its parser of headers
        raise SnapshotError("source", shown, f"a snapshot, a numpy npz file ({problem})") from None
    return _checked(data, shown)


def _checked(data, shown) -> dict[str, np.ndarray]:
    version = data.get("version")
    if version is None or version.shape != () or version.dtype.kind != "i" or version != VERSION:
        raise SnapshotError(
            "source",
            shown,
            f"a snapshot of version {VERSION}, not {version} (another version of the package wrote it)",
        )
    for name, (kind, shape) in _ARRAYS.items():
        if name not in data:
            raise SnapshotError("source", shown, f"a snapshot with an array {name!r}")
        have = data[name]
        fits = have.dtype.kind == kind and have.ndim == len(shape)
        if not fits or any(want not in (None, size) for size, want in zip(have.shape, shape, strict=True)):
            raise SnapshotError("source", shown, f"a snapshot whose {name!r} has the shape {shape}")
    arrays = {name: data[name] for name in _ARRAYS if name != "digest"}
    if not np.array_equal(digest_of(arrays), data["digest"]):
        raise SnapshotError("source", shown, "an undamaged snapshot: its digest does not fit its arrays")
    for name, have in arrays.items():
        if have.dtype.kind in "if":
            arrays[name] = have.astype(np.int64 if have.dtype.kind == "i" else np.float64)
    for what, fits in _consistency(arrays):
        if not fits:
            raise SnapshotError("source", shown, f"a snapshot whose {what}")
    return arrays


def _consistency(arrays):
    """What of a snapshot's arrays must be true whatever world they are of: texts, and whether it is."""
    yield "'core' is bytes", arrays["core"].dtype == np.uint8
    for names, rows in (("tendons", "tendon_slots"), ("tunnels", "tunnel_slots")):
        yield f"{rows!r} has a row for each of {names!r}", len(arrays[names]) == len(arrays[rows])
    links = [tuple(row) for row in arrays["links"].tolist() if tuple(row) != _NO_LINK]
    known = all(body >= 0 and link >= -1 for body, link in links)
    yield "'links' are links, each once", known and len(set(links)) == len(links)
    yield from _holds_consistency(arrays["hold_places"], arrays["hold_numbers"])


def _holds_consistency(places, numbers):
    yield "'hold_numbers' has a row for each of 'hold_places'", len(places) == len(numbers)
    tendon, particle, kind, number, body, link = places.T
    yield "holds are of tendons and particles >= 0", (tendon >= 0).all() and (particle >= 0).all()
    yield "holds are grips, attachments or lines", np.isin(kind, (_GRIP, *_ON_LINKS)).all()
    yield "holds hold different particles", len(np.unique(places[:, :2], axis=0)) == len(places)
    within = ((number > 0) & (number < _MOST_NUMBER)).all()
    yield "holds have different numbers > 0", within and len(np.unique(number)) == len(number)
    grips = kind == _GRIP
    yield "grips hold no links", ((body[grips] == -1) & (link[grips] == -1)).all()
    yield "holds are at finite points", np.isfinite(numbers[:, :3]).all()
    stiffness, damping, direction = numbers[grips, 3], numbers[grips, 4], numbers[grips, 5:8]
    most = numbers[grips, 8]
    soft = ~np.isnan(stiffness)
    yield "grips have a stiffness > 0 or none", (np.isfinite(stiffness) & (stiffness > 0))[soft].all()
    yield "grips have a damping >= 0", (np.isfinite(damping) & (damping >= 0)).all()
    limited = ~np.isnan(most)
    yield "grips have a largest force > 0 or none", (np.isfinite(most) & (most > 0))[limited].all()
    clamped = ~np.isnan(direction).all(axis=1)
    yield "grips have a finite direction or none", np.isfinite(direction[clamped]).all()


def digest_of(arrays) -> np.ndarray:
    digest = hashlib.blake2b(digest_size=32)
    for name in sorted(arrays):
        digest.update(repr((name, arrays[name].shape, arrays[name].dtype.str)).encode())
        digest.update(np.ascontiguousarray(arrays[name]).tobytes())
    return np.frombuffer(digest.digest(), np.uint8)


def _table(rows, width) -> np.ndarray:
    return np.array(rows, dtype=np.int64).reshape(-1, width)


def _plain(value):
    return value.tolist() if isinstance(value, np.ndarray) else value
