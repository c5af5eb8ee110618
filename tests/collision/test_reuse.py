"""Distances that are not asked for again: the core measures the triangles that were near, exactly."""

import numpy as np
import pybullet as p
import pytest
from brute_force import segment_triangles
from link_scenes import add_mesh
from scipy.spatial import ConvexHull

import bullet_tendon as bt
from bullet_tendon import _core
from bullet_tendon.shapes import Shape

RADIUS = 0.002  # m


def hills(seed, cells=24, size=0.1):
    """A rough open surface (v, 3) [m], (t, 3): heights at random, so with peaks, ridges and hollows."""
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(*[np.linspace(-size / 2, size / 2, cells + 1)] * 2, indexing="ij")
    z = 1e-3 * rng.standard_normal(x.shape) - 10.0 * (x**2 + y**2)
    first = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).ravel()
    up, right, both = first + 1, first + cells + 1, first + cells + 2
    triangles = np.concatenate([np.c_[first, right, both], np.c_[first, both, up]])
    return np.c_[x.ravel(), y.ravel(), z.ravel()], triangles


@pytest.mark.parametrize("soup", [False, True])
@pytest.mark.parametrize("length", [0.0, 0.003])
def test_what_was_listed_answers_until_something_else_can_be_nearest(soup, length):
    rng = np.random.default_rng(5)
    vertices, triangles = hills(1)
    corners = rng.uniform(-0.05, 0.05, (300, 1, 3)) + rng.normal(0, 3e-3, (300, 3, 3))
    if not soup:
        corners = vertices[triangles]
    for _ in range(100):
        a = rng.uniform(-0.04, 0.04, 3) + (0 if soup else [0, 0, 0.04])
        way = rng.standard_normal(3)
        segment = np.array([a, a + length * way / np.linalg.norm(way)])
        d = segment_triangles(*segment, corners)
        if d == 0.0:
            continue
        whole, count, distance, _, _ = _core.testing.listed_nearest(corners, segment, 1.3 * d, segment)
        assert distance == pytest.approx(d, abs=1e-15)
        assert whole == pytest.approx(1.3 * d) or count == 64
        away = rng.standard_normal((2, 3)) if length else np.tile(rng.standard_normal(3), (2, 1))
        away *= 0.5 * (whole - d) / np.linalg.norm(away, axis=1).max()
        moved = segment + away
        exact = segment_triangles(*moved, corners)
        _, _, distance, point, u = _core.testing.listed_nearest(corners, segment, 1.3 * d, moved)
        assert distance == pytest.approx(exact, abs=1e-15)
        assert np.linalg.norm(moved[0] + u * (moved[1] - moved[0]) - point) == pytest.approx(exact, abs=1e-15)


@pytest.mark.parametrize(("length", "scale"), [(0.01, 1.0), (0.06, 1.0), (0.06, 1000.0)])
@pytest.mark.parametrize("surface", ["hills", "soup", "closed"])
def test_what_is_nearest_of_all_is_found_from_a_bound(surface, length, scale):
    """Points and segments, many of which cross the surface: there, and only there, the distance is 0.

    With lengths below and above one: a quotient of them is no product.
    """
    rng = np.random.default_rng(3)
    vertices, triangles = hills(2, cells=12)
    corners = vertices[triangles]
    if surface == "soup":
        corners = rng.uniform(-0.05, 0.05, (300, 1, 3)) + rng.normal(0, 8e-3, (300, 3, 3))
    elif surface == "closed":
        hull = ConvexHull(rng.standard_normal((60, 3)) * 0.03)
        corners = hull.points[hull.simplices]
    a = rng.uniform(-0.05, 0.05, (400, 3))
    b = a + rng.normal(0, length, (400, 3)) * (rng.random((400, 1)) < 0.7)
    corners, a, b = scale * corners, scale * a, scale * b
    exact = np.array([segment_triangles(*ends, corners) for ends in zip(a, b, strict=True)])
    within = exact * (1 + 10 ** rng.uniform(-8, 1, 400))
    found = _core.testing.searched_nearest(corners, np.c_[a, b], within)
    np.testing.assert_allclose(found[:, 0], exact, rtol=0, atol=scale * 1e-15)
    np.testing.assert_array_equal(found[:, 5] == 1, exact == 0)
    assert 20 <= (exact == 0).sum() <= 300
    apart = exact > 0
    between = a + found[:, 4:5] * (b - a) - found[:, 1:4]
    np.testing.assert_allclose(
        np.linalg.norm(between, axis=1)[apart], exact[apart], rtol=0, atol=scale * 1e-15
    )


