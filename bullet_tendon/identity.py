"""Which body an id means. pybullet gives the ids of removed bodies to others (all of them after
resetSimulation), so every body that tendons refer to gets a mark, as pybullet user data: it goes
when its body goes, and a body that has the id next does not carry it.
"""

import itertools
import os

import pybullet as p

_KEY = "bullet_tendon"
_PROCESS = os.urandom(8).hex()
_numbers = itertools.count()


class Marks:
    """Marks on the bodies of one client."""

    def __init__(self, client: int):
        self._client = client

    def mark(self, body: int) -> tuple[int, bytes]:
        """The body's mark, made where it has none: the user data's id and its value."""
        number = p.getUserDataId(body, _KEY, physicsClientId=self._client)
        if number < 0:
            value = f"{_PROCESS}-{next(_numbers)}"
            number = p.addUserData(body, _KEY, value, physicsClientId=self._client)
        return number, p.getUserData(number, self._client)

    def all_hold(self, marks) -> bool:
        """Whether all bodies that carry these marks are still there."""
        value_of, client = p.getUserData, self._client
        return all(value_of(number, client) == value for number, value in marks)

    def holds(self, mark: tuple[int, bytes]) -> bool:
        """Whether the body that carries the mark is still there."""
        return p.getUserData(mark[0], self._client) == mark[1]
