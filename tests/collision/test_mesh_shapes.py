"""Distances to meshes, which FCL measures, against brute force, and FCL's traps."""

from pathlib import Path

import fcl
import numpy as np
import pytest
from brute_force import Triangles, check_pairs, point_triangles, random_segments, segment_triangles, torus
from threads import at_once

from bullet_tendon.errors import InvalidValue
from bullet_tendon.mesh_files import read_mesh
from bullet_tendon.shapes import convex_mesh, mesh, primitive

FEMUR = Path(__file__).parents[3] / "shared" / "knee" / "femur.stl"
COUNTS = [1000, pytest.param(10_000, marks=pytest.mark.slow)]


def corners_of_a_rock(count=30):
    return np.random.default_rng(5).normal(size=(count, 3)) * (0.2, 0.15, 0.1)


def heights_of(hull, x):
    """Height (k, f) of points x (k, 3) over the planes of a hull's faces."""
    return x @ hull.equations[:, :3].T + hull.equations[:, 3]


def check_mesh(shape, triangles, a, b, tolerance=1e-12):
    """Every answer against brute force; where brute force says 0 the shape must say <= 0, and only there."""
    distance, point, u = shape.measure(a, b)
    exact = np.array([segment_triangles(p, q, triangles) for p, q in zip(a, b, strict=True)])
    outside = exact > tolerance
    assert np.isfinite(point).all()
    assert np.abs(distance - exact)[outside].max() <= tolerance
    assert (distance[~outside] <= tolerance).all()
    check_pairs(a, b, distance, point, u, outside)
    off = [point_triangles(x, triangles).min() for x in point[outside]]
    assert max(off) <= tolerance
    return exact


@pytest.mark.parametrize("count", COUNTS)
def test_concave_mesh_against_brute_force(count):
    vertices, triangles = torus()
    shape = mesh(vertices, triangles)
    exact = check_mesh(shape, vertices[triangles], *random_segments(np.random.default_rng(6), count, shape))
    assert (exact == 0).sum() > 0.01 * count


@pytest.mark.parametrize("count", COUNTS)
def test_convex_mesh_against_brute_force(count):
    shape = convex_mesh(corners_of_a_rock())
    hull = shape.query.hull
    a, b = random_segments(np.random.default_rng(7), count, shape)
    heights = np.minimum(heights_of(hull, a).max(1), heights_of(hull, b).max(1))
    distance, point, u = shape.measure(a, b)
    inside = heights <= 0
    assert inside.any() and (distance[inside] <= heights[inside] + 1e-12).all()
    assert np.abs(heights_of(hull, point).max(1)).max() <= 1e-12
    check_mesh(shape, hull.points[hull.simplices], a[~inside], b[~inside])
    check_pairs(a, b, distance, point, u, np.ones(count, bool))


@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_mesh_at_tiny_and_huge_scale_and_far_from_its_origin(scale):
    vertices, triangles = torus()
    vertices = scale * (vertices + (3.0, -2.0, 1.0))
    shape = mesh(vertices, triangles)
    a, b = random_segments(np.random.default_rng(8), 200, shape)
    check_mesh(shape, vertices[triangles], a, b, 1e-12 * scale)


def test_degenerate_poses_against_a_mesh():
    """Directions +-z, ends on vertices, edges and faces, segments along edges, and a hair above them."""
    vertices, triangles = torus()
    shape = mesh(vertices, triangles)
    corner, edge = vertices[triangles[:40, 0]], vertices[triangles[:40, :2]].mean(1)
    face, out = vertices[triangles[:40]].mean(1), np.array([0.0, 0.0, 1.0])
    for height in (0.0, 1e-12, 1e-9, 1e-6, -1e-6):
        for start in (corner, edge, face):
            for length in (1e-9, 0.01, -0.01):
                a = start + height * out
                distance, point, _ = shape.measure(a, a + length * out)
                exact = [segment_triangles(p, p + length * out, vertices[triangles]) for p in a]
                touching = np.array(exact) <= 1e-12
                assert np.abs(distance - exact)[~touching].max(initial=0.0) <= 1e-12
                assert (distance[touching] <= 2e-12).all() and np.isfinite(point).all()
    along = shape.measure(corner + 1e-3 * out, vertices[triangles[:40, 1]] + 1e-3 * out)
    exact = [
        segment_triangles(p + 1e-3 * out, q + 1e-3 * out, vertices[triangles])
        for p, q in zip(corner, vertices[triangles[:40, 1]], strict=True)
    ]
    right = np.array(exact) > 0
    assert along[0][right] == pytest.approx(np.array(exact)[right], abs=1e-12)


