"""
A graft in my own knee's STL files
==================================

Two bones come as STL files. Two tunnels come as the points where a surgeon drilled. A graft is laid through
both tunnels, fixed to the femur, and pulled below the tibia.
"""

import struct

import numpy as np
import pybullet as p

import bullet_tendon as bt
from bullet_tendon import view

# %%
# The files
# ---------
# With files of your own, leave this step out. The files must be in the frame of the tunnels' points. Files
# from segmentation are often in millimetres: ``SCALE`` is 0.001 then. Here the bones of the package are
# written as STL files, so that the program runs anywhere.

SCALE = 1.0  # metres in a unit of the files


def write_stl(path, obj_file):
    with open(obj_file) as file:
        rows = [line.split() for line in file]
    vertices = np.array([row[1:] for row in rows if row and row[0] == "v"], float)
    faces = [[int(corner.split("/")[0]) - 1 for corner in row[1:]] for row in rows if row and row[0] == "f"]
    with open(path, "wb") as file:
        file.write(bytes(80) + struct.pack("<I", len(faces)))
        for face in faces:
            a, b, c = vertices[face]
            normal = np.cross(b - a, c - a)
            file.write(struct.pack("<12fH", *normal / np.linalg.norm(normal), *a, *b, *c, 0))


write_stl("femur.stl", bt.data_path("meshes/femur.obj"))
write_stl("tibia.stl", bt.data_path("meshes/tibia.obj"))

# %%
# The bones
# ---------
# pybullet loads a file as triangles with ``GEOM_FORCE_CONCAVE_TRIMESH``. Without this flag it makes a convex
# hull. pybullet does not give the triangles back. Therefore ``add_obstacle`` gets the file and its scale as
# well.

client = p.connect(p.DIRECT)
p.setGravity(0, -9.81, 0)  # in these files y points up the leg
world = bt.TendonWorld(client)


def load_bone(path):
    file = {"fileName": path, "meshScale": 3 * [SCALE]}
    collision = p.createCollisionShape(p.GEOM_MESH, **file, flags=p.GEOM_FORCE_CONCAVE_TRIMESH)
    visual = p.createVisualShape(p.GEOM_MESH, **file, rgbaColor=(0.93, 0.89, 0.78, 1))
    body = p.createMultiBody(0, collision, visual)
    world.add_obstacle(body, friction=0.5, meshes=[(path, SCALE)])
    return body


femur, tibia = load_bone("femur.stl"), load_bone("tibia.stl")

# %%
# The tunnels
# -----------
# Each tunnel is a straight bore of radius 4 mm. Its ends are in the frame of the bone, in metres. If its
# unit is not that of the bone, the graft touches nothing: ``print(world.describe())`` tells that.

below, plateau = np.array([0.02146, -0.05099, -0.01581]), np.array([0.005, -0.02248, -0.002])
notch, lateral = np.array([-0.004, -0.0005, 0.00968]), np.array([0.00368, 0.03139, 0.03005])
tibial = world.add_tunnel(tibia, -1, below, plateau, radius=0.004, chamfer=0.0005, name="tibial")
femoral = world.add_tunnel(femur, -1, notch, lateral, radius=0.004, chamfer=0.0005, name="femoral")

# %%
# The graft
# ---------
# The graft begins 30 mm below the tibial tunnel and ends at the outer mouth of the femoral one. A force of
# 80 N along the tibial tunnel pulls its free end.

down = (below - plateau) / np.linalg.norm(below - plateau)
way = [below + 0.03 * down, below, plateau, notch, lateral]
graft = world.add_tendon(way, 0.0035, bt.Material.preset("hamstring_graft"), particles=60, name="graft")
button = graft.attach(-1, femur)
graft.set_force(0, 80 * down)
world.step(240)  # 1 s

tension = graft.tension
print(f"tension at the free end {tension[0]:.1f} N, at the button {tension[-1]:.1f} N")
print(f"force on the button {np.linalg.norm(button.force):.1f} N")
for name, bone in (("tibia", tibia), ("femur", femur)):
    print(f"force on the {name}: {np.linalg.norm(world.wrench(bone)[:3]):.1f} N")

print(f"converged: {world.report.converged}")

# %%
# Friction at the mouths of the tunnels holds back a part of the tension. The force on the femur includes
# that on the button.

camera = {"target": (0.0, -0.008, 0), "distance": 0.24, "yaw": 35, "pitch": 8, "up": "y"}
bores = [(*tunnel.ends, tunnel.radius) for tunnel in world.tunnels]
view.save_png("graft.png", view.render_scene(client, camera, [femur, tibia], [graft], bores))
