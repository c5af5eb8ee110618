"""Triangles that a caller gives are held to the size and the place of pybullet's own shape."""

import itertools

import numpy as np
import pybullet as p
import pytest
from link_scenes import FACES, TETRA, tetra_obj

import bullet_tendon as bt

PLACE, TURN = (0.3, -0.2, 0.5), p.getQuaternionFromEuler([0.4, -1.1, 2.0])
TRIANGLES = p.GEOM_FORCE_CONCAVE_TRIMESH
SCALES = [1e-3, 0.1, 0.9, 1.1, 3.0, 1e3]


def shape_of(client, path, scale, flags=TRIANGLES, **frame):
    mesh = {"fileName": str(path), "meshScale": [scale] * 3, "flags": flags, **frame}
    return p.createCollisionShape(p.GEOM_MESH, **mesh, physicsClientId=client)


def body_of(client, path, scale, flags=TRIANGLES, mass=0.0, **frame):
    shape = shape_of(client, path, scale, flags, **frame)
    return p.createMultiBody(mass, shape, -1, PLACE, TURN, physicsClientId=client)


@pytest.fixture
def path(tmp_path):
    return tetra_obj(tmp_path / "tetra.obj")


@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize("as_path", [True, False])
def test_a_mesh_without_pybullets_scale_is_refused(make_world, client, path, scale, as_path):
    world = make_world()
    body = body_of(client, path, scale)
    before = world.state_hash()
    with pytest.raises(bt.InvalidValue, match="meshScale") as caught:
        world.add_obstacle(body, meshes=[path if as_path else (TETRA, FACES)])
    assert caught.value.argument == "meshes"
    assert world.state_hash() == before
    world.add_obstacle(body, meshes=[(scale * TETRA, FACES)])
    (shape,) = world._obstacles.shapes.values()
    np.testing.assert_allclose(shape.bounds[1], scale * TETRA.max(0), rtol=1e-12)


def test_both_sizes_are_named(make_world, client, path):
    shape = shape_of(client, path, 1e-3)
    body = p.createMultiBody(0, shape, physicsClientId=client)
    with pytest.raises(bt.InvalidValue, match=r"0.3 x 0.4 x 0.5.*0.0003 x 0.0004 x 0.0005"):
        make_world().add_obstacle(body, meshes=[path])


def test_the_axes_count(make_world, client, path):
    world = make_world()
    shape = p.createCollisionShape(
        p.GEOM_MESH, fileName=str(path), meshScale=[1, 2, 1], flags=TRIANGLES, physicsClientId=client
    )
    body = p.createMultiBody(0, shape, physicsClientId=client)
    for scale in ([1, 1, 1], [2, 1, 1], [1, 2, 2]):
        with pytest.raises(bt.InvalidValue):
            world.add_obstacle(body, meshes=[(TETRA * scale, FACES)])
    world.add_obstacle(body, meshes=[(TETRA * [1, 2, 1], FACES)])


def test_the_place_counts(make_world, client, path):
    """As where a mesh is moved to its middle in one program and not in the other."""
    world, body = make_world(), body_of(client, path, 1.0)
    with pytest.raises(bt.InvalidValue, match="same place"):
        world.add_obstacle(body, meshes=[(TETRA - TETRA.mean(0), FACES)])


