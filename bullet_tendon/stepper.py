"""Stepper: one step of a world, from what pybullet says of its bodies to what the tendons do to them.

Owns: the solver's options and the last report. A step has five rooms: sense (where links are and how they
answer), near (distances that could matter), solve (the implicit step), react (wrenches on links) and bullet
(pybullet's own step). Goes with the core's room `world`. The core takes a step in one call. It calls back to
read bodies and to measure distances, and restores its state if anything fails.
"""

import warnings
from time import perf_counter

import numpy as np
import pybullet as p

from . import _core, checks
from .bodies import Bodies
from .cartilage import Cartilage
from .errors import InvalidType, InvalidValue, StepFailed, StepWarning
from .obstacles import Obstacles
from .options import SolverOptions
from .placement import Placement
from .reports import StepReport
from .tendon import Tendon

_GRAVITY = ["gravityAcceleration" + axis for axis in "XYZ"]
_ITERATING = 'SolverOptions with iteration="newton" and an implicit integrator, for ligaments and cartilage'
_FAILED, _SOLVED, _TO_TELL, _BAD_PARAMETERS = range(4)  # what the core's apply returns


class Stepper:
    """Takes the steps of the tendons in `tendons` (by slot), among bodies and obstacles."""

    def __init__(
        self,
        client: int,
        core: _core.World,
        bodies: Bodies,
        obstacles: Obstacles,
        placement: Placement,
        tendons: dict[int, Tendon],
        cartilages: dict[int, Cartilage],
        options: SolverOptions,
    ):
        self._client = client
        self._core = core
        self._bodies = bodies
        self._links = bodies.links
        self._placement = placement
        self._tendons = tendons
        self._cartilages = cartilages
        self._is_read, self._report = True, StepReport()  # whether _report is what the core reports
        self.options = options
        self._measure = obstacles.measure  # what the core calls; bound once
        self._react = self._bullet = 0.0  # seconds of these rooms in the last step
        self._again: bool | None = None  # whether a new solution of the last step was found

    @property
    def options(self) -> SolverOptions:
        """See TendonWorld.options."""
        return self._options

    @options.setter
    def options(self, value: SolverOptions) -> None:
        if not isinstance(value, SolverOptions):
            raise InvalidType("options", value, "SolverOptions")
        if self._core.has_elements() and value.goal is None:
            raise InvalidValue("options", value, _ITERATING)
        _ = self.report  # which is of the options that the step was taken with
        self._core.set_options(*value.core_arguments())
        self._options = value

    def require_iterating(self, call: str) -> None:
        """Raise InvalidValue unless the options can step ligaments and cartilage. Also where disconnected."""
        self._bodies.require_client()
        if self._options.goal is None:
            raise InvalidValue("options", self._options, f"{_ITERATING}, for {call}")

    @property
    def report(self) -> StepReport:
        """What the last step did and what it skipped; read from the core when it is first asked for."""
        if not self._is_read:
            found = self._core.report()
            worst = self._tendons.get(found.worst_tendon)
            name = "" if worst is None else worst.name
            seconds = found.sense_seconds, found.near_seconds, found.solve_seconds, self._react, self._bullet
            self._report, self._is_read = StepReport.read(found, name, seconds, self._options.goal), True
        return self._report

    def apply(self) -> None:
        """See TendonWorld.apply."""
        try:
            parameters = p.getPhysicsEngineParameters(self._client)
        except p.error:
            self._bodies.require_client()
            raise
        links = self._links
        outcome = self._core.apply(parameters, self._look_and_sense if links else None, self._measure)
        if outcome == _BAD_PARAMETERS:
            _checked(parameters)
        self._is_read = False
        self._bullet = self._react = 0.0
        if outcome == _FAILED:
            self._give_up()
        elif links:
            start = perf_counter()
            self._bodies.apply_wrenches(parameters["fixedTimeStep"])
            self._react = perf_counter() - start
        self._bodies.forget_external_forces()
        if outcome == _TO_TELL:
            report = self._core.report()
            if (slot := report.coarse_tendon) >= 0:
                self._placement.tell_coarse(slot, *self._core.coarse_turn(slot))
            if (slot := report.flat_cartilage) >= 0:
                self._cartilages[slot]._tell_flat()

    def step(self) -> None:
        """apply, pybullet's step, and the observation of held bodies right after it."""
        self.apply()
        start = perf_counter()
        p.stepSimulation(self._client)
        self._bullet = perf_counter() - start
        if self._links and self._core.any_held() and self._bodies.sample():
            report, self._again = self.report, None
            self._sense(*self._core.last_step(), was_read=False)
            if self._again is not None:
                report.add_solved_again(self._core.report(), self._again)

    def forbid_resolve(self) -> None:
        """The last step is not solved again: the bodies were moved since."""
        self._core.forbid_resolve()

    def hold(self, dt: float, gravity: tuple, at_hand: float = 0.0) -> _core.Report | None:
        """One step of dt [s] in which bodies neither move nor yield: what the core reports of it.

        They are where they were read last. at_hand: largest force on them [N]. The tolerance is of that where
        it is larger than the tendons' own. None only where the step could not be solved and the options say
        to go on. Raises what apply raises.
        """
        self._placement.look()
        solved = self._core.hold(dt, gravity, at_hand, self._measure)
        self._is_read = False
        self._bullet = self._react = 0.0
        if not solved:
            self._give_up()
            return None
        return self._core.report()

    def checkpoint(self, to: _core.Checkpoint | None = None) -> _core.Checkpoint:
        """The state of the core, for take_back. to: an earlier one that is not needed any more, or None."""
        if to is None:
            return self._core.checkpoint()
        self._core.capture(to)
        return to

    def take_back(self, to: _core.Checkpoint) -> None:
        """Put the core where it was; the report stays."""
        _ = self.report
        self._core.return_to(to)

    def step_and_gravity(self) -> tuple[float, tuple]:
        """pybullet's time step [s] and gravity (3 numbers) [m/s^2], checked.

        Raises UnknownId where the client was disconnected, InvalidValue for what is not finite.
        """
        self._bodies.require_client()
        return _checked(p.getPhysicsEngineParameters(self._client))

    def _give_up(self) -> None:
        """The step has no solution: raises StepFailed, or warns, as the options say."""
        self.report.converged = False
        problem = self._failure()
        if self._options.on_failure == "raise":
            raise problem
        warnings.warn(str(problem), StepWarning, stacklevel=5)

    def _failure(self) -> StepFailed:
        report = self._core.report()
        worst = self._tendons.get(report.worst_tendon)
        name = "?" if worst is None else worst.name
        return StepFailed(name, report.worst_particle, report.residual, self._options.tolerance)

    def _look_and_sense(self, dt: float, gravity: tuple) -> None:
        self._placement.look()
        self._sense(dt, gravity)

    def _sense(self, dt: float, gravity: tuple, was_read: bool = True) -> None:
        """Read where links are and how they respond; correct a last step with a release or a sudden pull.

        was_read: the forces of that step may have been read, by a user or a recorder.
        """
        self._bodies.read()
        if not self._core.sense(dt, gravity):
            return  # nothing is held that could be released
        for slot in self._bodies.unheld():
            self._core.let_go(slot)
        if self._resolve_previous_step(was_read):
            self._core.sense(dt, gravity)

    def _resolve_previous_step(self, was_read: bool) -> bool:
        """Correct a step in which a body was released, or pulled by a force that was not predicted.

        The step is solved again with the free response of the released links, and with the observed motion of
        the pulled bodies. The links get the difference of the impulses, as if that had acted in the step. If
        this has no solution, the step stays as it was taken. Bodies whose rates pybullet has cut off, so that
        the pull is not known, move as predicted. Returns whether any motion has changed.
        """
        last_dt = self._core.last_step()[0]
        released = self._core.released_bodies()
        pulled = [slot for slot in self._core.pulled_bodies() if self._bodies.was_free(slot)]
        if not released and not pulled:
            return False
        cut = [slot for slot in pulled if self._core.velocity_was_cut(slot)]
        for slot in cut:
            self._bodies.change_rates(slot, -last_dt * self._core.missed(slot), last_dt)
        pulled = [slot for slot in pulled if slot not in cut]
        if not self._solve_again(released, pulled, was_read) and not cut:
            return False
        self._bodies.read()
        self._core.finish_resolve()
        return True

    def _solve_again(self, released: list[int], pulled: list[int], was_read: bool) -> bool:
        """Solve the last step again, with released and pulled bodies; whether that step could be undone."""
        if not released and not pulled:
            return False
        core = self._core
        _ = self.report  # of the step as it was taken, before the core's is of this solution
        taken, given = core.save(), core.wrenches()
        dt, gravity = core.last_step()
        thrown = [(body, body.limit_shifts(core)) for body in map(self._bodies.jointed, core.thrown_bodies())]
        if not core.rewind(pulled):
            return False
        if self._solve(dt, gravity):
            core.accept_resolve(was_read)
            self._exchange_wrenches(given, dt)
            for body, shifts in thrown:
                body.set_rates(core.rates_at_end(body.slot), dt, shifts)
        else:
            core.restore(taken)
            for body in released:
                core.let_go(body)
        return True

    def _solve(self, dt: float, gravity: tuple) -> bool:
        self._again = self._core.step(dt, gravity, False, self._measure)
        return self._again

    def _exchange_wrenches(self, before: np.ndarray, dt: float) -> None:
        """Give bodies the difference of the last step's impulses to those of wrenches `before` (links, 6).

        dt: length of that step [s].
        """
        after = self._core.wrenches()
        for slot in self._core.pushable():
            self._bodies.exchange_wrench(slot, before[slot], after[slot], dt)


def _checked(parameters: dict) -> tuple[float, tuple]:
    """Time step and gravity of pybullet's parameters. Raises InvalidValue for what is not finite."""
    step = checks.number("fixedTimeStep", parameters["fixedTimeStep"], above=0)
    return step, tuple(checks.vector("gravity", [parameters[key] for key in _GRAVITY]).tolist())
