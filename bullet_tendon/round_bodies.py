"""Round bodies: the spheres, cylinders and capsules of a client, drawn round in a camera's own client.

Owns: the visual bodies that it adds there. Goes with no room of the core. pybullet's renderer draws a sphere
by 42 corners, and a cylinder by 64 that are 1 mm outside of it. While an image is taken, these are invisible.
"""

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pybullet as p

from .visual_meshes import is_round, round_surface
from .visuals import paint, visual_body, visual_shape

_SIDES = (12, 72)  # of the polygon that stands for a circle, at least and at most


class RoundBodies:
    """Smooth meshes in the client `own` for what is round in the client `seen`, where it is now.

    Only links of nothing but round shapes of one colour, without a texture: pybullet 3.2.7 paints all shapes
    of a link at once. Only in clients without a window, in which they would flicker. Meshes are moved from
    frame to frame. What is gone or has another size now is kept for later: pybullet does not give back all
    of a shape's memory.
    """

    def __init__(self, seen: int, own: int):
        self._seen, self._own = seen, own
        self._is_used = p.getConnectionInfo(seen)["connectionMethod"] == p.DIRECT
        self._shapes: dict[tuple, int] = {}  # pybullet's shapes by what they show
        self._bodies: dict[tuple, list[int]] = {}  # all bodies that show it
        self._painted: dict[int, tuple] = {}  # colours of these bodies
        self._colors: dict[tuple[int, int], tuple] = {}  # of links in the client that is seen
        self.links: dict[int, tuple[int, int]] = {}  # (bodyUniqueId, linkIndex) that a body shows now

    def update(self, sides_of: Callable[[float, tuple[int, int]], int]) -> None:
        """Show what is there now. sides_of(radius [m], limits): sides of a polygon that is round enough."""
        self._colors, self.links = {}, {}
        used: dict[tuple, int] = {}
        for (body, link), rows in _round_links(self._seen) if self._is_used else ():
            self._colors[body, link] = rows[0][7]
            pose = _link_pose(body, link, self._seen)
            for _, _, kind, sizes, _, *place, color, _ in rows:
                radius = sizes[0] if kind == p.GEOM_SPHERE else sizes[1]
                key = kind, sizes, *place, 4 * math.ceil(sides_of(radius, _SIDES) / 4)
                shown = self._take(key, used)
                self._paint(shown, color)
                p.resetBasePositionAndOrientation(shown, *pose, physicsClientId=self._own)
                self.links[shown] = body, link
        for unused in self._painted.keys() - self.links.keys():
            self._paint(unused, (*self._painted[unused][:3], 0.0))

    @contextmanager
    def alone(self) -> Iterator[None]:
        """While it lasts, the links that are shown here are invisible in the client that is seen."""
        try:
            for (body, link), color in self._colors.items():
                paint(body, link, (*color[:3], 0.0), self._seen)
            yield
        finally:
            for (body, link), color in self._colors.items():
                paint(body, link, color, self._seen)

    def _take(self, key: tuple, used: dict[tuple, int]) -> int:
        """A body that shows this and is not used yet; made where there is none."""
        found = self._bodies.setdefault(key, [])
        used[key] = used.get(key, 0) + 1
        if used[key] > len(found):
            if key not in self._shapes:
                self._shapes[key] = visual_shape(round_surface(*key), (1.0, 1.0, 1.0, 1.0), self._own)
            found.append(visual_body(self._shapes[key], self._own))
        return found[used[key] - 1]

    def _paint(self, body: int, color: tuple) -> None:
        if self._painted.get(body) != color:
            paint(body, -1, color, self._own)
            self._painted[body] = color


def _round_links(client: int) -> Iterator[tuple]:
    """Links that can be drawn here: (body, link), and their rows of p.getVisualShapeData."""
    for k in range(p.getNumBodies(client)):
        body = p.getBodyUniqueId(k, client)
        links: dict[int, list] = {}
        for row in p.getVisualShapeData(body, p.VISUAL_SHAPE_DATA_TEXTURE_UNIQUE_IDS, physicsClientId=client):
            links.setdefault(row[1], []).append(row)
        for link, rows in links.items():
            color = rows[0][7]
            if color[3] > 0 and all(is_round(row) and row[7] == color and row[8] < 0 for row in rows):
                yield (body, link), rows


def _link_pose(body: int, link: int, client: int) -> tuple:
    """Position and orientation of a link's URDF frame."""
    if link >= 0:
        return p.getLinkState(body, link, 0, 1, client)[4:6]
    centre = p.getBasePositionAndOrientation(body, client)
    inertial = p.getDynamicsInfo(body, -1, client)[3:5]
    return p.multiplyTransforms(*centre, *p.invertTransform(*inertial))
