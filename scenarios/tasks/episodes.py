"""Episodes: runs of a policy in a task, alone or spread over processes by bullet_tendon.sweep."""

from time import process_time
from typing import NamedTuple

import gymnasium
import numpy as np

from bullet_tendon import sweep

from .policies import Learned, make_policy

_ENVIRONMENTS: dict[str, gymnasium.Env] = {}  # of this process, by task: scenes are built once


class Episode(NamedTuple):
    """What came of an episode: sum of rewards, whether it succeeded, number of steps, processor time [s]."""

    reward: float
    success: bool
    steps: int
    seconds: float


def run_episode(env: gymnasium.Env, policy, seed: int, watch=None) -> Episode:
    """One episode of the policy, from reset(seed=seed).

    watch(env, reward): called after the reset and after each step, with the sum of the rewards so far.
    """
    start = process_time()
    observation, info = env.reset(seed=seed)
    total, steps, ended = 0.0, 0, False
    if watch is not None:
        watch(env, total)
    while not ended:
        observation, reward, terminated, truncated, info = env.step(policy(observation))
        total, steps = total + reward, steps + 1
        ended = terminated or truncated
        if watch is not None:
            watch(env, total)
    return Episode(total, info["is_success"], steps, process_time() - start)


def evaluate(task: str, policy: str, seeds, executor=None, progress: bool = True) -> list[Episode]:
    """An episode for each seed by a policy's name (see policies.make_policy), on any executor of sweep."""
    cases = [{"task": task, "policy": policy, "seed": int(seed)} for seed in seeds]
    return [Episode(*row) for row in sweep(_by_name, cases, executor=executor, progress=progress)]


def evaluate_parameters(task: str, candidates, seeds, executor=None) -> list[list[Episode]]:
    """Episodes of learned policies with the parameters given: for each of them one for each seed."""
    cases = [
        {"task": task, "parameters": list(map(float, candidate)), "seed": int(seed)}
        for candidate in candidates
        for seed in seeds
    ]
    rows = [Episode(*row) for row in sweep(_by_parameters, cases, executor=executor, progress=False)]
    return [rows[at : at + len(seeds)] for at in range(0, len(rows), len(seeds))]


def environment(task: str) -> gymnasium.Env:
    """This process's environment of a task; it is made once."""
    if task not in _ENVIRONMENTS:
        _ENVIRONMENTS[task] = gymnasium.make(f"{__package__}:bullet_tendon/{task}-v0")
    return _ENVIRONMENTS[task]


def close_environments() -> None:
    """Close this process's environments."""
    while _ENVIRONMENTS:
        _ENVIRONMENTS.popitem()[1].close()


def _by_name(case: dict, rng: np.random.Generator) -> Episode:
    policy = make_policy(case["policy"], case["task"], np.random.default_rng(case["seed"]))
    return run_episode(environment(case["task"]), policy, case["seed"])


def _by_parameters(case: dict, rng: np.random.Generator) -> Episode:
    return run_episode(environment(case["task"]), Learned(case["task"], case["parameters"]), case["seed"])
