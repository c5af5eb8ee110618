"""A tendon is drawn tight around a condyle of the femur, to 500 N and then to 2,000 N.

The tendon is laid in a sagittal plane around the distal end, along the outline of a slab of bone as thick as
itself. One end is held, the other one is drawn by a hand until it feels the load. Nowhere does the bone's
surface come deeper into it than a hundredth of its radius (two hundredths at 2,000 N), as measured from the
mesh itself, and few distances have to be asked for.
"""

from pathlib import Path

import numpy as np
import pybullet as p
from scipy.spatial import ConvexHull

import bullet_tendon as bt
from bullet_tendon.mesh_files import read_mesh

from . import measure
from .scene import Check, Scene

# The real bone, where it lies beside the folder that this is run in.
REAL = Path("..") / "shared" / "knee" / "femur.stl"
RADIUS, SEGMENT = 0.004, 0.002  # m
FRICTION = 0.2  # both coefficients multiplied: with less it slips off a round condyle
STIFFNESS = 6e4  # N per strain
LOADS = (500.0, 2000.0)  # N
DEEPEST = (0.01, 0.02)  # of the radius, at these
RAMP, REST = 480, 120  # steps, in which a load grows, and stays
# Where the ends are: anterior and posterior of the femur, and so high [m].
FRONT, BACK = (0.066, 0.045), (-0.048, 0.045)
TOP = 0.015  # m: what is higher up of the bone is not in the way
BONE_COLOR = (0.93, 0.89, 0.78, 1.0)
SLACK = 0.0005  # m, that is left between tendon and bone


def build(options) -> Scene:
    scene = Scene(options, gravity=0.0)
    h = scene.handles
    file = REAL if REAL.exists() else Path(bt.data_path("meshes/femur.obj"))
    mesh = read_mesh(file)
    h.triangles = np.asarray(mesh.vertices)[mesh.triangles]
    shape = p.createCollisionShape(
        p.GEOM_MESH, fileName=str(file), flags=p.GEOM_FORCE_CONCAVE_TRIMESH, physicsClientId=scene.client
    )
    bone = p.createMultiBody(0, shape, physicsClientId=scene.client)
    p.changeVisualShape(bone, -1, rgbaColor=BONE_COLOR, physicsClientId=scene.client)
    scene.bones, scene.names = [bone], {bone: "femur"}
    scene.world.add_obstacle(bone, friction=1.0, meshes=[str(file)])
    line = _around(np.asarray(mesh.vertices))
    material = bt.Material(stiffness=STIFFNESS, damping=10.0, density=1120.0, friction=FRICTION)
    count = round(np.linalg.norm(np.diff(line, axis=0), axis=1).sum() / SEGMENT)
    h.tendon = scene.world.add_tendon(line, RADIUS, material, count + 1, "wrapped")
    h.tendon.grip(0)
    h.hand = h.tendon.grip(-1)
    h.pull = (line[-1] - line[-2]) / np.linalg.norm(line[-1] - line[-2])
    scene.camera = {"target": (0.005, 0.035, 0), "distance": 0.3, "yaw": 30, "pitch": 8, "up": "y", "fov": 40}
    scene.labels.update(xlabel="along the tendon [mm]", ylabel="depth [% of the radius]")
    scene.labels.update(title=f"Around the {'real' if REAL.exists() else 'model'} femur's condyle")
    return scene


def drive(scene, progress) -> None:
    h = scene.handles
    asked = considered = 0
    previous = 0.0
    for load in LOADS:
        for k in progress(range(RAMP + REST), f"{load:.0f} N"):
            wanted = previous + (load - previous) * min(1.0, (k + 1) / RAMP)
            missing = (wanted - h.tendon.tension[-1]) / STIFFNESS
            h.hand.target = h.hand.target + 0.5 * h.tendon.rest_length * missing * h.pull
            scene.step()
            counts = scene.world.report.counts
            asked += counts["pairs_queried"]
            considered += counts["pairs_considered"] + counts["pairs_skipped"] + counts["pairs_reused"]
        previous = load
        _measure(scene, load)
        scene.mark(f"{load:.0f} N")
    scene.measure("distances asked for, a step", asked / scene.steps)
    scene.measure("pairs near enough to ask, a step", considered / scene.steps)


def check(scene) -> list[Check]:
    checks = [
        Check.at_most(f"depth at {load:.0f} N", scene.measured[f"depth at {load:.0f} N"], most)
        for load, most in zip(LOADS, DEEPEST, strict=True)
    ]
    checks += [
        Check.at_most(
            f"tension at {load:.0f} N, error",
            abs(scene.measured[f"tension in the drawn end at {load:.0f} N"] / load - 1),
            1e-2,
        )
        for load in LOADS
    ]
    wraps = scene.measured["wrapped by"]
    return [*scene.health(), *checks, Check.at_least("wrapped by", wraps, 60.0)]


def _measure(scene, load) -> None:
    """Depth of the surface in the tendon, from the triangles, at particles and between them."""
    t = scene.handles.tendon
    x = t.positions
    x = np.insert(x, np.arange(1, len(x)), (x[1:] + x[:-1]) / 2, axis=0)
    depths = 1 - np.array([measure.to_triangles(point, scene.handles.triangles) for point in x]) / RADIUS
    for k, depth in enumerate(depths):
        if depth > -0.5:
            scene.record(f"{load:.0f} N", 100 * depth, 1e3 * SEGMENT / 2 * k)
    scene.measure(f"depth at {load:.0f} N", depths.max(), "radii")
    ends = np.array([x[0] - x[4], x[-1] - x[-5]])
    ends /= np.linalg.norm(ends, axis=1)[:, None]
    scene.measure("wrapped by", 180 - np.degrees(np.arccos(np.clip(ends[0] @ ends[1], -1, 1))), "degrees")
    scene.measure(f"tension in the drawn end at {load:.0f} N", t.tension[-1], "N")
    scene.measure(f"tension in the held end at {load:.0f} N", t.tension[0], "N")


def _around(vertices) -> np.ndarray:
    """A line (m, 3) from FRONT around the distal end to BACK, through the middle of the lateral condyle."""
    lateral = vertices[vertices[:, 2] > 0]
    lowest = lateral[lateral[:, 1] < lateral[:, 1].min() + 0.004, 2]
    aside = (lowest.min() + lowest.max()) / 2
    slab = vertices[np.abs(vertices[:, 2] - aside) < 1.5 * RADIUS, :2]
    angles = np.linspace(0, 2 * np.pi, 48, endpoint=False)
    rim = (RADIUS + SLACK) * np.c_[np.cos(angles), np.sin(angles)]
    grown = (slab[:, None] + rim).reshape(-1, 2)
    points = np.vstack([[FRONT, BACK], grown[grown[:, 1] < TOP]])
    hull = list(ConvexHull(points).vertices)  # counter-clockwise
    hull = hull[hull.index(1) :] + hull[: hull.index(1)]  # from BACK, below the bone, to FRONT
    path = points[hull[: hull.index(0) + 1]][::-1]
    return np.c_[path, np.full(len(path), aside)]
