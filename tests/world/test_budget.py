"""The work of a step is bounded: by linear solutions, by wall time, and by Ctrl-C."""

import math
import os
import signal
import threading
import time

import numpy as np
import pybullet as p
import pytest
from link_scenes import free_ball, hinged

import bullet_tendon as bt
from bullet_tendon.reports import REASONS

# Linear solutions of the substep in which the budget ends: up to four iterations, each again where the matrix
# is not definite, and the same once more where the substep is halved.
LAST = 2 * 2 * 4


def folding(make_world, particles=60, **options):
    """A tendon with bending stiffness, held in its middle, whose ends are pulled down: it folds."""
    world = make_world(gravity=(0, 0, 0), **options)
    material = bt.Material.preset("hamstring_graft")
    stiff = bt.Material(
        stiffness=material.stiffness,
        exponent=material.exponent,
        toe_strain=material.toe_strain,
        tension_only=material.tension_only,
        bending_stiffness=1e-5,
        density=material.density,
    )
    t = world.add_tendon([[-0.08, 0, 0], [0.08, 0, 0]], 0.24 / particles, stiff, particles)
    t.grip(particles // 2)
    for end in (0, -1):
        t.set_force(end, (0, 0, -1.0))
    return world, t


def tangle_up(tendon, seed=0):
    """Put the particles far from their neighbours, at random."""
    line = np.linspace([0, 0, 0], [0.3, 0, 0], len(tendon.positions))
    tendon.set_positions(line + 0.05 * np.random.default_rng(seed).normal(size=line.shape))


def tangled(make_world, particles, **options):
    """A tendon that is held at both ends, tangled up."""
    world = make_world(gravity=(0, 0, -9.81), **options)
    material = bt.Material(stiffness=3e5, exponent=2.0)
    t = world.add_tendon([[0, 0, 0], [0.3, 0, 0]], 1e-3, material, particles)
    t.grip(0), t.grip(-1)
    tangle_up(t)
    return world, t


def test_linear_solutions_are_bounded(make_world):
    """Of a whole step, with all its substeps: what is over it are the last iterations of one substep."""
    world, t = folding(make_world, max_linear_solves=40)
    over = 0
    for _ in range(12):
        world.step()
        assert np.isfinite(t.positions).all()
        assert np.isfinite(t.velocities).all()
        assert world.report.counts["linear_solves"] <= 40 + LAST
        assert not world.report.over_budget or world.report.counts["linear_solves"] >= 40
        assert not (world.report.over_budget and world.report.converged)
        over += world.report.over_budget
    assert over > 0


def test_a_step_within_its_bound_is_the_same(make_world):
    """The bound changes nothing until it is reached."""
    found = []
    for most in (100_000, 1000):
        world = make_world(gravity=(0, 0, -9.81), max_linear_solves=most)
        t = world.add_tendon([[0, 0, 0], [0.1, 0, 0]], 1e-3, bt.Material(stiffness=1e4, damping=1.0), 20)
        t.grip(0)
        world.step(60)
        assert not world.report.over_budget
        assert world.report.counts["linear_solves"] >= 1
        found.append(t.positions)
    np.testing.assert_array_equal(*found)


@pytest.mark.parametrize("integrator", ["implicit_euler", "bdf2"])
def test_a_step_solved_with_its_last_solution_is_not_over_its_budget(make_world, integrator):
    """One linear solution fewer, and it is: then it has not converged."""
    found = []
    for most in (100_000, None, -1):
        solves = found[0][0] + (most or 0) if found else most
        world = make_world(gravity=(0, 0, -9.81), integrator=integrator, max_linear_solves=solves)
        t = world.add_tendon([[0, 0, 0], [0.1, 0, 0]], 1e-3, bt.Material(stiffness=1e4, damping=1.0), 20)
        t.grip(0), t.grip(-1)
        world.step()
        report = world.report
        found.append((report.counts["linear_solves"], report.converged, report.over_budget, t.positions))
    free, enough, short = found
    assert free[0] >= 2
    assert enough[:3] == (free[0], True, False)
    np.testing.assert_array_equal(enough[3], free[3])
    assert short[1:3] == (False, True)
    assert np.isfinite(short[3]).all()


def test_wall_time_is_bounded(make_world):
    """Of a budget that no step can keep, the last iterations of one substep are left."""
    world, t = folding(make_world, time_budget=1e-9)
    for _ in range(8):
        world.step()
        assert world.report.over_budget
        assert not world.report.converged
        assert world.report.counts["linear_solves"] <= LAST
        assert np.isfinite(t.positions).all()


@pytest.mark.parametrize("most", [2, 4, 8])
def test_contacts_are_not_detected_again_and_again_after_the_budget(make_world, most):
    """Of ten tendons that cross each other in one point, and push each other apart."""
    world = make_world(gravity=(0, 0, -9.81), max_linear_solves=most)
    material = bt.Material(stiffness=1e4, bending_stiffness=1e-5)
    ends = [0.1 * np.array([math.cos(a), math.sin(a), 0]) for a in np.pi * np.arange(10) / 10]
    tendons = [world.add_tendon([-end, end], 2e-3, material, 30) for end in ends]
    for _ in range(40):
        world.step()
        assert world.report.over_budget
        assert world.report.reasons.get("left_prediction", 0) <= 3
        assert all(np.isfinite(t.positions).all() for t in tendons)


def plate(client, half_thickness, height):
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.5, 0.5, half_thickness], physicsClientId=client)
    return p.createMultiBody(0, shape, basePosition=[0, 0, height], physicsClientId=client)


