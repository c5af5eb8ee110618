"""Camera: what is seen of a client and of a world's tendons; no window, no GPU.

Owns: for each camera a pybullet client with the tendons' visual bodies. Goes with no room of the core.

The user's client is rendered as it is: its bodies, links, meshes and colours. The tendons, and smooth meshes
of round bodies, are rendered through the same lens in a client of the camera's own, and the nearer of both is
taken at each pixel. So the user's client gets no body, no id and no shape, and its state and its next steps
are as without the camera.
"""

import inspect
import math
import weakref
from collections.abc import Iterable, Sequence
from contextlib import ExitStack, contextmanager

import numpy as np
import pybullet as p
from numpy.typing import ArrayLike

from . import checks
from .bodies import checked_body, client_of
from .errors import InvalidValue, NotCopied, UnknownId
from .figures import outline
from .lens import FOV, NOTHING, PITCH, YAW, Lens, Rendering, nearer
from .ligament import Ligament
from .round_bodies import RoundBodies
from .tendon import Tendon
from .visuals import (
    LIGAMENT_COLOR,
    PALETTE,
    TUNNEL_COLOR,
    LigamentLine,
    Lines,
    TendonVisual,
    checked_colors,
    mesh_body,
    paint,
    tunnel_mesh,
    update_visuals,
)
from .world import TendonWorld

_FIRST_TENDON = -2  # in segmentations
_SAGITTA = 0.25  # pixels that a tendon's polygonal cross-section may be off its circle
_SIDES = (6, 32)  # of that polygon, at least and at most
_PIECE = 4  # pixels that a straight piece of a tendon may be long, where that is more than the radius
_LINKS = p.ER_SEGMENTATION_MASK_OBJECT_AND_LINKINDEX


class Camera(NotCopied):
    """A camera that sees a pybullet client and its tendons, for reinforcement learning and pictures.

    Needs no window, no GPU and no further package. Each frame shows the poses at that moment. The user's
    client and world are not changed. Spheres, cylinders and capsules without a texture are drawn round,
    where pybullet draws few corners. Memory does not grow with the frames; each camera takes about 30 MB for
    its own client, until it is closed or no longer used. Things nearer than 0.02 or farther than 20 distances
    are not seen.

    Args:
        world: a TendonWorld, or a client's number or BulletClient, which has no tendons.
        width, height: of the image [pixels].
        target: (3,) point that it looks at [m], world frame.
        distance: from there [m].
        yaw, pitch: [degrees], as in p.resetDebugVisualizerCamera (pitch -30 looks down by 30 degrees).
        up: "z" or "y", the axis that points up.
        fov: the vertical field of view [degrees].
        colors: RGBA of the tendons, by turns.
        full_tension: tension at which a segment is red [N]; None: colours do not depend on tension.
        samples: rays a pixel along each side; the colour is their mean.

    Raises:
        InvalidType, InvalidValue, UnknownId: naming the argument.

    Example:
        >>> from bullet_tendon import view
        >>> camera = view.Camera(world, 64, 48, target=(0, 0, -0.05), distance=0.3)
        >>> seen = camera.render()
        >>> seen.rgb.shape, seen.depth.shape, seen.segmentation.shape
        ((48, 64, 3), (48, 64), (48, 64))
        >>> camera.close()
    """

    def __init__(
        self,
        world: TendonWorld | int,
        width: int = 128,
        height: int = 128,
        target: ArrayLike = (0.0, 0.0, 0.0),
        distance: float = 0.3,
        yaw: float = YAW,
        pitch: float = PITCH,
        up: str = "z",
        fov: float = FOV,
        colors: Sequence = PALETTE,
        full_tension: float | None = None,
        samples: int = 1,
    ):
        self._world = world
        self._client = client_of(world.physicsClientId if isinstance(world, TendonWorld) else world)
        self._lens = Lens(width, height, target, distance, yaw, pitch, up, fov, samples)
        self._layer = _Layer(self._client, colors, full_tension)
        self._lines = Lines(world) if isinstance(world, TendonWorld) else None

    def look(
        self,
        target: ArrayLike,
        distance: float,
        yaw: float,
        pitch: float,
        up: str = "z",
        fov: float = FOV,
    ) -> None:
        """Look elsewhere from the next frame on; the arguments of Camera.

        Raises InvalidType or InvalidValue; then nothing has changed.

        Example:
            >>> from bullet_tendon import view
            >>> camera = view.Camera(world, 64, 48, target=(0, 0, -0.05), distance=0.3)
            >>> camera.look((0, 0, 0), distance=0.5, yaw=90, pitch=0)
        """
        size, samples = (self._lens.width, self._lens.height), self._lens.samples
        self._lens = Lens(*size, target, distance, yaw, pitch, up, fov, samples)

    def render(self, links: bool = False) -> Rendering:
        """Colours, depth and segmentation at once, in the time of one of them. links: see segmentation.

        Example:
            >>> from bullet_tendon import view
            >>> camera = view.Camera(world, 64, 48, target=(0, 0, -0.05), distance=0.3)
            >>> int((camera.render().segmentation == camera.label(tendon)).sum()) > 10
            True
        """
        flags = _LINKS if checks.flag("links", links) else 0
        self._layer.show([] if self._lines is None else self._lines.now(), self._lens.scale)
        return self._lens.finish(self._layer.before(self._lens, flags))

    def image(self) -> np.ndarray:
        """(height, width, 3) uint8; white where nothing is.

        Example:
            >>> from bullet_tendon import view
            >>> camera = view.Camera(world, 64, 48, target=(0, 0, -0.05), distance=0.3)
            >>> camera.image().shape, camera.image().dtype.name
            ((48, 64, 3), 'uint8')
        """
        return self.render().rgb

    def depth(self) -> np.ndarray:
        """(height, width) float32: distance from the camera's plane [m]; the far plane's where nothing is.

        Example:
            >>> from bullet_tendon import view
            >>> camera = view.Camera(world, 64, 48, target=(0, 0, -0.05), distance=0.3)
            >>> print(f"{camera.depth().min():.1f} m")
            0.3 m
        """
        return self.render().depth

    def segmentation(self, links: bool = False) -> np.ndarray:
        """(height, width) int32: what is seen at each pixel.

        -1: nothing. 0 and above: the bodyUniqueId; with `links`, bodyUniqueId + ((linkIndex + 1) << 24), as
        p.getCameraImage has it. -2 - k: tendon k of world.tendons, then the ligaments; see label.

        Example:
            >>> from bullet_tendon import view
            >>> camera = view.Camera(world, 64, 48, target=(0, 0, -0.05), distance=0.3)
            >>> ball in camera.segmentation(), camera.label(tendon) in camera.segmentation()
            (True, True)
        """
        return self.render(links).segmentation

    def label(self, tendon: Tendon | Ligament) -> int:
        """The number that a tendon or ligament has in segmentations now. Raises UnknownId for another.

        Example:
            >>> from bullet_tendon import view
            >>> camera = view.Camera(world, 64, 48, target=(0, 0, -0.05), distance=0.3)
            >>> camera.label(tendon)
            -2
        """
        world = self._world
        known = (*world.tendons, *world.ligaments) if isinstance(world, TendonWorld) else ()
        if tendon not in known:
            raise UnknownId("tendon", tendon, "a tendon or ligament of the camera's world")
        return _FIRST_TENDON - known.index(tendon)

    def close(self) -> None:
        """Give its client back; a second call does nothing. Afterwards rendering raises UnknownId.

        Example:
            >>> from bullet_tendon import view
            >>> camera = view.Camera(world, 64, 48, target=(0, 0, -0.05), distance=0.3)
            >>> camera.close()
        """
        self._layer.close()

    def __enter__(self) -> "Camera":
        return self

    def __exit__(self, *_) -> None:
        self.close()


