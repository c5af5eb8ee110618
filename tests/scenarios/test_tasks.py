"""What every task does: gymnasium's checks, repeatable to the bit, alone and in vectors of environments."""

import concurrent.futures
import hashlib
import json
import multiprocessing
import pickle
import subprocess
import sys
import warnings

import numpy as np
import pybullet as p
import pytest

import bullet_tendon as bt

gymnasium = pytest.importorskip("gymnasium", reason="gymnasium (extra gym) is not installed")
pytest.importorskip("gymnasium.vector", reason="gymnasium >= 1.1 is not installed")

from bullet_tendon.scenarios import tasks  # noqa: E402
from bullet_tendon.scenarios.tasks import __main__ as command_line  # noqa: E402
from bullet_tendon.scenarios.tasks import episodes, graft_passage, policies, pulley_lift, task  # noqa: E402
from bullet_tendon.scenarios.tasks.share import RemoteShare  # noqa: E402
from gymnasium.utils.env_checker import check_env  # noqa: E402

NAMES = tuple(tasks.TASKS)
STEPS = 12


def make(name, **arguments):
    return gymnasium.make(f"bullet_tendon.scenarios.tasks:bullet_tendon/{name}-v0", **arguments)


def make_vector(name, count, **arguments):
    where = f"bullet_tendon.scenarios.tasks:bullet_tendon/{name}-v0"
    return gymnasium.make_vec(where, count, vectorization_mode="vector_entry_point", **arguments)


def flat(observation) -> np.ndarray:
    """All numbers of an observation."""
    if isinstance(observation, dict):
        return np.concatenate([np.ravel(observation[key]) for key in sorted(observation)])
    return np.ravel(observation)


def trajectory(name, seed, steps=STEPS) -> str:
    """A hash of observations and rewards of an episode with random actions, in an environment of its own."""
    with make(name) as env:
        return run(env, seed, steps)


def run(env, seed, steps=STEPS) -> str:
    digest = hashlib.sha256()
    observation, _ = env.reset(seed=seed)
    digest.update(flat(observation).tobytes())
    rng = np.random.default_rng(seed)
    for _ in range(steps):
        action = rng.uniform(-1, 1, env.action_space.shape).astype(np.float32)
        observation, reward, terminated, truncated, _ = env.step(action)
        digest.update(flat(observation).tobytes() + np.float64(reward).tobytes())
        if terminated or truncated:
            break
    return digest.hexdigest()


@pytest.fixture(scope="module", autouse=True)
def no_environment_stays():
    yield
    episodes.close_environments()


@pytest.fixture(params=NAMES)
def env(request):
    with make(request.param) as made:
        yield made


@pytest.mark.parametrize("name", NAMES)
def test_gymnasium_has_nothing_to_say(name):
    with make(name, render_mode="rgb_array") as env, warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env.unwrapped)


def test_episodes_depend_on_the_seed_alone(env):
    first = run(env, seed=3)
    other = run(env, seed=4, steps=5)
    assert run(env, seed=3) == first
    assert other != first


@pytest.mark.parametrize("name", NAMES)
def test_episodes_are_the_same_in_other_processes(name):
    context = multiprocessing.get_context("spawn")
    with concurrent.futures.ProcessPoolExecutor(1, mp_context=context) as pool:
        elsewhere = pool.submit(trajectory, name, 5)
        assert elsewhere.result() == trajectory(name, 5)


@pytest.mark.parametrize("name", NAMES)
def test_vectors_do_what_single_environments_do(name):
    count, seed = 3, 11
    with make(name) as env:
        single = [env.reset(seed=seed + i)[0] for i in range(count)]
    for divided in ({"threads": 1}, {"threads": 3}, {"processes": 2}):
        vector = make_vector(name, count, **divided)
        observations, _ = vector.reset(seed=seed)
        actions = np.random.default_rng(0).uniform(-1, 1, (STEPS, *vector.action_space.shape))
        rows = [
            vector.step(action.astype(np.float32))[:2] for action in actions[: 4 if name != "KnotTie" else 2]
        ]
        vector.close()
        for i in range(count):
            mine = {k: v[i] for k, v in observations.items()} if isinstance(observations, dict) else None
            assert np.array_equal(flat(single[i]), flat(mine if mine else observations[i]))
        if divided == {"threads": 1}:
            expected = rows
        for (one, reward), (other, same) in zip(rows, expected, strict=True):
            assert np.array_equal(flat(one), flat(other)) and np.array_equal(reward, same)


