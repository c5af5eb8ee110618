"""load_urdf: bodies with the tunnels, tendons and obstacles of their file; nothing left where it fails."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pybullet as p
import pytest

import bullet_tendon as bt
from bullet_tendon.loading import link_indices
from bullet_tendon.urdf_elements import read_elements

URDF = Path(__file__).parents[2] / "urdf"
FLAGS = {"useFixedBase": True, "flags": p.URDF_USE_INERTIA_FROM_FILE}
LINKS = (
    '<link name="a"><inertial><origin xyz="0.02 0 0"/><mass value="1"/>'
    '<inertia ixx="1e-3" ixy="0" ixz="0" iyy="1e-3" iyz="0" izz="1e-3"/></inertial>'
    '<collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision></link>'
    '<link name="b"><inertial><mass value="1"/>'
    '<inertia ixx="1e-3" ixy="0" ixz="0" iyy="1e-3" iyz="0" izz="1e-3"/></inertial></link>'
    '<joint name="j" type="fixed"><parent link="a"/><child link="b"/>'
    '<origin xyz="0 0 0.3" rpy="0.4 0 0"/></joint>'
)
TUNNEL = '<tunnel name="bore" link="a" radius="0.006"><start xyz="0 0 -0.05"/><end xyz="0 0 0.05"/></tunnel>'
TENDON = (
    '<tendon name="graft" radius="0.003" particles="21"><material stiffness="3e3" damping="3"/>'
    '<point link="a" xyz="0 0 -0.1" attach="true"/><point xyz="0.5 0 0.2"/>'
    '<point link="b" xyz="0 0.02 0" attach="true"/></tendon>'
)


@pytest.fixture
def written(tmp_path):
    """written(*elements): path of a URDF of two links with those elements."""

    def write(*elements):
        path = tmp_path / "model.urdf"
        path.write_text(f'<robot name="r">{LINKS}{"".join(elements)}</robot>', encoding="utf-8")
        return str(path)

    return write


def state(world):
    client = world.physicsClientId
    return p.getNumBodies(client), world.tendons, world.tunnels


@pytest.mark.parametrize("name", ["knee.urdf", "femur.urdf", "tibia.urdf"])
def test_the_packages_bones(make_world, name):
    """Every tunnel of the file, on its link, where the file says; no undrilled bone is felt inside."""
    world = make_world(1 / 240)
    body = world.load_urdf(str(URDF / name), [0.1, 0.2, 0.3], **FLAGS)
    client, elements = world.physicsClientId, read_elements(URDF / name)
    links = link_indices(body, client)
    assert len(world.tunnels) == len(elements.tunnels) > 0
    for tunnel, element in zip(world.tunnels, elements.tunnels, strict=True):
        assert (tunnel.name, tunnel.linkIndex, tunnel.bodyUniqueId) == (
            element.name,
            links[element.link],
            body,
        )
        np.testing.assert_array_equal(tunnel.start, element.start)
        np.testing.assert_array_equal(tunnel.end, element.end)
        assert (tunnel.radius, tunnel.friction) == (element.radius, element.friction)
        assert tunnel.chamfer == element.chamfer > 0
    tunnel = world.tunnels[0]
    if tunnel.linkIndex >= 0:
        origin, turn = p.getLinkState(body, tunnel.linkIndex, 0, 1, client)[4:6]
    else:
        info = p.getDynamicsInfo(body, -1, client)
        base = p.getBasePositionAndOrientation(body, client)
        origin, turn = p.multiplyTransforms(*base, *p.invertTransform(info[3], info[4]))
    axes = np.array(p.getMatrixFromQuaternion(turn)).reshape(3, 3)
    start, end = origin + axes @ tunnel.start, origin + axes @ tunnel.end
    t = world.add_tendon([start, end], 0.003, bt.Material(stiffness=3e3, damping=3.0), 21)
    before = t.positions
    world.step(20)
    assert np.abs(t.positions - before).max() < 1e-6
    t.set_force(10, axes @ np.cross(tunnel.end - tunnel.start, [0.3, 0.1, 0.7]) * 100)
    world.step(200)
    along = (end - start) / np.linalg.norm(end - start)
    local = t.positions - start
    off = np.linalg.norm(local - np.outer(local @ along, along), axis=1)
    assert off.max() == pytest.approx(0.001, abs=2e-5)


def test_bones_are_obstacles_unless_asked(make_world):
    """A tendon inside the undrilled femur's box is measured; where bones are no obstacles, it is not."""
    for obstacles in (True, False):
        world = make_world(1 / 240)
        body = world.load_urdf(str(URDF / "femur.urdf"), obstacles=obstacles, **FLAGS)
        low, high = (np.array(x) for x in p.getAABB(body, -1, world.physicsClientId))
        middle = (low + high) / 2
        world.add_tendon([middle, middle + [0.05, 0, 0]], 0.003, bt.Material(stiffness=3e3), 6)
        world.step()
        counts = world.report.counts
        assert (counts["pairs_searched"] + counts["pairs_queried"] > 0) == obstacles


