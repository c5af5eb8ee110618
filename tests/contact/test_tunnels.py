"""Tunnels: the bore's wall, its mouths, what is not felt inside it, and what is refused."""

import math

import numpy as np
import pybullet as p
import pytest
from brute_force import signed_distance, subdivided
from link_scenes import cube, mesh_obstacle

import bullet_tendon as bt

BORE, RADIUS, HALF, G = 0.006, 0.004, 0.05, 9.81
ROPE = bt.Material(stiffness=3e3, damping=3.0, friction=1.0)


def bone(client, position=(0, 0, 0), turn=(0, 0, 0, 1), mass=0.0):
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[HALF] * 3, physicsClientId=client)
    return p.createMultiBody(mass, shape, -1, position, turn, physicsClientId=client)


@pytest.fixture
def drilled(make_world, client):
    """drilled(friction, **options): a world with a bone, an obstacle, bored through along x; the tunnel."""

    def make(friction=0.0, gravity=(0, 0, 0), chamfer=0.0, dt=1 / 240, **options):
        world = make_world(dt, gravity, **options)
        body = bone(client)
        world.add_obstacle(body)
        tunnel = world.add_tunnel(body, -1, [-HALF, 0, 0], [HALF, 0, 0], BORE, friction, chamfer)
        return world, body, tunnel

    return make


def along_x(world, start, end, n, radius=RADIUS):
    return world.add_tendon([[start, 0, 0], [end, 0, 0]], radius, ROPE, n)


def off_axis(t):
    return np.hypot(t.positions[:, 1], t.positions[:, 2])


PAPER = {"iteration": "single", "contact_threshold": 5e-4}


@pytest.mark.parametrize(
    ("push", "options"),
    [(1.0, {}), (1.0, {"integrator": "bdf2"}), (1e-3, PAPER), (1e-3, {**PAPER, "contact_stiffness": 50.0})],
    ids=str,
)
def test_particles_stay_in_the_bore(drilled, push, options):
    """Pushed sideways, by much more than their weight or as much: within R - r, and the wall pushes back."""
    world, body, _ = drilled(**options)
    t = along_x(world, -0.04, 0.04, 21)
    for i in range(21):
        t.set_force(i, [0, push, push / 2])
    for _ in range(300):
        world.step()
        assert off_axis(t).max() <= BORE - RADIUS + 0.02 * RADIUS
    contacts = world.contacts
    assert set(contacts["kind"]) == {"bore"}
    assert contacts["normal_force"].sum() == pytest.approx(21 * push * math.hypot(1, 0.5), rel=1e-6)
    depth = push * math.hypot(1, 0.5) / options.get("contact_stiffness", math.inf)
    expected = BORE - RADIUS - options.get("contact_threshold", 0) + depth
    np.testing.assert_allclose(off_axis(t), expected, atol=1e-6)
    np.testing.assert_allclose(world.wrench(body)[:3], [0, 21 * push, 10.5 * push], atol=1e-5 * push)


def test_bone_around_the_bore_is_not_there(drilled):
    """A tendon along the axis of a straight tunnel touches nothing, and no distance is asked for."""
    world, body, _ = drilled()
    t = along_x(world, -0.15, 0.15, 61)
    start = t.positions
    world.step(60)
    np.testing.assert_allclose(t.positions, start, atol=1e-12)
    assert world.report.counts["pairs_queried"] == 0
    assert not world.contacts["normal_force"].any()
    assert not world.wrench(body).any()


def test_a_filled_tunnel_is_bone_again(drilled):
    world, body, tunnel = drilled()
    t = along_x(world, -0.15, 0.15, 61)
    start = t.positions
    world.step()
    world.remove_tunnel(tunnel)
    assert world.tunnels == ()
    with pytest.raises(bt.UnknownId):
        world.remove_tunnel(tunnel)
    world.step(3)
    assert np.abs(start).max(1).min() == 0
    assert np.abs(t.positions).max(1).min() > 0.8 * HALF  # pressed out to the surface, or beyond it


