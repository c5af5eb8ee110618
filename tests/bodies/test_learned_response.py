"""What is learned of how a body answers: how much it gives way; it is never taken for lighter than it is."""

import numpy as np
import pybullet as p
import pytest
from link_scenes import free_ball, links_on_joints

import bullet_tendon as bt

DT, MASS, K, LENGTH = 1 / 240, 5e4, 2e3, 0.1


class Helped:
    """A heavy body on cords along x and y. A script resists the pull along y by half, and helps that along x.

    Something in pybullet could hold it: a constraint, whose force is none.
    """

    def __init__(self, client, world, help_along_x):
        self.client, self.world, self.help = client, world, help_along_x
        self.body = free_ball(client, MASS)
        place = [p.JOINT_POINT2POINT, [0, 0, 0], [0, 0, 0], [0, 0, 0]]
        loose = p.createConstraint(self.body, -1, -1, -1, *place, physicsClientId=client)
        p.changeConstraint(loose, maxForce=0, physicsClientId=client)
        self.hands, self.ties, self.cords = [], [], []
        for along in np.eye(3)[:2]:
            cord = world.add_tendon([LENGTH * along, 0 * along], 0.002, bt.Material(stiffness=K), 3)
            self.hands.append(cord.grip(0))
            self.ties.append(cord.attach(-1, self.body))
            self.cords.append(cord)

    def step(self, pulls):
        """One step with about these pulls [N]; how far the body is off its plan, over f dt^2/m (2,) [-]."""
        place = np.array(p.getBasePositionAndOrientation(self.body, self.client)[0])
        for axis, (hand, pull) in enumerate(zip(self.hands, pulls, strict=True)):
            hand.target = place + (LENGTH * (1 + pull / K)) * np.eye(3)[axis]
        self.world.apply()
        force = sum(tie.force for tie in self.ties)
        more = [self.help * force[0], -0.5 * force[1], 0]
        p.applyExternalForce(self.body, -1, more, place.tolist(), p.WORLD_FRAME, self.client)
        p.stepSimulation(self.client)
        place = np.array(p.getBasePositionAndOrientation(self.body, self.client)[0])
        missed = [place[k] - self.cords[k].positions[-1, k] for k in (0, 1)]
        return np.array(missed) / np.abs(force[:2]) / DT**2 * MASS


@pytest.mark.parametrize("share", [0.12, 0.18])
def test_a_body_is_never_taken_to_be_lighter_than_it_is(make_world, client, share):
    """What helps along x may end at once: the plan is that of the mass, or less, while the help lasts too."""
    scene = Helped(client, make_world(DT), share)
    for k in range(10):
        missed = scene.step([0.0, 100 * (1 + 0.5 * (-1) ** k)])
    assert abs(missed[1]) <= 1e-3  # it is known that it gives way by half
    for k in range(6):
        missed = scene.step([40 * (-1) ** k, 100.0])
        np.testing.assert_allclose(np.abs(missed), [share, 0], atol=1e-4)
    scene.help = 0.0
    for k in range(4):
        missed = scene.step([40 * (-1) ** k, 100.0])
        np.testing.assert_allclose(missed, 0, atol=1e-4)


