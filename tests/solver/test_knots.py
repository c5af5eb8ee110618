"""The scenes of knots hold their own checks, and the checks notice a knot that comes undone."""

import numpy as np
import pytest
from bullet_tendon.scenarios import braid, measure, overhand_knot, reef_knot, runner
from scene_runs import holds, run, with_options

SCENES = {
    "overhand_knot": (overhand_knot, {}),
    "reef_knot": (reef_knot, {"TAIL": 0.015, "SNUGGING": 100, "PULLING": 270, "HOLDING": 30}),
    "braid": (braid, {"TWISTING": 360, "PULLING": 180}),
}


@pytest.mark.parametrize(("module", "changes"), SCENES.values(), ids=SCENES)
def test_knot_holds_its_own_check(module, changes, monkeypatch):
    holds(module, monkeypatch, **changes)


def test_a_knot_that_passes_through_itself_is_noticed(monkeypatch):
    """Where the contact is far too soft, the pull draws the loop through itself."""
    with_options(overhand_knot, monkeypatch, contact_stiffness=10.0)
    failed = [check.name for check in runner.run(overhand_knot).failed]
    assert "nearest" in failed and "steps of tightening without the trefoil" in failed


def test_strands_that_pass_through_each_other_are_noticed(monkeypatch):
    with_options(braid, monkeypatch, contact_stiffness=1.0)
    failed = [c.name for c in run(braid, monkeypatch, {"TWISTING": 60, "PULLING": 10}).failed]
    assert "nearest" in failed


def test_a_reef_knot_that_slips_is_noticed(monkeypatch):
    """With too little friction the first of the two does not hold either."""
    changes = {"FRICTIONS": (0.1, 0.0), "SNUGGING": 90, "PULLING": 90, "HOLDING": 5}
    failed = [check.name for check in run(reef_knot, monkeypatch, changes).failed]
    assert "held without moving" in failed


def test_distance_to_itself_counts_neighbours_by_rest_lengths():
    line = np.array([(0, 0, 0), (1, 0, 0), (1, 0.5, 0), (0, 0.5, 0)], dtype=float)
    assert measure.with_itself(line, 0.4, np.array([1.0, 0.3, 1.0])) == np.inf
    assert measure.with_itself(line, 0.4, np.array([1.0, 0.5, 1.0])) == pytest.approx(0.5)


def test_shortest_distances_are_those_of_all_pairs():
    one, other = np.random.default_rng(3).normal(size=(2, 30, 3))
    table = measure.segment_distances(one[:-1, None], one[1:, None], other[None, :-1], other[None, 1:])
    assert measure.between(one, other) == table.min()
