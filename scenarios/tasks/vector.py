"""TaskVector: many tasks of one kind, stepped by several processes.

Each task has a pybullet client and a world of its own, and shares nothing with the others. Therefore
results do not depend on the number of processes, nor on that of threads.
"""

import multiprocessing
import os

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space

from bullet_tendon import checks
from bullet_tendon.errors import InvalidValue

from .share import RemoteShare, Share, joined
from .task import Task


class TaskVector(gymnasium.vector.VectorEnv):
    """num_envs tasks, each with the seed that it would have by itself.

    max_episode_steps: after which an episode is truncated (None: never). processes: among how many the tasks
    are divided, this one among them (None: one for each processor, or 1 where threads is given). threads:
    how many step the tasks of one process at the same time (None: 1). context: how processes start, as
    multiprocessing.get_context takes it. With "spawn" and "forkserver" the main module has to be protected
    by `if __name__ == "__main__":`.

    Autoreset is SAME_STEP: where an episode ends, the observation is the first of the next one, and
    infos["final_obs"], infos["final_info"] are of the end. Further arguments go to each task. Raises
    InvalidType, InvalidValue, what a task raises, or UnknownId where a process was ended from outside.
    """

    task: type[Task] = Task

    def __init__(
        self,
        num_envs: int = 1,
        max_episode_steps: int | None = None,
        processes: int | None = None,
        threads: int | None = None,
        render_mode: str | None = None,
        context: str | None = None,
        **arguments,
    ):
        self.num_envs = checks.integer("num_envs", num_envs, at_least=1)
        if max_episode_steps is not None:
            checks.integer("max_episode_steps", max_episode_steps, at_least=1)
        if processes is None:
            processes = (os.cpu_count() or 1) if threads is None else 1
        processes = min(checks.integer("processes", processes, at_least=1), self.num_envs)
        threads = 1 if threads is None else checks.integer("threads", threads, at_least=1)
        self.render_mode = render_mode
        self.metadata = {**self.task.metadata, "autoreset_mode": AutoresetMode.SAME_STEP}
        arguments["render_mode"] = render_mode
        bounds = [self.num_envs * k // processes for k in range(processes + 1)]
        self._slices = [slice(*ends) for ends in zip(bounds, bounds[1:], strict=False)]
        shares = [
            Share(self.task, part.stop - part.start, max_episode_steps, threads, arguments)
            for part in self._slices
        ]
        start = multiprocessing.get_context(context)
        self._own, self._others = shares[0], [RemoteShare(start, share) for share in shares[1:]]
        try:
            spaces = self._ask("build")[0]
        except BaseException:
            self.close()
            raise
        self.single_observation_space, self.single_action_space = spaces
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)

    def reset(self, *, seed=None, options: dict | None = None):
        """Begin an episode in every task. seed: one for each, None, or an integer: seed, seed + 1, ..."""
        if seed is None or isinstance(seed, (int, np.integer)):
            seeds = [None if seed is None else int(seed) + i for i in range(self.num_envs)]
        else:
            seeds = list(seed)
        if len(seeds) != self.num_envs:
            raise InvalidValue("seed", seed, f"an integer, None or {self.num_envs} of them")
        observations, infos = zip(*self._ask("reset", seeds, [options] * self.num_envs), strict=True)
        return joined(observations), self._gathered(infos)

    def step(self, actions):
        """One step of every task; actions (num_envs, ...)."""
        actions = np.asarray(actions)
        if actions.shape != self.action_space.shape:
            raise InvalidValue("actions", actions, f"of shape {self.action_space.shape}")
        results = zip(*self._ask("step", actions), strict=True)
        observations, rewards, terminated, truncated, infos = results
        ends = np.array(_flat(terminated), bool), np.array(_flat(truncated), bool)
        return joined(observations), np.array(_flat(rewards), float), *ends, self._gathered(infos)

    def render(self) -> tuple | None:
        """The images of all tasks, one after the other."""
        return tuple(_flat(self._ask("render")))

    def close_extras(self, **_) -> None:
        """Close all tasks and end the processes and threads."""
        for share in (self._own, *self._others):
            share.close()

    @property
    def envs(self) -> list:
        """The tasks that are in this process: the first ones."""
        return self._own.envs

    def _ask(self, call: str, *arguments) -> list:
        """What a method of Share returns, by share. arguments: sequences of one value for each task."""
        own, *parts = [[whole[part] for whole in arguments] for part in self._slices]
        for share, part in zip(self._others, parts, strict=True):
            share.begin(call, *part)
        return [getattr(self._own, call)(*own), *(share.result() for share in self._others)]

    def _gathered(self, infos: tuple) -> dict:
        """One dict of the infos of the tasks of each share."""
        gathered: dict = {}
        for index, info in enumerate(_flat(infos)):
            gathered = self._add_info(gathered, info, index)
        return gathered


def _flat(parts: tuple) -> list:
    """What is there for each task, of what each share has."""
    return [value for part in parts for value in part]
