"""The benchmarks run and write what they should, and their references are right. No time is judged."""

import json
import math

import numpy as np
import pytest
from bullet_tendon.scenarios.benchmarks import (
    cylinder,
    hand_record,
    harness,
    multibody,
    multibody_problems,
    peers,
    problems,
    rigid_ode,
    speed,
    work_precision,
)
from bullet_tendon.scenarios.benchmarks.chain_ode import PLANE, ChainOde
from conftest import SANITIZED
from scipy.spatial.transform import Rotation

import bullet_tendon as bt
from bullet_tendon import _core

NAMES = [
    "apart",
    "call",
    "camera",
    "coupling",
    "haptic",
    "heap",
    "many_bodies",
    "multibody",
    "peers",
    "recorder",
    "speed",
    "whole_knee",
    "work_precision",
]


def numbers(item):
    """All numbers in a record."""
    if isinstance(item, dict):
        item = list(item.values())
    if isinstance(item, list):
        return [number for part in item for number in numbers(part)]
    return [item] if isinstance(item, (int, float)) else []


def test_command_without_a_name_lists_the_benchmarks(capsys):
    assert harness.main([]) == 0
    names = [line.split()[0] for line in capsys.readouterr().out.splitlines()]
    assert names == NAMES


def test_an_unknown_name_is_refused(capsys):
    with pytest.raises(SystemExit) as stop:
        harness.main(["sped"])
    assert stop.value.code == 2
    assert ", ".join(NAMES) in capsys.readouterr().err


@pytest.mark.parametrize("name", NAMES)
def test_quick_runs_write_finite_numbers_and_a_plot(name, tmp_path, capsys):
    pytest.importorskip("matplotlib")
    files = tmp_path / "it.json", tmp_path / "it.png"
    assert harness.main([name, "--quick", "--json", str(files[0]), "--plot", str(files[1])]) == 0
    record = json.loads(files[0].read_text())
    assert (record["benchmark"], record["quick"]) == (name, True)
    found = numbers(record)
    assert len(found) > 20
    assert all(math.isfinite(number) for number in found)
    assert files[1].stat().st_size > 1000
    assert capsys.readouterr().out.count("\n") > 5


@pytest.mark.parametrize("seed", range(5))
def test_the_record_of_a_hand_reaches_the_end_and_is_no_faster_than_a_slip(seed):
    along, off = hand_record.hand_record(0.2, seed)
    assert len(along) == len(off) and along[0] == 0
    assert along[-1] == pytest.approx(0.2, abs=hand_record.ENCODER)
    fastest = 1.875 * hand_record.SLIP[1] / hand_record.SLIP_TIME  # of a minimum-jerk movement
    assert (
        np.abs(np.diff(along)).max() * hand_record.RATE < fastest + 2 * hand_record.ENCODER * hand_record.RATE
    )
    assert np.diff(along).min() < 0
    assert np.abs(off).max() <= hand_record.TREMOR + hand_record.ENCODER
    assert np.array_equal(along, hand_record.hand_record(0.2, seed)[0])


def test_the_exact_equations_of_free_bodies_conserve_energy():
    """Two boxes, turned and off centre, on springs: elastic energy, motion and height, by differences."""
    springs = [(-1, np.zeros(3), 0, np.array([0.03, 0.01, 0.05]), 300.0, 0.1)]
    springs.append((0, np.array([0, -0.02, -0.05]), 1, np.array([0.01, 0, 0.04]), 300.0, 0.1))
    masses, inertias = np.array([0.5, 0.3]), np.array([[1e-3, 2e-3, 2.5e-3], [1e-3, 5e-4, 8e-4]])
    bodies = rigid_ode.FreeBodies(masses, inertias, springs)
    turns = Rotation.from_euler("xyz", [[0.3, 0.2, 0.1], [-0.2, 0.4, 0.0]])
    start = np.concatenate([[0.1, 0, -0.2, 0.15, 0.02, -0.4], turns.as_quat().ravel(), np.zeros(12)])

    def energy(state):
        x, turn, v, spin = np.split(state, [6, 14, 20])
        x, v, spin = (part.reshape(2, 3) for part in (x, v, spin))
        turn = Rotation.from_quat(turn.reshape(2, 4))
        own = turn.inv().apply(spin)
        kinetic = 0.5 * np.sum(masses * np.sum(v**2, 1)) + 0.5 * np.sum(inertias * own**2)
        height = rigid_ode.GRAVITY * np.sum(masses * x[:, 2])

        def at(body, point):
            return point if body < 0 else x[body] + turn[body].apply(point)

        stretches = [np.linalg.norm(at(a, p) - at(b, q)) - rest for a, p, b, q, _, rest in springs]
        return kinetic + height + sum(0.5 * 300.0 / 0.1 * s**2 for s in stretches)

    end = rigid_ode._solve(bodies._rates, start, np.array([0.2, 0.7]))
    assert np.abs(end[1, 14:20]).max() > 0.1
    assert energy(end[1]) == pytest.approx(energy(start), abs=1e-7)


