"""Search: the parameters of a small policy by imitation, and then by population search.

The search begins at the least-squares fit to the actions of the task's expert, in episodes whose actions
are disturbed. CMA-ES (package `cma`, extra `learn`) goes on from there, by the rewards alone. All episodes
are calls of bullet_tendon.sweep, so that they run on whatever executor sweep takes. All candidates of a
generation meet the same seeds, and each generation meets others.
"""

import concurrent.futures
import multiprocessing
from time import perf_counter

import numpy as np

from bullet_tendon import checks, sweep, view
from bullet_tendon.errors import MissingExtra

from .episodes import Episode, environment, evaluate_parameters, run_episode
from .policies import module_of

DEMONSTRATIONS, DISTURBANCE = 24, 0.5  # episodes of the expert, and the largest change of their actions
RIDGE = 1e-3  # of the fit, as a share of the mean square of the basis
FIRST_STEP = 0.05  # of the population search, in units of parameters
EPISODES = 4  # of each candidate in a generation
FIRST_SEED = 1_000_000  # seeds of the search begin here; smaller ones are for evaluations
TESTED, ENOUGH = 60, 59  # episodes that the mean of the search is tested by, and successes that end it
TEST_EVERY, LEAST = 4, 8  # generations between tests, and before the search may end


def search(task: str, minutes: float = 10.0, processes: int = 2, seed: int = 0) -> dict[str, np.ndarray]:
    """Parameters of a task's learned policy, and how they were found.

    minutes: of wall time, at most, until the last generation begins. processes: that run episodes.
    Returns arrays by name: parameters (count,), those of the best test; curve (tests, 5), of the fit and of
    the mean of the search every 4 generations: wall time [s], processor time of all episodes [s], number of
    episodes, mean reward and share of successes in 60 further episodes; seed. Ends after 8 generations where
    59 of 60 succeed. Raises MissingExtra, InvalidType or InvalidValue.
    """
    try:
        import cma
    except ImportError:
        raise MissingExtra("cma", "learn", "searching a policy") from None
    minutes = checks.number("minutes", minutes, above=0)
    processes = checks.integer("processes", processes, at_least=1)
    seed = checks.integer("seed", seed, at_least=0)
    context = multiprocessing.get_context("spawn")
    with concurrent.futures.ProcessPoolExecutor(processes, mp_context=context) as pool:
        runs = _Runs(task, FIRST_SEED + 100_000 * seed, pool)
        first = imitate(task, runs)
        strategy = cma.CMAEvolutionStrategy(first, FIRST_STEP, {"seed": seed + 1, "verbose": -9})
        best, most = first, runs.test(first)
        for generation in view.progress(range(1, 10**6), f"searching {task}"):
            is_enough = generation > LEAST and most[1] >= ENOUGH / TESTED
            if is_enough or runs.seconds() > 60 * minutes:
                break
            candidates = strategy.ask()
            results = runs.evaluate(candidates, EPISODES)
            strategy.tell(candidates, [-_reward(result) for result in results])
            if generation % TEST_EVERY == 0:
                tested = runs.test(strategy.mean)
                best, most = max((best, most), (strategy.mean, tested), key=lambda pair: pair[1][::-1])
    return {"parameters": np.array(best), "curve": np.array(runs.curve), "seed": np.array(seed)}


def imitate(task: str, runs: "_Runs") -> np.ndarray:
    """(count,) parameters: the least-squares fit to the expert's actions in disturbed episodes."""
    square, product = (sum(parts) for parts in zip(*runs.demonstrate(DEMONSTRATIONS), strict=True))
    ridge = RIDGE * np.trace(square) / len(square)
    return np.linalg.solve(square + ridge * np.eye(len(square)), product)


class _Runs:
    """The episodes of a search: each has a seed of its own, and their time is counted."""

    def __init__(self, task: str, first_seed: int, pool):
        self._task, self._seed, self._pool = task, first_seed, pool
        self._start, self._spent, self._count = perf_counter(), 0.0, 0
        self.curve: list[tuple] = []

    def seconds(self) -> float:
        """Wall time since the search began [s]."""
        return perf_counter() - self._start

    def evaluate(self, candidates, episodes: int) -> list[list[Episode]]:
        """Episodes of each candidate, on seeds that no other call has."""
        results = evaluate_parameters(self._task, candidates, self._seeds(episodes), self._pool)
        self._note([episode for result in results for episode in result])
        return results

    def test(self, parameters) -> tuple[float, float]:
        """Mean reward and share of successes of a policy, which become a point of the curve."""
        [tested] = self.evaluate([parameters], TESTED)
        found = _reward(tested), float(np.mean([episode.success for episode in tested]))
        self.curve.append((self.seconds(), self._spent, self._count, *found))
        return found

    def demonstrate(self, episodes: int) -> list[tuple[np.ndarray, np.ndarray]]:
        """Of episodes by the expert: the basis' products with itself and with the expert's actions."""
        cases = [{"task": self._task, "seed": seed} for seed in self._seeds(episodes)]
        found = sweep(_demonstrate, cases, executor=self._pool, progress=False)
        self._note([episode for *_, episode in found])
        return [(square, product) for square, product, _ in found]

    def _seeds(self, count: int) -> range:
        self._seed += count
        return range(self._seed - count, self._seed)

    def _note(self, episodes: list[Episode]) -> None:
        self._spent += sum(episode.seconds for episode in episodes)
        self._count += len(episodes)


def _demonstrate(case: dict, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, Episode]:
    module = module_of(case["task"])
    square, product = 0.0, 0.0
    disturbed = np.random.default_rng(case["seed"])

    def policy(observation) -> np.ndarray:
        nonlocal square, product
        basis, action = module.basis(observation), np.clip(module.expert(observation), -1.0, 1.0)
        square, product = square + basis @ basis.T, product + basis @ action
        return np.clip(action + disturbed.uniform(-DISTURBANCE, DISTURBANCE, len(action)), -1.0, 1.0)

    episode = run_episode(environment(case["task"]), policy, case["seed"])
    return square, product, episode


def _reward(episodes: list[Episode]) -> float:
    return float(np.mean([episode.reward for episode in episodes]))
