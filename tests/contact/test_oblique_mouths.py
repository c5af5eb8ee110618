"""Mouths of bores that meet the bone's surface at a slope: where they are, and what they hold back."""

import math

import numpy as np
import pybullet as p
import pytest
from brute_force import subdivided
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq, minimize_scalar

import bullet_tendon as bt
from bullet_tendon import _core, shapes
from bullet_tendon.mouths import mouths_of

MOUTH = 2  # ContactKind::mouth
SIZE = (0.2, 0.2, 0.05)  # of the box that is drilled [m]
BORE = 0.004
RANDOM = settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))


def slanted(tilt, below=0.0):
    """Start and end of a bore through the box at a tilt [rad], its end as far below the upper face [m]."""
    way = np.array([math.sin(tilt), 0.0, math.cos(tilt)])
    half = 0.5 * SIZE[2] / math.cos(tilt)
    return -half * way, (half - below / math.cos(tilt)) * way, way


def slope_of(tilt, way):
    """Of a horizontal plane over the axis `way`: z = 0 at c d + s e for d across the axis, s = slope . d."""
    return -(np.array([0.0, 0.0, 1.0]) - math.cos(tilt) * way) / math.cos(tilt)


@pytest.mark.parametrize("below", [0.0, 0.002])
@pytest.mark.parametrize("tilt", [0.0, 0.3, 0.9, 1.05])
def test_a_mouth_lies_in_the_surface(tilt, below):
    start, end, way = slanted(tilt, below)
    found = mouths_of([shapes.primitive("box", SIZE)], start, end, BORE)
    half = 0.5 * SIZE[2] / math.cos(tilt)
    np.testing.assert_allclose(found.centres, [-half * way, half * way], atol=1e-6)
    np.testing.assert_allclose(found.slopes, [slope_of(tilt, way)] * 2, atol=1e-5)


def test_a_mouth_that_is_straight_stays_where_it_was_given():
    start, end, _ = slanted(0.0)
    found = mouths_of([shapes.primitive("box", SIZE)], start, end, BORE)
    assert (found.centres == [start, end]).all()
    assert not found.slopes.any()


@pytest.mark.parametrize(
    ("solids", "start", "end"),
    [
        ([], [0, 0, -0.02], [0, 0, 0.02]),
        (["box"], [0, 0, -0.025], [0, 0, 0.01]),
        (["box"], [0.12, 0, -0.02], [0.12, 0, 0.02]),
        (["box"], [0.099, 0, -0.02], [0.099, 0, 0.02]),
    ],
    ids=["no bone", "blind", "an eyelet beside the bone", "a groove along its edge"],
)
def test_what_has_no_surface_around_it_stays_across_the_axis(solids, start, end):
    found = mouths_of([shapes.primitive(kind, SIZE) for kind in solids], start, end, BORE)
    assert (found.centres == [start, end]).all()
    assert not found.slopes.any()


def test_a_bone_of_several_shapes_is_one():
    """The surface within the bone, where two shapes overlap, is no mouth."""
    halves = [shapes.primitive("box", (0.11, 0.2, 0.05), (x, 0, 0)) for x in (-0.05, 0.05)]
    start, end, way = slanted(0.6, 0.001)
    found = mouths_of(halves, start, end, BORE)
    np.testing.assert_allclose(found.slopes, [slope_of(0.6, way)] * 2, atol=1e-5)


def test_a_mesh_and_a_primitive_have_the_same_mouths():
    corners = np.array(np.meshgrid(*[(-0.5, 0.5)] * 3)).reshape(3, -1).T * SIZE
    box = shapes.convex_mesh(corners)
    surface = shapes.mesh(corners, box.query.hull.simplices)
    start, end, _ = slanted(0.7, 0.002)
    exact = mouths_of([shapes.primitive("box", SIZE)], start, end, BORE)
    for shape in (box, surface):
        found = mouths_of([shape], start, end, BORE)
        np.testing.assert_allclose(found.centres, exact.centres, atol=1e-6)
        np.testing.assert_allclose(found.slopes, exact.slopes, atol=1e-5)


