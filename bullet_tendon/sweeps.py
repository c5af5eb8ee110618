"""sweep: one function over many cases, on any executor.

Owns: the order of the results, the seed of each case, and the file that finished cases stream to. Goes with
no room of the core. It never starts a cluster: the caller hands one over.
"""

import concurrent.futures
import contextlib
import functools
import json
import multiprocessing
import os
import traceback
from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np

from . import checks, view
from .errors import CaseFailed, InvalidType, InvalidValue

Executor = concurrent.futures.Executor | int | Callable | None
_EXECUTORS = (
    "None, a number of processes, a concurrent.futures.Executor (Dask: client.get_executor()), or a callable "
    "as map"
)


class _Outcome(NamedTuple):
    """What came of a case. failure: the traceback as text, or ""."""

    index: int
    result: Any
    failure: str = ""


def sweep(
    function: Callable[[Any, np.random.Generator], Any],
    cases: Iterable,
    *,
    executor: Executor = None,
    seed: int = 0,
    progress: bool = True,
    file: str | os.PathLike | None = None,
) -> list:
    """[function(case, rng) for case in cases], in the order of the cases, on any executor.

    Args:
        function: gets the case and a numpy Generator of its own. Its seed is that of
            SeedSequence(seed).spawn(number of cases)[index], so that results depend neither on the executor
            nor on the number of workers. Where processes are used, function, cases and results have to be
            picklable.
        cases: any iterable; it is read once, before the first case runs.
        executor: None: this thread. A number: that many processes, started anew (spawn) and ended afterwards.
            Any concurrent.futures.Executor: it stays open. A callable that is used as map(function,
            iterable), in any order: multiprocessing's or Ray's pool.imap_unordered, for example.
        seed: of all cases, an integer >= 0.
        progress: whether a bar is shown on stderr, where tqdm is installed.
        file: a path. Every finished case is written to it at once, as a line of JSON with its index, case and
            result. If the file is there, the cases that it has are taken from it and not run again. Cases may
            be added at the end. Cases and results have to be what JSON can hold, or numpy arrays and numbers;
            the results returned are as JSON gives them back: lists in place of tuples and arrays.

    Returns:
        The results.

    Raises:
        CaseFailed: where function, or the executor, raised for a case. No further case is begun, those that
            run are finished and written.
        InvalidType, InvalidValue: for bad arguments, for a file of another sweep, and, with a file, for cases
            and results that JSON cannot hold.

    Example:
        >>> bt.sweep(lambda case, rng: case**2, [1, 2, 3], progress=False)
        [1, 4, 9]
    """
    if not callable(function):
        raise InvalidType("function", function, "a callable")
    seed = checks.integer("seed", seed, at_least=0)
    checks.flag("progress", progress)
    cases = checks.sequence("cases", cases, "an iterable of cases")
    with contextlib.ExitStack() as stack:
        engine = _engine(executor, len(cases), stack)
        log = None if file is None else stack.enter_context(_Log(file, function, seed, cases))
        results = {} if log is None else log.finished
        jobs = [(index, case) for index, case in enumerate(cases) if index not in results]
        outcomes = engine(functools.partial(_run, function, seed), jobs)
        failed = []
        # A failed sweep leaves the rest of the outcomes, and with that cancels what has not begun.
        with contextlib.closing(outcomes):
            for outcome in view.progress(outcomes, "sweep", len(jobs)) if progress else outcomes:
                if outcome.failure:
                    failed.append(outcome)
                else:
                    result = outcome.result if log is None else log.write(outcome.index, outcome.result)
                    results[outcome.index] = result
    if failed:
        first = min(failed, key=lambda outcome: outcome.index)
        raise CaseFailed(first.index, cases[first.index], first.failure)
    return [results[index] for index in range(len(cases))]


def _run(function, seed: int, job: tuple[int, Any]) -> _Outcome:
    """In the worker. A failure returns as text: not every exception can be pickled."""
    index, case = job
    try:
        rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(index,)))
        return _Outcome(index, function(case, rng))
    except Exception:
        return _Outcome(index, None, traceback.format_exc())