class _Layer:
    """Tendons, meshes and what is round in a client of their own, to be seen together with the client `seen`.

    colors: RGBA of the tendons, by turns. full_tension: see TendonVisual.
    """

    def __init__(self, seen: int, colors, full_tension=None):
        self._colors = checked_colors(colors)
        if full_tension is not None:
            full_tension = checks.number("full_tension", full_tension, above=0.0)
        self._full_tension = full_tension
        self._seen, self._client = seen, p.connect(p.DIRECT)
        self._round = RoundBodies(seen, self._client)
        self.close = weakref.finalize(self, _disconnect, self._client)
        self._visuals: list[TendonVisual] = []
        self._meshes = 0

    def show(self, tendons: Sequence, scale: float) -> None:
        """Show these tendons where they are now, and no others. scale: pixels a metre."""
        if not self.close.alive:
            raise UnknownId("camera", "closed", "a camera that was not closed")
        if [visual.tendon for visual in self._visuals] != list(tendons):
            self._replace(tendons, scale)
        update_visuals(self._visuals)

    def add_mesh(self, mesh, color) -> None:
        """Show a mesh too (vertices, normals, triangles) [m], world frame."""
        mesh_body(mesh, self._client, color)
        self._meshes += 1

    def color(self, k: int) -> np.ndarray:
        """Of the k-th tendon."""
        return self._colors[k % len(self._colors)]

    def before(self, lens: Lens, flags: int = 0) -> Rendering:
        """What the lens takes of the client that is seen, with this in it; tendons have their labels."""
        client_of(self._seen)
        self._round.update(lambda radius, limits: _sides(radius * lens.scale, limits))
        with self._round.alone():
            taken = lens.take(self._seen, flags)
        if not self._visuals and not self._meshes and not self._round.links:
            return taken
        own = lens.take(self._client)
        return nearer(taken, own._replace(segmentation=self._labels(flags)[own.segmentation]))

    def _replace(self, tendons, scale) -> None:
        for visual in self._visuals:
            visual.remove()
        self._visuals = []
        for k, tendon in enumerate(tendons):
            length = max(tendon.radius, _PIECE / scale)
            color = LIGAMENT_COLOR if isinstance(tendon, LigamentLine) else self.color(k)
            style = color, self._full_tension, _sides(tendon.radius * scale), length
            self._visuals.append(TendonVisual(tendon, self._client, *style))

    def _labels(self, flags: int) -> np.ndarray:
        """The labels of this client's bodies by id; the last one is that of nothing, whose id is -1."""
        ids = [p.getBodyUniqueId(k, self._client) for k in range(p.getNumBodies(self._client))]
        labels = np.full(max(ids) + 2, _FIRST_TENDON - len(self._visuals), np.int32)
        labels[-1] = NOTHING
        for k, visual in enumerate(self._visuals):
            labels[visual.bodies] = _FIRST_TENDON - k
        for own, (body, link) in self._round.links.items():
            labels[own] = body + ((link + 1) << 24) if flags else body
        return labels


