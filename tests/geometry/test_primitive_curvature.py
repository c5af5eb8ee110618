"""The curvature of round primitives against the distances beside them."""

import numpy as np
import pytest

from bullet_tendon import _core

SHAPES = {"sphere": [0.02], "capsule": [0.01, 0.05], "cylinder": [0.015, 0.04], "box": [0.02, 0.03, 0.04]}
STEP = 1e-5  # m


@pytest.mark.parametrize("kind", SHAPES)
def test_curvature_is_that_of_the_distance(kind):
    """At a tangential distance s from a point of the surface, the surface is k s^2/2 away."""
    shape, rng = _core.Primitive(kind, SHAPES[kind]), np.random.default_rng(3)
    seen = set()
    for _ in range(200):
        outside = rng.normal(size=3)
        outside *= 0.1 / np.linalg.norm(outside)
        distance, point, _ = shape(outside, (0, 0, 0))
        normal = (outside - point) / distance
        along = np.cross(normal, rng.normal(size=3))
        along /= np.linalg.norm(along)
        radius, axis = shape.round_at(point, normal)
        found = (1 - np.dot(axis, along) ** 2) / radius if radius > 0 else 0.0
        beside = [shape(point + s * along, (0, 0, 0))[0] for s in (-STEP, STEP)]
        if min(beside) < -1e-9 or abs(beside[0] - beside[1]) > 1e-3 * max(max(beside), 1e-10):
            continue  # beside an edge
        seen.add(found > 0)
        assert found == pytest.approx(sum(beside) / STEP**2, rel=1e-3, abs=1e-2)
    assert (kind == "box") == (True not in seen)
