"""Random URDFs: mirrored shapes against pybullet's distances, wrenches about the centre of mass."""

import numpy as np
import pybullet as p
import pytest
from link_scenes import link_frame

import bullet_tendon as bt
from bullet_tendon.shapes import collision_shapes


def _numbers(values):
    return " ".join(f"{v:.6f}" for v in values)


def _origin(rng, far=0.3):
    return f'<origin xyz="{_numbers(rng.uniform(-far, far, 3))}" rpy="{_numbers(rng.uniform(-3, 3, 3))}"/>'


def _geometry(rng):
    a, b, c = rng.uniform(0.02, 0.1, 3)
    kinds = [f'<box size="{a} {b} {c}"/>', f'<sphere radius="{a}"/>', f'<capsule radius="{a}" length="{b}"/>']
    return rng.choice(kinds)


def random_urdf(rng, path):
    """A chain or a tree of 1 to 5 links, each with an inertial offset and up to 3 collision shapes."""
    count = int(rng.integers(1, 6))
    parts = []
    for i in range(count):
        shapes = "".join(
            f"<collision>{_origin(rng)}<geometry>{_geometry(rng)}</geometry></collision>"
            for _ in range(rng.integers(0 if i else 1, 4))
        )
        ixx, iyy, izz = rng.uniform(1e-3, 2e-3, 3)
        inertia = f'<inertia ixx="{ixx}" iyy="{iyy}" izz="{izz}" ixy="0" ixz="0" iyz="0"/>'
        mass = f'<inertial>{_origin(rng)}<mass value="{rng.uniform(0.1, 2)}"/>{inertia}</inertial>'
        parts.append(f'<link name="l{i}">{mass}{shapes}</link>')
        if i:
            kind = rng.choice(["revolute", "prismatic", "fixed", "continuous"])
            axis = rng.normal(size=3)
            parts.append(
                f'<joint name="j{i}" type="{kind}"><parent link="l{rng.integers(i)}"/><child link="l{i}"/>'
                f'{_origin(rng)}<axis xyz="{_numbers(axis / np.linalg.norm(axis))}"/>'
                '<limit lower="-3" upper="3" effort="1" velocity="1"/></joint>'
            )
    path.write_text(f'<robot name="r">{"".join(parts)}</robot>')
    return path


@pytest.mark.parametrize("count", [15, pytest.param(1000, marks=pytest.mark.slow)])
def test_random_urdfs(client, make_world, probe, tmp_path, count):
    rng = np.random.default_rng(12)
    compared = 0
    for k in range(count):
        scale = float(rng.choice([1.0, 1.0, 0.5, 2.0]))
        flags = int(rng.choice([0, p.URDF_USE_INERTIA_FROM_FILE, p.URDF_MERGE_FIXED_LINKS]))
        path = random_urdf(rng, tmp_path / f"random{k}.urdf")
        turn = rng.normal(size=4)
        at = {"basePosition": rng.uniform(-2, 2, 3), "baseOrientation": turn / np.linalg.norm(turn)}
        body = p.loadURDF(str(path), **at, globalScaling=scale, flags=flags, physicsClientId=client)
        for j in range(p.getNumJoints(body, client)):
            p.resetJointState(body, j, float(rng.uniform(-0.3, 0.3)), physicsClientId=client)
        for link in range(-1, p.getNumJoints(body, client)):
            shapes = collision_shapes(body, link, client, None, ())
            if shapes:
                compared += check_faces(client, probe, body, link, shapes)
            check_wrench(client, make_world(), rng, body, link)
        p.removeBody(body, client)
    assert compared > 10 * count


def check_faces(client, probe, body, link, shapes) -> int:
    """From beside each shape's faces, where it is the nearest: Bullet rounds others' edges."""
    origin, axes = link_frame(client, body, link)
    compared = 0
    for shape in shapes:
        middle, half = shape.bounds.mean(0), np.ptp(shape.bounds, axis=0) / 2
        for direction in np.vstack([np.eye(3), -np.eye(3)]):
            point = shape.position + shape.rotation @ (middle + direction * (half + 0.05))
            found = [distance(other, point) for other in shapes]
            if min(found) < distance(shape, point):
                continue
            assert probe(body, link, origin + axes @ point) == pytest.approx(min(found), abs=1e-6)
            compared += 1
    return compared


def distance(shape, point) -> float:
    local = (shape.rotation.T @ (point - shape.position))[None]
    return shape.measure(local, local)[0][0]


def check_wrench(client, world, rng, body, link):
    """A tendon pulls at a point of the link: the wrench is that force at that point, by pybullet's frames."""
    origin, axes = link_frame(client, body, link)
    local = rng.uniform(-0.2, 0.2, 3)
    point = origin + axes @ local
    # Too soft to turn a body far within the step, by which its arm would turn too (test_off_centre.py).
    t = world.add_tendon([point, point + [0.1, 0, 0]], 0.002, bt.Material(stiffness=1.0), 4)
    hold = t.attach(0, body, link, local)
    t.grip(-1, target=point + [0.12, 0.03, 0])
    world.apply()
    if link < 0:
        centre = p.getBasePositionAndOrientation(body, client)[0]
    else:
        centre = p.getLinkState(body, link, computeForwardKinematics=True, physicsClientId=client)[0]
    wrench, force = world.wrench(body, link), hold.force
    assert np.linalg.norm(force) > 1e-3
    np.testing.assert_allclose(wrench[:3], force, atol=1e-10)
    np.testing.assert_allclose(wrench[3:], np.cross(point - centre, force), atol=1e-10)