@pytest.mark.parametrize("sideways", [0.0, 0.3])
def test_pulling_through_without_friction_costs_no_force(drilled, sideways):
    """At constant speed, pressed against the wall or not, nothing holds the tendon back."""
    world, _, _ = drilled(tolerance=1e-10)
    t, speed = along_x(world, -0.03, 0.03, 31), 0.02
    for i in range(31):
        t.set_force(i, [0, sideways, 0])
    world.step(200)
    grip = t.grip(-1)
    t.set_positions(t.positions, np.tile([speed, 0, 0], (31, 1)))
    for _ in range(100):
        grip.target = grip.target + [speed / 240, 0, 0]
        world.step()
    assert t.positions[-1, 0] > 0.035
    assert abs(grip.force[0]) <= 1e-6
    if sideways:
        assert world.contacts["normal_force"].sum() == pytest.approx(30 * sideways, rel=1e-5)


def test_friction_in_a_straight_bore_is_coulombs(drilled):
    """mu N at constant speed, the same on the bone."""
    mu, push, n = 0.25, 0.2, 31
    world, body, _ = drilled(friction=mu, tolerance=1e-10)
    t, speed = along_x(world, -0.03, 0.02, n), 0.02
    for i in range(n):
        t.set_force(i, [0, 0, -push])
    world.step(200)
    grip = t.grip(-1)
    for _ in range(300):
        grip.target = grip.target + [speed / 240, 0, 0]
        world.step()
    contacts = world.contacts
    resistance = mu * contacts["normal_force"].sum()
    free = contacts["position"][:, 0] < t.positions[-1, 0] - 1e-6  # the grip can carry its own particle
    assert contacts["normal_force"][free].sum() == pytest.approx(push * (n - 1), rel=1e-3)
    assert world.wrench(body)[0] == pytest.approx(resistance, rel=1e-3)
    assert -grip.force[0] == pytest.approx(resistance, rel=1e-3)


def distance_to_circle(t, x, radius):
    """Least distance of the centreline, finely sampled, to a circle about the x axis."""
    fine = np.linspace(0, t.particles - 1, 50 * (t.particles - 1) + 1)
    line = np.column_stack([np.interp(fine, np.arange(t.particles), c) for c in t.positions.T])
    return np.hypot(line[:, 0] - x, np.hypot(line[:, 1], line[:, 2]) - radius).min()


@pytest.mark.parametrize(
    ("n", "pull", "steps"),
    [(41, (0, 1e-4, 0), 150), (161, (-1e-4, 3e-4, 0), 300), (41, (-1e-4, 3e-4, 0), 300)],
    ids=["gentle", "hard and fine", "hard and coarse"],
)
def test_a_mouths_edge_keeps_the_tendon_off(drilled, n, pull, steps):
    """Pulled sideways over a mouth, its centreline stays a radius away from the mouth's circle."""
    radius = 0.003
    world, _, _ = drilled()
    t = along_x(world, -0.04, 0.12, n, radius)
    t.grip(0)
    grip, least = t.grip(-1), math.inf
    for k in range(steps):
        grip.target = grip.target + pull
        world.step()
        if k > steps // 2:
            least = min(least, distance_to_circle(t, HALF, BORE))
    assert least >= 0.98 * radius
    assert least < 1.1 * radius  # it does touch
    assert "mouth" in world.contacts["kind"]
    assert t.tension.max() > 10


def test_a_chamfer_moves_the_edge_back(drilled):
    """The rounded edge: a torus about a circle, within the bone and farther out by the chamfer's radius."""
    radius, chamfer = 0.003, 0.002
    world, _, _ = drilled(chamfer=chamfer)
    t = along_x(world, -0.04, 0.12, 81, radius)
    t.grip(0)
    grip = t.grip(-1)
    for _ in range(150):
        grip.target = grip.target + [0, 1e-4, 0]
        world.step()
    least = distance_to_circle(t, HALF - chamfer, BORE + chamfer)
    assert least == pytest.approx(radius + chamfer, rel=0.02)


