"""
A suture and a knot
===================

A suture is laid as an overhand knot and pulled tight by two hands. The knot holds by contact of the suture
with itself.
"""

import numpy as np
import pybullet as p

import bullet_tendon as bt
from bullet_tendon import view

client = p.connect(p.DIRECT)
world = bt.TendonWorld(client)

# %%
# The centreline is a trefoil that is cut open, with straight ends. A suture needs a bending stiffness:
# without it nothing rounds the knot's turns. Its particles must be nearer to each other than it is thick.

radius, length = 0.0005, 0.12
t = np.linspace(-0.9, 0.9, 200) * np.pi
loop = 0.0036 * np.c_[np.sin(t) + 2 * np.sin(2 * t), np.cos(t) - 2 * np.cos(2 * t), -1.5 * np.sin(3 * t)]
first = loop[0] + (0.020, -0.015, 0)
last = loop[-1] + (-0.020, -0.015, 0)
material = bt.Material(
    stiffness=600, damping=0.01, damping_form="whole", bending_stiffness=1e-6, friction=0.3
)
suture = world.add_tendon(np.vstack([first, loop, last]), radius, material, particles=201, name="suture")

camera = {"target": (0, -0.004, 0), "distance": 0.075, "yaw": 0, "pitch": -70}
view.save_png("1_loose.png", view.render_scene(client, camera, [], [suture]))

# %%
# Each hand has a largest force of 5 N. It leads its end away until the knot holds against it.

hands = [suture.grip(0, max_force=5), suture.grip(-1, max_force=5)]
for _ in range(960):
    for hand, way in zip(hands, (1, -1), strict=True):
        hand.target = hand.target + (way * 0.025 / 240, 0, 0)
    world.step()

touching = world.contacts
print(f"tension at the ends {suture.tension[0]:.2f} N and {suture.tension[-1]:.2f} N")
print(f"{len(touching)} contacts, the largest {touching['normal_force'].max():.2f} N")
print(f"centrelines at least {(2 * radius + touching['distance'].min()) / (2 * radius):.3f} diameters apart")

# %%
# The last line tells that the suture did not pass through itself.

camera["target"] = suture.positions[suture.particles // 2]
camera["distance"] = 0.02
view.save_png("2_tight.png", view.render_scene(client, camera, [], [suture]))
