"""Extensor: a patella with its tendon and a quadriceps line, for a KneeRig of the project's knee.

The patella is an ellipsoid of the size of a man's, a free body that glides on the femur's cartilage. Five
strands join it to the tibia's tuberosity. Three lines of given tension are the quadriceps: along the shaft of
the femur, and around the trochlea where the knee is flexed. Two strands beside it hold it in the groove.
"""

import os
import tempfile

import numpy as np
import pybullet as p

import bullet_tendon as bt

from .knee_files import own

# Half the thickness, height and width of the patella. Means of men: 20 to 23, 37 to 40, 42 to 44 mm overall
# (textbook values). m
HALF = np.array([0.010, 0.019, 0.021])
MASS, INERTIA = 0.03, 4e-6  # kg, kg m^2
START = (0.0445, 0.0140, 0.003), np.radians(5.0)  # in the femur, at 10 degrees of flexion: m, rad
# Slope and slack length of a strand of the patellar tendon: means of those of lenhart2015 (3,000 N, 41 to 52
# mm). Insertion: the tuberosity, 28 mm below the plateau.
TENDON_SLOPE, TENDON_SLACK, TENDON_WIDTH = 3000.0, 0.0435, 0.016  # N, m, m
POLE, TUBEROSITY = (-0.002, -0.018), (0.0315, -0.050)  # x, y of the strands' ends [m]
TENDON_ASIDE = 0.003  # of the tuberosity, lateral [m]
BASE, ORIGIN = (0.001, 0.018), (0.030, 0.250)  # x, y of the quadriceps' ends [m]
RETINACULUM = 1500.0  # slope of a strand [N]
EPICONDYLES = (-0.004, 0.004, 0.041)  # m; the last on both sides
TROCHLEA, RADIUS = (0.012, 0.004, 0.0), 0.027  # axis and radius of what the quadriceps wraps around [m]


class Extensor:
    """What extends a knee: patella (bodyUniqueId), tendon and quadriceps (ligaments), cartilage.

    rig: a KneeRig of the project's knee, flexed by about 10 degrees. Nothing pulls at first.
    """

    def __init__(self, rig):
        self._rig, world = rig, rig.world
        self._client = rig.client
        with tempfile.TemporaryDirectory() as folder:
            mesh = os.path.join(folder, "patella.obj")
            _write_ellipsoid(mesh, HALF)
            self.patella = self._make_patella(mesh)
            femoral = (*rig.femur, str(own("meshes/femur_cartilage.obj")))
            self.cartilage = world.add_cartilage(femoral, (self.patella, -1, mesh), name="patellofemoral")
        tendon = bt.Material.ligament(TENDON_SLOPE)
        self.tendon = [
            world.add_ligament(
                [
                    (self.patella, -1, (*POLE, 0.8 * aside)),
                    (*rig.tibia, (*TUBEROSITY, TENDON_ASIDE + aside)),
                ],
                tendon,
                TENDON_SLACK,
                f"PT{k + 1}",
            )
            for k, aside in enumerate(np.linspace(-0.5, 0.5, 5) * TENDON_WIDTH)
        ]
        trochlea = world.add_wrap(*rig.femur, ("cylinder", RADIUS), TROCHLEA, (0, 0, 0, 1))
        self.quadriceps = [
            world.add_ligament(
                [(self.patella, -1, (*BASE, aside)), (*rig.femur, (*ORIGIN, TENDON_ASIDE + 2 * aside))],
                bt.Material(stiffness=1.0),
                name=f"quadriceps {k + 1}",
                wraps=(trochlea,),
            )
            for k, aside in enumerate((-0.01, 0.0, 0.01))
        ]
        for side in (-1, 1):
            ends = (0.0, 0.004, 0.020 * side), (*EPICONDYLES[:2], EPICONDYLES[2] * side)
            path = [(self.patella, -1, ends[0]), (*rig.femur, ends[1])]
            world.add_ligament(path, bt.Material.ligament(RETINACULUM), name=f"retinaculum {side:+d}")
        self.pull(0.0)

    def pull(self, force: float) -> None:
        """Pull with a force of the quadriceps [N], in equal shares of its lines."""
        for line in self.quadriceps:
            line.set_tension(force / len(self.quadriceps))

    @property
    def forces(self) -> dict[str, float]:
        """Of the patellar tendon, the quadriceps, and the cartilage behind the patella [N]."""
        return {
            "PT": sum(strand.force for strand in self.tendon),
            "quadriceps": sum(line.force for line in self.quadriceps),
            "patellofemoral": float(np.linalg.norm(self.cartilage.wrench[:3])),
        }

    def _make_patella(self, mesh: str) -> int:
        client = self._client
        origin, turn = p.getBasePositionAndOrientation(self._rig.femur[0], client)
        place, tilt = START
        at = p.multiplyTransforms(origin, turn, place, p.getQuaternionFromEuler((0, 0, tilt - np.pi / 18)))
        look = p.createVisualShape(
            p.GEOM_MESH, fileName=mesh, rgbaColor=(0.93, 0.89, 0.78, 1), physicsClientId=client
        )
        body = p.createMultiBody(MASS, -1, look, *at, physicsClientId=client)
        quiet = {"linearDamping": 0, "angularDamping": 0, "localInertiaDiagonal": [INERTIA] * 3}
        p.changeDynamics(body, -1, **quiet, physicsClientId=client)
        return body


def _write_ellipsoid(path: str, half, rings: int = 24, columns: int = 40) -> None:
    """An OBJ file of a closed ellipsoid around the origin; half (3,): its half axes [m]."""
    polar = np.pi * np.arange(1, rings) / rings
    around = 2 * np.pi * np.arange(columns) / columns
    height, ring = np.cos(polar)[:, None], np.sin(polar)[:, None]
    sides = np.stack([ring * np.cos(around), height + 0 * around, ring * np.sin(around)], axis=-1)
    points = half * np.vstack([[0, 1, 0], sides.reshape(-1, 3), [0, -1, 0]])
    first, last = 1, len(points)  # numbers of the poles in the file
    faces = []
    for j in range(columns):
        k = (j + 1) % columns
        faces.append((first, 2 + k, 2 + j))
        for i in range(rings - 2):
            a, b, c, d = (2 + i * columns + j, 2 + i * columns + k, 2, 2)
            c, d = a + columns, b + columns
            faces += [(a, b, d), (a, d, c)]
        base = 2 + (rings - 2) * columns
        faces.append((last, base + j, base + k))
    with open(path, "w", encoding="utf-8") as file:
        file.writelines(f"v {x:.7f} {y:.7f} {z:.7f}\n" for x, y, z in points)
        file.writelines(f"f {a} {b} {c}\n" for a, b, c in faces)
