"""Pictures: tendons drawn in pybullet, camera images without a window, plots. No physics.

Owns: the visual bodies that it adds to pybullet. Goes with no room of the core.

Bodies added here have no collision shape and mass 0, so that nothing feels them; what is added for
a picture is removed again. Images are (height, width, 3) uint8. A `physicsClientId` may be the
number or a BulletClient. matplotlib and tqdm (extra `view`) are imported only where they are used.
"""

from collections.abc import Iterable
from contextlib import ExitStack, contextmanager
from types import SimpleNamespace

import numpy as np
import pybullet as p

from . import checks
from .errors import InvalidValue, UnknownId
from .figures import figure as figure
from .figures import outline
from .figures import save_png as save_png
from .skin import Skin, twist_free_frames

TENDON_COLOR = (0.86, 0.75, 0.55, 1.0)
TAUT_COLOR = (0.80, 0.10, 0.08, 1.0)
TUNNEL_COLOR = (0.05, 0.55, 0.60, 1.0)
PALETTE = (TENDON_COLOR, (0.75, 0.35, 0.30, 1.0), (0.45, 0.60, 0.80, 1.0), (0.55, 0.70, 0.40, 1.0))
_MOST_VERTICES, _MOST_TRIANGLES = 131072, 174762  # createVisualShape fails beyond (pybullet 3.2.7)


def progress(iterable: Iterable, description: str = "", total: int | None = None) -> Iterable:
    """The iterable with a tqdm bar on stderr; without tqdm, the iterable itself."""
    try:
        from tqdm import tqdm
    except ImportError:
        return iterable
    return tqdm(iterable, desc=description or None, total=total)


