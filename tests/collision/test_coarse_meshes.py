"""A taut tendon that turns far at one particle on a mesh: its tension is not exact, and it is told once."""

import math
import warnings

import numpy as np
import pytest
from link_scenes import mesh_obstacle

import bullet_tendon as bt

BONE, RADIUS = 0.02, 0.001


def prism(world, client, sides):
    """A prism along y, with a flat top."""
    angles = math.pi / 2 + (np.arange(sides) + 0.5) * 2 * math.pi / sides
    ring = BONE * np.c_[np.cos(angles), np.sin(angles)]
    vertices = [[x, y, z] for y in (-0.05, 0.05) for x, z in ring]
    k, after = np.arange(sides), (np.arange(sides) + 1) % sides
    faces = np.concatenate([np.c_[k, after, k + sides], np.c_[after, after + sides, k + sides]])
    return mesh_obstacle(world, client, vertices, faces)


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