def pulled_out(world, degrees, start, reach, particles, way):
    """Forces of a hand [N] that pulls a tendon without friction out of the bore at an angle, against 20 N."""
    out = np.array([math.cos(math.radians(degrees)), 0, math.sin(math.radians(degrees))])
    end = np.array([HALF, 0, 0]) + reach * out
    t = world.add_tendon([[start, 0, 0], [HALF, 0, 0], end], 0.003, ROPE, particles)
    t.friction = 0.0
    t.set_force(0, [-20.0, 0, 0])
    hand, felt = t.grip(-1), []
    for k in range(240):
        hand.target = end + (k / 240 * way) * out
        world.step()
        if k >= 60:
            felt.append(abs(np.array(hand.force) @ out))
    return np.array(felt)


def test_a_tendon_slides_over_a_chamfer(drilled):
    """The face of the bone ends where its rounded edge begins."""
    world, _, _ = drilled(chamfer=0.005)
    assert pulled_out(world, 45, -0.1, 0.06, 161, 0.01) == pytest.approx(20.0, rel=0.02)


@pytest.mark.parametrize(("degrees", "error"), [(30, 0.03), (45, 0.07), (60, 0.13)])
def test_a_coarse_tendon_bends_at_a_mouth(drilled, degrees, error):
    """Its segments are longer than its radius, and still the hand feels the pull, wherever the particles are.

    If chords touched the edge, the force would be off by 1/cos - 1 where one of them ends: 15, 41 and 100 %.
    """
    world, _, _ = drilled()
    felt = pulled_out(world, degrees, -0.17, 0.12, 35, 0.02)
    assert felt == pytest.approx(20.0, rel=error)
    assert felt.mean() == pytest.approx(20.0, rel=0.03)


@pytest.mark.parametrize("particles", [9, 11, 15, 24])
@pytest.mark.parametrize("longer", [0.7, 1.4])
def test_a_coarse_tendon_lies_around_the_corner_beside_a_mouth(make_world, client, particles, longer):
    """Segments from before the mouth to beside the box touch its corner, where nothing is drilled away."""
    world, half, bore = make_world(1 / 240), 3 * RADIUS, 1.5 * RADIUS
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[half] * 3, physicsClientId=client)
    box = p.createMultiBody(0, shape, physicsClientId=client)
    world.add_obstacle(box, friction=0.1)
    world.add_tunnel(box, -1, (-half, 0, 0), (half, 0, 0), bore, friction=0.1)
    beside = -half - 1.5 * RADIUS
    line = [((8 + longer) * RADIUS, 0, 0), (beside, 0, 0), (beside, 0, beside), (4 * half, 0, beside)]
    material = bt.Material(stiffness=2e4, damping=2.0, friction=1.0)
    t = world.add_tendon(line, RADIUS, material, particles)
    t.grip(0)
    t.grip(-1, target=(6 * half, 0, beside), stiffness=300.0, damping=0.5)
    for _ in range(240):
        world.step()
        assert world.report.converged
    x = subdivided(t.positions, 30)
    x = x[np.hypot(x[:, 1], x[:, 2]) > 1.05 * bore]
    assert signed_distance("box", [2 * half] * 3, x).min() > 0.95 * RADIUS


def test_several_tunnels(make_world, client):
    """One tendon through two bones, one of them turned and shifted: each holds its own stretch."""
    world = make_world(1 / 240)
    turn = p.getQuaternionFromEuler([0, 0, 0.5])
    axes = np.array(p.getMatrixFromQuaternion(turn)).reshape(3, 3)
    place = np.array([0.2, 0.05, 0.02])
    bodies = [bone(client), bone(client, place, turn)]
    for body in bodies:
        world.add_obstacle(body)
        world.add_tunnel(body, -1, [-HALF, 0, 0], [HALF, 0, 0], BORE, 0.0)
    ends = [[-HALF, 0, 0], [HALF, 0, 0], place - axes @ [HALF, 0, 0], place + axes @ [HALF, 0, 0]]
    t = world.add_tendon(ends, RADIUS, ROPE, 81)
    t.grip(0), t.grip(-1)
    t.set_force(40, [0, 0, 5.0])
    t.set_force(60, [0, 0, -5.0])
    world.step(500)
    x = t.positions
    for centre, rotation in ((np.zeros(3), np.eye(3)), (place, axes)):
        local = (x - centre) @ rotation
        inside = np.abs(local[:, 0]) < HALF - 1e-3
        assert inside.sum() > 10
        assert np.hypot(local[inside, 1], local[inside, 2]).max() <= BORE - RADIUS + 0.02 * RADIUS
    felt = {row["bodyUniqueId"] for row in world.contacts if row["normal_force"] > 0}
    assert felt == set(bodies)


