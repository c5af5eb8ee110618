"""The packaged knee: closed meshes of published size, tunnels that fit them, URDFs that pybullet loads."""

import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pybullet as p
import pytest
from scipy.spatial import cKDTree

URDF = Path(__file__).parents[2] / "urdf"
MESHES = ("femur", "tibia", "femur_drilled", "tibia_drilled")
GRAFT_RADIUS = 3.5e-3  # the commonest hamstring graft is 7 to 8 mm thick
JOINTS = ("flexion", "adduction", "rotation", "anterior", "superior", "lateral")


def read_obj(path: Path):
    """Vertices (V, 3) [m] and triangles (F, 3) of an OBJ file."""
    rows = [line.split() for line in path.read_text().splitlines()]
    vertices = np.array([row[1:] for row in rows if row[0] == "v"], float)
    faces = [[int(corner.split("/")[0]) - 1 for corner in row[1:]] for row in rows if row[0] == "f"]
    return vertices, np.array(faces)


@pytest.fixture(scope="module")
def meshes():
    return {name: read_obj(URDF / "meshes" / f"{name}.obj") for name in MESHES}


def tunnel(name: str, file: str):
    """start (3,), end (3,), radius [m]."""
    (node,) = (t for t in ElementTree.parse(URDF / file).iter("tunnel") if t.get("name") == name)
    start, end = (np.array(node.find(tag).get("xyz").split(), float) for tag in ("start", "end"))
    return start, end, float(node.get("radius"))


def cloud(mesh):
    """Points about 0.5 mm apart all over a mesh (N, 3) [m]: enough to measure distances to 0.1 mm."""
    vertices, triangles = mesh
    n = 6
    weights = np.array([(i, j, n - i - j) for i in range(n + 1) for j in range(n + 1 - i)]) / n
    return (weights @ vertices[triangles]).reshape(-1, 3)


