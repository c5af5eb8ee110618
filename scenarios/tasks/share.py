"""Share: the tasks of a vector that one process steps, and the same in a process of its own.

Tasks share nothing. So results do not depend on how they are divided. Python, pybullet and FCL hold the
interpreter's lock: only processes step tasks at the same time throughout.
"""

import contextlib
import multiprocessing
import os
import selectors
import signal
import time
from concurrent.futures import ThreadPoolExecutor
from multiprocessing.connection import Connection

import numpy as np
from gymnasium.vector.utils import concatenate, create_empty_array

from bullet_tendon.errors import UnknownId

_AWAKE = 1e-3  # s for which a process that waits for another one stays awake


class Share:
    """`count` tasks of one class, stepped one after the other, or at the same time by threads.

    horizon: the number of steps after which an episode is truncated; None: never.
    """

    def __init__(self, task: type, count: int, horizon: int | None, threads: int, arguments: dict):
        self._task, self._count, self._arguments = task, count, arguments
        self._horizon = horizon
        self._pool = ThreadPoolExecutor(threads) if threads > 1 else None
        self._lengths = [0] * count
        self.envs: list = []

    def build(self) -> tuple:
        """Make the tasks. Returns the observation space and the action space of one."""
        for _ in range(self._count):
            self.envs.append(self._task(**self._arguments))
        return self.envs[0].observation_space, self.envs[0].action_space

    def reset(self, seeds: list, options: list) -> tuple:
        """Observations as one batch, and the info of each task."""
        self._lengths = [0] * self._count
        results = self._map(lambda env, s, o: env.reset(seed=s, options=o), self.envs, seeds, options)
        observations, infos = zip(*results, strict=True)
        return self._joined(observations), infos

    def step(self, actions) -> tuple:
        """Observations as one batch; reward, termination, truncation and info of each task."""
        results = self._map(self._step_of, range(self._count), actions)
        observations, *others = zip(*results, strict=True)
        return self._joined(observations), *others

    def render(self) -> list:
        """The image of each task."""
        return [env.render() for env in self.envs]

    def close(self) -> None:
        """Close the tasks and end the threads."""
        for env in self.envs:
            env.close()
        if self._pool is not None:
            self._pool.shutdown()

    def _step_of(self, index: int, action) -> tuple:
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
        return observation, reward, terminated, truncated, info

    def _joined(self, observations):
        space = self.envs[0].observation_space
        return concatenate(space, observations, create_empty_array(space, self._count))

    def _map(self, function, *iterables) -> list:
        call = map if self._pool is None else self._pool.map
        return list(call(function, *iterables))


class RemoteShare:
    """A Share in a process of its own: `begin` asks for a call, `result` waits for what it returns.

    The process ends by close, and when the process that made it ends.
    """

    def __init__(self, context, share: Share):
        """context: of multiprocessing."""
        self._asked = 0
        self._connection, other = context.Pipe()
        self._watched = selectors.DefaultSelector()
        self._watched.register(self._connection, selectors.EVENT_READ)
        self._process = context.Process(target=_serve, args=(other, share), daemon=True)
        self._process.start()
        other.close()

    def begin(self, call: str, *arguments) -> None:
        """Ask for a method of Share. The result of an earlier call that was not taken is dropped.

        Raises UnknownId where the process has ended.
        """
        self._asked += 1
        try:
            self._connection.send((self._asked, call, arguments))
        except OSError:
            raise self._ended() from None

    def result(self):
        """What the call returned. Raises what it raised, or UnknownId where the process has ended."""
        number = None
        _awaited(self._watched)
        while number != self._asked:
            try:
                number, failed, value = self._connection.recv()
            except (EOFError, OSError):
                raise self._ended() from None
        if failed:
            raise value
        return value

    def close(self) -> None:
        """Close the tasks and end the process. A second call does nothing."""
        if not self._connection.closed:
            with contextlib.suppress(UnknownId):
                self.begin("close")
                self.result()
            self._watched.close()
            self._connection.close()
            self._process.join()

    def _ended(self) -> UnknownId:
        self._process.join()
        allowed = f"one whose process runs: this one ended with exit code {self._process.exitcode}"
        return UnknownId("environment", self._process.name, allowed)


def _serve(connection: Connection, share: Share) -> None:
    """Answer calls of a share until it is closed or the other process has ended."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # both processes get it; the other one decides
    watched = selectors.DefaultSelector()  # once: multiprocessing's `wait` makes one at each call
    asked = watched.register(connection, selectors.EVENT_READ)
    watched.register(multiprocessing.parent_process().sentinel, selectors.EVENT_READ)
    call = ""
    while call != "close" and asked in [key for key, _ in _awaited(watched)]:
        number, call, arguments = connection.recv()
        try:
            answer = False, getattr(share, call)(*arguments)
        except Exception as error:
            answer = True, error
        try:
            connection.send((number, *answer))
        except Exception as error:  # of pickle: an object of the user's that cannot be sent
            connection.send((number, True, RuntimeError(f"{error}, in the answer: {answer[1]!r}")))


def _awaited(watched: selectors.BaseSelector) -> list:
    """What is ready, as `select` tells. To sleep and be woken takes longer than a short wait itself."""
    end = time.perf_counter() + _AWAKE
    while not (ready := watched.select(0)) and time.perf_counter() < end:
        os.sched_yield()
    return ready or watched.select()


def joined(parts: tuple):
    """One batch of the batches of shares: of arrays, or of dicts of arrays."""
    if isinstance(parts[0], dict):
        return {key: joined(tuple(part[key] for part in parts)) for key in parts[0]}
    return np.concatenate(parts)
