"""Window: a world's tendons in pybullet's window (p.GUI), coloured by tension; a key to pause, one to step.

Owns: the visual bodies that it adds to the client, until it is closed. Goes with no room of the core.
"""

import time
from collections.abc import Sequence

import pybullet as p

from . import checks
from .errors import InvalidType, NotCopied
from .tendon import Tendon
from .visuals import (
    LIGAMENT_COLOR,
    PALETTE,
    LigamentLine,
    Lines,
    TendonVisual,
    checked_colors,
    update_visuals,
)
from .world import TendonWorld

PAUSE, STEP = p.B3G_SPACE, p.B3G_RIGHT_ARROW
_NAP = 0.01  # s between two looks at the keys while paused


class Window(NotCopied):
    """Shows a world's tendons in the window of its client, and lets its user pause a run.

    The space bar pauses and goes on, the right arrow takes a single step while paused. Call update after each
    step::

        while window.update():
            world.step()

    Args:
        world: a TendonWorld. A client without a window works too, and has no keys.
        colors: RGBA of the tendons without tension, by turns.
        tension: whether segments are coloured by tension, up to red.
        full_tension: [N] at which a segment is red; None: the highest tension so far.

    Raises:
        InvalidType, InvalidValue: naming the argument.

    Example:
        >>> window = bt.view.Window(world)
        >>> window.update()
        True
        >>> window.close()
    """

    def __init__(
        self,
        world: TendonWorld,
        colors: Sequence = PALETTE,
        tension: bool = True,
        full_tension: float | None = None,
    ):
        if not isinstance(world, TendonWorld):
            raise InvalidType("world", world, "a TendonWorld")
        self._world = world
        self._client = world.physicsClientId
        self._colors = checked_colors(colors)
        self._colored = checks.flag("tension", tension)
        if full_tension is not None:
            full_tension = checks.number("full_tension", full_tension, above=0.0)
        self._given = full_tension
        self._highest = 0.0
        self._visuals: dict[Tendon | LigamentLine, TendonVisual] = {}
        self._lines = Lines(world)
        self.paused = False

    def update(self) -> bool:
        """Show the tendons where they are; while paused, wait for a key. False once the window is closed.

        Example:
            >>> window = bt.view.Window(world)
            >>> while window.update() and len(world.tendons) > 1:
            ...     world.step()
        """
        if not self._is_open():
            return False
        self._follow()
        self._read_keys()
        while self.paused:
            if not self._is_open():
                return False
            if self._read_keys():
                break  # a single step
            time.sleep(_NAP)
        return self._is_open()

    def close(self) -> None:
        """Take the tendons out of the window; a second call does nothing.

        Example:
            >>> window = bt.view.Window(world)
            >>> window.close()
        """
        if self._is_open():
            for visual in self._visuals.values():
                visual.remove()
        self._visuals.clear()

    def __enter__(self) -> "Window":
        return self

    def __exit__(self, *_) -> None:
        self.close()

    def _is_open(self) -> bool:
        return bool(p.isConnected(self._client))

    def _read_keys(self) -> bool:
        """Pause or go on; whether a single step is asked for."""
        keys = p.getKeyboardEvents(self._client)
        if keys.get(PAUSE, 0) & p.KEY_WAS_TRIGGERED:
            self.paused = not self.paused
        return bool(keys.get(STEP, 0) & p.KEY_WAS_TRIGGERED)

    def _follow(self) -> None:
        tendons = self._lines.now()
        if list(self._visuals) != tendons:
            for visual in self._visuals.values():
                visual.remove()
            self._visuals = {t: self._visual(k, t) for k, t in enumerate(tendons)}
        if self._colored:
            tensions = [float(tendon.tension.max()) for tendon in tendons]
            self._highest = max([self._highest, *tensions])
            for visual in self._visuals.values():
                visual.full_tension = self._full()
        update_visuals(self._visuals.values())

    def _visual(self, k: int, tendon: Tendon | LigamentLine) -> TendonVisual:
        full = self._full() if self._colored else None
        own = self._colors[k % len(self._colors)]
        color = LIGAMENT_COLOR if isinstance(tendon, LigamentLine) else own
        return TendonVisual(tendon, self._client, color, full)

    def _full(self) -> float:
        return self._given or self._highest or 1.0
