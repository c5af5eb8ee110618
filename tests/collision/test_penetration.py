"""Centrelines that begin inside obstacles: found, pushed out the near way, or refused."""

from pathlib import Path

import numpy as np
import pybullet as p
import pytest
from brute_force import segment_primitive, segment_triangles, signed_distance, torus

import bullet_tendon as bt
from bullet_tendon.mesh_files import read_mesh

RADIUS = 0.004
SOFT = bt.Material(stiffness=300.0, damping=0.3, friction=1.0)
PATELLA = Path(__file__).parents[3] / "shared" / "knee" / "patella.stl"
SIZES = {"box": (0.2, 0.3, 0.5), "sphere": (0.2,), "capsule": (0.1, 0.4), "cylinder": (0.15, 0.4)}
PLACE, TURN = np.array([0.3, -0.2, 0.5]), p.getQuaternionFromEuler([0.4, -1.1, 2.0])
AXES = np.array(p.getMatrixFromQuaternion(TURN)).reshape(3, 3)


def add_body(world, **shape):
    """A static, turned body of one shape, which becomes an obstacle; vertices: a concave mesh."""
    mesh = (shape["vertices"], np.reshape(shape["indices"], (-1, 3))) if "vertices" in shape else ()
    made = p.createCollisionShape(**shape, physicsClientId=world.physicsClientId)
    body = p.createMultiBody(0, made, -1, PLACE, TURN, physicsClientId=world.physicsClientId)
    world.add_obstacle(body, meshes=[mesh] if mesh else ())
    return body


def add_primitive(world, kind):
    sizes = SIZES[kind]
    geometry = {
        "box": {"shapeType": p.GEOM_BOX, "halfExtents": np.array(sizes) / 2},
        "sphere": {"shapeType": p.GEOM_SPHERE, "radius": sizes[0]},
        "capsule": {"shapeType": p.GEOM_CAPSULE, "radius": sizes[0], "height": sizes[-1]},
        "cylinder": {"shapeType": p.GEOM_CYLINDER, "radius": sizes[0], "height": sizes[-1]},
    }
    return add_body(world, **geometry[kind])


def add_torus(world):
    """Closed and concave; its winding turned over here and there."""
    vertices, triangles = torus()
    triangles[::3] = triangles[::3, ::-1]
    indices = triangles.ravel().tolist()
    return add_body(world, shapeType=p.GEOM_MESH, vertices=vertices.tolist(), indices=indices)


def there(points):
    """Points of the body's frame in the world."""
    return PLACE + np.asarray(points, float) @ AXES.T


def here(points):
    return (points - PLACE) @ AXES


def tendon(world, points, inside, n=21):
    return world.add_tendon(there(points), RADIUS, SOFT, n, inside=inside)


@pytest.mark.parametrize("kind", SIZES)
def test_depth_and_way_out_of_a_primitive(make_world, kind):
    world = make_world()
    body = add_primitive(world, kind)
    t = tendon(world, [[-0.05, 0.01, 0.02], [0.9, 0.2, 0.1]], "allow")
    line = here(t.positions)
    exact = segment_primitive(kind, SIZES[kind], line[:-1], line[1:])
    rows = world.penetrations()
    assert rows["segment"].tolist() == np.flatnonzero(exact < 0).tolist()
    assert rows["depth"] == pytest.approx(-exact[exact < 0], abs=1e-7)
    assert set(rows["bodyUniqueId"]) == {body} and set(rows["linkIndex"]) == {-1}
    surface = here(rows["position"] + rows["depth"][:, None] * rows["normal"])
    assert np.abs(signed_distance(kind, SIZES[kind], surface)).max() < 1e-7


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("kind", SIZES)
def test_pushed_out_of_a_primitive(make_world, kind, seed):
    world = make_world()
    add_primitive(world, kind)
    rng = np.random.default_rng(seed)
    line = rng.uniform(-0.06, 0.06, 3) + np.outer([-1, 1], rng.normal(size=3)) * rng.choice([0.01, 0.2])
    t = tendon(world, line, "push_out")
    pushed = here(t.positions)
    assert segment_primitive(kind, SIZES[kind], pushed[:-1], pushed[1:]).min() > 0
    assert len(world.penetrations()) == 0
    before = line[0] + np.linspace(0, 1, 21)[:, None] * (line[1] - line[0])
    was_inside = signed_distance(kind, SIZES[kind], before) < 0
    assert was_inside.any()
    clear = signed_distance(kind, SIZES[kind], pushed)[was_inside]
    assert clear.min() > 0.25 * RADIUS


