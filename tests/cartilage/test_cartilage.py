"""Cartilage: its pressure, its derivatives, and bodies that rest and fall on it."""

import ctypes
import math
import sys
import threading
import time
from collections import OrderedDict

import numpy as np
import pybullet as p
import pytest
from brute_force import point_triangles, torus
from scipy.spatial.transform import Rotation

import bullet_tendon as bt
from bullet_tendon import _core

G = 9.81
K = 10e6 * 0.55 / (1.45 * 0.1) / 0.006  # Pa/m, of the default layer


def plate(cells, size, up=True):
    """A square in the plane z = 0: vertices and triangles."""
    x = np.linspace(-size / 2, size / 2, cells + 1)
    across, along = np.meshgrid(x, x, indexing="ij")
    vertices = np.stack([across.ravel(), along.ravel(), np.zeros(across.size)], axis=1)
    number = np.arange((cells + 1) ** 2).reshape(cells + 1, cells + 1)
    a, b, c, d = (n.ravel() for n in (number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]))
    triangles = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    return vertices, triangles if up else triangles[:, ::-1]


def ball(radius, rings=60):
    """A closed sphere about the origin: vertices and triangles, wound to look outwards."""
    polar, turn = np.linspace(0, np.pi, rings + 1)[1:-1], np.linspace(0, 2 * np.pi, 2 * rings, endpoint=False)
    circle = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    inner = [np.column_stack([np.sin(t) * circle, np.full(len(turn), -np.cos(t))]) for t in polar]
    vertices = radius * np.concatenate([[[0, 0, -1]], *inner, [[0, 0, 1]]])
    m, last, triangles = len(turn), len(vertices) - 1, []
    for j in range(m):
        after = (j + 1) % m
        triangles += [(0, 1 + after, 1 + j), (last, last - m + j, last - m + after)]
        for i in range(len(polar) - 1):
            low, high = 1 + i * m, 1 + (i + 1) * m
            triangles += [(low + j, low + after, high + after), (low + j, high + after, high + j)]
    return vertices, np.array(triangles)


def cap(radius, angle=0.35, rings=50, turns=200):
    """The lower cap of a sphere about the origin, open: vertices and triangles that look outwards."""
    polar, turn = np.linspace(0, angle, rings + 1), np.linspace(0, 2 * np.pi, turns, endpoint=False)
    circle = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    vertices = radius * np.concatenate(
        [np.column_stack([np.sin(t) * circle, np.full(turns, -np.cos(t))]) for t in polar]
    )
    i, j = (n.ravel() for n in np.meshgrid(np.arange(rings), np.arange(turns), indexing="ij"))
    a, b = i * turns + j, i * turns + (j + 1) % turns
    triangles = np.concatenate([np.stack([a, b, b + turns], 1), np.stack([a, b + turns, a + turns], 1)])
    return vertices, triangles


def body(client, mass, at=(0, 0, 0), inertia=(1e-3, 1e-3, 1e-3)):
    """A body that pybullet neither damps nor lets collide."""
    shape = p.createCollisionShape(p.GEOM_SPHERE, radius=0.01, physicsClientId=client)
    made = p.createMultiBody(mass, shape, -1, at, physicsClientId=client)
    damping = {"linearDamping": 0, "angularDamping": 0}
    p.changeDynamics(made, -1, localInertiaDiagonal=inertia, **damping, physicsClientId=client)
    p.setCollisionFilterGroupMask(made, -1, 0, 0, client)
    return made


def height(body, client):
    return p.getBasePositionAndOrientation(body, client)[0][2]


def test_the_distance_is_exact_for_a_sphere_inside_and_outside():
    """Of a fine polyhedron: within its sagitta of the sphere's."""
    vertices, triangles = ball(0.02)
    distance = _core.SignedDistance(vertices, triangles)
    assert not distance.open and distance.volume() == pytest.approx(4 / 3 * math.pi * 0.02**3, rel=2e-3)
    points = np.random.default_rng(1).uniform(-0.03, 0.03, (500, 3))
    exact = np.linalg.norm(points, axis=1) - 0.02
    np.testing.assert_allclose(distance(points), exact, atol=0.02 * (np.pi / 60) ** 2 / 4)


