"""Meshes of what links look like: pybullet's own picture of them lies on their triangles."""

import numpy as np
import pybullet as p
import pytest
from bullet_tendon.scenarios import measure
from scipy.spatial.transform import Rotation

import bullet_tendon as bt
from bullet_tendon import view
from bullet_tendon.visual_meshes import round_surface, visual_meshes

SHAPES = {
    "box": {"shapeType": p.GEOM_BOX, "halfExtents": [0.01, 0.02, 0.03]},
    "sphere": {"shapeType": p.GEOM_SPHERE, "radius": 0.03},
    "cylinder": {"shapeType": p.GEOM_CYLINDER, "radius": 0.02, "length": 0.06},
    "capsule": {"shapeType": p.GEOM_CAPSULE, "radius": 0.015, "length": 0.05},
    "mesh": {
        "shapeType": p.GEOM_MESH,
        "fileName": bt.data_path("meshes/tibia.obj"),
        "meshScale": [0.5, 0.4, 0.6],
    },
}


def seen_points(camera, body) -> np.ndarray:
    """(k, 3) places of the body's pixels in the world [m], by the depth that pybullet has rendered."""
    rendering, lens = camera.render(), camera._lens
    rows, columns = np.nonzero(rendering.segmentation == body)
    depth = rendering.depth[rows, columns]
    half = depth / np.array(lens.projection)[[0, 5], None]
    across = (2 * (columns + 0.5) / lens.width - 1) * half[0]
    up = (1 - 2 * (rows + 0.5) / lens.height) * half[1]
    local = np.c_[across, up, -depth, np.ones(len(depth))]
    return (local @ np.linalg.inv(np.reshape(lens.seen, (4, 4)).T).T)[:, :3]


@pytest.mark.parametrize("name", SHAPES)
def test_what_is_rendered_is_on_the_triangles(client, name):
    turn = Rotation.from_euler("xyz", [0.3, 0.5, -0.4]).as_quat().tolist()
    frame = {"visualFramePosition": (0.01, -0.02, 0.015), "visualFrameOrientation": turn}
    shape = p.createVisualShape(**SHAPES[name], **frame, rgbaColor=[0.2, 0.4, 0.6, 1], physicsClientId=client)
    placed = {"basePosition": (0.02, 0.01, -0.01), "baseOrientation": turn}
    inertial = {"baseInertialFramePosition": (0.01, 0.02, 0.03), "baseInertialFrameOrientation": turn}
    body = p.createMultiBody(1.0, -1, shape, **placed, **inertial, physicsClientId=client)
    p.stepSimulation(client)
    world = bt.TendonWorld(client)
    recorder = bt.Recorder(world, every=1)
    (track,) = recorder.recording.links
    (mesh,) = track.meshes
    np.testing.assert_allclose(mesh.color, [0.2, 0.4, 0.6, 1], rtol=1e-6)
    axes = Rotation.from_quat(track.orientation[0])
    corners = (axes.apply(mesh.vertices) + track.position[0])[mesh.triangles]
    middle = corners.reshape(-1, 3).mean(axis=0)
    with view.Camera(client, 128, 128, target=middle, distance=0.25, yaw=40, pitch=-25) as camera:
        points = seen_points(camera, body)
    assert len(points) > 50
    few = points[:: max(1, len(points) // 60)]
    away = [measure.to_triangles(point, corners) for point in few]
    assert np.quantile(away, 0.9) < 1e-3  # a pixel is 1.4 mm


def test_vertices_that_pybullet_does_not_tell_are_those_of_the_obstacle(client):
    vertices = np.array([(0, 0, 0), (0.1, 0, 0), (0, 0.1, 0), (0, 0, 0.1)])
    triangles = np.array([(0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)])
    data = {"vertices": vertices.tolist(), "indices": triangles.ravel().tolist(), "physicsClientId": client}
    body = p.createMultiBody(0, p.createCollisionShape(p.GEOM_MESH, **data), physicsClientId=client)
    world = bt.TendonWorld(client)
    rows = p.getVisualShapeData(body, physicsClientId=client)
    assert visual_meshes(rows, body, world._obstacles.of_link) == {}
    world.add_obstacle(body, meshes=[(vertices, triangles)])
    (mesh,) = visual_meshes(rows, body, world._obstacles.of_link)[-1]
    found = mesh.vertices[mesh.triangles]
    assert sorted(map(tuple, found.mean(axis=1).round(6))) == sorted(
        map(tuple, vertices[triangles].mean(axis=1).round(6).astype(np.float32))
    )
    assert bt.Recorder(world, every=1).recording.bones == (body,)


@pytest.mark.parametrize("kind", [p.GEOM_SPHERE, p.GEOM_CYLINDER, p.GEOM_CAPSULE])
def test_round_surfaces_have_the_normals_of_their_shapes(kind):
    sizes = (0.03, 0.0, 0.0) if kind == p.GEOM_SPHERE else (0.05, 0.02, 0.0)
    place, turn = np.array([0.1, -0.2, 0.3]), Rotation.from_euler("xyz", [0.3, 0.5, -0.4])
    mesh = round_surface(kind, sizes, place, turn.as_quat().tolist(), 24)
    x, normals = turn.inv().apply(mesh.vertices - place), turn.inv().apply(mesh.normals)
    if kind == p.GEOM_CYLINDER:
        ends = np.isin(np.arange(len(x)), np.r_[mesh.triangles[:48], mesh.triangles[96:]])
        exact = np.where(ends[:, None], (0, 0, 1) * np.sign(x), (1, 1, 0) * x / 0.02)
    else:
        half = 0.0 if kind == p.GEOM_SPHERE else 0.025
        exact = (x - np.clip(x, (0, 0, -half), (0, 0, half))) / (0.03 if half == 0 else 0.02)
    np.testing.assert_allclose(normals, exact, atol=1e-6)
    a, b, c = (x[corner] for corner in mesh.triangles.T)
    facing, of_face = np.cross(b - a, c - a), normals[mesh.triangles].mean(axis=1)
    areas = np.linalg.norm(facing, axis=1)
    along = np.einsum("ij,ij->i", facing, of_face)
    assert (along[areas > 1e-12] > 0.95 * areas[areas > 1e-12]).all()  # those at poles have no area
