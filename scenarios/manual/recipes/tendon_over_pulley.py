"""
A tendon over a pulley
======================

A tendon runs over a cylinder that does not turn. Friction lets its two ends carry different loads. A hand
pulls one end slowly, and a weight of 1 kg hangs on the other.
"""

import numpy as np
import pybullet as p

import bullet_tendon as bt
from bullet_tendon import view

client = p.connect(p.DIRECT)
p.setGravity(0, 0, -9.81)
world = bt.TendonWorld(client)

# %%
# The coefficient of a pair is the product of the tendon's and the body's. Let the obstacle have 1.

drum_radius, radius, mu = 0.03, 0.002, 0.2
turn = p.getQuaternionFromEuler((np.pi / 2, 0, 0))  # a cylinder's axis is z; here it is y
cylinder = p.createCollisionShape(p.GEOM_CYLINDER, radius=drum_radius, height=0.06)
drum = p.createMultiBody(0, cylinder, -1, (0, 0, 0), turn)
world.add_obstacle(drum, friction=1.0)

# %%
# The tendon begins along an arc that touches the cylinder. Its chords turn by 4 degrees at each particle.

r = drum_radius + radius
angles = np.radians(np.arange(0, 181, 4))
arc = np.c_[r * np.cos(angles), np.zeros(len(angles)), r * np.sin(angles)]
points = np.vstack([(r, 0, -0.10), arc, (-r, 0, -0.10)])
material = bt.Material(stiffness=2e4, damping=20, friction=mu)
tendon = world.add_tendon(points, radius, material, particles=120)

weight = p.createMultiBody(1.0, p.createCollisionShape(p.GEOM_SPHERE, radius=0.012), -1, points[-1])
tendon.attach(-1, weight, position=(0, 0, 0))
hand = tendon.grip(0)

# %%
# The hand pulls at 10 mm/s. Once the tendon slides, the ratio of the tensions is e^(mu phi).

for _ in range(480):
    hand.target = hand.target - (0, 0, 0.010 / 240)
    world.step()

contact = world.contacts
pulled, loaded = tendon.tension[0], tendon.tension[-1]
print(f"hand {pulled:.2f} N, weight {loaded:.2f} N")
print(f"ratio {pulled / loaded:.3f}, e^(mu pi) = {np.exp(mu * np.pi):.3f}")
print(f"{len(contact)} contacts, sum of normal forces {contact['normal_force'].sum():.1f} N")

# %%
camera = {"target": (0, 0, -0.03), "distance": 0.22, "yaw": 20, "pitch": -15}
view.save_png("pulley.png", view.render_scene(client, camera, [], [tendon]))
