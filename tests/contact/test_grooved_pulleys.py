"""A cord in the groove of a pulley of facets, as a mesh has them, that turns on a joint."""

import numpy as np
import pybullet as p
import pytest
from link_scenes import free_ball, links_on_joints, mesh_obstacle, triangles_shape

import bullet_tendon as bt

G, DT = 9.81, 1 / 240
BOTTOM, RIM, WIDTH, RADIUS = 0.04, 0.048, 0.024, 0.002  # m
OUT = BOTTOM + 1.5 * RADIUS + 0.001  # of the cord, at first [m]
LIGHT, INERTIA = 1.0, 1e-4  # kg, kg m^2


def grooved(facets):
    """Vertices and triangles of a V-groove around the y axis."""
    angles = np.arange(facets) * 2 * np.pi / facets
    rings = ((-WIDTH / 2, RIM), (0.0, BOTTOM), (WIDTH / 2, RIM))
    vertices = np.array([[r * np.cos(a), y, r * np.sin(a)] for y, r in rings for a in angles])
    first = np.arange(facets)
    following = (first + 1) % facets
    sides = []
    for ring in (0, facets):
        sides.append(np.c_[first + ring, following + ring, following + ring + facets])
        sides.append(np.c_[first + ring, following + ring + facets, first + ring + facets])
    return vertices, np.concatenate(sides)


def over_it(world, client, particles, friction, masses):
    """A cord over the groove, and the weights at its ends."""
    angles = np.linspace(np.pi, 0, 17)
    around = np.c_[OUT * np.cos(angles), 0 * angles, OUT * np.sin(angles)].tolist()
    material = bt.Material.from_modulus(2e8, RADIUS, friction=friction)
    cord = world.add_tendon([[-OUT, 0, -0.3], *around, [OUT, 0, -0.3]], RADIUS, material, particles)
    weights = []
    for end, mass in zip((0, -1), masses, strict=True):
        weights.append(free_ball(client, mass, cord.positions[end], 0.02))
        cord.attach(end, weights[-1])
    return cord, weights


def pulley(world, client, facets):
    """Its body; link 0 turns freely."""
    vertices, faces = grooved(facets)
    shape = triangles_shape(client, vertices, faces)
    body = links_on_joints(client, p.JOINT_REVOLUTE, [0.2], [(0, 1, 0)], shape)
    p.changeDynamics(body, 0, localInertiaDiagonal=[INERTIA] * 3, physicsClientId=client)
    p.setJointMotorControl2(body, 0, p.VELOCITY_CONTROL, force=0, physicsClientId=client)
    world.add_obstacle(body, 0, friction=1.0, convex=False, meshes=[(vertices, faces)])
    return body


@pytest.mark.filterwarnings("ignore::bullet_tendon.ResolutionWarning")
@pytest.mark.parametrize(("heavy", "friction"), [(1.2, 0.5), (1.5, 0.3)], ids=str)
@pytest.mark.parametrize("facets", [24, 36])
def test_two_weights_turn_it(make_world, client, facets, heavy, friction):
    """(m_2 - m_1) g / (m_1 + m_2 + I / R^2), the same for the cord and the rim; it stays in the groove."""
    world = make_world(DT, (0, 0, -G))
    wheel = pulley(world, client, facets)
    cord, weights = over_it(world, client, 40, friction, (LIGHT, heavy))

    def lead():
        up, down = (p.getBasePositionAndOrientation(w, client)[0][2] for w in weights)
        return (up - down) / 2

    ways, turns = [], []
    for _ in range(130):
        world.step()
        assert world.report.converged
        assert world.report.iterations < 200
        ways.append(lead())
        turns.append(OUT * p.getJointState(wheel, 0, client)[0])
    times = DT * np.arange(len(ways))
    expected = (heavy - LIGHT) * G / (LIGHT + heavy + INERTIA / OUT**2 + cord.masses.sum())
    # The corners of the polygon lift the cord as they pass: the speeds have ripples.
    for way in (ways, turns):
        assert 2 * np.polyfit(times, way, 2)[0] == pytest.approx(expected, rel=0.1)
    around = np.hypot(cord.positions[:, 0], cord.positions[:, 2]) < 1.1 * OUT
    assert np.abs(cord.positions[around & (cord.positions[:, 2] > 0), 1]).max() < 1e-4


@pytest.mark.filterwarnings("ignore::bullet_tendon.ResolutionWarning")
@pytest.mark.parametrize("heavy", [1.0, 1.2])
@pytest.mark.parametrize("particles", [25, 60])
@pytest.mark.parametrize("facets", [12, 24])
def test_weights_that_friction_holds_rest(make_world, client, facets, particles, heavy):
    """The coarse cord lies on the corners of a pulley that does not turn, in the groove, without a tremor."""
    world = make_world(DT, (0, 0, -G))
    mesh_obstacle(world, client, *grooved(facets), friction=1.0)
    cord, _ = over_it(world, client, particles, 0.3, (LIGHT, heavy))
    world.step(360)
    for _ in range(60):
        world.step()
        assert cord.tension[[0, -1]] == pytest.approx([LIGHT * G, heavy * G], rel=2e-3)
        assert world.report.iterations < 10
