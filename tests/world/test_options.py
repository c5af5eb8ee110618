"""SolverOptions: defaults, every argument's bounds, and that each of them reaches the solver."""

import dataclasses
import math

import numpy as np
import pytest

import bullet_tendon as bt

CHOICES = {
    "integrator": ("implicit_euler", "bdf2", "explicit_euler"),
    "iteration": ("newton", "single"),
    "linear_solver": ("banded", "pcg"),
    "bone_contact": ("spring", "constraint"),
}
OUT_OF_RANGE = {
    "tolerance": [0, -1e-8, 1.5, math.nan],
    "linear_tolerance": [0, 2, math.inf],
    "max_iterations": [0, -3],
    "contact_stiffness": [0, -1, math.inf],
    "contact_threshold": [-1e-6, math.nan],
    "reuse_tolerance": [-1e-9, math.inf],
}
NUMBERS = [*OUT_OF_RANGE]


def test_defaults_are_valid_and_frozen():
    options = bt.SolverOptions()
    assert (options.integrator, options.iteration, options.linear_solver) == (
        "implicit_euler",
        "newton",
        "banded",
    )
    with pytest.raises(dataclasses.FrozenInstanceError):
        options.tolerance = 1.0
    with pytest.raises(TypeError):
        bt.SolverOptions("bdf2")


@pytest.mark.parametrize(("name", "value"), [(n, v) for n, values in CHOICES.items() for v in values])
def test_choices(name, value):
    assert getattr(bt.SolverOptions(**{name: value}), name) == value


@pytest.mark.parametrize("name", CHOICES)
@pytest.mark.parametrize("value", ["fast", "", None, 0])
def test_other_choices_are_refused(name, value):
    with pytest.raises(bt.InvalidValue) as caught:
        bt.SolverOptions(**{name: value})
    assert caught.value.argument == name
    assert all(repr(allowed) in str(caught.value) for allowed in CHOICES[name])


@pytest.mark.parametrize(("name", "value"), [(n, v) for n, values in OUT_OF_RANGE.items() for v in values])
def test_numbers_out_of_range_are_refused(name, value):
    with pytest.raises(bt.InvalidValue) as caught:
        bt.SolverOptions(**{name: value})
    assert caught.value.argument == name


@pytest.mark.parametrize("name", NUMBERS)
@pytest.mark.parametrize("value", ["1", True, [1]])
def test_other_types_are_refused(name, value):
    with pytest.raises(bt.InvalidType) as caught:
        bt.SolverOptions(**{name: value})
    assert caught.value.argument == name


def test_published_is_the_papers_method():
    options = bt.SolverOptions.published(tolerance=1e-3)
    assert (options.integrator, options.iteration, options.linear_solver) == (
        "implicit_euler",
        "single",
        "pcg",
    )
    assert options.tolerance == 1e-3


def swing(make_world, **options):
    """A violent swing: positions after 20 steps, the iterations used and the last report."""
    world = make_world(1 / 240, (0, 0, -9.81), **options)
    material = bt.Material(stiffness=3e4, exponent=2.0, damping=1.0, shear_stiffness=3e3)
    t = world.add_tendon([[0, 0, 0], [0.1, 0, 0]], 0.002, material, 20)
    t.grip(0)
    used = 0
    for _ in range(20):
        world.step()
        used = max(used, world.report.iterations)
    return t.positions, used, world.report


def test_both_linear_solvers_solve_the_same_steps(make_world):
    precise = {"tolerance": 1e-10, "linear_tolerance": 1e-12}
    direct, _, report = swing(make_world, **precise)
    iterative, _, other = swing(make_world, linear_solver="pcg", **precise)
    assert report.converged
    assert other.converged
    np.testing.assert_allclose(iterative, direct, rtol=0, atol=1e-8)


def test_a_tight_tolerance_takes_more_iterations_and_is_met(make_world):
    loose, tight = (swing(make_world, tolerance=tolerance) for tolerance in (1e-2, 1e-9))
    assert loose[1] < tight[1]
    assert tight[2].converged
    assert tight[2].residual <= 1e-9
    single = swing(make_world, iteration="single")
    assert single[1] == 1


def test_running_out_of_iterations_is_reported(make_world):
    world = make_world(1 / 240, max_iterations=1, tolerance=1e-12)
    t = world.add_tendon([[0, 0, 0], [0.1, 0, 0]], 0.002, bt.Material(stiffness=3e4, exponent=2.0), 20)
    t.grip(0)
    t.set_positions(t.positions + np.linspace(0, 0.05, 20)[:, None] ** 2 * [0, 40, 0])
    world.step()
    assert not world.report.converged
    assert world.report.residual > 1e-12
    assert world.report.worst[0] == t.name
    assert 0 <= world.report.worst[1] < 20