def test_a_tunnel_moves_with_its_body(drilled, client):
    world, body, _ = drilled()
    t = along_x(world, -0.04, 0.04, 21)
    for k in range(1, 201):
        p.resetBasePositionAndOrientation(body, [0, 0, 1e-4 * k], [0, 0, 0, 1], physicsClientId=client)
        world.step()
        assert np.abs(t.positions[:, 2] - 1e-4 * k).max() <= 2e-3 + 1.2e-4
    world.step(200)
    assert np.hypot(t.positions[:, 1], t.positions[:, 2] - 0.02).max() <= BORE - RADIUS + 0.02 * RADIUS


GOOD = {"bodyUniqueId": 0, "linkIndex": -1, "start": [0, 0, 0], "end": [0, 0, 0.03], "radius": 0.004}


@pytest.mark.parametrize(
    ("argument", "value", "error"),
    [
        ("bodyUniqueId", 9, bt.UnknownId),
        ("linkIndex", 0, bt.UnknownId),
        ("start", [0, 0], bt.InvalidValue),
        ("start", [0, 0, math.nan], bt.InvalidValue),
        ("end", [0, 0, 0], bt.InvalidValue),
        ("end", "far", bt.InvalidType),
        ("radius", 0.0, bt.InvalidValue),
        ("radius", None, bt.InvalidType),
        ("friction", -1, bt.InvalidValue),
        ("chamfer", -1e-3, bt.InvalidValue),
        ("chamfer", "round", bt.InvalidType),
        ("name", "", bt.InvalidValue),
    ],
)
def test_refused_tunnels_change_nothing(make_world, client, argument, value, error):
    bone(client)
    world = make_world()
    with pytest.raises(error) as caught:
        world.add_tunnel(**{**GOOD, argument: value})
    assert caught.value.argument == argument
    assert world.tunnels == ()
    tunnel = world.add_tunnel(**GOOD, name="femoral")
    assert world.tunnels == (tunnel,)
    assert (tunnel.name, tunnel.radius, tunnel.friction, tunnel.chamfer) == ("femoral", 0.004, 0.5, 0.0)
    with pytest.raises(bt.InvalidType):
        world.remove_tunnel("femoral")


def test_tunnels_far_away_cost_a_box_test(make_world, client):
    """Of many tunnels, only the one that the tendon is in makes contacts: the same as without the others."""

    def run(others):
        world = make_world(1 / 240, (0, 0, -9.81), sleep=False)
        block = p.createMultiBody(0, physicsClientId=client)
        world.add_tunnel(block, -1, (-0.02, 0, 0), (0.02, 0, 0), radius=0.006)
        for k in range(others):
            y = 0.1 * (k + 1)
            world.add_tunnel(block, -1, (-0.02, y, 0), (0.02, y, 0), radius=0.006)
        t = world.add_tendon(
            [[-0.05, 0, 0], [0.05, 0, 0]], 0.002, bt.Material(stiffness=1e3, damping=1.0), 21
        )
        t.grip(0)
        t.set_force(-1, (0.5, 0, -0.5))
        world.step(30)
        assert len(world.contacts) > 0
        return t.positions, world.report.counts

    alone, one = run(0)
    among, many = run(40)
    np.testing.assert_array_equal(alone, among)
    assert (one["tunnels_considered"], one["tunnels_culled"]) == (1, 0)
    assert many["tunnels_culled"] == 40 * many["tunnels_considered"] / 41


