"""Bodies that lie along two taut cords of few particles: each cord holds a body over its whole length."""

import numpy as np
import pybullet as p
import pytest

import bullet_tendon as bt

RADIUS, HALF = 0.002, 0.1  # m: of the cords; half their length
SIZE, LENGTH, APART = 0.01, 0.06, 0.012  # m: half width and length of the body; distance of the cords
CORNERS = [(x, y, z) for x in (-SIZE, SIZE) for y in (-SIZE, SIZE) for z in (-LENGTH / 2, LENGTH / 2)]
AROUND = np.linspace(0, 2 * np.pi, 33)[:-1]
PRISM = [(SIZE * np.cos(a), SIZE * np.sin(a), z) for a in AROUND for z in (-LENGTH / 2, LENGTH / 2)]
SHAPES = {
    "box": (p.GEOM_BOX, {"halfExtents": [SIZE, SIZE, LENGTH / 2]}),
    "hull_box": (p.GEOM_MESH, {"vertices": CORNERS}),
    "cylinder": (p.GEOM_CYLINDER, {"radius": SIZE, "height": LENGTH}),
    "capsule": (p.GEOM_CAPSULE, {"radius": SIZE, "height": LENGTH}),
    "hull_cylinder": (p.GEOM_MESH, {"vertices": PRISM}),
}
FACES = [(1, 2, 4, 3), (5, 7, 8, 6), (1, 5, 6, 2), (3, 4, 8, 7), (1, 3, 7, 5), (2, 6, 8, 4)]  # of CORNERS


@pytest.fixture
def triangles(tmp_path):
    """The box as a file of triangles."""
    lines = [f"v {x} {y} {z}\n" for x, y, z in CORNERS]
    lines += [f"f {a} {b} {c}\nf {a} {c} {d}\n" for a, b, c, d in FACES]
    file = tmp_path / "box.obj"
    file.write_text("".join(lines))
    return {"mesh_box": (p.GEOM_MESH, {"fileName": str(file)})}, {"meshes": [str(file)], "convex": False}


def lay_on(world, client, shape, angle, particles, friction, aside, yaw, mass, triangles):
    """Returns the body and the holds of both cords, which diverge by twice the angle [rad]."""
    mesh, as_mesh = triangles
    kind, form = (SHAPES | mesh)[shape]
    material = bt.Material(stiffness=1e4, friction=1.0, damping=5.0)
    holds = []
    for side in (-1, 1):
        middle = np.array([0, side * APART / 2, 0])
        along = HALF * np.array([np.cos(angle), side * np.sin(angle), 0])
        t = world.add_tendon([middle - along, middle + along], RADIUS, material, particles)
        holds += [t.grip(0), t.grip(-1)]
    is_flat = shape.endswith("box")
    height = SIZE + RADIUS if is_flat else np.sqrt((SIZE + RADIUS) ** 2 - (APART / 2) ** 2)
    turn = p.getQuaternionFromEuler((0, 0, yaw)), p.getQuaternionFromEuler((0, np.pi / 2, 0))
    turn = p.multiplyTransforms((0, 0, 0), turn[0], (0, 0, 0), turn[1])[1]
    collision = p.createCollisionShape(kind, physicsClientId=client, **form)
    body = p.createMultiBody(mass, collision, -1, (aside, 0, height + 1e-5), turn, physicsClientId=client)
    world.add_obstacle(body, friction=friction, **(as_mesh if shape in mesh else {}))
    return body, holds


@pytest.mark.parametrize("shape", [*SHAPES, "mesh_box"])
@pytest.mark.parametrize("particles", [2, 3])
@pytest.mark.parametrize(
    ("dt", "angle", "yaw", "aside", "friction", "mass"),
    [
        (1 / 60, -1e-3, 1e-3, 0.0, 1.0, 0.5),
        (1 / 60, -1e-9, 1e-6, 0.0397, 0.3, 0.005),
        (1 / 60, 1e-3, 0.0, 0.0152, 0.3, 0.005),
        (1 / 240, 1e-4, 1e-3, -0.0315, 1.0, 0.05),
        (1 / 1000, 3e-3, 3e-3, 0.02, 0.3, 0.5),
    ],
)
def test_a_body_that_is_laid_on_two_cords_rests_on_them(
    make_world, client, triangles, shape, particles, dt, angle, yaw, aside, friction, mass
):
    """It would tip over the nearest points, and be thrown, or fall through."""
    world = make_world(dt, (0, 0, -9.81))
    body, holds = lay_on(world, client, shape, angle, particles, friction, aside, yaw, mass, triangles)
    for _ in range(round(2.5 * max(1, 1 / (60 * dt)) ** 0.5 * 60)):
        world.step()
        assert world.report.converged
    speed, turning = map(np.linalg.norm, p.getBaseVelocity(body, physicsClientId=client))
    assert speed < 0.02 and turning < 1.0
    place = p.getBasePositionAndOrientation(body, physicsClientId=client)[0]
    assert np.hypot(place[0] - aside, place[1]) < 0.1 * LENGTH
    weight = 9.81 * (mass + sum(t.masses.sum() for t in world.tendons))
    assert sum(hold.force[2] for hold in holds) == pytest.approx(-weight, rel=0.1)
