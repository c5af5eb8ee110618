"""world.relax against exact equilibria."""

import numpy as np
import pybullet as p
import pytest
from scipy.optimize import brentq

import bullet_tendon as bt

G = 9.81
LENGTH, SPAN, RADIUS, STIFFNESS = 0.3, 0.24, 0.004, 3e4


def rope(world, n, exponent=1.0, **more):
    material = bt.Material(stiffness=STIFFNESS, exponent=exponent, density=1100.0, **more)
    return world.add_tendon([[0, 0, 0], [LENGTH, 0, 0]], RADIUS, material, n)


def catenary(n, exponent, masses) -> np.ndarray:
    """(n, 2) x and z of the discrete elastic catenary: lumped weights, T_i = sqrt(H^2 + V_i^2)."""
    rest = LENGTH / (n - 1)
    weights = G * masses
    left = 0.5 * weights.sum()
    vertical = left - np.cumsum(weights)[:-1]  # by symmetry half of the weight hangs on each end

    def steps(h):
        tension = np.hypot(h, vertical)
        length = rest * (1 + (tension / STIFFNESS) ** (1 / exponent))
        return length * h / tension, -length * vertical / tension

    h = brentq(lambda h: steps(h)[0].sum() - SPAN, 1e-6, 1e3, xtol=1e-16, rtol=1e-15)
    return np.concatenate([[[0, 0]], np.cumsum(np.column_stack(steps(h)), axis=0)])


@pytest.mark.parametrize("n", [20, 60, 500])
@pytest.mark.parametrize("exponent", [1.0, 2.0])
def test_catenary_from_a_straight_line(make_world, n, exponent):
    world = make_world(1 / 240, (0, 0, -G))
    t = rope(world, n, exponent)
    t.grip(0, (0, 0, 0)), t.grip(-1, (SPAN, 0, 0))
    world.relax(1e-11)
    assert world.report.converged
    assert world.report.iterations < 30
    assert np.abs(t.positions[:, [0, 2]] - catenary(n, exponent, t.masses)).max() <= 1e-9 * LENGTH
    assert not t.velocities.any()


@pytest.mark.parametrize("exponent", [1.0, 1.5, 2.0, 3.0])
def test_series_stretch(make_world, exponent):
    world = make_world(1 / 240, (0, 0, 0))
    t = rope(world, 500, exponent)
    t.grip(0), t.set_force(-1, (50.0, 0, 0))
    world.relax(1e-12)
    stretch = LENGTH * (50.0 / STIFFNESS) ** (1 / exponent)
    assert t.length - LENGTH == pytest.approx(stretch, rel=1e-10)


def test_over_a_ball(make_world, client):
    """It comes to lie on the ball, carried by it and by the grips; the ball, though free, is held."""
    world = make_world(1 / 240, (0, 0, -G))
    shape = p.createCollisionShape(p.GEOM_SPHERE, radius=0.05, physicsClientId=client)
    ball = p.createMultiBody(1.0, shape, basePosition=[0.15, 0, -0.06], physicsClientId=client)
    world.add_obstacle(ball)
    t = rope(world, 121)
    grips = t.grip(0, (0.02, 0, -0.06)), t.grip(-1, (0.28, 0, -0.06))
    world.relax(1e-7)
    assert world.report.converged
    assert world.contacts["distance"].min() >= -1e-6
    forces = grips[0].force + grips[1].force + world.wrench(ball)[:3]
    np.testing.assert_allclose(forces, [0, 0, -G * t.masses.sum()], atol=1e-5)
    assert p.getBasePositionAndOrientation(ball, client)[0] == (0.15, 0.0, -0.06)
    assert p.getBaseVelocity(ball, client)[0] == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("bead, mass", [(36, 0.01227), (20, 0.003), (30, 0.05), (38, 0.3)])
@pytest.mark.parametrize("exponent", [1.0, 1.568, 2.0])
def test_a_fold_on_the_way_leaves_no_contact(make_world, bead, mass, exponent):
    """A cord with a bead can fold while it is brought to rest; where it rests, springs carry the weights."""
    world = make_world(1 / 240, (0, 0, -G))
    material = bt.Material(stiffness=11793.82, exponent=exponent, density=1523.0)
    t = world.add_tendon([(0, 0, 0), (0.16895, 0, -0.02493), (0.3379, 0, 0)], 0.0005, material, 42)
    t.grip(0), t.grip(-1)
    t.set_point_mass(bead, mass)
    world.relax()
    assert world.report.converged
    along = np.diff(t.positions, axis=0)
    pulls = t.tension[:, None] * along / np.linalg.norm(along, axis=1)[:, None]
    balance = np.diff(pulls, axis=0) - G * t.masses[1:-1, None] * [0, 0, 1]
    assert np.abs(balance).max() <= 1e-5 * t.tension.max()
    assert not len(world.contacts)


