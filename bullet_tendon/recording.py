"""Recording: what a Recorder has kept of a run, as arrays; saved, loaded, plotted and replayed.

Owns: values; no world and no client. Goes with no room of the core. Lengths, forces and poses are float32,
which is 1e-8 m at 0.1 m; frames are numbered 0 ... f-1, and what came or went during the run names the frames
that it was in.
"""

import dataclasses
import json
import zipfile
from dataclasses import dataclass
from os import PathLike
from typing import NamedTuple

import numpy as np

from . import checks
from .errors import InvalidValue, UnknownId

VERSION = 1  # of the file's layout

CONTACTS = np.dtype(
    [
        ("frame", "i4"),
        ("tendon", "i4"),
        ("segment", "i4"),
        ("bodyUniqueId", "i4"),
        ("linkIndex", "i4"),
        ("kind", "U8"),
        ("position", "f4", 3),
        ("normal", "f4", 3),
        ("distance", "f4"),
        ("normal_force", "f4"),
        ("friction_force", "f4"),
    ]
)

HOLDS = np.dtype(
    [
        ("frame", "i4"),
        ("tendon", "i4"),
        ("particle", "i4"),
        ("bodyUniqueId", "i4"),
        ("linkIndex", "i4"),
        ("force", "f4", 3),
    ]
)


class VisualMesh(NamedTuple):
    """What a link looks like: vertices (v, 3) [m] in its URDF frame, triangles (t, 3), color RGBA (4,)."""

    vertices: np.ndarray
    triangles: np.ndarray
    color: np.ndarray


@dataclass(frozen=True, eq=False)
class TendonTrack:
    """A tendon in the frames (k,): positions (k, n, 3) [m], tension (k, n-1) [N], energy (k,) [J]."""

    name: str
    radius: float
    frames: np.ndarray
    positions: np.ndarray
    tension: np.ndarray
    energy: np.ndarray


@dataclass(frozen=True, eq=False)
class LigamentTrack:
    """A ligament in the frames (k,): positions (k, m, 3) of its line [m], force (k,) [N]."""

    name: str
    frames: np.ndarray
    positions: np.ndarray
    force: np.ndarray


@dataclass(frozen=True, eq=False)
class LinkTrack:
    """A link's URDF frame in the frames (k,): position (k, 3) [m], orientation (k, 4); its visual meshes."""

    name: str
    bodyUniqueId: int
    linkIndex: int
    frames: np.ndarray
    position: np.ndarray
    orientation: np.ndarray
    meshes: tuple[VisualMesh, ...] = ()


@dataclass(frozen=True, eq=False)
class TunnelTrack:
    """A bore of a link: start, end (3,) in the link's URDF frame [m], radius [m]."""

    name: str
    bodyUniqueId: int
    linkIndex: int
    start: np.ndarray
    end: np.ndarray
    radius: float


