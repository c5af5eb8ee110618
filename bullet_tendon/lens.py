"""Lens: where a camera stands, what it takes of a pybullet client, and how two takes become one.

Owns: the matrices of a view. Goes with no room of the core. The renderer is pybullet's TinyRenderer, which
needs no window.
"""

from typing import NamedTuple

import numpy as np
import pybullet as p

from . import checks
from .errors import InvalidType, InvalidValue, UnknownId

NEAR, FAR = 0.02, 20.0  # planes between which things are seen, in distances of the target
YAW, PITCH, FOV = 30.0, -30.0, 40.0  # degrees, where nothing else is said
NOTHING = -1  # in segmentations, as pybullet has it


class Rendering(NamedTuple):
    """What a camera saw at one moment.

    rgb (height, width, 3) uint8. depth (height, width) float32: distance from the camera's plane [m]; the far
    plane's where nothing is. segmentation (height, width) int32: see Camera.segmentation.

    Example:
        >>> from bullet_tendon import view
        >>> camera = view.Camera(world, 64, 48, target=(0, 0, -0.05), distance=0.3)
        >>> rgb, depth, segmentation = camera.render()
    """

    rgb: np.ndarray
    depth: np.ndarray
    segmentation: np.ndarray


class Lens:
    """A view of a client, its arguments those of camera.Camera."""

    def __init__(self, width, height, target, distance, yaw, pitch, up, fov, samples):
        self.width = checks.integer("width", width, at_least=1)
        self.height = checks.integer("height", height, at_least=1)
        self.samples = checks.integer("samples", samples, at_least=1)
        target = checks.vector("target", target).tolist()
        distance = checks.number("distance", distance, above=0.0)
        yaw, pitch = checks.number("yaw", yaw), checks.number("pitch", pitch)
        fov = checks.number("fov", fov, above=0.0, at_most=170.0)
        axis = {"y": 1, "z": 2}[checks.choice("up", up, ("z", "y"))]
        self.near, self.far = NEAR * distance, FAR * distance
        self.seen = p.computeViewMatrixFromYawPitchRoll(target, distance, yaw, pitch, 0.0, axis)
        self.projection = p.computeProjectionMatrixFOV(fov, self.width / self.height, self.near, self.far)
        right, above, back = view_axes(yaw, pitch, up).T
        self._light = (back + 0.6 * above - 0.4 * right).tolist()  # over the photographer's shoulder
        self.scale = self.samples * self.height * self.projection[5] / (2 * distance)

    @property
    def size(self) -> tuple[int, int]:
        """Rows and columns of what is taken."""
        return self.samples * self.height, self.samples * self.width

    def take(self, client: int, flags: int = 0) -> Rendering:
        """What is in a client, of `size`, its depth that of the depth buffer, 0 (near) to 1 (far)."""
        if not p.isConnected(client):
            raise UnknownId("physicsClientId", client, "a connected pybullet client")
        rows, columns = self.size
        _, _, pixels, depth, segmentation = p.getCameraImage(
            columns,
            rows,
            self.seen,
            self.projection,
            lightDirection=self._light,
            lightAmbientCoeff=0.5,
            lightDiffuseCoeff=0.5,
            lightSpecularCoeff=0.12,
            shadow=0,
            renderer=p.ER_TINY_RENDERER,
            flags=flags,
            physicsClientId=client,
        )
        return Rendering(
            np.reshape(np.asarray(pixels, dtype=np.uint8), (rows, columns, 4))[..., :3],
            np.reshape(np.asarray(depth, dtype=np.float32), (rows, columns)),
            np.reshape(np.asarray(segmentation, dtype=np.int32), (rows, columns)),
        )

    def finish(self, taken: Rendering) -> Rendering:
        """What was taken, of the image's size and with its depth in metres."""
        n, middle = self.samples, slice(self.samples // 2, None, self.samples)
        depth = taken.depth[middle, middle]
        depth = self.far * self.near / (self.far - (self.far - self.near) * depth)
        rgb = taken.rgb if n == 1 else _mean(taken.rgb, n)
        return Rendering(np.ascontiguousarray(rgb), depth, taken.segmentation[middle, middle])


def checked_camera(camera) -> dict:
    """Arguments of camera.Camera by name, of which any may be missing, as plain numbers.

    Raises InvalidType or InvalidValue.
    """
    given = {"width": 1, "height": 1, "target": (0, 0, 0), "distance": 1}
    given.update(yaw=YAW, pitch=PITCH, up="z", fov=FOV, samples=1)
    if not isinstance(camera, dict):
        raise InvalidType("camera", camera, "a dict of arguments of view.Camera")
    if not camera.keys() <= given.keys():
        raise InvalidValue("camera", camera, "a dict of some of " + ", ".join(given))
    Lens(**{**given, **camera})
    return {
        key: value if isinstance(value, str) else np.asarray(value).tolist() for key, value in camera.items()
    }


def view_axes(yaw: float = YAW, pitch: float = PITCH, up: str = "z") -> np.ndarray:
    """(3, 3): unit vectors to the right of, above and back from what a camera sees, as columns."""
    axis = {"y": 1, "z": 2}[checks.choice("up", up, ("z", "y"))]
    seen = p.computeViewMatrixFromYawPitchRoll((0.0, 0.0, 0.0), 1.0, yaw, pitch, 0.0, axis)
    return np.reshape(seen, (4, 4))[:3, :3]


def nearer(one: Rendering, other: Rendering) -> Rendering:
    """At each pixel what is nearer; of things equally near, the other's."""
    found = (other.depth <= one.depth) & (other.segmentation != NOTHING)
    rgb = np.where(found[..., None], other.rgb, one.rgb)
    depth = np.where(found, other.depth, one.depth)
    return Rendering(rgb, depth, np.where(found, other.segmentation, one.segmentation))


def _mean(fine, n: int) -> np.ndarray:
    """(h, w, 3) uint8: the mean of each n by n pixels, rounded."""
    rows, columns, channels = fine.shape
    blocks = fine.reshape(rows // n, n, columns // n, n, channels)
    total = blocks.sum(axis=(1, 3), dtype=np.uint32)
    return ((total + n * n // 2) // (n * n)).astype(np.uint8)