@pytest.mark.parametrize("limit", [{"time_budget": 1e-9}, {"max_linear_solves": 1}])
def test_nothing_passes_a_plate_in_steps_over_budget(make_world, client, limit):
    """A tendon that is thrown at it at 100 m/s, 1.7 m a step."""
    world = make_world(1 / 60, **limit)
    world.add_obstacle(plate(client, 1e-3, -0.05))
    t = world.add_tendon([[0, 0, 0], [0.1, 0, 0]], 1e-3, bt.Material(stiffness=1e3), 20)
    t.set_positions(t.positions, np.tile([0, 0, -100.0], (20, 1)))
    lowest, over = 0.0, 0
    for _ in range(40):
        world.step()
        lowest, over = min(lowest, t.positions[:, 2].min()), over + world.report.over_budget
    assert over > 0
    assert lowest > -0.05


def ball_beside_a_tangle(make_world, client, stiffness, solves, particles=100, **options):
    """A ball of 1 kg that hangs on 0.2 m of tendon, while a tendon elsewhere exhausts the budget."""
    world, tangle = tangled(make_world, particles, max_linear_solves=solves, **options)
    ball = free_ball(client, 1.0, at=(0, 1, -0.2))
    p.changeDynamics(ball, -1, linearDamping=0, angularDamping=0, physicsClientId=client)
    material = bt.Material(stiffness=stiffness, damping=20.0)
    t = world.add_tendon([[0, 1, 0], [0, 1, -0.2]], 1e-3, material, 10)
    t.attach(-1, ball, -1, [0, 0, 0])
    return world, tangle, t.grip(0), ball


@pytest.mark.parametrize("solves", [40, 100])
@pytest.mark.parametrize("stiffness", [1e4, 1e5, 1e6])
@pytest.mark.parametrize("push", [0.0, 30.0])
@pytest.mark.parametrize("integrator", ["implicit_euler", "bdf2"])
def test_what_hangs_is_held_in_steps_over_budget(make_world, client, integrator, stiffness, solves, push):
    """In every step it is no faster than its loads can have made it, and the grip bears what they ask."""
    world, tangle, grip, ball = ball_beside_a_tangle(
        make_world, client, stiffness, solves, integrator=integrator
    )
    over, load, spring = 0, 9.81 + push, stiffness / 0.2
    for k in range(90):
        if k == 30:
            assert over == 30
            world.remove_tendon(tangle)
        elif k < 30:
            tangle_up(tangle, k)
        (_, _, height), _ = p.getBasePositionAndOrientation(ball, client)
        if push:
            p.applyExternalForce(ball, -1, [0, 0, -push], [0, 1, height], p.WORLD_FRAME, client)
        world.step()
        over += world.report.over_budget
        speed = np.linalg.norm(p.getBaseVelocity(ball, client)[0])
        # A load that begins at once sinks by twice its sag. pybullet's own pushes are known a step later.
        assert speed <= 2.05 * max(load / math.sqrt(spring), load / 240)
        assert np.linalg.norm(grip.force) <= 4 * load
    assert height == pytest.approx(-0.2 - load / spring, abs=2e-5)
    np.testing.assert_allclose(grip.force, [0, 0, -load], rtol=0.02)


@pytest.mark.parametrize("particles", [60, 80])
@pytest.mark.parametrize("integrator", ["implicit_euler", "bdf2"])
def test_an_unknown_push_is_held_while_a_tangle_comes_loose(make_world, client, integrator, particles):
    """The push is learned, and what holds it bears no more than a load that begins at once: twice its own."""
    options = {"particles": particles, "integrator": integrator}
    world, _, grip, ball = ball_beside_a_tangle(make_world, client, 1e6, 100, **options)
    over, push = 0, 30.0
    for _ in range(60):
        (_, _, height), _ = p.getBasePositionAndOrientation(ball, client)
        p.applyExternalForce(ball, -1, [0, 0, -push], [0, 1, height], p.WORLD_FRAME, client)
        world.step()
        over += world.report.over_budget
        assert np.linalg.norm(grip.force) <= 3 * (9.81 + push)
    assert over > 5
    np.testing.assert_allclose(grip.force, [0, 0, -9.81 - push], rtol=0.02)


