"""A taut tendon that turns about another one in few segments: its tension is not exact, and it is told."""

import re
import warnings

import numpy as np
import pybullet as p
import pytest

import bullet_tendon as bt

RADIUS, SPAN, FORCE = 1e-3, 0.1, 20.0


def told(step, steps):
    """Calls step(i) for each i, and returns the texts of the ResolutionWarnings."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        for i in range(steps):
            step(i)
    return [str(w.message) for w in caught if w.category is bt.ResolutionWarning]


def smooth(radius=RADIUS):
    return bt.Material.from_modulus(1e9, radius, friction=0.0)


def drawn_over_cord(make_world, segment, half):
    """Draws a cord of that segment length [m] over a taut one without friction, at an angle to the vertical.

    Returns the largest ratio of the tensions on both sides, less 1 [-], and the warnings of it.
    """
    world = make_world(1 / 240, (0, 0, 0))
    across = world.add_tendon([(0, -0.05, 0), (0, 0.05, 0)], RADIUS, smooth(), round(0.1 / segment) + 1)
    across.grip(0), across.grip(-1)
    out = np.array([np.sin(half), 0, -np.cos(half)])
    top = np.array([0, 0, 2.1 * RADIUS])
    back = out * (-1, 0, 1)
    line = [top + SPAN * back, top, top + SPAN * out]
    t = world.add_tendon(line, RADIUS, smooth(), round(2 * SPAN / segment) + 1, name="drawn")
    hand = t.grip(0)
    t.set_force(-1, FORCE * out)
    start, ratios = t.positions[0].copy(), []

    def step(i):
        hand.target = start + max(0, i - 100) / 240 * 2 * segment * back
        world.step()
        ratios.append(t.tension[1] / t.tension[-1])

    texts = [text for text in told(step, 340) if text.startswith("tendon 'drawn'")]
    moving = np.array(ratios[140:])
    return max(moving.max(), 1 / moving.min()) - 1, texts


@pytest.mark.parametrize("half", [0.5, 1.0])
def test_segments_that_are_short_for_the_turn_are_right_and_not_told(make_world, half):
    error, texts = drawn_over_cord(make_world, 1e-3, half)
    assert error < 0.06
    assert texts == []


@pytest.mark.parametrize(("segment", "half"), [(2.5e-3, 0.7), (3.2e-3, 0.6), (5e-3, 1.0), (8e-3, 1.3)])
def test_segments_that_are_long_for_the_turn_are_told_with_the_error(make_world, segment, half):
    error, (text,) = drawn_over_cord(make_world, segment, half)
    assert text.startswith("tendon 'drawn' is too coarse for tendon 'tendon1': it turns by")
    said = int(re.search(r"off by up to (\d+)%", text)[1]) / 100
    assert error > 0.05
    assert error < 1.4 * said


def twisted(make_world, client, particles, turns=10):
    """Two strands between two discs, one of which is turned; the other lifts its mass without turning.

    Returns the warnings, and how far it is lifted [m].
    """
    world = make_world(1 / 240, (0, 0, -9.81))
    disc = p.createMultiBody(0, basePosition=(0, 0, 0.2), physicsClientId=client)
    load = p.createMultiBody(2.0, physicsClientId=client)
    p.resetBasePositionAndOrientation(load, (0, 0, 0), (0, 0, 0, 1), physicsClientId=client)
    p.changeDynamics(load, -1, localInertiaDiagonal=(1e3, 1e3, 1e3), physicsClientId=client)  # does not turn
    for x in (RADIUS, -RADIUS):
        t = world.add_tendon([(x, 0, 0.2), (x, 0, 0)], RADIUS, smooth(), particles)
        t.attach(0, disc), t.attach(-1, load)

    def step(i):
        angle = 2 * np.pi * turns * min(i / 480, 1)
        turned = p.getQuaternionFromEuler((0, 0, angle))
        p.resetBasePositionAndOrientation(disc, (0, 0, 0.2), turned, physicsClientId=client)
        world.step()

    return told(step, 600), p.getBasePositionAndOrientation(load, physicsClientId=client)[0][2]


def test_a_twist_of_few_segments_a_turn_is_told(make_world, client):
    texts, lifted = twisted(make_world, client, 51)
    assert any("around it in a segment" in text for text in texts)
    fine, right = twisted(make_world, client, 161)
    assert fine == []
    assert lifted > 1.1 * right


def test_cords_that_lie_beside_each_other_around_a_post_are_not_told(make_world, client):
    """They turn by 30 degrees at each particle, but not about each other."""
    world = make_world(1 / 240, (0, 0, 0))
    post = p.createCollisionShape(p.GEOM_CYLINDER, radius=0.01, height=0.1, physicsClientId=client)
    body = p.createMultiBody(0, post, physicsClientId=client)
    world.add_obstacle(body)
    a, away = np.linspace(0, np.pi, 7), 0.011 / np.cos(np.pi / 12)
    arc = away * np.c_[np.cos(a), np.sin(a)]
    ends = np.linspace(-0.06, 0, 10, endpoint=False)[:, None] * (0, 1)
    line = np.vstack([arc[0] + ends, arc, arc[-1] + ends[::-1]])
    for z in (0.95 * RADIUS, -0.95 * RADIUS):
        t = world.add_tendon(np.c_[line, np.full(len(line), z)], RADIUS, smooth(), len(line))
        t.set_force(0, (0, -FORCE, -50 * z)), t.set_force(-1, (0, -FORCE, -50 * z))
    assert told(lambda i: world.step(), 60) == []
    found = world.contacts
    assert np.any((found["kind"] == "tendon") & (found["normal_force"] > 0))
