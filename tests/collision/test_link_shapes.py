"""Mirrored shapes of pybullet links: their place and size against pybullet's own contact queries."""

import numpy as np
import pybullet as p
import pytest
from link_scenes import check_link, turn, urdf_body

from bullet_tendon.errors import InvalidValue, UnknownId
from bullet_tendon.shapes import collision_shapes

SHAPES = {
    "box": {"shapeType": p.GEOM_BOX, "halfExtents": [0.1, 0.2, 0.3]},
    "sphere": {"shapeType": p.GEOM_SPHERE, "radius": 0.2},
    "capsule": {"shapeType": p.GEOM_CAPSULE, "radius": 0.1, "height": 0.4},
    "cylinder": {"shapeType": p.GEOM_CYLINDER, "radius": 0.15, "height": 0.4},
}


@pytest.mark.parametrize("kind", SHAPES)
def test_random_frames(client, probe, kind):
    """Inertial offset, collision origin and body pose all at random, on bases and on nested links."""
    rng = np.random.default_rng(1)
    for _ in range(5):
        shape = p.createCollisionShape(
            **SHAPES[kind],
            collisionFramePosition=rng.normal(size=3),
            collisionFrameOrientation=turn(rng),
            physicsClientId=client,
        )
        count = 3
        body = p.createMultiBody(
            1.0,
            shape,
            basePosition=rng.normal(size=3),
            baseOrientation=turn(rng),
            baseInertialFramePosition=rng.normal(size=3),
            baseInertialFrameOrientation=turn(rng),
            linkMasses=[1.0] * count,
            linkCollisionShapeIndices=[shape] * count,
            linkVisualShapeIndices=[-1] * count,
            linkPositions=rng.normal(size=(count, 3)).tolist(),
            linkOrientations=[turn(rng) for _ in range(count)],
            linkInertialFramePositions=rng.normal(size=(count, 3)).tolist(),
            linkInertialFrameOrientations=[turn(rng) for _ in range(count)],
            linkParentIndices=[0, 1, 1],
            linkJointTypes=[p.JOINT_REVOLUTE] * count,
            linkJointAxis=[[0, 0, 1]] * count,
            physicsClientId=client,
        )
        for joint in range(count):
            p.resetJointState(body, joint, rng.normal(), physicsClientId=client)
        for link in range(-1, count):
            found = collision_shapes(body, link, client)
            assert [s.kind for s in found] == [kind]
            check_link(client, probe, body, link, found)


def test_compound_of_primitives(client, probe):
    rng = np.random.default_rng(2)
    array = p.createCollisionShapeArray(
        shapeTypes=[p.GEOM_SPHERE, p.GEOM_BOX, p.GEOM_CYLINDER],
        radii=[0.1, 0.2, 0.3],
        halfExtents=[[0.1, 0.2, 0.3]] * 3,
        lengths=[0.1, 0.2, 0.3],
        collisionFramePositions=[[0, 0, 0], [1, 0, 0], [0, 2, 0]],
        collisionFrameOrientations=[turn(rng) for _ in range(3)],
        physicsClientId=client,
    )
    body = p.createMultiBody(
        1.0,
        array,
        baseInertialFramePosition=[0.1, 0.2, 0.3],
        baseInertialFrameOrientation=turn(rng),
        physicsClientId=client,
    )
    shapes = collision_shapes(body, -1, client)
    assert [s.kind for s in shapes] == ["sphere", "box", "cylinder"]
    assert shapes[1].position == pytest.approx([1, 0, 0]) and shapes[2].position == pytest.approx([0, 2, 0])
    check_link(client, probe, body, -1, shapes)


@pytest.mark.parametrize(
    "geometry,kind",
    [
        ('<box size=".2 .3 .4"/>', "box"),
        ('<sphere radius=".2"/>', "sphere"),
        ('<capsule radius=".1" length=".4"/>', "capsule"),
        ('<cylinder radius=".15" length=".4"/>', "cylinder"),
    ],
)
def test_urdf_primitives(client, probe, tmp_path, geometry, kind):
    flags = {"flags": p.URDF_USE_IMPLICIT_CYLINDER}
    body = urdf_body(client, tmp_path, (geometry, ""), **flags)
    for link in (-1, 0):
        found = collision_shapes(body, link, client)
        assert [s.kind for s in found] == [kind]
        check_link(client, probe, body, link, found)