@pytest.mark.parametrize("length", [1e-12, 2.0**-8, 2.0**-8 * 1.999999, 0.1, 1.0, 50.0])
def test_lengths_of_segments(length):
    """A segment is asked in pieces whose lengths are powers of two: none of it may be left out."""
    vertices, triangles = torus()
    shape = mesh(vertices, triangles)
    rng = np.random.default_rng(9)
    way = rng.normal(size=(100, 3))
    way *= length / np.linalg.norm(way, axis=1)[:, None]
    middle = rng.normal(size=(100, 3)) * 0.3 + rng.uniform(-0.5, 0.5, (100, 1)) * way
    check_mesh(shape, vertices[triangles], middle - way / 2, middle + way / 2, 1e-12 * max(1.0, length))


def test_trap_sphere_against_mesh():
    """FCL finds spheres at distance 0 from meshes they are far from; points must not be asked as spheres."""
    vertices, triangles = torus()
    shape = mesh(vertices, triangles)
    x = np.random.default_rng(10).normal(size=(300, 3)) * 0.3
    distance, _, u = shape.measure(x, x)
    exact = [point_triangles(p, vertices[triangles]).min() for p in x]
    assert np.abs(distance - exact).max() <= 1e-12
    assert (u == 0).all()


def test_trap_reused_result_keeps_a_smaller_distance():
    shape = mesh(*torus())
    far, near = np.array([[0.0, 0.0, 5.0]]), np.array([[0.2, 0.0, 0.1]])
    first = shape.measure(far, far)[0]
    assert shape.measure(near, near)[0] < 0.1
    assert shape.measure(far, far)[0] == first


def test_trap_solver_type_is_never_passed(monkeypatch):
    """GST_INDEP sets the relative error to 1; the request in use must be the default one."""
    seen = []
    real = fcl.distance
    monkeypatch.setattr(fcl, "distance", lambda *a: seen.append(a[2]) or real(*a))
    mesh(*torus()).measure(np.ones((1, 3)), np.zeros((1, 3)))
    assert seen and all(request.gjk_solver_type == fcl.GJKSolverType.GST_LIBCCD for request in seen)


def test_trap_collision_objects_are_made_once(monkeypatch):
    shape = mesh(*torus())
    a, b = random_segments(np.random.default_rng(11), 50, shape)
    first = shape.measure(a, b)
    monkeypatch.setattr(fcl, "CollisionObject", None)
    for once, again in zip(first, shape.measure(a, b), strict=True):
        np.testing.assert_array_equal(again, once)


@pytest.mark.parametrize("shared", [False, True])
def test_threads_measure_what_one_alone_measures(shared):
    """To the bit, each with a mesh of its own and both with the same one; 12,000 queries of FCL."""
    vertices, triangles = torus()
    shapes = [mesh(vertices * scale, triangles) for scale in ((1.0, 1.0) if shared else (1.0, 1.1))]
    rng = np.random.default_rng(14)
    a = rng.uniform(-0.4, 0.4, (2, 6000, 3))
    b = a + rng.normal(0, 0.02, a.shape)
    alone = [np.column_stack(shapes[k].measure(a[k], b[k])) for k in range(2)]
    if shared:
        shapes[1] = shapes[0]
    found = [None] * 2

    def run(k):
        found[k] = np.column_stack(shapes[k].measure(a[k], b[k]))

    at_once(run, 2)
    np.testing.assert_array_equal(found, alone)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize("shape", [mesh(*torus()), primitive("box", (1, 1, 1))], ids=["mesh", "box"])
def test_trap_not_a_number_is_refused(shape, bad):
    with pytest.raises(InvalidValue, match="finite"):
        shape.measure(np.array([[0.0, bad, 0.0]]), np.zeros((1, 3)))


def test_trap_crossing_a_mesh_is_not_trusted():
    shape = mesh(*torus())
    distance, point, u = shape.measure(np.array([[0.2, 0, -1.0]]), np.array([[0.2, 0, 1.0]]))
    assert distance[0] == -1.0 and np.isfinite(point).all() and 0 <= u[0] <= 1


def test_trap_small_triangles_are_not_degenerate():
    """FCL takes triangles of 0.1 mm for degenerate, and then a point over one may be at distance 0."""
    steps = 1e-4 * np.arange(21)
    vertices = np.array([[x, y, 0.0] for x in steps for y in steps])
    i, j = (k.ravel() for k in np.meshgrid(np.arange(20), np.arange(20), indexing="ij"))
    at = i * 21 + j
    triangles = np.concatenate([np.stack([at, at + 21, at + 22], -1), np.stack([at, at + 22, at + 1], -1)])
    x = vertices[triangles].mean(1) + (0.0, 0.0, 2e-5)
    distance, point, _ = mesh(vertices, triangles).measure(x, x)
    assert np.abs(distance - 2e-5).max() <= 1e-15 and np.abs(point[:, 2]).max() <= 1e-15