def test_tendons_and_tunnels_are_placed_in_their_links(make_world, written):
    world = make_world(1.0)
    turn = p.getQuaternionFromEuler([0.2, -0.3, 0.9])
    place = np.array([0.3, -0.1, 0.5])
    body = world.load_urdf(written(TUNNEL, TENDON), place, turn, useFixedBase=True)
    (t,), (tunnel,) = world.tendons, world.tunnels
    axes = np.array(p.getMatrixFromQuaternion(turn)).reshape(3, 3)
    tilt = np.array(p.getMatrixFromQuaternion(p.getQuaternionFromEuler([0.4, 0, 0]))).reshape(3, 3)
    first = place + axes @ [0, 0, -0.1]
    last = place + axes @ (np.array([0, 0, 0.3]) + tilt @ [0, 0.02, 0])
    np.testing.assert_allclose(t.positions[0], first, atol=1e-8)
    np.testing.assert_allclose(t.positions[-1], last, atol=1e-8)
    assert np.linalg.norm(t.positions - [0.5, 0, 0.2], axis=1).min() < 0.05
    assert (t.name, t.particles, t.radius, t.material.stiffness) == ("graft", 21, 0.003, 3e3)
    assert (tunnel.bodyUniqueId, tunnel.linkIndex, tunnel.name) == (body, -1, "bore")
    for end in (0, -1):
        with pytest.raises(bt.InvalidValue, match="attached already"):
            t.grip(end)
    t.set_force(10, [0, 0, -2.0])
    world.step(60)
    np.testing.assert_allclose(t.positions[0], first, atol=1e-8)
    np.testing.assert_allclose(t.positions[-1], last, atol=1e-8)
    held = world.wrench(body, -1)[:3] + world.wrench(body, 0)[:3]
    np.testing.assert_allclose(held, [0, 0, -2.0], atol=1e-4)


@pytest.mark.parametrize("positional", [False, True])
def test_scaled_bodies_have_scaled_elements(make_world, written, positional):
    """Tunnels and tendons are as much larger as their links; what is in the world frame stays there."""
    world, by, place = make_world(1 / 240), 2.5, np.array([0.3, -0.1, 0.5])
    path = written(TUNNEL.replace('radius="0.006"', 'radius="0.006" chamfer="0.002"'), TENDON)
    if positional:
        world.load_urdf(path, place, (0, 0, 0, 1), False, True, 0, by)
    else:
        world.load_urdf(path, place, useFixedBase=True, globalScaling=by)
    (t,), (tunnel,) = world.tendons, world.tunnels
    np.testing.assert_allclose(tunnel.ends, place + by * np.array([(0, 0, -0.05), (0, 0, 0.05)]), atol=1e-12)
    assert (tunnel.radius, tunnel.chamfer) == (0.006 * by, 0.002 * by)
    tilt = np.array(p.getMatrixFromQuaternion(p.getQuaternionFromEuler([0.4, 0, 0]))).reshape(3, 3)
    last = place + by * (np.array([0, 0, 0.3]) + tilt @ [0, 0.02, 0])
    np.testing.assert_allclose(t.positions[0], place + by * np.array([0, 0, -0.1]), atol=1e-8)
    np.testing.assert_allclose(t.positions[-1], last, atol=1e-8)
    assert np.linalg.norm(t.positions - [0.5, 0, 0.2], axis=1).min() < 0.05
    assert t.radius == 0.003 * by
    before = t.positions
    t.set_force(10, (0, 0, -1))
    world.step(60)
    np.testing.assert_allclose(t.positions[[0, -1]], before[[0, -1]], atol=1e-8)


