"""Cords along round shapes, nearly parallel to their axes: no point of a segment is the nearest one."""

import numpy as np
import pybullet as p
import pytest
from link_scenes import links_on_joints

import bullet_tendon as bt

AXLE = p.getQuaternionFromEuler((np.pi / 2, 0, 0))
RADIUS, BAR, HALF = 0.002, 0.01, 0.1  # m: of the cord, of the bar; half the cord's length


def lay_along(world, client, kind, angle, aside, particles, friction, height=0.15):
    """A cord along the top of a horizontal bar, drawn down at both ends by soft hands."""
    turn = p.getQuaternionFromEuler((0, np.pi / 2, 0))
    shape = p.createCollisionShape(kind, radius=BAR, height=height, physicsClientId=client)
    bar = p.createMultiBody(0, shape, -1, (0, 0, 0), turn, physicsClientId=client)
    world.add_obstacle(bar, friction=friction)
    along, top = HALF * np.array([np.cos(angle), np.sin(angle), 0]), np.array([0, aside, BAR + RADIUS])
    material = bt.Material(stiffness=1e4, damping=1.0, friction=friction)
    t = world.add_tendon([top - along, top + along], RADIUS, material, particles)
    for end, side in ((0, -1), (-1, 1)):
        t.grip(end, target=top + side * along - (0, 0, 1e-3), stiffness=500.0, damping=1.0)
    return t


@pytest.mark.parametrize("kind", [p.GEOM_CYLINDER, p.GEOM_CAPSULE])
@pytest.mark.parametrize("angle", [1e-6, 1e-3, 1e-2, 3e-2, 0.1])
@pytest.mark.parametrize(("aside", "particles", "friction"), [(0, 21, 0.5), (1e-3, 11, 0.0), (1e-3, 7, 0.3)])
def test_steps_are_few_solutions(make_world, client, kind, angle, aside, particles, friction):
    world = make_world(1 / 240, (0, 0, -9.81))
    t = lay_along(world, client, kind, angle, aside, particles, friction)
    solutions = []
    for _ in range(120):
        world.step()
        assert world.report.converged
        solutions.append(world.report.counts["linear_solves"])
    assert sum(solutions) < 2000 and max(solutions) < 60
    over = np.abs(t.positions[:, 0]) < 0.07
    assert np.hypot(*t.positions[over, 1:].T).min() > BAR + 0.99 * RADIUS


@pytest.mark.parametrize("kind", [p.GEOM_CYLINDER, p.GEOM_CAPSULE])
@pytest.mark.parametrize("angle", [3e-3, 1e-2, 3e-2])
@pytest.mark.parametrize(
    ("particles", "height", "friction"), [(2, 0.01, 0.0), (2, 0.03, 0.5), (3, 0.03, 0.5)]
)
def test_segments_longer_than_the_bar(make_world, client, kind, angle, particles, height, friction):
    """All of the segment would turn around a longer bar, but the part over this one lies along it."""
    world = make_world(1 / 240, (0, 0, -9.81))
    t = lay_along(world, client, kind, angle, 0, particles, friction, height)
    for _ in range(120):
        world.step()
        assert world.report.converged
        assert world.report.counts["linear_solves"] < 20
    first, last = t.positions[[0, -1]]
    middle = first + (last - first) / 2 if particles == 2 else t.positions[1]
    assert np.hypot(*middle[1:]) > BAR + 0.99 * RADIUS


@pytest.mark.parametrize("yaw", [-0.1, -0.03, 0.1])
@pytest.mark.parametrize("integrator", ["implicit_euler", "bdf2"])
def test_a_smooth_wheel_on_an_oblique_hinge(make_world, client, yaw, integrator):
    """Forces pass through its axis: what rounding leaves of their arms is no residual."""
    wheel = 0.02
    world = make_world(1 / 240, (0, 0, -9.81), integrator=integrator)
    shape = p.createCollisionShape(p.GEOM_CYLINDER, radius=wheel, height=0.05, physicsClientId=client)
    body = links_on_joints(client, p.JOINT_REVOLUTE, [0.05], [(0, 0, 1)], shape)
    turn = p.getQuaternionFromEuler((np.pi / 2, 0, yaw))
    p.resetBasePositionAndOrientation(body, (0, 0, 0), turn, physicsClientId=client)
    p.setJointMotorControl2(body, 0, p.VELOCITY_CONTROL, force=0, physicsClientId=client)
    world.add_obstacle(body, friction=0.0)
    arc = (wheel + RADIUS + 1e-6) * np.array([(-np.cos(a), 0, np.sin(a)) for a in np.linspace(0, np.pi, 200)])
    ends = [arc[k] - (0, 0, 0.14) for k in (0, -1)]
    t = world.add_tendon([ends[0], *arc, ends[1]], RADIUS, bt.Material(stiffness=1e4, damping=1.0), 30)
    t.set_point_mass(0, 0.05)
    t.set_point_mass(-1, 0.05 + 5e-6)
    for _ in range(120):
        world.step()
        assert world.report.converged
        assert world.report.counts["linear_solves"] < 400
    assert abs(p.getJointState(body, 0, physicsClientId=client)[1]) < 1e-6


@pytest.mark.parametrize("over", [100, 180, 300])
@pytest.mark.parametrize("particles", [30, 47])
def test_a_thin_cord_does_not_turn_a_large_smooth_wheel(make_world, client, over, particles):
    """A weight on it swings; every force on the wheel passes through its axle."""
    radius, mass = 0.1, 0.3
    thin = radius / over
    shape = p.createCollisionShape(p.GEOM_CYLINDER, radius=radius, height=0.03, physicsClientId=client)
    wheel = links_on_joints(client, p.JOINT_REVOLUTE, [0.4], [(0, 0, 1)], shape, turned=AXLE)
    p.setJointMotorControl2(wheel, 0, p.VELOCITY_CONTROL, force=0, physicsClientId=client)
    world = make_world(1 / 240, (0, 0, -9.81))
    world.add_obstacle(wheel, 0, friction=0.0)
    angle, off = np.linspace(np.pi, 0, 60)[:, None], radius + thin
    arc = off * np.hstack([np.cos(angle), 0 * angle, np.sin(angle)])
    line = np.vstack([[-off, 0, -0.3], arc, [off, 0, -0.3]])
    cord = bt.Material(stiffness=1500.0, damping=0.1)
    tendon = world.add_tendon(line, thin, cord, particles)
    tendon.set_point_mass(0, mass)
    hand = tendon.grip(-1)
    for step in range(120):
        hand.target = (off, 0, -0.3 - 0.06 * step / 120)
        world.step()
        assert abs(world.wrench(wheel, 0)[4]) < 1e-9 * radius * mass * 9.81
    assert tendon.tension[0] > 0
