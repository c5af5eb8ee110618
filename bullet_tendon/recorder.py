"""Recorder: keeps frames of a world while it runs; off, it is not there.

Owns: the frames, until they are a Recording. Goes with no room of the core. A frame is a few copies of
arrays: what they mean is worked out when somebody asks for the recording.
"""

from collections.abc import Callable
from os import PathLike
from typing import NamedTuple

import numpy as np
import pybullet as p
from scipy.spatial.transform import Rotation

from . import checks
from .bodies import Bodies, Marks, checked_body
from .errors import InvalidType, NotCopied
from .lens import checked_camera
from .ligament import Ligament, line_of
from .recording import CONTACTS, HOLDS, LigamentTrack, LinkTrack, Recording, TendonTrack, TunnelTrack
from .reports import KINDS
from .tendon import Tendon
from .visual_meshes import visual_meshes
from .world import TendonWorld

_FRAME_BYTES = 250  # of a frame beside its moment
_SCALAR_BYTES = 150  # of a named number of a frame
_LEAST_MEMORY = 1_000_000
_NONE: dict[str, float] = {}  # of frames without named numbers
_PIECE = 1 << 20  # bytes that are allotted at once: in larger ones Linux clears 2 MB in one step


class _Blocks(NamedTuple):
    """What the core says of a moment: see `moment` in core/bindings/world.cpp."""

    shapes: np.ndarray
    energies: np.ndarray
    anchors: np.ndarray
    contacts: np.ndarray
    ligaments: np.ndarray
    poses: np.ndarray


class _Frame(NamedTuple):
    """One moment, as it was read: bytes `start` to `end` of `memory`. layout: what slots in it mean.

    bodies: by id, the number and the joints of a body that was there. A recorder has frames as tuples, which
    take less time to make.
    """

    time: float
    step: int
    memory: np.ndarray
    start: int
    end: int
    layout: "_Layout"
    bodies: dict[int, tuple[int, list[int]]]
    scalars: dict[str, float]

    @property
    def blocks(self) -> _Blocks:
        """The moment as arrays: (k,), (t,), (a, 6), (c, 14), (l, 2) and (p, 7)."""
        counts = np.frombuffer(self.memory, np.int32, 6, self.start)
        found, start = [], self.start + counts.nbytes
        for count, width in zip(counts, (1, 1, 6, 14, 2, 7), strict=True):
            kind = np.dtype(np.float64 if len(found) == 5 else np.float32)
            block = np.frombuffer(self.memory, kind, count, start)
            found.append(block if width == 1 else block.reshape(-1, width))
            start += block.nbytes
        return _Blocks(*found)

    def poses(self):
        """Of each body, its number and the poses (1 + joints, 7) of its base's centre of mass and links."""
        poses, link = self.blocks.poses, len(self.bodies)
        for base, (number, joints) in enumerate(self.bodies.values()):
            yield number, np.vstack([poses[base], poses[link : link + len(joints)]])
            link += len(joints)


_STEP, _START, _SCALARS = map(_Frame._fields.index, ("step", "start", "scalars"))


def _size_of(frame: tuple) -> int:
    """Bytes that a frame takes."""
    found = _Frame._make(frame)
    return _FRAME_BYTES + found.end - found.start + _SCALAR_BYTES * len(found.scalars)


class _Memory:
    """Memory in pieces, in which moments lie one behind the other. None of them lies in two pieces.

    most: bytes of a piece, at most.
    """

    def __init__(self, most: float):
        self._size = min(_PIECE, int(most))
        self._pieces = [np.empty(self._size, np.uint8)]
        self._piece, self._end = self._pieces[-1], 0  # the last one, and the end of what is used of it

    def write(self, moment: Callable, arguments: tuple, start: int | None) -> tuple[np.ndarray, int, int]:
        """Keep what `moment`, of the core, writes: its piece, and where it begins and ends there.

        start: of the last moment, where this one takes its place. Nothing has changed where `moment` raises.
        """
        piece, start = self._piece, self._end if start is None else start
        end = moment(piece, start, *arguments)
        if end < 0:
            piece, start = np.empty(max(self._size, -end), np.uint8), 0
            end = moment(piece, start, *arguments)
            self._pieces.append(piece)
            self._piece = piece
        self._end = end
        return piece, start, end

    def keep(self, frames: list[tuple]) -> list[tuple]:
        """Move what these frames have, in their order, to the beginning, and give up all else."""
        kept, at, self._end = [], 0, 0
        for frame in map(_Frame._make, frames):
            size = frame.end - frame.start
            while self._end + size > self._pieces[at].size:
                at, self._end = at + 1, 0
            piece, start = self._pieces[at], self._end
            self._end += size
            piece[start : self._end] = frame.memory[frame.start : frame.end]
            kept.append(tuple(frame._replace(memory=piece, start=start, end=self._end)))
        del self._pieces[at + 1 :]
        self._piece = self._pieces[-1]
        return kept


