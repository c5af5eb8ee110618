"""A tendon attached on or in a shape leaves it as if nothing touched it there, however finely it is divided.

Without the smaller contact distance beside the attachment its particles are pushed out by the radius, over a
segment that is shorter than that: 9.8 kN on the surface, 70 kN at a depth of 2 mm, with segments of 0.7 mm.
"""

import numpy as np
import pybullet as p
import pytest

import bullet_tendon as bt

RADIUS, LENGTH, HALF = 0.001, 0.1, 0.03
MATERIAL = bt.Material(stiffness=2e4, damping=2.0, friction=0.3)
SHAPES = {
    "box": (p.GEOM_BOX, {"halfExtents": [HALF] * 3}),
    "sphere": (p.GEOM_SPHERE, {"radius": HALF}),
    "cylinder": (p.GEOM_CYLINDER, {"radius": HALF, "height": 2 * HALF}),
    "half space": (p.GEOM_PLANE, {}),
}


@pytest.fixture
def world(make_world):
    return make_world()


def bone(client, kind, mass=0.0):
    geometry, sizes = SHAPES[kind]
    shape = p.createCollisionShape(geometry, physicsClientId=client, **sizes)
    at = (0, 0, HALF if kind == "half space" else 0)
    return p.createMultiBody(mass, shape, -1, at, physicsClientId=client)


def attached(world, body, depth, tilt, particles):
    """A straight tendon from a depth [m] under the top of a shape, at an angle to the normal [rad]."""
    start = np.array([0, 0, HALF - depth])
    way = LENGTH * np.array([np.sin(tilt), 0, np.cos(tilt)])
    t = world.add_tendon([start, start + way], RADIUS, MATERIAL, particles)
    t.attach(0, body)
    return t


@pytest.mark.parametrize("particles", [10, 150, 300])
@pytest.mark.parametrize("tilt", [0.0, 0.8, 1.3])
@pytest.mark.parametrize("depth", [0.0, 0.0005, 0.002])
@pytest.mark.parametrize("kind", SHAPES)
def test_no_tension_arises(world, client, kind, depth, tilt, particles):
    body = bone(client, kind)
    world.add_obstacle(body)
    t = attached(world, body, depth, tilt, particles)
    for _ in range(20):
        world.step()
        assert world.report.converged
    assert np.abs(t.tension).max() < 1e-3 * MATERIAL.stiffness * 1e-3


def test_the_finger_of_the_package_is_not_pulled(make_world, client):
    """Its tendons end in the box of its last link, which is an obstacle unless the user says otherwise.

    With the whole radius as contact distance 26 kN pull at it in the third step, which takes seconds.
    """
    world = make_world()
    flags = p.URDF_USE_INERTIA_FROM_FILE
    robot = world.load_urdf(bt.data_path("tendon_finger.urdf"), useFixedBase=True, flags=flags)
    for joint in range(p.getNumJoints(robot, client)):
        p.setJointMotorControl2(robot, joint, p.VELOCITY_CONTROL, force=0, physicsClientId=client)
    world.step(10)
    assert max(np.abs(t.tension).max() for t in world.tendons) < 1
    assert max(abs(p.getJointState(robot, j, client)[0]) for j in range(3)) < 1e-4


@pytest.mark.parametrize("depth", [0.0, 0.001])
def test_away_from_the_attachment_it_lies_on_the_surface(make_world, client, depth):
    """Pressed down along a plate: nearer than the radius over ten times the depth and the radius alone."""
    world = make_world(gravity=(0, 0, -9.81))
    body = bone(client, "half space")
    world.add_obstacle(body)
    t = attached(world, body, depth, np.pi / 2 - 0.15, 101)
    world.step(480)
    heights = t.positions[:, 2] - HALF
    arc = np.linspace(0, LENGTH, 101)
    np.testing.assert_array_less(np.minimum(RADIUS, 0.1 * arc - depth) - 0.01 * RADIUS, heights)
    np.testing.assert_allclose(heights[arc > 10 * (depth + RADIUS) + 0.01], RADIUS, atol=0.01 * RADIUS)


def test_at_the_radius_nothing_changes(make_world, client):
    """Attached to a plate at its height on it, a tendon that is pressed down lies on it from the start."""
    world = make_world(gravity=(0, 0, -9.81))
    body = bone(client, "half space")
    world.add_obstacle(body)
    t = attached(world, body, -RADIUS, np.pi / 2, 101)
    world.step(240)
    np.testing.assert_allclose(t.positions[:, 2] - HALF, RADIUS, atol=0.001 * RADIUS)


def test_what_is_attached_elsewhere_is_kept_out(make_world, client):
    """The attachment to one bone leaves the distance from another one as it is."""
    world = make_world(gravity=(0, 0, -9.81))
    plate, other = bone(client, "half space"), bone(client, "sphere")
    p.resetBasePositionAndOrientation(other, (0, 0, 0), (0, 0, 0, 1), physicsClientId=client)
    world.add_obstacle(plate)
    t = attached(world, other, -RADIUS, np.pi / 2, 101)
    world.step(240)
    np.testing.assert_allclose(t.positions[:, 2] - HALF, RADIUS, atol=0.001 * RADIUS)
