"""TendonFinger: its geometry against pybullet's, its statics, its two modes, and what the expert achieves."""

import numpy as np
import pybullet as p
import pytest

gymnasium = pytest.importorskip("gymnasium")

from bullet_tendon.scenarios.tasks import tendon_finger  # noqa: E402
from task_runs import run  # noqa: E402

from bullet_tendon.errors import InvalidType, InvalidValue  # noqa: E402


@pytest.fixture(scope="module")
def task():
    env = tendon_finger.TendonFinger()
    yield env
    env.close()


def hinge_of(task, link):
    """Where pybullet has the hinge of a link, and the direction of the link."""
    place, turn = p.getLinkState(task.finger, link, 1, 1, task.client)[4:6]
    return np.array(place), np.array(p.getMatrixFromQuaternion(turn)).reshape(3, 3)[:, 0]


def still(_):
    return np.zeros(2)


def test_tip_is_where_pybullet_has_it(task):
    task.reset(seed=1, options={"mode": "reach"})
    for action in np.random.default_rng(0).uniform(-0.2, 1.0, (60, 2)):
        seen = task.step(action)[0]
    hinge, along = hinge_of(task, 2)
    assert np.allclose(seen["achieved_goal"], (hinge + 0.04 * along) / 0.1, atol=1e-6)
    assert seen["achieved_goal"][0] < 1.2


@pytest.mark.parametrize("mode", ["reach", "hold"])
def test_expert_succeeds_from_the_observation_alone(task, mode):
    for seed in range(4):
        seen, info, *_ = run(task, tendon_finger.expert, 500 + seed, mode=mode)
        assert info["is_success"]
        assert np.linalg.norm(seen["achieved_goal"] - seen["desired_goal"]) < 0.03


@pytest.mark.parametrize("mode", ["reach", "hold"])
def test_random_actions_do_not_succeed(task, mode):
    rng = np.random.default_rng(4)
    assert not any(
        run(task, lambda _: rng.uniform(-1, 1, 2), seed, mode=mode)[1]["is_success"] for seed in range(4)
    )


def test_sphere_falls_without_the_finger(task):
    seen, info, rewards, _ = run(task, still, 3, mode="hold")
    assert not info["is_success"]
    assert seen["achieved_goal"][1] < -1
    assert rewards[0] == pytest.approx(0, abs=1e-3) and rewards[-1] == -1.5


def test_sphere_is_held_by_the_finger_alone(task):
    run(task, tendon_finger.expert, 8, mode="hold")
    touching = {c[2] for c in p.getContactPoints(task.ball, physicsClientId=task.client)}
    assert touching == {task.finger}
    links = {c[4] for c in p.getContactPoints(task.ball, task.finger, physicsClientId=task.client)}
    assert -1 in links and len(links) > 1


@pytest.mark.parametrize("mode", ["reach", "hold"])
def test_an_episode_does_not_depend_on_those_before_it(task, mode):
    def trace():
        seen = [task.reset(seed=5, options={"mode": mode})[0]]
        for _ in range(150):
            seen.append(task.step(tendon_finger.expert(seen[-1]))[0])
        return [np.concatenate(list(each.values())).tobytes() for each in seen], task.world.state_hash()

    first = trace()
    run(task, tendon_finger.expert, 6, mode="hold")
    run(task, tendon_finger.expert, 7, mode="reach")
    assert trace() == first


def test_reward_is_that_of_the_goals_alone(task):
    seen, _ = task.reset(seed=2, options={"mode": "reach"})
    achieved, desired, rewards = [], [], []
    for _ in range(60):
        seen, reward, _, _, info = task.step(tendon_finger.expert(seen))
        assert reward == task.compute_reward(seen["achieved_goal"], seen["desired_goal"], info)
        assert reward == sum(value for name, value in info.items() if name.startswith("reward_"))
        achieved.append(seen["achieved_goal"])
        desired.append(seen["desired_goal"])
        rewards.append(reward)
    together = task.compute_reward(np.array(achieved), np.array(desired), [{}] * 60)
    assert together.shape == (60,) and np.allclose(together, rewards, rtol=0, atol=1e-6)
    assert task.compute_reward(desired[0], desired[0], {}) == 0