@pytest.mark.parametrize("element", [TUNNEL.replace('link="a"', 'link="b"'), TENDON])
def test_elements_on_merged_links_are_refused(make_world, written, element):
    world = make_world()
    before = state(world)
    with pytest.raises(bt.UrdfError, match="pybullet keeps") as caught:
        world.load_urdf(written(element), flags=p.URDF_MERGE_FIXED_LINKS)
    assert (caught.value.attribute, caught.value.value) == ("link", "b")
    assert state(world) == before


def test_bodies_in_maximal_coordinates_are_no_obstacles(make_world, tmp_path):
    path = tmp_path / "model.urdf"
    path.write_text(
        '<robot name="r">' + LINKS[: LINKS.index("</link>")] + "</link></robot>", encoding="utf-8"
    )
    world = make_world()
    before = state(world)
    with pytest.raises(bt.InvalidValue, match="maximal coordinates"):
        world.load_urdf(str(path), useMaximalCoordinates=True)
    assert state(world) == before
    world.load_urdf(str(path), obstacles=False, useMaximalCoordinates=True)


@pytest.mark.parametrize("scaling", [0, -1.0, float("nan"), "2"])
def test_scalings_that_are_none_are_refused(make_world, written, scaling):
    world = make_world()
    before = state(world)
    with pytest.raises(bt.TendonError, match="globalScaling"):
        world.load_urdf(written(TUNNEL), globalScaling=scaling)
    assert state(world) == before


def test_link_indices(make_world, written, client):
    body = make_world().load_urdf(written(), useFixedBase=True)
    assert link_indices(body, client) == {"a": -1, "b": 0}


WRONG = [
    (TUNNEL.replace('link="a"', 'link="c"'), "link"),
    (TUNNEL.replace('"0.006"', '"-1"'), "radius"),
    (TUNNEL.replace("0 0 0.05", "0 0 up"), "xyz"),
    (TENDON.replace('"3e3"', '"0"'), "stiffness"),
    (TENDON.replace('damping="3"', 'damping="3" shear_stiffness="1e9"'), "shear_stiffness"),
    (TENDON.replace('damping="3"', 'damping="3" shear_stiffness="2e3"'), "shear_stiffness"),
    (TENDON.replace('<material stiffness="3e3" damping="3"/>', '<material preset="rope"/>'), "preset"),
    (TENDON.replace('particles="21"', 'particles="1"'), "particles"),
]


@pytest.mark.parametrize(("element", "attribute"), WRONG)
def test_what_is_wrong_leaves_nothing(make_world, written, element, attribute):
    world = make_world()
    kept = world.load_urdf(written(), useFixedBase=True)
    before = state(world)
    path = written(TUNNEL if "tendon" in element else TENDON, element)
    with pytest.raises(bt.UrdfError) as caught:
        world.load_urdf(path)
    assert caught.value.attribute == attribute
    assert path in str(caught.value)
    assert state(world) == before
    world.wrench(kept)
    world.step()


