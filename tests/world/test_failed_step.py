"""A step without a finite solution is refused, and the world goes on from where it was."""

import numpy as np
import pybullet as p
import pytest

import bullet_tendon as bt


def swinging(world):
    t = world.add_tendon([[0, 0, 0], [0.3, 0, 0]], 0.004, bt.Material(stiffness=3e4, damping=1.0), 20)
    t.grip(0)
    return t


@pytest.mark.parametrize("integrator", ["implicit_euler", "bdf2", "explicit_euler"])
def test_state_is_kept_and_the_run_goes_on(make_world, integrator):
    dt = 1 / 240 if integrator != "explicit_euler" else 1e-6
    world = make_world(dt, (0, 0, -9.81), integrator=integrator)
    t = swinging(world)
    world.step(30)
    x, v, tension = t.positions, t.velocities, t.tension
    t.set_force(-1, (1e308, 0, 1e308))
    with pytest.raises(bt.StepFailed, match="residual"):
        world.step(5)
    np.testing.assert_array_equal(t.positions, x)
    np.testing.assert_array_equal(t.velocities, v)
    np.testing.assert_array_equal(t.tension, tension)
    t.set_force(-1, (0, 0, 0))
    world.step(30)
    assert world.report.converged
    assert np.isfinite(t.positions).all()
    assert t.length == pytest.approx(0.3, rel=1e-2)


def test_goes_on_as_if_nothing_had_failed(make_world):
    """One of two equal tendons has a failed step in between; both swing on alike."""
    tips = []
    for fails in (False, True):
        world = make_world(1 / 240, (0, 0, -9.81))
        t = swinging(world)
        world.step(30)
        if fails:
            t.set_force(-1, (1e308, 0, 1e308))
            with pytest.raises(bt.StepFailed):
                world.step()
            t.set_force(-1, (0, 0, 0))
        world.step(60)
        tips.append(t.positions[-1])
    np.testing.assert_allclose(tips[0], tips[1], atol=1e-7)


def test_a_mend_without_solution_leaves_the_step_as_it_was_taken(make_world, client, monkeypatch):
    """A body is let go under load; solving the step again with it free fails."""
    world = make_world(1 / 240)
    body = p.createMultiBody(0.2, physicsClientId=client)
    origin = [0, 0, 0]
    pin = p.createConstraint(body, -1, -1, -1, p.JOINT_FIXED, origin, origin, origin, physicsClientId=client)
    t = world.add_tendon([[0, 0, 0], [0, 0, -0.1]], 0.001, bt.Material(stiffness=1e4, damping=1.0), 10)
    t.attach(0, body)
    t.grip(-1, (0, 0, -0.1005))
    world.step(60)
    x, v = t.positions, t.velocities
    world.apply()
    p.removeConstraint(pin, client)
    p.stepSimulation(client)
    assert world._core.any_held()
    tries, solve = [], world._stepper._solve

    def fails_at_first(*step):
        tries.append(step)
        return len(tries) > 1 and solve(*step)

    monkeypatch.setattr(world._stepper, "_solve", fails_at_first)
    taken = t.positions, t.velocities
    world._stepper._sense(1 / 240, (0.0, 0.0, 0.0))
    assert len(tries) == 1
    np.testing.assert_array_equal([t.positions, t.velocities], taken)
    np.testing.assert_allclose([t.positions, t.velocities], [x, v], atol=1e-6)
    assert not world._core.any_held()
    world.step(60)
    assert len(tries) == 1 and world.report.converged
    assert np.isfinite(t.positions).all()
