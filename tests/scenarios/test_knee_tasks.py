"""Tasks in which an ACL is reconstructed: beside virtual reconstructions, and their policies."""

import numpy as np
import pytest

import bullet_tendon as bt

gymnasium = pytest.importorskip("gymnasium", reason="gymnasium (extra gym) is not installed")

from bullet_tendon.scenarios.knee import KneeRig  # noqa: E402
from bullet_tendon.scenarios.reconstruction import (  # noqa: E402
    SLOPE,
    TIBIAL,
    drawer,
    on_bernards_grid,
    reconstruct,
)
from bullet_tendon.scenarios.tasks import (  # noqa: E402
    episodes,
    graft_tension,
    policies,
    tunnel_placement,
)
from bullet_tendon.scenarios.tasks.knee_task import LACHMAN  # noqa: E402

NAMES = "GraftTension", "TunnelPlacement"


def make(name):
    return gymnasium.make(f"bullet_tendon.scenarios.tasks:bullet_tendon/{name}-v0")


@pytest.fixture(scope="module", autouse=True)
def no_environment_stays():
    yield
    episodes.close_environments()


@pytest.fixture(scope="module")
def tension():
    with make("GraftTension") as env:
        yield env.unwrapped


@pytest.fixture(scope="module")
def placement():
    with make("TunnelPlacement") as env:
        yield env.unwrapped


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("policy", ["expert", "learned"])
def test_policies_succeed_where_random_actions_do_not(name, policy):
    seeds = range(400, 406)
    good = episodes.evaluate(name, policy, seeds, progress=False)
    chance = episodes.evaluate(name, "random", seeds, progress=False)
    assert sum(episode.success for episode in good) >= 5
    assert sum(episode.success for episode in chance) <= 2
    assert np.mean([e.reward for e in chance]) < np.mean([e.reward for e in good]) - 3


def fixed(env, pull, degrees, **options):
    """The drawer of a knee [m] whose graft was fixed under a pull at a flexion."""
    env.reset(seed=0, options={"goal": 0.007, **options})
    env.episode.pull, env.episode.flexion = pull, np.radians(degrees)
    _, _, terminated, _, info = env.step(np.array([0.0, 0.0, 1.0], np.float32))
    assert terminated and env.episode.at_rest
    assert info["reward_drawer"] == pytest.approx(-1e3 * abs(env.episode.error))
    assert info["is_success"] == (abs(env.episode.error) <= graft_tension.NEAR)
    return env.episode.error + env.episode.goal


def test_the_drawer_is_that_of_a_virtual_reconstruction(tension):
    plan = {"deep": 0.3, "low": 0.3, "slope": 0.9}
    found = fixed(tension, 70.0, 10.0, **plan)
    with KneeRig() as rig:
        site = on_bernards_grid(plan["deep"], plan["low"])
        reconstruct(rig, site, tension=70.0, fixed_at=np.radians(10.0), slope=0.9 * SLOPE)
        assert found == pytest.approx(drawer(rig, LACHMAN), abs=2e-5)


def test_more_pull_and_more_flexion_make_the_knee_tighter(tension):
    plan = {"deep": 0.3, "low": 0.3, "slope": 0.9}
    drawers = [[fixed(tension, pull, degrees, **plan) for pull in (20, 60, 110)] for degrees in (0, 20)]
    assert (np.diff(drawers, axis=1) < 0).all() and (np.diff(drawers, axis=0) < 0).all()


def test_a_pull_draws_the_tibia_back(tension):
    observation, _ = tension.reset(seed=1)
    shifts = [observation[6]]
    for _ in range(3):
        observation, *_ = tension.step(np.array([1.0, 0.0, -1.0], np.float32))
        shifts.append(observation[6])
    assert (np.diff(shifts) < 0).all()
    assert tension.graft.force == pytest.approx(tension.episode.pull, rel=1e-6)


def test_the_change_of_length_is_that_of_a_line_in_the_flexed_intact_knee(placement):
    action = np.array([0.3, -0.4, 0.5, -0.2])
    placement.reset(seed=1)
    placement.step(action.astype(np.float32))
    deep, low = (0.35 + 0.15 * a for a in action[:2])
    mouth = on_bernards_grid(deep, low)[0]
    tibial = np.add(TIBIAL[0], (5e-3 * action[2], 0, 4e-3 * action[3]))
    with KneeRig() as rig:
        law = bt.Material(stiffness=1.0)
        line = rig.world.add_ligament([(*rig.femur, mouth), (*rig.tibia, tibial)], law)
        line.set_tension(0.0)
        lengths = []
        for angle in np.radians(range(0, 91, 15)):
            rig.flex(angle)
            assert rig.settle()
            lengths.append(line.length)
    assert placement.episode.change == pytest.approx(np.ptp(lengths), abs=2e-5)


def test_the_reward_knows_what_is_wanted_of_a_placement(placement):
    observation, _ = placement.reset(seed=2)
    best = placement.step(tunnel_placement.expert(observation).astype(np.float32))
    placement.reset(seed=2)
    worst = placement.step(np.array([1.0, 1.0, 1.0, 1.0], np.float32))
    assert best[2] and worst[2]  # one step is all
    assert best[1] > worst[1] + 4 and best[4]["is_success"] and not worst[4]["is_success"]
    assert worst[4]["reward_anisometry"] < -1


@pytest.mark.parametrize("name", NAMES)
def test_episodes_leave_nothing_behind(name):
    with make(name) as env:
        inner = env.unwrapped
        rng = np.random.default_rng(0)
        hashes, counts = set(), set()
        for seed in (5, 6, 5):
            inner.reset(seed=seed)
            inner._restore()
            hashes.add(inner.world.state_hash())
            counts.add(len(inner.world.ligaments))
            inner.reset(seed=seed)
            inner.step(rng.uniform(-1, 1, inner.action_size).astype(np.float32))
        assert len(hashes) == 1 and len(counts) == 1


@pytest.mark.parametrize("name", NAMES)
def test_policies_act_within_bounds(name):
    module = policies.module_of(name)
    with make(name) as env:
        observation, _ = env.reset(seed=0)
        basis = module.basis(observation)
        assert basis.shape[1:] == env.action_space.shape
        assert env.action_space.contains(module.expert(observation).astype(np.float32))


def test_options_fix_what_is_random_and_others_are_refused(tension, placement):
    tension.reset(seed=1, options={"goal": 0.0075, "slope": 1.0, "pull": 30.0})
    assert (tension.episode.goal, tension.episode.slope, tension.episode.pull) == (0.0075, 1.0, 30.0)
    placement.reset(seed=1, options={"tension": 50.0})
    assert placement.episode.tension == 50.0
    for env, options in (
        (tension, {"goal": 0.02}),
        (tension, {"colour": 1}),
        (placement, {"tension": -1.0}),
        (placement, {"slope": "soft"}),
    ):
        with pytest.raises(bt.TendonError):
            env.reset(seed=1, options=options)