@pytest.mark.parametrize("stiffness", [300.0, 3e3, 1e4])
@pytest.mark.parametrize("beside", [False, True])
def test_a_torque_controlled_joint_is_not_taken_for_a_held_one(make_world, client, stiffness, beside):
    """A slider on a cord that is drawn, and on a spring that the user computes.

    Nothing holds it, whatever holds another body: the plan of each step is off by what the user's force has
    changed by since the lesser one of the last two steps.
    """
    world, mass, force = make_world(DT), 0.5, []
    body = links_on_joints(client, p.JOINT_PRISMATIC, [mass], [(1, 0, 0)])
    p.setJointMotorControl2(body, 0, p.VELOCITY_CONTROL, force=0, physicsClientId=client)
    if beside:
        other = free_ball(client, 1.0, (5, 0, 0))
        place = [p.JOINT_POINT2POINT, [0, 0, 0], [0, 0, 0], [5, 0, 0]]
        p.createConstraint(other, -1, -1, -1, *place, physicsClientId=client)
    cord = world.add_tendon([(-LENGTH, 0, 0), (0, 0, 0)], 0.002, bt.Material(stiffness=2e3, damping=5.0), 3)
    hand = cord.grip(0)
    cord.attach(-1, body, 0)
    damping = 0.6 * np.sqrt(stiffness * mass)
    for k in range(60):
        hand.target = np.array([-LENGTH - 1e-4 * k * (1 + 0.5 * np.sin(k)), 0, 0])
        place, rate = p.getJointState(body, 0, client)[:2]
        force.append(-stiffness * place - damping * rate)
        p.setJointMotorControl2(body, 0, p.TORQUE_CONTROL, force=force[k], physicsClientId=client)
        world.step()
        pushes = force[k - 2 : k] if k > 1 else [0.0, 0.0]
        push = min(pushes, key=abs) if np.prod(pushes) > 0 else 0.0
        missed = p.getJointState(body, 0, client)[0] - cord.positions[-1, 0]
        np.testing.assert_allclose(missed, (force[k] - push) * DT**2 / mass, atol=1e-7)


def free_finger(client, damped):
    """The three free links of the finger, which turn fast and in opposite senses."""
    body = p.loadURDF(
        bt.data_path("tendon_finger.urdf"),
        useFixedBase=True,
        flags=p.URDF_USE_INERTIA_FROM_FILE,
        physicsClientId=client,
    )
    for link in range(-1, p.getNumJoints(body, client)):
        if not damped:
            p.changeDynamics(body, link, linearDamping=0, angularDamping=0, physicsClientId=client)
    for joint, (angle, rate) in enumerate(((0.6, 3.0), (0.8, -8.0), (0.7, 12.0))):
        p.setJointMotorControl2(body, joint, p.VELOCITY_CONTROL, force=0, physicsClientId=client)
        p.resetJointState(body, joint, angle, rate, client)
    return body


@pytest.mark.parametrize("damped", [False, True])
@pytest.mark.parametrize("pull", [0.02, 0.5])
@pytest.mark.parametrize("gravity", [(0, 0, 0), (0, 0, -9.81)])
def test_a_free_arm_is_not_taken_for_a_held_one(make_world, client, damped, pull, gravity):
    """Gravity, Coriolis forces, and the damping of its links and joints, are not what a motor does."""
    world = make_world(DT, gravity)
    body = free_finger(client, damped)
    cord = world.add_tendon([[0, 0.05, 0.1], [0.02, 0, 0.05]], 0.001, bt.Material(stiffness=1e3), 8)
    cord.attach(-1, body, 2, position=(0.01, 0, 0))
    cord.set_force(0, (0, 0.3 * pull, pull))
    for _ in range(12):
        world.step()
        assert world.report.converged
        assert not world._core.held_bodies()


@pytest.mark.parametrize("dt", [1 / 240, 1 / 100])
def test_gravity_is_that_of_the_step_in_which_it_acted(make_world, client, dt):
    """An arm falls, and gravity turns every few steps: it moves as predicted, and no push is learned."""
    world = make_world(dt, (0, 0, -9.81))
    body = free_finger(client, False)
    cord = world.add_tendon([[0, 0.05, 0.1], [0.02, 0, 0.05]], 0.001, bt.Material(stiffness=1e3), 8)
    cord.attach(-1, body, 2, position=(0.01, 0, 0))
    cord.set_force(0, (0, 0.02, 0.05))
    for k in range(12):
        if k % 3 == 2:
            p.setGravity(*np.roll((0, 0, 5.0 + k), k), client)
        world.step()
        assert not world._core.held_bodies()
        missed = world._core.missed(0)
        assert k == 0 or np.abs(missed).max() * dt < 1e-6
