"""Valleys of meshes: a tendon in one touches both of its sides."""

import math

import numpy as np
import pytest
from link_scenes import mesh_obstacle

import bullet_tendon as bt

G, RADIUS, PARTICLES = 9.81, 0.002, 21


def groove(world, client, half_angle, tilt):
    """An obstacle: two faces that meet along the x axis at twice this angle [rad], turned by `tilt`."""
    sides = [math.pi / 2 + tilt + side * half_angle for side in (-1, 1)]
    corners = [[x, 0.0, 0.0] for x in (-0.2, 0.2)]
    corners += [[x, 0.05 * math.cos(a), 0.05 * math.sin(a)] for a in sides for x in (-0.2, 0.2)]
    faces = [[0, 2, 1], [1, 2, 3], [0, 1, 4], [1, 5, 4]]
    return mesh_obstacle(world, client, corners, faces, friction=1.0)


def saddle(world, client, rows, columns, sizes, bulge, groove):
    """An obstacle of rows x columns corners: it bulges along x, and is a groove across.

    sizes: half of its length and width; bulge, groove: how far it falls and rises to its borders [m].
    """
    along, across = np.linspace(-1, 1, rows), np.linspace(-1, 1, columns)
    length, width = sizes
    vertices = [[length * a, width * b, -bulge * a * a + groove * b * b] for a in along for b in across]
    k = np.arange((rows - 1) * columns).reshape(rows - 1, columns)[:, :-1].ravel()
    faces = np.concatenate([np.c_[k, k + columns, k + 1], np.c_[k + 1, k + columns, k + columns + 1]])
    mesh_obstacle(world, client, vertices, faces, friction=1.0)


@pytest.mark.parametrize("contact", ["spring", "constraint"])
@pytest.mark.parametrize("friction", [0.0, 0.3])
@pytest.mark.parametrize(("half_angle", "tilt"), [(0.6, 0.0), (0.8, 0.3), (1.45, 0.04)], ids=str)
def test_both_sides_carry_the_weight(make_world, client, half_angle, tilt, friction, contact):
    """At rest, with the forces that statics gives where there is no friction, and without a tremor."""
    world = make_world(1 / 240, (0, 0, -G), bone_contact=contact)
    body = groove(world, client, half_angle, tilt)
    up = RADIUS / math.sin(half_angle) * np.array([0, -math.sin(tilt), math.cos(tilt)])
    t = world.add_tendon(
        [up - [0.1, 0, 0], up + [0.1, 0, 0]],
        RADIUS,
        bt.Material(stiffness=3e3, damping=3.0, friction=friction),
        PARTICLES,
    )
    world.step(120)
    before = t.positions
    world.step(60)
    np.testing.assert_allclose(t.positions, before, atol=1e-8)
    np.testing.assert_allclose(t.positions[:, 1:], np.tile(up[1:], (PARTICLES, 1)), atol=1e-6)
    contacts = world.contacts
    assert contacts["distance"].min() > -1e-7
    weight = t.masses.sum() * G
    np.testing.assert_allclose(world.wrench(body)[:3], [0, 0, -weight], atol=1e-6 * weight)
    if not friction:
        for side in (-1, 1):
            # The faces' normals are at tilt +- (90 degrees - half_angle) from upwards; two forces in balance.
            from_up = tilt - side * (math.pi / 2 - half_angle)
            other = tilt + side * (math.pi / 2 - half_angle)
            on_it = contacts["normal"] @ [0, -math.sin(from_up), math.cos(from_up)] > 1 - 1e-6
            expected = weight * math.sin(other) / math.sin(other - from_up)
            assert contacts["normal_force"][on_it].sum() == pytest.approx(expected, rel=1e-4)


def test_a_taut_tendon_does_not_sink_between_the_faces_of_a_groove(make_world, client):
    """A force within one step throws it into a groove of coarse faces: it stays on top of them, and rests."""
    world = make_world(1 / 75, (0, 0, 0))
    saddle(world, client, 15, 15, (0.027, 0.02), 0.014, 0.006)
    a = np.linspace(-1.25, 1.25, 41)
    line = np.c_[0.027 * a, 0 * a + 1e-4, -0.014 * a * a + 0.0025]
    t = world.add_tendon(line, 0.0013, bt.Material(stiffness=1e6, damping=200.0, friction=0.0), 41)
    pull = np.array([1, 0, -1.25])
    t.set_force(0, 600 / np.linalg.norm(pull) * pull * [-1, 1, 1])
    t.grip(-1)
    for _ in range(60):
        world.step()
        assert world.report.converged
    x = t.positions[np.abs(t.positions[:, 0]) < 0.024]
    assert (x[:, 2] > -0.014 * (x[:, 0] / 0.027) ** 2 + 0.001).all()
    assert t.tension.max() < 1.1 * 600


@pytest.mark.parametrize("dt", [1 / 2000, 1 / 500, 1 / 200], ids=lambda dt: f"1/{round(1 / dt)}")
@pytest.mark.parametrize("rows", [7, 9, 12])
def test_a_taut_tendon_rests_on_the_ridges_of_a_groove(make_world, client, rows, dt):
    """Where its segments cross the ridges of a coarse saddle, they touch both sides of the groove too."""
    world = make_world(dt, (0, 0, 0))
    saddle(world, client, rows, 9, (0.04, 0.02), 0.025, 0.012)
    a = np.linspace(-1.25, 1.25, 33)
    line = np.c_[0.04 * a, 0 * a + 1e-4, -0.025 * a * a + 0.0035]
    t = world.add_tendon(line, 0.0009, bt.Material(stiffness=1e6, damping=200.0, friction=0.0), 33)
    t.set_force(0, [-13.0, 0, -19.0])
    t.grip(-1)
    world.step(round(0.2 / dt))
    before = t.positions
    world.step(40)
    np.testing.assert_allclose(t.positions, before, atol=2e-5)
    on_it = np.abs(before[:, 0]) < 0.03
    assert np.abs(before[on_it, 1]).max() < 1e-5


@pytest.mark.parametrize("dt", [1 / 240, 1 / 87], ids=lambda dt: f"1/{round(1 / dt)}")
@pytest.mark.parametrize("particles", [30, 45])
@pytest.mark.parametrize(("rows", "columns"), [(15, 15), (9, 15), (21, 21)], ids=str)
def test_a_taut_tendon_in_a_shallow_groove_rests(make_world, client, rows, columns, particles, dt):
    """It slides to the bottom of the groove and stays: it does not fall from side to side of it."""
    world = make_world(dt, (0, 0, 0))
    saddle(world, client, rows, columns, (0.0425, 0.02), 0.0245, 0.0067)
    a = np.linspace(-1.2, 1.2, 41)
    line = np.c_[0.0425 * a, 0 * a + 1e-4, -0.0245 * a * a + 0.0025]
    t = world.add_tendon(line, 0.001, bt.Material(stiffness=3e3, damping=8.0, friction=0.0), particles)
    t.set_force(0, [-91.0, 0, -127.0])
    t.grip(-1)
    world.step(100)
    for _ in range(20):
        before = t.positions
        world.step()
        np.testing.assert_allclose(t.positions, before, atol=2e-6)
        assert world.report.iterations <= 4
