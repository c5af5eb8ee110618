"""
A robot finger from my own URDF
===============================

A URDF file defines the links, the eyelets and the tendons. A motor reels in the flexor, and the finger bends.
"""

import numpy as np
import pybullet as p

import bullet_tendon as bt
from bullet_tendon import view

# %%
# The file
# --------
# Tunnels and tendons are children of ``<robot>``. pybullet's own loader ignores them. The tunnels here are
# the eyelets: one in the palm and one in the finger, both 6 mm below the hinge. The elements are listed on
# the page of the models.

with open("finger.urdf", "w") as file:
    file.write("""<?xml version="1.0"?>
<robot name="finger">
  <link name="palm">
    <inertial>
      <mass value="0.3"/><inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/>
    </inertial>
    <visual><origin xyz="-0.025 0 0"/><geometry><box size="0.04 0.02 0.008"/></geometry></visual>
  </link>
  <link name="phalanx">
    <inertial>
      <origin xyz="0.02 0 0"/>
      <mass value="0.03"/><inertia ixx="1e-6" iyy="4e-6" izz="4e-6" ixy="0" ixz="0" iyz="0"/>
    </inertial>
    <visual><origin xyz="0.025 0 0"/><geometry><box size="0.04 0.014 0.008"/></geometry></visual>
  </link>
  <joint name="knuckle" type="revolute">
    <parent link="palm"/><child link="phalanx"/><axis xyz="0 1 0"/>
    <limit lower="0" upper="1.5" effort="10" velocity="10"/><dynamics damping="0.0005"/>
  </joint>
  <tunnel name="palm eyelet" link="palm" radius="0.0015" friction="0" chamfer="0.002">
    <start xyz="-0.025 0 -0.006"/><end xyz="-0.006 0 -0.006"/>
  </tunnel>
  <tunnel name="finger eyelet" link="phalanx" radius="0.0015" friction="0" chamfer="0.002">
    <start xyz="0.006 0 -0.006"/><end xyz="0.025 0 -0.006"/>
  </tunnel>
  <tendon name="flexor" radius="0.0005" particles="100">
    <material stiffness="5e3" damping="2" friction="0.1"/>
    <point link="palm" xyz="-0.045 0 -0.006"/>
    <point link="phalanx" xyz="0.035 0 -0.006" attach="true"/>
  </tendon>
</robot>
""")

# %%
# The robot
# ---------
# Switch off pybullet's motors, which hold each joint by default. ``obstacles=False``: this finger has no
# collision shapes.

client = p.connect(p.DIRECT)
world = bt.TendonWorld(client)
flags = p.URDF_USE_INERTIA_FROM_FILE
finger = world.load_urdf("finger.urdf", useFixedBase=True, flags=flags, obstacles=False)
p.setJointMotorControl2(finger, 0, p.VELOCITY_CONTROL, force=0)
(flexor,) = world.tendons
motor = flexor.grip(0)

# %%
# The motion
# ----------
# ``shorten`` reels the tendon in at the motor's end. The finger bends downwards. Gravity is turned upwards,
# as for a hand that lies on its back, so that the tendon has to lift the finger.

REEL, STEPS = 0.012, 480  # m, in so many steps

p.setGravity(0, 0, 9.81)
print("reeled in   angle  tension")
for step in range(1, STEPS + 1):
    flexor.shorten(REEL / STEPS, end=0)
    world.step()
    if step % (STEPS // 4) == 0:
        angle = p.getJointState(finger, 0)[0]
        print(
            f"{1e3 * REEL * step / STEPS:6.1f} mm  {np.degrees(angle):5.1f} deg  {flexor.tension[0]:5.2f} N"
        )

# %%
camera = {"target": (0.0, 0, -0.012), "distance": 0.11, "yaw": 20, "pitch": -15}
bores = [(*tunnel.ends, tunnel.radius) for tunnel in world.tunnels]
view.save_png("finger.png", view.render_scene(client, camera, [finger], [flexor], bores))
