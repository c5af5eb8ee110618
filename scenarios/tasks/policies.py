"""Policies: what chooses actions. Scripted experts, small learned policies, random actions.

A policy is a function of one observation, observation -> action. It has no memory.
"""

import importlib
from importlib.resources import files
from types import ModuleType

import numpy as np

from bullet_tendon import checks
from bullet_tendon.errors import InvalidValue

from . import TASKS

POLICIES = ("expert", "learned", "random")


def module_of(task: str) -> ModuleType:
    """The module of a task by its name. Raises InvalidValue for an unknown one."""
    if task not in TASKS:
        raise InvalidValue("task", task, f"one of {', '.join(TASKS)}")
    return importlib.import_module(f"{__package__}.{TASKS[task][0]}")


class Learned:
    """A policy that is linear in a few parameters: action = parameters . basis(observation), clipped.

    task: its name; parameters: (count,). The task's module gives the basis: (count, action_size) actions that
    belong to an observation.
    """

    def __init__(self, task: str, parameters):
        self._basis = module_of(task).basis
        self._parameters = checks.array("parameters", parameters, (None,))

    def __call__(self, observation) -> np.ndarray:
        return np.clip(self._parameters @ self._basis(observation), -1.0, 1.0)


def make_policy(name: str, task: str, rng: np.random.Generator):
    """The policy of a task: "expert", "learned" (the one that is shipped) or "random" (from rng).

    Raises InvalidValue, also where the task has no such policy.
    """
    checks.choice("policy", name, POLICIES)
    module = module_of(task)
    if name == "expert":
        return module.expert
    if name == "learned":
        file = files(__package__).joinpath(f"{TASKS[task][0]}.npz")
        if not file.is_file():
            raise InvalidValue("policy", name, f"'expert' or 'random' for {task}")
        with file.open("rb") as stream, np.load(stream) as data:
            return Learned(task, data["parameters"])
    size = getattr(module, task).action_size
    return lambda observation: rng.uniform(-1.0, 1.0, size)
