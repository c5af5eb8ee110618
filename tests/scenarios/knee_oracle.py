"""Quasi-static knee by numpy and scipy alone: ligament strands, an elastic foundation, held flexion.

Nothing of the package is used here. The femur is fixed. The tibia's pose in the femur's frame is
R = Rz(-flexion) Rx(adduction) Ry(internal rotation) and the place of the tibia's origin; flexion is held, the
other five are found where all forces balance. Units are SI; x anterior, y superior, z to the right.

- A strand is straight between its insertions, or passes around a cylinder of one bone by the shortest way:
  its tangents and a helix between. With the strain e = (length - slack)/slack it carries, after
  Blankevoort and Huiskes (1991), k e^2/(2 t) for 0 < e <= t and k (e - t/2) beyond, t = 0.06.
- The contact is a linear elastic foundation: each triangle of the tibia's surface, of area A, whose centroid
  is at the depth d inside the femur's surface, is pushed out by K A d along the gradient of the exact signed
  distance, K = E (1 - nu)/((1 + nu)(1 - 2 nu))/thickness.
"""

import csv
import dataclasses
from pathlib import Path

import numpy as np
from scipy.optimize import minimize, root
from scipy.spatial import cKDTree

TRANSITION_STRAIN = 0.06
NEAR = 1e-3  # m: what is farther away is not measured exactly
SCALE = np.array([3e-2, 3e-2, 1e-3, 1e-3, 1e-3])  # of the unknowns: two angles [rad], three lengths [m]
WEIGHT = np.array([1 / 0.03, 1 / 0.03, 1.0, 1.0, 1.0])  # moments are forces at an arm of 30 mm


def read_stl(path) -> np.ndarray:
    """Corners (triangles, 3, 3) of a binary STL file, in the vertices' order."""
    content = Path(path).read_bytes()
    count = int.from_bytes(content[80:84], "little")
    record = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    return np.frombuffer(content, record, count, offset=84)["corners"].astype(float)


def read_obj(path) -> np.ndarray:
    """Corners (triangles, 3, 3) of a Wavefront file of triangles."""
    vertices, triangles = [], []
    for line in Path(path).read_text().splitlines():
        words = line.split()
        if words[:1] == ["v"]:
            vertices.append([float(w) for w in words[1:4]])
        elif words[:1] == ["f"]:
            triangles.append([int(w.split("/")[0]) - 1 for w in words[1:4]])
    return np.array(vertices)[np.array(triangles)]