def test_open_doubled_and_degenerate_triangles():
    """A single sheet given twice, turned over, with triangles without area and vertices nobody uses."""
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 0, 0], [0.5, 0, 0], [9, 9, 9]], float)
    triangles = [[0, 1, 2], [2, 3, 0], [0, 1, 1], [0, 4, 1], [2, 1, 0]]
    shape = mesh(vertices, triangles)
    assert shape.bounds.tolist() == [[0, 0, 0], [1, 1, 0]]
    a = np.array([[0.2, 0.2, 0.5], [-1.0, 0.5, 0.0]])
    distance, point, u = shape.measure(a, a * (1, 1, 2))
    assert distance == pytest.approx([0.5, 1.0], abs=1e-14)
    with pytest.raises(InvalidValue, match="area"):
        mesh(vertices, [[0, 1, 1], [0, 4, 1]])
    with pytest.raises(InvalidValue, match="volume"):
        convex_mesh(vertices[:4])


@pytest.mark.skipif(not FEMUR.exists(), reason="no real bone beside the project (shared/knee/femur.stl)")
@pytest.mark.parametrize("count", [150, pytest.param(3000, marks=pytest.mark.slow)])
def test_real_bone_against_brute_force(count):
    bone = read_mesh(FEMUR)
    triangles = bone.vertices[bone.triangles]
    rng = np.random.default_rng(12)
    t = triangles[rng.integers(len(triangles), size=count)]
    normal = np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    a = t.mean(1) + normal * rng.choice([1e-6, 1e-3, 4e-3, 0.02], (count, 1))
    way = rng.normal(size=(count, 3))
    way *= 0.005 * rng.random((count, 1)) / np.linalg.norm(way, axis=1)[:, None]
    way[::5] = 0.0
    check_mesh(mesh(bone.vertices, bone.triangles), triangles, a, a + way, 1e-10)


def near_segments(rng, count, triangles, scale):
    """Segments of 1e-6 to 1 (times scale) 1e-9 to 0.3 over or under faces, edges and corners."""
    t = triangles[rng.integers(len(triangles), size=count)]
    weights = rng.dirichlet(np.ones(3), count)
    weights[: count // 7] = np.eye(3)[rng.integers(3, size=count // 7)]
    normal = np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0])
    size = np.linalg.norm(normal, axis=1)[:, None]
    normal /= np.where(size > 0, size, 1.0)
    height = 10 ** rng.uniform(-9, -0.5, (count, 1)) * rng.choice([1, -1], (count, 1))
    way = rng.normal(size=(count, 3))
    way[::2] = np.cross(way, normal)[::2]
    way *= 10 ** rng.uniform(-6, 0, (count, 1)) / np.linalg.norm(way, axis=1)[:, None]
    foot = np.einsum("ij,ijk->ik", weights, t) + scale * height * normal
    a = foot - scale * rng.choice([0.0, 0.3, 0.8], (count, 1)) * way
    return a, a + scale * way


@pytest.mark.skipif(not FEMUR.exists(), reason="no real bones beside the project (shared/knee)")
@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize("bone", ["femur", "tibia", "patella", "whole_femur"])
@pytest.mark.parametrize("count", [40, pytest.param(10_000, marks=pytest.mark.slow)])
def test_real_bones_at_all_scales_heights_and_lengths(bone, scale, count):
    """No error beyond rounding, no false far, and no false near but within rounding of the surface."""
    file = read_mesh(FEMUR.with_name(f"{bone}.stl"))
    rng = np.random.default_rng(13)
    vertices = scale * (file.vertices + rng.choice([0.0, 100.0]))
    a, b = near_segments(rng, count, vertices[file.triangles], scale)
    distance, point, u = mesh(vertices, file.triangles).measure(a, b)
    brute = Triangles(vertices[file.triangles])
    exact = np.array([brute.distance(p, q) for p, q in zip(a, b, strict=True)])
    assert np.isfinite(distance).all() and np.isfinite(point).all() and ((u >= 0) & (u <= 1)).all()
    apart = distance > 0
    assert np.abs(distance - exact)[apart].max() <= 1e-11 * scale
    assert (exact[~apart] <= 1e-7 * scale).all()
    assert (exact > 0).any() and (exact == 0).any()