@pytest.mark.parametrize("count", [3, 5, 11])
@pytest.mark.parametrize("thin", [1.0, 1e-3])
def test_the_nearest_point_is_that_of_brute_force(count, thin):
    """Of closed meshes of 18 to 242 triangles, up to a thousand times longer than wide."""
    vertices, triangles = torus(0.02, 0.007, count, count)
    vertices *= (thin, 1.0, 1.0)
    distance = _core.SignedDistance(vertices, triangles)
    assert not distance.open
    rng = np.random.default_rng(count)
    points = rng.uniform(-0.03, 0.03, (400, 3))
    points[::2, 0] *= thin
    exact = [point_triangles(x, vertices[triangles]).min() for x in points]
    np.testing.assert_allclose(np.abs(distance(points)), exact, rtol=1e-10, atol=1e-15)


def fold(length):
    """Two squares, open, at a right angle: what is at x < 0 and z < 0 is behind; 20 mm and `length` long."""
    y = 0.02
    corners = [(-0.02, -y, 0), (-0.02, y, 0), (0, -y, 0), (0, y, 0), (0, -y, -length), (0, y, -length)]
    return np.array(corners), np.array([(0, 2, 3), (0, 3, 1), (2, 4, 5), (2, 5, 3)])


def nodes_of(vertices, triangles, spacing, depth):
    """values (k, j, i) of a grid's nodes, infinite where not computed, and the distances there."""
    distance = _core.SignedDistance(vertices, triangles)
    numbers = _core.DistanceGrid(distance, spacing, depth).numbers()
    nodes, bricks = numbers[6:9].astype(int), int(np.prod(numbers[9:12]))
    values = numbers[12 + 2 * bricks :].reshape(nodes[::-1])
    k, j, i = np.nonzero(values < 1e300)
    assert numbers[3] == spacing and len(i) > 1000
    distances = np.full(values.shape, np.inf)
    distances[k, j, i] = distance(numbers[:3] + spacing * np.stack([i, j, k], axis=1))
    return np.where(values < 1e300, values, np.inf), distances