class _Layout(NamedTuple):
    """What slots of the core mean. tendons: with their slots and numbers of particles, by slot."""

    tendons: tuple[tuple[Tendon, int, int], ...]
    links: tuple[tuple[int, int], ...]
    ligaments: dict[int, Ligament]

    def shapes(self, row: np.ndarray):
        """Of each tendon, positions (n, 3) and tension (n-1,) in the row of a moment."""
        start = 0
        for _, _, n in self.tendons:
            yield row[start : start + 3 * n].reshape(n, 3), row[start + 3 * n : start + 4 * n - 1]
            start += 4 * n - 1

    def numbers(self, order: dict[Tendon, int]) -> np.ndarray:
        """By slot, the number of a tendon in `order`."""
        found = np.full(1 + max((slot for _, slot, _ in self.tendons), default=0), -1)
        for tendon, slot, _ in self.tendons:
            found[slot] = order[tendon]
        return found

    def bodies(self, slots) -> np.ndarray:
        """(k, 2) bodyUniqueId and linkIndex of links by slot; -1, -1 for slot -1."""
        return np.array([*self.links, (-1, -1)])[slots]


class Recorder(NotCopied):
    """Keeps centrelines, tensions, contact forces, poses of bodies and named scalars of a world's run.

    It changes nothing in the run. Stop it with stop, or use it in a `with` statement.

    Args:
        world: the TendonWorld.
        every: keep the present moment and then each so many steps by itself, whether steps are taken by
            TendonWorld.step or by apply and p.stepSimulation. None: only where frame is called.
        scalars: name -> function without arguments, whose number is kept with each frame.
        memory: [bytes], >= 1e6, and
        most_frames: >= 2. Where more is needed, every second frame is given up, and from then on every second
            one is kept, so that the recording always covers the whole run.
        camera: arguments of view.Camera that show the scene in replays; without target and distance, all
            tendons, ligaments and the links around them are seen.
        bones: ids of bodies that replays show translucent. None: triangle meshes, and what has tunnels.
        title: of replays and plots.

    Raises:
        InvalidType, InvalidValue: naming the argument.
        UnknownId: for bones that are no bodies of the world's client, or where that was disconnected.

    Example:
        >>> with bt.Recorder(world, every=2) as recorder:
        ...     world.step(20)
        >>> len(recorder), recorder.recording.tendons[0].positions.shape
        (11, (11, 11, 3))
    """

    def __init__(
        self,
        world: TendonWorld,
        every: int | None = None,
        scalars: dict[str, Callable[[], float]] | None = None,
        memory: float = 256e6,
        most_frames: int | None = None,
        camera: dict | None = None,
        bones: tuple[int, ...] | None = None,
        title: str = "",
    ):
        if not isinstance(world, TendonWorld):
            raise InvalidType("world", world, "a TendonWorld")
        world._bodies.require_client()
        self._world = world
        self._client = world.physicsClientId
        self._core = world._core
        self.every = None if every is None else checks.integer("every", every, at_least=1)
        self.time = 0.0
        self.steps = 0
        self.camera = None if camera is None else checked_camera(camera)
        self.bones = None if bones is None else _checked_bones(world, bones)
        if not isinstance(title, str):
            raise InvalidType("title", title, "a string")
        self.title = title
        self._functions = {} if scalars is None else _checked_functions(scalars)
        self._memory = checks.number("memory", memory, at_least=_LEAST_MEMORY)
        self._most = None if most_frames is None else checks.integer("most_frames", most_frames, at_least=2)
        self._frames: list[tuple] = []  # of what a _Frame has
        self._bytes = 0
        self._kept = _Memory(self._memory)
        self._share = 1  # one of so many calls of frame is kept
        self._calls = 0
        self._seen = _Bodies(self._client, world._bodies)
        self._look()
        self._world._listeners.next_begins()  # a step that was applied before is not one of the recording
        if self.every is not None:
            self._keep(_NONE)
        self._world._listeners.add(self._step_taken)

    def __len__(self) -> int:
        """How many frames are kept."""
        return len(self._frames)

    def __repr__(self) -> str:
        how = "on request" if self.every is None else f"every {self.every} steps"
        return f"<Recorder, {how}: {len(self)} frames over {self.time:.4g} s, {self._bytes / 1e6:.3g} MB>"

    def frame(self, **scalars: float) -> None:
        """Keep the present moment, with named numbers.

        Raises:
            InvalidType, InvalidValue: for a scalar that is no finite number.
            UnknownId: where the client was disconnected. Then nothing has changed.

        Example:
            >>> recorder = bt.Recorder(world)
            >>> recorder.frame(pull=3.2)
            >>> recorder.recording.scalar("pull")
            (array([0.]), array([3.2]))
        """
        values = {name: checks.number(name, value) for name, value in scalars.items()}
        self._world._bodies.require_client()
        self._world._listeners.next_begins()
        self._calls += 1
        if (self._calls - 1) % self._share == 0:
            self._keep(values)

    def stop(self) -> None:
        """Keep no more by itself; what was kept stays. A second call does nothing.

        Example:
            >>> recorder = bt.Recorder(world, every=1)
            >>> recorder.stop()
            >>> world.step(5)
            >>> len(recorder)
            1
        """
        self._world._listeners.next_begins()
        self._world._listeners.discard(self._step_taken)

    @property
    def recording(self) -> Recording:
        """What was kept so far."""
        self._world._listeners.next_begins()
        return _recording(self)

    def save(self, path: str | PathLike, **options) -> None:
        """Write what was kept so far: see Recording.save.

        Example:
            >>> recorder = bt.Recorder(world, every=1)
            >>> world.step(5)
            >>> recorder.save("run.npz")
        """
        self.recording.save(path, **options)

    @staticmethod
    def load(path: str | PathLike) -> Recording:
        """Read a ".npz" file: see Recording.load.

        Example:
            >>> bt.Recorder(world, every=1).save("run.npz")
            >>> len(bt.Recorder.load("run.npz"))
            1
        """
        return Recording.load(path)

    def __enter__(self) -> "Recorder":
        return self

    def __exit__(self, *_) -> None:
        self.stop()

    def _step_taken(self, at_once: bool) -> None:
        self.steps += 1
        self.time += self._core.last_step()[0]
        if self.every is not None and self.steps % self.every == 0:
            self._keep(_NONE, at_once)

    def _keep(self, values: dict, at_once: bool = False) -> None:
        """Keep a frame. at_once: what stands is where it was when the last step began."""
        world, frames, step = self._world, self._frames, self.steps
        if self._functions:
            named = self._functions.items()
            values = {**values, **{name: checks.number(name, function()) for name, function in named}}
        again = frames[-1] if frames and frames[-1][_STEP] == step else None
        start = None
        if again:
            start, values = again[_START], {**again[_SCALARS], **values}
        is_known = world._tendons == self._tendons and world._ligaments is self._ligaments
        if not is_known or world._bodies.revision != self._revision:
            self._look()
        bodies = self._seen.present(at_once)
        piece, start, end = self._kept.write(self._core.moment, self._seen.places(at_once), start)
        if again:
            self._bytes -= _size_of(frames.pop())
        frame = (self.time, step, piece, start, end, self._layout, bodies, values)
        frames.append(frame)
        self._bytes += _size_of(frame) if values else _FRAME_BYTES + end - start
        if self._bytes > self._memory or (self._most is not None and len(frames) > self._most):
            self._thin()

    def _look(self) -> None:
        """See which tendons, ligaments and links there are."""
        world = self._world
        self._tendons, self._ligaments = dict(world._tendons), world._ligaments
        self._revision = world._bodies.revision
        self._seen.look_at_slots()
        tendons = tuple((tendon, slot, tendon.particles) for slot, tendon in sorted(self._tendons.items()))
        self._layout = _Layout(tendons, tuple(world._bodies.links), self._ligaments)

    def _thin(self) -> None:
        """Give up every second frame, and keep half as many from now on."""
        self._frames = self._kept.keep(self._frames[::2])
        self._bytes = sum(map(_size_of, self._frames))
        self._share *= 2
        if self.every is not None:
            self.every *= 2


