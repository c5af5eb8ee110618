"""The contact of two tendons is the same whichever was added first."""

import numpy as np
import pytest

import bullet_tendon as bt

THICK = bt.Material(stiffness=2e4, damping=20.0, friction=0.4, density=3000.0)
THIN = bt.Material(stiffness=300.0, damping=0.1, friction=0.8, density=900.0)
RADII = {"thick": 0.006, "thin": 0.0015}


def crossing(make_world, order, integrator, steps=120):
    """Positions by name, at every step, of a thick tendon and a thin one that is drawn over it."""
    world = make_world(1 / 240, (0, 0, -9.81), integrator=integrator, sleep=False)
    above = RADII["thick"] + RADII["thin"]
    lines = {
        "thick": ([[-0.1, 0.003, 0], [0.1, 0.001, 0]], 13, THICK),
        "thin": ([[0.004, -0.1, above], [0.002, 0.1, above]], 28, THIN),
    }
    t = {}
    for name in order:
        points, particles, material = lines[name]
        t[name] = world.add_tendon(points, RADII[name], material, particles)
    t["thick"].grip(0), t["thick"].grip(-1)
    hand = t["thin"].grip(0)
    t["thin"].set_force(-1, (0.0, 0.05, -0.1))
    out = {name: [] for name in t}
    for _ in range(steps):
        hand.target = hand.target + (0, -1e-4, -1e-4)
        world.step()
        for name in t:
            out[name].append(t[name].positions)
    assert (world.contacts["normal_force"] > 0).any()
    return out


@pytest.mark.parametrize("integrator", ["implicit_euler", "bdf2"])
def test_trajectories_do_not_depend_on_which_tendon_was_added_first(make_world, integrator):
    one = crossing(make_world, ("thick", "thin"), integrator)
    other = crossing(make_world, ("thin", "thick"), integrator)
    for name, radius in RADII.items():
        np.testing.assert_allclose(one[name], other[name], rtol=0, atol=1e-9 * radius)


@pytest.mark.parametrize("reverse", [False, True])
def test_rounding_of_bending_is_judged_by_the_shortest_segment(make_world, reverse):
    """A cantilever far from the origin, of one long segment and many short ones, whichever comes first."""
    world = make_world(1 / 240, (0, 0, -9.81), tolerance=1e-10, sleep=False)
    x = np.r_[0, 0.05 + 1e-3 * np.arange(25)]
    if reverse:
        x = x[-1] - x[::-1]
    material = bt.Material(stiffness=1e3, damping=1.0, bending_stiffness=1e-5)
    t = world.add_tendon(np.c_[100 + x, 0 * x, 0 * x], 2e-4, material)
    t.grip(-1 if reverse else 0)
    for _ in range(60):
        world.step()
        assert world.report.converged
        assert world.report.iterations <= 10
