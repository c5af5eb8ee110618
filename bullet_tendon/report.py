"""Read-outs of a step: the report and the contact table. Made when somebody asks."""

import dataclasses
from time import perf_counter

import numpy as np

ROOMS = ("sense", "near", "solve", "react", "bullet")
KINDS = ("bone", "bore", "mouth", "tendon")

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


class Clock:
    """Wall time of a step by room [s]."""

    def __init__(self):
        self.seconds = dict.fromkeys(ROOMS, 0.0)
        self._last = perf_counter()

    def enter(self, room: str) -> None:
        """The time since the last call was spent in `room`."""
        now = perf_counter()
        self.seconds[room] += now - self._last
        self._last = now


@dataclasses.dataclass
class StepReport:
    """What the last step did and what it skipped.

    iterations: Newton iterations (linear solutions), the most of any group of touching tendons, summed
    over all that was tried where the step was taken in parts; but for those on a few places of a group.
    residual: largest residual force over the largest force at hand [-]; converged: whether every
    group reached the tolerance, or its rounding level (always True of methods that do not iterate).
    worst: name of the tendon and particle with that residual. seconds: wall time by room; search_seconds: of
    the solution, what the search for tendons that touch took.
    counts: pairs of tendon features (particles, segments) and shapes that were considered by their
    boxes, culled, skipped (too far since their last query), reused (last plane or triangles), searched (the
    nearest triangle anew, in the core) and queried (of FCL, or of a closed form in the core);
    tendon_searches: pairs of tendons (each with itself too) whose list of segments that are near each other
    was collected anew; tendon_searches_skipped: those whose list served again, because its margin is not used
    up, or that need none, because a tendon is straight; tendon_pairs_considered: pairs of segments of those
    lists that were measured; tendon_pairs_near: those that could touch within the step;
    rows: contacts in the solution; groups: systems solved apart; substeps: parts that the step was taken in;
    tendons_asleep: left out of it because they rest.
    """

    iterations: int = 0
    residual: float = 0.0
    converged: bool = True
    worst: tuple[str, int] = ("", -1)
    seconds: dict[str, float] = dataclasses.field(default_factory=lambda: dict.fromkeys(ROOMS, 0.0))
    counts: dict[str, int] = dataclasses.field(default_factory=dict)
    search_seconds: float = 0.0

    @classmethod
    def read(cls, core, worst: str, seconds: dict[str, float]) -> "StepReport":
        """From the core's report, and the name of the tendon that is worst in it."""
        where = (worst, core.worst_particle)
        return cls(
            core.iterations, core.residual, core.converged, where, seconds, core.counts(), core.search_seconds
        )


def contact_table(records: list, names: dict[int, str], links: list[tuple[int, int]]) -> np.ndarray:
    """Structured array of CONTACT from the core's records."""
    table = np.zeros(len(records), CONTACT)
    for row, (chain, segment, other, link, kind, *rest) in zip(table, records, strict=True):
        body = links[link] if link >= 0 else (-1, -1)
        row["tendon"], row["segment"], row["other_tendon"] = names[chain], segment, names.get(other, "")
        row["bodyUniqueId"], row["linkIndex"] = body
        row["kind"] = KINDS[kind]
        for field, value in zip(CONTACT.names[6:], rest, strict=True):
            row[field] = value
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