def test_the_exact_equations_of_the_arm_conserve_energy():
    arm = rigid_ode.Arm(0.2, 0.5, 0.5 * 0.2**2 / 12, [0.4, 0, 0.3], 50.0, 0.3)
    start = np.array([0.2, 0.7, 0.0, 0.0])

    def energy(state):
        step = 1e-6
        places = [arm.points(state[:2] + k * step * state[2:]) for k in (-1, 0, 1)]
        velocity = (places[2] - places[0])[:2] / (2 * step)
        rates = np.cumsum(state[2:])
        kinetic = 0.25 * np.sum(velocity**2) + 0.5 * arm.inertia * np.sum(rates**2)
        stretch = np.linalg.norm(arm.anchor - places[1][2]) - 0.3
        return kinetic + 0.5 * 9.81 * places[1][:2, 2].sum() + 0.5 * 50.0 / 0.3 * stretch**2

    end = rigid_ode._solve(arm._rates, start, np.array([0.1, 0.6]))
    assert np.abs(end[1, 2:]).max() > 0.1
    assert energy(end[1]) == pytest.approx(energy(start), abs=1e-7)


@pytest.mark.parametrize("problem", ["pendulum", "double pendulum", "plate"])
def test_bdf2_follows_free_bodies_at_second_order_half_a_step_later(problem):
    build = multibody_problems.PROBLEMS[problem]
    rates = (240, 480)
    exact = multibody._references(build, rates, 1.0)
    errors = [
        multibody._error(multibody._measure(build, "BDF2", rate, 1.0)[1], exact[rate][1]) for rate in rates
    ]
    assert errors[1] < 1e-3
    assert 1.8 < math.log2(errors[0] / errors[1]) < 2.2


def test_json_refuses_what_is_not_finite(tmp_path):
    with pytest.raises(ValueError, match="JSON"):
        harness.write_json({"it": float("nan")}, str(tmp_path / "it.json"))


