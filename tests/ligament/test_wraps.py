"""Ligaments that wrap around spheres and cylinders: length, direction, balance."""

import math

import numpy as np
import pybullet as p
import pytest
from scipy.spatial.transform import Rotation

import bullet_tendon as bt
from bullet_tendon import _core


def body(client, mass, at=(0, 0, 0), turn=(0, 0, 0, 1)):
    shape = p.createCollisionShape(p.GEOM_SPHERE, radius=0.01, physicsClientId=client)
    made = p.createMultiBody(mass, shape, -1, at, turn, physicsClientId=client)
    dynamics = {"localInertiaDiagonal": (1e-3, 1e-3, 1e-3), "linearDamping": 0, "angularDamping": 0}
    p.changeDynamics(made, -1, **dynamics, physicsClientId=client)
    p.setCollisionFilterGroupMask(made, -1, 0, 0, client)
    return made


def shortest(kind, radius, a, b):
    """Length of the shortest way: around a circle, on a cylinder unrolled into the plane."""
    rise = 0.0
    if kind == "cylinder":
        rise, a, b = b[2] - a[2], np.array([*a[:2], 0]), np.array([*b[:2], 0])
    far, other = np.linalg.norm(a), np.linalg.norm(b)
    arc = math.acos(a @ b / far / other) - math.acos(radius / far) - math.acos(radius / other)
    around = math.sqrt(far**2 - radius**2) + radius * arc + math.sqrt(other**2 - radius**2)
    return math.hypot(around, rise)


@pytest.mark.parametrize("kind", ["sphere", "cylinder"])
def test_it_takes_the_shortest_way(make_world, client, kind):
    world = make_world()
    radius, turn = 0.02, Rotation.from_rotvec([0.3, -0.8, 0.5])
    centre = np.array([0.1, 0.2, 0.3])
    stand = body(client, 0, centre, turn.as_quat())
    wrap = world.add_wrap(stand, -1, (kind, radius), (0, 0, 0))
    a, b = np.array([0.03, 0.012, 0.01]), np.array([-0.028, 0.01, -0.02])
    ends = [body(client, 1.0, centre + turn.apply(v)) for v in (a, b)]
    path = [(end, -1, (0, 0, 0)) for end in ends]
    ligament = world.add_ligament(path, bt.Material(stiffness=1e3), wraps=[wrap])
    assert ligament.length == pytest.approx(shortest(kind, radius, a, b), rel=1e-9)
    assert len(ligament.points) == 4 and ligament.length > np.linalg.norm(a - b)
    p.resetBasePositionAndOrientation(ends[1], centre + turn.apply(b + [0, 0.05, 0]), (0, 0, 0, 1), client)
    assert ligament.length == pytest.approx(np.linalg.norm(a - b - [0, 0.05, 0]), rel=1e-9)
    assert len(ligament.points) == 2


@pytest.mark.parametrize("kind", ["sphere", "cylinder"])
def test_the_gradient_is_the_derivative_of_the_length(make_world, client, kind):
    world = make_world()
    stand = body(client, 1.0)
    ends = [body(client, 1.0, at) for at in ((0.03, 0.012, 0.01), (-0.028, 0.01, -0.02))]
    wrap = world.add_wrap(stand, -1, (kind, 0.02), (0.001, 0.002, 0), (0.1, 0.2, 0, 1))
    path = [(end, -1, (0.001, 0.002, 0.003)) for end in ends]
    ligament = world.add_ligament(path, bt.Material(stiffness=1e3), rest_length=0.06, wraps=[wrap])
    world.step()
    moves = np.zeros((3, 6))

    def term(by):
        return _core.testing.ligament_term(world._core, ligament.slot, moves + by, 1 / 240)

    gradient = term(np.zeros((3, 6)))[1]
    size, step = np.abs(gradient).max(), 1e-6
    assert size > 1
    for k in range(18):
        by = np.zeros(18)
        by[k] = step
        slope = (term(by.reshape(3, 6))[0] - term(-by.reshape(3, 6))[0]) / (2 * step)
        assert slope == pytest.approx(gradient[k], abs=1e-5 * size)


def test_two_weights_balance_over_a_pulley(make_world, client):
    """The heavier one falls with (m1 - m2) g/(m1 + m2), and the pulley carries both tensions."""
    world = make_world(1 / 240, (0, 0, -9.81))
    stand = body(client, 0)
    weights = [body(client, mass, (x, 0, -0.3)) for mass, x in ((1.0, 0.02), (1.2, -0.02))]
    turn = (math.sqrt(0.5), 0, 0, math.sqrt(0.5))  # the axis along y
    wrap = world.add_wrap(stand, -1, ("cylinder", 0.02 - 1e-9), (0, 0, 0), turn)
    # A point of the stand above the pulley keeps the path on its upper side.
    path = [(weights[0], -1, (0, 0, 0)), (stand, -1, (0, 0, 0.02)), (weights[1], -1, (0, 0, 0))]
    line = world.add_ligament(path, bt.Material(stiffness=1e5, damping=100.0), wraps=[wrap])
    world.step(60)
    speeds = [p.getBaseVelocity(weight, client)[0][2] for weight in weights]
    exact = 0.2 / 2.2 * 9.81 * 0.25
    assert speeds[0] == pytest.approx(exact, rel=0.02) and speeds[1] == pytest.approx(-exact, rel=0.02)
    tension = 2 * 1.0 * 1.2 / 2.2 * 9.81
    assert line.force == pytest.approx(tension, rel=0.02)
    assert world.wrench(stand)[2] == pytest.approx(-2 * tension, rel=0.02)


def test_bad_wraps_are_refused(make_world, client):
    world = make_world()
    stand, other = body(client, 0), body(client, 1.0, (0.1, 0, 0))
    for shape in (("cone", 0.01), ("sphere", 0), ("sphere", -1)):
        with pytest.raises(bt.InvalidValue):
            world.add_wrap(stand, -1, shape, (0, 0, 0))
    with pytest.raises(bt.InvalidType):
        world.add_wrap(stand, -1, 0.01, (0, 0, 0))
    with pytest.raises(bt.InvalidValue):
        world.add_wrap(stand, -1, ("sphere", 0.01), (0, 0, 0), (0, 0, 0, 0))
    with pytest.raises(bt.UnknownId):
        world.add_wrap(77, -1, ("sphere", 0.01), (0, 0, 0))
    path = [(stand, -1, (0, 0, 0)), (other, -1, (0, 0, 0))]
    with pytest.raises(bt.InvalidType):
        world.add_ligament(path, bt.Material(stiffness=1e3), wraps=[3])
    assert world.ligaments == ()