def test_flexors_and_straps_balance_each_hinge(task):
    """At rest. A flexor's torque is tension times distance from the hinge, a strap's is by virtual work."""
    task.reset(seed=0, options={"mode": "reach"})
    for action in [(0.7, 0.25)] * 60 + [(0, 0)] * 200:
        task.step(action)
    angles, rates = np.array(task.angles), np.array(task.rates)
    assert (angles > 0.2).all() and (np.abs(rates) < 1e-3).all()
    for link, angle in enumerate(angles):
        hinge, _ = hinge_of(task, link)
        closes = sum(
            _torque(flexor, hinge) for flexor in list(task.flexors.values())[: 2 if link == 0 else 1]
        )
        strap = task.world.tendons[2 + link]
        opens = 1e3 * (_strap(angle + 5e-4) - _strap(angle - 5e-4)) * strap.tension[0]
        assert closes == pytest.approx(opens, rel=0.01)


def _torque(flexor, hinge):
    """Tension times distance of the segment that passes a hinge [N m]."""
    x = flexor.positions
    passing = np.argmin(np.linalg.norm(0.5 * (x[1:] + x[:-1]) - hinge, axis=1))
    along = (x[passing + 1] - x[passing]) / np.linalg.norm(x[passing + 1] - x[passing])
    return abs(np.cross(x[passing] - hinge, along)[1]) * flexor.tension[passing]


def _strap(angle):
    """Distance of a strap's ends, 3 mm before and behind the hinge and 12 mm above it [m]."""
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    return np.linalg.norm(turn @ [0.003, 0.012] - [-0.003, 0.012])


def test_motors_stall(task):
    run(task, lambda _: np.ones(2), 0, mode="hold", place=(0, 0))
    tension = max(flexor.tension.max() for flexor in task.flexors.values())
    assert 4 < tension < 8.5
    assert all(motor.force[0] <= 8 * (1 + 1e-6) for motor in task.motors.values())


def test_options_fix_what_is_random(task):
    seen, _ = task.reset(seed=1, options={"goal": (0.045, -0.106)})
    assert np.allclose(seen["desired_goal"], (0.45, 0, -1.06))
    assert seen["observation"][10:12].tolist() == [1, 0]
    seen, _ = task.reset(seed=1, options={"place": (1, -1), "mass": 0.025})
    assert np.allclose(seen["achieved_goal"], (0.17, 0, -0.445), atol=1e-6)
    assert p.getDynamicsInfo(task.ball, -1, task.client)[0] == 0.025


@pytest.mark.parametrize(
    ("options", "error"),
    [
        ({"mode": "grasp"}, InvalidValue),
        ({"goal": (0.2, 0.0)}, InvalidValue),
        ({"goal": (0.129, 0.0)}, InvalidValue),
        ({"goal": (np.nan, 0.0)}, InvalidValue),
        ({"goal": "there"}, InvalidType),
        ({"mode": "hold", "goal": (0.045, -0.106)}, InvalidValue),
        ({"mode": "reach", "mass": 0.03}, InvalidValue),
        ({"mass": 1.0}, InvalidValue),
        ({"colour": 1}, InvalidValue),
    ],
)
def test_refused_options(task, options, error):
    with pytest.raises(error, match=list(options)[-1]):
        task.reset(seed=0, options=options)
    assert task.observation_space.contains(task.reset(seed=0)[0])


@pytest.mark.parametrize("seed", [7011, 7064])
def test_a_flexor_that_mouths_squeeze_does_not_sink_into_their_edges(task, seed):
    """The last hinge is at its limit, and the long flexor slides through two mouths beside it."""
    depths = []

    def expert(observation):
        contacts = task.world.contacts
        pressed = contacts["distance"][contacts["normal_force"] > 0]
        depths.append(-pressed.min(initial=0.0))
        return tendon_finger.expert(observation)

    assert run(task, expert, seed, mode="hold")[1]["is_success"]
    assert max(depths) < 1.1e-3


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["reach", "hold"])
def test_expert_over_a_hundred_seeds(task, mode):
    made = [run(task, tendon_finger.expert, 7000 + seed, mode=mode)[1]["is_success"] for seed in range(100)]
    assert sum(made) >= 97