def test_the_nodes_of_a_grid_have_the_distances():
    values, distances = nodes_of(*ball(0.02, 12), 5e-4, 0.005)
    np.testing.assert_allclose(values, distances, rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize("mesh", [cap(0.02, rings=5, turns=11), fold(0.005)], ids=["cap", "fold"])
def test_depths_behind_an_open_surface_have_no_jumps(mesh):
    spacing, slope = 1e-3, math.sqrt(2)
    values, distances = nodes_of(*mesh, spacing, 0.008)
    known = np.isfinite(values)
    for axis in range(3):
        with np.errstate(invalid="ignore"):
            steps = np.diff(np.minimum(values, 0), axis=axis)
        both = known.take(range(1, known.shape[axis]), axis) & known.take(range(known.shape[axis] - 1), axis)
        assert np.abs(steps[both]).max() <= slope * spacing * (1 + 1e-9)
    # Nodes whose distance keeps the slope to all others have it.
    most, reach = np.full(values.shape, -np.inf), 8
    ends = np.where(known, np.minimum(distances, 0), -np.inf)
    ends = np.pad(ends, reach, constant_values=-np.inf)
    for shift in np.ndindex(*3 * (2 * reach + 1,)):
        way = slope * spacing * math.dist(shift, 3 * (reach,))
        there = ends[tuple(slice(a, a + n) for a, n in zip(shift, values.shape, strict=True))]
        np.maximum(most, there - way, out=most, where=way > 0)
    keeps = known & (distances >= most - 1e-15)
    assert keeps.sum() > 0.8 * known.sum()
    np.testing.assert_allclose(values[keeps], distances[keeps], rtol=1e-12, atol=1e-15)
    assert (values[known] >= distances[known] - 1e-15).all()


def test_nothing_is_behind_the_border_of_an_open_surface():
    vertices, triangles = plate(10, 0.04)
    distance = _core.SignedDistance(vertices, triangles)
    assert distance.open
    below = [(0.0, 0.0, -0.003), (0.019, 0.0, -0.003), (0.0211, 0.0, -0.001), (0.05, 0.05, -0.01)]
    np.testing.assert_allclose(distance(below)[:2], -0.003)
    assert (distance(below)[2:] > 0).all()
    assert distance([(0.03, 0.0, 0.0)])[0] == pytest.approx(0.01)
    # The distance goes on without a jump beyond the border.
    x = np.linspace(0.018, 0.022, 401)
    along = distance(np.column_stack([x, 0 * x, np.full(len(x), -0.001)]))
    assert np.abs(np.diff(along)).max() <= 1.5 * (x[1] - x[0])


def test_an_evenly_pressed_surface_has_the_pressure_of_its_depth(make_world, client):
    world = make_world()
    stand, slab = body(client, 0), body(client, 1e9, (0.0013, -0.0021, -0.0004))
    p.resetBasePositionAndOrientation(stand, (0, 0, 0), (0, 0, 0, 1), client)
    pad = world.add_cartilage((stand, -1, plate(7, 0.06)), (slab, -1, plate(9, 0.02, up=False)))
    world.apply()
    assert pad.foundation == pytest.approx(K, rel=1e-12)
    np.testing.assert_allclose(pad.depths(), 0.0004, rtol=1e-6)
    assert pad.max_pressure == pytest.approx(K * 0.0004, rel=1e-6)
    assert pad.area == pytest.approx(4e-4, rel=1e-9)
    np.testing.assert_allclose(pad.wrench, [0, 0, K * 0.0004 * 4e-4, 0, 0, 0], atol=1e-6 * K * 0.0004 * 4e-4)
    np.testing.assert_allclose(pad.centre, [0.0013, -0.0021, -0.0004], atol=1e-9)
    np.testing.assert_allclose(world.wrench(stand)[:3], -pad.wrench[:3], rtol=1e-12)


@pytest.mark.parametrize("depth", [3e-4, 8e-4])
@pytest.mark.parametrize("second", ["ball", "plate"])
def test_a_sphere_on_a_plate_is_pressed_as_in_closed_form(make_world, client, depth, second):
    """Within 1 %: pi K R d^2 of a sphere that is the foundation, whose springs are compressed vertically, and
    pi K (R - d) d^2 of a plate that is, whose springs are pressed along the sphere's radii.
    """
    world = make_world()
    radius = 0.02
    stand, top = body(client, 0), body(client, 1e9, (0, 0, radius - depth))
    meshes = plate(100, 0.02), cap(radius)
    sides = [(stand, -1, meshes[0]), (top, -1, meshes[1])]
    pad = world.add_cartilage(*(sides if second == "ball" else sides[::-1]))
    world.apply()
    exact = math.pi * K * (radius if second == "ball" else radius - depth) * depth**2
    sign = 1 if second == "ball" else -1
    assert pad.wrench[2] == pytest.approx(sign * exact, rel=0.01)
    assert np.abs(pad.wrench[:2]).max() <= 1e-3 * exact
    assert pad.max_pressure == pytest.approx(K * depth, rel=0.02)


@pytest.mark.parametrize("surface", ["plate", "ball"])
@pytest.mark.parametrize("order", [(0, 1), (1, 0)], ids=["a first", "b first"])
@pytest.mark.parametrize(
    "layer",
    [
        {},
        {"law": "logarithmic", "thickness": 5e-4},
        {"law": "logarithmic", "thickness": 5e-4, "damping": 2.0},
    ],
    ids=["linear", "logarithmic", "damped"],
)
def test_gradient_and_hessian_are_derivatives_of_the_potential(make_world, client, surface, order, layer):
    """By central differences, with either link first; depths of up to 0.85 and 0.95 of the thin layers."""
    world = make_world()
    places = [(0.01, 0.02, 0.03), (0.0, 0.01, 0.1)]
    made = [body(client, 1.0, at) for at in places]
    path = [(made[k], -1, (0, 0, 0)) for k in order]  # in this order they get their slots
    world.add_ligament(path, bt.Material(stiffness=1.0))
    lower = plate(40, 0.05) if surface == "plate" else ball(0.03)
    upper = plate(15, 0.02, up=False)
    pad = world.add_cartilage((made[0], -1, lower), (made[1], -1, upper), **layer)
    world.step()
    moves = np.zeros((2, 6))
    moves[order[0], 3:], moves[order[1], 3:] = [0.02, -0.01, 0.03], [0.05, 0.02, 0.01]
    above = [0.002, -0.001, -0.0003 if surface == "plate" else 0.0296]  # b onto a, tilted
    turn = Rotation.from_rotvec(moves[order[0], 3:]).as_matrix()
    moves[order[1], :3] = np.array(places[0]) + turn @ above - places[1]

    def term(by):
        at = moves + by
        for k in range(2):
            turned = Rotation.from_rotvec(by[k, 3:]) * Rotation.from_rotvec(moves[k, 3:])
            at[k, 3:] = turned.as_rotvec()
        return _core.testing.cartilage_term(world._core, pad.slot, at, 1 / 240)

    energy, gradient, hessian = term(np.zeros((2, 6)))
    assert energy > 0
    size, step = np.abs(gradient).max(), 1e-8
    for k in range(12):
        by = np.zeros(12)
        by[k] = step
        ahead, behind = term(by.reshape(2, 6)), term(-by.reshape(2, 6))
        assert (ahead[0] - behind[0]) / (2 * step) == pytest.approx(gradient[k], abs=1e-4 * size)
    curvatures = []
    for d in np.random.default_rng(1).standard_normal((8, 12)):
        ahead, behind = term(step * d.reshape(2, 6)), term(-step * d.reshape(2, 6))
        slope = (ahead[1] - behind[1]) @ d / (2 * step)
        curvatures.append((slope, d @ hessian @ d))
    found, expected = np.transpose(curvatures)
    # A point that passes from one cell of the grid to the next one in this motion has two curvatures.
    np.testing.assert_allclose(found, expected, atol=0.01 * np.abs(expected).max())
    assert np.median(np.abs(found - expected)) <= 1e-5 * np.abs(expected).max()


@pytest.mark.parametrize("resolution", [0.0, 4e-4, 1.5e-3])
def test_merged_triangles_keep_area_and_centre_of_area(make_world, client, resolution):
    """Of every patch, exactly; and a patch is no larger than the resolution allows."""
    world = make_world()
    stand, top = body(client, 0), body(client, 1.0, (0, 0, 0.03))
    vertices, triangles = ball(0.01, 40)
    far = vertices * 0.5 + [0.05, 0, 0]
    both = np.concatenate([vertices, far]), np.concatenate([triangles, triangles + len(vertices)])
    pad = world.add_cartilage((stand, -1, plate(10, 0.05)), (top, -1, both), resolution=resolution)
    points, areas = pad.points
    corners = both[0][both[1]]
    centres = corners.mean(axis=1)
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    of_triangles = np.linalg.norm(across, axis=1) / 2
    for near in (lambda x: x[:, 0] < 0.02, lambda x: x[:, 0] > 0.02):  # the two patches
        point, triangle = near(points), near(centres)
        assert areas[point].sum() == pytest.approx(of_triangles[triangle].sum(), rel=1e-12)
        moments = areas[point] @ points[point], of_triangles[triangle] @ centres[triangle]
        assert moments[0] == pytest.approx(moments[1], rel=1e-9, abs=1e-15)
    if resolution == 0:
        assert sorted(points.tolist()) == sorted(centres.tolist())
        return
    assert len(points) < len(centres) / (3 if resolution > 1e-3 else 1.2)
    largest = of_triangles.max()
    assert areas.max() <= 2.5 * resolution**2 + largest  # a patch fits into a box
    sagitta = resolution**2 / 2 / 0.005
    balls = ([0, 0, 0], 0.01), ([0.05, 0, 0], 0.005)
    off = [np.abs(np.linalg.norm(points - centre, axis=1) - radius) for centre, radius in balls]
    assert np.min(off, axis=0).max() <= sagitta + 1e-4  # sheets that face apart are not merged


def test_random_poses_have_the_forces_of_all_triangles(make_world, client):
    """Within 1 %, with the default resolution, where a ball is pressed into a wavy dish by 100 N and more."""
    world, rng = make_world(), np.random.default_rng(4)
    vertices, triangles = plate(160, 0.03)
    x, y = vertices[:, 0], vertices[:, 1]
    vertices[:, 2] = 20 * (x**2 + 0.5 * y**2) + 2e-4 * np.sin(900 * x)
    stand, top = body(client, 0), body(client, 1e9, (0, 0, 0.02), (1e9, 1e9, 1e9))
    sides = (stand, -1, ball(0.02, 50)), (top, -1, (vertices, triangles[:, ::-1]))
    pads = [world.add_cartilage(*sides, resolution=value) for value in (None, 0.0)]
    counts = [len(pad.points[0]) for pad in pads]
    assert counts[0] < 0.25 * counts[1]
    pressed = 0
    for _ in range(80):
        turn = Rotation.from_rotvec(rng.uniform(-0.1, 0.1, 3)).as_quat()
        place = (*rng.uniform(-2e-3, 2e-3, 2), 0.02 - rng.uniform(1e-4, 8e-4))
        p.resetBasePositionAndOrientation(top, place, turn, client)
        world.apply()
        some, whole = (pad.wrench for pad in pads)
        size = np.linalg.norm(whole[:3])
        if size > 100:
            pressed += 1
            assert np.linalg.norm(some[:3] - whole[:3]) <= 0.01 * size
            assert np.linalg.norm(some[3:] - whole[3:]) <= 0.01 * size * 0.005
            assert pads[0].area == pytest.approx(pads[1].area, rel=0.04)
    assert pressed >= 20


def test_points_that_come_near_are_noticed_in_every_evaluation(make_world, client):
    """Of one cartilage that is evaluated from place to place, and of others that are made there."""
    world, rng = make_world(), np.random.default_rng(8)
    stand, top = body(client, 0), body(client, 1e9, (0, 0, 0.0205), (1e9, 1e9, 1e9))
    sides = (stand, -1, plate(20, 0.05)), (top, -1, ball(0.02, 40))
    pad = world.add_cartilage(*sides)
    at, turn = np.array([0, 0, 0.0205]), Rotation.identity()
    pressed = 0
    for _ in range(60):
        at = at + rng.normal(0, 1.5e-4, 3) - [0, 0, 0.3 * (at[2] - 0.0197)]
        turn = Rotation.from_rotvec(rng.normal(0, 0.02, 3)) * turn
        p.resetBasePositionAndOrientation(top, at, turn.as_quat(), client)
        world.apply()
        fresh = world.add_cartilage(*sides)
        world.apply()
        np.testing.assert_array_equal(pad.wrench, fresh.wrench)
        world.remove_cartilage(fresh)
        pressed += pad.wrench[2] > 10
    assert 10 <= pressed <= 50


def pressed(world, client, force, damping=2.0, **layer):
    """A slab of 4 cm^2 on a plate, under a force [N] for 1 s: the cartilage, and how deep the slab is [m]."""
    stand, slab = body(client, 0), body(client, 2.0)
    meshes = (stand, -1, plate(10, 0.06)), (slab, -1, plate(8, 0.02, up=False))
    pad = world.add_cartilage(*meshes, damping=damping, **layer)
    for _ in range(240):
        at = p.getBasePositionAndOrientation(slab, client)[0]
        world.apply_external_force(slab, -1, (0, 0, -force), at, p.WORLD_FRAME)
        world.step()
        assert world.report.converged
    return pad, -height(slab, client)


@pytest.mark.parametrize("damping", [0.3, 2.0])
@pytest.mark.parametrize("share", [0.01, 0.3, 1.0, 2.9])
def test_a_layer_of_the_logarithmic_law_is_not_pressed_flat(make_world, client, recwarn, share, damping):
    """p = -K h ln(1 - d/h), under up to 2.9 K h, where the linear law has 2.9 thicknesses. The force alone
    would move the slab by up to 19 thicknesses in a step, to where nothing presses.
    """
    h = 0.002
    force = share * 1e6 * 0.55 / (1.45 * 0.1) * 4e-4
    pad, depth = pressed(make_world(), client, force, damping, law="logarithmic", thickness=h, modulus=1e6)
    assert pad.wrench[2] == pytest.approx(force, rel=1e-6)
    assert depth == pytest.approx(h * (1 - math.exp(-share)), rel=1e-4)
    assert pad.max_depth == pytest.approx(depth, rel=1e-4)
    assert pad.max_pressure == pytest.approx(force / 4e-4, rel=1e-4)
    assert not recwarn


def test_beyond_95_percent_the_logarithmic_law_goes_on_along_its_tangent(make_world, client):
    world, h = make_world(), 0.002
    stand, slab = body(client, 0), body(client, 1e12, (0, 0, -0.97 * h))
    meshes = (stand, -1, plate(10, 0.06)), (slab, -1, plate(8, 0.02, up=False))
    pad = world.add_cartilage(*meshes, law="logarithmic", thickness=h)
    world.apply()
    stiffness = pad.foundation * h
    assert pad.max_pressure == pytest.approx(stiffness * (math.log(20) + 20 * 0.02), rel=1e-6)


def test_a_layer_that_is_pressed_flat_is_told_once(make_world, client):
    layer = {"thickness": 0.002, "modulus": 1e6}
    force = 1.5 * 1e6 * 0.55 / (1.45 * 0.1) * 4e-4
    with pytest.warns(bt.CartilageWarning) as told:
        pad, depth = pressed(make_world(), client, force, name="meniscus", **layer)
    assert depth == pytest.approx(0.003, rel=1e-4) and pad.max_depth == pytest.approx(depth, rel=1e-4)
    (text,) = (str(warning.message) for warning in told)
    assert text.startswith("cartilage 'meniscus' is pressed by 0.00")
    assert "more than its thickness of 0.002 m" in text


def test_relax_tells_of_a_layer_that_is_pressed_flat(make_world, client):
    world = make_world(1 / 240, (0, 0, -G))
    stand, slab = body(client, 0), body(client, 300.0, (0, 0, -0.0004))
    meshes = (stand, -1, plate(10, 0.06)), (slab, -1, plate(8, 0.02, up=False))
    world.add_cartilage(*meshes, thickness=0.002, modulus=1e6)
    with pytest.warns(bt.CartilageWarning, match="more than its thickness"):
        world.relax(bodies=[slab])
    assert world.report.converged


def test_a_weight_rests_on_its_cartilage(make_world, client):
    world = make_world(1 / 240, (0, 0, -G))
    stand, slab = body(client, 0), body(client, 2.0, (0, 0, 0.0005))
    pad = world.add_cartilage((stand, -1, plate(10, 0.06)), (slab, -1, plate(8, 0.02, up=False)), damping=2.0)
    world.step(240)
    assert pad.wrench[2] == pytest.approx(2.0 * G, rel=1e-6)
    assert height(slab, client) == pytest.approx(-2.0 * G / (K * 4e-4), rel=1e-3)
    assert np.abs(p.getBaseVelocity(slab, client)[0]).max() <= 1e-7
    assert world.report.converged


@pytest.mark.parametrize("dt", [1 / 240, 1 / 1000])
def test_a_drop_of_30_joules_gains_no_energy(make_world, client, dt):
    """A slab of 10 kg from 0.3 m, a little tilted: it bounces, and nothing passes through."""
    world = make_world(dt, (0, 0, -G))
    stand, slab = body(client, 0), body(client, 10.0, inertia=(4e-2, 4e-2, 6e-2))
    lower = stand, -1, plate(10, 0.08)
    pad = world.add_cartilage(lower, (slab, -1, plate(12, 0.04, up=False)), damping=0.3)
    p.resetBasePositionAndOrientation(slab, (0.001, 0.002, 0.306), (0.002, 0.001, 0, 1), client)
    most, pressed = 10.0 * G * height(slab, client), 0.0
    for _ in range(round(0.8 / dt)):
        world.step()
        linear, angular = map(np.array, p.getBaseVelocity(slab, client))
        energy = 5.0 * linear @ linear + 2e-2 * angular @ angular + 10.0 * G * height(slab, client)
        assert energy <= most * (1 + 1e-3) + 0.01
        assert height(slab, client) > -0.006
        assert world.report.converged
        pressed = max(pressed, pad.wrench[2])
    assert pressed > 4e3


def test_600_newtons_of_compression_are_stable(make_world, client):
    """A condyle in a dish, with a force that is put on at once."""
    world = make_world(1 / 240)
    stand, top = body(client, 0), body(client, 3.0, (0, 0, 0.02), (0.02, 0.02, 0.005))
    pad = world.add_cartilage((stand, -1, plate(30, 0.04)), (top, -1, cap(0.02, 0.5, 30, 90)), damping=1.0)
    for _ in range(240):
        world.apply_external_force(top, -1, (0, 0, -600), p.getBasePositionAndOrientation(top, client)[0], 1)
        world.step()
        assert world.report.converged
    assert pad.wrench[2] == pytest.approx(600, rel=1e-3)
    linear = np.abs(p.getBaseVelocity(top, client)[0])
    assert linear[2] <= 1e-4 and linear[:2].max() <= 0.05  # it rolls to where the triangles are lowest


def test_free_bodies_keep_their_momentum(make_world, client):
    world = make_world()
    a, b = body(client, 1.0), body(client, 0.4, (0.002, 0.001, 0.0205))
    pad = world.add_cartilage((a, -1, ball(0.01, 30)), (b, -1, ball(0.011, 30)))
    p.resetBaseVelocity(b, (0.05, 0, -0.5), (1, 2, 3), client)
    pressed = 0
    for _ in range(60):
        world.step()
        np.testing.assert_allclose(world.wrench(a)[:3], -world.wrench(b)[:3], atol=1e-12)
        velocities = [np.array(p.getBaseVelocity(part, client)[0]) for part in (a, b)]
        np.testing.assert_allclose(velocities[0] + 0.4 * velocities[1], [0.02, 0, -0.2], atol=1e-12)
        pressed += pad.area > 0
    assert pressed >= 1 and velocities[1][2] > velocities[0][2]


def test_each_patch_is_told_by_itself(make_world, client):
    world = make_world()
    (one, lower), (_, upper) = plate(6, 0.01, up=False), plate(8, 0.06)
    two = one + [0.02, 0, 0.0002]
    both = np.concatenate([one, two]), np.concatenate([lower, lower + len(one)])
    stand, slab = body(client, 0), body(client, 1e9, (-0.01, 0, -0.0005), (1e9, 1e9, 1e9))
    pad = world.add_cartilage((stand, -1, (plate(8, 0.06)[0], upper)), (slab, -1, both))
    world.apply()
    first, second = pad.regions
    assert first.max_pressure == pytest.approx(K * 0.0005, rel=1e-6)
    assert second.max_pressure == pytest.approx(K * 0.0003, rel=1e-6)
    np.testing.assert_allclose([first.area, second.area], 1e-4)
    np.testing.assert_allclose(first.centre, [-0.01, 0, -0.0005], atol=1e-9)
    np.testing.assert_allclose(second.centre, [0.01, 0, -0.0003], atol=1e-9)
    np.testing.assert_allclose(pad.wrench, first.wrench + second.wrench)


def test_a_state_goes_on_with_the_same_bits(make_world, client):
    world = make_world(1 / 240, (0, 0, -G))
    stand, top = body(client, 0), body(client, 1.0, (0, 0, 0.0101))
    pad = world.add_cartilage((stand, -1, plate(10, 0.05)), (top, -1, ball(0.01, 30)))
    world.step(30)
    kept, bodies = world.save_state(), p.saveState(client)
    world.step(10)
    ends = world.state_hash(), pad.wrench.tolist()
    world.restore_state(kept)
    p.restoreState(bodies, physicsClientId=client)
    world.step(10)
    assert (world.state_hash(), pad.wrench.tolist()) == ends
    data = world.snapshot()
    world.load_snapshot(data)
    assert world.state_hash() == ends[0]
    world.remove_cartilage(pad)
    with pytest.raises(bt.StateMismatch):
        world.restore_state(kept)
    with pytest.raises(bt.UnknownId):
        _ = pad.area


def test_the_grid_is_kept_beside_the_mesh(make_world, client, tmp_path):
    vertices, triangles = plate(6, 0.03)
    path = tmp_path / "plate.obj"
    rows = [f"v {x} {y} {z}" for x, y, z in vertices] + [
        f"f {a + 1} {b + 1} {c + 1}" for a, b, c in triangles
    ]
    path.write_text("\n".join(rows))
    stand, slab = body(client, 0), body(client, 1.0, (0, 0, -0.0004))
    depths = []
    for _ in range(2):
        world = make_world()
        pad = world.add_cartilage((stand, -1, path), (slab, -1, plate(5, 0.01, up=False)), cache=True)
        depths.append(pad.depths())
        bt.cartilage._grids.clear()
    assert (tmp_path / "plate.obj.distances.npz").exists()
    np.testing.assert_array_equal(*depths)
    (tmp_path / "plate.obj.distances.npz").write_bytes(b"nonsense")
    pad = make_world().add_cartilage((stand, -1, path), (slab, -1, plate(5, 0.01, up=False)), cache=True)
    np.testing.assert_array_equal(pad.depths(), depths[0])


class Observed(OrderedDict):
    """A dictionary that calls `asked` when it has been asked for a key."""

    asked = None

    def __contains__(self, key):
        found = super().__contains__(key)
        if self.asked is not None:
            self.asked()
        return found


def test_worlds_in_several_threads_share_the_grids(monkeypatch):
    """One finds a grid in memory while another makes as many as are kept there, which drop it."""
    surfaces = [bt.cartilage.Surface(*plate(1, 0.01 * (k + 1))) for k in range(bt.cartilage._MOST_GRIDS + 1)]
    grids = Observed()
    monkeypatch.setattr(bt.cartilage, "_grids", grids)

    def find(surface):
        return bt.cartilage.grid_of(surface, 0.005, 0.01, None)

    others = threading.Thread(target=lambda: [find(surface) for surface in surfaces[1:]])

    def begin_others():
        grids.asked = None
        others.start()
        others.join(0.2)  # they wait, or have ended

    first = find(surfaces[0])
    grids.asked = begin_others
    assert find(surfaces[0]) is first
    others.join()
    assert len(grids) == bt.cartilage._MOST_GRIDS


@pytest.fixture
def undisturbed():
    """No thread is made to give the interpreter away."""
    interval = sys.getswitchinterval()
    sys.setswitchinterval(1000)
    yield
    sys.setswitchinterval(interval)


def test_a_grid_becomes_an_object_while_its_thread_has_the_interpreter(undisturbed):
    """Its distances are found while another thread runs, but no object changes until that one waits."""
    arguments = _core.SignedDistance(*plate(4, 0.02)), 0.0005, 0.005
    begun = time.perf_counter()
    _core.DistanceGrid(*arguments)
    needed = time.perf_counter() - begun
    grid = _core.DistanceGrid.__new__(_core.DistanceGrid)
    head = object.__basicsize__
    memory = lambda: ctypes.string_at(id(grid) + head, _core.DistanceGrid.__basicsize__ - head)  # noqa: E731
    empty = memory()
    maker = threading.Thread(target=grid.__init__, args=arguments)
    maker.start()
    before, end = memory(), time.perf_counter() + 10 * needed
    while time.perf_counter() < end:
        pass
    assert memory() == before
    maker.join()
    assert memory() != empty


def test_bad_calls_change_nothing(make_world, client):
    world = make_world()
    a, b = body(client, 0), body(client, 1.0, (0, 0, 0.001))
    first, second = (a, -1, plate(6, 0.03)), (b, -1, plate(5, 0.01, up=False))
    vertices, triangles = ball(0.01, 20)
    for changes, error, text in (
        ({"thickness": 0.0003}, bt.InvalidValue, "at least the grid's spacing of 0.0005 m"),
        ({"poisson": 0.5}, bt.InvalidValue, "< 0.5"),
        ({"modulus": 0}, bt.InvalidValue, "> 0"),
        ({"damping": -1}, bt.InvalidValue, ">= 0"),
        ({"spacing": 1e-6}, bt.InvalidValue, "nodes"),
        ({"resolution": -1e-3}, bt.InvalidValue, ">= 0"),
        ({"cache": True}, bt.InvalidValue, "not a path"),
        ({"law": "log"}, bt.InvalidValue, "linear"),
        ({"second": (a, -1, plate(5, 0.01))}, bt.InvalidValue, "another link"),
        ({"second": (b, -1, "none.stl")}, bt.InvalidValue, "readable"),
        ({"second": (b, 4, plate(5, 0.01))}, bt.UnknownId, "integer from -1"),
        ({"second": (b, -1, (vertices, [[0, 1, 999999]]))}, bt.InvalidValue, "indices"),
        ({"first": (a, -1, (vertices, triangles[:, ::-1]))}, bt.InvalidValue, "look outwards"),
    ):
        with pytest.raises(error, match=text):
            world.add_cartilage(**{"first": first, "second": second, **changes})
    assert world.cartilages == ()


def test_surfaces_that_cannot_meet_are_told(make_world, client):
    world = make_world()
    a, b = body(client, 0), body(client, 1.0, (0, 0, 0.0002))
    first = a, -1, plate(6, 0.03)
    with pytest.warns(bt.CartilageWarning, match="mean cosine of their normals is 1.00"):
        world.add_cartilage(first, (b, -1, plate(5, 0.01)))
    p.resetBasePositionAndOrientation(b, (0, 0, 0.3), (0, 0, 0, 1), client)
    with pytest.warns(bt.CartilageWarning, match="at least 0.2.* m apart"):
        world.add_cartilage(first, (b, -1, plate(5, 0.01, up=False)))


@pytest.mark.parametrize("gap", [0.0, 0.01])
def test_relax_finds_what_rests_on_it_and_not_what_is_behind_it(make_world, client, gap):
    """Lines that pull a ball down onto a plate would balance its weight below the plate, too."""
    world = make_world(1 / 240, (0, 0, -G))
    stand, sphere = body(client, 0), body(client, 2.0, (0, 0, 0.02 + gap))
    meshes = (stand, -1, plate(8, 0.1)), (sphere, -1, ball(0.02))
    pad = world.add_cartilage(*meshes, thickness=0.002)
    for x, y in ((0.1, 0.02), (-0.07, 0.07), (-0.05, -0.08)):
        path = [(stand, -1, (x, y, -0.05)), (sphere, -1, (0, 0, 0))]
        world.add_ligament(path, bt.Material(stiffness=50.0)).set_tension(10)
    world.relax(bodies=[sphere])
    assert world.report.converged
    pulls = [line.points[1] - line.points[0] for line in world.ligaments]
    load = 2.0 * G + sum(10 * pull[2] / np.linalg.norm(pull) for pull in pulls)
    assert pad.wrench[2] == pytest.approx(load, rel=1e-4)
    assert 0.02 - 0.001 < height(sphere, client) < 0.02