@pytest.mark.parametrize("integrator", ["implicit_euler", "bdf2"])
def test_a_tangle_slows_down_nothing_but_itself(make_world, client, integrator):
    """A ball beside it swings in steps over budget as in others."""
    world, tangle, _, ball = ball_beside_a_tangle(make_world, client, 1e5, 40, integrator=integrator)
    p.resetBaseVelocity(ball, [1.0, 0, 0], physicsClientId=client)
    over = 0
    for k in range(8):
        tangle_up(tangle, k)
        world.step()
        over += world.report.over_budget
    assert over == 8
    (x, _, _), _ = p.getBasePositionAndOrientation(ball, client)
    assert x == pytest.approx(8 / 240, rel=0.03)
    world.remove_tendon(tangle)
    world.step(2)
    assert not world.report.over_budget
    (x, _, z), _ = p.getBasePositionAndOrientation(ball, client)
    speed = np.linalg.norm(p.getBaseVelocity(ball, client)[0])
    assert 0.5 * speed**2 + 9.81 * (z + 0.2) == pytest.approx(0.5, rel=0.03)


def test_motion_of_a_joint_that_is_left_out_is_not_lost(make_world, client, tmp_path):
    """An arm that swings with a light thread at its tip keeps the energy of its motion and of its height.

    The thread moves by many radii in a step, so that it is not solved in the rest of one.
    """
    world, tangle = tangled(make_world, 100, max_linear_solves=40)
    arm = hinged(client, tmp_path)
    p.resetBasePositionAndOrientation(arm, [0, 1, 0], [0, 0, 0, 1], physicsClientId=client)
    tip = np.array([0.1, 1, 0])
    thread = world.add_tendon([tip, tip - [0, 0, 0.02]], 2e-4, bt.Material(stiffness=1e3), 25)
    thread.attach(0, arm, 0, [0.1, 0, 0])

    def energy():
        angle, rate = p.getJointState(arm, 0, physicsClientId=client)[:2]
        return 0.5 * (5e-5 + 0.05 * 0.05**2) * rate**2 - 0.05 * 9.81 * 0.05 * math.sin(angle)

    before, over = energy(), 0
    for k in range(8):
        tangle_up(tangle, k)
        world.step()
        over += world.report.over_budget
    assert over == 8
    assert energy() < 0.1 * before  # it has been slowed down
    world.remove_tendon(tangle)
    world.options = bt.SolverOptions()  # the thread alone takes about as many linear solutions
    world.step(2)
    assert not world.report.over_budget
    assert energy() == pytest.approx(before, rel=0.03)


def test_what_was_stopped_meanwhile_stays(make_world, client):
    """Motion that was left out is not given back to a ball that the user has put to rest."""
    world, tangle, _, ball = ball_beside_a_tangle(make_world, client, 1e5, 40)
    p.resetBaseVelocity(ball, [1.0, 0, 0], physicsClientId=client)
    world.step()
    assert world.report.over_budget
    world.remove_tendon(tangle)
    p.resetBaseVelocity(ball, [0, 0, 0], [0, 0, 0], physicsClientId=client)
    world.step(2)
    assert np.linalg.norm(p.getBaseVelocity(ball, client)[0]) < 0.02


def test_reasons_are_told(make_world):
    """A step that does not converge is halved, and the report says how often."""
    world, tangle = tangled(make_world, 100, max_linear_solves=40)
    counts = {}
    for k in range(12):
        tangle_up(tangle, k)
        world.step()
        for name, count in world.report.reasons.items():
            counts[name] = counts.get(name, 0) + count
        assert world.report.counts["substeps"] >= 1
    assert counts["not_converged"] > 0


def pushed_ball(client, world, _):
    """A ball on a tendon, pushed by 200 N in one step."""
    ball = free_ball(client, 0.2, radius=0.02)
    t = world.add_tendon([[0.02, 0, 0], [0.2, 0, 0.05]], 1e-3, bt.Material(stiffness=2e3), 20)
    t.attach(0, ball, -1, [0.02, 0, 0])
    t.grip(-1)
    world.step(4)
    p.applyExternalForce(ball, -1, [-200, 0, 100], [0, 0, 0], p.WORLD_FRAME, physicsClientId=client)
    world.step()


