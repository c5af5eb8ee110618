"""What is inside of closed surfaces, however badly they are given, and that open ones have no inside."""

from pathlib import Path

import numpy as np
import pytest
from brute_force import torus
from hypothesis import given, settings
from hypothesis import strategies as st

from bullet_tendon.mesh_files import read_mesh
from bullet_tendon.solids import Interior, winding_number

KNEE = Path(__file__).parents[3] / "shared" / "knee"
CUBE = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
SIDES = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
BOX = np.concatenate([SIDES[:, [0, 1, 2]], SIDES[:, [0, 2, 3]]])


def boxes(*placed):
    """Vertices and triangles of cubes, each (corner, size, turned inside out)."""
    vertices = np.concatenate([CUBE * size + np.asarray(corner, float) for corner, size, _ in placed])
    triangles = [BOX[:, :: -1 if turned else 1] + 8 * k for k, (_, _, turned) in enumerate(placed)]
    return vertices, np.concatenate(triangles)


def in_polygonal_torus(x, big=0.2, small=0.07):
    """Points (k, 3) surely inside (1), surely outside (0) or between the ring and its polygons (-1)."""
    away = np.hypot(np.hypot(x[:, 0], x[:, 1]) - big, x[:, 2])
    return np.where(away > 1.2 * small, 0, np.where(away < 0.7 * small, 1, -1))


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from([1e-4, 1.0, 1e4]), st.floats(0.0, 1.0))
def test_any_winding_scale_place_and_doubling(seed, scale, share):
    """A torus in triangle soup: a share of it turned over, some triangles twice, some without area."""
    rng = np.random.default_rng(seed)
    vertices, triangles = torus()
    x = rng.uniform(-0.3, 0.3, (200, 3)) * (1, 1, 0.4)
    turned = rng.random(len(triangles)) < share
    triangles = np.where(turned[:, None], triangles[:, ::-1], triangles)
    twice = triangles[rng.integers(len(triangles), size=20)]
    soup = vertices[np.concatenate([triangles, twice[:, [1, 2, 0]], twice[:, [0, 0, 1]]])].reshape(-1, 3)
    place = scale * rng.normal(size=3)
    interior = Interior(scale * soup + place, np.arange(len(soup)).reshape(-1, 3))
    assert interior.closed
    known = in_polygonal_torus(x)
    inside = interior.contains(scale * x + place)
    assert (inside[known >= 0] == known[known >= 0]).all() and {0, 1} <= set(known)


@pytest.mark.parametrize("turned", [(False, False), (False, True), (True, False), (True, True)])
def test_nested_overlapping_and_touching_pieces(turned):
    """A cavity is empty and overlap is solid, whichever way each of the two cubes was wound."""
    middle = np.array([[0.5, 0.5, 0.5], [0.1, 0.1, 0.1], [2.5, 0.5, 0.5], [-0.1, 0.5, 0.5]])
    cavity = Interior(*boxes(((0, 0, 0), 1, turned[0]), ((0.25, 0.25, 0.25), 0.5, turned[1])))
    assert cavity.contains(middle).tolist() == [False, True, False, False]
    overlap = Interior(*boxes(((0, 0, 0), 1, turned[0]), ((0.25, 0.25, 0.25), 3, turned[1])))
    assert overlap.contains(middle).tolist() == [True, True, True, False]
    edge = Interior(*boxes(((0, 0, 0), 1, turned[0]), ((1, 1, 0), 1, turned[1])))  # four triangles at an edge
    assert edge.contains([[0.5, 0.5, 0.5], [1.5, 1.5, 0.5], [1.5, 0.5, 0.5]]).tolist() == [True, True, False]


def test_island_in_a_cavity_is_solid():
    cubes = [((0, 0, 0), 1, False), ((0.2, 0.2, 0.2), 0.6, False), ((0.4, 0.4, 0.4), 0.2, False)]
    inside = Interior(*boxes(*cubes)).contains([[0.1, 0.5, 0.5], [0.3, 0.5, 0.5], [0.5, 0.5, 0.5]])
    assert inside.tolist() == [True, False, True]


def test_open_surfaces_have_no_inside_and_pinholes_do_not_open_one():
    vertices, triangles = boxes(((0, 0, 0), 1, False))
    lidless = Interior(vertices, triangles[1:])
    assert not lidless.closed and not lidless.contains([[0.5, 0.5, 0.5]]).any()
    vertices, triangles = torus(around=120, along=60)
    assert Interior(vertices, triangles[1:]).contains([[0.2, 0, 0], [0, 0, 0]]).tolist() == [True, False]
    strip = [[0, 1, 2], [1, 2, 3], [2, 3, 4], [3, 4, 0], [4, 0, 1]]  # a Moebius strip has but one side
    assert not Interior(np.random.default_rng(0).normal(size=(5, 3)), strip).closed


def test_seams_wider_than_rounding_are_welded():
    vertices, triangles = torus()
    soup = vertices[triangles].reshape(-1, 3)
    soup += np.random.default_rng(1).uniform(-5e-8, 5e-8, soup.shape)
    assert Interior(soup, np.arange(len(soup)).reshape(-1, 3)).contains([[0.2, 0, 0]]).all()


def test_winding_number_counts_turns():
    vertices, triangles = boxes(((0, 0, 0), 1, True))
    points = [[0.5, 0.5, 0.5], [1.5, 0.5, 0.5], [0.5, 0.5, 1 - 1e-9], [0.5, 0.5, 1 + 1e-9]]
    outwards = winding_number(points, vertices[triangles[:, ::-1]])
    assert np.abs(outwards) == pytest.approx([1, 0, 1, 0], abs=1e-7)
    assert winding_number(points, vertices[triangles]) == pytest.approx(-outwards)


@pytest.mark.skipif(not KNEE.exists(), reason="no real bones beside the project (shared/knee)")
@pytest.mark.parametrize("bone", ["femur", "tibia", "patella", "whole_femur"])
def test_real_bones(bone):
    """Against the parity of crossings along a ray that misses all edges."""
    file = read_mesh(KNEE / f"{bone}.stl")
    interior = Interior(file.vertices, file.triangles)
    assert interior.closed == (bone in ("patella", "whole_femur"))
    rng = np.random.default_rng(2)
    x = rng.uniform(file.vertices.min(0), file.vertices.max(0), (60, 3))
    inside = interior.contains(x)
    if not interior.closed:
        assert not inside.any()
        return
    corners, way = file.vertices[file.triangles], np.array([0.312, 0.577, 0.755])
    assert inside.tolist() == [bool(crossings(p, way, corners) % 2) for p in x]
    assert 0.1 < inside.mean() < 0.9


def crossings(start, way, corners) -> int:
    """How many triangles the ray from `start` meets (Moeller and Trumbore's way)."""
    a, b, c = np.moveaxis(corners, 1, 0)
    across = np.cross(way, c - a)
    volume = np.einsum("ij,ij->i", b - a, across)
    volume[volume == 0] = np.inf
    u = np.einsum("ij,ij->i", start - a, across) / volume
    other = np.cross(start - a, b - a)
    v, along = other @ way / volume, np.einsum("ij,ij->i", c - a, other) / volume
    return int(((u > 0) & (v > 0) & (u + v < 1) & (along > 0)).sum())
