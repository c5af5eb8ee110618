"""Virtual reconstructions: what they restore, and the trends that are known from practice."""

import numpy as np
import pytest
from bullet_tendon.scenarios.knee import KneeRig
from bullet_tendon.scenarios.reconstruction import (
    FEMORAL,
    TENSION,
    drawer,
    on_bernards_grid,
    reconstruct,
    to_bernards_grid,
    virtual_reconstruction,
)

import bullet_tendon as bt

LACHMAN = np.radians(30)


def after(**plan) -> float:
    """Drawer at 30 degrees [mm] of a reconstructed knee."""
    with KneeRig() as rig:
        graft = reconstruct(rig, **plan)
        assert graft.force == pytest.approx(plan.get("tension", TENSION), rel=1e-3)
        return 1e3 * drawer(rig, LACHMAN)


def test_a_graft_restores_the_intact_knee_and_more_tension_makes_it_tighter():
    with KneeRig() as rig:
        intact = 1e3 * drawer(rig, LACHMAN)
    loose, usual, tight = (after(tension=tension) for tension in (20.0, TENSION, 140.0))
    assert usual == pytest.approx(intact, abs=2.0)
    assert loose > usual > tight


def test_a_stiffer_graft_is_tighter():
    assert after(slope=5e4) > after(slope=1e5)


def test_a_place_on_bernards_grid_is_on_the_notchs_wall():
    mouth, outer = on_bernards_grid(0.3878, 0.1926)
    assert mouth == pytest.approx(np.array(FEMORAL[0]), abs=5e-4)
    assert outer - mouth == pytest.approx(np.subtract(FEMORAL[1], FEMORAL[0]))
    assert to_bernards_grid(mouth) == pytest.approx((0.3878, 0.1926), abs=1e-9)
    for deep, low in ((1.2, 0.2), (0.3, -0.1)):
        with pytest.raises(bt.InvalidValue):
            on_bernards_grid(deep, low)


def test_a_sweep_of_reconstructions_is_repeatable():
    cases = [{"angles": [30], "tension": 40.0}, {"angles": [30], "tension": 120.0, "deep": 0.35, "low": 0.25}]
    first, again = (bt.sweep(virtual_reconstruction, cases, seed=3, progress=False) for _ in range(2))
    assert first == again
    assert first[1]["deep"] == 0.35
    assert all(0 < result["drawer"][0] < 15 for result in first)
