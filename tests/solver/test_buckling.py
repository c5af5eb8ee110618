"""Struts buckle at Euler's load, also if they are straight to the last bit."""

import numpy as np
import pybullet as p
import pytest

import bullet_tendon as bt


@pytest.mark.parametrize("step", [1 / 1000, 1 / 240, 1 / 60])
@pytest.mark.parametrize("bending", [1e-3, 1e-2])
@pytest.mark.parametrize("load", [0.5, 0.9, 1.2, 2, 5, 20])
def test_a_pinned_column_buckles_at_eulers_load(make_world, load, bending, step):
    """Euler (1744): pi^2 B / L^2. Buckled, it bears this load at any small shortening.

    load: of the column if it stays straight, in Euler's loads.
    """
    length, stiffness, n = 0.2, 1e4, 41
    euler = np.pi**2 * bending / length**2
    world = make_world(step)
    material = bt.Material(stiffness=stiffness, bending_stiffness=bending, damping=20.0, density=1000.0)
    t = world.add_tendon([[0, 0, 0], [0, 0, -length]], 1e-3, material, n)
    t.grip(0)
    hand = t.grip(-1)
    ramp = round(0.25 / step)
    for k in range(round(1.5 / step)):
        hand.target = [0, 0, -length * (1 - min(1, (k + 1) / ramp) * load * euler / stiffness)]
        world.step()
        assert world.report.converged
    share = -t.tension.mean() / euler
    if load < 1:
        assert share == pytest.approx(load, rel=1e-6)
        assert np.abs(t.positions[:, :2]).max() < 1e-9
    else:
        assert share == pytest.approx(1, rel=0.01)
        # The arc of a sine with the shortening d has the amplitude 2 sqrt(d L) / pi.
        shortening = (load - 1) * euler / stiffness * length
        deflection = np.linalg.norm(t.positions[:, :2], axis=1).max()
        assert deflection == pytest.approx(2 / np.pi * np.sqrt(shortening * length), rel=0.05)


@pytest.mark.parametrize("particles", [24, 60])
@pytest.mark.parametrize("damping", [0.0, 60.0])
def test_a_slack_cord_between_bodies_that_approach_buckles_at_once(make_world, client, damping, particles):
    """It buckles in every segment: its lengths stay. The descent to that takes few linear solutions."""
    dt, speed = 1 / 400, 1.0
    world = make_world(dt, (0.0, 0.0, -9.81))
    ball = p.createCollisionShape(p.GEOM_SPHERE, radius=0.005, physicsClientId=client)
    line = np.linspace([0, 0, 0], [0.1, 0, 0], particles)
    material = bt.Material(stiffness=6e4, exponent=1.2, damping=damping, density=1100.0)
    t = world.add_tendon(line, 5e-4, material, particles)
    for particle, place, mass, way in ((0, [0, 0, 0], 10.0, 1), (-1, [0.1, 0, 0], 20.0, -1)):
        body = p.createMultiBody(mass, ball, basePosition=place, physicsClientId=client)
        p.resetBaseVelocity(body, [way * speed, 0, 0], [0, 0, 0], physicsClientId=client)
        t.attach(particle, body)
    t.set_positions(line, np.linspace([speed, 0, 0], [-speed, 0, 0], particles))
    world.step()
    assert world.report.converged and world.report.counts["substeps"] == 1
    assert world.report.counts["linear_solves"] <= 100
    assert np.linalg.norm(np.diff(t.positions, axis=0), axis=1) == pytest.approx(
        t.rest_length / (particles - 1), rel=1e-3
    )


@pytest.mark.parametrize("particles, mass, off", [(4, 0.01, 0.008), (10, 5.0, 0.008), (20, 0.2, 0.002)])
def test_a_slack_cord_beside_the_centres_of_bodies_that_approach_buckles_at_once(
    make_world, client, off, mass, particles
):
    """They turn as it buckles. Its ends are forces on the bodies, in the descent to that too."""
    speed, side = 0.3, 0.02
    world = make_world(1 / 240)
    box = p.createCollisionShape(p.GEOM_BOX, halfExtents=3 * [side / 2], physicsClientId=client)
    line = np.linspace([0, 0, 0], [0.1, 0, 0], particles)
    t = world.add_tendon(line, 5e-4, bt.Material(stiffness=1e4, damping=60.0, density=1100.0), particles)
    for particle, way, m in ((0, 1, mass), (-1, -1, 2 * mass)):
        place = line[particle] + [-way * side / 2, 0, off]
        body = p.createMultiBody(m, box, basePosition=place.tolist(), physicsClientId=client)
        p.resetBaseVelocity(body, [way * speed, 0, 0], [0, 0, 0], physicsClientId=client)
        t.attach(particle, body)
    for _ in range(20):
        world.step()
        assert world.report.converged
        assert world.report.counts["linear_solves"] <= 60


def test_a_rod_beside_the_centres_of_light_bodies_that_meet_is_solved_at_once(make_world, client):
    """Two particles, both carried: all unknowns are the bodies', which it turns by their fastest rate."""
    world = make_world(1 / 240)
    ball = p.createCollisionShape(p.GEOM_SPHERE, radius=0.004, physicsClientId=client)
    t = world.add_tendon([[0, 0, 0.003], [0.05, 0, 0.003]], 5e-4, bt.Material(stiffness=1e4), 2)
    for particle, place, speed in ((0, [0, 0, 0], 2.0), (-1, [0.05, 0, 0], -2.0)):
        body = p.createMultiBody(0.001, ball, basePosition=place, physicsClientId=client)
        p.resetBaseVelocity(body, [speed, 0, 0], [0, 0, 0], physicsClientId=client)
        t.attach(particle, body)
    for _ in range(4):
        world.step()
        assert world.report.converged
        assert world.report.counts["linear_solves"] <= 20
        assert np.linalg.norm(np.diff(t.positions, axis=0)) == pytest.approx(0.05, rel=1e-3)
