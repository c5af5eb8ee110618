"""Framing: where a camera has to stand that sees what it should.

Owns: nothing. Goes with no room of the core. A direction is some of yaw, pitch, up and fov, which are
arguments of view.Camera. What is found here is its target and its distance.
"""

import math

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from . import checks
from .errors import InvalidValue
from .lens import FOV, view_axes
from .recording import LinkTrack, Recording

ASPECT = 1.25  # width over height of an image
_MARGIN = 0.09  # of the image's width and height, left free on each side
_SURROUNDINGS = 2.0  # sizes of the tendons, up to which a link is looked at as a whole
_FOLLOWED = 3.0  # of the radius of the scene at first: where things are followed
_SHOWN = 2.0  # the same where a camera is given that shows the scene
_PROPORTIONS = 0.5, 2.5  # of images, at least and at most
_SETTING = 1.6  # of the distance from which what touches fills the image: so that it is seen what it is
_LEAST = 0.02  # m: what is smaller is not looked at more closely
_CUBE = np.array(np.meshgrid(*3 * [(-1, 1)])).reshape(3, -1).T  # its corners
_WAYS = np.array(np.meshgrid(*3 * [(-1, 0, 1)])).reshape(3, -1).T  # in which vertices are outermost


def fitted(points: ArrayLike, direction: dict, aspect: float = ASPECT) -> dict:
    """The camera that is nearest to points (n, 3) [m] and sees all of them; aspect: width over height."""
    points = checks.array("points", points, (None, 3))
    if not len(points):
        raise InvalidValue("points", points, "at least one")
    points = np.vstack([points, _middle(points) + 0.5 * _LEAST * _CUBE])
    axes = _axes(direction)
    right, above, back = (points @ axes).T
    half = (1 - 2 * _MARGIN) * math.tan(math.radians(direction.get("fov", FOV) / 2))
    # The eye at (x, y, z) sees a point where |right - x| <= slope (z - back), and as much for above and y.
    places, away = [], []
    for along, slope in ((right, aspect * half), (above, half)):
        high, low = (along + slope * back).max(), (along - slope * back).min()
        places.append((high + low) / 2)
        away.append((high - low) / (2 * slope))
    eye = np.array([*places, max(away)])
    distance = eye[2] - (back.max() + back.min()) / 2
    target = axes @ (eye[0], eye[1], eye[2] - distance)
    return {**direction, "target": tuple(target.tolist()), "distance": float(distance)}


def overview(recording: Recording, camera: dict, aspect: float = ASPECT) -> dict:
    """The camera that sees the tendons and ligaments of a recording, and the links around, all the time.

    camera: a direction. With a target and a distance, what is never in its image does not count. Nor does
    what flies away, nor links that are far larger than the tendons are.
    """
    return fitted(surroundings(recording, camera, aspect), camera, aspect)


def surroundings(recording: Recording, camera: dict, aspect: float = ASPECT) -> np.ndarray:
    """Points (n, 3) [m] that an overview sees; see there."""
    axes = _axes(camera)
    is_whole = "target" in camera and "distance" in camera
    seen = _Sight(camera, axes, aspect) if is_whole else lambda points: True
    lines = [*recording.tendons, *recording.ligaments]
    tracks = [(track.frames[0], track.positions) for track in lines if seen(track.positions)]
    size = _radius(_at_first(tracks)) if tracks else math.inf
    for track in recording.links:
        corners = _corners(track, 2 * _SURROUNDINGS * size)
        if corners.size and seen(corners):
            tracks.append((track.frames[0], corners))
    if not tracks:
        return np.zeros((1, 3))
    first = _at_first(tracks)
    points = np.vstack([positions.reshape(-1, 3) for _, positions in tracks])
    limit = (_SHOWN if is_whole else _FOLLOWED) * max(_radius(first), _LEAST)
    near = np.linalg.norm(points - _middle(first), axis=1) <= limit
    return points[near]


def proportions(points: np.ndarray, direction: dict) -> float:
    """Width over height that an image of the points (n, 3) [m] has from a direction, within _PROPORTIONS."""
    camera = fitted(points, direction, aspect=1.0)
    away = (points - camera["target"]) @ _axes(direction)
    width, height = np.ptp(away[:, :2] / (camera["distance"] - away[:, 2:]), axis=0)
    narrowest, widest = _PROPORTIONS
    return float(np.clip(width / max(height, width / widest, 1e-12), narrowest, widest))


def closeup(recording: Recording, camera: dict, aspect: float = ASPECT) -> dict | None:
    """The camera that sees where tendons touch something, in the last frame in which they do; else None."""
    pressed = recording.contacts[recording.contacts["normal_force"] > 0]
    if not len(pressed):
        return None
    found = fitted(pressed["position"][pressed["frame"] == pressed["frame"].max()], camera, aspect)
    return {**found, "distance": _SETTING * found["distance"]}


class _Sight:
    """Whether any of some points [m] is in the image of a camera."""

    def __init__(self, camera: dict, axes: np.ndarray, aspect: float):
        self._camera, self._axes = camera, axes
        half = math.tan(math.radians(camera.get("fov", FOV) / 2))
        self._slopes = np.array([aspect * half, half])

    def __call__(self, points: np.ndarray) -> bool:
        away = (points.reshape(-1, 3) - self._camera["target"]) @ self._axes
        ahead = self._camera["distance"] - away[:, 2:]
        return bool((np.abs(away[:, :2]) <= self._slopes * ahead).all(axis=1).any())


def _axes(camera: dict) -> np.ndarray:
    """(3, 3): see lens.view_axes."""
    return view_axes(**{key: camera[key] for key in ("yaw", "pitch", "up") if key in camera})


def _at_first(tracks: list[tuple]) -> np.ndarray:
    """(n, 3) first points of the tracks (first frame, points (k, m, 3)) that were there first."""
    start = min(frame for frame, _ in tracks)
    return np.vstack([positions[0] for frame, positions in tracks if frame == start])


def _middle(points: np.ndarray) -> np.ndarray:
    return (points.min(axis=0) + points.max(axis=0)) / 2


def _radius(points: np.ndarray) -> float:
    """Largest distance from their middle."""
    return float(np.linalg.norm(points - _middle(points), axis=1).max())


def _corners(track: LinkTrack, largest: float) -> np.ndarray:
    """(frames, m, 3) [m], world: outermost vertices of a link's meshes; none of larger or unseen meshes."""
    turns = Rotation.from_quat(track.orientation).as_matrix()
    found = [np.zeros((0, 3))]
    for mesh in track.meshes:
        if mesh.color[3] > 0 and np.linalg.norm(np.ptp(mesh.vertices, axis=0)) <= largest:
            found.append(mesh.vertices[np.unique((mesh.vertices @ _WAYS.T).argmax(axis=0))])
    return np.vstack(found) @ turns.transpose(0, 2, 1) + track.position[:, None]
