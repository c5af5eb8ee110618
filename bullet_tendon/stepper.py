"""Stepper: one step of a world, from what pybullet says of its bodies to what the tendons do to them.

Owns: the solver's options, the last step's length and gravity (with which it is solved again where a body
turns out to have been released in it), and the last report. A step has five rooms: sense (where links are and
how they answer), near (distances that could matter), solve (the implicit step), react (wrenches on links) and
bullet (pybullet's own step). Goes with the core's room `world`, which asks for distances by a callback.
"""

import warnings
from operator import itemgetter
from time import perf_counter

import numpy as np
import pybullet as p

from . import _core, checks
from .bodies import Bodies
from .errors import InvalidType, StepFailed, StepWarning
from .obstacles import Obstacles
from .options import SolverOptions
from .reports import ROOMS, StepReport
from .tendon import Tendon

_step_and_gravity = itemgetter("fixedTimeStep", *["gravityAcceleration" + axis for axis in "XYZ"])
_SENSE, _NEAR, _SOLVE, _REACT, _BULLET = range(len(ROOMS))


class Stepper:
    """Takes the steps of the tendons in `tendons` (by slot), among bodies and obstacles."""

    def __init__(
        self,
        client: int,
        core: _core.World,
        bodies: Bodies,
        obstacles: Obstacles,
        tendons: dict[int, Tendon],
        options: SolverOptions,
    ):
        self._client = client
        self._core = core
        self._bodies = bodies
        self._obstacles = obstacles
        self._tendons = tendons
        self.options = options
        self.last_step: tuple[float, tuple] = (0.0, (0.0, 0.0, 0.0))  # length [s], gravity [m/s^2]
        self._read: tuple = ()  # pybullet's time step and gravity, and what they are when checked
        self._checked: tuple[float, tuple] = self.last_step
        self._seconds = [0.0] * len(ROOMS)  # of the last step
        self._report = StepReport()
        self._is_read = True  # whether _report is what the core reports

    @property
    def options(self) -> SolverOptions:
        """See TendonWorld.options."""
        return self._options

    @options.setter
    def options(self, value: SolverOptions) -> None:
        if not isinstance(value, SolverOptions):
            raise InvalidType("options", value, "SolverOptions")
        self._core.set_options(*value.core_arguments())
        self._options = value

    @property
    def report(self) -> StepReport:
        """What the last step did and what it skipped; made when it is asked for."""
        if not self._is_read:
            found = self._core.report()
            worst = self._tendons.get(found.worst_tendon)
            name = "" if worst is None else worst.name
            self._report, self._is_read = StepReport.read(found, name, self._seconds), True
        return self._report

    def apply(self) -> None:
        """See TendonWorld.apply."""
        if self.solve(*self.step_and_gravity()) and self._bodies.links:
            start = perf_counter()
            self._bodies.apply_wrenches()
            self._seconds[_REACT] += perf_counter() - start

    def step(self) -> None:
        """apply, pybullet's step, and what is seen of held bodies right after it."""
        self.apply()
        start = perf_counter()
        p.stepSimulation(self._client)
        self._seconds[_BULLET] = perf_counter() - start
        if self._core.any_held() and self._bodies.sample():
            self._sense(*self.last_step)

    def step_and_gravity(self) -> tuple[float, tuple]:
        """pybullet's time step [s] and gravity (3 numbers) [m/s^2], checked.

        Raises UnknownId where the client was disconnected, InvalidValue for what is not finite.
        """
        try:
            found = p.getPhysicsEngineParameters(self._client)
        except p.error:
            self._bodies.require_client()
            raise
        read = _step_and_gravity(found)
        if read != self._read:
            step = checks.number("fixedTimeStep", read[0], above=0)
            self._checked = step, tuple(checks.vector("gravity", read[1:]).tolist())
            self._read = read
        return self._checked

    def solve(self, dt: float, gravity: tuple, held: bool = False) -> bool:
        """Rooms sense, near and solve of one step of dt [s]; held: bodies neither move nor yield.

        False where it could not be solved and the options say to go on. Raises StepFailed where they do
        not; then, and where anything else is raised, the tendons are as they were.
        """
        self._core.checkpoint()
        seconds = [0.0, 0.0, 0.0, 0.0, 0.0]
        try:
            if self._bodies.links:
                start = perf_counter()
                self._sense(dt, gravity, held)
                seconds[_SENSE] = perf_counter() - start
            self._solve(dt, gravity, held, seconds)
        except BaseException as problem:  # an interrupt too
            self._core.restore_checkpoint()
            if not isinstance(problem, StepFailed):
                raise
            self._seconds, self._is_read = seconds, False
            self.report.converged = False
            if self._options.on_failure == "raise":
                raise
            warnings.warn(str(problem), StepWarning, stacklevel=5)
            return False
        self._seconds, self._is_read = seconds, False
        if not held:
            self.last_step = dt, gravity
        return True

    def _solve(self, dt: float, gravity: tuple, held: bool, seconds: list[float]) -> None:
        """Rooms near and solve: the core's step, which asks obstacles for the distances that it needs.

        Adds to the seconds of both rooms. Raises StepFailed.
        """
        solved, near, solve = self._core.step(dt, gravity, held, self._obstacles.measure)
        seconds[_NEAR] += near
        seconds[_SOLVE] += solve
        if not solved:
            raise self._failure()

    def _failure(self) -> StepFailed:
        report = self._core.report()
        worst = self._tendons.get(report.worst_tendon)
        name = "?" if worst is None else worst.name
        return StepFailed(name, report.worst_particle, report.residual, self._options.tolerance)

    def _sense(self, dt: float, gravity: tuple, held: bool = False) -> None:
        """Where links are and how they answer; a last step with a release or a sudden pull is put right."""
        self._bodies.read()
        if not self._core.sense(dt, gravity, held) or held:
            return  # nothing is held that could be released
        for slot in self._bodies.unheld():
            self._core.let_go(slot)
        self._resolve_previous_step(dt, gravity)

    def _resolve_previous_step(self, dt: float, gravity: tuple) -> None:
        """Take back a step that did not know of a release, or of a sudden pull at a body, and put it right.

        The step is solved again with the free response of the links that were released, and with the motion
        that was seen of bodies pulled at; links get the difference of the impulses, as if that had acted in
        the first place. Where that has no solution, the step stays as it was taken. Bodies whose rates
        pybullet has cut off, so that the pull is not known, go as was predicted. dt, gravity: of the step to
        come.
        """
        last_dt = self.last_step[0]
        released = self._core.released_bodies()
        pulled = [slot for slot in self._core.pulled_bodies() if self._bodies.was_free(slot)]
        if not released and not pulled:
            return
        cut = [slot for slot in pulled if self._core.was_cut(slot)]
        for slot in cut:
            self._bodies.change_rates(slot, -last_dt * self._core.missed(slot), last_dt)
        pulled = [slot for slot in pulled if slot not in cut]
        if not self._solve_again(released, pulled) and not cut:
            return
        self._bodies.read()
        self._core.refresh_bodies()
        self._core.checkpoint()  # where the step to come fails, all stays as it is now
        self._core.sense(dt, gravity, False)

    def _solve_again(self, released: list[int], pulled: list[int]) -> bool:
        """Solve the last step again, without what held and with what pulled; whether there was a way back."""
        if not released and not pulled:
            return False
        core = self._core
        _ = self.report  # of the step as it was taken: the core's is going to be of this solution
        taken, given = core.save(), core.wrenches()
        if not core.rewind(*self.last_step, pulled):
            return False
        try:
            self._solve(*self.last_step, False, [0.0] * len(ROOMS))  # seconds that nobody reads
            self._exchange_wrenches(given)
        except StepFailed:
            core.restore(taken)
            for mover in released:
                core.let_go(mover)
        return True

    def _exchange_wrenches(self, before: np.ndarray) -> None:
        """Give bodies the difference of the last step's impulses to those of wrenches `before` (links, 6)."""
        after = self._core.wrenches()
        for slot in self._core.pushable():
            stopped = self._core.stopped(slot)
            self._bodies.exchange_wrench(slot, before[slot], after[slot], self.last_step[0], stopped)
