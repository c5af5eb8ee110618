"""What the benchmark `coupling` measures is what is known of its methods."""

import cmath
import math

import numpy as np
import pytest
from bullet_tendon.scenarios.benchmarks import coupling
from bullet_tendon.scenarios.benchmarks.coupled_bodies import HELD, MOVING, Cell, hold, move, rest
from bullet_tendon.scenarios.benchmarks.coupled_springs import (
    LENGTH,
    METHODS,
    HandWrittenSpring,
    TendonSpring,
    TwoStepSpring,
)


def cell_with(omega_dt, mass=0.1, dt=1 / 240):
    return Cell(mass * LENGTH * (omega_dt / dt) ** 2, mass, dt)


def hanging(method, cell, steps=400):
    return move(method, "hanging", cell, steps)


@pytest.mark.parametrize(("turn", "kept"), [(0.9, 0.7), (0.05, 1.0), (2e-4, 1.0), (2e-3, 0.99999)])
def test_the_angle_of_an_oscillation_is_read_from_a_part_of_it(turn, kept):
    k = np.arange(2400)
    samples = 0.3 * kept**k * np.cos(turn * k + 0.4)
    assert coupling.oscillation(samples) == pytest.approx(turn, rel=1e-6)
    assert coupling.oscillation(0.5 ** k[:50] + 0.4 ** k[:50]) is None  # it does not oscillate


@pytest.mark.parametrize("omega_dt", [0.05, 0.3, 0.9])
def test_periods_of_all_methods_are_those_of_their_integrators(omega_dt):
    """In a step symplectic Euler turns by 2 asin(w h/2), implicit Euler by atan(w h).

    BDF2 takes y' = i w y from q z to z, with 3/2 - 2 q + q^2/2 = i w h. The second root of that fades in the
    first period.
    """
    turns = {HandWrittenSpring: 2 * math.asin(omega_dt / 2), TendonSpring: math.atan(omega_dt)}
    turns[TwoStepSpring] = -cmath.phase(2 - cmath.sqrt(1 + 2j * omega_dt))
    cell = cell_with(omega_dt)
    for method, turn in turns.items():
        found = hanging(method, cell)
        period, path = coupling.motion_errors(cell, found["depths"], found["mass"])
        fading = 0.03 if method is TwoStepSpring else 1e-3
        assert period == pytest.approx(abs(omega_dt / turn - 1), rel=fading)
        assert path < 2 * omega_dt


@pytest.mark.parametrize("name", METHODS)
@pytest.mark.parametrize("case", ["hanging", "free"])
def test_the_explicit_force_alone_is_stable_up_to_its_limit_only(name, case):
    below, above = (move(METHODS[name], case, cell_with(w), 200)["gain"] for w in (1.5, 2.1))
    assert below <= coupling.GAIN
    if name == "explicit force":
        assert above is None or above > coupling.GAIN
    else:
        assert above <= coupling.GAIN


@pytest.mark.parametrize("method", METHODS.values())
def test_a_weight_at_rest_is_carried_by_its_weight_and_a_load_by_its_load(method):
    cell = cell_with(0.3)
    assert rest(method, cell, 400) < 1e-9
    for case in HELD:
        assert hold(method, case, Cell(1e3, 1.0, 1 / 240), 120, 30) < 1e-2


def test_the_summary_counts_cells_and_compares_where_all_are_stable():
    def found(stable, rest):
        errors, gains = dict.fromkeys(coupling.ERRORS) | {"rest": rest}, dict.fromkeys(MOVING, 0.0)
        return {"stable": stable, "strict": stable, "gain": gains, "errors": errors, "step_us": 1.0}

    good = found(True, 1e-4)
    rows = [(good, good, found(True, 1e-2)), (good, good, found(False, 1e3))]
    cells = [{"methods": dict(zip(METHODS, row, strict=True))} for row in rows]
    record = coupling.summary(cells)
    euler, _, explicit = record["methods"].values()
    assert (euler["stable_share"], explicit["stable_share"]) == (1.0, 0.5)
    assert explicit["within_1_percent"]["rest"] == [1, 2]
    stable = record["all_stable"]
    assert (stable["cells"], stable["period"]) == (1, None)
    assert stable["rest"]["errors"] == pytest.approx(dict(zip(METHODS, (1e-4, 1e-4, 1e-2), strict=True)))
    assert coupling.worst_error(cells[1]["methods"]["explicit force"]) is None