def _engine(
    executor: Executor, cases: int, stack: contextlib.ExitStack
) -> Callable[[Callable, list], Iterator[_Outcome]]:
    """What runs jobs, as engine(run, jobs): a generator of their outcomes."""
    if executor is None:
        return functools.partial(_by_map, map)
    if isinstance(executor, concurrent.futures.Executor):
        return functools.partial(_by_futures, executor)
    if isinstance(executor, (int, np.integer)):
        count = min(checks.integer("executor", executor, at_least=1), max(1, cases))
        context = multiprocessing.get_context("spawn")
        pool = concurrent.futures.ProcessPoolExecutor(count, mp_context=context)
        return functools.partial(_by_futures, stack.enter_context(pool))
    if callable(executor) and not hasattr(executor, "submit"):
        return functools.partial(_by_map, executor)
    raise InvalidType("executor", executor, _EXECUTORS)


def _by_map(call, run, jobs) -> Iterator[_Outcome]:
    for outcome in call(run, jobs):
        yield outcome
        if outcome.failure:
            return


def _by_futures(executor, run, jobs) -> Iterator[_Outcome]:
    waiting: dict[concurrent.futures.Future, int] = {}
    try:
        for job in jobs:
            waiting[executor.submit(run, job)] = job[0]
        for future in concurrent.futures.as_completed(list(waiting)):
            outcome = _outcome(future, waiting.pop(future))
            yield outcome
            if outcome.failure:
                break
        running = [future for future in waiting if not future.cancel()]
        for future in concurrent.futures.as_completed(running):
            yield _outcome(future, waiting.pop(future))
    finally:
        for future in waiting:
            future.cancel()


def _outcome(future, index: int) -> _Outcome:
    """Of a future that is done. The executor's own failures are those of the case."""
    try:
        return future.result()
    except (Exception, concurrent.futures.CancelledError):
        return _Outcome(index, None, traceback.format_exc())


class _Log:
    """The file of a sweep: a line about the sweep, and one for each finished case.

    finished: results by index, of the cases that the file had.
    """

    def __init__(self, path, function, seed: int, cases: list):
        self._path = checks.path("file", path)
        self._cases = [_as_json(f"cases[{index}]", case) for index, case in enumerate(cases)]
        head = {"function": getattr(function, "__qualname__", type(function).__name__), "seed": seed}
        self._head = json.dumps(head)
        self.finished: dict[int, Any] = {}

    def __enter__(self) -> "_Log":
        complete = self._read()
        self._file = open(self._path, "ab")
        # A line that was being written when the sweep was killed.
        self._file.truncate(complete)
        if not complete:
            self._append(self._head)
        return self

    def __exit__(self, *_) -> None:
        self._file.close()

    def write(self, index: int, result) -> Any:
        """Adds a case. Returns its result as JSON gives it back."""
        text = _as_json(f"result of cases[{index}]", result)
        self._append(f'{{"index": {index}, "case": {self._cases[index]}, "result": {text}}}')
        return json.loads(text)

    def _append(self, line: str) -> None:
        self._file.write(line.encode() + b"\n")
        self._file.flush()

    def _read(self) -> int:
        """Takes the finished cases from the file, if there is one. Returns the size of its whole lines."""
        if not os.path.exists(self._path):
            return 0
        with open(self._path, "rb") as file:
            content = file.read()
        complete = content.rfind(b"\n") + 1
        if not complete and not self._head.encode().startswith(content):
            self._refuse(1)
        for number, line in enumerate(content[:complete].splitlines(), 1):
            self._take(number, line)
        return complete

    def _take(self, number: int, line: bytes) -> None:
        try:
            entry = json.loads(line)
            if number == 1:
                same = json.dumps(entry) == self._head
            else:
                index = entry["index"]
                same = json.dumps(entry["case"]) == self._cases[index] and index >= 0
                self.finished[index] = entry["result"]
        except (ValueError, KeyError, IndexError, TypeError):
            same = False
        if not same:
            self._refuse(number)

    def _refuse(self, number: int):
        what = f"function and seed {self._head}" if number == 1 else "the same cases"
        raise InvalidValue("file", self._path, f"a file of this sweep, with {what} (line {number})")


def _as_json(what: str, value) -> str:
    try:
        text = json.dumps(value, default=_plain)
        # Keys of dictionaries become text.
        return json.dumps(json.loads(text))
    except (TypeError, ValueError):
        raise InvalidType(what, value, "what JSON can hold, or numpy arrays and numbers") from None


def _plain(value):
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    raise TypeError
