"""Distances to boxes, spheres, capsules and cylinders against brute force; planes."""

import numpy as np
import pytest
from brute_force import (
    check_pairs,
    point_triangles,
    random_segments,
    segment_primitive,
    signed_distance,
    torus,
)

from bullet_tendon.errors import InvalidValue
from bullet_tendon.shapes import Shape, mesh, plane, primitive

SIZES = {"box": (0.2, 0.3, 0.5), "sphere": (0.2,), "capsule": (0.1, 0.4), "cylinder": (0.15, 0.4)}
COUNTS = [1000, pytest.param(10_000, marks=pytest.mark.slow)]


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize("kind", SIZES)
def test_primitive_against_brute_force(kind, count):
    shape = primitive(kind, SIZES[kind])
    a, b = random_segments(np.random.default_rng(1), count, shape)
    distance, point, u = shape.measure(a, b)
    exact = segment_primitive(kind, SIZES[kind], a, b)
    assert np.abs(distance - exact).max() <= 1e-8
    assert (exact < 0).mean() > 0.02 and (exact > 0).mean() > 0.3
    check_pairs(a, b, distance, point, u, np.ones(count, bool))
    assert np.abs(signed_distance(kind, SIZES[kind], point)).max() <= 1e-8


@pytest.mark.parametrize("scale", [1e-3, 1e3])
@pytest.mark.parametrize("kind", SIZES)
def test_primitive_at_tiny_and_huge_scale(kind, scale):
    sizes = np.array(SIZES[kind]) * scale
    shape = primitive(kind, sizes)
    a, b = random_segments(np.random.default_rng(2), 300, shape)
    distance, point, _ = shape.measure(a, b)
    assert np.abs(distance - segment_primitive(kind, sizes, a, b)).max() <= 1e-8 * scale
    assert np.abs(signed_distance(kind, sizes, point)).max() <= 1e-8 * scale


@pytest.mark.parametrize("height", [1e-9, 1e-6, 1e-3])
@pytest.mark.parametrize("kind", SIZES)
def test_very_near_and_parallel(kind, height):
    """Segments lifted off the surface along its normal, tangent to it, the foot in their middle."""
    rng = np.random.default_rng(3)
    shape = primitive(kind, SIZES[kind])
    start = rng.normal(size=(200, 3)) * 0.5
    start = start[signed_distance(kind, SIZES[kind], start) > 0.01]
    distance, foot, _ = shape.measure(start, start)
    normal = (start - foot) / distance[:, None]
    tangent = np.cross(normal, rng.normal(size=normal.shape))
    middle = foot + height * normal
    distance, point, _ = shape.measure(middle - 0.01 * tangent, middle + 0.01 * tangent)
    assert np.abs(distance - height).max() <= 1e-12
    assert np.abs(signed_distance(kind, SIZES[kind], point)).max() <= 1e-12


def test_parallel_to_a_face_is_measured_from_the_middle_and_ends_are_clean():
    box = primitive("box", (2.0, 2.0, 2.0))
    a = np.array([[-0.5, 0.0, 1.5], [0.0, 0.0, 1.5], [0.0, 0.0, 3.0]])
    b = np.array([[0.5, 0.0, 1.5], [0.0, 0.0, 3.0], [0.0, 0.0, 1.5]])
    distance, point, u = box.measure(a, b)
    assert distance == pytest.approx([0.5, 0.5, 0.5], abs=1e-15)
    assert u.tolist() == [0.5, 0.0, 1.0]
    assert point == pytest.approx(np.array([[0.0, 0.0, 1.0]] * 3), abs=1e-15)


@pytest.mark.parametrize("kind", SIZES)
def test_inside_the_way_out_is_the_shortest(kind):
    """From inside, by the distance reported along the direction reported, one is on the surface."""
    rng = np.random.default_rng(4)
    shape = primitive(kind, SIZES[kind])
    x = rng.uniform(*shape.bounds, size=(300, 3))
    x = np.vstack([x[signed_distance(kind, SIZES[kind], x) < 0], np.zeros((1, 3))])
    distance, point, _ = shape.measure(x, x)
    assert distance == pytest.approx(signed_distance(kind, SIZES[kind], x), abs=1e-14)
    assert np.abs(signed_distance(kind, SIZES[kind], point)).max() <= 1e-14
    assert np.linalg.norm(x - point, axis=1) == pytest.approx(-distance, abs=1e-14)


def test_no_segments_and_planes():
    assert [len(x) for x in mesh(*torus()).measure(np.empty((0, 3)), np.empty((0, 3)))] == [0, 0, 0]
    ground = plane((0, 3, 4), 10.0)
    assert isinstance(ground, Shape) and ground.half_space == pytest.approx([0, 0.6, 0.8, 2.0])
    with pytest.raises(InvalidValue, match="half_space"):
        ground.measure(np.zeros((1, 3)), np.zeros((1, 3)))


def test_brute_force_itself():
    """A few distances known by heart."""
    assert signed_distance("box", (2, 2, 2), [[2, 0, 0], [0, 0, 0], [2, 2, 1]]) == pytest.approx(
        [1, -1, 2**0.5]
    )
    triangle = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]]], float)
    assert point_triangles(np.array([0.2, 0.2, 3.0]), triangle) == pytest.approx(3.0)
    assert point_triangles(np.array([-3.0, 0.0, 4.0]), triangle) == pytest.approx(5.0)
