"""
A multi-strand graft
====================

A hamstring graft of four strands lies side by side between two bones. One strand was cut 1 mm shorter than
the others. It carries more than its share.
"""

import numpy as np
import pybullet as p

import bullet_tendon as bt
from bullet_tendon import view

client = p.connect(p.DIRECT)
world = bt.TendonWorld(client)

# %%
# The four strands have the cross-section of the whole graft, 57 mm^2. Each one has a quarter of it, and a
# quarter of the slope of the law. The strands lie as the corners of a square, and do not overlap. Strands
# that overlap where they begin are pushed apart.

area = 57e-6 / 4
radius = np.sqrt(area / np.pi)
material = bt.Material.ligament(slope=1.5e9 * area, toe_strain=0.03)
corners = 1.02 * radius * np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)])

strands = []
for k, (x, y) in enumerate(corners):
    cut = 0.100 - (0.001 if k == 0 else 0)
    line = [(x, y, 0), (x, y, 0.1)]
    strands.append(world.add_tendon(line, radius, material, 30, f"strand {k + 1}", rest_length=cut))

# %%
# One hand holds the lower ends. The upper ends are attached to one bone, which is pulled with 400 N.

sphere = p.createCollisionShape(p.GEOM_SPHERE, radius=0.01)
bone = p.createMultiBody(0.5, sphere, -1, (0, 0, 0.1))
for strand in strands:
    strand.grip(0)
    strand.attach(-1, bone)

for _ in range(480):
    world.apply_external_force(bone, -1, (0, 0, 400), p.getBasePositionAndOrientation(bone)[0], p.WORLD_FRAME)
    world.step()

forces = [strand.tension.mean() for strand in strands]
for strand, force in zip(strands, forces, strict=True):
    print(f"{strand.name}: {force:6.1f} N, {force / sum(forces):5.1%}, strain {strand.strain.mean():.2%}")

print(f"all: {sum(forces):.1f} N")

# %%
# The bone is free to turn. Therefore the torques about its centre are in balance: each strand carries as much
# as the one at the opposite corner, and the two that are not cut beside the short one carry less.

camera = {"target": (0, 0, 0.05), "distance": 0.13, "yaw": 30, "pitch": -15, "width": 640, "height": 640}
view.save_png("strands.png", view.render_scene(client, camera, [], strands))
