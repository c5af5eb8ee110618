"""Replay: a recording as one HTML file that a browser plays without network and server (k3d, extra `replay`).

Owns: nothing. Goes with no room of the core. Tendons are tubes coloured by tension, bones are translucent,
contact forces are arrows that can be switched on. k3d draws; the bar below (a slider, play, speed, the
colours' legend) is this module's. The file forbids itself all requests by its content security policy.

Time in k3d is the number of a frame. Scenes are drawn in millimetres, with as many digits as can be seen.
"""

import dataclasses
import html
import json
import math
from pathlib import Path
from string import Template

import numpy as np
import pybullet as p
from scipy.spatial.transform import Rotation

from . import checks, framing
from .errors import InvalidType, InvalidValue, MissingExtra
from .lens import FOV, checked_camera, view_axes
from .recording import LinkTrack, Recording
from .visual_meshes import round_mesh
from .visuals import LIGAMENT_RADIUS, TAUT_COLOR, TENDON_COLOR, TUNNEL_COLOR

MILLIMETRES = 1000.0
BACKGROUND = 0xDDE4EC  # of the pages: white bodies are seen on it
SPEEDS = (0.001, 0.003, 0.01, 0.03, 0.1, 0.25, 0.5, 1.0, 2.0, 4.0)  # that can be chosen, times real time
_SHORT = 1.0  # s that a run has to last when it is played
_BONE_OPACITY, _TUNNEL_OPACITY = 0.35, 0.15
_FEW = 100  # triangles of a link: fewer are seen as flat faces
_DIGITS = 0.01  # of a tendon's radius, to which its positions are rounded
_FLAT = 0.2  # of a ligament's radius, within which points of its line are left out
_MESH_DIGITS = 4e-5  # of the camera's distance from its target, to which meshes are rounded
_LEAST_TENSION = 1e-6  # N; less is rounding
_ARROW = 0.15  # length of the greatest contact force's arrow, in distances of the camera from its target
_HEAD = 0.25  # of an arrow's length
_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline' 'unsafe-eval' blob:; style-src 'unsafe-inline'; "
    "img-src data: blob:; font-src data:; worker-src blob:; connect-src data: blob:"
)

_BAR = Path(__file__).with_name("replay.js")
# k3d's style sheet holds its fonts, and names files of them besides, which browsers look for.
_FONT_FILES = r"/,url\(fonts\/[^)]*\) format\([^)]*\)/g"


def write_replay(
    recording: Recording,
    path: str,
    fps: float = 30.0,
    full_tension: float | None = None,
    contacts: bool = True,
    camera: dict | None = None,
) -> None:
    """Write a recording as an HTML file.

    The address can end in #t=SECONDS, where the file is to open, and in #t=SECONDS&contacts.

    Args:
        recording: with at least one frame.
        path: of the file.
        fps: at most so many frames are kept for each second that it plays, > 0. A run of less than a
            second is played slower.
        full_tension: [N] at which a tendon is red; None: the highest of the recording.
        contacts: whether contact forces can be shown, and looked at from near.
        camera: arguments of view.Camera; None: the recording's. Without a target and a distance, it sees all
            tendons, ligaments and the links around them, all the time.

    Raises:
        InvalidType, InvalidValue: naming the argument.
        MissingExtra: without k3d.
    """
    if not isinstance(recording, Recording):
        raise InvalidType("recording", recording, "a Recording")
    if not len(recording):
        raise InvalidValue("recording", recording, "one with frames")
    fps = checks.number("fps", fps, above=0)
    if full_tension is not None:
        full_tension = checks.number("full_tension", full_tension, above=0)
    speed = _speed(recording.times[-1] - recording.times[0])
    scene = _Scene(recording, _kept(recording.times, fps / speed), full_tension, camera)
    scene.speed = speed
    page = _page(scene, checks.flag("contacts", contacts))
    with open(path, "w", encoding="utf-8") as file:
        file.write(page)


def _import_k3d():
    try:
        import k3d
    except ImportError:
        raise MissingExtra("k3d", "replay", "writing a replay") from None
    return k3d


def _speed(seconds: float) -> float:
    """Of SPEEDS, at which a run of so many simulated seconds is played at first."""
    if seconds >= _SHORT or seconds <= 0:
        return 1.0
    slow = [speed for speed in SPEEDS if seconds / speed >= _SHORT]
    return max(slow, default=SPEEDS[0])