def released_arm(client, world, tmp_path):
    """A hinged arm that a motor has held against a taut tendon. The motor is switched off."""
    arm = hinged(client, tmp_path)
    p.resetJointState(arm, 0, 0.0, physicsClientId=client)
    t = world.add_tendon([[0.1, 0, 0], [0.1, 0, 0.3]], 1e-3, bt.Material(stiffness=2e4), 20)
    t.attach(0, arm, 0, [0.1, 0, 0])
    t.grip(-1).target = [0.1, 0, 0.301]
    p.setJointMotorControl2(arm, 0, p.POSITION_CONTROL, targetPosition=0, force=1e3, physicsClientId=client)
    world.step(60)
    p.setJointMotorControl2(arm, 0, p.VELOCITY_CONTROL, force=0, physicsClientId=client)


@pytest.mark.parametrize("scene", [pushed_ball, released_arm])
def test_the_work_of_a_step_that_is_solved_again_is_told(make_world, client, monkeypatch, tmp_path, scene):
    """Before this step, or after it: iterations, linear solutions and the reason are in its report."""
    world = make_world(gravity=(0, 0, -9.81))
    scene(client, world, tmp_path)
    stepper, before = world._stepper, []

    def solve(*args, original=stepper._solve):
        solved = original(*args)
        found = stepper._core.report()
        before.append((found.iterations, found.counts()["linear_solves"], found.reasons))
        return solved

    monkeypatch.setattr(stepper, "_solve", solve)
    world.step()
    ((iterations, solves, reasons),) = before
    assert iterations > 0
    assert world.report.reasons["released"] == 1
    for name, count in zip(REASONS, reasons, strict=True):
        assert world.report.reasons.get(name, 0) >= count, name
    assert world.report.iterations >= iterations
    assert world.report.counts["linear_solves"] >= solves
    world.step()
    assert len(before) == 1
    assert "released" not in world.report.reasons


def test_a_step_that_is_solved_again_shares_the_budget_of_the_next(make_world, client):
    """Once the solution of the last step has exhausted it, this one is over it too."""
    world = make_world(gravity=(0, 0, -9.81), max_linear_solves=3)
    pushed_ball(client, world, None)
    world.step()
    assert world.report.reasons["released"] == 1
    assert world.report.over_budget
    assert world.report.counts["linear_solves"] <= 3 + 2 * LAST


@pytest.mark.parametrize("name", ["max_linear_solves", "time_budget"])
@pytest.mark.parametrize("value", [0, -1, math.nan, "many"])
def test_bounds_that_are_none_are_refused(name, value):
    with pytest.raises((bt.InvalidValue, bt.InvalidType), match=name):
        bt.SolverOptions(**{name: value})


@pytest.fixture
def interruptible():
    """Python's own handler of Ctrl-C, which a process that was started in the background has not."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def test_ctrl_c_ends_a_long_step(make_world, interruptible):
    """The step is left within a second, and the tendons are as they were before it."""
    world, t = tangled(make_world, 400, max_linear_solves=10**8, max_iterations=10**5)
    begun = time.perf_counter()
    timer = threading.Timer(0.4, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    before = t.positions, t.velocities
    with pytest.raises(KeyboardInterrupt):
        world.step()
    timer.join()
    assert time.perf_counter() - begun < 10
    np.testing.assert_array_equal(t.positions, before[0])
    np.testing.assert_array_equal(t.velocities, before[1])
    world.options = bt.SolverOptions(max_linear_solves=50)
    world.step()
    assert np.isfinite(t.positions).all()


@pytest.mark.parametrize("most", [12, 24])
def test_what_a_user_moves_does_not_pass_cords_that_a_budget_leaves_unsolved(make_world, client, most):
    """A box is led through hanging cords at 0.2 m/s. Some steps need more than the budget."""
    world = make_world(gravity=(0, 0, -9.81), max_linear_solves=most)
    half, radius, speed = np.array([0.02, 0.05, 0.05]), 2e-3, 0.2
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=half.tolist(), physicsClientId=client)
    box = p.createMultiBody(0, shape, -1, (-0.1, 0, 0), physicsClientId=client)
    world.add_obstacle(box, friction=0.5)
    material = bt.Material(stiffness=2e3, damping=1, friction=0.4)
    cords = [
        world.add_tendon([(0, y, 0.15), (0, y, -0.15)], radius, material, 40) for y in (-0.02, 0, 0.01, 0.02)
    ]
    for cord in cords:
        cord.grip(0), cord.set_point_mass(-1, 0.02)
    over = 0
    for x in np.arange(-0.1, 0.1, speed / 240):
        p.resetBasePositionAndOrientation(box, (x, 0, 0), (0, 0, 0, 1), client)
        world.step()
        over += world.report.over_budget
        inside = half - np.abs(np.concatenate([cord.positions for cord in cords]) - [x, 0, 0])
        assert inside.min(axis=1).max() < 0
    assert over > 0