def refined(corners):
    """Each triangle in four."""
    a, b, c = np.moveaxis(corners, 1, 0)
    ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
    return np.concatenate(
        [np.stack(t, axis=1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]
    )


class Surface:
    """Exact signed distance to a triangle mesh: negative behind the faces; nothing is behind an open edge."""

    def __init__(self, corners):
        vertices, index = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
        self.corners, triangles = corners, index.reshape(-1, 3)
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        self.face_normal = across / np.linalg.norm(across, axis=1, keepdims=True)
        self.edge_normal, self.open_edge = self._edges(triangles, len(vertices))
        self.vertex_normal = self._vertices(triangles, len(vertices))
        self._centres = corners.mean(axis=1)
        self._radius = np.linalg.norm(corners - self._centres[:, None], axis=2).max()
        self._tree = cKDTree(self._centres)

    def __call__(self, points):
        """Signed distances (n,) of points (n, 3), and their gradients (n, 3)."""
        distance, normal = np.empty(len(points)), np.empty((len(points), 3))
        todo, near = np.arange(len(points)), 12
        while len(todo):
            near = min(near, len(self.corners))
            bound, faces = self._tree.query(points[todo], k=near)
            found, toward = self._nearest(points[todo], faces)
            distance[todo], normal[todo] = found, toward
            # A triangle whose centroid is farther away than this cannot be nearer.
            unsure = np.abs(found) > bound[:, -1] - self._radius
            todo, near = (todo[unsure], 4 * near) if near < len(self.corners) else (todo[:0], near)
        return distance, normal

    def clearance(self, points):
        """Lower bounds (n,) of the signed distances, where the surface is smooth."""
        distance, face = self._tree.query(points)
        outside = ((points - self._centres[face]) * self.face_normal[face]).sum(axis=1) > 0
        return np.where(outside, distance - self._radius, -np.inf)

    def _nearest(self, points, faces):
        """The nearest of candidate faces (n, k): signed distance (n,) and gradient (n, 3)."""
        a, b, c = np.moveaxis(self.corners[faces], 2, 0)
        weights = _barycentric(points[:, None], a, b, c)
        nearest = np.einsum("nki,inkj->nkj", weights, np.stack([a, b, c]))
        gap = points[:, None] - nearest
        which = np.linalg.norm(gap, axis=2).argmin(axis=1)
        row = np.arange(len(points))
        gap, weights, face = gap[row, which], weights[row, which], faces[row, which]
        normal, is_open = self._pseudonormal(face, weights)
        size = np.linalg.norm(gap, axis=1)
        side = np.where(is_open | ((gap * normal).sum(axis=1) >= 0), 1.0, -1.0)
        toward = np.where(
            size[:, None] > 1e-12, gap / np.maximum(size, 1e-12)[:, None], side[:, None] * normal
        )
        return side * size, side[:, None] * toward

    def _pseudonormal(self, face, weights):
        """Angle-weighted normal of the feature with the nearest point (Baerentzen and Aanaes 2005)."""
        zero = weights < 1e-12
        normal = self.face_normal[face].copy()
        is_open = np.zeros(len(face), bool)
        for corner in range(3):
            edge = zero[:, corner]  # opposite to this corner
            normal[edge] = self.edge_normal[face[edge], corner]
            is_open[edge] |= self.open_edge[face[edge], corner]
        for corner in range(3):
            vertex = zero[:, (corner + 1) % 3] & zero[:, (corner + 2) % 3]
            normal[vertex] = self.vertex_normal[face[vertex], corner]
        return normal, is_open

    def _edges(self, triangles, count):
        """Sum of the faces' normals at the edge opposite to each corner (f, 3, 3), and whether it is open."""
        ends = np.sort(
            np.stack([triangles[:, [1, 2]], triangles[:, [2, 0]], triangles[:, [0, 1]]], 1), axis=2
        )
        _, edge, shared = np.unique(ends.reshape(-1, 2) @ [count, 1], return_inverse=True, return_counts=True)
        total = np.zeros((len(shared), 3))
        np.add.at(total, edge.ravel(), np.repeat(self.face_normal, 3, axis=0))
        edge = edge.reshape(-1, 3)
        return total[edge], shared[edge] == 1

    def _vertices(self, triangles, count):
        """Normals at each corner (f, 3, 3), weighted by the faces' angles."""
        total = np.zeros((count, 3))
        for corner in range(3):
            one = self.corners[:, (corner + 1) % 3] - self.corners[:, corner]
            other = self.corners[:, (corner + 2) % 3] - self.corners[:, corner]
            angle = np.arctan2(np.linalg.norm(np.cross(one, other), axis=1), (one * other).sum(axis=1))
            np.add.at(total, triangles[:, corner], angle[:, None] * self.face_normal)
        return total[triangles]


def _barycentric(p, a, b, c):
    """Weights (..., 3) of the corners at the triangle's point nearest to p: the best of face and edges."""
    u, v, w = b - a, c - a, p - a
    uu, uv, vv = (u * u).sum(-1), (u * v).sum(-1), (v * v).sum(-1)
    uw, vw = (u * w).sum(-1), (v * w).sum(-1)
    area = np.maximum(uu * vv - uv * uv, 1e-300)
    s, t = (vv * uw - uv * vw) / area, (uu * vw - uv * uw) / area
    inside = (s >= 0) & (t >= 0) & (s + t <= 1)
    best, least = np.stack([1 - s - t, s, t], axis=-1), np.where(inside, -np.inf, np.inf)
    for first, second, start, end in ((0, 1, a, b), (1, 2, b, c), (2, 0, c, a)):
        along = end - start
        share = np.clip(((p - start) * along).sum(-1) / np.maximum((along * along).sum(-1), 1e-300), 0, 1)
        away = ((p - start - share[..., None] * along) ** 2).sum(-1)
        weights = np.zeros_like(best)
        weights[..., first], weights[..., second] = 1 - share, share
        nearer = away < least
        best[nearer], least = weights[nearer], np.minimum(away, least)
    return best


@dataclasses.dataclass
class Cylinders:
    """What strands pass around, in the frame of a bone: centres (n, 3), unit axes (n, 3), radii (n,) [m].

    A radius of 0: nothing. on_femur (n,): whether it is the femur, not the tibia.
    """

    centres: np.ndarray
    axes: np.ndarray
    radii: np.ndarray
    on_femur: np.ndarray

    @classmethod
    def none(cls, count: int) -> "Cylinders":
        axes = np.tile([0.0, 0.0, 1.0], (count, 1))
        return cls(np.zeros((count, 3)), axes, np.zeros(count), np.ones(count, bool))

    def of(self, which) -> "Cylinders":
        return Cylinders(*(column[which] for column in (self.centres, self.axes, self.radii, self.on_femur)))

    def around(self, start, end, centres, axes):
        """The shortest ways from start to end (n, 3): first and last points of the cylinders that they touch
        (n, 3), lengths between (n,). Where nothing is touched both are the start. All in one frame.
        """
        first, last, between = start.copy(), start.copy(), np.zeros(len(start))
        a, b = start - centres, end - centres
        below, above = (a * axes).sum(axis=1), (b * axes).sum(axis=1)
        a, b = a - below[:, None] * axes, b - above[:, None] * axes
        along = b - a
        share = -(a * along).sum(axis=1) / (along**2).sum(axis=1)
        nearest = np.linalg.norm(a + share[:, None] * along, axis=1)
        far, other = np.linalg.norm(a, axis=1), np.linalg.norm(b, axis=1)
        touch = (share > 0) & (share < 1) & (nearest < self.radii) & (np.minimum(far, other) > self.radii)
        for k in np.flatnonzero(touch):
            radius, e1 = self.radii[k], a[k] / far[k]
            e2 = b[k] - (b[k] @ e1) * e1
            e2 /= np.linalg.norm(e2)
            begin = np.arccos(radius / far[k])
            turn = np.arccos(np.clip(b[k] @ e1 / other[k], -1, 1)) - np.arccos(radius / other[k]) - begin
            before, after = np.sqrt(far[k] ** 2 - radius**2), np.sqrt(other[k] ** 2 - radius**2)
            whole, rise = before + radius * turn + after, above[k] - below[k]
            for found, angle, way in ((first, begin, before), (last, begin + turn, whole - after)):
                outward = np.cos(angle) * e1 + np.sin(angle) * e2
                found[k] = centres[k] + radius * outward + (below[k] + rise * way / whole) * axes[k]
            between[k] = radius * turn * np.hypot(1, rise / whole)
        return first, last, between


@dataclasses.dataclass
class Strands:
    """Strands from a point of the femur to one of the tibia, in their frames (n, 3) [m].

    stiffness [N] and slack length [m] of the whole; extra [m]: what lies along either bone, of constant
    length; cylinders: what they pass around between.
    """

    names: list[str]
    femoral: np.ndarray
    tibial: np.ndarray
    stiffness: np.ndarray
    slack: np.ndarray
    extra: np.ndarray
    cylinders: Cylinders

    @classmethod
    def read(cls, path, first="femur_distal", last="tibia_proximal"):
        """Those of the table at `path` that run from one of these bodies to the other."""
        strands: dict = {}
        with open(path, newline="") as file:
            for row in csv.DictReader(file):
                strands.setdefault(row["strand"], []).append(row)
        found: list = []
        around: list = []
        for name, rows in strands.items():
            wraps = [row for row in rows if row.get("cylinder_radius_m")]
            rows = [row for row in rows if row not in wraps]
            bodies = [row["body"] for row in rows]
            if set(bodies) != {first, last} or bodies != sorted(bodies, key=[first, last].index):
                continue
            points = np.array([[float(row[f"{c}_m"]) for c in "xyz"] for row in rows])
            parts = np.linalg.norm(np.diff(points, axis=0), axis=1)
            across = bodies.index(last)
            numbers = [float(rows[0][c]) for c in ("linear_stiffness_N_per_strain", "slack_length_m")]
            found.append(
                (name, points[across - 1], points[across], *numbers, np.delete(parts, across - 1).sum())
            )
            around.append(wraps[0] if wraps else None)
        names, *columns = zip(*found, strict=True)
        cylinders = Cylinders.none(len(names))
        for k, row in enumerate(around):
            if row is not None:
                axis = np.array([float(row[f"axis_{c}"]) for c in "xyz"])
                cylinders.centres[k] = [float(row[f"{c}_m"]) for c in "xyz"]
                cylinders.axes[k] = axis / np.linalg.norm(axis)
                cylinders.radii[k] = float(row["cylinder_radius_m"])
                cylinders.on_femur[k] = row["body"] == first
        return cls(list(names), *map(np.array, columns), cylinders)

    @property
    def groups(self) -> list[str]:
        """Names without the numbers at their ends."""
        return [name.rstrip("0123456789") for name in self.names]

    def without(self, *prefixes) -> "Strands":
        """Those whose names begin with none of the prefixes."""
        kept = np.array([not name.startswith(prefixes) for name in self.names])
        names = [name for name, keep in zip(self.names, kept, strict=True) if keep]
        columns = self.femoral, self.tibial, self.stiffness, self.slack, self.extra
        return Strands(names, *(column[kept] for column in columns), self.cylinders.of(kept))

    def crossings(self, pose):
        """Where strands leave the femur and meet the tibia (n, 3), femur's frame; their lengths (n,)."""
        c, start = self.cylinders, self.femoral
        end = pose.origin + self.tibial @ pose.axes.T
        on_femur = c.on_femur[:, None]
        centres = np.where(on_femur, c.centres, pose.origin + c.centres @ pose.axes.T)
        first, last, between = c.around(start, end, centres, np.where(on_femur, c.axes, c.axes @ pose.axes.T))
        touched = (between > 0)[:, None]
        lengths = np.linalg.norm(first - start, axis=1) + between + np.linalg.norm(end - last, axis=1)
        leaves = np.where(touched & on_femur, last, start)
        return leaves, np.where(touched & ~on_femur, first, end), lengths + self.extra


def law(strain, stiffness):
    """Tension (n,) [N]."""
    toe = stiffness * strain**2 / (2 * TRANSITION_STRAIN)
    line = stiffness * (strain - TRANSITION_STRAIN / 2)
    return np.where(strain <= 0, 0.0, np.where(strain <= TRANSITION_STRAIN, toe, line))


def law_energy(strain, stiffness, slack):
    """Integral of the tension over the length (n,) [J]."""
    toe = stiffness * strain**3 / (6 * TRANSITION_STRAIN)
    beyond = stiffness * (strain**2 / 2 - TRANSITION_STRAIN / 2 * strain + TRANSITION_STRAIN**2 / 6)
    return slack * np.where(strain <= 0, 0.0, np.where(strain <= TRANSITION_STRAIN, toe, beyond))


def rotation(flexion, adduction, internal):
    """Axes (3, 3) of the tibia in the femur's frame, as columns."""
    cz, sz = np.cos(-flexion), np.sin(-flexion)
    cx, sx = np.cos(adduction), np.sin(adduction)
    cy, sy = np.cos(internal), np.sin(internal)
    about_z = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    return about_z @ about_x @ about_y


@dataclasses.dataclass(frozen=True)
class Pose:
    """Angles [rad] and the place of the tibia's origin in the femur's frame (3,) [m]."""

    flexion: float
    adduction: float = 0.0
    internal: float = 0.0
    origin: tuple = (0.0, 0.0, 0.0)

    @property
    def axes(self):
        return rotation(self.flexion, self.adduction, self.internal)

    @property
    def joint_axes(self):
        """Grood and Suntay's axes (3, 3), rows: the femur's z, the floating axis, the tibia's y."""
        femoral, tibial = np.array([0.0, 0.0, 1.0]), self.axes[:, 1]
        floating = np.cross(tibial, femoral)
        return np.array([femoral, floating / np.linalg.norm(floating), tibial])

    @property
    def translations(self):
        """Lateral, anterior and superior shift (3,): the origin's components along the three axes [m]."""
        return self.joint_axes @ self.origin

    def moved(self, step) -> "Pose":
        """With adduction, internal rotation and origin changed by step (5,)."""
        return Pose(
            self.flexion, self.adduction + step[0], self.internal + step[1], tuple(self.origin + step[2:])
        )


class Knee:
    """Strands and an elastic foundation between two surfaces of corners (n, 3, 3)."""

    def __init__(self, strands, femur, tibia, modulus=10e6, poisson=0.45, thickness=0.006):
        self.strands = strands
        self.femur = Surface(femur)
        self.centres = tibia.mean(axis=1)
        across = np.cross(tibia[:, 1] - tibia[:, 0], tibia[:, 2] - tibia[:, 0])
        self.areas = np.linalg.norm(across, axis=1) / 2
        self.foundation = modulus * (1 - poisson) / ((1 + poisson) * (1 - 2 * poisson)) / thickness
        self._asked = np.full((len(tibia), 3), np.inf)
        self._clear = np.zeros(len(tibia))

    @classmethod
    def of_files(cls, folder, **kwargs) -> "Knee":
        """The knee of the data beside the checkout."""
        meshes = (read_stl(Path(folder) / f"{bone}_cartilage.stl") for bone in ("femur", "tibia"))
        return cls(Strands.read(Path(folder) / "ligaments.csv"), *meshes, **kwargs)

    def tensions(self, pose) -> np.ndarray:
        """(n,) [N] of the strands."""
        _, _, lengths = self.strands.crossings(pose)
        return law(lengths / self.strands.slack - 1, self.strands.stiffness)

    def pressed(self, pose):
        """Indices (m,) of pressed triangles; places (m, 3), femur's frame; depths (m,); normals (m, 3)."""
        places = pose.origin + self.centres @ pose.axes.T
        # The distance changes by no more than the way: what was farther away than that is still clear.
        moved = np.linalg.norm(places - self._asked, axis=1)
        near = np.flatnonzero(~(moved < self._clear))
        self._asked[near], self._clear[near] = places[near], self.femur.clearance(places[near])
        near = near[self._clear[near] < NEAR]
        distance, normal = self.femur(places[near])
        self._clear[near] = distance
        inside = distance < 0
        which = near[inside]
        return which, places[which], -distance[inside], normal[inside]

    def wrench(self, pose):
        """(6,) force and moment of all on the tibia, about its origin, in the femur's frame."""
        leaves, meets, _ = self.strands.crossings(pose)
        along = meets - leaves
        pull = -self.tensions(pose)[:, None] * along / np.linalg.norm(along, axis=1, keepdims=True)
        which, places, depth, normal = self.pressed(pose)
        push = (self.foundation * self.areas[which] * depth)[:, None] * normal
        arms = np.concatenate([meets, places]) - pose.origin
        forces = np.concatenate([pull, push])
        return np.concatenate([forces.sum(axis=0), np.cross(arms, forces).sum(axis=0)])

    def energy(self, pose) -> float:
        """[J] of strands and contact."""
        s = self.strands
        _, _, lengths = s.crossings(pose)
        which, _, depth, _ = self.pressed(pose)
        contact = self.foundation / 2 * (self.areas[which] * depth**2).sum()
        return law_energy(lengths / s.slack - 1, s.stiffness, s.slack).sum() + contact

    def residual(self, pose, force=(0, 0, 0), moment=(0, 0, 0), point=(0.0, -0.1, 0.0)) -> np.ndarray:
        """Generalized forces (5,) as in Pose.moved; loads are in the tibia's frame, at its `point`."""
        axes = pose.axes
        load = axes @ force
        torque = axes @ moment + np.cross(axes @ point, load)
        total = self.wrench(pose) + np.concatenate([load, torque])
        _, floating, tibial = pose.joint_axes
        return np.array([total[3:] @ floating, total[3:] @ tibial, *total[:3]])

    def solve(self, start, tolerance=1e-3, **load) -> Pose:
        """The stable equilibrium near `start`, at its flexion; unbalanced by at most `tolerance` newtons.

        The energy is minimised with the load's direction held, then all forces are balanced. Raises
        ArithmeticError where no equilibrium is found.
        """
        pose = start
        for _ in range(6):
            pose = self._balanced(self._lowered(pose, **load), **load)
            unbalanced = np.abs(WEIGHT * self.residual(pose, **load)).max()
            if unbalanced <= tolerance:
                return pose
        raise ArithmeticError(f"no equilibrium near {start}: unbalanced by {unbalanced:.3g} N")

    def _lowered(self, start, force=(0, 0, 0), moment=(0, 0, 0), point=(0.0, -0.1, 0.0)) -> Pose:
        """Less energy, that of a load included whose directions stay those at the start."""
        axes = start.axes
        held_force, held_moment = axes @ force, axes @ moment
        rows = start.joint_axes[1:]

        def potential(x):
            pose = start.moved(SCALE * x)
            work = held_force @ (pose.origin + pose.axes @ point) + rows @ held_moment @ (SCALE * x)[:2]
            gradient = self.residual(pose)
            gradient[2:] += held_force
            arm = np.cross(pose.axes @ point, held_force)
            gradient[:2] += pose.joint_axes[1:] @ arm + rows @ held_moment
            return self.energy(pose) - work, -SCALE * gradient

        found = minimize(potential, np.zeros(5), jac=True, method="BFGS", options={"gtol": 1e-7})
        return start.moved(SCALE * found.x)

    def _balanced(self, start, **load) -> Pose:
        """All forces balanced, if this comes to an end."""

        def unbalanced(x):
            return WEIGHT * self.residual(start.moved(SCALE * x), **load)

        found = root(unbalanced, np.zeros(5), method="hybr", options={"factor": 0.1, "eps": 1e-7})
        better = np.abs(found.fun).max() < np.abs(unbalanced(np.zeros(5))).max()
        return start.moved(SCALE * found.x) if better else start

    def held(self, start, anterior, force, tolerance=0.05) -> tuple[Pose, float]:
        """The equilibrium at an anterior shift [m], near `start`, and the force along the tibia's x [N] that
        the knee has there; `force` is a guess. Unlike `solve`, it is found where less force goes with more
        shift, too: beyond the largest force that the knee holds. Raises ArithmeticError.
        """

        def unbalanced(x):
            pose = start.moved(SCALE * x[:5])
            forces = WEIGHT * self.residual(pose, force=(force * x[5], 0.0, 0.0))
            return np.append(forces, (pose.translations[1] - anterior) / 1e-5)

        found = root(unbalanced, np.append(np.zeros(5), 1.0), options={"factor": 0.1, "eps": 1e-7})
        worst = np.abs(found.fun).max()
        if not worst <= tolerance:
            raise ArithmeticError(f"no equilibrium at {anterior} m: unbalanced by {worst:.3g} N")
        return start.moved(SCALE * found.x[:5]), force * found.x[5]

    def groups(self, pose) -> dict[str, float]:
        """Sums of tensions by group, and the size of the contact's force, as "cartilage" [N]."""
        sums: dict[str, float] = {}
        for group, tension in zip(self.strands.groups, self.tensions(pose), strict=True):
            sums[group] = sums.get(group, 0.0) + tension
        which, _, depth, normal = self.pressed(pose)
        push = (self.foundation * self.areas[which] * depth)[:, None] * normal
        return {**sums, "cartilage": float(np.linalg.norm(push.sum(axis=0)))}