class _Sight(NamedTuple):
    """A body as it was first seen: rows of p.getVisualShapeData, base's inertial frame, names by link."""

    body: int
    shapes: tuple
    inertial: tuple
    names: dict[int, str]


class _Bodies:
    """The bodies of a client as they were first seen, numbered, and their poses.

    pybullet gives the id of a removed body to another one, which is seen as a body of its own.
    """

    def __init__(self, client: int, read: Bodies):
        self._client = client
        self._read = read  # those that steps read
        self._present: dict[int, tuple[int, list[int]]] = {}  # number and joints, by id
        self._marks = Marks(client)
        self._mark_of: dict[int, tuple[int, bytes]] = {}  # by id
        self._others: list[tuple[int, bytes]] = []  # marks of those that steps do not read
        self._bases: list[tuple] = []  # slot, and arguments of p.getBasePositionAndOrientation
        self._jointed: list[tuple] = []  # arguments of p.getLinkStates
        self.seen: list[_Sight] = []  # by number

    def look_at_slots(self) -> None:
        """See which bodies steps read, and see to be there."""
        read, client, find = self._read.marks_read(), self._client, self._read.find_slot
        self._others = [mark for mark in self._mark_of.values() if mark not in read]
        slots = {body: find(body, -1) for body in self._present}
        self._bases = [(-1 if slot is None else slot, (body, client)) for body, slot in slots.items()]
        jointed = ((body, joints) for body, (_, joints) in self._present.items() if joints)
        self._jointed = [(body, joints, 0, 1, client) for body, joints in jointed]

    def present(self, at_once: bool) -> dict[int, tuple[int, list[int]]]:
        """By id, the number and the joints of each body that is there.

        at_once: nothing has come or gone since the last step began.
        """
        marks = self._others if at_once else self._mark_of.values()
        there = p.getNumBodies(self._client) == len(self._mark_of)
        if not there or (marks and not self._marks.all_hold(marks)):
            self._look()
        return self._present

    def places(self, at_once: bool) -> tuple:
        """What `moment` takes: of bases, of which it asks for those that move in a step, and of all links."""
        links = [state for asked in self._jointed for state in p.getLinkStates(*asked)]
        return at_once, self._bases, p.getBasePositionAndOrientation, links

    def _look(self) -> None:
        ids = [p.getBodyUniqueId(i, self._client) for i in range(p.getNumBodies(self._client))]
        known = {
            body: found for body, found in self._present.items() if self._marks.holds(self._mark_of[body])
        }
        self._present = {body: known[body] if body in known else self._meet(body) for body in ids}
        self._mark_of = {body: self._marks.mark(body) for body in ids}
        self.look_at_slots()

    def _meet(self, body: int) -> tuple[int, list[int]]:
        client = self._client
        joints = list(range(p.getNumJoints(body, client)))
        base, name = (part.decode(errors="replace") for part in p.getBodyInfo(body, client))
        own = name or f"body {body}"
        names = {-1: f"{own} {base}" if joints and base else own}
        for joint in joints:
            names[joint] = f"{own} {p.getJointInfo(body, joint, client)[12].decode(errors='replace')}"
        shapes = p.getVisualShapeData(body, physicsClientId=client)
        self.seen.append(_Sight(body, shapes, p.getDynamicsInfo(body, -1, client)[3:5], names))
        return len(self.seen) - 1, joints


