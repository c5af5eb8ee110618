"""Contacts of bodies with each other: the points that pybullet lists, and the bodies that they join.

Owns: the contact points of a client where bodies are now. Bodies that touch are solved for as one, like those
that constraints join (constraints.py).
"""

from collections.abc import Callable, Iterable

import pybullet as p

from .constraints import has_constraints

MOST_RATES = 64  # of bodies that are solved for as one: work grows with the cube
_TOUCHING = 0.002  # m: bodies at rest on each other are within it; contact points are kept for longer


def bodies_of(client: int) -> list[int]:
    """The ids of all bodies of a client."""
    return [p.getBodyUniqueId(i, client) for i in range(p.getNumBodies(client))]


class Contacts:
    """The contact points of the bodies of a client; each body is asked for once between two `begin`."""

    def __init__(self, client: int):
        self._client = client
        self._points: dict[int, list[tuple]] = {}
        self._there: set[int] | None = None  # the client's bodies

    def begin(self, moved: bool) -> None:
        """Forget all points. moved: bodies have moved since pybullet found them.

        After a step pybullet lists those of where bodies were before it.
        """
        self._points, self._there = {}, None
        if moved:
            p.performCollisionDetection(self._client)

    def of(self, body: int) -> list[tuple]:
        """p.getContactPoints of a body; pybullet lists some with bodies that were removed since."""
        points = self._points.get(body)
        if points is None:
            points = p.getContactPoints(bodyA=body, physicsClientId=self._client)
            if points and self._there is None:
                self._there = set(bodies_of(self._client))
            self._points[body] = points = [point for point in points if point[2] in self._there]
        return points

    def pairs(self, bodies: dict[int, int], rates_of: Callable[[int], int]) -> list[tuple[int, int]]:
        """Pairs of bodies that move and touch: of these, and of what touches them, and so on.

        Heaps with more rates than are solved for as one are left out. bodies: with their numbers of rates.
        rates_of: that number of any body; 0 where it is left out.
        """
        pairs: list[tuple[int, int]] = []
        seen: set[int] = set()
        for body, count in bodies.items():
            if body not in seen and self.of(body):
                heap, among = self._heap(body, count, rates_of)
                seen.update(heap)
                pairs += among
        return pairs

    def _heap(self, body: int, count: int, rates_of: Callable) -> tuple[list[int], list[tuple[int, int]]]:
        """Bodies that touch this one, or each other, and their pairs; no pairs if these are too many."""
        heap, pairs = [body], []
        for one in heap:
            for other in sorted({point[2] for point in self.of(one)} - {one}):
                pair = min(one, other), max(one, other)
                if pair in pairs:
                    continue
                more = 0 if other in heap else rates_of(other)
                if other in heap or more > 0:
                    pairs.append(pair)
                if more > 0:
                    heap.append(other)
                    count += more
            if count > MOST_RATES:
                return heap, []
        return heap, pairs

    def can_be_hit(self, body: int) -> bool:
        """Whether any other body is near, or it has constraints; whatever contacts pybullet still lists."""
        others = set(bodies_of(self._client)) - {body}
        return has_constraints(body, self._client) or self._is_near(body, others)

    def can_be_held(self, body: int) -> bool:
        """Whether another body touches it, or it has constraints.

        pybullet's restoreState leaves contacts of later times behind.
        """
        if has_constraints(body, self._client):
            return True
        return self._is_near(body, {point[2] for point in self.of(body)})

    def _is_near(self, body: int, others: Iterable[int]) -> bool:
        return any(p.getClosestPoints(body, o, _TOUCHING, physicsClientId=self._client) for o in others)
