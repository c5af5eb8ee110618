"""A taut tendon that turns far at one particle on a body: its tension is not exact, and it is told once."""

import math
import warnings

import numpy as np
import pybullet as p
import pytest
from link_scenes import mesh_obstacle, prism_mesh

import bullet_tendon as bt

BONE, RADIUS = 0.02, 0.001


def prism(world, client, sides):
    """A prism along y, with a flat top."""
    return mesh_obstacle(world, client, *prism_mesh(BONE, 0.05, sides))


def drawn_over(world, force, particles, name="cord"):
    """A tendon over half of the prism, pulled down at both ends."""
    a = np.linspace(math.pi, 0, 61)
    arc = (1.02 * BONE + RADIUS) * np.c_[np.cos(a), 0 * a, np.sin(a)]
    line = np.vstack([arc[0] - [0, 0, 0.05], arc, arc[-1] - [0, 0, 0.05]])
    material = bt.Material(stiffness=1e4, damping=10.0, friction=0.0)
    t = world.add_tendon(line, RADIUS, material, particles, name=name)
    for end in (0, -1):
        t.set_force(end, (0, 0, -force))
    return t


def told(world, steps):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        world.step(steps)
    return [str(w.message) for w in caught if w.category is bt.ResolutionWarning]


def test_it_is_told_once_for_each_tendon(make_world, client):
    world = make_world(1 / 240, (0, 0, 0))
    body = prism(world, client, 12)
    t = drawn_over(world, 50.0, 16)
    (text,) = told(world, 60)
    assert f"tendon 'cord' is too coarse for the mesh of body {body}, link -1" in text
    turned = np.diff(t.positions, axis=0)
    turned /= np.linalg.norm(turned, axis=1)[:, None]
    angles = np.degrees(np.arccos(np.einsum("ij,ij->i", turned[:-1], turned[1:])))
    assert angles.max() > 15
    named = int(text.split(" degrees")[0].split()[-1]), int(text.split("particle ")[1].split(",")[0])
    assert named[0] == pytest.approx(angles[named[1] - 1], abs=3)  # it still moves a little
    assert not told(world, 60)
    world.remove_tendon(t)
    drawn_over(world, 50.0, 16)
    assert len(told(world, 60)) == 1


def test_tendons_that_begin_together_are_all_told(make_world, client):
    world = make_world(1 / 240, (0, 0, 0))
    prism(world, client, 12)
    for aside in (-0.02, 0.0, 0.02):
        t = drawn_over(world, 50.0, 16, f"cord at {aside}")
        t.set_positions(t.positions + [0, aside, 0])
    texts = told(world, 60)
    assert len({text.split("'")[1] for text in texts}) == len(texts) == 3


@pytest.mark.parametrize(("sides", "particles", "force"), [(36, 60, 50.0), (12, 16, 0.0)])
def test_what_is_fine_or_slack_is_not_told(make_world, client, sides, particles, force):
    world = make_world(1 / 240, (0, 0, -9.81))
    prism(world, client, sides)
    drawn_over(world, force, particles)
    assert not told(world, 60)
    assert len(world.contacts) > 0


def through_a_bore(world, client, particles, force, friction=0.0):
    """A tendon through a bore of a box, pulled at 40 degrees beyond its mouth; the hand behind it."""
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=(0.0175, 0.05, 0.05), physicsClientId=client)
    block = p.createMultiBody(0, shape, physicsClientId=client)
    world.add_obstacle(block, friction=1.0)
    world.add_tunnel(block, -1, (-0.0175, 0, 0), (0.0175, 0, 0), radius=0.0045, friction=1.0)
    way = np.array([math.cos(0.7), 0, math.sin(0.7)])
    line = [(-0.0275, 0, 0), (0.0175, 0, 0), np.array([0.0175, 0, 0]) + 0.03 * way]
    material = bt.Material(stiffness=1e4, damping=60.0, friction=friction)
    t = world.add_tendon(line, 0.004, material, particles, name="graft")
    t.set_force(-1, force * way)
    return t.grip(0)


@pytest.mark.parametrize("friction", [0.0, 0.4, 0.8])
def test_the_error_that_is_told_bounds_that_of_the_tension(make_world, client, friction):
    """A hand draws the tendon through the bore against the pull, which friction multiplies."""
    world = make_world(1 / 240, (0, 0, 0))
    hand = through_a_bore(world, client, 8, 80.0, friction)
    texts = told(world, 120)
    start, beyond = np.array(hand.target), []
    for k in range(240):
        hand.target = start - (0.008 * k / 240, 0, 0)
        texts += told(world, 1)
        beyond.append(np.linalg.norm(hand.force) / (80.0 * math.exp(0.7 * friction)) - 1)
    (text,) = texts
    assert 0.5 * error_told(text) < max(beyond) < error_told(text)


def error_told(text):
    return float(text.split("off by up to ")[1].split("%")[0]) / 100


TURN = 0.55  # of the cord over the edges below [rad]