def _kept(times, fps: float) -> np.ndarray:
    """Numbers of the frames to keep: the first, the last, and those at least 1/fps apart."""
    kept = [0]
    for k in range(1, len(times)):
        if times[k] - times[kept[-1]] >= (1 - 1e-6) / fps:
            kept.append(k)
    if kept[-1] != len(times) - 1:
        kept.append(len(times) - 1)
    return np.array(kept)


class _Scene:
    """What is drawn: the recording at the kept frames, numbered anew from 0."""

    def __init__(self, recording: Recording, kept: np.ndarray, full_tension, camera):
        self.recording = recording
        self.kept = kept
        self.speed = 1.0
        self.times = recording.times[kept]
        start = start_camera(recording, camera)
        self.camera, self.closer = _camera(start), framing.closeup(recording, start)
        highest = [t.tension.max() for t in recording.tendons] + [t.force.max() for t in recording.ligaments]
        highest = float(max(highest, default=0.0))
        self.full_tension = full_tension or _rounded_up(highest)

    def moments(self, track) -> tuple[np.ndarray, np.ndarray]:
        """Of a track: rows (m,) to draw, and the new numbers (m,) of their frames."""
        _, rows, numbers = np.intersect1d(track.frames, self.kept, return_indices=True)
        return rows, numbers

    def presence(self, numbers) -> dict | bool:
        """Whether something is there, by frame, where it is not always."""
        there = np.isin(np.arange(len(self.kept)), numbers)
        if there.all():
            return True
        changes = np.flatnonzero(np.diff(there, prepend=not there[0]))
        return {str(k): bool(there[k]) for k in changes.tolist()}


def start_camera(recording: Recording, given: dict | None = None) -> dict:
    """The arguments of view.Camera with which a replay begins; given: as in write_replay."""
    chosen = checked_camera(given) if given is not None else recording.camera or {}
    if "target" in chosen and "distance" in chosen:
        return chosen
    return framing.overview(recording, chosen)


def _camera(chosen: dict) -> dict:
    """Position, target, up [mm], vertical field of view [degrees] and distance of a camera."""
    target = checks.vector("target", chosen["target"])
    distance = checks.number("distance", chosen["distance"], above=0)
    axes = view_axes(**{key: chosen[key] for key in ("yaw", "pitch", "up") if key in chosen})
    return {
        "position": MILLIMETRES * (target + distance * axes[:, 2]),
        "target": MILLIMETRES * target,
        "up": axes[:, 1],
        "fov": float(chosen.get("fov", FOV)),
        "distance": MILLIMETRES * distance,
    }


def _numbers(camera: dict) -> list[float]:
    """Position, target and up in one list, as k3d has it."""
    return [float(x) for key in ("position", "target", "up") for x in camera[key]]


def _rounded_up(value: float) -> float:
    """The next number with two digits [N]; 1 for nothing."""
    if not value > _LEAST_TENSION:
        return 1.0
    digit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return math.ceil(value / digit - 1e-9) * digit


def _page(scene: _Scene, contacts: bool) -> str:
    k3d = _import_k3d()
    plot = k3d.plot(
        camera_auto_fit=False,
        grid_visible=False,
        menu_visibility=False,
        axes_helper=0.0,
        time_interpolation=False,
        camera_fov=scene.camera["fov"],
        colorbar_object_id=0,
        background_color=BACKGROUND,
    )
    plot.camera = _numbers(scene.camera)
    for track in scene.recording.links:
        _draw_link(k3d, plot, scene, track)
    for track in scene.recording.tendons:
        _draw_line(k3d, plot, scene, track, track.radius, track.tension)
    for track in scene.recording.ligaments:
        corners = _corners(track.positions, _FLAT * LIGAMENT_RADIUS)
        drawn = dataclasses.replace(track, positions=track.positions[:, corners])
        tension = np.repeat(track.force[:, None], len(corners) - 1, axis=1)
        _draw_line(k3d, plot, scene, drawn, LIGAMENT_RADIUS, tension)
    _draw_tunnels(k3d, plot, scene)
    arrows = _draw_contacts(k3d, plot, scene) if contacts else None
    settings = {
        "times": [round(float(t), 6) for t in scene.times],
        "title": scene.recording.title,
        "speeds": SPEEDS,
        "speed": scene.speed,
        "camera": plot.camera,
        "closer": _numbers(_camera(scene.closer)) if contacts and scene.closer else None,
        "aspect": framing.ASPECT,
        "contacts": arrows,
        "colors": [_css(TENDON_COLOR), _css(TAUT_COLOR)],
        "full": f"{scene.full_tension:g}",
    }
    bar = Template(_BAR.read_text(encoding="utf-8"))
    page = plot.get_snapshot(
        9, additional_js_code=bar.substitute(settings=json.dumps(settings).replace("</", "<\\/"))
    )
    page = page.replace("eval(k3dSource)", f"eval(k3dSource.replace({_FONT_FILES}, ''))")
    head = f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">'
    title = html.escape(scene.recording.title or "Replay")
    start, end = page.index("<title>"), page.index("</title>")
    return f"{page[:start]}{head}<title>{title}{page[end:]}"


