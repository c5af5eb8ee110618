"""Meshes of pybullet links: hull or triangles, one or several, in the right place."""

import numpy as np
import pybullet as p
import pytest
from brute_force import point_triangles
from link_scenes import (
    FACES,
    TETRA,
    check_hull_faces,
    link_frame,
    tetra_obj,
    turn,
    urdf_body,
)

from bullet_tendon.errors import InvalidType, InvalidValue
from bullet_tendon.shapes import collision_shapes


def test_urdf_cylinder_made_a_hull_is_a_cylinder(client, tmp_path):
    body = urdf_body(client, tmp_path, ('<cylinder radius=".15" length=".4"/>', ""))
    round_one = urdf_body(
        client, tmp_path, ('<cylinder radius=".15" length=".4"/>', ""), flags=p.URDF_USE_IMPLICIT_CYLINDER
    )
    shape, expected = (collision_shapes(b, 0, client)[0] for b in (body, round_one))
    assert shape.kind == collision_shapes(body, 0, client, convex=False)[0].kind == "cylinder"
    assert shape.bounds == pytest.approx(expected.bounds, abs=1e-12)
    assert shape.position == pytest.approx(expected.position, abs=1e-12)
    assert shape.rotation == pytest.approx(expected.rotation, abs=1e-12)


@pytest.mark.parametrize("scale", [(1, 1, 1), (0.5, 2, 3), (-1, 1, 1)])
def test_urdf_meshes_convex_and_concave(client, probe, tmp_path, scale):
    tetra_obj(tmp_path / "t.obj")
    geometry = '<mesh filename="t.obj" scale="{} {} {}"/>'.format(*scale)
    for attribute, is_hull in (("", True), ('concave="yes"', False)):
        body = urdf_body(client, tmp_path, (geometry, attribute), useFixedBase=not is_hull)
        for link in (-1, 0):
            found = collision_shapes(body, link, client)
            assert [s.kind for s in found] == ["mesh"]
            assert found[0].bounds == pytest.approx(np.sort([np.zeros(3), TETRA.max(0) * scale], axis=0))
            assert hasattr(found[0].query, "hull") == is_hull
            if is_hull:
                check_hull_faces(client, probe, body, link, found[0])
        assert hasattr(collision_shapes(body, -1, client, convex=True)[0].query, "hull")
        assert not hasattr(collision_shapes(body, -1, client, convex=False)[0].query, "hull")


def test_urdf_concave_mesh_in_place_by_rays(client, tmp_path):
    tetra_obj(tmp_path / "t.obj")
    body = urdf_body(client, tmp_path, ('<mesh filename="t.obj"/>', 'concave="1"'), useFixedBase=True)
    shape = collision_shapes(body, -1, client)[0]
    origin, axes = link_frame(client, body, -1)
    for face in TETRA[FACES]:
        normal = np.cross(face[1] - face[0], face[2] - face[0])
        normal /= np.linalg.norm(normal)
        ends = [face.mean(0) + height * normal for height in (0.3, -0.01)]
        ends = [origin + axes @ (shape.position + shape.rotation @ x) for x in ends]
        hit = p.rayTest(*ends, physicsClientId=client)[0]
        local = shape.rotation.T @ (axes.T @ (np.array(hit[3]) - origin) - shape.position)
        assert hit[0] == body and shape.measure(local[None], local[None])[0][0] <= 1e-6


