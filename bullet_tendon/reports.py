"""What can be read of a world: the report of its last step, contacts, wrenches and penetrations.

Owns: nothing but the forms of what is read; all of it is made when somebody asks. Goes with the core's room
`world` (report).
"""

import dataclasses

import numpy as np

from . import _core
from .bodies import Bodies
from .obstacles import Obstacles
from .penetration import Surroundings
from .tendon import Tendon
from .tunnels import Bores, Tunnel

ROOMS = ("sense", "near", "solve", "react", "bullet")
KINDS = ("bone", "bore", "mouth", "tendon")
REASONS = (
    "motion",
    "turn",
    "growth",
    "not_converged",
    "left_prediction",
    "woken",
    "step_weights",
    "joint_stops",
    "body_rotation",
    "released",
)

CONTACT = np.dtype(
    [
        ("tendon", "U32"),
        ("segment", "i4"),
        ("bodyUniqueId", "i4"),
        ("linkIndex", "i4"),
        ("other_tendon", "U32"),
        ("kind", "U8"),
        ("position", "f8", 3),
        ("normal", "f8", 3),
        ("distance", "f8"),
        ("normal_force", "f8"),
        ("friction_force", "f8"),
    ]
)

PENETRATION = np.dtype(
    [
        ("tendon", "U32"),
        ("segment", "i4"),
        ("bodyUniqueId", "i4"),
        ("linkIndex", "i4"),
        ("position", "f8", 3),
        ("normal", "f8", 3),
        ("depth", "f8"),
    ]
)


@dataclasses.dataclass
class StepReport:
    """What the last step did and what it skipped.

    Args:
        iterations: Newton iterations (linear solutions), the most of any island, summed over all that was
            tried where the step was taken in substeps.
        residual: largest residual force over the largest force at hand [-].
        converged: whether every island reached the tolerance, or its rounding level: a residual above the
            tolerance counts as solved where it is at most one rounding error (machine epsilon times stiffness
            times coordinate), or eight and no iteration halves it any more, or where it would move no
            particle by more than the tolerance times a segment and no iteration reduces it. It is always True
            of methods that do not iterate. ended_by tells which rule it was.
        worst: name of the tendon and particle with that residual.
        seconds: wall time by room [s].
        counts: pairs of tendon features (particles, segments) and shapes that were considered by their boxes,
            culled, skipped (too far since their last query), reused (last plane or triangles), searched (the
            nearest triangle anew, in the core) and queried (of FCL, or of a closed form in the core).
            tunnels_considered: pairs of tendons and tunnels; tunnels_culled: those whose boxes are too far
            apart. tendon_searches: pairs of tendons (each with itself too) whose list of segments that are
            near each other was collected anew; tendon_searches_skipped: those that are apart, those whose
            list served again, because its margin is not used up, and those that need none, because a tendon
            is straight.
            tendon_pairs_considered: pairs of segments of those lists that were measured; tendon_pairs_near:
            those that could touch within the step. contacts: in the solution. islands: sets of tendons and
            bodies that were solved by themselves. substeps: parts that the step was taken in.
            tendons_asleep: left out of it because they rest.
        search_seconds: of the solution, what the search for tendons that touch took [s].
        reasons: how often a substep was solved again or cut, by reason. "motion": something near a contact
            moves by more than its radius. "turn": a segment turns far. "growth": the last step was much
            shorter. "not_converged": a solution failed. "left_prediction": particles ended where
            contacts were not looked for. "woken": tendons at rest were reached. "step_weights": tendons that
            press on each other had other methods, or were struck in a step of BDF2. "joint_stops": joint
            limits act otherwise than predicted. "body_rotation": a body turns far. "released": a body that
            something holds yields, was released, or pulled by something that was not predicted: this step or
            the previous one was solved again; iterations, linear_solves and the other reasons include that.
        over_budget: whether max_linear_solves or time_budget stopped the step before it was solved; converged
            is then False.
        stops_settled: whether joint limits, motors, constraints and contacts of all bodies act as the forces
            of the solution ask for. False: they still changed after the step had been solved with six other
            sets of them, and the last one was taken; converged is then False.
        tolerance: what the residual was to reach; None of methods that do not iterate.

    Example:
        >>> world.step()
        >>> world.report.converged, world.report.over_budget, world.report.counts["islands"]
        (True, False, 1)
    """

    iterations: int = 0
    residual: float = 0.0
    converged: bool = True
    worst: tuple[str, int] = ("", -1)
    seconds: dict[str, float] = dataclasses.field(default_factory=lambda: dict.fromkeys(ROOMS, 0.0))
    counts: dict[str, int] = dataclasses.field(default_factory=dict)
    search_seconds: float = 0.0
    reasons: dict[str, int] = dataclasses.field(default_factory=dict)
    over_budget: bool = False
    stops_settled: bool = True
    tolerance: float | None = None

    def __repr__(self) -> str:
        rooms = ", ".join(f"{room} {1e6 * self.seconds[room]:.0f}" for room in ROOMS)
        state = f"{'converged' if self.converged else 'not converged'} by {self.ended_by}"
        parts = [f"{state} in {self.iterations} iterations (residual {self.residual:.2g})"]
        parts += [f"{self.counts['contacts']} contacts"] if "contacts" in self.counts else []
        parts += [f"{self.counts['substeps']} substeps"] if self.counts.get("substeps", 1) > 1 else []
        parts.append(f"{1e6 * sum(self.seconds.values()):.0f} us ({rooms})")
        return f"<StepReport: {', '.join(parts)}>"

    @property
    def ended_by(self) -> str:
        """Why the step was not solved further.

        "tolerance": it was reached; "rounding": the residual is above it, and is rounding, or moves nothing
        (see converged); "method": it does not iterate; "budget": over_budget; "stops": not stops_settled;
        "failure": not converged within the budget.
        """
        if not self.converged and self.over_budget:
            return "budget"
        if not self.stops_settled:
            return "stops"
        if not self.converged:
            return "failure"
        if self.tolerance is None:
            return "method"
        return "tolerance" if self.residual <= self.tolerance else "rounding"

    @classmethod
    def read(
        cls, core: _core.Report, worst: str, seconds: list[float], tolerance: float | None
    ) -> "StepReport":
        """From the core's report, the name of the tendon that is worst in it, seconds by room, tolerance."""
        return cls(
            core.iterations,
            core.residual,
            core.converged,
            (worst, core.worst_particle),
            dict(zip(ROOMS, seconds, strict=True)),
            core.counts(),
            core.search_seconds,
            {name: count for name, count in zip(REASONS, core.reasons, strict=True) if count},
            core.over_budget,
            core.stops_settled,
            tolerance,
        )

    def add_solved_again(self, core: _core.Report, solved: bool) -> None:
        """Add the work of solving this step again, after a body was released in it.

        solved: whether a solution was found. If not, the step stays as it was taken.
        """
        self.iterations += core.iterations
        self.counts["linear_solves"] += core.counts()["linear_solves"]
        for name, count in (*zip(REASONS, core.reasons, strict=True), ("released", 1)):
            if count:
                self.reasons[name] = self.reasons.get(name, 0) + count
        self.over_budget |= core.over_budget
        self.stops_settled &= core.stops_settled or not solved
        self.converged &= core.converged or not solved