@pytest.mark.parametrize("given", ["file", "arrays"])
@pytest.mark.parametrize("scale", [1e-3, 1e-2, 1.0, 30.0])
@pytest.mark.parametrize("kind", ["triangles", "hull", "indices"])
def test_what_fits_is_taken(make_world, client, path, given, scale, kind):
    """At any pose, in any frame, with each of pybullet's margins."""
    world, rng = make_world(), np.random.default_rng(3)
    vertices = scale * TETRA
    frame = {"collisionFramePosition": [0.1, 0.2, -0.3], "collisionFrameOrientation": [0.5, 0.5, -0.5, 0.5]}
    file = {"fileName": str(path), "meshScale": [scale] * 3}
    arrays = {"vertices": vertices.tolist()}
    sources = {
        "triangles": {**file, "flags": TRIANGLES},
        "hull": file if given == "file" else arrays,
        "indices": {**arrays, "indices": FACES.ravel().tolist()},
    }
    for framed, mass in itertools.product((False, True), (0.0, 1.0)):
        options = sources[kind] | (frame if framed else {})
        shape = p.createCollisionShape(p.GEOM_MESH, **options, physicsClientId=client)
        body = p.createMultiBody(mass if kind == "hull" else 0, shape, physicsClientId=client)
        for _ in range(3):
            turn = rng.normal(size=4)
            turn /= np.linalg.norm(turn)
            place = rng.uniform(-1, 1, 3)
            p.resetBasePositionAndOrientation(body, place, turn, physicsClientId=client)
            world.add_obstacle(body, convex=False, meshes=[(vertices, FACES)])


def test_a_link_of_several_shapes(make_world, client, path):
    """A mesh that is too large is found beside other shapes, and one that fits is taken, on a turned link."""
    world = make_world()
    shapes = p.createCollisionShapeArray(
        shapeTypes=[p.GEOM_SPHERE, p.GEOM_BOX, p.GEOM_CAPSULE, p.GEOM_CYLINDER],
        radii=[0.1, 0, 0.05, 0.04],
        halfExtents=[[0, 0, 0], [0.1, 0.05, 0.02], [0, 0, 0], [0, 0, 0]],
        lengths=[0, 0, 0.3, 0.2],
        collisionFramePositions=[[1, 0, 0], [0, 1, 0], [0, 0, 1], [-1, 0, 0]],
        collisionFrameOrientations=[[0, 0, 0, 1], [0.5, 0.5, 0.5, 0.5], [0.6, 0, 0, 0.8], [0, 0.6, 0, 0.8]],
        physicsClientId=client,
    )
    mesh = shape_of(client, path, 1e-3)
    body = p.createMultiBody(
        0,
        shapes,
        basePosition=PLACE,
        baseOrientation=TURN,
        linkMasses=[0],
        linkCollisionShapeIndices=[mesh],
        linkVisualShapeIndices=[-1],
        linkPositions=[[0.3, 0, 0]],
        linkOrientations=[TURN],
        linkInertialFramePositions=[[0.1, 0.2, 0.3]],
        linkInertialFrameOrientations=[TURN],
        linkParentIndices=[0],
        linkJointTypes=[p.JOINT_REVOLUTE],
        linkJointAxis=[[0, 0, 1]],
        physicsClientId=client,
    )
    p.resetJointState(body, 0, 0.7, physicsClientId=client)
    with pytest.raises(bt.InvalidValue, match="meshScale"):
        world.add_obstacle(body, 0, meshes=[path])
    world.add_obstacle(body, 0, meshes=[(1e-3 * TETRA, FACES)])
    world.add_obstacle(body, -1)


def test_a_urdfs_scale_is_taken_for_a_file_that_is_given(make_world, client, tmp_path, path, monkeypatch):
    """pybullet tells the scale of a URDF's mesh, also where its file is not found from the present folder."""
    place = tmp_path / "elsewhere"
    place.mkdir()
    urdf = (
        '<robot name="r"><link name="a"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" '
        'ixz="0" iyz="0"/></inertial><collision concave="yes"><geometry><mesh filename="tetra.obj" '
        'scale="0.001 0.002 0.003"/></geometry></collision></link></robot>'
    )
    (tmp_path / "model.urdf").write_text(urdf)
    monkeypatch.chdir(tmp_path)
    body = p.loadURDF("model.urdf", useFixedBase=True, physicsClientId=client)
    monkeypatch.chdir(place)
    world = make_world()
    world.add_obstacle(body, meshes=[path])
    (shape,) = world._obstacles.shapes.values()
    np.testing.assert_allclose(shape.bounds[1], TETRA.max(0) * [0.001, 0.002, 0.003], rtol=1e-12)
    with pytest.raises(bt.InvalidValue, match="meshScale"):
        world.add_obstacle(body, meshes=[(TETRA, FACES)])