def test_planes(client, tmp_path):
    made = p.createCollisionShape(p.GEOM_PLANE, planeNormal=[0, 3, 4], physicsClientId=client)
    body = p.createMultiBody(0, made, physicsClientId=client)
    shape = collision_shapes(body, -1, client)[0]
    assert shape.kind == "plane" and shape.half_space == pytest.approx([0, 0.6, 0.8, 0])
    assert np.isinf(shape.bounds).all()


def test_links_without_shapes_and_what_is_refused(client):
    empty = p.createMultiBody(1.0, physicsClientId=client)
    assert collision_shapes(empty, -1, client) == []
    with pytest.raises(UnknownId, match="linkIndex = 0"):
        collision_shapes(empty, 0, client)
    with pytest.raises(UnknownId, match="bodyUniqueId = 77"):
        collision_shapes(77, -1, client)
    box = p.createCollisionShape(p.GEOM_BOX, halfExtents=[1, 1, 1], physicsClientId=client)
    maximal = p.createMultiBody(1.0, box, useMaximalCoordinates=True, physicsClientId=client)
    with pytest.raises(InvalidValue, match="useMaximalCoordinates"):
        collision_shapes(maximal, -1, client)
    field = p.createCollisionShape(
        p.GEOM_HEIGHTFIELD,
        heightfieldData=[0.0, 1, 2, 3, 4, 5, 6, 7, 8],
        numHeightfieldRows=3,
        numHeightfieldColumns=3,
        physicsClientId=client,
    )
    with pytest.raises(InvalidValue, match="height field"):
        collision_shapes(p.createMultiBody(0, field, physicsClientId=client), -1, client)


def loaded_mjcf(client, path, geom):
    """The base of a body that is one geom of an MJCF file."""
    path.write_text(
        f'<mujoco model="one"><worldbody><body name="part" pos="0 0 1">{geom}</body></worldbody></mujoco>'
    )
    return p.loadMJCF(str(path), physicsClientId=client)[-1]


@pytest.mark.parametrize("ends", ["0 0 0 0.2 0.2 0", "-0.1 0 0 0.1 0 0"])
def test_capsules_between_points_of_an_mjcf_file_are_refused(client, tmp_path, ends):
    """pybullet's own reading of them ends the process."""
    body = loaded_mjcf(client, tmp_path / "one.xml", f'<geom type="capsule" fromto="{ends}" size="0.08"/>')
    with pytest.raises(InvalidValue, match="MJCF"):
        collision_shapes(body, -1, client)


@pytest.mark.parametrize(
    "kind, geom",
    {
        "box": 'type="box" size="0.1 0.2 0.3" pos="0.1 0 0"',
        "sphere": 'type="sphere" size="0.1" pos="0.1 0 0"',
        "capsule": 'type="capsule" size="0.04 0.1"',
        "capsule beside": 'type="capsule" size="0.05 0.1" pos="0.1 0 0"',
    }.items(),
)
def test_other_shapes_of_an_mjcf_file(client, probe, tmp_path, kind, geom):
    body = loaded_mjcf(client, tmp_path / "one.xml", f"<geom {geom}/>")
    shapes = collision_shapes(body, -1, client)
    assert [shape.kind for shape in shapes] == [kind.split()[0]]
    check_link(client, probe, body, -1, shapes)


def test_compounds_that_are_drawn_as_capsules_are_read(client):
    """They have no margin either; createMultiBody gives their body its name."""
    on = {"physicsClientId": client}
    places = [[0, 0, -0.1], [0, 0, 0.1]]
    spheres = p.createCollisionShapeArray(
        [p.GEOM_SPHERE] * 2, [0.05] * 2, collisionFramePositions=places, **on
    )
    drawn = p.createVisualShape(p.GEOM_CAPSULE, radius=0.05, length=0.2, **on)
    body = p.createMultiBody(1, spheres, drawn, **on)
    assert [s.kind for s in collision_shapes(body, -1, client)] == ["sphere", "sphere"]
