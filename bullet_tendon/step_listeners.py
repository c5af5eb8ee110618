"""StepListeners: what is told when a step is complete, pybullet's part included.

Owns: the listeners of one world. Goes with no room of the core. A step that was taken by TendonWorld.apply is
complete when the script has called p.stepSimulation, which is known at the next call.
"""

from collections.abc import Callable


class StepListeners:
    """Functions that are called in the order in which they were added.

    Their argument: whether nothing but pybullet's step came after the step of the tendons.
    """

    def __init__(self):
        self._listeners: list[Callable[[bool], None]] = []
        self._applied = False  # whether pybullet's part of the last step is left to the script

    def add(self, listener: Callable[[bool], None]) -> None:
        self._listeners.append(listener)

    def discard(self, listener: Callable[[bool], None]) -> None:
        """Tell it no more; nothing, where it is not told."""
        if listener in self._listeners:
            self._listeners.remove(listener)

    def next_begins(self) -> None:
        """A new step begins, or somebody asks: what was applied has been stepped by the script."""
        if self._applied:
            self.complete(at_once=False)

    def applied(self) -> None:
        """A step was taken but for pybullet's part."""
        self._applied = True

    def complete(self, at_once: bool = True) -> None:
        """A step is complete. at_once: the script has done nothing since it began.

        All are told, also where one of them raises.
        """
        self._applied = False
        first = None
        for listener in tuple(self._listeners):
            try:
                listener(at_once)
            except Exception as problem:  # of a function that the user has given
                first = first or problem
        if first is not None:
            raise first
