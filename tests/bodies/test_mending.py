"""A pull at a body that nobody told of: the step in which it came is taken back, and solved with it."""

import numpy as np
import pybullet as p
import pytest
from link_scenes import free_ball

import bullet_tendon as bt

LENGTH, LEVER = 0.2, 0.03  # m


def hung(client, world, mass, stiffness):
    """A ball between three tendons, whose far ends are held; and these tendons."""
    body, tendons = free_ball(client, mass), []
    for angle in np.radians([0, 120, 240]):
        along = np.array([np.cos(angle), np.sin(angle), 0.3])
        material = bt.Material(stiffness=stiffness, density=100.0)
        t = world.add_tendon([(LEVER + LENGTH) * along, 0 * along], 1e-3, material, 8)
        t.grip(0)
        t.attach(-1, body)
        tendons.append(t)
    return body, tendons


def pull(client, body, force):
    place = p.getBasePositionAndOrientation(body, client)[0]
    p.applyExternalForce(body, -1, force, place, p.WORLD_FRAME, client)
    return np.array(place)


@pytest.mark.parametrize("mass", [1e-3, 0.1])
def test_pulls_through_the_centre_do_not_turn_a_body(make_world, client, mass):
    """Also in steps that are cut, in which the body moves before the last forces act."""
    world, cut = make_world(1 / 1000), 0
    body, _ = hung(client, world, mass, 1e3)
    world.step(3)
    for _ in range(20):
        pull(client, body, [30.0, -20.0, -400.0])
        world.step()
        cut += world.report.counts["substeps"] > 1
        np.testing.assert_allclose(p.getBaseVelocity(body, client)[1], 0, rtol=0, atol=1e-6)
    assert cut >= 5


@pytest.mark.parametrize("dt", [1 / 1000, 1 / 240, 1 / 60])
@pytest.mark.parametrize("mass", [1e-3, 0.1, 10.0])
@pytest.mark.parametrize("stiffness", [1e3, 1e6])
def test_a_sudden_pull_gives_no_more_than_its_work(make_world, client, dt, mass, stiffness):
    world, force = make_world(dt), np.array([30.0, -20.0, -400.0])
    body, tendons = hung(client, world, mass, stiffness)
    world.step(3)
    work = most = gained = 0.0
    for _ in range(40):
        before = pull(client, body, force)
        world.step()
        assert world.report.converged
        work += force @ (np.array(p.getBasePositionAndOrientation(body, client)[0]) - before)
        most = max(most, abs(work))
        moving = 0.5 * mass * np.square(p.getBaseVelocity(body, client)[0]).sum()
        gained = max(gained, moving + sum(t.energy for t in tendons) - work)
    assert gained <= 1e-2 * most


def test_a_blow_by_hand_is_not_taken_for_a_pull(make_world, client):
    """A velocity that is set, and a place that is, are the user's: both stay."""
    world = make_world(1 / 240)
    body, _ = hung(client, world, 1.0, 1e3)
    world.step(3)
    p.resetBasePositionAndOrientation(body, [0, 0, -0.005], [0, 0, 0, 1], physicsClientId=client)
    world.apply()
    assert p.getBasePositionAndOrientation(body, client)[0] == (0, 0, -0.005)
    p.stepSimulation(client)
    p.resetBaseVelocity(body, [0, 0, 3.0], physicsClientId=client)
    world.apply()
    assert p.getBaseVelocity(body, client)[0] == (0, 0, 3.0)


def test_a_pull_after_a_restore_has_the_same_bits(make_world, client):
    """What a step is taken back to is part of a saved state."""
    world = make_world(1 / 240)
    body, _ = hung(client, world, 0.01, 1e5)
    world.step(3)
    pull(client, body, [0, 0, -500.0])
    world.step()
    state, bullet = world.save_state(), p.saveState(client)
    hashes = []
    for _ in range(2):
        world.restore_state(state)
        p.restoreState(bullet, physicsClientId=client)
        world.step(10)
        hashes.append(world.state_hash())
    assert hashes[0] == hashes[1]


def test_a_step_that_fails_after_a_mend_can_be_taken_again(make_world, client):
    """The mend stays: bodies and tendons go on from it as if the failed step had not been tried."""

    def run(fails):
        number = p.connect(p.DIRECT)
        p.setTimeStep(1 / 240, number)
        world = bt.TendonWorld(number)
        body, tendons = hung(number, world, 0.01, 1e5)
        world.step(3)
        pull(number, body, [0, 0, -500.0])
        world.step()
        if fails:
            tendons[0].set_force(3, [1e300, 0, 0])
            with pytest.raises(bt.StepFailed):
                world.apply()
            tendons[0].set_force(3, [0, 0, 0])
        world.step(10)
        place = p.getBasePositionAndOrientation(body, number)
        p.disconnect(number)
        return np.concatenate(place), np.concatenate([t.positions for t in tendons])

    for tried, straight in zip(run(True), run(False), strict=True):
        assert np.abs(tried - straight).max() < 1e-6
