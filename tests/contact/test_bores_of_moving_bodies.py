"""Bores and mouths of bodies that move, and what has been led out of them and is let go."""

import numpy as np
import pybullet as p
import pytest
from brute_force import segment_segments

import bullet_tendon as bt

DT, BORE, R, HALF = 1 / 240, 0.006, 0.004, 0.05
ROPE = bt.Material(stiffness=3e3, damping=3.0, friction=1.0)


def heavy(client, mass=1e4, at=(0, 0, 0)):
    """A free body without damping, so heavy that a tendon does not change its motion."""
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[HALF] * 3, physicsClientId=client)
    body = p.createMultiBody(mass, shape, -1, at, physicsClientId=client)
    p.changeDynamics(body, -1, linearDamping=0, angularDamping=0, physicsClientId=client)
    return body


def off_axis(client, body, points):
    """Distances of points from the x axis of a body, as it is now [m]."""
    origin, turn = p.getBasePositionAndOrientation(body, client)
    axes = np.array(p.getMatrixFromQuaternion(turn)).reshape(3, 3)
    return np.linalg.norm(((points - origin) @ axes)[:, 1:], axis=1)


@pytest.mark.parametrize("options", [{}, {"integrator": "bdf2"}], ids=["euler", "bdf2"])
@pytest.mark.parametrize("static", [False, True], ids=["free", "led by hand"])
def test_a_tunnel_that_moves_along_its_axis_drags_the_tendon(make_world, client, static, options):
    """mu N on the tendon and its opposite on the body, until the tendon is as fast."""
    mu, push, speed, n = 0.25, 0.02, 0.3, 9
    world = make_world(DT, sleep=False, **options)
    body = heavy(client, 0.0 if static else 1e4)
    world.add_tunnel(body, -1, [-HALF, 0, 0], [HALF, 0, 0], BORE, mu)
    t = world.add_tendon([[-0.01, 0, R - BORE], [0.01, 0, R - BORE]], R, ROPE, n)
    share = t.masses / t.masses.sum()
    for i in range(n):
        t.set_force(i, [0, 0, -push * share[i]])
    world.step(60)
    start, friction = t.positions[:, 0], mu * push
    assert np.abs(t.velocities).max() <= 1e-5
    p.resetBaseVelocity(body, [speed, 0, 0], [0, 0, 0], client)
    slips = int(speed * t.masses.sum() / (friction * DT))
    assert slips >= 8
    for k in range(1, slips + 20):
        if static:
            p.resetBasePositionAndOrientation(body, [speed * DT * (k - 1), 0, 0], [0, 0, 0, 1], client)
            p.resetBaseVelocity(body, [speed, 0, 0], [0, 0, 0], client)
        world.step()
        if k <= slips - 1:
            assert world.wrench(body)[0] == pytest.approx(-friction, rel=1e-4)
    np.testing.assert_allclose(t.velocities[:, 0], speed, rtol=1e-3)
    # While it slid, friction took it 1/2 a t^2 with v = a t: half as far as the bore went.
    behind = speed * DT * (slips + 19) - (t.positions[:, 0] - start)
    assert behind.mean() == pytest.approx(speed**2 * t.masses.sum() / (2 * friction), rel=0.1)


@pytest.mark.parametrize(("spin", "speed"), [(6.0, 0.0), (6.0, 2.0), (2.0, -2.0)])
@pytest.mark.parametrize("axis", [(0, 1, 0), (0, 0.6, 0.8)])
def test_a_tunnel_that_turns_takes_its_particles_along_within_the_step(make_world, client, spin, speed, axis):
    """At the end of a step particles are in the bore as the body has turned in it, however fast they slide.

    Within a step the axis goes along its tangent: that is off by the cube of the angle.
    """
    world, length = make_world(DT), 0.2
    body = heavy(client)
    world.add_tunnel(body, -1, [-length, 0, 0], [length, 0, 0], BORE, 0.0)
    t = world.add_tendon([[-0.04, 0, 0], [0.04, 0, 0]], R, ROPE, 17)
    if not speed:
        t.attach(8, body)
    t.set_positions(t.positions, np.tile([speed, 0, 0], (17, 1)))
    p.resetBaseVelocity(body, [0, 0, 0], (spin * np.array(axis)).tolist(), client)
    most = 0.0
    for _ in range(15):
        world.step()
        most = max(most, off_axis(client, body, t.positions).max())
        assert most <= BORE - R + length * (spin * DT) ** 3 + 2e-3 * R
    assert most >= 0.9 * (BORE - R)  # the wall pushes