def test_the_way_to_rest_is_short_where_nothing_is_near(make_world, client):
    """Beside a ball that it does not meet, a cord hangs as it does alone, and needs few solutions."""
    world = make_world(1 / 240, (0, 0, -G))
    shape = p.createCollisionShape(p.GEOM_SPHERE, radius=0.05, physicsClientId=client)
    world.add_obstacle(p.createMultiBody(0, shape, basePosition=[0.12, 0.2, -0.1], physicsClientId=client))
    material = bt.Material(stiffness=10.0, density=1100.0, tension_only=True)
    t = world.add_tendon([[0, 0, 0], [LENGTH, 0, 0]], 0.0001, material, 61)
    t.grip(0), t.grip(-1)
    t.set_point_mass(30, 0.1)
    world.relax()
    assert world.report.converged
    assert world.report.iterations < 300
    assert t.positions[30, 2] < -500 * t.radius
    lengths = np.linalg.norm(np.diff(t.positions, axis=0), axis=1)
    sine = -t.positions[30, 2] / lengths[:30].sum()
    assert 2 * t.tension[29] * sine == pytest.approx(0.1 * G, rel=1e-3)


def test_no_leap_over_what_lies_on_the_way(make_world, client):
    """A cord that falls from high above a plate comes to lie on it."""
    world = make_world(1 / 240, (0, 0, -G))
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.05, 0.05, 0.002], physicsClientId=client)
    world.add_obstacle(p.createMultiBody(0, shape, basePosition=[0, 0, -0.06], physicsClientId=client))
    material = bt.Material(stiffness=1e3, density=1100.0)
    t = world.add_tendon([[-0.1, 0, 0], [0.1, 0, 0]], 0.001, material, 41, rest_length=0.3)
    t.grip(0), t.grip(-1)
    world.relax()
    assert world.report.converged
    middle = t.positions[np.abs(t.positions[:, 0]) < 0.035, 2]
    np.testing.assert_allclose(middle, -0.058 + t.radius, atol=1e-5)


def test_refuses_what_makes_no_sense(make_world):
    world = make_world(1 / 240, (0, 0, -G))
    with pytest.raises(bt.InvalidValue, match="tolerance"):
        world.relax(0)
    with pytest.raises(bt.InvalidType, match="max_steps"):
        world.relax(1e-6, 2.5)


def test_says_so_where_there_is_no_equilibrium(make_world):
    """A tendon that nothing holds goes on falling."""
    world = make_world(1 / 240, (0, 0, -G))
    rope(world, 10)
    world.relax(1e-6, max_steps=5)
    assert not world.report.converged


def test_a_world_without_tendons_is_at_rest(make_world):
    """Also where the last one was removed."""
    world = make_world(gravity=(0.0, 0.0, -9.81))
    world.relax()
    assert world.report.converged
    t = world.add_tendon([(0, 0, 0), (0, 0, -0.1)], 0.001, bt.Material(stiffness=1e3), 5)
    t.grip(0)
    world.step()
    world.remove_tendon(t)
    world.relax()
    assert world.report.converged


@pytest.mark.parametrize("bending_stiffness", [0.0, 2e-4])
@pytest.mark.parametrize("n", [30, 100, 400])
def test_drawn_taut_through_two_plates(make_world, client, n, bending_stiffness):
    """By forces that draw a light cord by many radii at once. Friction holds it in the bores it began in.

    The ends carry 10 and 10.5 N, of which friction can make 10 e^(0.1 phi), more than 18 N.
    """
    world = make_world(1 / 240, (0, 0, -G))
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=(0.02, 0.02, 0.01), physicsClientId=client)
    for at in (0, 0, 0), (0.06, 0, 0.03):
        plate = p.createMultiBody(0, shape, -1, at, physicsClientId=client)
        world.add_obstacle(plate, friction=0.5)
        world.add_tunnel(plate, -1, (0, 0, -0.01), (0, 0, 0.01), 0.004, friction=0.5, chamfer=0.001)
    line = [(0, 0, -0.08), (0, 0, 0.015), (0.03, 0, 0.06), (0.06, 0, 0.045), (0.06, 0, -0.05)]
    material = bt.Material(stiffness=1e4, damping=5.0, bending_stiffness=bending_stiffness, friction=0.2)
    t = world.add_tendon(line, 0.0025, material, n)
    t.set_force(0, (0, 0, -10.0)), t.set_force(-1, (0, 0, -10.5))
    world.relax()
    assert world.report.converged
    assert len(world.penetrations()) == 0
    assert world.contacts["distance"].min() > -1e-3 * t.radius
    ends = np.array([10.0, 10.5]) + G * t.masses[[0, -1]]
    np.testing.assert_allclose(t.tension[[0, -1]], ends, rtol=1e-5)
    # What is taut between the bores passes 0.03 m below its slack way.
    assert t.positions[np.abs(t.positions[:, 0] - 0.03) < 0.02, 2].max() < 0.045
    x = t.positions
    world.step(60)
    assert np.abs(t.positions - x).max() < 1e-3 * t.radius


@pytest.mark.parametrize("far", [0.01, 0.05])
def test_led_by_a_hand_that_is_far(make_world, client, far):
    """Shorter steps do not bring it nearer to where it was."""
    world = make_world(1 / 240, (0, 0, -G))
    shape = p.createCollisionShape(p.GEOM_SPHERE, radius=0.02, physicsClientId=client)
    world.add_obstacle(p.createMultiBody(0, shape, -1, (0.1, 0, -0.2), physicsClientId=client))
    t = rope(world, 40)
    t.grip(0), t.grip(-1, target=(LENGTH - 0.02, far, far))
    world.relax()
    assert world.report.converged
    np.testing.assert_allclose(t.positions[-1], (LENGTH - 0.02, far, far), atol=1e-12)