def _corners(lines: np.ndarray, tolerance: float) -> list[int]:
    """Numbers of the points of a moving line (k, m, 3) [m] that are enough to draw it.

    The others lie within the tolerance [m] of the way between their neighbours, at all k moments.
    """
    corners, last = [0], lines.shape[1] - 1
    while corners[-1] < last:
        first = corners[-1]
        ends = range(last, first, -1)
        corners.append(next(end for end in ends if _height(lines[:, first : end + 1]) <= tolerance))
    return corners


def _height(lines: np.ndarray) -> float:
    """Largest distance of the points of lines (k, m, 3) from their chords [m]."""
    chord, away = lines[:, -1:] - lines[:, :1], lines - lines[:, :1]
    square = np.maximum((chord**2).sum(-1, keepdims=True), np.finfo(float).tiny)
    share = np.clip((away * chord).sum(-1, keepdims=True) / square, 0, 1)
    return float(np.linalg.norm(away - share * chord, axis=-1).max())


def _draw_line(k3d, plot, scene: _Scene, track, radius: float, tension: np.ndarray) -> None:
    """A tendon's or a ligament's track, tension (k, n-1)."""
    rows, numbers = scene.moments(track)
    if not len(rows):
        return
    step = MILLIMETRES * radius * _DIGITS
    tension = np.pad(tension[rows], ((0, 0), (1, 1)), mode="edge")
    tension = 0.5 * (tension[:, 1:] + tension[:, :-1])  # at particles
    grain = scene.full_tension / 500
    plot += k3d.line(
        _by_frame(numbers, _rounded(MILLIMETRES * track.positions[rows], step)),
        shader="mesh",
        width=MILLIMETRES * radius,  # the radius, with this shader
        radial_segments=12,
        attribute=_by_frame(numbers, _rounded(tension, grain)),
        color_map=[0.0, *TENDON_COLOR[:3], 1.0, *TAUT_COLOR[:3]],
        color_range=[0.0, scene.full_tension],
        name=track.name,
        visible=scene.presence(numbers),
    )


def _draw_link(k3d, plot, scene: _Scene, track: LinkTrack) -> None:
    rows, numbers = scene.moments(track)
    if not len(rows):
        return
    matrices = _matrices(track, rows, numbers)
    opacity = _BONE_OPACITY if track.bodyUniqueId in scene.recording.bones else 1.0
    for mesh in track.meshes:
        alpha = opacity * float(mesh.color[3])
        if alpha > 0:
            drawn = k3d.mesh(
                _rounded(MILLIMETRES * mesh.vertices, scene.camera["distance"] * _MESH_DIGITS),
                mesh.triangles,
                color=_number(mesh.color),
                opacity=alpha,
                flat_shading=len(mesh.triangles) < _FEW,
                side="double",
                name=track.name,
                visible=scene.presence(numbers),
            )
            drawn.model_matrix = matrices
            plot += drawn