class Readouts:
    """What is read of a world's tendons, bodies and obstacles as they are now, and of its last step."""

    def __init__(
        self,
        core: _core.World,
        bodies: Bodies,
        obstacles: Obstacles,
        tendons: dict[int, Tendon],
        tunnels: dict[int, Tunnel],
    ):
        self._core, self._bodies, self._obstacles = core, bodies, obstacles
        self._tendons, self._tunnels = tendons, tunnels

    def contacts(self) -> np.ndarray:
        """See TendonWorld.contacts."""
        names = {slot: t.name for slot, t in self._tendons.items()}
        return contact_table(self._core.contacts(), names, self._bodies.links)

    def wrench(self, body: int, link: int) -> np.ndarray:
        """See TendonWorld.wrench."""
        self._bodies.require(body, link)
        slot = self._bodies.find_slot(body, link)
        wrenches = self._core.wrenches_to_read()
        return wrenches[slot] if slot is not None and slot < len(wrenches) else np.zeros(6)

    def penetrations(self) -> np.ndarray:
        """See TendonWorld.penetrations."""
        return penetration_table({t.name: t.positions for t in self._tendons.values()}, self.surroundings())

    def surroundings(self) -> Surroundings:
        """Obstacles and bores where they are now. Raises UnknownId where a body or the client is gone."""
        self._bodies.require_client()
        self._bodies.require_alive()
        bores = Bores(tuple(self._tunnels.values()), self._bodies.frame)
        return Surroundings(self._obstacles.placed(), bores)


def contact_table(records: np.ndarray, names: dict[int, str], links: list[tuple[int, int]]) -> np.ndarray:
    """Structured array of CONTACT from the core's records (k, 14)."""
    table = np.zeros(len(records), CONTACT)
    tendon, segment, other, link, kind = records[:, :5].astype(int).T
    slots = range(1 + max(tendon.max(initial=-1), other.max(initial=-1)))
    name_of = np.array([*(names.get(slot, "") for slot in slots), ""])  # the last one for -1
    link_of = np.array([*links, (-1, -1)])
    table["tendon"], table["segment"], table["other_tendon"] = name_of[tendon], segment, name_of[other]
    table["bodyUniqueId"], table["linkIndex"] = link_of[link].T
    table["kind"] = np.array(KINDS)[kind]
    table["position"], table["normal"] = records[:, 5:8], records[:, 8:11]
    for column, field in enumerate(CONTACT.names[8:], 11):
        table[field] = records[:, column]
    return table


def penetration_table(tendons: dict[str, np.ndarray], surroundings) -> np.ndarray:
    """Structured array of PENETRATION, of centrelines (n, 3) [m] by name."""
    rows = []
    for name, line in tendons.items():
        for obstacle, found in surroundings.penetrated(line[:-1], line[1:]):
            for k, u, depth, normal in zip(*found, strict=True):
                place = (1 - u) * line[k] + u * line[k + 1]
                rows.append((name, k, obstacle.bodyUniqueId, obstacle.linkIndex, place, normal, depth))
    return np.array(rows, PENETRATION)