def led_out(make_world, client, line, n, taken, aside):
    """The world and a tendon of which rigid grips took particles out of a bore, sideways through its wall.

    They are let go; particles that are not taken, at the ends, are held for good.
    """
    world = make_world(DT)
    body = heavy(client, 0.0)
    world.add_tunnel(body, -1, [-HALF, 0, 0], [HALF, 0, 0], BORE, 0.0)
    t = world.add_tendon(line, R, ROPE, n)
    world.step()
    hands = [t.grip(i) for i in taken]
    for i, pull in ((0, -0.002), (n - 1, 0.002)):
        if i not in taken:
            t.grip(i, target=t.positions[i] + [pull, 0, 0])
    for _ in range(10):
        for hand in hands:
            hand.target = hand.target + np.array(aside) / 10
        world.step()
    world.step()  # with the hands still: at rest
    for hand in hands:
        hand.release()
    return world, t


@pytest.mark.parametrize("aside", [(0, 1.6 * BORE, 0), (0, -1.2 * BORE, 1.2 * BORE)])
def test_what_was_forced_through_the_wall_of_a_bore_comes_back(make_world, client, aside):
    """A particle stays of the bore that it was in until it leaves by a mouth."""
    line = [[-0.012, 0, 0], [0.012, 0, 0]]
    world, t = led_out(make_world, client, line, 7, range(7), aside)
    assert np.hypot(*t.positions.T[1:]).min() > 1.1 * BORE
    world.step(60)
    assert np.hypot(*t.positions.T[1:]).max() <= BORE - R + 1e-3 * R


@pytest.mark.parametrize("mouth", [-1, 1])
@pytest.mark.parametrize("shift", [-0.003, 0.0, 0.004])
def test_a_segment_that_was_forced_beyond_a_mouths_edge_comes_back(make_world, client, mouth, shift):
    """A taut tendon whose middle is let go outside a mouth's circle passes through the mouth again."""
    line = np.array([[-0.04, 0, 0], [0.04, 0, 0]]) + [mouth * (HALF + shift), 0, 0]
    world, t = led_out(make_world, client, line, 9, [3, 4, 5], (0, 1.5 * BORE, 0))
    world.step(100)
    assert np.hypot(*t.positions.T[1:]).max() <= BORE - R + 0.02 * R


def test_a_body_hung_by_its_tunnel_takes_few_iterations(make_world, client):
    """The tendon slides over both mouths while the body falls into it: their points slide with the body."""
    world = make_world(DT, (0, 0, -9.81))
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.02] * 3, physicsClientId=client)
    body = p.createMultiBody(0.3, shape, physicsClientId=client)
    p.changeDynamics(body, -1, linearDamping=0, angularDamping=0, physicsClientId=client)
    world.add_tunnel(body, -1, [-0.02, 0, 0], [0.02, 0, 0], 0.004, 0.1)
    line = [[-0.08, 0, 0.06], [-0.02, 0, 0], [0.02, 0, 0], [0.08, 0.01, 0.06]]
    t = world.add_tendon(line, 0.002, bt.Material(stiffness=3e4, damping=100.0), 30)
    t.grip(0), t.grip(-1)
    iterations = []
    for _ in range(60):
        world.step()
        assert world.report.converged
        iterations.append(world.report.iterations)
    assert "mouth" in set(world.contacts["kind"])
    assert np.mean(iterations) <= 9