def test_an_open_mesh_has_mouths_too():
    """As a scan of a part of a bone, which has no inside: the lower face is missing."""
    corners = np.array(np.meshgrid(*[(-0.5, 0.5)] * 3)).reshape(3, -1).T * SIZE
    faces = shapes.convex_mesh(corners).query.hull.simplices
    cap = shapes.mesh(corners, faces[~(corners[faces][:, :, 2] < 0).all(1)])
    assert not cap.interior.closed
    start, end, way = slanted(0.7, 0.002)
    found = mouths_of([cap], start, end, BORE)
    np.testing.assert_allclose(found.centres, [start, 0.5 * SIZE[2] / math.cos(0.7) * way], atol=1e-6)
    np.testing.assert_allclose(found.slopes, [np.zeros(3), slope_of(0.7, way)], atol=1e-5)


@RANDOM
@given(seed=st.integers(0, 2**32 - 1), steep=st.floats(0.01, 2.0))
def test_the_distance_from_an_edge_is_the_least(seed, steep):
    """Against a search over the ellipse."""
    random = np.random.default_rng(seed)
    axis = random.standard_normal(3)
    axis /= np.linalg.norm(axis)
    one = np.cross(axis, random.standard_normal(3))
    one /= np.linalg.norm(one)
    centre, slope = random.uniform(-1, 1, 3), steep * one
    x = centre + random.uniform(-2, 2, 3) * BORE
    found = _core.testing.contact_term(
        MOUTH, x, np.zeros(3), 0.0, centre, axis, BORE, slope, 1.0, 0.0, 0.0, 0.0, np.zeros(3), True
    )[0]
    angles = np.linspace(0, 2 * np.pi, 20001)
    out = np.outer(np.cos(angles), one) + np.outer(np.sin(angles), np.cross(axis, one))
    edge = centre + BORE * (out + np.outer(out @ slope, axis))
    least = np.linalg.norm(x - edge, axis=1).min()
    assert found == pytest.approx(least, abs=1e-6 * BORE)


def ended_half(steep, distance, lean, half, samples=20001):
    """Points of an edge of radius BORE, ended for a line at this distance from both halves.

    lean: angle of the line and the normal of the edge's plane, about the shorter axis [rad].
    Returns (k, 2) coordinates along the longer and the shorter axis, and the tangent at the first end.
    """
    A, B = BORE * math.hypot(1, steep), BORE
    seen = A * math.cos(lean)  # along the line

    def beyond(angle):
        """By how much the line between both halves that is nearest there is farther."""
        return B / seen * math.hypot(seen * math.sin(angle), B * math.cos(angle)) - distance

    end = brentq(beyond, 0, np.pi / 2, xtol=1e-14) if seen > B and beyond(0) < 0 else 0
    angle = np.linspace(end, np.pi - end, samples)
    points = np.c_[A * np.cos(angle), half * B * np.sin(angle)]
    tangent = np.array([A * np.sin(angle[0]), -half * B * np.cos(angle[0])])
    return points, tangent / np.linalg.norm(tangent)


def distance_in_plane(x, points, tangent):
    """Distance of x (2,) from the line through these points, which goes on straight from both ends."""
    ways = np.diff(points, axis=0)
    along = np.clip(((x - points[:-1]) * ways).sum(1) / (ways**2).sum(1), 0, 1)
    least = np.linalg.norm(points[:-1] + along[:, None] * ways - x, axis=1).min()
    for end, way in ((points[0], tangent), (points[-1], tangent * [-1, 1])):
        beyond = max(0.0, (x - end) @ way)
        least = min(least, np.linalg.norm(x - end - beyond * way))
    return least


def distance_from_half(x, height, steep, half, distance, lean):
    """That of the core, of a point in the same coordinates at a height over the plane [m]."""
    stretch = math.hypot(1, steep)
    longer, normal = np.array([1, 0, steep]) / stretch, np.array([-steep, 0, 1]) / stretch
    place = x[0] * longer + x[1] * np.array([0, 1, 0]) + height * normal
    along, slope = math.sin(lean) * longer + math.cos(lean) * normal, np.array([steep, 0, 0])
    return _core.testing.distance_from_half(
        place, np.zeros(3), np.array([0, 0, 1.0]), BORE, slope, half, distance, along
    )


