"""
A task for reinforcement learning
=================================

The package has tasks by the interface of gymnasium (``pip install 'bullet_tendon[gym]'``). Each is a
pybullet client of its own, and an episode depends on nothing but its seed and its actions.
"""

import gymnasium
import numpy as np
from bullet_tendon.scenarios.tasks import pulley_lift

from bullet_tendon import view

# %%
# One environment
# ---------------
# A trolley with a wheel runs on a rail, and a hand pulls at the rope over the wheel. The task's expert
# lifts the weight to its goal.

TASK = "bullet_tendon.scenarios.tasks:bullet_tendon/PulleyLift-v0"

env = gymnasium.make(TASK)


def episode(policy, seed: int) -> list[float]:
    """The rewards of an episode."""
    observation, _ = env.reset(seed=seed)
    rewards, ended = [], False
    while not ended:
        observation, reward, terminated, truncated, info = env.step(policy(observation))
        rewards.append(reward)
        ended = terminated or truncated
    print(f"{len(rewards)} steps, reward {sum(rewards):.2f}, success: {info['is_success']}")
    return rewards


rng = np.random.default_rng(0)
by_expert = episode(pulley_lift.expert, seed=3)
at_random = episode(lambda _: rng.uniform(-1, 1, 2), seed=3)

# %%
curves = [
    {"y": np.cumsum(by_expert), "x": np.arange(len(by_expert)), "label": "expert"},
    {"y": np.cumsum(at_random), "x": np.arange(len(at_random)), "label": "random"},
]
view.figure("rewards.png", curves=curves, xlabel="step", ylabel="sum of rewards")

# %%
# Many environments
# -----------------
# A vector divides environments among processes, one for each processor. What each does is equal, to the
# last bit, to what an environment alone does with the same seed.


def vector_observations(count: int, steps: int) -> np.ndarray:
    """(count, n) observations after some steps at rest."""
    vector = gymnasium.make_vec(TASK, count, vectorization_mode="vector_entry_point")
    observations, _ = vector.reset(seed=0)
    for _ in range(steps):
        observations, *_ = vector.step(np.zeros((count, 2), np.float32))
    vector.close()
    return observations


if __name__ == "__main__":  # processes that are spawned import this file
    observations = vector_observations(4, 10)
    env.reset(seed=2)
    for _ in range(10):
        alone, *_ = env.step(np.zeros(2, np.float32))
    print("environment 2 as it is alone:", np.array_equal(alone, observations[2]))

# %%
# A task of your own is a subclass of ``bullet_tendon.scenarios.tasks.task.Task``: see
# :doc:`/scenarios/tasks/README` for what it has to say.
