"""
Pretension and fixation
=======================

A graft is fixed in the femur. A hand pulls it with 80 N. Then it is fixed in the tibia, and the hand lets go.
The joint yields, and a part of the tension is lost.
"""

import pybullet as p

import bullet_tendon as bt
from bullet_tendon import view

client = p.connect(p.DIRECT)
world = bt.TendonWorld(client)

# %%
# The joint
# ---------
# The femur stands still. The tibia slides along z, 35 mm below it. Switch off pybullet's own motor: by
# default it holds each joint.

box = p.createCollisionShape(p.GEOM_BOX, halfExtents=(0.02, 0.02, 0.02))
knee = p.createMultiBody(
    baseMass=0,
    baseCollisionShapeIndex=box,
    basePosition=(0, 0, 0.02),
    linkMasses=[2.6],
    linkCollisionShapeIndices=[box],
    linkVisualShapeIndices=[-1],
    linkPositions=[(0, 0, -0.075)],
    linkOrientations=[(0, 0, 0, 1)],
    linkInertialFramePositions=[(0, 0, 0)],
    linkInertialFrameOrientations=[(0, 0, 0, 1)],
    linkParentIndices=[0],
    linkJointTypes=[p.JOINT_PRISMATIC],
    linkJointAxis=[(0, 0, 1)],
)
p.setJointMotorControl2(knee, 0, p.VELOCITY_CONTROL, force=0)
FEMUR, TIBIA = -1, 0  # link indices

# %%
# What holds the bones apart is a strut of 150 N/mm. A material that is not ``tension_only`` can push, and a
# chain of two particles does not buckle.

length = 0.035
cartilage = bt.Material(stiffness=150e3 * length, damping=40)
strut = world.add_tendon([(0, 0, 0), (0, 0, -length)], 0.004, cartilage, collides=False)
strut.attach(0, knee, FEMUR)
strut.attach(1, knee, TIBIA)

# %%
# Pretension
# ----------
# The graft has 200 N/mm over 35 mm. Its lower end hangs out of the tibia, and is pulled by a soft grip with a
# largest force: it slips at 80 N, whatever the way.

material = bt.Material(stiffness=200e3 * length, damping=40, tension_only=True)
graft = world.add_tendon([(0, 0, 0), (0, 0, -length)], 0.004, material, particles=8, collides=False)
graft.attach(0, knee, FEMUR)
hand = graft.grip(-1, target=(0, 0, -0.05), stiffness=1e5, max_force=80)

history = []


def run(steps):
    for _ in range(steps):
        world.step()
        history.append((graft.tension.mean(), -strut.tension[0]))


run(240)
print(f"pulled: {graft.tension.mean():.1f} N, the hand slips: {hand.slipping}")

# %%
# Fixation
# --------
# ``attach`` without a position ties the particle to the tibia where it is now.

hand.release()
screw = graft.attach(-1, knee, TIBIA)
run(240)
print(f"fixed: {graft.tension.mean():.1f} N, the joint carries {-strut.tension[0]:.1f} N")

# %%
times = [k / 240 for k in range(len(history))]
pulled, pressed = zip(*history, strict=True)
curves = [{"x": times, "y": pulled, "label": "graft"}, {"x": times, "y": pressed, "label": "strut"}]
view.figure("fixation.png", curves=curves, xlabel="time [s]", ylabel="force [N]")

# %%
# The hand stood in the world, so that the strut carried nothing while it pulled. After the fixation the graft
# pulls the tibia. It keeps the share k_joint/(k_joint + k_graft) = 150/350 of its tension, 34.3 N. To keep
# the 80 N, pull against the tibia: then the strut is loaded before the fixation.
