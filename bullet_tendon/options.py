"""SolverOptions: what the user chooses about time stepping and contact.

Owns: values, immutable, and their order as the core takes them. Goes with the core's room `solver`.
"""

import dataclasses

from . import checks

_CHOICES = {
    "integrator": ("implicit_euler", "bdf2", "explicit_euler"),
    "iteration": ("newton", "single"),
    "linear_solver": ("banded", "pcg"),
    "bone_contact": ("spring", "constraint"),
}
_ON_FAILURE = ("raise", "warn")


@dataclasses.dataclass(frozen=True, kw_only=True)
class SolverOptions:
    """How a world steps its tendons. Immutable; give a world another one to change it.

    Args:
        integrator: "implicit_euler" (paper, equation 7), "bdf2" (second order, as stable, restarted at first
            order where the time step grows by more than 4.8, a hold is made or lost, a contact stops a tendon
            suddenly, or a body is let go),
            or "explicit_euler" (equation 6; stable for tiny steps only). "bdf2" is of second order for
            tendons on bodies and robots too; those on held or stopped bodies take implicit Euler. It
            takes a step in three parts where a segment is about to turn in it by more than an angle of sine
            0.6, in two where some tendon was touched in the last one, or where it is 2.4 to 4.8 times as long
            as that.
        iteration: "newton" solves the implicit step to the tolerance; "single" is the paper's one
            linearisation a step (equations 8 and 9).
        linear_solver: "banded", a direct block-banded Cholesky factorisation, or "pcg", the paper's
            preconditioned conjugate gradients (here: block Jacobi).
        bone_contact: "spring", temporary constraint springs (section 4.1), or "constraint": particles
            that would enter a body which does not yield are constrained directly (Baraff and Witkin 1998).
        tolerance: largest residual force of a converged step over the largest force at hand [-].
        max_iterations: Newton iterations after which a step counts as not converged, counted anew
            whenever friction limits or contacts have changed with its solution.
        linear_tolerance: of conjugate gradients, relative residual in the preconditioned norm [-].
        contact_stiffness: of the temporary springs [N/m], as in the paper. None: chosen for each contact
            from its particles, with the force carried over from step to step, so that a resting contact
            has no depth whatever its load.
        contact_threshold: the paper's d_collision, by which the springs' rest lengths exceed touching [m];
            less than the clearance of tendons in their bores.
        reuse_tolerance: error allowed to a contact plane of a closed form (sphere, box, capsule, cylinder) at
            rest that is reused instead of measured again [m]. Triangles of meshes that were near are kept and
            measured by the core between queries, to rounding, for as long as no other one can be nearest. 0
            queries always.
        sleep: whether steps leave out tendons at rest (slower than 1e-5 of their radius a second, for half a
            second) that something static holds or carries, until they or what is within reach of them moves
            or is changed. What touches a body that yields does not sleep, nor do methods that do not iterate.
        max_linear_solves: linear solutions that one step may take, of all its islands and substeps together.
            The default is some eighty times what the most violent step of the scenarios takes.
        time_budget: wall time that one step may take [s]; None: any. Once either is used up, the present
            substep ends after a few more iterations, shortened if particles have moved so far that they could
            pass through something. The rest of the step is one substep. For that, tendons that are not solved
            in it by 20 linear solutions, or that would pass through something, and the bodies on which they
            act, stay where they are, and the next step begins with their velocities. In such a step
            report.converged is False and report.over_budget True.
        on_failure: what a step without a finite solution does. "raise": StepFailed. "warn": a StepWarning,
            and the report says converged False; the tendons stay as they were, without a force on bodies, for
            that step. A step that ends finite above the tolerance is taken in both cases: its report says
            converged False, with the residual.

    Raises:
        InvalidType, InvalidValue: for whatever does not fit.

    Example:
        >>> import dataclasses
        >>> world.options = bt.SolverOptions(integrator="bdf2", tolerance=1e-8)
        >>> world.options = dataclasses.replace(world.options, time_budget=1e-3)
        >>> world.options.integrator, world.options.time_budget
        ('bdf2', 0.001)
    """

    integrator: str = "implicit_euler"
    iteration: str = "newton"
    linear_solver: str = "banded"
    tolerance: float = 1e-9
    max_iterations: int = 100
    linear_tolerance: float = 1e-10
    bone_contact: str = "spring"
    contact_stiffness: float | None = None
    contact_threshold: float = 0.0
    reuse_tolerance: float = 1e-6
    sleep: bool = True
    max_linear_solves: int = 8_000
    time_budget: float | None = None
    on_failure: str = "raise"

    def __post_init__(self):
        for name, allowed in _CHOICES.items():
            checks.choice(name, getattr(self, name), allowed)
        checks.choice("on_failure", self.on_failure, _ON_FAILURE)
        checks.number("tolerance", self.tolerance, above=0, at_most=1)
        checks.integer("max_iterations", self.max_iterations, at_least=1, at_most=10**6)
        checks.number("linear_tolerance", self.linear_tolerance, above=0, at_most=1)
        if self.contact_stiffness is not None:
            checks.number("contact_stiffness", self.contact_stiffness, above=0)
        checks.number("contact_threshold", self.contact_threshold, at_least=0)
        checks.number("reuse_tolerance", self.reuse_tolerance, at_least=0)
        checks.flag("sleep", self.sleep)
        checks.integer("max_linear_solves", self.max_linear_solves, at_least=1, at_most=10**9)
        if self.time_budget is not None:
            checks.number("time_budget", self.time_budget, above=0)

    @classmethod
    def published(cls, **changes) -> "SolverOptions":
        """The paper's own method: one linearisation a step, preconditioned conjugate gradients.

        Args:
            changes: further options.

        Example:
            >>> paper = bt.SolverOptions.published(integrator="explicit_euler")
            >>> paper.iteration, paper.linear_solver
            ('single', 'pcg')
        """
        return cls(**{"iteration": "single", "linear_solver": "pcg", **changes})

    @property
    def goal(self) -> float | None:
        """The tolerance that steps are solved to; None of methods that do not iterate."""
        iterates = self.iteration == "newton" and self.integrator != "explicit_euler"
        return float(self.tolerance) if iterates else None

    def core_arguments(self) -> tuple:
        """The options as the compiled core takes them."""
        chosen = [_CHOICES[name].index(getattr(self, name)) for name in _CHOICES]
        return (
            *chosen,
            float(self.tolerance),
            int(self.max_iterations),
            float(self.linear_tolerance),
            float(self.contact_stiffness or 0.0),
            float(self.contact_threshold),
            float(self.reuse_tolerance),
            bool(self.sleep),
            int(self.max_linear_solves),
            float(self.time_budget or 0.0),
        )