def test_a_tunnel_on_a_fast_body_is_not_culled(make_world, client):
    """Its box is far from the tendon as the step begins, and over it as the step ends."""
    world = make_world(1 / 240, sleep=False)
    shape = p.createCollisionShape(p.GEOM_SPHERE, radius=1e-3, physicsClientId=client)
    ring = p.createMultiBody(1.0, shape, basePosition=[0.1, 0, 0], physicsClientId=client)
    p.changeDynamics(ring, -1, linearDamping=0, angularDamping=0, physicsClientId=client)
    world.add_tunnel(ring, -1, (-0.005, 0, 0), (0.005, 0, 0), radius=0.006)
    t = world.add_tendon([[-0.05, 0, 0.003], [0, 0, 0.003]], 0.002, bt.Material(stiffness=1e3), 21)
    world.step()
    assert world.report.counts["tunnels_culled"] == world.report.counts["tunnels_considered"] > 0
    p.resetBaseVelocity(ring, [-30.0, 0, 0], physicsClientId=client)
    world.step()
    counts = world.report.counts
    assert counts["tunnels_culled"] < counts["tunnels_considered"]
    assert t.particles == 21


@pytest.mark.parametrize("spin", [10.0, -10.0])
def test_a_tunnel_on_a_spinning_body_is_not_culled(make_world, client, spin):
    """The body spins about the middle of a long tendon, where it moves nothing. The mouth goes by its end."""
    world, arm, gap = make_world(1 / 240, sleep=False), 0.45, 0.015
    shape = p.createCollisionShape(p.GEOM_SPHERE, radius=1e-3, physicsClientId=client)
    body = p.createMultiBody(1.0, shape, physicsClientId=client)
    p.changeDynamics(body, -1, linearDamping=0, angularDamping=0, physicsClientId=client)
    ends = [[arm, -gap, z] for z in (-0.01, 0.01)]
    world.add_tunnel(body, -1, *np.sign(spin) * np.array(ends), radius=0.006)
    world.add_tendon([[-0.5, 0, 0], [0.5, 0, 0]], 0.002, bt.Material(stiffness=1e3), 201)
    world.step()
    assert world.report.counts["tunnels_culled"] == world.report.counts["tunnels_considered"] > 0
    p.resetBaseVelocity(body, [0, 0, 0], [0, 0, spin], client)
    world.step()
    assert arm * abs(spin) / 240 > gap  # the step takes the bore across the tendon
    counts = world.report.counts
    assert counts["tunnels_culled"] < counts["tunnels_considered"]


def test_ends_of_a_tunnel_follow_its_bone(make_world, client):
    world = make_world()
    half = math.sqrt(0.5)
    body = bone(client, (0.1, 0, 0), (0, 0, half, half))  # a quarter turn about z
    tunnel = world.add_tunnel(body, -1, [-0.05, 0.01, 0], [0.05, 0.01, 0], BORE)
    np.testing.assert_allclose(tunnel.ends, [[0.09, -0.05, 0], [0.09, 0.05, 0]], atol=1e-9)
    p.resetBasePositionAndOrientation(body, (0, 0, 1), (0, 0, 0, 1), client)
    np.testing.assert_allclose(tunnel.ends, [[-0.05, 0.01, 1], [0.05, 0.01, 1]], atol=1e-9)
    p.removeBody(body, client)
    with pytest.raises(bt.UnknownId):
        tunnel.ends  # noqa: B018


@pytest.mark.parametrize("ratio", [0.9, 1.0, 1.3])
def test_a_tendon_that_is_as_thick_as_a_bore_finds_solid_bone(drilled, ratio):
    """It is led to the mouth: it goes in, or stops on the bone's surface as if there was no bore."""
    world, _, _ = drilled()
    radius = ratio * BORE
    t = world.add_tendon([[-0.25, 0, 0], [-0.06, 0, 0]], radius, ROPE, 41)
    hand = t.grip(-1, stiffness=500.0)
    for _ in range(100):
        hand.target = hand.target + [0.05 / 240, 0, 0]
        world.step()
        assert world.report.converged
        assert world.report.iterations <= 100  # where the tendon buckles; else 10
    end = t.positions[-1, 0]
    assert end == pytest.approx(-0.06 + 100 * 0.05 / 240 if ratio < 1 else -HALF - radius, abs=1e-3)