def flexed(points, degrees: float):
    """Points (..., 3) of the tibia in the femur's frame after flexion as a pure hinge."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return points @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]).T


@pytest.mark.parametrize("name", MESHES)
def test_mesh_is_closed_and_looks_outward(meshes, name):
    vertices, triangles = meshes[name]
    edges = [(a, b) for t in triangles.tolist() for a, b in zip(t, t[1:] + t[:1], strict=True)]
    assert len(set(edges)) == len(edges)  # each direction once ...
    assert {(b, a) for a, b in edges} == set(edges)  # ... and its opposite
    a, b, c = np.moveaxis(vertices[triangles], 1, 0)
    assert np.linalg.norm(np.cross(b - a, c - a), axis=1).min() > 0.0
    volume = np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0
    assert 1.2e-4 < volume < 2.6e-4  # m^3
    handles = 1 if "drilled" in name else 0
    assert len(vertices) - len(edges) // 2 + len(triangles) == 2 - 2 * handles


@pytest.mark.parametrize("name", MESHES)
def test_mesh_stays_small(meshes, name):
    assert 3000 < len(meshes[name][1]) < 7000
    assert (URDF / "meshes" / f"{name}.obj").stat().st_size < 400_000


def test_drilled_mesh_normals_look_outward():
    for name in ("femur", "tibia"):
        path = URDF / "meshes" / f"{name}_drilled.obj"
        vertices, triangles = read_obj(path)
        rows = [line.split()[1:] for line in path.read_text().splitlines() if line.startswith("vn ")]
        normals = np.array(rows, float)
        np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=0.02)
        a, b, c = np.moveaxis(vertices[triangles], 1, 0)
        agreement = np.einsum("ij,ij->i", np.cross(b - a, c - a), normals[triangles].sum(axis=1))
        assert (agreement > 0).mean() > 0.99


def test_femur_has_published_dimensions(meshes):
    """Sources: urdf/make_bones.py; two standard deviations each way."""
    femur, points = meshes["femur"][0], cloud(meshes["femur"])
    joint = points[points[:, 1] < 0.025]
    assert 0.057 < np.ptp(joint[:, 0]) < 0.071  # depth
    assert 0.074 < np.ptp(points[:, 2]) < 0.090  # between the epicondyles
    assert np.abs(points[:, 2].max() + points[:, 2].min()) < 2e-3
    assert np.ptp(femur[:, 1]) > 0.120
    for side in (-1, 1):  # circle through the rear of each condyle, seen from the side
        rear = points[(points[:, 2] * side > 0.020) & (points[:, 2] * side < 0.026)]
        rear = rear[(rear[:, 0] < -0.012) & (np.abs(rear[:, 1]) < 0.012)][:, :2]
        (x, y, free), *_ = np.linalg.lstsq(np.c_[2 * rear, np.ones(len(rear))], (rear**2).sum(1), rcond=None)
        assert 0.016 < np.sqrt(free + x * x + y * y) < 0.0225
    notch = points[
        (np.abs(points[:, 2]) < 0.016) & (np.abs(points - [-0.010, 0.0, 0.0]) < 1e-3)[:, :2].all(1)
    ]
    width = notch[notch[:, 2] > 0, 2].min() - notch[notch[:, 2] < 0, 2].max()
    assert 0.143 < width / np.ptp(points[:, 2]) < 0.319


def test_trochlear_groove_is_as_deep_as_published(meshes):
    """Sulcus angle 138 +- 6 degrees (Merchant 1974), at the level of the epicondyles."""
    points = cloud(meshes["femur"])
    front = points[(np.abs(points[:, 1]) < 1e-3) & (points[:, 0] > 0.020)][:, [0, 2]]
    middle = front[np.abs(front[:, 1]) < 0.008]
    bottom = middle[middle[:, 0].argmin()]
    sides = [front[side * front[:, 1] > 0.008] for side in (-1, 1)]
    u, v = (ridge[ridge[:, 0].argmax()] - bottom for ridge in sides)
    angle = np.degrees(np.arccos(u @ v / np.linalg.norm(u) / np.linalg.norm(v)))
    assert 126 < angle < 150


def test_tibia_has_published_dimensions(meshes):
    points = cloud(meshes["tibia"])
    head = points[(points[:, 1] > -0.040) & (points[:, 2] < 0.0385)]
    plateau = head[head[:, 1] > -0.031]
    assert 0.070 < np.ptp(plateau[:, 2]) < 0.082
    assert 0.0409 < np.ptp(plateau[:, 0]) < 0.0529
    assert np.ptp(points[:, 1]) > 0.100
    for side in (-1, 1):  # slope of each plateau, front to rear
        top = head[(np.abs(head[:, 2] * side - 0.028) < 2e-3) & (np.abs(head[:, 0]) < 0.016)]
        top = top[top[:, 1] > -0.030]
        assert 4.0 < np.degrees(np.arctan(np.polyfit(top[:, 0], top[:, 1], 1)[0])) < 11.0


@pytest.mark.parametrize(
    "degrees, low, high", [(0, 2e-3, 4e-3), (45, 2e-3, 4e-3), (90, 1e-3, 4e-3), (125, 1e-3, 4e-3)]
)
def test_bones_leave_room_for_cartilage(meshes, degrees, low, high):
    femur = cKDTree(cloud(meshes["femur"]))
    tibia = cloud(meshes["tibia"])
    tibia = flexed(tibia[tibia[:, 1] > -0.045], degrees)
    for side in (-1, 1):
        gap = femur.query(tibia[tibia[:, 2] * side > 0.012])[0].min()
        assert low < gap < high


@pytest.mark.parametrize(
    "name, bone, shortest, longest",
    [
        ("femoral", "femur", 33.3e-3, 43.7e-3),  # 38.5 +- 5.2 mm
        ("tibial", "tibia", 35e-3, 45e-3),
    ],
)
def test_tunnel_fits_its_bone(meshes, name, bone, shortest, longest):
    start, end, radius = tunnel(name, f"{bone}.urdf")
    for one, other in zip(tunnel(name, "knee.urdf"), (start, end, radius), strict=True):
        np.testing.assert_array_equal(one, other)
    assert radius == 0.004
    assert shortest < np.linalg.norm(end - start) < longest
    assert cKDTree(cloud(meshes[bone])).query([start, end])[0].max() < 0.5e-3
    # the drilled mesh leaves the bore free, and its wall is where the tunnel says
    axis = (end - start) / np.linalg.norm(end - start)
    points = cloud(meshes[f"{bone}_drilled"]) - start
    along = points @ axis
    inside = (along > 4e-3) & (along < np.linalg.norm(end - start) - 4e-3)
    away = np.linalg.norm(points - along[:, None] * axis, axis=1)[inside].min()
    assert 0.0039 < away < 0.0041


def test_tunnels_lead_a_graft_through_the_notch(meshes):
    """Moderate bends at both mouths from extension to 90 degrees, and a free path at 30 degrees."""
    outer, plateau, _ = tunnel("tibial", "knee.urdf")
    notch, lateral, _ = tunnel("femoral", "knee.urdf")
    assert 0.025 < np.linalg.norm(notch - plateau) < 0.032
    for degrees in (0, 30, 60, 90):
        path = [flexed(outer, degrees), flexed(plateau, degrees), notch, lateral]
        u, v, w = (step / np.linalg.norm(step) for step in np.diff(path, axis=0))
        assert np.degrees(np.arccos([u @ v, v @ w])).max() < 60.0
    plateau = flexed(plateau, 30)
    line = plateau + np.linspace(0, 1, 100)[:, None] * (notch - plateau)
    assert cKDTree(cloud(meshes["femur_drilled"])).query(line)[0].min() > GRAFT_RADIUS
    tibia = flexed(cloud(meshes["tibia_drilled"]), 30)
    assert cKDTree(tibia).query(line)[0].min() > GRAFT_RADIUS


@pytest.fixture
def client():
    client = p.connect(p.DIRECT)
    yield client
    p.disconnect(client)


def load(client, name):
    flags = p.URDF_USE_INERTIA_FROM_FILE
    return p.loadURDF(str(URDF / f"{name}.urdf"), useFixedBase=True, flags=flags, physicsClientId=client)


@pytest.mark.parametrize("name", ["femur", "tibia", "knee"])
def test_pybullet_loads_it(client, name):
    body = load(client, name)
    base = "tibia" if name == "tibia" else "femur"
    assert p.getBodyInfo(body, physicsClientId=client)[0].decode() == base
    assert p.getCollisionShapeData(body, -1, physicsClientId=client)[0][2] == p.GEOM_MESH


def test_knee_flexes_under_a_motor(client):
    knee = load(client, "knee")
    p.setGravity(0, -9.81, 0, physicsClientId=client)
    info = [p.getJointInfo(knee, i, physicsClientId=client) for i in range(6)]
    assert tuple(row[1].decode() for row in info) == JOINTS
    assert info[5][12].decode() == "tibia"
    mass, _, inertia, *_ = p.getDynamicsInfo(knee, 5, physicsClientId=client)
    assert (mass, *inertia) == pytest.approx((2.652, 0.0249, 0.0043, 0.0259))
    home = p.getLinkState(knee, 5, physicsClientId=client)[4]
    np.testing.assert_allclose(home, 0.0, atol=1e-6)
    for joint in range(6):
        target, force = (np.radians(60) if joint == 0 else 0.0), (100 if joint < 3 else 5000)
        p.setJointMotorControl2(knee, joint, p.POSITION_CONTROL, target, force=force, physicsClientId=client)
    for _ in range(240):
        p.stepSimulation(physicsClientId=client)
    angles = [p.getJointState(knee, i, physicsClientId=client)[0] for i in range(6)]
    assert np.degrees(angles[0]) == pytest.approx(60, abs=2)
    assert np.abs(angles[1:]).max() < 1e-3
    state = p.getLinkState(knee, 5, computeForwardKinematics=True, physicsClientId=client)
    down = np.array(p.getMatrixFromQuaternion(state[5])).reshape(3, 3) @ [0, -1, 0]
    assert down[0] < -0.8  # the shank's far end goes backwards
    assert not p.getContactPoints(physicsClientId=client)


def test_generator_reproduces_the_meshes(meshes, tmp_path):
    run = [sys.executable, str(URDF / "make_bones.py"), "--out", str(tmp_path)]
    subprocess.run(run, check=True, capture_output=True, timeout=300)
    for name, (vertices, triangles) in meshes.items():
        made = read_obj(tmp_path / f"{name}.obj")
        np.testing.assert_allclose(made[0], vertices, rtol=0, atol=2e-5)
        np.testing.assert_array_equal(made[1], triangles)
