"""TaskVector: many tasks of one kind in one process, stepped by threads.

Each task has a pybullet client and a world of its own, and shares nothing with the others. Therefore
results do not depend on the number of threads. The core lets other threads run while it solves.
"""

import os
from concurrent.futures import ThreadPoolExecutor

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space, concatenate, create_empty_array

from bullet_tendon import checks
from bullet_tendon.errors import InvalidValue

from .task import Task


class TaskVector(gymnasium.vector.VectorEnv):
    """num_envs tasks, each with the seed that it would have by itself.

    max_episode_steps: after which an episode is truncated (None: never). threads: how many step tasks at
    the same time (None: one for each processor). Autoreset is SAME_STEP: where an episode ends, the
    observation is the first of the next one, and infos["final_obs"], infos["final_info"] are of the end.
    Further arguments go to each task. Raises InvalidType or InvalidValue.
    """

    task: type[Task] = Task

    def __init__(
        self,
        num_envs: int = 1,
        max_episode_steps: int | None = None,
        threads: int | None = None,
        render_mode: str | None = None,
        **arguments,
    ):
        self.num_envs = checks.integer("num_envs", num_envs, at_least=1)
        if max_episode_steps is not None:
            checks.integer("max_episode_steps", max_episode_steps, at_least=1)
        self._horizon = max_episode_steps
        if threads is None:
            threads = os.cpu_count() or 1
        workers = min(checks.integer("threads", threads, at_least=1), num_envs)
        self._pool = ThreadPoolExecutor(workers) if workers > 1 else None
        self.render_mode = render_mode
        self.metadata = {**self.task.metadata, "autoreset_mode": AutoresetMode.SAME_STEP}
        self.envs = list(self._map(lambda _: self.task(render_mode, **arguments), range(num_envs)))
        first = self.envs[0]
        self.single_observation_space = first.observation_space
        self.single_action_space = first.action_space
        self.observation_space = batch_space(first.observation_space, num_envs)
        self.action_space = batch_space(first.action_space, num_envs)
        self._lengths = np.zeros(num_envs, int)

    def reset(self, *, seed=None, options: dict | None = None):
        """Begin an episode in every task. seed: one for each, None, or an integer: seed, seed + 1, ..."""
        if seed is None or isinstance(seed, (int, np.integer)):
            seeds = [None if seed is None else int(seed) + i for i in range(self.num_envs)]
        else:
            seeds = list(seed)
        if len(seeds) != self.num_envs:
            raise InvalidValue("seed", seed, f"an integer, None or {self.num_envs} of them")
        jobs = zip(self.envs, seeds, strict=True)
        results = self._map(lambda job: job[0].reset(seed=job[1], options=options), jobs)
        self._lengths[:] = 0
        infos: dict = {}
        for i, (_, info) in enumerate(results):
            infos = self._add_info(infos, info, i)
        return self._joined([observation for observation, _ in results]), infos

    def step(self, actions):
        """One step of every task; actions (num_envs, ...)."""
        actions = np.asarray(actions)
        if actions.shape != self.action_space.shape:
            raise InvalidValue("actions", actions, f"of shape {self.action_space.shape}")
        results = self._map(self._step_of, range(self.num_envs), actions)
        infos: dict = {}
        for i, result in enumerate(results):
            infos = self._add_info(infos, result.pop("info"), i)
        columns = {key: [result[key] for result in results] for key in results[0]}
        return (
            self._joined(columns["observation"]),
            np.array(columns["reward"], np.float64),
            np.array(columns["terminated"], bool),
            np.array(columns["truncated"], bool),
            infos,
        )

    def render(self) -> tuple | None:
        """The images of all tasks, one after the other."""
        return tuple(env.render() for env in self.envs)

    def close_extras(self, **_) -> None:
        """Close all tasks and end the threads."""
        for env in self.envs:
            env.close()
        if self._pool is not None:
            self._pool.shutdown()

    def _step_of(self, index: int, action) -> dict:
        """A step of one task, and the reset if its episode ends with it."""
        env = self.envs[index]
        observation, reward, terminated, truncated, info = env.step(action)
        self._lengths[index] += 1
        truncated = truncated or self._lengths[index] == self._horizon
        if terminated or truncated:
            ended = {"final_obs": observation, "final_info": info}
            observation, info = env.reset()
            info = {**info, **ended}
            self._lengths[index] = 0
        return {
            "observation": observation,
            "reward": reward,
            "terminated": terminated,
            "truncated": truncated,
            "info": info,
        }

    def _map(self, function, *iterables) -> list:
        call = map if self._pool is None else self._pool.map
        return list(call(function, *iterables))

    def _joined(self, observations):
        empty = create_empty_array(self.single_observation_space, self.num_envs)
        return concatenate(self.single_observation_space, observations, empty)