def edge_or_post(world, client, post):
    """A box or a post of 10 mm, over which a cord of 2 mm turns at x = 0.1 from a height of its radius."""
    if post:
        shape = p.createCollisionShape(p.GEOM_CYLINDER, radius=0.01, height=0.1, physicsClientId=client)
        place = [0.1, 0, -0.01], p.getQuaternionFromEuler([math.pi / 2, 0, 0])
    else:
        shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=(0.1, 0.1, 0.05), physicsClientId=client)
        place = [0, 0, -0.05], [0, 0, 0, 1]
    body = p.createMultiBody(0, shape, -1, *place, physicsClientId=client)
    world.add_obstacle(body, friction=1.0)


@pytest.mark.parametrize("friction", [0.0, 0.3, 0.7])
@pytest.mark.parametrize(
    ("post", "particles", "coarse"),
    [(False, 12, 1), (False, 20, 1), (False, 40, 1), (False, 300, 0)]
    + [(True, 8, 1), (True, 12, 1), (True, 60, 0)],
)
@pytest.mark.parametrize("back", [0.0, 0.005])
def test_the_error_that_is_told_covers_all_places_of_the_particles(
    make_world, client, post, particles, coarse, friction, back
):
    """A hand draws a cord over an edge. It is told when it begins to, wherever its particles are then."""
    world = make_world(1 / 240, (0, 0, 0))
    edge_or_post(world, client, post)
    way = np.array([math.cos(TURN), 0, -math.sin(TURN)])
    corner = np.array([0.1, 0, 0.002])
    material = bt.Material(stiffness=2e4, damping=40.0, friction=friction)
    t = world.add_tendon([(-back, 0, 0.002), corner, corner + 0.08 * way], 0.002, material, particles)
    t.set_force(-1, 20.0 * way)
    hand = t.grip(0)
    start, texts, seen = np.array(hand.target), [], []
    for k in range(400):
        hand.target = start - (0.02 * k / 400, 0, 0)
        texts += told(world, 1)
        first, last = np.diff(t.positions, axis=0)[[0, -1]]
        turn = math.acos(first @ last / (np.linalg.norm(first) * np.linalg.norm(last)))
        seen.append(np.linalg.norm(hand.force) / (20.0 * math.exp(friction * turn)) - 1)
    assert len(texts) == coarse
    assert max(seen[120:]) <= (error_told(texts[0]) if coarse else 0.06)


@pytest.mark.parametrize(
    ("particles", "error", "coarse"), [(8, 0.2, True), (15, 0.1, True), (120, 0.01, False)]
)
def test_a_tendon_that_turns_far_at_a_mouth_is_told(make_world, client, particles, error, coarse):
    """Without friction the hand feels the pull, as far as the tendon turns by little at each particle."""
    world = make_world(1 / 240, (0, 0, 0))
    hand = through_a_bore(world, client, particles, 80.0)
    texts = told(world, 240)
    assert len(texts) == coarse
    assert all(
        text.startswith("tendon 'graft' is too coarse for body 0, link -1: it turns by") for text in texts
    )
    assert all(text.endswith("%. Add particles") for text in texts)
    assert np.linalg.norm(hand.force) == pytest.approx(80.0, rel=error)


@pytest.mark.parametrize(("force", "count"), [(0.05, 0), (50.0, 1)])
def test_a_loose_end_behind_a_hold_is_not_told(make_world, client, force, count):
    """Between two hands the tendon carries 50 N. Behind them it turns on the prism, under `force`."""
    world = make_world(1 / 240, (0, 0, 0))
    prism(world, client, 12)
    t = drawn_over(world, force, 16)
    t.set_force(0, (0, 0, 0))
    along = t.positions[1] - t.positions[0]
    t.grip(1)
    t.grip(0, t.positions[0] - 0.005 * along)
    assert len(told(world, 60)) == count
    assert t.tension[0] == pytest.approx(50.0, rel=0.1)
    assert len(world.contacts) > 0


def test_what_turns_at_a_grip_is_not_told(make_world, client):
    """It turns by 80 degrees at the particle that a hand holds above a plate, on which it lies."""
    world = make_world(1 / 240, (0, 0, -9.81))
    plate = p.createMultiBody(
        0, p.createCollisionShape(p.GEOM_PLANE, physicsClientId=client), physicsClientId=client
    )
    world.add_obstacle(plate, friction=1.0)
    line = [(-0.05, 0, 0.001), (0, 0, 0.001), (0.01, 0, 0.05)]
    t = world.add_tendon(line, 0.001, bt.Material(stiffness=1e3, damping=1.0, friction=0.5), 31)
    middle = int(np.argmin(np.linalg.norm(t.positions, axis=1)))
    for i in (0, middle, -1):
        t.grip(i)
    t.set_force(middle - 1, (0, 0, -1))
    t.shorten(0.001)
    t.shorten(0.001, end=0)
    assert not told(world, 60)
    assert t.tension.min() > 1.0