@pytest.mark.parametrize("exponent", [-4, -6, -7, -8, -9])
def test_the_nearest_is_found_from_its_own_distance(exponent):
    """Next to the surface the rounding of coordinates is a large share of the bound."""
    rng = np.random.default_rng(5)
    hull = ConvexHull(rng.standard_normal((60, 3)) * 0.05 + 0.3)
    corners = hull.points[hull.simplices]
    faces = rng.integers(len(corners), size=1000)
    on = np.einsum("nk,nkj->nj", rng.dirichlet([1, 1, 1], 1000), corners[faces])
    distance = rng.uniform(0.7, 1.3, (2, 1000, 1)) * 10.0**exponent
    before, now = on + distance * hull.equations[faces, :3]
    point = _core.testing.searched_nearest(corners, np.c_[before, before], np.full(1000, np.inf))[:, 1:4]
    within = (1 + 1e-9) * np.linalg.norm(now - point, axis=1)
    found = _core.testing.searched_nearest(corners, np.c_[now, now], within)
    np.testing.assert_allclose(found[:, 0], distance[1, :, 0], rtol=0, atol=1e-14)
    np.testing.assert_allclose(found[:, 1:4], on, rtol=0, atol=1e-14)


def test_flat_faces_are_not_crossed_by_what_lies_in_their_planes():
    square = np.array([[[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[1, 1, 0], [0, 1, 0], [1, 0, 0]]], float)
    beside = [2.0, 0.2, 0.0, 2.5, 0.8, 0.0]
    inside, through = [0.2, 0.2, 0.0, 0.3, 0.3, 0.0], [0.5, 0.5, -1.0, 0.5, 0.5, 1.0]
    found = _core.testing.searched_nearest(square, np.array([beside, inside, through]), np.full(3, 2.0))
    np.testing.assert_allclose(found[:, 0], [1.0, 0.0, 0.0], atol=1e-15)


def draw(make_world, client, friction, pause=None, speed=1, **options):
    """A tendon drawn across hills by a hand: positions at the end, and how many distances were asked for.

    speed: in hundredths of a metre a second.
    """
    world = make_world(gravity=(0, 0, -9.81), **options)
    add_mesh(world, client, *hills(7), friction=1.0)
    material = bt.Material(stiffness=1e4, damping=1.0, friction=friction)
    t = world.add_tendon([[-0.06, 0, 0.006], [0, 0, 0.008], [0.06, 0, 0.006]], RADIUS, material, 50)
    hand = t.grip(-1)
    t.set_force(0, [-3.0, 0.0, -3.0])
    asked = 0
    for k in range(360):
        gone = min(speed * k, 200)
        hand.target = np.array([0.06 + 5e-5 * gone, 0.0, 0.006 - 2e-5 * gone])
        if k == 150 and pause:
            pause(world)
        world.step()
        asked += world.report.counts["pairs_queried"]
    return t.positions, asked


@pytest.mark.parametrize("friction", [0.0, 0.03, 0.3])
def test_friction_is_led_over_the_same_surface(make_world, client, friction):
    reused, few = draw(make_world, client, friction)
    anew, many = draw(make_world, client, friction, reuse_tolerance=0.0)
    assert np.ptp(reused[:, 0]) > 0.1
    assert np.abs(reused - anew).max() <= 1e-9
    assert many >= 50 * few


@pytest.mark.parametrize("speed", [20, 100, 200])
def test_fast_motion_needs_few_queries_as_well(make_world, client, speed):
    """To 2.4 m/s, where a step is longer than the tendon is thick."""
    reused, few = draw(make_world, client, 0.1, speed=speed)
    anew, many = draw(make_world, client, 0.1, speed=speed, reuse_tolerance=0.0)
    assert np.abs(reused - anew).max() <= 1e-9
    assert many >= 10 * few


@pytest.mark.parametrize("convex", [False, True])
def test_what_jumps_about_touches_what_it_touches(make_world, client, convex):
    """A bone put anywhere, into a tendon and beyond it: contacts are those of new queries."""
    vertices = 0.02 * ConvexHull(np.random.default_rng(1).standard_normal((40, 3))).points
    triangles = ConvexHull(vertices).simplices
    listed = {} if convex else {"indices": triangles.ravel().tolist()}
    shape = p.createCollisionShape(p.GEOM_MESH, vertices=vertices.tolist(), physicsClientId=client, **listed)
    bone = p.createMultiBody(0, shape, physicsClientId=client)
    worlds = [make_world(reuse_tolerance=tolerance) for tolerance in (1e-6, 0.0)]
    for world in worlds:
        world.add_obstacle(bone, meshes=[] if convex else [(vertices, triangles)])
        tendon = world.add_tendon([[-0.05, 0, 0], [0.05, 0, 0]], RADIUS, bt.Material(stiffness=1e3), 12)
        for i in range(12):
            tendon.grip(i, stiffness=100.0, damping=0.1)
    rng, touched = np.random.default_rng(2), 0
    for _ in range(120):
        place, turn = rng.uniform(-0.07, 0.07, 3), rng.standard_normal(4)
        p.resetBasePositionAndOrientation(bone, place, turn / np.linalg.norm(turn), physicsClientId=client)
        found = []
        for world in worlds:
            world.apply()
            found.append(np.sort(world.contacts, order=["segment", "distance"]))
        assert len(found[0]) == len(found[1])
        touched += len(found[0])
        for name in ("segment", "position", "normal", "distance", "normal_force"):
            np.testing.assert_allclose(found[0][name], found[1][name], rtol=1e-6, atol=1e-9)
    assert touched > 60


def test_lists_are_made_again_after_a_restore(make_world, client):
    def pause(world):
        state = world.save_state()
        world.step(3)
        world.restore_state(state)

    straight, _ = draw(make_world, client, 0.1)
    paused, _ = draw(make_world, client, 0.1, pause)
    np.testing.assert_array_equal(straight, paused)


@pytest.mark.parametrize("kind", ["box", "sphere", "capsule", "cylinder"])
def test_closed_forms_are_measured_within_the_core(make_world, client, kind, monkeypatch):
    """Drawn over one at 1 m/s, a tendon asks nothing of Python, and touches what it asks about from there."""

    def refuse(*_):
        raise AssertionError

    sizes = {"halfExtents": [0.02] * 3} if kind == "box" else {"radius": 0.02, "height": 0.1}
    if kind == "sphere":
        del sizes["height"]
    shape = p.createCollisionShape(getattr(p, f"GEOM_{kind.upper()}"), physicsClientId=client, **sizes)
    body = p.createMultiBody(
        0, shape, baseOrientation=p.getQuaternionFromEuler((1.4, 0.1, 0.0)), physicsClientId=client
    )
    monkeypatch.setattr(Shape, "measure", refuse)
    world = make_world(gravity=(0, 0, -9.81))
    world.add_obstacle(body, friction=1.0)
    t = world.add_tendon([[-0.1, 0, 0.05], [0.1, 0, 0.05]], RADIUS, bt.Material(stiffness=1e4), 40)
    hands = t.grip(0), t.grip(-1)
    touched = 0
    for _ in range(20):
        for hand in hands:
            hand.target = hand.target + [0.001, 0.0003, -0.004]
        world.step()
        touched += len(world.contacts)
        nearest = world.contacts["distance"]
        assert len(nearest) == 0 or nearest.min() > -0.05 * RADIUS
    assert touched > 0
    monkeypatch.undo()
    assert len(world.penetrations()) == 0