@pytest.mark.parametrize("options", [{}, {"integrator": "bdf2"}], ids=["euler", "bdf2"])
def test_a_body_that_hangs_on_an_end_fixed_in_its_bore_is_foreseen_at_rest(make_world, client, options):
    """The end is aimed at where the body would fall to. What is beside it is not."""
    mass = 0.1
    world = make_world(DT, (0, 0, -9.81), sleep=False, **options)
    body = heavy(client, mass)
    for z in (-0.03, 0.02):
        world.add_tunnel(body, -1, [0, 0, z], [0, 0, z + 0.006], 0.002)
    t = world.add_tendon([[0, 0, 0.2], [0, 0, -0.025]], 0.001, bt.Material(stiffness=5e3, damping=2.0), 60)
    t.grip(0)
    t.attach(-1, body, -1, [0, 0, -0.025])
    world.step(120)
    for _ in range(20):
        world.step()
        assert world.report.reasons == {}
    assert t.tension[-1] == pytest.approx(9.81 * (mass + t.masses[-1]), rel=1e-6)


@pytest.mark.parametrize("kind", ["box", "sphere"])
def test_a_bead_within_one_segment_stays_on_its_cord(make_world, client, kind):
    """Both ends of the segment are far outside the bore: bone around it is not in its way."""
    world, g, size, mass = make_world(1 / 240, (0, 0, -9.81)), 9.81, 0.008, 0.002
    if kind == "box":
        shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[size / 2] * 3, physicsClientId=client)
    else:
        shape = p.createCollisionShape(p.GEOM_SPHERE, radius=size / 2, physicsClientId=client)
    bead = p.createMultiBody(mass, shape, -1, (0.015, 0, 0), physicsClientId=client)
    world.add_obstacle(bead)
    world.add_tunnel(bead, -1, (-size / 2, 0, 0), (size / 2, 0, 0), 0.0025, friction=0.0)
    cord = bt.Material(stiffness=100.0, damping=0.1, density=1000.0)
    t = world.add_tendon([(-0.3, 0, 0), (0.3, 0, 0)], 0.001, cord, 21)  # segments of 30 mm
    hands = t.grip(0), t.grip(-1)
    forces = []
    for _ in range(480):
        world.step()
        assert world.report.converged
        assert world.contacts["normal_force"].max(initial=0.0) < 50 * mass * g
        forces.append(-sum(hand.force[2] for hand in hands))
    assert np.mean(forces[240:]) == pytest.approx((mass + t.masses.sum()) * g, rel=0.05)
    at = np.array(p.getBasePositionAndOrientation(bead, client)[0])
    assert segment_segments(at, at, t.positions[:-1], t.positions[1:]).min() < 0.0025


def held_on_a_cord(make_world, client, half, bore, reach, radius, particles):
    """A bead that does not yield, of these half edges, on the middle of a cord; its tunnel and the cord."""
    world = make_world(1 / 240)
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=half, physicsClientId=client)
    bead = p.createMultiBody(0, shape, physicsClientId=client)
    world.add_obstacle(bead)
    tunnel = world.add_tunnel(bead, -1, (-half[0], 0, 0), (half[0], 0, 0), bore)
    cord = bt.Material(stiffness=100.0, damping=1.0, density=1100.0)
    line = [(-reach, 0, 0), (reach, 0, 0)]
    t = world.add_tendon(line, radius, cord, particles, rest_length=1.98 * reach)
    t.grip(0), t.grip(-1)
    world.step(5)
    return world, tunnel, t


def on_one_segment(make_world, client):
    """A bead 2 mm long on the middle segment of a cord, which is 11 mm long."""
    return held_on_a_cord(make_world, client, (1e-3, 4e-3, 4e-3), 1e-3, 0.05, 5e-4, 10)