def _draw_tunnels(k3d, plot, scene: _Scene) -> None:
    links = {(track.bodyUniqueId, track.linkIndex): track for track in scene.recording.links}
    for tunnel in scene.recording.tunnels:
        track = links.get((tunnel.bodyUniqueId, tunnel.linkIndex))
        if track is None:
            continue
        rows, numbers = scene.moments(track)
        axis = tunnel.end - tunnel.start
        vertices, triangles = round_mesh(p.GEOM_CYLINDER, (np.linalg.norm(axis), tunnel.radius))
        walls = triangles[len(triangles) // 3 : 2 * len(triangles) // 3]  # without the ends
        turn = Rotation.align_vectors([axis], [[0.0, 0.0, np.linalg.norm(axis)]])[0]
        placed = turn.apply(vertices) + 0.5 * (tunnel.start + tunnel.end)
        drawn = k3d.mesh(
            (MILLIMETRES * placed).astype(np.float32),
            walls.astype(np.uint32),
            color=_number(TUNNEL_COLOR),
            opacity=_TUNNEL_OPACITY,
            side="double",
            flat_shading=False,
            name=tunnel.name,
            visible=scene.presence(numbers),
        )
        drawn.model_matrix = _matrices(track, rows, numbers)
        plot += drawn


def _draw_contacts(k3d, plot, scene: _Scene) -> int | None:
    """Arrows of the normal forces on tendons, hidden at first; the object's number, None without any."""
    table = scene.recording.contacts
    table = table[(table["normal_force"] > 0) & np.isin(table["frame"], scene.kept)]
    if not len(table):
        return None
    most = int(np.bincount(table["frame"]).max())
    longest = _ARROW * scene.camera["distance"]
    length = longest * table["normal_force"] / table["normal_force"].max()
    points = _arrows(MILLIMETRES * table["position"], table["normal"], length, scene.camera)
    vertices = np.tile(MILLIMETRES * table["position"][0], (len(scene.kept), 4 * most, 1))
    for n, frame in enumerate(scene.kept):
        these = points[table["frame"] == frame].reshape(-1, 3)
        vertices[n, : len(these)] = these
    corners = 4 * np.arange(most)[:, None, None] + np.array([[0, 1], [1, 2], [1, 3]])
    lines = k3d.lines(
        _by_frame(np.arange(len(vertices)), _rounded(vertices, 0.002 * longest)),
        corners.reshape(-1, 2).astype(np.uint32),
        indices_type="segment",
        shader="simple",
        color=0x1F4FA0,
        name="contact forces",
        visible=False,
    )
    plot += lines
    return lines.id


def _arrows(start, direction, length, camera) -> np.ndarray:
    """(k, 4, 3) start, tip and the ends of the two barbs of arrows, whose barbs are seen from the camera."""
    back = camera["position"] - camera["target"]
    aside = np.cross(direction, back)
    aside /= np.maximum(np.linalg.norm(aside, axis=1), 1e-12)[:, None]
    reach = length[:, None]
    tip = start + reach * direction
    neck = start + (1 - _HEAD) * reach * direction
    return np.stack([start, tip, neck + 0.4 * _HEAD * reach * aside, neck - 0.4 * _HEAD * reach * aside], 1)


def _matrices(track: LinkTrack, rows, numbers):
    """The link's frame (4, 4) [mm] by frame."""
    turns = Rotation.from_quat(track.orientation[rows]).as_matrix()
    places = MILLIMETRES * track.position[rows]
    matrices = np.zeros((len(rows), 4, 4), np.float32)
    matrices[:, :3, :3] = np.round(turns, 5)
    matrices[:, :3, 3] = np.round(places, 3)
    matrices[:, 3, 3] = 1
    return _by_frame(numbers, matrices)


def _by_frame(numbers, values: np.ndarray):
    """Values (k, ...) by the numbers (k,) of their frames, where they change; the first if they never do."""
    changes = np.append(True, (np.diff(values, axis=0) != 0).any(axis=tuple(range(1, values.ndim))))
    if changes.sum() == 1:
        return values[0]
    return {str(n): value for n, value in zip(numbers[changes], values[changes], strict=True)}


def _rounded(values, step: float) -> np.ndarray:
    """float32 with no more binary digits than steps need, which compress well."""
    step = 2.0 ** math.floor(math.log2(step))
    return (np.round(np.asarray(values, float) / step) * step).astype(np.float32)


def _number(color) -> int:
    """RRGGBB of an RGBA colour."""
    red, green, blue = (round(255 * float(part)) for part in color[:3])
    return (red << 16) + (green << 8) + blue


def _css(color) -> str:
    return f"#{_number(color):06x}"