@pytest.mark.parametrize(("exponent", "rate"), [(1.0, 1.0), (2.0, 1.0), (1.5, 2.0)])
def test_the_reference_has_the_accelerations_of_the_core(make_world, exponent, rate):
    dt = 1e-3
    world = make_world(dt, (0, 0, -9.81), integrator="explicit_euler")
    material = bt.Material(stiffness=500.0, exponent=exponent, damping=2.0, damping_exponent=rate)
    tendon = world.add_tendon([(0, 0, 0), (0.3, 0, 0)], 1e-3, material, 7)
    tendon.grip(0)
    random = np.random.default_rng(3)
    x, v = tendon.positions, np.zeros((7, 3))
    x[1:, PLANE] += 0.01 * random.standard_normal((6, 2))
    v[1:, PLANE] = random.standard_normal((6, 2))
    tendon.set_positions(x, v)
    world.step()
    ode = ChainOde(tendon.masses, np.full(6, 0.05), material, (0,), -9.81)
    expected = ode.accelerations(x[:, PLANE], v[:, PLANE])
    got = (tendon.velocities - v)[:, PLANE] / dt
    np.testing.assert_allclose(got, expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


def test_the_reference_oscillator_has_the_exact_period():
    oscillator = next(q for q in problems.PROBLEMS if q.name == "power-law oscillator")
    with oscillator.scene(1.0) as scene:
        tendon = oscillator.start(scene)
        x = tendon.positions[:, PLANE]
        period = problems.oscillator_period()
        times = np.array([0.5, 1.0]) * period
        half, whole = oscillator.ode(tendon).solve(x, 0 * x, times, "DOP853", 1e-11)
    amplitude = problems.SPRING["amplitude"]
    assert half[1, 0] == pytest.approx(problems.LENGTH - amplitude, abs=1e-9)
    assert whole[1, 0] == pytest.approx(problems.LENGTH + amplitude, abs=1e-9)


def test_the_band_matrix_is_positive_definite_and_resists_stretch_and_swing():
    x = np.zeros((3, 3))
    x[:, 0] = [0.0, 1.1, 2.2]  # strain 0.1
    masses, dt, stiffness = np.array([1.0, 2.0, 1.0]), 0.5, 100.0
    band = speed.band_matrix(x, masses, [(1, np.ones(2), stiffness)], dt)
    full = np.zeros((9, 9))
    for below, row in enumerate(band):
        for column in range(9 - below):
            full[column + below, column] = full[column, column + below] = row[column]
    slope, across = stiffness * 2 * 0.1, stiffness * 0.1**2 / 1.1
    np.testing.assert_allclose(full[3:6, 3:6], np.diag([8 + 2 * slope, 8 + 2 * across, 8 + 2 * across]))
    np.testing.assert_allclose(full[6:, 3:6], -np.diag([slope, across, across]), atol=1e-12)
    assert np.linalg.eigvalsh(full).min() > 0


def test_time_to_reach_is_interpolated_on_logarithmic_scales():
    runs = [{"error": e, "seconds": s} for e, s in ((None, 0.1), (1e-1, 1.0), (1e-3, 4.0), (1e-5, 9.0))]
    assert work_precision.time_to_reach(runs, 1e-2) == pytest.approx(2.0)
    assert work_precision.time_to_reach(runs, 1.0) == pytest.approx(1.0)
    assert work_precision.time_to_reach(runs, 1e-6) is None


def test_order_is_the_slope_over_the_finest_runs():
    runs = [{"error": 3 * h**2 if h < 0.3 else None, "time_step_s": h} for h in (0.4, 0.2, 0.1, 0.05)]
    assert work_precision.order(runs) == pytest.approx(2.0)
    assert work_precision.order(runs[:2]) is None


def test_the_hanging_curve_is_where_finer_and_finer_chains_hang(make_world):
    """Between the ends that it should have, and approached with the square of the segments' length."""
    ends = peers.hanging_curve([0.0, peers.LENGTH])
    np.testing.assert_allclose(ends, [[0, 0], [peers.SPAN, 0]], atol=1e-12)
    away = []
    for n in (21, 41):
        world = make_world(1.0, (0, 0, -peers.GRAVITY))
        material = bt.Material(stiffness=peers.STIFF, density=peers.DENSITY)
        depth = math.sqrt(peers.LENGTH**2 - peers.SPAN**2) / 2
        corners = [(0, 0, 0), (peers.SPAN / 2, 0, -depth), (peers.SPAN, 0, 0)]
        tendon = world.add_tendon(corners, peers.RADIUS, material, n)
        tendon.grip(0), tendon.grip(-1)
        world.relax(1e-12)
        curve = peers.hanging_curve(np.linspace(0, peers.LENGTH, n))
        away.append(np.abs(tendon.positions[:, PLANE] - curve).max())
    assert away[1] < 2e-4 * peers.LENGTH
    assert away[0] / away[1] == pytest.approx(4.0, rel=0.05)


def test_over_the_cylinder_the_reference_slides_as_two_weights_do():
    """Without friction and with a light tendon: (m2 - m1) g / (m1 + m2), both weights alike."""
    problem = next(q for q in problems.PROBLEMS if q.contact)
    duration, (left, right) = 0.05, cylinder.WEIGHTS
    with problem.scene(1.0) as scene:
        tendon = problem.start(scene)
        x = tendon.positions[:, PLANE]
        ode = problem.ode(tendon)
        moved = ode.solve(x, 0 * x, [duration], "Radau", 1e-5)[0] - x
    hanging = cylinder.MASS * (x[-1, 1] - x[0, 1]) / cylinder.LENGTH  # less on the right
    pull = (right - left - hanging) * cylinder.GRAVITY / (left + right + cylinder.MASS)
    assert np.linalg.norm(x + moved, axis=1).min() > cylinder.CLEAR - 2e-5
    assert -moved[-1, 1] == pytest.approx(0.5 * pull * duration**2, rel=0.05)
    assert moved[0, 1] == pytest.approx(-moved[-1, 1], rel=0.05)


@pytest.mark.skipif(SANITIZED, reason="a sanitizer has an allocator of its own")
@pytest.mark.parametrize("integrator", ["implicit_euler", "bdf2"])
def test_the_core_counts_what_it_asks_for_and_asks_for_nothing_in_a_step(integrator):
    before = _core.allocated_bytes()
    with speed.pendulum.scene() as scene:
        scene.world.options = bt.SolverOptions(integrator=integrator)
        speed._build(scene, 60, 0.1, 0.004)
        assert _core.allocated_bytes() - before > 60 * 8 * 30  # it does count
        scene.world.step(5)
        assert speed._core_allocated(scene) == 0
