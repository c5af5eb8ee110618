"""
A ligament with a slack length
==============================

A ligament carries nothing until it is as long as its slack length. Beyond that its stiffness grows up to the
toe strain, and stays constant from there on (Blankevoort 1991).
"""

import numpy as np
import pybullet as p

import bullet_tendon as bt
from bullet_tendon import view

client = p.connect(p.DIRECT)
world = bt.TendonWorld(client)

# %%
# The bones
# ---------
# The tibia stands still. The femur hangs on the ligament below, and is pulled away from it. Here both are
# small spheres.

sphere = p.createCollisionShape(p.GEOM_SPHERE, radius=0.005)
tibia = p.createMultiBody(0, sphere)
femur = p.createMultiBody(1.0, sphere, -1, (0, 0, -0.030))

# %%
# The ligament
# ------------
# A ligament has no mass and no particles. It is a line along points of links, in the links' frames, and acts
# on the bodies implicitly. ``slope`` is the stiffness beyond the toe, in newtons per unit strain.
# ``rest_length`` is the slack length: the ligament begins 2 mm slack.

SLOPE, TOE, SLACK = 2000, 0.06, 0.032  # N, -, m
material = bt.Material.ligament(slope=SLOPE, toe_strain=TOE)
path = [(tibia, -1, (0, 0, 0)), (femur, -1, (0, 0, 0))]
ligament = world.add_ligament(path, material, rest_length=SLACK, name="ligament")

# %%
# The law
# -------
# The femur is pulled with a force that grows slowly, so that it is at rest at each force.


def law(length):
    strain = max(0, length / SLACK - 1)
    return SLOPE * (strain**2 / (2 * TOE) if strain < TOE else strain - TOE / 2)


measured = []
print("   force   length    strain     law")
for load in (1, 10, 30, 60, 90, 120):
    for _ in range(240):
        place = p.getBasePositionAndOrientation(femur)[0]
        world.apply_external_force(femur, -1, (0, 0, -load), place, p.WORLD_FRAME)
        world.step()
    length, force = ligament.length, ligament.force
    measured.append((length, force))
    print(f"{force:6.1f} N {1e3 * length:5.2f} mm {ligament.strain:8.2%} {law(length):6.1f} N")

# %%
lengths, forces = np.transpose(measured)
ways = np.linspace(0.030, 1.01 * lengths[-1], 200)
curves = [
    {"x": 1e3 * ways, "y": [law(length) for length in ways], "label": "law"},
    {"x": 1e3 * lengths, "y": forces, "label": "ligament", "ls": "", "marker": "o"},
]
view.figure("law.png", curves=curves, xlabel="length [mm]", ylabel="force [N]")

# %%
# A ligament can go round a bone by further points in its path, through which it slides freely. It touches
# nothing. A strand that has to touch bones is a tendon: ``add_tendon(rest_length=...)``.