def test_vectors_begin_the_next_episode_in_the_same_step():
    vector = make_vector("PulleyLift", 2, max_episode_steps=3, threads=1)
    vector.reset(seed=0)
    still = np.zeros((2, 2), np.float32)
    for _ in range(2):
        *_, truncated, _ = vector.step(still)
        assert not truncated.any()
    observation, _, terminated, truncated, infos = vector.step(still)
    vector.close()
    assert truncated.all() and not terminated.any()
    assert vector.metadata["autoreset_mode"] == gymnasium.vector.AutoresetMode.SAME_STEP
    assert infos["_final_obs"].all() and infos["_final_info"].all()
    ended = np.stack(infos["final_obs"])
    assert ended.shape == observation.shape and not np.array_equal(ended, observation)
    assert not infos["final_info"]["is_success"].any()


def test_vectors_gather_what_only_some_tasks_tell():
    vector = make_vector("PulleyLift", 3, max_episode_steps=4, processes=2)
    vector.reset(seed=0)
    still = np.zeros((3, 2), np.float32)
    vector.step(still)
    vector.unwrapped.envs[0].reset(seed=0)  # the first task is in this process
    vector.unwrapped._own._lengths[0] = 0
    for _ in range(3):
        *_, truncated, infos = vector.step(still)
    vector.close()
    assert truncated.tolist() == [False, True, True]
    assert infos["_final_info"].tolist() == infos["_final_obs"].tolist() == [False, True, True]
    assert infos["final_obs"][0] is None and infos["final_obs"][1].shape == infos["final_obs"][2].shape
    assert infos["_is_success"].all() and infos["final_info"]["_is_success"].tolist() == [False, True, True]


def test_vectors_refuse_what_does_not_fit():
    with pytest.raises(bt.InvalidValue, match="num_envs"):
        make_vector("PulleyLift", 0)
    with pytest.raises(bt.InvalidValue, match="processes"):
        make_vector("PulleyLift", 2, processes=0)
    vector = make_vector("PulleyLift", 2)
    with pytest.raises(bt.InvalidValue, match="seed"):
        vector.reset(seed=[1])
    vector.reset(seed=0)
    with pytest.raises(bt.InvalidValue, match="actions"):
        vector.step(np.zeros((3, 2), np.float32))
    vector.close()


def test_vectors_raise_what_a_task_in_another_process_raises():
    vector = make_vector("PulleyLift", 3, processes=2)
    expected = vector.reset(seed=5)[0]
    with pytest.raises(bt.InvalidValue, match="nothing"):
        vector.reset(seed=5, options={"nothing": 1})
    for index in (0, 2):  # of a task in this process, and of one in the other
        wrong = np.zeros((3, 2), np.float32)
        wrong[index] = np.nan
        with pytest.raises(bt.InvalidValue, match="action"):
            vector.step(wrong)
        assert np.array_equal(vector.reset(seed=5)[0], expected)
    vector.close()
    with pytest.raises(TypeError, match="nothing"):
        make_vector("PulleyLift", 2, processes=2, nothing=1)


def test_vectors_drop_what_an_interrupted_step_found(monkeypatch):
    vector = make_vector("PulleyLift", 2, processes=2, context="spawn").unwrapped
    expected = vector.reset(seed=5)[0]

    def interrupted(share):
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(RemoteShare, "result", interrupted)
        with pytest.raises(KeyboardInterrupt):
            vector.step(np.zeros((2, 2), np.float32))
    assert np.array_equal(vector.reset(seed=5)[0], expected)
    vector.close()


def test_vectors_tell_that_a_process_was_ended():
    vector = make_vector("PulleyLift", 2, processes=2)
    vector.reset(seed=0)
    child = multiprocessing.active_children()[0]
    child.terminate()
    child.join()
    for _ in range(2):
        with pytest.raises(bt.UnknownId, match="exit code -15"):
            vector.step(np.zeros((2, 2), np.float32))
    vector.close()
    assert not multiprocessing.active_children()


def test_processes_of_gymnasium_work_too():
    where = "bullet_tendon.scenarios.tasks:bullet_tendon/PulleyLift-v0"
    vector = gymnasium.make_vec(where, 2, vectorization_mode="async", vector_kwargs={"context": "spawn"})
    observations, _ = vector.reset(seed=7)
    rewards = vector.step(np.zeros((2, 2), np.float32))[1]
    vector.close()
    with make("PulleyLift") as env:
        assert np.array_equal(observations[1], env.reset(seed=8)[0])
        assert rewards[1] == env.step(np.zeros(2, np.float32))[1]