@RANDOM
@given(seed=st.integers(0, 2**32 - 1), steep=st.floats(0.2, 2.0), half=st.sampled_from([1, -1]))
def test_a_half_goes_on_straight_where_a_tendon_cannot_follow_it(seed, steep, half):
    """Around the narrow end, up to the distance for which it is ended; against a search."""
    random = np.random.default_rng(seed)
    distance, lean = BORE * random.uniform(0.3, 0.95), random.uniform(-0.8, 0.8)
    points, tangent = ended_half(steep, distance, lean, half)
    A = BORE * math.hypot(1, steep)
    tried = 0
    for x in random.uniform([0.3 * A, -0.7 * BORE], [1.2 * A, 0.7 * BORE], (200, 2)):
        height = distance * math.sin(lean) * random.uniform(0.9, 1.1)
        least = math.hypot(distance_in_plane(x, points, tangent), height)
        if least > distance:
            continue
        tried += 1
        found = distance_from_half(x, height, steep, half, distance, lean)
        assert found == pytest.approx(least, abs=1e-6 * BORE)
    assert tried > 10


@RANDOM
@given(seed=st.integers(0, 2**32 - 1), steep=st.floats(0.2, 1.5), half=st.sampled_from([1, -1]))
def test_a_tip_between_both_halves_is_as_far_from_each_as_its_points_are(seed, steep, half):
    """Of a tendon along the bore, whose halves are whole: the tip may be beyond the longer one."""
    random = np.random.default_rng(seed)
    points, tangent = ended_half(steep, 0.95 * BORE, -math.atan(steep), half)
    A = BORE * math.hypot(1, steep)
    for x in random.uniform([A - BORE, -0.05 * BORE], [A, 0.05 * BORE], (50, 2)) * random.choice([-1, 1]):
        height = random.uniform(0, 0.5 * BORE)
        least = math.hypot(distance_in_plane(x, points, tangent), height)
        if least < 0.05 * BORE:  # the search is not accurate there
            continue
        found = distance_from_half(x, height, steep, half, 0.95 * BORE, -math.atan(steep))
        assert found == pytest.approx(least, abs=1e-6 * BORE)


NEARLY_AS_FAR = [  # parameter; ends of a segment from the centre of the mouth, and its bend at the end [um]
    (0.8075, (-3832.49, 98.5499, -3971.60), (-883.164, -5.1736, -352.220), (-1430.360, -441.517, 793.627)),
    (0.7460, (-3620.37, 110.2745, -3809.82), (-767.391, -28.5770, -115.635), (-1322.540, -397.683, 692.187)),
    (0.7510, (-3634.33, 109.5306, -3820.75), (-774.864, -26.9628, -131.464), (-1331.610, -401.126, 700.530)),
]


@pytest.mark.parametrize("aside", [-0.02, -0.001, 0.001, 0.02])
@pytest.mark.parametrize(("nearest", "start", "end", "bend"), NEARLY_AS_FAR)
def test_the_nearest_point_of_a_segment_is_found_where_all_of_it_is_nearly_as_far(
    nearest, start, end, bend, aside
):
    """A graft bent around the narrow end of a mouth: distances differ by 40 nm in a tenth of a segment.

    The second derivative of half the squared distance is 0.003 to 0.009 of the length squared.
    """
    start, end, bend = 1e-6 * np.array([start, end, bend])
    axis, slope = (0.692537038, 0.0, 0.721382319), (0.692537092, 0.0, -0.664845220)
    edge = (0, 0, 0), axis, 0.002333, slope

    def distance(u):
        x = start + u * (end - start) + 0.5 * (u - 0.5) ** 2 * bend
        return _core.testing.distance_from_half(x, *edge, -1, 0.002, axis)

    found = _core.testing.slid_to_rim(nearest + aside, start, end, [(0, 0, 0), bend], *edge, -1)
    bounds = found - 0.002, found + 0.002
    least = minimize_scalar(distance, bounds=bounds, method="bounded", options={"xatol": 1e-9})
    assert found == pytest.approx(least.x, abs=1e-5)


@pytest.mark.parametrize("wider", [0.9, 1.0, 1.001, 1.02, 1.2, 1.4])
def test_what_holds_a_centreline_in_a_narrow_end_bends_no_more_sharply_than_it_is_rounded(wider):
    """Of thinner and wider tendons: the distance from a half has a bounded second derivative."""
    steep, rounded = 1.0, 0.02
    A = BORE * math.hypot(1, steep)
    kept = wider * BORE**2 / A
    distance = (1 + rounded) * kept
    for x in np.linspace(A - 1.5 * kept, A - 0.5 * kept, 41):
        y = np.linspace(-0.5, 0.5, 1001) * BORE
        held = np.array([distance_from_half((x, v), 0, steep, 1, distance, 0) for v in y])
        bend = np.abs(np.diff(held, 2)) / (y[1] - y[0]) ** 2
        assert bend[held[1:-1] <= kept].max(initial=0) <= 1.05 / (rounded * kept)


