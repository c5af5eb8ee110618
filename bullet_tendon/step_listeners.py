"""StepListeners: what is told when a step is complete, pybullet's part included.

Owns: the listeners of one world. Goes with no room of the core. A step that was taken by TendonWorld.apply is
complete when the script has called p.stepSimulation, which is known at the next call.
"""

from collections.abc import Callable


class StepListeners:
    """Functions without arguments, called in the order in which they were added."""

    def __init__(self):
        self._listeners: list[Callable[[], None]] = []
        self._applied = False  # whether pybullet's part of the last step is left to the script

    def add(self, listener: Callable[[], None]) -> None:
        self._listeners.append(listener)

    def discard(self, listener: Callable[[], None]) -> None:
        """Tell it no more; nothing, where it is not told."""
        if listener in self._listeners:
            self._listeners.remove(listener)

    def next_begins(self) -> None:
        """A new step begins, or somebody asks: what was applied has been stepped by the script."""
        if self._applied:
            self.complete()

    def applied(self) -> None:
        """A step was taken but for pybullet's part."""
        self._applied = True

    def complete(self) -> None:
        """A step is complete."""
        self._applied = False
        for listener in tuple(self._listeners):
            listener()
