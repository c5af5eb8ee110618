"""Obstacles: the links that tendons collide with, and distances from their shapes.

Owns: the collision shapes of links, by the numbers that the core gives them, and through them the FCL objects
that measure meshes: no other world has any part in them. Goes with the core's room `collision`; the shapes
themselves are in shapes.py.
"""

import numpy as np
import pybullet as p

from . import _core, checks
from .bodies import Bodies
from .errors import InvalidType, InvalidValue, UnknownId
from .penetration import Obstacle
from .shapes import Shape, collision_shapes


class Obstacles:
    """Collision shapes of links, in slots numbered as the core numbers them."""

    def __init__(self, core: _core.World, bodies: Bodies):
        self._core = core
        self._bodies = bodies
        self.shapes: dict[int, Shape] = {}
        self._by_link: dict[tuple[int, int], list[int]] = {}
        self._link_slots: dict[tuple[int, int], int] = {}
        self._friction: dict[tuple[int, int], float | None] = {}  # as given, of the links

    def __len__(self) -> int:
        return len(self.shapes)

    def listing(self) -> tuple:
        """Body, link, and the numbers of its shapes, of every link that is an obstacle."""
        return tuple((*key, *numbers) for key, numbers in sorted(self._by_link.items()))

    def link_slots(self) -> set[int]:
        return set(self._link_slots.values())

    def add(
        self, body, link=None, friction=None, convex=None, meshes=(), concave: dict | None = None
    ) -> None:
        """See TendonWorld.add_obstacle. concave: by link, see link_shapes.read_link."""
        self._bodies.require(body, -1 if link is None else link)
        if convex is not None:
            convex = checks.flag("convex", convex)
        if not isinstance(meshes, (list, tuple)):
            raise InvalidType("meshes", meshes, "a list of paths or of vertices and triangles")
        client = self._bodies.client
        links = range(-1, p.getNumJoints(body, client)) if link is None else [link]
        known = concave or {}
        found = {i: collision_shapes(body, i, client, convex, meshes, known.get(i)) for i in links}
        if not any(found.values()):
            where = "bodyUniqueId" if link is None else "linkIndex"
            raise InvalidValue(where, body if link is None else link, "one with a collision shape")
        for shape in (shape for shapes in found.values() for shape in shapes):
            _ = shape.solid, shape.measured  # which takes a while: here, and not where a step asks for it
        if friction is not None:
            friction = checks.number("friction", friction, at_least=0)
        for key in [k for k, slot in self._link_slots.items() if k[0] == body and self._bodies.is_gone(slot)]:
            self._drop(key)  # of a body that had this id before
        for i, shapes in found.items():
            self._drop((int(body), int(i)))
            if shapes:
                self._put(int(body), int(i), shapes, friction)

    def remove(self, body, link) -> None:
        """See TendonWorld.remove_obstacle."""
        checks.integer("bodyUniqueId", body)
        if link is not None:
            checks.integer("linkIndex", link, at_least=-1)
        keys = [k for k in self._by_link if k[0] == body and link in (None, k[1])]
        if not keys:
            added = [index for number, index in self._by_link if number == body]
            if added:
                raise UnknownId("linkIndex", link, f"a link that was added as an obstacle: {sorted(added)}")
            raise UnknownId("bodyUniqueId", body, "a body that was added as an obstacle")
        for key in keys:
            self._drop(key)

    def forget(self, slots: set[int]) -> None:
        """Take out the shapes of links, by their slots."""
        for key in [k for k, slot in self._link_slots.items() if slot in slots]:
            self._drop(key)

    def friction(self, body: int, link: int) -> float:
        """The coefficient of an obstacle now: as given, or pybullet's."""
        given = self._friction[body, link]
        return self._bodies.lateral_friction(body, link) if given is None else given

    def of_link(self, body: int, link: int) -> list[Shape]:
        """The shapes of a link; none, if it is no obstacle."""
        return [self.shapes[number] for number in self._by_link.get((body, link), ())]

    def placed(self) -> list[Obstacle]:
        """All shapes where they are now."""
        found = []
        for (body, link), numbers in self._by_link.items():
            origin, axes = self._bodies.frame(body, link)
            for shape in (self.shapes[k] for k in numbers):
                there = origin + axes @ shape.position, axes @ shape.rotation
                found.append(Obstacle(body, link, shape, *there))
        return found

    def measure(
        self, shape: np.ndarray, a: np.ndarray, b: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Distances of k segments a -> b (k, 3) from the shapes numbered `shape` (k,); a == b is a point.

        Each in its shape's frame [m]. Returns distance (k,), surface point (k, 3), u (k,): see Shape.measure.
        """
        distance, point, u = np.empty(len(a)), np.empty((len(a), 3)), np.empty(len(a))
        for number in np.unique(shape):
            which = np.flatnonzero(shape == number)
            distance[which], point[which], u[which] = self.shapes[number].measure(a[which], b[which])
        return distance, point, u

    def _put(self, body: int, link: int, shapes: list[Shape], friction: float | None) -> None:
        slot = self._bodies.slot(body, link)
        own = core_friction(friction)
        numbers = []
        for shape in shapes:
            plane = shape.half_space
            flat = plane is not None
            normal, offset = (plane[:3], plane[3]) if flat else (np.zeros(3), 0.0)
            lo, hi = np.nan_to_num(shape.bounds, posinf=1e300, neginf=-1e300)
            placed = (slot, shape.position, shape.rotation, lo, hi)
            measured = shape.measured, shape.solid, shape.closed_form
            number = self._core.add_shape(*placed, flat, normal, float(offset), own, *measured)
            self.shapes[number] = shape
            numbers.append(number)
        self._by_link[body, link] = numbers
        self._friction[body, link] = friction
        self._link_slots[body, link] = slot

    def _drop(self, key: tuple[int, int]) -> None:
        self._link_slots.pop(key, None)
        self._friction.pop(key, None)
        for number in self._by_link.pop(key, ()):
            self._core.remove_shape(number)
            del self.shapes[number]


def core_friction(given: float | None) -> float:
    """A coefficient of an obstacle or a tunnel as the core takes it; negative: pybullet's of the link."""
    return -1.0 if given is None else given