@dataclass(frozen=True, eq=False)
class Recording:
    """The frames that a Recorder has kept.

    Args:
        times: (f,) simulated since the recorder was made [s].
        steps: (f,) of the world, likewise.
        tendons: a TendonTrack each: name, radius, frames, positions, tension, energy.
        links: a LinkTrack each: name, ids, frames, position, orientation, meshes.
        tunnels: a TunnelTrack each, in their links' frames.
        ligaments: a LigamentTrack each: name, frames, positions, force.
        contacts: structured array, one row for each contact of a frame (fields: recording.CONTACTS;
            `tendon` is the index in `tendons`).
        holds: structured array of the forces of tendons on grips and attachments (fields: recording.HOLDS;
            bodyUniqueId is -1 for a grip).
        scalars: name -> (frames (k,), values (k,)).
        camera: arguments of view.Camera that show the scene, as of Recorder, or None.
        bones: ids of the bodies that replays show translucent.
        title: of replays and plots.

    Example:
        >>> with bt.Recorder(world, every=4) as recorder:
        ...     world.step(8)
        >>> recorder.recording
        <Recording of 3 frames, 0 to 0.03333 s: 1 tendons, 1 links, 0 contacts>
    """

    times: np.ndarray
    steps: np.ndarray
    tendons: tuple[TendonTrack, ...] = ()
    links: tuple[LinkTrack, ...] = ()
    tunnels: tuple[TunnelTrack, ...] = ()
    ligaments: tuple[LigamentTrack, ...] = ()
    contacts: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(0, CONTACTS))
    holds: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(0, HOLDS))
    scalars: dict[str, tuple[np.ndarray, np.ndarray]] = dataclasses.field(default_factory=dict)
    camera: dict | None = None
    bones: tuple[int, ...] = ()
    title: str = ""

    def __len__(self) -> int:
        return len(self.times)

    def __repr__(self) -> str:
        span = f"{self.times[0]:.4g} to {self.times[-1]:.4g} s" if len(self) else "empty"
        parts = f"{len(self.tendons)} tendons, {len(self.links)} links, {len(self.contacts)} contacts"
        return f"<Recording of {len(self)} frames, {span}: {parts}>"

    def tendon(self, name: str) -> TendonTrack:
        """The track of the tendon of that name.

        Raises:
            UnknownId: where there is none.

        Example:
            >>> bt.Recorder(world, every=1).recording.tendon(tendon.name).tension.shape
            (1, 10)
        """
        for track in self.tendons:
            if track.name == name:
                return track
        raise UnknownId("name", name, f"one of {[track.name for track in self.tendons]}")

    def scalar(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Times (k,) [s] and values (k,) of a named scalar.

        Raises:
            UnknownId: where there is none.

        Example:
            >>> recorder = bt.Recorder(world, every=1, scalars={"length": lambda: tendon.length})
            >>> times, lengths = recorder.recording.scalar("length")
            >>> lengths.round(6)
            array([0.1])
        """
        if name not in self.scalars:
            raise UnknownId("name", name, f"one of {list(self.scalars)}")
        frames, values = self.scalars[name]
        return self.times[frames], values

    def body_forces(self) -> dict[tuple[int, int], np.ndarray]:
        """By (bodyUniqueId, linkIndex): the sum of the contacts' normal forces in each frame (f,) [N].

        Example:
            >>> world.add_obstacle(ball)
            >>> tendon.set_positions(tendon.positions - (0.006, 0, 0))
            >>> with bt.Recorder(world, every=1) as recorder:
            ...     world.step()
            >>> list(recorder.recording.body_forces())
            [(0, -1)]
        """
        found = {}
        contacts = self.contacts[self.contacts["bodyUniqueId"] >= 0]
        for body, link in sorted({(int(r["bodyUniqueId"]), int(r["linkIndex"])) for r in contacts}):
            rows = contacts[(contacts["bodyUniqueId"] == body) & (contacts["linkIndex"] == link)]
            found[body, link] = np.bincount(rows["frame"], rows["normal_force"], len(self))
        return found

    def link_name(self, body: int, link: int) -> str:
        """The name of a link that was recorded, or its numbers.

        Example:
            >>> bt.Recorder(world, every=1).recording.link_name(ball, -1)
            'body 0'
        """
        names = {(track.bodyUniqueId, track.linkIndex): track.name for track in self.links}
        return names.get((body, link), f"body {body}, link {link}")

    def save(self, path: str | PathLike, **options) -> None:
        """Write a file: ".npz" (all of it, see load) or ".html" (a replay; options: see replay.write_replay).

        Raises:
            InvalidValue: for another ending.
            MissingExtra: for ".html" without k3d (extra `replay`).

        Example:
            >>> recording = bt.Recorder(world, every=1).recording
            >>> recording.save("run.npz")
        """
        name = checks.path("path", path)
        if name.endswith(".npz") and not options:
            _write(self, name)
        elif name.endswith(".html"):
            from .replay import write_replay

            write_replay(self, name, **options)
        else:
            raise InvalidValue("path", path, "one that ends in .html, or without options in .npz")

    @classmethod
    def load(cls, path: str | PathLike) -> "Recording":
        """Read what save has written to a ".npz" file.

        Raises:
            InvalidValue: for a file that is none.

        Example:
            >>> bt.Recorder(world, every=1).recording.save("run.npz")
            >>> len(bt.Recording.load("run.npz"))
            1
        """
        name = checks.path("path", path)
        try:
            with np.load(name, allow_pickle=False) as file:
                arrays = {key: file[key] for key in file.files}
            head = json.loads(str(arrays.pop("head")))
            if head["version"] != VERSION:
                raise InvalidValue("path", path, f"a recording of version {VERSION}, not {head['version']}")
            return _assembled(head, arrays)
        except (KeyError, ValueError, zipfile.BadZipFile, EOFError, TypeError) as problem:
            if isinstance(problem, InvalidValue):
                raise
            raise InvalidValue("path", path, "a file that Recording.save has written") from problem


_KINDS = {
    "tendons": TendonTrack,
    "links": LinkTrack,
    "tunnels": TunnelTrack,
    "ligaments": LigamentTrack,
}


def _write(recording: Recording, path: str) -> None:
    head = {"version": VERSION, "camera": recording.camera, "bones": list(recording.bones)}
    head["title"] = recording.title
    arrays = {"times": recording.times, "steps": recording.steps}
    arrays |= {"contacts": recording.contacts, "holds": recording.holds}
    for kind in _KINDS:
        head[kind] = [
            _parted(track, f"{kind}/{i}", arrays) for i, track in enumerate(getattr(recording, kind))
        ]
    head["scalars"] = list(recording.scalars)
    for i, (frames, values) in enumerate(recording.scalars.values()):
        arrays[f"scalars/{i}/frames"], arrays[f"scalars/{i}/values"] = frames, values
    with open(path, "wb") as file:
        np.savez_compressed(file, head=np.array(json.dumps(head)), **arrays)


def _parted(track, prefix: str, arrays: dict) -> dict:
    """The plain values of a track; its arrays are put into `arrays`."""
    plain = {}
    for field in dataclasses.fields(track):
        value = getattr(track, field.name)
        if isinstance(value, np.ndarray):
            arrays[f"{prefix}/{field.name}"] = value
        elif field.name == "meshes":
            plain["meshes"] = len(value)
            for k, mesh in enumerate(value):
                for name in mesh._fields:
                    arrays[f"{prefix}/meshes/{k}/{name}"] = getattr(mesh, name)
        else:
            plain[field.name] = value
    return plain


def _assembled(head: dict, arrays: dict) -> Recording:
    tracks = {
        kind: tuple(_track(one, plain, f"{kind}/{i}", arrays) for i, plain in enumerate(head[kind]))
        for kind, one in _KINDS.items()
    }
    scalars = {
        name: (arrays[f"scalars/{i}/frames"], arrays[f"scalars/{i}/values"])
        for i, name in enumerate(head["scalars"])
    }
    if arrays["contacts"].dtype != CONTACTS or arrays["holds"].dtype != HOLDS:
        raise ValueError("of other fields")
    tables = arrays["times"], arrays["steps"]
    return Recording(
        *tables,
        **tracks,
        contacts=arrays["contacts"],
        holds=arrays["holds"],
        scalars=scalars,
        camera=head["camera"],
        bones=tuple(head["bones"]),
        title=head["title"],
    )


def _track(kind, plain: dict, prefix: str, arrays: dict):
    values = {}
    for field in dataclasses.fields(kind):
        if field.name == "meshes":
            parts = [f"{prefix}/meshes/{k}" for k in range(plain["meshes"])]
            values["meshes"] = tuple(
                VisualMesh(*(arrays[f"{part}/{name}"] for name in VisualMesh._fields)) for part in parts
            )
        else:
            name = field.name
            values[name] = plain[name] if name in plain else arrays[f"{prefix}/{name}"]
    return kind(**values)
