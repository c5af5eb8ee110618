"""Resampling of a user's polyline into evenly spaced particles."""

import numpy as np

from . import checks
from .errors import InvalidValue


def particle_positions(points, particles: int | None) -> np.ndarray:
    """(n, 3) particles along the polyline `points` (m, 3) [m].

    particles: how many, evenly spaced by arc length; None: the points themselves. At corners the
    centreline cuts across, so it can be shorter than the polyline. Raises InvalidType or InvalidValue,
    also where neighbouring points coincide.
    """
    line = checks.array("points", points, (None, 3))
    if len(line) < 2:
        raise InvalidValue("points", points, "at least 2 points")
    lengths = np.linalg.norm(np.diff(line, axis=0), axis=1)
    if not (lengths > 1e-9 * lengths.max()).all() or lengths.max() == 0:
        raise InvalidValue("points", points, "distinct from one point to the next")
    if particles is None:
        return line
    n = checks.integer("particles", particles, at_least=2)
    arc = np.concatenate([[0.0], np.cumsum(lengths)])
    even = np.linspace(0.0, arc[-1], n)
    return np.column_stack([np.interp(even, arc, line[:, c]) for c in range(3)])