def test_pushed_the_near_way(make_world):
    """Beside one face of a box, each particle moves straight through that face, and others stay."""
    world = make_world()
    add_primitive(world, "box")
    t = tendon(world, [[0.09, 0.0, -0.4], [0.09, 0.0, 0.4]], "push_out", 41)
    line = here(t.positions)
    inside = np.abs(np.linspace(-0.4, 0.4, 41)) < 0.2
    np.testing.assert_allclose(line[inside, 0], 0.1 + RADIUS, atol=1e-12)
    np.testing.assert_allclose(line[:, 1], 0.0, atol=1e-12)
    np.testing.assert_allclose(line[0], [0.09, 0.0, -0.4], atol=1e-12)


def test_closed_mesh_whichever_way_it_winds(make_world):
    world = make_world()
    add_torus(world)
    through = [[0.2, -0.02, 0.3], [0.2, 0.01, 0.0], [0.2, 0.02, -0.3]]
    t = tendon(world, through, "allow")
    heights = np.abs(here(t.positions)[:, 2])
    deep = np.minimum(heights[1:], heights[:-1])
    rows = world.penetrations()
    assert {9, 10} <= set(rows["segment"]) and set(rows["segment"]) <= set(np.flatnonzero(deep < 0.07))
    assert 0.05 < np.nanmax(rows["depth"]) < 0.07
    ring = [[0.2 * np.cos(s), 0.2 * np.sin(s), 0.01] for s in np.linspace(0, 2, 15)]
    wholly = tendon(world, ring, "allow", 15)
    assert (world.penetrations()["tendon"] == wholly.name).sum() == 14
    hole = tendon(world, [[0, 0, -0.3], [0, 0, 0.3]], "error")
    assert hole.name not in world.penetrations()["tendon"]


@pytest.mark.parametrize("seed", range(8))
def test_pushed_out_of_a_closed_mesh(make_world, seed):
    world = make_world()
    add_torus(world)
    rng = np.random.default_rng(seed)
    start = np.array([0.2, 0, 0]) + rng.uniform(-0.02, 0.02, 3)
    t = tendon(world, [start, start + rng.normal(size=3) * 0.1], "push_out")
    vertices, triangles = torus()
    line = here(t.positions)
    assert min(segment_triangles(a, b, vertices[triangles]) for a, b in zip(line, line[1:], strict=False)) > 0
    assert len(world.penetrations()) == 0


@pytest.mark.parametrize("inside", ["error", "push_out"])
def test_open_surface_is_only_crossed(make_world, inside):
    """A sheet has no inside and no way out: a clear error, and nothing has changed."""
    world = make_world()
    corners = [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]
    sheet = {"shapeType": p.GEOM_MESH, "vertices": corners, "indices": [0, 1, 2, 0, 2, 3]}
    body = add_body(world, **sheet)
    with pytest.raises(bt.InvalidValue, match=rf"body {body}, link -1 at segment 9"):
        tendon(world, [[0.1, 0, -0.2], [0.1, 0, 0.21]], inside)
    assert world.tendons == ()
    tendon(world, [[0.1, 0, 0.2], [0.1, 0, 0.01]], inside)
    tendon(world, [[0.1, 0, -0.2], [0.1, 0, 0.21]], "allow")
    rows = world.penetrations()
    assert rows["segment"].tolist() == [9] and np.isnan(rows["depth"]).all()


def test_a_particle_on_the_surface_is_not_inside(make_world):
    """As a ligament's end picked on a bone is."""
    world = make_world()
    add_torus(world)
    vertices, triangles = torus()
    for point in (vertices[0], vertices[triangles[0]].mean(0)):
        tendon(world, [point, 3 * point + (0, 0, 0.1)], "error")
    assert len(world.penetrations()) == 0


