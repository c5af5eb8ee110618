"""
How loose is my knee?
=====================

``KneeRig`` is a rig for cadaver tests: it holds the flexion of a knee of ligaments and cartilage, and
leaves its other five freedoms free. Loads on the tibia show how loose the knee is, and what each ligament
carries.
"""

import numpy as np
from bullet_tendon.scenarios.knee import KneeRig

from bullet_tendon import view

# %%
# The knee
# --------
# Without arguments it is the knee of this package. Yours is made of STL files and a table::
#
#     KneeRig(bones="my_knee", ligaments="my_knee/ligaments.csv", cartilage="my_knee")
#
# The folder has ``femur.stl``, ``tibia.stl``, ``femur_cartilage.stl`` and ``tibia_cartilage.stl``, all in
# the frame of the extended knee in metres: x anterior, y superior, z lateral. ``help(KneeRig)`` names the
# table's columns.

rig = KneeRig()

# %%
# A Lachman test
# --------------
# The tibia is drawn forwards by 90 N at 30 degrees of flexion. ``settle`` lets the knee come to rest, and
# tells whether it has.


def drawer(degrees: float, force: float) -> float:
    """How far the tibia goes forwards under that force [N], from its unloaded place [mm]."""
    rig.flex(np.radians(degrees))
    rig.load()
    rig.settle()
    unloaded = rig.coordinates.anterior
    rig.load(anterior=force)
    rig.settle()
    return 1e3 * (rig.coordinates.anterior - unloaded)


forces = [0, 30, 60, 90]
intact = [drawer(30, force) for force in forces]
shares = dict(rig.forces)
print(f"intact: {intact[-1]:.1f} mm under {forces[-1]} N")
for group, force in sorted(shares.items(), key=lambda item: -item[1])[:5]:
    print(f"  {group:12} {force:6.1f} N")

# %%
# Without its ACL
# ---------------
# ``cut`` takes out a ligament: all groups of strands whose names begin with this.

rig.cut("ACL")
cut = [drawer(30, force) for force in forces]
print(f"ACL cut: {cut[-1]:.1f} mm under {forces[-1]} N")

# %%
curves = [
    {"x": intact, "y": forces, "label": "intact", "marker": "o"},
    {"x": cut, "y": forces, "label": "ACL cut", "marker": "o"},
]
view.figure("laxity.png", curves=curves, xlabel="anterior drawer [mm]", ylabel="force [N]")

# %%
# ``rig.world`` is a usual TendonWorld: tunnels, tendons and fixations are added to ``rig.femur`` and
# ``rig.tibia``. The scenarios ``knee_laxity``, ``passive_flexion`` and ``tunnel_placement`` go on from
# here.
