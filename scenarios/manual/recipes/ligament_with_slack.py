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
# Two bones stand 30 mm apart. Here they are small spheres without mass: something else moves them.
# ``slope`` is the stiffness beyond the toe, in newtons per unit strain. ``rest_length`` is the slack length.
# ``collides=False`` leaves the ligament out of all contacts. Two particles are enough for a straight strand.

sphere = p.createCollisionShape(p.GEOM_SPHERE, radius=0.002)
femur = p.createMultiBody(0, sphere, -1, (0, 0, 0.030))
tibia = p.createMultiBody(0, sphere, -1, (0, 0, 0))

material = bt.Material.ligament(slope=2000, toe_strain=0.06, damping=0)
ligament = world.add_tendon(
    [(0, 0, 0), (0, 0, 0.030)], 0.002, material, rest_length=0.032, collides=False, name="ligament"
)
on_tibia, on_femur = ligament.attach(0, tibia), ligament.attach(1, femur)

# %%
# The femur moves away in steps of 1 mm. The force on it is compared with the law.


def law(length, slack=0.032, slope=2000, toe=0.06):
    strain = max(0, length / slack - 1)
    return slope * (strain**2 / (2 * toe) if strain < toe else strain - toe / 2)


forces = {}
print("length    force       law")
for length in np.arange(0.030, 0.0361, 0.001):
    p.resetBasePositionAndOrientation(femur, (0, 0, length), (0, 0, 0, 1))
    world.step(5)
    forces[length] = abs(on_femur.force[2])
    print(f"{1e3 * length:4.0f} mm {forces[length]:7.2f} N {law(length):7.2f} N")

# %%
ways = np.linspace(0.030, 0.036, 200)
curves = [
    {"x": 1e3 * ways, "y": [law(length) for length in ways], "label": "law"},
    {
        "x": [1e3 * length for length in forces],
        "y": list(forces.values()),
        "label": "ligament",
        "ls": "",
        "marker": "o",
    },
]
view.figure("law.png", curves=curves, xlabel="length [mm]", ylabel="force [N]")

# %%
# Damping was set to zero here, because the femur jumps from place to place. ``Material.ligament`` has a
# damping of 0.003 ``slope`` by default.
