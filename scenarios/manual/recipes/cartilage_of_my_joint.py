"""
Cartilage between my own surfaces
=================================

pybullet has no contact between two concave meshes, and its contact is rigid. Cartilage is an elastic layer:
the deeper two surfaces are in each other, the more they press. A layer on a stiff bone presses each point
by itself (an elastic foundation), with p = K depth.
"""

import numpy as np
import pybullet as p

import bullet_tendon as bt
from bullet_tendon import view

client = p.connect(p.DIRECT)
world = bt.TendonWorld(client)

# %%
# The surfaces
# ------------
# A surface is the path of an STL or OBJ file, or its vertices [m] and triangles, in the frame of its link.
# Faces look outwards. Surfaces may be open, as segmented cartilage is. Here a round condyle stands on a
# flat plateau.

RADIUS = 0.03  # m


def condyle(rings=60, turns=160, opening=0.5):
    """The lower part of a sphere about the origin, which looks down."""
    tilt = np.linspace(0, opening, rings + 1)[1:, None]
    turn = np.linspace(0, 2 * np.pi, turns, endpoint=False)
    circles = np.stack(
        np.broadcast_arrays(np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), -np.cos(tilt)), -1
    )
    vertices = RADIUS * np.vstack([(0, 0, -1), circles.reshape(-1, 3)])
    index = 1 + np.arange(rings * turns).reshape(rings, turns)
    beside = np.roll(index, -1, axis=1)
    tip = np.stack([np.zeros(turns, int), beside[0], index[0]], -1)
    inner, outer = (index[:-1], beside[:-1]), (index[1:], beside[1:])
    first = np.stack([inner[0], inner[1], outer[1]], -1)
    second = np.stack([inner[0], outer[1], outer[0]], -1)
    return vertices, np.vstack([tip, first.reshape(-1, 3), second.reshape(-1, 3)])


corners = np.array([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]) * 0.03
plateau = corners, np.array([(0, 1, 2), (0, 2, 3)])

# %%
# The bodies
# ----------
# The bodies need no collision shapes. Where they have some, pybullet's contact between the two is switched
# off by ``p.setCollisionFilterPair``.

tibia = p.createMultiBody(0)
femur = p.createMultiBody(2.0, basePosition=(0, 0, RADIUS))
p.changeDynamics(femur, -1, localInertiaDiagonal=(2e-3, 2e-3, 2e-3), angularDamping=5)

cartilage = world.add_cartilage(
    (tibia, -1, plateau),
    (femur, -1, condyle()),
    modulus=10e6,  # Pa
    poisson=0.45,
    thickness=0.006,  # m, of both layers together
    damping=2.0,  # s/m
)
print(f"K = {cartilage.foundation:.3g} Pa/m")

# %%
# The law
# -------
# A sphere that is at a depth d in an elastic foundation has pressed an area of 2 pi R d, with a force of pi
# K R d^2 and a greatest pressure of K d. Keep d within the rim of the surfaces, and below the thickness: a
# step that presses farther gives a ``CartilageWarning``. With ``law="logarithmic"`` the pressure grows
# without bound towards the thickness, as that of a layer that cannot be pressed flat.

measured = []
print("  force     depth      area   pressure")
for load in (10, 30, 100, 300, 600):
    for _ in range(240):
        place = p.getBasePositionAndOrientation(femur)[0]
        world.apply_external_force(femur, -1, (0, 0, -load), place, p.WORLD_FRAME)
        world.step()
    depth = RADIUS - p.getBasePositionAndOrientation(femur)[0][2]
    force = cartilage.wrench[2]
    measured.append((load, depth, force, cartilage.area, cartilage.max_pressure))
    area, pressure = 1e6 * cartilage.area, 1e-6 * cartilage.max_pressure
    print(f"{force:6.1f} N {1e3 * depth:6.3f} mm {area:5.1f} mm^2 {pressure:6.3f} MPa")

# %%
depths = np.linspace(0, 1.05 * measured[-1][1], 100)
curves = [
    {"x": 1e3 * depths, "y": np.pi * cartilage.foundation * RADIUS * depths**2, "label": "law"},
    {
        "x": [1e3 * row[1] for row in measured],
        "y": [row[2] for row in measured],
        "label": "cartilage",
        "ls": "",
        "marker": "o",
    },
]
view.figure("foundation.png", curves=curves, xlabel="depth [mm]", ylabel="force [N]")

# %%
# ``cartilage.regions`` tells the same of each connected patch of the second surface: of the medial and of
# the lateral compartment of a knee. Measuring the distance to a mesh takes a second or so; ``cache=True``
# keeps it in a file beside the mesh.