@pytest.mark.parametrize("tilt", [0.0, 0.6])
def test_what_comes_from_the_side_is_not_in_a_bore(make_world, client, tilt):
    """An eyelet without bone around it: a strand passes through it as if it was not there."""
    world = make_world()
    world.add_tunnel(bone(client), -1, [-HALF, 0, 0], [HALF, 0, 0], BORE, 0.0)
    ends = [[-0.1 * math.sin(tilt), -0.02, -0.1], [0.1 * math.sin(tilt), -0.02, 0.1]]
    t = world.add_tendon(ends, RADIUS, ROPE, 81)
    start = t.positions
    t.set_positions(start, np.tile([0, 1.0, 0], (81, 1)))
    world.step(12)
    np.testing.assert_allclose(t.positions, start + [0, 12 / 240, 0], atol=1e-9)


def test_an_end_beside_an_eyelet_does_not_jam_what_runs_in_it(make_world, client):
    """It is led through the eyelet's side by a soft hand, and pushes the strand that is in it aside."""
    world = make_world()
    world.add_tunnel(bone(client), -1, [-HALF, 0, 0], [HALF, 0, 0], BORE, 0.0)
    inside = along_x(world, -0.2, 0.2, 81)
    inside.grip(0), inside.grip(-1)
    other = world.add_tendon([[0, 0.03, 0], [0, 0.2, 0]], RADIUS, ROPE, 41)
    hand = other.grip(0, stiffness=200.0)
    for _ in range(120):
        hand.target = hand.target - [0, 0.03 / 120, 0]
        world.step()
        assert world.report.converged
    assert off_axis(inside).max() <= BORE - RADIUS + 0.02 * RADIUS
    assert np.linalg.norm(hand.force) < 200.0 * 0.03


def test_beside_a_bore_what_is_left_of_the_bone_is_felt(make_world, client, tmp_path):
    """Also where the nearest point of its surface is drilled away, and no mouth fits the bone.

    A bore runs into the edge of a block at 45 degrees. A particle is pressed onto the border that it leaves
    in the upper face: it rests on it.
    """
    cells, size = 80, 0.02
    u, v = np.meshgrid(np.linspace(-1, 0, cells + 1), np.linspace(-0.5, 0.5, cells + 1), indexing="ij")
    upper = size * np.stack([u, v, 0 * u], axis=-1).reshape(-1, 3)
    sides = upper, upper[:, [2, 1, 0]] * (1, -1, 1)
    number = np.arange((cells + 1) ** 2).reshape(cells + 1, cells + 1)
    a, b, c, d = (n.ravel() for n in (number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]))
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    lines = [f"v {x:.6f} {y:.6f} {z:.6f}" for side in sides for x, y, z in side]
    lines += [f"f {a} {b} {c}" for k in range(2) for a, b, c in faces + 1 + k * len(upper)]
    mesh = tmp_path / "block.obj"
    mesh.write_text("\n".join(lines))
    shape = p.createCollisionShape(
        p.GEOM_MESH, fileName=str(mesh), flags=p.GEOM_FORCE_CONCAVE_TRIMESH, physicsClientId=client
    )
    block = p.createMultiBody(0, shape, physicsClientId=client)
    world = make_world(1 / 240)
    world.add_obstacle(block, friction=0.5, meshes=[str(mesh)])
    bore, radius = 0.004, 0.0025
    world.add_tunnel(block, -1, (0.003, 0, 0.003), (-0.013, 0, -0.013), bore)
    border = np.array([-bore * np.sqrt(2), 0, 0])
    out = np.array([0.3, 0, 1]) / np.hypot(0.3, 1)
    start = border + 1.1 * radius * out
    slack = bt.Material(stiffness=3e3, damping=3.0, friction=1.0, tension_only=True)
    tendon = world.add_tendon([start, start + 0.03 * out], radius, slack, 2)
    tendon.grip(1, start + 0.025 * out)
    tendon.set_force(0, -0.5 * out)
    world.step(48)
    away = tendon.positions[0] - border
    assert away[2] > 0
    assert np.linalg.norm(away) == pytest.approx(radius, rel=0.005)
    assert world.report.converged