def test_plane(make_world, client):
    world = make_world()
    ground = p.createMultiBody(0, p.createCollisionShape(p.GEOM_PLANE, physicsClientId=client))
    world.add_obstacle(ground)
    line = [[0, 0, -0.02], [0.1, 0, 0.03]]
    with pytest.raises(bt.InvalidValue, match="outside all obstacles"):
        world.add_tendon(line, RADIUS, SOFT, 11, inside="error")
    t = world.add_tendon(line, RADIUS, SOFT, 11, inside="push_out")
    np.testing.assert_allclose(t.positions[:4, 2], RADIUS, atol=1e-12)
    np.testing.assert_allclose(t.positions[5:, 2], np.linspace(-0.02, 0.03, 11)[5:], atol=1e-12)


@pytest.mark.parametrize("height", np.linspace(0.02, 0.09, 8))
@pytest.mark.parametrize("n", [21, 56])
def test_particles_inside_an_edge_do_not_meet(make_world, height, n):
    """They are put over both faces, where the nearest point of several is the same."""
    world = make_world()
    add_primitive(world, "box")
    t = tendon(world, [[-0.3, 0.01, height + 0.15], [0.3, 0.01, height + 0.15]], "push_out", n)
    lengths = np.linalg.norm(np.diff(t.positions, axis=0), axis=1)
    assert lengths.min() > 0.09 * 0.6 / (n - 1)
    assert len(world.penetrations()) == 0
    world.step(2)
    assert world.report.converged


def test_a_bore_is_not_inside_its_bone(make_world):
    world = make_world()
    body = add_primitive(world, "box")
    world.add_tunnel(body, -1, (-0.1, 0, 0), (0.1, 0, 0), 0.006)
    line = [[-0.3, 0, 0], [0.3, 0, 0]]
    t = tendon(world, line, "push_out", 61)
    np.testing.assert_allclose(here(t.positions)[:, 1:], 0.0, atol=1e-12)
    assert len(world.penetrations()) == 0
    with pytest.raises(bt.InvalidValue, match="outside"):
        tendon(world, np.add(line, [0, 0.01, 0]), "error", 61)


def test_obstacles_that_come_later_and_move_are_seen(make_world, client):
    world = make_world()
    tendon(world, [[-0.05, 0, 0], [0.9, 0, 0]], "error")
    body = add_primitive(world, "sphere")
    assert world.penetrations()["depth"].max() == pytest.approx(0.2, abs=3e-3)
    p.resetBasePositionAndOrientation(body, PLACE + 5.0, TURN, physicsClientId=client)
    assert len(world.penetrations()) == 0


def test_a_removed_body_is_named(make_world, client):
    world = make_world()
    body = add_primitive(world, "sphere")
    p.removeBody(body, client)
    with pytest.raises(bt.UnknownId, match=f"bodyUniqueId = {body}"):
        world.penetrations()
    world.remove_obstacle(body)
    assert len(world.penetrations()) == 0


def test_inside_must_be_one_of_the_choices(make_world):
    with pytest.raises(bt.InvalidValue, match="'allow', 'push_out', 'error'"):
        tendon(make_world(), [[0, 0, 0], [1, 0, 0]], "drop")


@pytest.mark.skipif(not PATELLA.exists(), reason="no real bone beside the project (shared/knee/patella.stl)")
def test_out_of_a_real_bone(make_world):
    """Random lines through a patella: pushed out they cross it nowhere, by brute force."""
    world, bone = make_world(), read_mesh(PATELLA)
    made = p.createCollisionShape(
        p.GEOM_MESH,
        fileName=str(PATELLA),
        flags=p.GEOM_FORCE_CONCAVE_TRIMESH,
        physicsClientId=world.physicsClientId,
    )
    body = p.createMultiBody(0, made, physicsClientId=world.physicsClientId)
    world.add_obstacle(body, meshes=[PATELLA])
    rng, crossed = np.random.default_rng(3), 0
    for _ in range(8):
        middle = bone.vertices.mean(0) + rng.normal(size=3) * 0.006
        line = middle + np.outer([-1, 1], rng.normal(size=3) * 0.02)
        corners = bone.vertices[bone.triangles]
        crossed += segment_triangles(*line, corners) == 0
        x = world.add_tendon(line, 0.002, SOFT, 16, inside="push_out").positions
        assert min(segment_triangles(a, b, corners) for a, b in zip(x, x[1:], strict=False)) > 0
    assert crossed >= 4