def tilt_bead(world, tunnel, client, angle):
    turn = p.getQuaternionFromEuler((0, angle, 0))
    p.resetBasePositionAndOrientation(tunnel.bodyUniqueId, (0, 0, 0), turn, physicsClientId=client)
    for _ in range(240):
        world.step()


def off_centres(tunnel, t):
    """Distances from the centres of both mouths at which the cord passes through their planes [m]."""
    axis, found = tunnel.ends[1] - tunnel.ends[0], []
    for mouth in tunnel.ends:
        height = (t.positions - mouth) @ axis
        k = np.flatnonzero(height[:-1] * height[1:] < 0)[0]
        share = height[k] / (height[k] - height[k + 1])
        found.append(np.linalg.norm((1 - share) * t.positions[k] + share * t.positions[k + 1] - mouth))
    return found


@pytest.mark.parametrize("angle", [0.5, 0.9, 1.2])
def test_a_bead_that_tilts_out_of_its_segment_is_drawn_back(make_world, client, angle):
    """In a bore that is shorter than a segment, no particle tells on which side of its wall the cord is."""
    world, tunnel, t = on_one_segment(make_world, client)
    tilt_bead(world, tunnel, client, angle)
    assert world.report.converged
    assert off_centres(tunnel, t) == pytest.approx([tunnel.radius - t.radius] * 2, rel=0.2)


def test_a_snapshot_holds_which_segments_run_through_bores(make_world, client):
    """A bead that tilts out of its segment right after a snapshot was loaded is drawn back, as without it."""
    world, tunnel, t = on_one_segment(make_world, client)
    saved, ends = world.snapshot(), []
    for _ in range(2):
        tilt_bead(world, tunnel, client, 0.9)
        assert off_centres(tunnel, t) == pytest.approx([tunnel.radius - t.radius] * 2, rel=0.2)
        ends.append(t.positions.copy())
        world.load_snapshot(saved)
    assert np.array_equal(*ends)


@pytest.mark.parametrize("angle", [0.7, 1.0, 1.3])
def test_what_a_bead_turned_out_of_its_wall_is_drawn_back(make_world, client, angle):
    """A particle that the turn leaves beside the bead, next to one in its bore, passed no mouth."""
    half = (3e-3, 2.6e-3, 2.6e-3)
    world, tunnel, t = held_on_a_cord(make_world, client, half, 1.9e-3, 0.0228, 1e-3, 20)
    tilt_bead(world, tunnel, client, angle)
    assert world.report.converged
    assert off_centres(tunnel, t) == pytest.approx([tunnel.radius - t.radius] * 2, rel=0.4)


@pytest.mark.parametrize("torque", [3e-4, 1e-3])
def test_a_bead_that_tilts_against_its_mouths_takes_few_solutions(make_world, client, torque):
    """The edges of mouths turn with their body: force and gap have one Jacobian."""
    world, half = make_world(1 / 240), 0.01
    material = bt.Material(stiffness=2e4)
    t = world.add_tendon([(-0.1, 0, 0), (0.1, 0, 0)], 0.002, material, 41, rest_length=0.199)
    t.grip(0), t.grip(-1)
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[half] * 3, physicsClientId=client)
    bead = p.createMultiBody(0.01, shape, physicsClientId=client)
    p.changeDynamics(bead, -1, linearDamping=0, angularDamping=0, physicsClientId=client)
    tunnel = world.add_tunnel(bead, -1, (-half, 0, 0), (half, 0, 0), 0.003, friction=0.0)
    solutions = []
    for _ in range(40):
        p.applyExternalTorque(bead, -1, (0, torque, 0), p.WORLD_FRAME, physicsClientId=client)
        world.step()
        assert world.report.converged
        solutions.append(world.report.counts["linear_solves"])
    assert sum(solutions) < 80 and max(solutions[-20:]) <= 2
    assert off_centres(tunnel, t) == pytest.approx([tunnel.radius - t.radius] * 2, rel=0.1)
