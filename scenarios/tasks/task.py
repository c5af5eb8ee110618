"""Task: what the environments share. One task is one pybullet client with a TendonWorld in it.

The scene is built once. An episode begins by restoring the state in which it was built, and by what the
episode's random numbers change. Therefore an episode depends on nothing but its seed and its actions.
"""

import dataclasses
import os
import sys
from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
import pybullet as p

from bullet_tendon import SolverOptions, TendonWorld, checks, view
from bullet_tendon.errors import InvalidType, InvalidValue, UnknownId

IMAGE = 128  # pixels: width and height of a rendered image
BOUND = 10.0  # of every observed number; scaled observations are about 1


@dataclasses.dataclass(frozen=True)
class Verdict:
    """What a step was worth.

    terms: parts of the reward by name; the reward is their sum. success: whether the goal is reached.
    terminated: whether the episode ends here.
    """

    terms: dict[str, float]
    success: bool
    terminated: bool


class Task(gymnasium.Env):
    """A task in a pybullet client of its own.

    render_mode: None, "rgb_array" (render returns (128, 128, 3) uint8, without a window) or "human"
    (pybullet's window; without a display nothing is shown). Actions are float32 in [-1, 1]; what is outside
    is clipped, what is not finite raises InvalidValue. Observations are float32, scaled to about [-1, 1] and
    clipped at +-10. `info` has "is_success" and each term of the reward as "reward_NAME".

    reset(seed=, options=): the options that a task takes fix what is random otherwise; an unknown one
    raises InvalidValue. If a step raises, reset leads back to a usable environment.

    A subclass says what the task is: build, begin, act, drive, observe, judge.
    """

    metadata = {"render_modes": ["rgb_array", "human"], "render_fps": 24}
    time_step = 1 / 240  # s, of pybullet
    substeps = 10  # time steps for each action
    action_size = 1
    camera: dict[str, Any] = {}  # arguments of view.Camera
    bones: tuple[int, ...] = ()  # ids of bodies that pictures of episodes show as if one could look into them
    option_names: tuple[str, ...] = ()  # what reset(options=) takes

    def __init__(self, render_mode: str | None = None):
        if render_mode is not None:
            checks.choice("render_mode", render_mode, tuple(self.metadata["render_modes"]))
        self.render_mode = render_mode
        self._has_window = render_mode == "human" and _has_display()
        self.client: int = p.connect(p.GUI if self._has_window else p.DIRECT)
        p.setTimeStep(self.time_step, self.client)
        # Without it, pybullet lists contacts in an order that a restored state does not repeat.
        p.setPhysicsEngineParameter(deterministicOverlappingPairs=1, physicsClientId=self.client)
        self.world = TendonWorld(self.client, self.solver())
        self._visuals: list[view.TendonVisual] = []
        self._camera: view.Camera | None = None
        self._is_broken = False  # whether a step raised
        self.build()
        if self._has_window:
            self._visuals = [view.TendonVisual(tendon, self.client) for tendon in self.world.tendons]
        self._start = p.saveState(self.client), self.world.save_state()
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (self.action_size,), np.float32)
        self._begin(np.random.default_rng(0), {})
        self.observation_space = _space_of(self.observe())

    # What a subclass says.

    def solver(self) -> SolverOptions:
        """Options of the world."""
        return SolverOptions()

    def build(self) -> None:
        """Make bodies and tendons."""
        raise NotImplementedError

    def begin(self, rng: np.random.Generator, options: dict) -> None:
        """Change the restored scene for an episode. Everything random comes from rng."""
        raise NotImplementedError

    def act(self, action: np.ndarray) -> None:
        """Take an action in (action_size,) float64, within [-1, 1]."""
        raise NotImplementedError

    def drive(self) -> None:
        """What has to be done before each time step."""

    def measure(self) -> None:
        """Read what judge and observe need of the scene, after begin and after the steps of an action."""

    def observe(self):
        """The observation now."""
        raise NotImplementedError

    def judge(self) -> Verdict:
        """What the last step was worth."""
        raise NotImplementedError

    def lines(self) -> tuple[list, Sequence]:
        """What pictures of episodes show as tendons, and their colours by turns."""
        return list(self.world.tendons), view.PALETTE

    # What gymnasium calls.

    def reset(self, *, seed: int | None = None, options: dict | None = None):
        """See gymnasium.Env.reset. Raises InvalidType, InvalidValue for unknown options."""
        self._require_client()
        if not isinstance(options, dict | None):
            raise InvalidType("options", options, "a dict")
        options = dict(options or {})
        unknown = [name for name in options if name not in self.option_names]
        if unknown:
            raise InvalidValue("options", unknown, f"some of {list(self.option_names)}")
        super().reset(seed=seed)
        self._restore()
        self._begin(self.np_random, options)
        self._show()
        return self.observe(), {"is_success": False}

    def step(self, action):
        """See gymnasium.Env.step."""
        self._require_client()
        action = checks.array("action", action, (self.action_size,)).clip(-1.0, 1.0)
        self._is_broken = True
        self.act(action)
        for _ in range(self.substeps):
            self.drive()
            self.world.step()
        self._is_broken = False
        self._show()
        self.measure()
        verdict = self.judge()
        info = {f"reward_{name}": float(value) for name, value in verdict.terms.items()}
        info["is_success"] = bool(verdict.success)
        reward = float(sum(verdict.terms.values()))
        return self.observe(), reward, bool(verdict.terminated), False, info

    def render(self):
        """(128, 128, 3) uint8 with render_mode="rgb_array"; None otherwise."""
        if self.render_mode != "rgb_array":
            return None
        self._require_client()
        if self._camera is None:
            self._camera = view.Camera(self.world, IMAGE, IMAGE, **self.camera)
        return self._camera.image()

    def close(self) -> None:
        """Disconnect from pybullet. A second call does nothing."""
        if self._camera is not None:
            self._camera.close()
            self._camera = None
        if self.client >= 0 and p.isConnected(self.client):
            p.disconnect(self.client)
        self.client = -1

    def _begin(self, rng: np.random.Generator, options: dict) -> None:
        self.begin(rng, options)
        self.measure()

    def _restore(self) -> None:
        """Put back the state in which the scene was built."""
        if self._is_broken:
            # A step that raised may have left forces on bodies: pybullet keeps them until its next step.
            p.stepSimulation(self.client)
            self._is_broken = False
        bodies, tendons = self._start
        p.restoreState(bodies, physicsClientId=self.client)
        self.world.restore_state(tendons)

    def _show(self) -> None:
        for visual in self._visuals:
            visual.update()

    def _require_client(self) -> None:
        if self.client < 0:
            raise UnknownId("environment", type(self).__name__, "one that was not closed")


def _has_display() -> bool:
    """Whether a window can be opened. pybullet ends the process where there is no display."""
    return not sys.platform.startswith("linux") or bool(os.environ.get("DISPLAY"))


def _space_of(observation) -> gymnasium.Space:
    """The space of observations that are an array, or a dict of arrays."""
    if isinstance(observation, dict):
        return gymnasium.spaces.Dict({name: _space_of(part) for name, part in observation.items()})
    return gymnasium.spaces.Box(-BOUND, BOUND, observation.shape, np.float32)


def scaled(*parts) -> np.ndarray:
    """One observation (n,) float32 of parts that were scaled, clipped at +-BOUND."""
    joined = np.concatenate([np.ravel(part) for part in parts])
    return joined.clip(-BOUND, BOUND).astype(np.float32)


def drawn(options: dict, name: str, low: float, high: float, rng: np.random.Generator) -> float:
    """The option `name`, within [low, high], or a uniform random number in that range.

    The random number is drawn in any case, so that an option does not change what is drawn after it.
    Raises InvalidType or InvalidValue.
    """
    value = rng.uniform(low, high)
    if name not in options:
        return float(value)
    return checks.number(name, options[name], at_least=low, at_most=high)
