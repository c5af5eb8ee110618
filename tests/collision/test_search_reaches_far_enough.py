"""What tendons could touch in a step is found: fast motion, slack on both sides, lists of triangles."""

import numpy as np
import pybullet as p
import pytest
from link_scenes import add_mesh

import bullet_tendon as bt
from bullet_tendon.mesh_queries import MeshQuery

R, DT = 0.003, 1 / 240
ROPE = bt.Material(stiffness=2e3, damping=1.0, friction=0.0)


def octahedron(size):
    """Its vertices [m], on the axes, and triangles."""
    faces = [[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]]
    return size * np.vstack([np.eye(3), -np.eye(3)]), faces


def box(client, half, at=(0, 0, 0)):
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=half, physicsClientId=client)
    return p.createMultiBody(0, shape, -1, at, physicsClientId=client)


@pytest.mark.parametrize("speed", [3.0, 20.0, 100.0])
@pytest.mark.parametrize("spread", [0.0, 0.2])
def test_a_tendon_beyond_reach_is_stopped_in_the_step_that_takes_it_there(make_world, client, speed, spread):
    """A tendon shot square at a thin plate from beyond its radius; it would be behind it after one step."""
    half = 1e-3
    world = make_world(DT)
    world.add_obstacle(box(client, [0.1, 0.1, half]), friction=0.0)
    height = half + 1.3 * R + (1 - spread) * 1e-3
    t = world.add_tendon([[-0.02, 0.01, height], [0.02, 0.01, height]], R, ROPE, 9)
    velocities = np.tile([0, 0, -speed], (9, 1)) * np.linspace(1, 1 - spread, 9)[:, None]
    assert speed * DT > height - half - R
    t.set_positions(t.positions, velocities)
    world.step()
    assert t.positions[:, 2].min() >= half + 0.99 * R
    world.step(3)
    assert t.positions[:, 2].min() >= half + 0.99 * R


def crossed(world, gap):
    """Two tendons across each other, the surfaces `gap` apart: the lower one, the upper one."""
    low = world.add_tendon([[-0.02, 0, 0], [0.02, 0, 0]], R, ROPE, 6)
    high = world.add_tendon([[0, -0.02, 2 * R + gap], [0, 0.02, 2 * R + gap]], R, ROPE, 6)
    return low, high


def apart(low, high) -> float:
    """Height of the upper tendon over the lower one, where they cross, less both radii [m]."""
    a = np.interp(0, low.positions[:, 0], low.positions[:, 2])
    return np.interp(0, high.positions[:, 1], high.positions[:, 2]) - a - 2 * R


@pytest.mark.parametrize("gap", [0.06, 0.07, 0.08, 0.09])
def test_tendons_that_both_gather_speed_do_not_overlap(make_world, gap):
    """At rest as the step begins, both are pushed towards each other by less than 0.05 radii within it.

    Neither goes as far as the gap; both together do.
    """
    world = make_world(DT)
    low, high = crossed(world, gap * R)
    acceleration = 0.048 * R / DT**2
    for t, sign in ((low, 1), (high, -1)):
        for i, mass in enumerate(t.masses):
            t.set_force(i, [0, 0, sign * mass * acceleration])
    for _ in range(6):
        world.step()
        assert apart(low, high) >= -2e-3 * R
    assert apart(low, high) <= 0.01 * R  # they met


@pytest.mark.parametrize("kind", ["sphere", "mesh"])
def test_the_report_counts_what_is_skipped_and_what_is_culled(make_world, client, kind):
    """A tendon at rest by the corner of a ball's box is measured once, and skipped in the next steps.

    One farther off than the box is culled. Each particle and each segment counts.
    """
    world, size, n, m = make_world(DT), 0.05, 5, 8
    if kind == "sphere":
        shape = p.createCollisionShape(p.GEOM_SPHERE, radius=size, physicsClientId=client)
        world.add_obstacle(p.createMultiBody(0, shape, physicsClientId=client))
    else:  # an octahedron, whose box has empty corners as well
        add_mesh(world, client, *octahedron(size))
    corner = 0.9 * size
    world.add_tendon([[corner, corner, corner], [corner, corner, 0.8 * size]], R, ROPE, n)
    world.add_tendon([[0, 0, 3 * size], [size, 0, 3 * size]], R, ROPE, m)
    world.step()
    counts = world.report.counts
    assert counts["pairs_queried"] == 2 * n - 1 and counts["pairs_skipped"] == 0
    for _ in range(3):
        world.step()
        counts = world.report.counts
        assert counts["pairs_skipped"] == 2 * n - 1 == counts["pairs_considered"]
        assert counts["pairs_culled"] == 2 * m - 1
        assert counts["pairs_queried"] == counts["pairs_reused"] == counts["pairs_searched"] == 0


@pytest.mark.parametrize("speed", [0.03, 0.045, 0.06, 0.075, 0.09])
@pytest.mark.parametrize("room", [0.1001, 0.11, 0.13, 0.17])
def test_a_tendon_between_two_walls_leaves_neither_unseen(make_world, client, speed, room):
    """It goes to and fro between two walls of one mesh, by a few hundredths of its radius a step.

    What was near at one wall is a list without the other one; it must be made anew in time.
    """
    world, width = make_world(DT), 2 * R * (1 + room / 2)
    square = np.array([[-0.1, -0.1], [0.1, -0.1], [0.1, 0.1], [-0.1, 0.1]])
    walls = [np.column_stack([square, np.full(4, z)]) for z in (-R, -R + width)]
    faces = [[0, 1, 2], [0, 2, 3], [4, 6, 5], [4, 7, 6]]
    add_mesh(world, client, np.vstack(walls), faces)
    t = world.add_tendon([[-0.01, 0.003, 1e-6 * R], [0.01, 0.003, 1e-6 * R]], R, ROPE, 5)
    for sign in (1, -1, 1):
        t.set_positions(t.positions, np.tile([0, 0, sign * speed * R / DT], (5, 1)))
        for _ in range(int(room / speed) + 4):
            world.step()
            z = t.positions[:, 2]
            assert z.min() >= -2e-3 * R and z.max() <= room * R + 2e-3 * R
    assert z.max() >= 0.9 * room * R


def test_the_oracle_measures_particles_and_the_segments_follow_from_them(make_world, client, monkeypatch):
    """A tendon across the tip of an octahedron, which only the middle segment touches, in the first step."""
    size, n = 0.05, 6
    world = make_world(DT)
    add_mesh(world, client, *octahedron(size))
    height = size + 0.9 * R
    t = world.add_tendon([[-0.05, 0.0, height], [0.05, 0.0, height]], R, ROPE, n)
    t.grip(0)
    t.grip(-1)
    measured = []
    measure = MeshQuery.__call__

    def counted(self, start, way):
        measured.append(np.linalg.norm(way))
        return measure(self, start, way)

    monkeypatch.setattr(MeshQuery, "__call__", counted)
    world.step()
    assert 0 < len(measured) <= n and not np.any(measured)
    (contact,) = world.contacts[world.contacts["normal_force"] > 0]
    assert contact["position"][:2] == pytest.approx([0.0, 0.0], abs=1e-9)
    assert contact["distance"] == pytest.approx(contact["position"][2] - size - R, abs=1e-9)