def test_taken_names_leave_nothing(make_world, written):
    world = make_world()
    path = written(TUNNEL, TENDON)
    world.load_urdf(path, useFixedBase=True)
    before = state(world)
    with pytest.raises(bt.UrdfError) as caught:
        world.load_urdf(path, [1, 0, 0])
    assert caught.value.attribute == "name"
    assert state(world) == before


def test_failures_after_loading_leave_nothing(make_world, written):
    """A tunnel too short for its chamfers, and two points in one place, are found when the body is there."""
    world = make_world()
    before = state(world)
    coincident = TENDON.replace('<point xyz="0.5 0 0.2"/>', '<point link="a" xyz="0 0 -0.1"/>')
    for element in (TUNNEL.replace('radius="0.006"', 'radius="0.006" chamfer="0.06"'), coincident):
        with pytest.raises(bt.TendonError):
            world.load_urdf(
                written(TENDON.replace("graft", "first"), TUNNEL.replace("bore", "first"), element)
            )
        assert state(world) == before
        world.step()


def test_files_that_are_not_there(make_world, tmp_path):
    world = make_world()
    with pytest.raises(bt.TendonError):
        world.load_urdf(str(tmp_path / "none.urdf"))
    assert state(world) == (0, (), ())
    assert Path(bt.data_path("knee.urdf")).read_bytes() == (URDF / "knee.urdf").read_bytes()


LOADED = """
import pybullet as p, bullet_tendon as bt
client = p.connect(p.DIRECT)
world = bt.TendonWorld(client)
for name in ("knee.urdf", "femur.urdf", "tendon_finger.urdf"):
    world.load_urdf(bt.data_path(name), useFixedBase=True)
"""
ADDED = """
import pybullet as p, bullet_tendon as bt
client = p.connect(p.DIRECT)
world = bt.TendonWorld(client)
world.add_obstacle(p.loadURDF(bt.data_path("tibia.urdf")))
corners, faces = [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
hull = p.createCollisionShape(p.GEOM_MESH, vertices=corners)
triangles = p.createCollisionShape(p.GEOM_MESH, vertices=corners, indices=sum(faces, []))
world.add_obstacle(p.createMultiBody(0, hull))
world.add_obstacle(p.createMultiBody(0, triangles), meshes=[(corners, faces)])
world.add_obstacle(p.createMultiBody(0, p.createCollisionShape(p.GEOM_SPHERE, radius=0.1)))
"""


# Hulls, triangles and a sphere in one link: which is which is in the file.
MIXED = """
import pathlib, tempfile
import pybullet as p, bullet_tendon as bt
from link_scenes import tetra_obj
folder = pathlib.Path(tempfile.mkdtemp())
tetra_obj(folder / "one.obj")
tetra_obj(folder / "two.obj", groups=2)
mesh = '<mesh filename="{}.obj" scale="1 1 {}"/>'.format
ball = '<sphere radius=".2"/>'
parts = ["", mesh("one", 1)], ['concave="0"', mesh("two", 2)], ["", ball], ["", mesh("two", 3)]
shapes = "".join(f"<collision {c}><geometry>{g}</geometry></collision>" for c, g in parts)
heavy = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
(folder / "mixed.urdf").write_text(f'<robot name="r"><link name="a">{heavy}{shapes}</link></robot>')
world = bt.TendonWorld(p.connect(p.DIRECT))
body = world.load_urdf(folder / "mixed.urdf", useFixedBase=True)
kinds = ["hull" if hasattr(s.query, "hull") else s.kind for s in world._obstacles.shapes.values()]
assert kinds == ["hull", "mesh", "sphere", "hull", "hull"], kinds
"""


@pytest.mark.parametrize("script", [LOADED, ADDED, MIXED], ids=["load_urdf", "add_obstacle", "mixed"])
def test_nothing_is_printed(script):
    """pybullet's getMeshData would print a lone question mark for every mesh that is no hull."""
    found = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, env=found)
    assert run.returncode == 0, run.stderr
    assert run.stdout == ""
    assert "?" not in run.stderr