def camera_image(
    physicsClientId, target, distance, yaw, pitch, width=960, height=720, fov=40.0, up="z"
) -> np.ndarray:
    """What a camera sees, (height, width, 3) uint8, on white; pybullet's software renderer, no window.

    `target` (3,) and `distance` in metres, world frame; `yaw`, `pitch` and the vertical field of
    view `fov` in degrees as in resetDebugVisualizerCamera (pitch -30 looks down by 30 degrees);
    `up`: "z" or "y", the axis that points up. Rendered at twice the size, then averaged.
    """
    client = _client(physicsClientId)
    target = checks.vector("target", target).tolist()
    distance = checks.number("distance", distance, above=0.0)
    yaw, pitch = checks.number("yaw", yaw), checks.number("pitch", pitch)
    fov = checks.number("fov", fov, above=0.0, at_most=170.0)
    axis = {"y": 1, "z": 2}[checks.choice("up", up, ("z", "y"))]
    width, height = (checks.integer(*side, at_least=1) for side in (("width", width), ("height", height)))
    seen = p.computeViewMatrixFromYawPitchRoll(target, distance, yaw, pitch, 0.0, axis)
    lens = p.computeProjectionMatrixFOV(fov, width / height, 0.02 * distance, 20 * distance)
    right, above, back = np.reshape(seen, (4, 4))[:3, :3].T
    _, _, pixels, _, _ = p.getCameraImage(
        2 * width,
        2 * height,
        seen,
        lens,
        lightDirection=(back + 0.6 * above - 0.4 * right).tolist(),  # over the photographer's shoulder
        lightAmbientCoeff=0.5,
        lightDiffuseCoeff=0.5,
        lightSpecularCoeff=0.12,
        shadow=0,
        renderer=p.ER_TINY_RENDERER,
        flags=p.ER_NO_SEGMENTATION_MASK,
        physicsClientId=client,
    )
    fine = np.reshape(np.asarray(pixels, dtype=np.uint8), (height, 2, width, 2, 4))[..., :3]
    return ((fine.sum(axis=(1, 3), dtype=np.uint16) + 2) // 4).astype(np.uint8)


class TendonVisual:
    """A tendon shown by one capsule per segment, cheap enough for every frame of a GUI.

    `tendon` has positions (n, 3) [m], radius [m] and, if `full_tension` [N] is given, tension
    (n-1,) [N]: segments are then coloured from `color` (no tension) to red (full). A capsule keeps
    its length; its round ends bridge the gap while the strain stays below 2 radius / segment length.
    """

    def __init__(self, tendon, physicsClientId=0, color=TENDON_COLOR, full_tension=None):
        self.tendon, self.color = tendon, checks.vector("color", color, 4)
        self.full_tension = full_tension
        if full_tension is not None:
            self.full_tension = checks.number("full_tension", full_tension, above=0.0)
        self._client = _client(physicsClientId)
        lengths = np.linalg.norm(np.diff(tendon.positions, axis=0), axis=1)
        steps = np.maximum(np.round(lengths / tendon.radius, 2), 0.01) * tendon.radius
        shapes = {
            step: _shape(_capsule(step, tendon.radius), self.color, self._client) for step in set(steps)
        }
        self.bodies: list[int] = [_body(shapes[step], self._client) for step in steps]
        self._shown = np.full(len(steps), np.nan)
        self.update()

    def update(self):
        """Move the capsules to the tendon's present positions, and recolour them if asked for."""
        points = np.asarray(self.tendon.positions, dtype=float)
        if len(points) != len(self.bodies) + 1:
            raise InvalidValue("tendon.positions", points, f"of shape ({len(self.bodies) + 1}, 3)")
        middles = 0.5 * (points[1:] + points[:-1])
        turns = _turns_from_x(np.diff(points, axis=0))
        for body, middle, turn in zip(self.bodies, middles.tolist(), turns.tolist(), strict=True):
            p.resetBasePositionAndOrientation(body, middle, turn, physicsClientId=self._client)
        if self.full_tension is not None:
            self._recolour(np.asarray(self.tendon.tension, dtype=float))

    def remove(self):
        """Take the capsules away; a second call does nothing."""
        while self.bodies:
            p.removeBody(self.bodies.pop(), physicsClientId=self._client)

    def _recolour(self, tension):
        share = np.round(np.clip(tension / self.full_tension, 0.0, 1.0), 2)  # 100 shades: few changes
        for i in np.flatnonzero(share != self._shown):
            color = (1 - share[i]) * self.color + share[i] * np.array(TAUT_COLOR)
            _paint(self.bodies[i], -1, color, self._client)
        self._shown = share


def mesh_body(skin, physicsClientId=0, color=TENDON_COLOR) -> int:
    """A visual body of `skin` (vertices, normals, triangles, world frame) as it is now; its body id.

    For one picture: it does not follow. Remove it with pybullet.removeBody; pybullet keeps some of
    a mesh's memory even then (about 0.5 kB a vertex), so do not make one per frame of a long film.
    """
    client = _client(physicsClientId)
    return _body(_shape(skin, checks.vector("color", color, 4), client), client)


def tunnel_mesh(start, end, radius, rings=2, lines=6):
    """A wire frame (vertices, normals, triangles) of a bore between two points (3,) [m], of a radius [m]."""
    start, end = checks.vector("start", start), checks.vector("end", end)
    radius = checks.number("radius", radius, above=0.0)
    _, across, aside = twist_free_frames([start, end])[0].T
    angle = np.linspace(0.0, 2 * np.pi, 37)
    circle = radius * (np.cos(angle)[:, None] * across + np.sin(angle)[:, None] * aside)
    curves = [start + part * (end - start) + circle for part in np.linspace(0.0, 1.0, rings)]
    curves += [np.array([start, end]) + spoke for spoke in circle[: 36 : 36 // lines]]
    wires = [Skin.tube(SimpleNamespace(positions=curve, radius=0.05 * radius), ring=8) for curve in curves]
    shift = np.cumsum([0] + [len(wire.vertices) for wire in wires])
    return SimpleNamespace(
        vertices=np.vstack([wire.vertices for wire in wires]),
        normals=np.vstack([wire.normals for wire in wires]),
        triangles=np.vstack([wire.triangles + at for wire, at in zip(wires, shift, strict=False)]),
    )


@contextmanager
def hidden(bodies: Iterable[int], physicsClientId=0):
    """While it lasts, the bodies are invisible to the camera (alpha 0); poses and velocities stay.

    Raises InvalidValue for a link whose visual shapes differ in colour: pybullet 3.2.7 sets the
    colour of all shapes of a link whatever the shape index, and could not give it back.
    """
    client = _client(physicsClientId)
    colors: dict[tuple[int, int], tuple] = {}
    for body in bodies:
        for row in p.getVisualShapeData(body, physicsClientId=client):
            if colors.setdefault((body, row[1]), row[7]) != row[7]:
                raise InvalidValue("bodies", body, "bodies with one colour per link")
    with ExitStack() as undo:
        for (body, link), color in colors.items():
            undo.callback(_paint, body, link, color, client)
            _paint(body, link, (*color[:3], 0.0), client)
        yield


def render_scene(
    physicsClientId, camera: dict, bones=(), tendons=(), tunnels=(), bone_opacity=0.45, colors=PALETTE
) -> np.ndarray:
    """A picture (height, width, 3) uint8 of the world, with bones one can look into.

    `camera`: the arguments of `camera_image`. `bones`: ids of bodies (one colour per link) shown
    with `bone_opacity` from 0, an outline, to 1. `tendons`: tendons, or skins of them, drawn in
    `colors` by turns. `tunnels`: (start, end, radius) in metres, world frame. The software renderer
    knows no transparency: the scene is rendered with and without the bones, the two are mixed, and
    the bones' visible part gets an outline. Triangles seen from behind are not drawn, whatever the
    opacity. The simulation is left as it was.
    """
    client = _client(physicsClientId)
    opacity = checks.number("bone_opacity", bone_opacity, at_least=0.0, at_most=1.0)
    skins = [(item if hasattr(item, "vertices") else Skin.tube(item, ring=16)) for item in tendons]
    meshes = [(skin, colors[i % len(colors)]) for i, skin in enumerate(skins)]
    meshes += [(tunnel_mesh(*tunnel), TUNNEL_COLOR) for tunnel in tunnels]
    with ExitStack() as undo:
        for mesh, color in meshes:
            undo.callback(p.removeBody, mesh_body(mesh, client, color), physicsClientId=client)
        image = camera_image(client, **camera)
        if not bones or opacity == 1.0:
            return image
        with hidden(bones, client):
            inside = camera_image(client, **camera)
    mixed = opacity * image + (1 - opacity) * inside
    return np.round(mixed * (1 - 0.5 * outline(image, inside))).astype(np.uint8)


def _client(physicsClientId) -> int:
    client = checks.integer("physicsClientId", getattr(physicsClientId, "_client", physicsClientId))
    if not p.isConnected(client):
        raise UnknownId("physicsClientId", physicsClientId, "a connected pybullet client")
    return client


def _paint(body, link, color, client):
    p.changeVisualShape(body, link, rgbaColor=list(color), physicsClientId=client)


def _shape(mesh, color, client) -> int:
    if len(mesh.vertices) > _MOST_VERTICES or len(mesh.triangles) > _MOST_TRIANGLES:
        sizes = (len(mesh.vertices), len(mesh.triangles))
        allowed = f"at most {_MOST_VERTICES} vertices and {_MOST_TRIANGLES} triangles"
        raise InvalidValue("mesh (vertices, triangles)", sizes, allowed)
    return p.createVisualShape(
        p.GEOM_MESH,
        vertices=mesh.vertices.tolist(),
        normals=mesh.normals.tolist(),
        indices=mesh.triangles.ravel().tolist(),
        rgbaColor=list(color),
        physicsClientId=client,
    )


def _body(shape, client) -> int:
    return p.createMultiBody(0, -1, shape, physicsClientId=client)


def _capsule(length, radius) -> Skin:
    """A capsule around x, centred, its hemispheres' centres `length` apart."""
    angle = np.linspace(0.02, np.pi / 2, 6)
    x, radii = 0.5 * length + radius * np.cos(angle[::-1]), radius * np.sin(angle[::-1])
    points = np.zeros((12, 3))
    points[:, 0] = np.concatenate([-x[::-1], x])
    return Skin.tube(
        SimpleNamespace(positions=points, radius=radius), 16, None, np.concatenate([radii[::-1], radii])
    )


def _turns_from_x(vectors) -> np.ndarray:
    """Quaternions (n, 4) that turn x the short way onto the vectors (n, 3)."""
    length = np.linalg.norm(vectors, axis=1)[:, None]
    x, y, z = np.where(length > 0, vectors / np.where(length > 0, length, 1.0), [1.0, 0.0, 0.0]).T
    turns = np.stack([0 * x, -z, y, 1 + x], axis=1)
    turns[x < -1 + 1e-12] = [0.0, 0.0, 1.0, 0.0]
    return turns / np.linalg.norm(turns, axis=1)[:, None]
