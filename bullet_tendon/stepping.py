"""One step of a world by its rooms: sense, near, solve; what was let go is mended, what fails is reported.

Everything here is of TendonWorld, which it is a part of: its core, bodies, obstacles and options.
"""

import warnings

import numpy as np
import pybullet as p

from . import checks
from .errors import StepFailed, StepWarning
from .report import Clock, StepReport

_FAILED, _AGAIN = 0, 2  # outcomes of the core's solve
_PARAMETERS = ("fixedTimeStep", *["gravityAcceleration" + axis for axis in "XYZ"])


class TakesSteps:
    """The part of a TendonWorld that takes its steps."""

    def _step_and_gravity(self) -> tuple[float, tuple]:
        """pybullet's time step [s] and gravity (3 numbers) [m/s^2], checked."""
        self._bodies.require_client()
        found = p.getPhysicsEngineParameters(self._client)
        told = tuple([found[name] for name in _PARAMETERS])
        if told != self._told:
            step = checks.number("fixedTimeStep", told[0], above=0)
            self._checked = step, tuple(checks.vector("gravity", told[1:]).tolist())
            self._told = told
        return self._checked

    def _solve(self, dt: float, gravity: tuple, held: bool = False) -> bool:
        """Rooms sense, near and solve of one step of dt [s]; held: bodies neither move nor yield.

        False where it could not be solved and the options say to go on.
        """
        clock = Clock()
        self._core.keep()
        try:
            self._step_of(dt, gravity, held, clock)
        except StepFailed as problem:
            self._core.roll_back()
            if self._options.on_failure == "raise":
                raise
            self._left_out(problem, clock)
            return False
        except BaseException:  # an interrupt too
            self._core.roll_back()
            raise
        return True

    def _step_of(self, dt: float, gravity: tuple, held: bool, clock: Clock) -> None:
        if self._bodies.links:
            self._sense(dt, gravity, held)
        if not held:
            self._dt, self._last_gravity = dt, gravity
        self._core.begin(dt, gravity, held)
        clock.enter("sense")
        self._go_through(clock)
        self._core.finish()
        clock.enter("solve")
        self._tell(clock)

    def _tell(self, clock: Clock) -> None:
        """Keep what the core reports, for when somebody reads it."""
        told = self._core.report()
        worst = self._tendons.get(told.worst_chain)
        self._seconds = clock.seconds
        self._unread = told, "" if worst is None else worst.name, clock.seconds

    @property
    def report(self) -> StepReport:
        """What the last step did and what it skipped."""
        if self._unread is not None:
            self._report, self._unread = StepReport.read(*self._unread), None
        return self._report

    def _left_out(self, problem: StepFailed, clock: Clock) -> None:
        """Report a step without a finite solution, which was rolled back."""
        self._tell(clock)
        self.report.converged = False
        warnings.warn(str(problem), StepWarning, stacklevel=5)

    def _sense(self, dt: float, gravity: tuple, held: bool = False) -> None:
        """Where links are and how they answer; what was let go in the last step is put right."""
        self._bodies.tell(self._core)
        if not self._core.sense(dt, gravity, held) or held:
            return  # nothing is held that could be let go
        for slot in self._bodies.unheld(self._core):
            self._core.let_go(slot)
        self._mend(dt, gravity)

    def _mend(self, dt: float, gravity: tuple) -> None:
        """Take back a step that did not know of a release, or of a sudden pull at a body, and put it right.

        The step is solved again with the free response of the links that were let go, and with the motion
        that was seen of bodies pulled at; links get the difference of the impulses, as if that had acted in
        the first place. Where that has no solution, the step stays as it was taken. Bodies that pybullet
        has cut off, whose pull is not known, go as they were foreseen to. dt, gravity: of the step to come.
        """
        released = self._core.released_movers()
        pulled = [slot for slot in self._core.pulled_movers() if self._bodies.was_free(slot)]
        if not released and not pulled:
            return
        cut = [slot for slot in pulled if self._core.was_cut(slot)]
        for slot in cut:
            self._bodies.change_rates(slot, -self._dt * self._core.missed(slot), self._dt)
        if not self._take_back(released, [slot for slot in pulled if slot not in cut]) and not cut:
            return
        self._bodies.tell(self._core)
        self._core.refresh_movers()
        self._core.keep()  # where the step to come fails, bodies stay mended, and the tendons with them
        self._core.sense(dt, gravity, False)

    def _take_back(self, released: list[int], pulled: list[int]) -> bool:
        """Solve the last step again, without what held and with what pulled; whether there was a way back."""
        if not released and not pulled:
            return False
        taken, given = self._core.save(), self._core.wrenches()
        if not self._core.rewind(self._dt, self._last_gravity, pulled):
            return False
        try:
            self._take_again(given)
        except StepFailed:
            self._core.restore(taken)
            for mover in released:
                self._core.let_go(mover)
        else:
            self._core.keep_told_contacts()  # pybullet may tell others, of a later time (restoreState)
        return True

    def _take_again(self, before: np.ndarray) -> None:
        """Solve the last step again, and give bodies the difference of its impulses to those of `before`.

        before: (links, 6), the wrenches that acted in it.
        """
        self._core.begin(self._dt, self._last_gravity, False)
        self._go_through(Clock())
        self._core.finish()
        after = self._core.wrenches()
        for slot in self._core.pushable():
            self._bodies.exchange(slot, before[slot], after[slot], self._dt, self._core.stopped(slot))

    def _go_through(self, clock) -> None:
        """Near and solve, as often as the core wants it: to look again for contacts, or in parts."""
        outcome = _AGAIN
        while outcome == _AGAIN:
            self._obstacles.measure()
            clock.enter("near")
            outcome = self._core.solve()
            clock.enter("solve")
        if outcome == _FAILED:
            self._fail()

    def _fail(self):
        report = self._core.report()
        name = self._names().get(report.worst_chain, "?")
        raise StepFailed(name, report.worst_particle, report.residual, self._options.tolerance)