def camera_image(
    physicsClientId, target, distance, yaw, pitch, width=960, height=720, fov=FOV, up="z"
) -> np.ndarray:
    """One picture, (height, width, 3) uint8, taken with four rays a pixel; the arguments of Camera.

    physicsClientId: a client, of which no tendons are seen, or a TendonWorld. For picture after picture make
    a Camera: this makes one for each, which takes 10 ms more and 23 kB that pybullet does not give back.

    Example:
        >>> from bullet_tendon import view
        >>> view.camera_image(world, (0, 0, 0), 0.3, 30, -30, width=64, height=48).shape
        (48, 64, 3)
    """
    with Camera(physicsClientId, width, height, target, distance, yaw, pitch, up, fov, samples=2) as camera:
        return camera.image()


@contextmanager
def hidden(bodies: Iterable[int], physicsClientId=0):
    """While it lasts, the bodies are invisible to the camera (alpha 0); poses and velocities stay.

    Raises UnknownId for what is no body, and InvalidValue for a link whose visual shapes differ in
    colour: pybullet 3.2.7 sets the colour of all shapes of a link whatever the shape index, and
    could not give it back.

    Example:
        >>> from bullet_tendon import view
        >>> with view.hidden([ball]):
        ...     image = view.camera_image(world, (0, 0, 0), 0.3, 30, -30, width=64, height=48)
    """
    client = client_of(physicsClientId)
    colors: dict[tuple[int, int], tuple] = {}
    for body in _checked_bodies("bodies", bodies, client):
        for row in p.getVisualShapeData(body, physicsClientId=client):
            if colors.setdefault((body, row[1]), row[7]) != row[7]:
                raise InvalidValue("bodies", body, "bodies with one colour per link")
    with ExitStack() as undo:
        for (body, link), color in colors.items():
            undo.callback(paint, body, link, color, client)
            paint(body, link, (*color[:3], 0.0), client)
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

    Example:
        >>> from bullet_tendon import view
        >>> camera = {"target": (0, 0, -0.05), "distance": 0.3, "yaw": 30, "pitch": -30, "width": 64}
        >>> view.render_scene(0, camera, bones=[ball], tendons=[tendon]).shape
        (720, 64, 3)
    """
    client = client_of(physicsClientId)
    opacity = checks.number("bone_opacity", bone_opacity, at_least=0.0, at_most=1.0)
    bones = _checked_bodies("bones", bones, client)
    known = inspect.signature(Lens).parameters
    if not isinstance(camera, dict) or not camera.keys() <= known.keys():
        raise InvalidValue("camera", camera, "a dict of some of " + ", ".join(known))
    chosen = {"width": 960, "height": 720, "up": "z", "fov": FOV, "samples": 2, **camera}
    lens = Lens(**chosen)
    layer = _Layer(client, colors)
    try:
        _fill(layer, tendons, tunnels, lens.scale)
        image = lens.finish(layer.before(lens)).rgb
        if not bones or opacity == 1.0:
            return image
        with hidden(bones, client):
            inside = lens.finish(layer.before(lens)).rgb
    finally:
        layer.close()
    mixed = opacity * image + (1 - opacity) * inside
    return np.round(mixed * (1 - 0.5 * outline(image, inside))).astype(np.uint8)


def _checked_bodies(argument, bodies, client: int) -> list[int]:
    """Ids of bodies of a client. Raises InvalidType or UnknownId."""
    found = checks.sequence(argument, bodies, "bodyUniqueIds")
    return [checked_body(body, client, argument) for body in found]


def _fill(layer, tendons, tunnels, scale) -> None:
    """Show tendons, skins and tunnels in a layer."""
    for k, item in enumerate(tendons):
        if hasattr(item, "vertices"):
            layer.add_mesh(item, layer.color(k))
    layer.show([item for item in tendons if not hasattr(item, "vertices")], scale)
    for tunnel in tunnels:
        layer.add_mesh(tunnel_mesh(*tunnel), TUNNEL_COLOR)


def _sides(radius: float, limits: tuple[int, int] = _SIDES) -> int:
    """Of a polygon that is nowhere farther than _SAGITTA from its circle, of a radius in pixels."""
    share = min(1.0, _SAGITTA / max(radius, _SAGITTA))
    return int(np.clip(math.ceil(math.pi / math.acos(1 - share)), *limits))


def _disconnect(client: int) -> None:
    if p.isConnected(client):
        p.disconnect(client)
