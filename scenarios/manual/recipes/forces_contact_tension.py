"""
Reading forces, contact and tension
===================================

A tendon lies over a box and carries a weight. After each step all forces can be read, in newtons, in the
world frame.
"""

import numpy as np
import pybullet as p

import bullet_tendon as bt
from bullet_tendon import view

client = p.connect(p.DIRECT)
p.setGravity(0, 0, -9.81)
world = bt.TendonWorld(client)

block = p.createCollisionShape(p.GEOM_SPHERE, radius=0.03)
ball = p.createMultiBody(0, block)
world.add_obstacle(ball, friction=1.0)

angles = np.linspace(0, np.pi, 40)
arc = 0.032 * np.c_[np.cos(angles), np.zeros(40), np.sin(angles)]
points = np.vstack([(0.032, 0, -0.06), arc, (-0.032, 0, -0.06)])
tendon = world.add_tendon(points, 0.002, bt.Material(stiffness=1e4, damping=20, friction=0.2), particles=70)
hand = tendon.grip(0)
weight = p.createMultiBody(0.5, p.createCollisionShape(p.GEOM_SPHERE, radius=0.01), -1, points[-1])
knot = tendon.attach(-1, weight, position=(0, 0, 0))
world.step(480)

# %%
# Of a tendon
# -----------
# ``tension`` and ``strain`` have one value for each segment, ``positions`` and ``velocities`` one row for
# each particle. Each read-out is a copy.

print(f"tension: {tendon.tension.shape}, from {tendon.tension.min():.2f} to {tendon.tension.max():.2f} N")
print(f"largest strain {tendon.strain.max():.2e}, length {1e3 * tendon.length:.2f} mm")

# %%
# Of hands and attachments
# ------------------------
# ``force`` is the force of the tendon on what holds it.

print(f"on the hand  {hand.force.round(2)} N")
print(f"on the weight {knot.force.round(2)} N")

# %%
# Of bodies
# ---------
# ``wrench`` is the force and the torque about the centre of mass of all tendons on a link, static links too.

print(f"on the ball: force {world.wrench(ball)[:3].round(2)} N, torque {world.wrench(ball)[3:].round(3)} N m")

# %%
# Of contacts
# -----------
# ``contacts`` is a numpy array with named fields. ``kind`` tells what is touched: "bone", "bore", "mouth" or
# "tendon".

contacts = world.contacts
print(contacts.dtype.names)
print(f"{len(contacts)} contacts of kind {set(contacts['kind'].tolist())}")
pressed = contacts["normal"] * contacts["normal_force"][:, None]
print(f"normal forces on the tendon add up to {pressed.sum(axis=0).round(2)} N")

# %%
# Balance: at rest, the forces of the tendon on the hand, the weight and the ball add up to its own weight.

total = hand.force + knot.force + world.wrench(ball)[:3]
print(f"sum of these forces {total[2]:.3f} N, weight of the tendon {-9.81 * tendon.masses.sum():.3f} N")

# %%
# Of the step
# -----------

report = world.report
camera = {"target": (0, 0, -0.02), "distance": 0.22, "yaw": 20, "pitch": -15}
view.save_png("forces.png", view.render_scene(client, camera, tendons=[tendon]))
print(f"{report.iterations} iterations, residual {report.residual:.0e}, ended by {report.ended_by}")