def test_groups_and_mixed_links(client, tmp_path):
    """One hull a group; and beside other shapes, hulls and triangles are still told apart."""
    tetra_obj(tmp_path / "one.obj")
    tetra_obj(tmp_path / "two.obj", groups=2)
    one, two = ('<mesh filename="one.obj"/>', ""), ('<mesh filename="two.obj" scale="1 2 1"/>', "")
    ball, open_one = (
        ('<sphere radius=".2"/>', ""),
        ('<mesh filename="two.obj" scale="1 1 3"/>', 'concave="1"'),
    )
    cases = {
        (two,): "hh",
        (two, two): "hhhh",
        (ball, one): "sh",
        (ball, open_one): "st",
        (one, open_one, ball, two): "htshh",
        (open_one, one, two): "thhh",
    }
    for collisions, expected in cases.items():
        body = urdf_body(client, tmp_path, *collisions, useFixedBase=True)
        shapes = collision_shapes(body, 0, client)
        kinds = ["s" if s.kind == "sphere" else "h" if hasattr(s.query, "hull") else "t" for s in shapes]
        assert "".join(kinds) == expected


@pytest.mark.parametrize("scale", [0.001, (0.001, 0.002, 0.0005)])
def test_a_file_of_the_caller_is_scaled_as_pybullet_scales_it(client, tmp_path, scale):
    path = str(tetra_obj(tmp_path / "t.obj"))
    factors = np.full(3, scale) if np.ndim(scale) == 0 else np.array(scale)
    flags = p.GEOM_FORCE_CONCAVE_TRIMESH
    solid = {"fileName": path, "meshScale": factors.tolist(), "flags": flags}
    body = p.createMultiBody(
        0.0, p.createCollisionShape(p.GEOM_MESH, **solid, physicsClientId=client), physicsClientId=client
    )
    (shape,) = collision_shapes(body, -1, client, meshes=[(path, scale)])
    assert shape.bounds == pytest.approx(np.array([TETRA.min(0), TETRA.max(0)]) * factors)
    with pytest.raises(InvalidValue, match="meshes = .*meshScale"):
        collision_shapes(body, -1, client, meshes=[path])


def test_meshes_from_vertices(client, probe, tmp_path):
    """A hull's vertices pybullet tells (to 1e-4 of its size); triangles it does not: they must be given."""
    rng = np.random.default_rng(3)
    frame = {"collisionFramePosition": [0.2, 0.1, 0.3], "collisionFrameOrientation": turn(rng)}
    inertial = {"baseInertialFramePosition": [0.3, -0.1, 0.2], "baseInertialFrameOrientation": turn(rng)}
    points = rng.normal(size=(30, 3)) * 0.2
    hull = p.createCollisionShape(p.GEOM_MESH, vertices=points.tolist(), physicsClientId=client, **frame)
    body = p.createMultiBody(1.0, hull, physicsClientId=client, **inertial)
    shape = collision_shapes(body, -1, client)[0]
    assert shape.bounds == pytest.approx(np.array([points.min(0), points.max(0)]), abs=2e-4)
    check_hull_faces(client, probe, body, -1, shape)

    triangles = p.createCollisionShape(
        p.GEOM_MESH,
        vertices=TETRA.tolist(),
        indices=FACES.ravel().tolist(),
        physicsClientId=client,
        **frame,
    )
    body = p.createMultiBody(0.0, triangles, physicsClientId=client, **inertial)
    with pytest.raises(InvalidValue, match="meshes = .*createCollisionShape"):
        collision_shapes(body, -1, client)
    for source in ((TETRA, FACES), tetra_obj(tmp_path / "t.obj"), str(tmp_path / "t.obj")):
        shape = collision_shapes(body, -1, client, meshes=[source])[0]
        assert shape.position == pytest.approx([0.2, 0.1, 0.3])
        x = rng.normal(size=(50, 3))
        exact = [point_triangles(y, TETRA[FACES]).min() for y in x]
        assert shape.measure(x, x)[0] == pytest.approx(exact, abs=1e-12)
    with pytest.raises(InvalidType, match="meshScale"):
        collision_shapes(body, -1, client, meshes=[(str(tmp_path / "t.obj"), "1")])
    with pytest.raises(InvalidValue, match="meshes"):
        collision_shapes(body, -1, client, meshes=[(TETRA, FACES)] * 2)
    with pytest.raises(InvalidValue, match="triangles"):
        collision_shapes(body, -1, client, meshes=[(TETRA, FACES + 1)])
