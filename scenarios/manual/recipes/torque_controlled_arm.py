"""
A torque-controlled arm
=======================

An arm of two hinges holds a weight on a cord. A controller computes its torques in each step.
pybullet does not report them, so the tendons are told.
"""

import numpy as np
import pybullet as p

import bullet_tendon as bt
from bullet_tendon import view

client = p.connect(p.DIRECT)
p.setGravity(0, 0, -9.81)

# %%
# Two links of 0.3 m and 0.5 kg turn about y. Their motors are switched off: p.createMultiBody, like
# p.loadURDF, begins with motors that hold the joints still.

middle = (0.15, 0, 0)
box = p.createCollisionShape(p.GEOM_BOX, halfExtents=(0.15, 0.01, 0.01), collisionFramePosition=middle)
straight = (0, 0, 0, 1)
arm = p.createMultiBody(
    linkMasses=[0.5, 0.5],
    linkCollisionShapeIndices=[box, box],
    linkVisualShapeIndices=[-1, -1],
    linkPositions=[(0, 0, 0), (0.3, 0, 0)],
    linkOrientations=[straight, straight],
    linkInertialFramePositions=[middle, middle],
    linkInertialFrameOrientations=[straight, straight],
    linkParentIndices=[0, 1],
    linkJointTypes=[p.JOINT_REVOLUTE, p.JOINT_REVOLUTE],
    linkJointAxis=[(0, 1, 0), (0, 1, 0)],
)
for joint in (0, 1):
    p.setJointMotorControl2(arm, joint, p.VELOCITY_CONTROL, force=0)

# %%
# A weight of 1 kg hangs at the arm's end. The point of an attachment is in the link's URDF frame, which
# begins at its joint.

aim = np.radians([-40, 50])
for joint in (0, 1):
    p.resetJointState(arm, joint, aim[joint])

frame = p.getLinkState(arm, 1, computeForwardKinematics=True)
tip = np.array(p.multiplyTransforms(*frame[4:6], (0.3, 0, 0), straight)[0])

ball = p.createCollisionShape(p.GEOM_SPHERE, radius=0.02)
weight = p.createMultiBody(1.0, ball, -1, tip - (0, 0, 0.22))
p.changeDynamics(weight, -1, linearDamping=4)  # it soon hangs still

world = bt.TendonWorld(client)
material = bt.Material.from_modulus(5e8, 0.001, damping=20, friction=0.3)
cord = world.add_tendon([tip, tip - (0, 0, 0.2)], 0.001, material, 20)
knot = cord.attach(0, arm, 1, position=(0.3, 0, 0))
cord.attach(-1, weight, position=(0, 0, 0.02))


# %%
# The controller is a spring and a damper for each joint, by the arm's mass matrix, and carries the arm's own
# weight. `apply_joint_force` is `p.setJointMotorControl2` with `p.TORQUE_CONTROL`, and tells the tendons.


def controlled(rate, feed_forward):
    """Angles (2,) beside the aim after 3 s [degrees]; rate: of the springs [rad/s]."""
    still = [0.0, 0.0]
    for _ in range(720):
        states = p.getJointStates(arm, (0, 1))
        angles, rates = (np.array([state[k] for state in states]) for k in (0, 1))
        mass = np.array(p.calculateMassMatrix(arm, angles.tolist()))
        torque = mass @ (rate**2 * (aim - angles) - 2 * rate * rates)
        torque += p.calculateInverseDynamics(arm, angles.tolist(), still, still)
        if feed_forward:
            jacobian, _ = p.calculateJacobian(arm, 1, knot.position.tolist(), angles.tolist(), still, still)
            torque -= np.transpose(jacobian) @ knot.force
        for joint in (0, 1):
            world.apply_joint_force(arm, joint, torque[joint])
        world.step()
    return np.degrees(angles - aim)


# %%
# The controller does not know of the weight, and the arm sinks. With the force that the cord had on it in the
# last step, it does not.

soft, stiff = controlled(30, False), controlled(120, False)
told = controlled(30, True)
for name, off in (("soft", soft), ("stiff", stiff), ("soft, told of the cord", told)):
    print(f"{name}: off by {off[0]:.3f} and {off[1]:.3f} degrees")

camera = {"target": (0.28, 0, 0.06), "distance": 0.8, "yaw": 0, "pitch": -10, "width": 640, "height": 640}
view.save_png("arm.png", view.render_scene(client, camera, [], [cord]))
