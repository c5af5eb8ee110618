"""Segments whose ends are held touch what they are led against, wherever force or motion can part them."""

import numpy as np
import pybullet as p
import pytest

import bullet_tendon as bt

RADIUS, WIDTH = 0.002, 0.01
MATERIAL = bt.Material(stiffness=1e4, damping=10.0, friction=0.0)
ACROSS = (0.5**0.5, 0, 0, 0.5**0.5)  # a cylinder along y

SHAPES = {
    "sphere": {"shapeType": p.GEOM_SPHERE, "radius": WIDTH},
    "cylinder": {"shapeType": p.GEOM_CYLINDER, "radius": WIDTH, "height": 0.1},
    "box": {"shapeType": p.GEOM_BOX, "halfExtents": [WIDTH, WIDTH, 0.05]},
}


def make_body(client, shape, mass, position):
    """Its section in the plane of x and z is that of the cylinder, or a square of the same width."""
    collision = p.createCollisionShape(**SHAPES[shape], physicsClientId=client)
    return p.createMultiBody(mass, collision, -1, position, ACROSS, physicsClientId=client)


def box_mesh():
    """The box as an OBJ file."""
    corners = [(x, y, z) for x in (-WIDTH, WIDTH) for y in (-WIDTH, WIDTH) for z in (-0.05, 0.05)]
    sides = [(1, 2, 4, 3), (5, 7, 8, 6), (1, 5, 6, 2), (3, 4, 8, 7), (1, 3, 7, 5), (2, 6, 8, 4)]
    faces = [half for a, b, c, d in sides for half in ((a, b, c), (a, c, d))]
    rows = [f"v {x} {y} {z}" for x, y, z in corners] + [f"f {a} {b} {c}" for a, b, c in faces]
    return "\n".join(rows) + "\n"


def clearance(client, tendon, body, shape):
    """Distance of the centreline from the body's surface [m], from many points; 0 where it is inside."""
    position, orientation = p.getBasePositionAndOrientation(body, client)
    share = np.linspace(0, 1, 400)[:, None]
    x = tendon.positions
    points = np.concatenate([a + share * (b - a) for a, b in zip(x[:-1], x[1:], strict=True)]) - position
    points = points @ np.reshape(p.getMatrixFromQuaternion(orientation), (3, 3))
    if shape == "box":
        return np.linalg.norm(np.maximum(np.abs(points) - [WIDTH, WIDTH, 0.05], 0), axis=1).min()
    axes = slice(0, 3 if shape == "sphere" else 2)
    return max(0.0, np.linalg.norm(points[:, axes], axis=1).min() - WIDTH)


@pytest.mark.parametrize("shape", ["sphere", "box"])
@pytest.mark.parametrize("place", [-0.06, 0.0, 0.03])
def test_a_segment_between_two_hands_carries_a_body(make_world, client, shape, place):
    """One string of two particles carries a ball, two carry a box."""
    world = make_world(gravity=(0, 0, -9.81))
    body = make_body(client, shape, 0.2, (place, 0, WIDTH + 2 * RADIUS))
    world.add_obstacle(body)
    for side in [0.0] if shape == "sphere" else [-0.04, 0.04]:
        string = world.add_tendon([(-0.1, side, 0), (0.1, side, 0)], RADIUS, MATERIAL)
        string.grip(0), string.grip(-1)
    for _ in range(240):
        world.step()
        assert world.report.converged
    position, _ = p.getBasePositionAndOrientation(body, client)
    np.testing.assert_allclose(position, (place, 0, WIDTH + RADIUS), atol=0.05 * RADIUS)
    np.testing.assert_allclose(world.wrench(body)[:3], (0, 0, 0.2 * 9.81), atol=1e-3 * 0.2 * 9.81)


@pytest.mark.parametrize("shape, place", [("sphere", 0.02), ("cylinder", 0.02), ("box", 0.0)])
def test_a_segment_between_two_bodies_is_struck(make_world, client, shape, place):
    """It gives on what strikes it to the bodies at its ends: none of the momentum is lost."""
    world = make_world()
    bodies = [make_body(client, "sphere", 1.0, (x, 0, 0)) for x in (-0.11, 0.11)]
    bodies.append(make_body(client, shape, 0.5, (place, 0, WIDTH + 1.5 * RADIUS)))
    for body in bodies:
        p.changeDynamics(body, -1, linearDamping=0, angularDamping=0, physicsClientId=client)
    world.add_obstacle(bodies[-1])
    string = world.add_tendon([(-0.1, 0, 0), (0.1, 0, 0)], RADIUS, MATERIAL)
    string.attach(0, bodies[0]), string.attach(-1, bodies[1])
    p.resetBaseVelocity(bodies[-1], (0, 0, -0.5), physicsClientId=client)
    for _ in range(60):
        world.step()
        assert clearance(client, string, bodies[-1], shape) > 0.95 * RADIUS
    speeds = [p.getBaseVelocity(body, client)[0] for body in bodies]
    momentum = np.array([1.0, 1.0, 0.5]) @ speeds + string.masses @ string.velocities
    np.testing.assert_allclose(momentum, (0, 0, -0.25), atol=1e-9)
    assert speeds[0][2] < -0.02 and speeds[1][2] < -0.02


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("hangs", ["a body", "a point mass"])
def test_a_cord_of_two_particles_is_pushed_aside(make_world, client, shape, hangs):
    world = make_world(gravity=(0, 0, -9.81))
    cord = world.add_tendon([(0, 0, 0), (0, 0, -0.1)], RADIUS, MATERIAL)
    cord.grip(0)
    if hangs == "a body":
        cord.attach(-1, make_body(client, "sphere", 1.0, (0, 0, -0.11)), position=(0, WIDTH, 0))
    else:
        cord.set_point_mass(-1, 1.0)
    post = make_body(client, shape, 0, (WIDTH + 2 * RADIUS, 0, -0.05))
    world.add_obstacle(post)
    p.resetBaseVelocity(post, (-0.024, 0, 0), physicsClientId=client)
    for _ in range(120):
        world.step()
        assert clearance(client, cord, post, shape) > 0.95 * RADIUS
    assert cord.positions[-1, 0] < -0.012


@pytest.mark.parametrize("form", ["box", "hull", "mesh"])
@pytest.mark.parametrize("place", [-0.03, -0.035])
def test_a_face_beside_the_hand_pushes_the_first_segment(make_world, client, tmp_path, form, place):
    """The plane of the face goes on to the hand, which the box itself is not under."""
    world = make_world(gravity=(0, 0, -9.81))
    cord = world.add_tendon([(0, 0, 0), (0, 0, -0.1)], RADIUS, MATERIAL, particles=3)
    cord.grip(0), cord.set_point_mass(-1, 1.0)
    at = WIDTH + 2 * RADIUS, 0, place
    if form == "box":
        post, given = make_body(client, "box", 0, at), []
    else:
        path = tmp_path / "box.obj"
        path.write_text(box_mesh())
        flags = p.GEOM_FORCE_CONCAVE_TRIMESH if form == "mesh" else 0
        shape = p.createCollisionShape(p.GEOM_MESH, fileName=str(path), flags=flags, physicsClientId=client)
        post = p.createMultiBody(0, shape, -1, at, ACROSS, physicsClientId=client)
        given = [str(path)] if form == "mesh" else []
    world.add_obstacle(post, meshes=given)
    p.resetBaseVelocity(post, (-0.024, 0, 0), physicsClientId=client)
    for _ in range(120):
        world.step()
        assert clearance(client, cord, post, "box") > 0.95 * RADIUS
    assert cord.positions[1, 0] < -0.012
