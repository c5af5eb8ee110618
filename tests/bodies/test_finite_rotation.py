"""The derivatives of a finite rotation, against differences and against pybullet's own rotation."""

import numpy as np
import pybullet as p
import pytest

from bullet_tendon import _core

# Angles below and above pi/4, beyond which pybullet rotates a body by less than spin times step, and one at
# which the coefficients are series.
ANGLES = [0.01, 0.6, 1.1, 2.5]
CORNER = np.pi / 4


# About which a body turns first: none, or that of its least moment of inertia.
AXES = [np.zeros(3), np.array([0.48, 0.64, 0.6])]


def rotated(axis, begun, by, arms, forces):
    return _core.testing.finite_rotation_term(axis, begun, by, np.atleast_2d(arms), np.atleast_2d(forces))


def random_case(angle, seed):
    """A rotation that has begun, one that is added so that both together have the angle, arms and forces."""
    random = np.random.default_rng(seed)
    begun, arms, forces = 0.3 * random.normal(size=3), random.normal(size=(4, 3)), random.normal(size=(4, 3))
    theta = random.normal(size=3)
    return begun, angle / np.linalg.norm(theta) * theta - begun, arms, forces


def derivative(of, h=1e-5):
    """Of a function of a change of the rotation vector, by central differences, one row an axis."""
    return np.array([(of(h * e) - of(-h * e)) / (2 * h) for e in np.eye(3)])


@pytest.mark.parametrize("angle", [*ANGLES, CORNER])
@pytest.mark.parametrize("axis", AXES)
@pytest.mark.parametrize("seed", range(3))
def test_stiffness_is_the_derivative_of_the_torque(angle, seed, axis):
    """Its symmetric part, for constant forces at points that the rotation moves."""
    begun, by, arms, forces = random_case(angle, seed)
    stiffness = rotated(axis, begun, by, arms, forces)[2]

    def torque(step):
        return np.array(rotated(axis, begun, by + step, arms, forces)[1])

    slope = derivative(torque)
    size = np.abs(arms).max() * np.abs(forces).max()
    np.testing.assert_allclose(stiffness, 0.5 * (slope + slope.T), atol=1e-8 * size)


@pytest.mark.parametrize("angle", ANGLES)
@pytest.mark.parametrize("axis", AXES)
@pytest.mark.parametrize("seed", range(3))
def test_torque_is_the_virtual_work_of_the_forces(angle, seed, axis):
    """Its product with a change of the rotation vector is force times motion of the points."""
    begun, by, arms, forces = random_case(angle, seed)
    torque = np.array(rotated(axis, begun, by, arms, forces)[1])

    def work(step):
        return np.sum((arms @ rotated(axis, begun, by + step, arms, forces)[0].T) * forces)

    np.testing.assert_allclose(
        torque, derivative(work), atol=1e-8 * np.abs(arms).max() * np.abs(forces).max()
    )


@pytest.mark.parametrize("angle", [*ANGLES, CORNER])
@pytest.mark.parametrize("seed", range(3))
def test_pybullet_is_given_the_rotation_vector_that_takes_a_slender_body_there(angle, seed):
    begun, by, arms, forces = random_case(0.9 * angle, seed)
    rotation, *_, beyond = rotated(AXES[1], begun, by, arms, forces)
    as_pybullet = rotated(AXES[0], begun, by + beyond, arms, forces)[0]
    np.testing.assert_allclose(rotation, as_pybullet, atol=1e-9)


@pytest.mark.parametrize("angle", ANGLES)
@pytest.mark.parametrize("seed", range(3))
def test_points_on_the_axis_of_a_slender_body_do_not_move_as_it_turns_about_it(angle, seed):
    _, by, arms, forces = random_case(angle, seed)
    on_axis = np.outer(arms[:, 0], AXES[1])
    torque = np.array(rotated(AXES[1], np.zeros(3), by, on_axis, forces)[1])
    assert abs(torque @ AXES[1]) < 1e-12 * np.linalg.norm(torque)


@pytest.mark.parametrize("angle", ANGLES)
def test_rotation_is_that_of_pybullet(client, angle):
    """A free body with equal moments of inertia keeps its spin. pybullet rotates it in one step."""
    dt = 0.05  # pybullet limits spins to 100 rad/s
    p.setTimeStep(dt, physicsClientId=client)
    theta = angle * np.array([0.6, -0.48, 0.64])
    ball = p.createCollisionShape(p.GEOM_SPHERE, radius=0.1, physicsClientId=client)
    body = p.createMultiBody(1.0, ball, physicsClientId=client)
    p.changeDynamics(body, -1, linearDamping=0, angularDamping=0, physicsClientId=client)
    p.resetBaseVelocity(body, [0, 0, 0], theta / dt, client)
    p.stepSimulation(client)
    turned = np.reshape(p.getMatrixFromQuaternion(p.getBasePositionAndOrientation(body, client)[1]), (3, 3))
    rotation = rotated(AXES[0], np.zeros(3), theta, np.zeros((1, 3)), np.zeros((1, 3)))[0]
    np.testing.assert_allclose(rotation, turned, atol=1e-12)


@pytest.mark.parametrize("off", [-1e-3, -5e-4, 0, 5e-4, 1e-3])
def test_rotation_goes_smoothly_round_the_corner_of_pybullets(off):
    """Its rate jumps by a tenth at pi/4. Within a milliradian of it, the rotation is right to 1e-4."""
    theta = (CORNER + off) * np.array([0.6, -0.48, 0.64])
    c = np.tan(np.pi / 8) / CORNER
    angle = min(CORNER + off, 2 * np.arctan(c * (CORNER + off)))
    rotation = np.array(rotated(AXES[0], np.zeros(3), theta, np.zeros((1, 3)), np.zeros((1, 3)))[0])
    assert np.arccos((np.trace(rotation) - 1) / 2) == pytest.approx(angle, abs=1e-4)


@pytest.mark.parametrize("off", [-5e-4, -1e-4, 0, 3e-4, 7e-4])
def test_the_rotation_vector_is_found_to_rounding_where_slowing_sets_in(off):
    """A slender body that turns across its axis alone turns as pybullet does: nothing has to be added."""
    across = np.array([0.8, -0.6, 0.0])
    assert across @ AXES[1] == pytest.approx(0, abs=1e-15)
    none = np.zeros((1, 3))
    *_, beyond = rotated(AXES[1], np.zeros(3), (CORNER + off) * across, none, none)
    np.testing.assert_allclose(beyond, 0, atol=1e-15)