def _recording(recorder: Recorder) -> Recording:
    frames = [_Frame._make(frame) for frame in recorder._frames]
    tendons = _tendon_tracks(frames)
    order = {tendon: number for number, tendon in enumerate(tendons)}
    world = recorder._world
    links = _link_tracks(frames, recorder._seen, world._obstacles.of_link)
    tunnels = tuple(
        TunnelTrack(t.name, t.bodyUniqueId, t.linkIndex, t.start.copy(), t.end.copy(), t.radius)
        for t in world.tunnels
    )
    return Recording(
        times=np.array([frame.time for frame in frames]),
        steps=np.array([frame.step for frame in frames], int),
        tendons=tuple(tendons.values()),
        links=links,
        ligaments=_ligament_tracks(frames, links),
        tunnels=tunnels,
        contacts=_contact_table(frames, order),
        holds=_hold_table(frames, order),
        scalars=_scalars(frames),
        camera=None if recorder.camera is None else dict(recorder.camera),
        bones=_bones(world) if recorder.bones is None else tuple(recorder.bones),
        title=recorder.title,
    )


def _tendon_tracks(frames) -> dict[Tendon, TendonTrack]:
    rows: dict[Tendon, list] = {}
    for k, frame in enumerate(frames):
        shapes, energies = frame.layout.shapes(frame.blocks.shapes), frame.blocks.energies
        for (tendon, *_), shape, energy in zip(frame.layout.tendons, shapes, energies, strict=True):
            rows.setdefault(tendon, []).append((k, *shape, energy))
    return {
        tendon: TendonTrack(tendon.name, tendon.radius, *map(np.array, zip(*of_it, strict=True)))
        for tendon, of_it in rows.items()
    }