def test_a_specification_can_be_pickled(env):
    again = pickle.loads(pickle.dumps(env.spec))
    with again.make() as made:
        assert np.array_equal(flat(made.reset(seed=1)[0]), flat(env.reset(seed=1)[0]))


def test_after_an_exception_reset_leads_back(env, monkeypatch):
    expected = run(env, seed=6)
    env.reset(seed=2)
    inner, calls = env.unwrapped, []

    def fail():
        calls.append(None)
        if len(calls) == 2:
            body = p.getBodyUniqueId(0, inner.client)
            for link in range(-1, p.getNumJoints(body, inner.client)):
                p.applyExternalForce(body, link, (5, 5, 5), (0, 0, 0), p.LINK_FRAME, inner.client)
            raise RuntimeError("within a step")

    with monkeypatch.context() as patch:
        patch.setattr(inner, "drive", fail)
        with pytest.raises(RuntimeError, match="within a step"):
            for _ in range(2):
                env.step(env.action_space.sample())
    assert run(env, seed=6) == expected


def test_rewards_are_the_sums_of_their_terms(env):
    env.reset(seed=1)
    for _ in range(3):
        _, reward, terminated, truncated, info = env.step(env.action_space.sample())
        terms = [value for name, value in info.items() if name.startswith("reward_")]
        assert terms and reward == pytest.approx(sum(terms), abs=1e-12)
        if terminated or truncated:
            break


def test_bad_actions_and_options_are_refused_before_anything_moves(env):
    env.reset(seed=1)
    inner = env.unwrapped
    before = inner.world.state_hash()
    size = inner.action_space.shape[0]
    for bad in (np.full(size, np.nan), np.zeros(size + 1), "left"):
        with pytest.raises(bt.TendonError, match="action"):
            inner.step(bad)
    for unknown in ({"colour": 3}, {"colour": 3, 1: 2}):
        with pytest.raises(bt.InvalidValue, match="options"):
            inner.reset(seed=1, options=unknown)
    with pytest.raises(bt.InvalidType, match="options"):
        inner.reset(seed=1, options=[1])
    assert inner.world.state_hash() == before


def test_a_closed_environment_says_so():
    env = make("PulleyLift").unwrapped
    env.close()
    env.close()
    with pytest.raises(bt.UnknownId, match="closed"):
        env.reset()
    with pytest.raises(bt.InvalidValue, match="render_mode"):
        pulley_lift.PulleyLift(render_mode="radar")


@pytest.mark.parametrize("name", NAMES)
def test_images_show_the_scene(name):
    with make(name, render_mode="rgb_array") as env:
        env.reset(seed=0)
        before = env.unwrapped.world.state_hash()
        image = env.render()
        assert image.shape == (task.IMAGE, task.IMAGE, 3) and image.dtype == np.uint8
        assert len(np.unique(image.reshape(-1, 3), axis=0)) > 20
        assert env.unwrapped.world.state_hash() == before


@pytest.mark.parametrize("name", ("GraftPassage", "PulleyLift"))
def test_experts_succeed_and_random_actions_do_not(name):
    experts = episodes.evaluate(name, "expert", range(500, 503), progress=False)
    assert all(episode.success for episode in experts)
    [chance] = episodes.evaluate(name, "random", [500], progress=False)
    assert not chance.success
    assert chance.reward < min(episode.reward for episode in experts)


def test_the_graft_is_in_both_tunnels_at_the_end():
    env = make("GraftPassage")
    with env:
        inner = env.unwrapped
        observation, _ = env.reset(seed=12, options={"flexion": 1.0, "graft": 2})
        ended = False
        while not ended:
            observation, _, terminated, truncated, info = env.step(graft_passage.expert(observation))
            ended = terminated or truncated
        assert info["is_success"]
        for tunnel in inner.tunnels:
            start, end = tunnel.ends
            length = np.linalg.norm(end - start)
            away = inner.graft.positions - start
            along = away @ (end - start) / length
            within = away[(along > 0.004) & (along < length - 0.004)]
            axis = (end - start) / length
            off = np.linalg.norm(within - np.outer(within @ axis, axis), axis=1)
            assert len(within) > 5 and (off < tunnel.radius - inner.graft.radius + 2e-4).any()


