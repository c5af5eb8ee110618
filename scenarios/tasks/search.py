"""Search: the parameters of a small policy by population search (CMA-ES, package `cma`, extra `learn`).

Each generation is one call of bullet_tendon.sweep, so that it runs on whatever executor sweep takes. All
candidates of a generation meet the same seeds, and each generation meets others.
"""

import concurrent.futures
import multiprocessing
from time import perf_counter

import numpy as np

from bullet_tendon import checks, view
from bullet_tendon.errors import MissingExtra

from .episodes import Episode, evaluate_parameters
from .policies import Learned

FIRST_STEP = 0.5  # of the search, in units of parameters
EPISODES = 4  # of each candidate in a generation
FIRST_SEED = 1_000_000  # seeds of the search begin here; smaller ones are for evaluations
SUCCESS = 2.0  # what a success adds to an episode's reward
TESTED = 40  # episodes that the search's mean is tested by
ENOUGH = 39  # successes among them that end the search


def search(task: str, minutes: float = 10.0, processes: int = 2, seed: int = 0) -> dict[str, np.ndarray]:
    """Parameters of a task's learned policy, and how they were found.

    minutes: of wall time, at most, until the last generation begins. processes: that run episodes.
    Returns arrays by name: parameters (count,); curve (generations, 4): seconds, episodes so far, mean reward
    and share of successes of the generation's episodes; seed. Ends earlier where the mean of the search
    succeeds in 39 of 40 further episodes. Raises MissingExtra, InvalidType or InvalidValue.
    """
    try:
        import cma
    except ImportError:
        raise MissingExtra("cma", "learn", "searching a policy") from None
    minutes = checks.number("minutes", minutes, above=0)
    processes = checks.integer("processes", processes, at_least=1)
    seed = checks.integer("seed", seed, at_least=0)
    options = {"seed": seed + 1, "verbose": -9}
    strategy = cma.CMAEvolutionStrategy(Learned.count(task) * [0.0], FIRST_STEP, options)
    curve, episodes, seeds = [], 0, FIRST_SEED + 100_000 * seed
    start = perf_counter()
    context = multiprocessing.get_context("spawn")
    with concurrent.futures.ProcessPoolExecutor(processes, mp_context=context) as pool:
        for _ in view.progress(range(10**6), f"searching {task}"):
            candidates = strategy.ask()
            results = evaluate_parameters(task, candidates, range(seeds, seeds + EPISODES), pool)
            strategy.tell(candidates, [-_worth(result) for result in results])
            seeds, episodes = seeds + EPISODES, episodes + EPISODES * len(candidates)
            every = [episode for result in results for episode in result]
            rates = np.mean([episode.reward for episode in every]), np.mean([e.success for e in every])
            curve.append((perf_counter() - start, episodes, *rates))
            if curve[-1][0] > 60 * minutes:
                break
            if rates[1] > 0.8:
                tested = evaluate_parameters(task, [strategy.mean], range(seeds, seeds + TESTED), pool)[0]
                seeds, episodes = seeds + TESTED, episodes + TESTED
                if sum(episode.success for episode in tested) >= ENOUGH:
                    break
    return {"parameters": np.array(strategy.mean), "curve": np.array(curve), "seed": np.array(seed)}


def _worth(result: list[Episode]) -> float:
    return float(np.mean([episode.reward + SUCCESS * episode.success for episode in result]))