def off_axis(points, way):
    return np.linalg.norm(points - np.outer(points @ way, way), axis=1)


def distance_to_bone(points, tilt):
    """Signed distance of points (k, 3) from the drilled box near its upper face."""
    way, top = slanted(tilt)[2], 0.5 * SIZE[2]
    angles = np.linspace(0, 2 * np.pi, 721)[:-1]
    out = np.outer(np.cos(angles), np.cross([0, 1, 0], way)) + np.outer(np.sin(angles), [0, 1, 0])
    edge = BORE * out + np.outer(top / math.cos(tilt) + BORE * out @ slope_of(tilt, way), way)
    wall = np.concatenate([edge - down * way for down in np.arange(0, 0.02, 1e-4)])
    near = np.array([np.linalg.norm(wall - x, axis=1).min() for x in points])
    foot = points * [1, 1, 0] + [0, 0, top]
    face = np.where(off_axis(foot, way) > BORE, np.abs(points[:, 2] - top), np.inf)
    inside = (points[:, 2] < top) & (off_axis(points, way) > BORE)
    return np.where(inside, -1, 1) * np.minimum(face, near)


@pytest.mark.parametrize("sideways", [(1, 0), (-1, 0), (0, 1), (0.7, -0.7)], ids=str)
@pytest.mark.parametrize("chamfer", [0.0, 0.0008])
def test_a_graft_led_over_an_oblique_mouth_stays_out_of_the_bone(make_world, client, sideways, chamfer):
    """Its end is led out and aside: the mouth's edge and the wall up to it hold the centreline off."""
    tilt, radius = 0.8, 0.002
    start, end, way = slanted(tilt, 0.002)
    world = make_world(1 / 240, (0, 0, 0))
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=np.array(SIZE) / 2, physicsClientId=client)
    body = p.createMultiBody(0, shape, physicsClientId=client)
    world.add_tunnel(body, -1, start, end, BORE, 0.0, chamfer)
    world.add_obstacle(body)
    material = bt.Material(stiffness=2e4, damping=20.0, friction=0.0)
    graft = world.add_tendon([start - 0.03 * way, end + 0.04 * way], radius, material, 60)
    graft.set_force(0, -20.0 * way)
    hand = graft.grip(-1, stiffness=2e3, damping=2.0)
    goal = hand.target + 0.025 * np.array([*sideways, 0.2])
    first = hand.target
    for k in range(240):
        s = min(1.0, (k + 1) / 160)
        hand.target = first + s * s * (3 - 2 * s) * (goal - first)
        world.step()
    assert world.report.converged
    line = subdivided(graft.positions, 7)
    near = line[line[:, 2] > 0.01]
    rounded = chamfer * (1 / math.sin(math.pi / 4 - tilt / 2) - 1)  # from a sharp edge to the round one in it
    assert distance_to_bone(near, tilt).min() >= 0.93 * radius - rounded
    assert graft.tension[0] == pytest.approx(20.0, rel=1e-3)
    # Smooth: the tension is the same on both sides of the edge, but for the angle of a chord there.
    assert graft.tension[-1] == pytest.approx(20.0, rel=0.1)


def test_mouths_follow_the_obstacle(make_world, client):
    """Whichever is added first; taken away, the surface is no mouth any more."""
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=np.array(SIZE) / 2, physicsClientId=client)
    start, end, way = slanted(0.8, 0.002)
    at = (end + 2.5 * BORE * way)[None]
    for tunnel_first in (False, True):
        world = make_world(1 / 240, (0, 0, 0))
        body = p.createMultiBody(0, shape, physicsClientId=client)
        if not tunnel_first:
            world.add_obstacle(body)
        tunnel = world.add_tunnel(body, -1, start, end, BORE)
        if tunnel_first:
            world.add_obstacle(body)
        assert tunnel._drills(at).all()
        world.remove_obstacle(body)
        assert not tunnel._drills(at).any()