def _contact_table(frames, order: dict[Tendon, int]) -> np.ndarray:
    counts = [len(frame.blocks.contacts) for frame in frames]
    table = np.zeros(sum(counts), CONTACTS)
    table["frame"] = np.repeat(np.arange(len(frames)), counts)
    for frame, part in zip(frames, _parts(table, counts), strict=True):
        rows = frame.blocks.contacts
        tendon, segment, _, link, kind = rows[:, :5].astype(int).T
        part["tendon"], part["segment"] = frame.layout.numbers(order)[tendon], segment
        part["bodyUniqueId"], part["linkIndex"] = frame.layout.bodies(link).T
        part["kind"] = np.array(KINDS)[kind]
        part["position"], part["normal"] = rows[:, 5:8], rows[:, 8:11]
        part["distance"], part["normal_force"], part["friction_force"] = rows[:, 11:14].T
    return table


def _parts(table: np.ndarray, counts: list[int]) -> list[np.ndarray]:
    """The rows of each frame, of which there are so many."""
    ends = np.cumsum(counts, dtype=int)
    return [table[end - count : end] for end, count in zip(ends, counts, strict=True)]


def _hold_table(frames, order: dict[Tendon, int]) -> np.ndarray:
    counts = [len(frame.blocks.anchors) for frame in frames]
    table = np.zeros(sum(counts), HOLDS)
    table["frame"] = np.repeat(np.arange(len(frames)), counts)
    for frame, part in zip(frames, _parts(table, counts), strict=True):
        anchors = frame.blocks.anchors
        tendon, particle, link = anchors[:, :3].astype(int).T
        part["tendon"], part["particle"] = frame.layout.numbers(order)[tendon], particle
        part["bodyUniqueId"], part["linkIndex"] = frame.layout.bodies(link).T
        part["force"] = anchors[:, 3:]
    return table


def _link_tracks(frames, bodies: _Bodies, shapes_of) -> tuple[LinkTrack, ...]:
    rows: dict[int, list] = {}
    for k, frame in enumerate(frames):
        for number, pose in frame.poses():
            rows.setdefault(number, []).append((k, pose))
    tracks = []
    for number, of_it in rows.items():
        sight = bodies.seen[number]
        looks = visual_meshes(sight.shapes, sight.body, shapes_of)
        kept, poses = zip(*of_it, strict=True)
        table = np.array(poses)
        table[:, 0] = _base_frames(table[:, 0], *sight.inertial)
        for link, name in sight.names.items():
            places, turns = np.split(table[:, link + 1].astype(np.float32), [3], axis=1)
            meshes = looks.get(link, ())
            tracks.append(LinkTrack(name, sight.body, link, np.array(kept), places, turns, meshes))
    return tuple(tracks)


