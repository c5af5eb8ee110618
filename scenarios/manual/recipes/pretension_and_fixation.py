"""
Pretension and fixation
=======================

A graft is fixed in the femur, pulled with 80 N, and fixed in the tibia. How much of the tension stays depends
on what the surgeon pulls against: the world, or the tibia.
"""

import pybullet as p

import bullet_tendon as bt
from bullet_tendon import view

# %%
# The joint
# ---------
# The femur stands still. The tibia slides along z, 35 mm below it. Switch off pybullet's own motor: by
# default it holds each joint. What holds the bones apart is a strut of 150 N/mm: the cartilage. A ligament
# whose material is not ``tension_only`` can push.

FEMUR, TIBIA = -1, 0  # link indices
LENGTH = 0.035


def build():
    client = p.connect(p.DIRECT)
    world = bt.TendonWorld(client)
    box = p.createCollisionShape(p.GEOM_BOX, halfExtents=(0.02, 0.02, 0.02), physicsClientId=client)
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
        physicsClientId=client,
    )
    p.setJointMotorControl2(knee, 0, p.VELOCITY_CONTROL, force=0, physicsClientId=client)
    ends = [(knee, FEMUR, (0, 0, -0.02)), (knee, TIBIA, (0, 0, 0.02))]
    strut = world.add_ligament(ends, bt.Material(stiffness=150e3 * LENGTH, damping=40))
    material = bt.Material(stiffness=200e3 * LENGTH, damping=40, tension_only=True)
    line = [(0, 0, 0), (0, 0, -LENGTH)]
    graft = world.add_tendon(line, 0.004, material, particles=8, collides=False)
    graft.attach(0, knee, FEMUR)
    return world, knee, strut, graft


history = []


def run(world, strut, graft, steps=240):
    for _ in range(steps):
        world.step()
        history.append((graft.tension.mean(), -strut.force))


# %%
# A hand in the world
# -------------------
# A grip with a largest force slips at 80 N, whatever the way. It pulls against the world, so that the strut
# carries nothing. After the fixation the graft pulls the tibia, and keeps k_joint/(k_joint + k_graft) =
# 150/350 of its tension.

world, knee, strut, graft = build()
hand = graft.grip(-1, target=(0, 0, -0.05), stiffness=1e5, max_force=80)
run(world, strut, graft)
print(f"pulled: graft {graft.tension.mean():.1f} N, joint {-strut.force:.1f} N")
hand.release()
graft.attach(-1, knee, TIBIA)
run(world, strut, graft)
print(f"fixed:  graft {graft.tension.mean():.1f} N, joint {-strut.force:.1f} N")
by_hand = graft.tension.mean()

# %%
# A tensioner on the tibia
# ------------------------
# ``pull`` is a device that rests on the bone: the tibia gets the exact opposite of the pull. The strut is
# loaded before the fixation. ``attach`` is a rigid fixation, and keeps nearly all of the tension.

world, knee, strut, graft = build()
tensioner = graft.pull(-1, 80, knee, TIBIA, position=(0, 0, -0.02))
run(world, strut, graft)
print(f"pulled: graft {graft.tension.mean():.1f} N, joint {-strut.force:.1f} N")
tensioner.release()
graft.attach(-1, knee, TIBIA)
run(world, strut, graft)
print(f"fixed:  graft {graft.tension.mean():.1f} N, joint {-strut.force:.1f} N")
by_tensioner = graft.tension.mean()

# %%
times = [k / 240 for k in range(480)]
curves = [
    {"x": times, "y": [graft for graft, _ in history[:480]], "label": "graft, hand in the world"},
    {"x": times, "y": [graft for graft, _ in history[480:]], "label": "graft, tensioner on the tibia"},
    {
        "x": times,
        "y": [joint for _, joint in history[480:]],
        "label": "joint, tensioner on the tibia",
        "ls": "--",
    },
]
view.figure("fixation.png", curves=curves, xlabel="time [s]", ylabel="force [N]")

# %%
# Hardware that yields
# --------------------
# ``graft.fix(tunnel, "screw")`` and ``graft.fix(particle, body, link, position, "button", stiffness=...)``
# are springs that slip at their load. Published loads are in ``bullet_tendon.fixation.HARDWARE``.
