"""The report tells which rule ended a step."""

import pytest

import bullet_tendon as bt

ROPE = bt.Material(stiffness=3e4, exponent=2.0, toe_strain=0.03, damping=3.0)


def swing(make_world, material=ROPE, dt=1 / 240, **options):
    """A tendon that is held at one end, and falls."""
    world = make_world(dt, (0, 0, -9.81), **options)
    t = world.add_tendon([[5.0, 0, 0], [5.2, 0, 0]], 0.002, material, 31)
    t.grip(0)
    return world


def test_at_the_tolerance(make_world):
    world = swing(make_world, tolerance=1e-6)
    for _ in range(20):
        world.step()
        assert world.report.ended_by == "tolerance" and world.report.tolerance == 1e-6
        assert world.report.converged and world.report.residual <= 1e-6


def test_at_rounding(make_world):
    """A tolerance that no rounded force can reach: converged, with a residual above it."""
    world = swing(make_world, tolerance=1e-18)
    for _ in range(20):
        world.step()
        assert world.report.converged and world.report.residual > 1e-18
        assert world.report.ended_by == "rounding"


@pytest.mark.parametrize("options", [{"iteration": "single"}, {"integrator": "explicit_euler"}], ids=str)
def test_methods_that_do_not_iterate(make_world, options):
    world = swing(make_world, dt=1e-6, **options)
    world.step()
    assert world.report.converged and world.report.tolerance is None
    assert world.report.ended_by == "method"


def test_the_budget(make_world):
    world = swing(make_world, max_linear_solves=1)
    world.step(5)
    assert not world.report.converged and world.report.over_budget
    assert world.report.ended_by == "budget"


def test_other_options_do_not_change_the_last_report(make_world):
    world = swing(make_world, tolerance=1e-6)
    world.step()
    world.options = bt.SolverOptions(tolerance=1e-18)
    assert world.report.tolerance == 1e-6 and world.report.ended_by == "tolerance"
    world.step()
    assert world.report.tolerance == 1e-18


def test_relax(make_world):
    world = swing(make_world)
    world.relax(tolerance=1e-5)
    assert world.report.converged and world.report.tolerance == 1e-5
    assert world.report.ended_by in ("tolerance", "rounding")
    loose = make_world(gravity=(0, 0, -9.81))
    loose.add_tendon([[0, 0, 0], [0.2, 0, 0]], 0.002, ROPE, 31)  # nothing holds it
    loose.relax()
    assert loose.report.ended_by == "failure"
