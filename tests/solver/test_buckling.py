"""Struts buckle at Euler's load, also if they are straight to the last bit."""

import numpy as np
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
