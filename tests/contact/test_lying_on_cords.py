"""Bodies that lie along two taut cords of few particles: each cord holds a body over its whole length."""

import numpy as np
import pybullet as p
import pytest
from link_scenes import UNDAMPED, cube

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
    "mesh_box": (p.GEOM_MESH, {"vertices": CORNERS}),
}


def lay_on(world, client, shape, angle, particles, friction, aside, yaw, mass):
    """Returns the body and the holds of both cords, which diverge by twice the angle [rad]."""
    kind, form = SHAPES[shape]
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
    triangles = {"meshes": [(CORNERS, cube(1)[1])], "convex": False} if shape == "mesh_box" else {}
    world.add_obstacle(body, friction=friction, **triangles)
    return body, holds


@pytest.mark.parametrize("shape", SHAPES)
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
    make_world, client, shape, particles, dt, angle, yaw, aside, friction, mass
):
    """It would tip over the nearest points, and be thrown, or fall through."""
    world = make_world(dt, (0, 0, -9.81))
    body, holds = lay_on(world, client, shape, angle, particles, friction, aside, yaw, mass)
    for _ in range(round(2.5 * max(1, 1 / (60 * dt)) ** 0.5 * 60)):
        world.step()
        assert world.report.converged
    speed, turning = map(np.linalg.norm, p.getBaseVelocity(body, physicsClientId=client))
    assert speed < 0.02 and turning < 1.0
    place = p.getBasePositionAndOrientation(body, physicsClientId=client)[0]
    assert np.hypot(place[0] - aside, place[1]) < 0.1 * LENGTH
    weight = 9.81 * (mass + sum(t.masses.sum() for t in world.tendons))
    assert sum(hold.force[2] for hold in holds) == pytest.approx(-weight, rel=0.1)


@pytest.mark.parametrize(
    ("particles", "mass", "yaw"), [(5, 0.05, 0.1), (9, 0.05, 0.1), (17, 0.005, 0.1), (17, 0.05, 0.05)]
)
def test_a_cylinder_that_rests_obliquely(make_world, client, particles, mass, yaw):
    """The body turns as its contacts do, so that a step of what does not move is few solutions.

    With five particles, segments begin each step as lying along it, and are found to cross it.
    """
    world = make_world(1 / 60, (0, 0, -9.81))
    body, holds = lay_on(world, client, "cylinder", 0, particles, 1.0, 0, yaw, mass)
    p.changeDynamics(body, -1, **UNDAMPED, physicsClientId=client)
    solutions = []
    for _ in range(120):
        world.step()
        assert world.report.converged
        solutions.append(world.report.counts["linear_solves"])
    assert sum(solutions[-30:]) < 240
    assert np.linalg.norm(p.getBaseVelocity(body, physicsClientId=client)[1]) < 1e-3
    weight = 9.81 * (mass + sum(t.masses.sum() for t in world.tendons))
    assert sum(hold.force[2] for hold in holds) == pytest.approx(-weight, rel=1e-3)