def l_shaped(kind, world, client, wall):
    """An obstacle bored through along z, and a wall beside its upper mouth, at x = wall."""
    parts = [((0.05, 0.05, 0.02), (0, 0, -0.02)), ((0.01, 0.02, 0.009), (wall + 0.01, 0, 0.011))]
    if kind == "mesh":
        (a, faces), (b, more) = [cube(np.array(half), at) for half, at in parts]
        body = mesh_obstacle(world, client, np.vstack([a, b]), np.vstack([faces, more + len(a)]))
    else:
        shape = p.createCollisionShapeArray(
            [p.GEOM_BOX] * len(parts),
            halfExtents=[list(half) for half, _ in parts],
            collisionFramePositions=[list(at) for _, at in parts],
            physicsClientId=client,
        )
        body = p.createMultiBody(0, shape, physicsClientId=client)
        world.add_obstacle(body)
    world.add_tunnel(body, -1, (0, 0, -0.04), (0, 0, 0), 0.0045)


@pytest.mark.filterwarnings("ignore::bullet_tendon.ResolutionWarning")
@pytest.mark.parametrize("kind", ["mesh", "boxes"])
@pytest.mark.parametrize("beyond", [-5e-4, -1e-4, 5e-4])
def test_a_wall_beside_a_mouth_holds_what_it_pushes_before_the_mouth(make_world, client, kind, beyond):
    """Drawn against it, a tendon rests there, whether its centreline is beside or beyond the bore's wall."""
    world, radius, force = make_world(), 0.0035, 10.0
    l_shaped(kind, world, client, 0.0045 + beyond + radius)
    t = world.add_tendon([(0, 0, -0.03), (0, 0, 0.03)], radius, ROPE, 31, rest_length=0.063)
    t.grip(0)
    t.grip(-1)
    t.set_force(18, (force, 0, 0))
    for _ in range(2):
        world.relax()
        assert world.report.converged
        assert t.positions[18, 0] == pytest.approx(0.0045 + beyond, abs=1e-6)
    rest = t.positions
    for _ in range(20):
        world.step()
        np.testing.assert_allclose(t.positions[18], rest[18], atol=1e-6)
        pressed = world.contacts[world.contacts["kind"] == "bone"]
        assert pressed["normal_force"].sum() == pytest.approx(force, rel=1e-3)


@pytest.mark.filterwarnings("ignore::bullet_tendon.ResolutionWarning")
@pytest.mark.parametrize("kind", ["box", "mesh"])
def test_bone_beside_a_bore_does_not_press_on_what_bends_into_its_wall(make_world, client, kind):
    """A particle of a coarse tendon at a kink, whose curve lies in the bore, is itself beyond the wall.

    The bone around the wall is 1 mm thick. It would press the particle out, against the bore's contact.
    """
    world, half, aside, radius, push = make_world(1 / 1000), (0.0054, 0.003, 0.0054), 0.0032, 0.00058, 0.02
    if kind == "mesh":
        block = mesh_obstacle(world, client, *cube(np.array(half)))
    else:
        shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=half, physicsClientId=client)
        block = p.createMultiBody(0, shape, physicsClientId=client)
        world.add_obstacle(block)
    world.add_tunnel(block, -1, (-half[0], 0, aside), (half[0], 0, aside), 0.0012, friction=0.0)
    material = bt.Material(stiffness=1e4, damping=0.5, tension_only=True)
    t = world.add_tendon([(-0.012, 0, aside), (0.012, 0, aside)], radius, material, 5)
    hands = [(t.grip(1), -1), (t.grip(3), 1)]
    t.set_force(2, (0, 0, push))
    for k in range(400):
        share = min(1.0, k / 300)
        for hand, side in hands:
            hand.target = (side * (0.006 - 0.0008 * share), 0, aside - 0.0012 * share)
        world.step()
        assert world.contacts["normal_force"].max(initial=0.0) <= 1.01 * push
    assert t.positions[2, 2] - aside > 0.00121  # beyond the bore's radius
