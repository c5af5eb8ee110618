"""A tendon without friction over a polygonal cylinder: how much its tension changes across the edges."""

import numpy as np
import pytest
from link_scenes import add_mesh
from scipy.spatial import ConvexHull

import bullet_tendon as bt

ROUND, RADIUS, WIDTH = 0.03, 0.003, 0.05
ROPE = bt.Material(stiffness=2e5, damping=300.0)
PULL = 2000.0  # N


@pytest.mark.parametrize("particles", [40, 80, 160])
def test_64_sides_change_the_tension_by_less_than_1_percent(make_world, client, particles):
    """Dihedral angles of 5.6 degrees; as many sides as a bone's mesh has round a condyle."""
    world = make_world(1 / 240)
    angle = 2 * np.pi * np.arange(64) / 64 + 0.1
    ring = ROUND * np.column_stack([np.cos(angle), np.sin(angle)])
    vertices = np.concatenate([np.insert(ring, 1, y, axis=1) for y in (-WIDTH, WIDTH)])
    add_mesh(world, client, vertices, ConvexHull(vertices).simplices)
    half = np.linspace(np.pi, 0, 120)
    over = (ROUND + 1.02 * RADIUS) * np.column_stack([np.cos(half), 0 * half, np.sin(half)])
    line = np.vstack([over[0] - [0, 0, 0.06], over, over[-1] - [0, 0, 0.06]])
    t = world.add_tendon(line, RADIUS, ROPE, particles)
    first, last = t.grip(0), t.grip(-1)
    for _ in range(20):
        for end in (0, 1):
            t.shorten(PULL / ROPE.stiffness * t.rest_length / 40, end)
        world.step()
    world.step(10)
    world.relax(1e-6, 30)
    forces = [np.linalg.norm(hold.force) for hold in (first, last)]
    assert min(forces) > 1000
    assert forces[0] / forces[1] == pytest.approx(1.0, abs=0.01)