def _ligament_tracks(frames, links: tuple[LinkTrack, ...]) -> tuple[LigamentTrack, ...]:
    """Forces as they were read; the lines where the links were. Only while all its links were there."""
    rows: dict[Ligament, list] = {}
    for k, frame in enumerate(frames):
        for slot, force in frame.blocks.ligaments.tolist():
            rows.setdefault(frame.layout.ligaments[int(slot)], []).append((k, force))
    known: dict[tuple[int, int], list[LinkTrack]] = {}  # of bodies that had the same id one after the other
    for track in links:
        known.setdefault((track.bodyUniqueId, track.linkIndex), []).append(track)
    used = set().union(*(ligament.links for ligament in rows))
    placed = {link: _Placement.of(known[link]) for link in used & known.keys()}
    tracks = []
    for ligament, of_it in rows.items():
        if not ligament.links <= placed.keys():
            continue
        numbers, forces = (np.array(column) for column in zip(*of_it, strict=True))
        places = {link: placed[link] for link in ligament.links}
        there = np.all([np.isin(numbers, place.frames) for place in places.values()], axis=0)
        numbers, forces = numbers[there], forces[there]
        if numbers.size:
            moved = {link: place.at(numbers) for link, place in places.items()}
            lines = line_of(ligament, moved).astype(np.float32)
            tracks.append(LigamentTrack(ligament.name, numbers, lines, forces.astype(np.float32)))
    return tuple(tracks)


class _Placement(NamedTuple):
    """Where a link was in frames (k,) that ascend: positions (k, 3) and orientations (k, 4)."""

    frames: np.ndarray
    position: np.ndarray
    orientation: np.ndarray

    @classmethod
    def of(cls, tracks: list[LinkTrack]) -> "_Placement":
        columns = zip(*((track.frames, track.position, track.orientation) for track in tracks), strict=True)
        frames, position, orientation = map(np.concatenate, columns)
        order = frames.argsort()
        return cls(frames[order], position[order], orientation[order])

    def at(self, numbers) -> tuple[np.ndarray, np.ndarray]:
        """Origins (m, 3) and axes (m, 3, 3) in the frames (m,), which are among those known."""
        rows = np.searchsorted(self.frames, numbers)
        return self.position[rows].astype(float), Rotation.from_quat(self.orientation[rows]).as_matrix()


def _base_frames(poses, position, orientation) -> np.ndarray:
    """URDF frames (k, 7) of poses (k, 7) of a centre of mass, whose inertial frame is that in the link's."""
    own = Rotation.from_quat(orientation)
    turns = Rotation.from_quat(poses[:, 3:]) * own.inv()
    return np.hstack([poses[:, :3] - turns.apply(position), turns.as_quat()])


def _scalars(frames) -> dict:
    rows: dict[str, list] = {}
    for k, frame in enumerate(frames):
        for name, value in frame.scalars.items():
            rows.setdefault(name, []).append((k, value))
    return {name: tuple(map(np.array, zip(*of_it, strict=True))) for name, of_it in rows.items()}


def _checked_bones(world: TendonWorld, bones) -> tuple[int, ...]:
    if not isinstance(bones, (tuple, list)):
        raise InvalidType("bones", bones, "a sequence of bodyUniqueIds")
    return tuple(checked_body(body, world.physicsClientId, "bones") for body in bones)


def _checked_functions(scalars) -> dict:
    named = isinstance(scalars, dict) and all(isinstance(name, str) for name in scalars)
    if not named or not all(map(callable, scalars.values())):
        raise InvalidType("scalars", scalars, "a dict of functions without arguments by name")
    return dict(scalars)


def _bones(world: TendonWorld) -> tuple[int, ...]:
    """Bodies with tunnels, and obstacles that are triangle meshes."""
    drilled = {tunnel.bodyUniqueId for tunnel in world.tunnels}
    solid = {body for body, link, *_ in world._obstacles.listing() if _is_mesh(world, body, link)}
    return tuple(sorted(drilled | solid))


def _is_mesh(world, body, link) -> bool:
    return any(shape.surface is not None for shape in world._obstacles.of_link(body, link))