@pytest.mark.parametrize("mass", (0.5, 3.0))
def test_the_hand_carries_the_weight(mass):
    with make("PulleyLift") as env:
        env.reset(seed=1, options={"mass": mass, "goal": (0.1, 0.3)})
        for _ in range(30):
            env.step(np.zeros(2, np.float32))
        # On a wheel of 40 mm, a rope of 12 mm segments is a polygon: its two arms differ by up to 1 %.
        force = np.linalg.norm(env.unwrapped.hand.force)
        assert force == pytest.approx(mass * 9.81, rel=0.015)


@pytest.mark.parametrize("name", ("GraftPassage", "PulleyLift"))
def test_policies_act_within_bounds(name):
    module = policies.module_of(name)
    rng = np.random.default_rng(1)
    with make(name) as env:
        observation, _ = env.reset(seed=0)
        basis = module.basis(observation)
        assert basis.shape[1:] == env.action_space.shape
        learned = policies.Learned(name, rng.normal(size=len(basis)))
        for policy in (learned, module.expert, policies.make_policy("random", name, rng)):
            assert env.action_space.contains(np.asarray(policy(observation), np.float32))
    with pytest.raises(bt.InvalidValue, match="task"):
        policies.module_of("Juggling")


def test_the_command_line_reports_and_draws(tmp_path, capsys):
    pytest.importorskip("matplotlib", reason="matplotlib (extra view) is not installed")
    picture, record = tmp_path / "lift.png", tmp_path / "lift.json"
    arguments = ["PulleyLift", "--episodes", "2", "--json", str(record), "--picture", str(picture)]
    assert command_line.main(arguments) == 0
    assert "100 % successes" in capsys.readouterr().out
    assert [episode["success"] for episode in json.loads(record.read_text())["episodes"]] == [True, True]
    assert picture.stat().st_size > 10_000
    assert command_line.main([]) == 0
    assert all(name in capsys.readouterr().out for name in ("PulleyLift",))
    with pytest.raises(SystemExit) as problem:
        command_line.main(["Juggling"])
    assert problem.value.code == 2


def test_without_gymnasium_the_message_names_the_extra():
    code = (
        "import sys; sys.modules['gymnasium'] = None\n"
        "import bullet_tendon as bt\n"
        "try:\n    import bullet_tendon.scenarios.tasks\n"
        "except bt.MissingExtra as problem:\n    print(problem)"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "bullet_tendon[gym]" in result.stdout


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_a_thousand_steps_are_the_same_again(name):
    def hashes(env):
        return [run(env, seed, 1000) for seed in range(8)]

    with make(name) as env:
        first = hashes(env)
    with make(name) as env:
        env.reset(seed=99)
        assert hashes(env) == first


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_vectors_step_as_single_environments_do_through_ends_of_episodes(name):
    def part(observation, i):
        is_dict = isinstance(observation, dict)
        return flat({k: v[i] for k, v in observation.items()} if is_dict else observation[i])

    count, steps = 2, 60 if name == "KnotTie" else 1000
    vector, singles = make_vector(name, count, processes=2), [make(name) for _ in range(count)]
    observations, _ = vector.reset(seed=3)
    for i, single in enumerate(singles):
        assert np.array_equal(part(observations, i), flat(single.reset(seed=3 + i)[0]))
    rng, ends = np.random.default_rng(0), 0
    for _ in range(steps):
        actions = rng.uniform(-1, 1, vector.action_space.shape).astype(np.float32)
        observations, rewards, terminated, truncated, _ = vector.step(actions)
        for i, single in enumerate(singles):
            alone, reward, *ended, _ = single.step(actions[i])
            assert (reward, *ended) == (rewards[i], terminated[i], truncated[i])
            if any(ended):
                alone, ends = single.reset()[0], ends + 1
            assert np.array_equal(part(observations, i), flat(alone))
    assert ends > 2
    for env in (vector, *singles):
        env.close()


@pytest.mark.slow
def test_the_search_finds_a_policy_that_lifts():
    pytest.importorskip("cma", reason="cma (extra learn) is not installed")
    from bullet_tendon.scenarios.tasks.search import search

    found = search("PulleyLift", minutes=3, processes=2, seed=3)
    assert found["curve"][:, 4].max() > 0.8
    rows = episodes.evaluate_parameters("PulleyLift", [found["parameters"]], range(100, 110))[0]
    assert sum(episode.success for episode in rows) >= 8
