"""Random scenes such as users build, each judged by laws that do not come from this code.

python tests/stress/everyday.py [--family NAME ...] [--seeds A B] [--integrator NAME] [--program]

A scene is repeatable by its family and seed. It is right, or refused by a typed error before its first step;
all else is wrong: another error, StepFailed, a value that is not finite, a law that does not hold. Steps that
did not converge and the time of each step are counted. --program prints each wrong scene as a script.
"""

import argparse
import contextlib
import dataclasses
import signal
import traceback
import zlib
from pathlib import Path

import everyday_bodies
import everyday_bones
import everyday_knots
import everyday_pulleys
import numpy as np
from everyday_scene import FAMILIES, Scene, Wrong

import bullet_tendon as bt

MODULES = everyday_pulleys, everyday_bodies, everyday_bones, everyday_knots
VERDICTS = "right", "refused", "wrong", "stopped"


@dataclasses.dataclass
class Outcome:
    """How a scene went. seconds: of each step; told: warnings; stopped: it took more than the limit."""

    family: str
    seed: int
    verdict: str
    message: str
    seconds: list[float]
    unconverged: int
    told: list[str]
    program: str


class _TooLong(Exception):
    """The limit of a scene's processor time is used up."""


@contextlib.contextmanager
def limited(seconds):
    """Stop what takes more processor time than that [s] (None: any); a step is stopped as by Ctrl-C."""

    def stop(*_):
        raise _TooLong(f"longer than {seconds:g} s")

    if seconds is None:
        yield
        return
    before = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, before)


def run(family: str, seed: int, steps=240, limit: float | None = None, **options) -> Outcome:
    """Build, run and judge a scene; limit: of its processor time [s]; options: of SolverOptions."""
    scene = Scene(zlib.crc32(family.encode()) ^ seed, steps, **options)
    verdict, message = "right", ""
    try:
        with limited(limit):
            FAMILIES[family](scene)
    except _TooLong as stopped:
        verdict, message = "stopped", str(stopped)
    except bt.TendonError as error:
        refused = not scene.begun and not isinstance(error, bt.StepFailed)
        verdict = "refused" if refused else "wrong"
        message = f"{type(error).__name__}: {error}"
    except Wrong as wrong:
        verdict, message = "wrong", str(wrong)
    except Exception:  # whatever else is raised at a user is a failure too
        verdict, message = "wrong", traceback.format_exc()
    finally:
        scene.close()
    told = sorted(set(scene.told))
    return Outcome(family, seed, verdict, message, scene.seconds, scene.unconverged, told, scene.program())


def row(family: str, outcomes: list[Outcome]) -> list[str]:
    """Of the table: counts, and times of steps [ms]."""
    counts = [sum(o.verdict == v for o in outcomes) for v in VERDICTS]
    steps = np.concatenate([o.seconds for o in outcomes] + [[0.0]]) * 1e3
    times = [np.percentile(steps, 50), np.percentile(steps, 99), np.percentile(steps, 99.9), steps.max()]
    unconverged = sum(o.unconverged for o in outcomes)
    return [family, str(len(outcomes)), *map(str, counts), str(unconverged), *(f"{t:.3g}" for t in times)]


HEAD = ["family", "scenes", *VERDICTS, "unconverged steps", "p50 ms", "p99", "p99.9", "worst"]


def table(outcomes: list[Outcome]) -> str:
    """A row for each family, and one for all."""
    names = list(dict.fromkeys(o.family for o in outcomes))
    rows = [row(name, [o for o in outcomes if o.family == name]) for name in names]
    lines = [HEAD, ["---"] * len(HEAD), *rows, row("all", outcomes)]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def main(arguments=None):
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--family", nargs="+", choices=sorted(FAMILIES), default=list(FAMILIES))
    parser.add_argument("--seeds", nargs=2, type=int, default=(0, 10), metavar=("A", "B"), help="A ... B-1")
    parser.add_argument("--steps", type=int, default=240)
    parser.add_argument("--limit", type=float, default=None, help="processor time of a scene [s]")
    parser.add_argument("--time-budget", type=float, default=None, help="of a step, SolverOptions [s]")
    parser.add_argument("--integrator", default=None, help="SolverOptions")
    parser.add_argument("--program", action="store_true", help="print each wrong scene as a script")
    parser.add_argument("--folder", type=Path, help="keep these scripts here, as FAMILY_SEED.py")
    parser.add_argument("--processes", type=int, help="run scenes in so many processes")
    parser.add_argument("--file", type=Path, help="keep all outcomes here, and go on from there (bt.sweep)")
    chosen = parser.parse_args(arguments)
    options = {"time_budget": chosen.time_budget, "integrator": chosen.integrator}
    options = {name: value for name, value in options.items() if value is not None}
    options = {"steps": chosen.steps, "limit": chosen.limit, **options}
    seeds = range(*chosen.seeds)
    cases = [{"family": family, "seed": seed, **options} for family in chosen.family for seed in seeds]
    outcomes = bt.sweep(run_case, cases, executor=chosen.processes, file=chosen.file)
    outcomes = [Outcome(**outcome) for outcome in outcomes]
    for outcome in outcomes:
        report(outcome, chosen)
    print(table(outcomes))


def run_case(case: dict, rng) -> dict:
    """A scene's outcome, for a sweep; its random numbers are those of its own seed."""
    return vars(run(**case))


def report(outcome: Outcome, chosen):
    if outcome.verdict == "refused":
        print(f"{outcome.family} {outcome.seed} refused: {outcome.message}")
    if outcome.verdict in ("wrong", "stopped"):
        worst = 1e3 * max(outcome.seconds, default=0)
        done = f"{len(outcome.seconds)} steps, {outcome.unconverged} unconverged, worst {worst:.3g} ms"
        print(f"{outcome.family} {outcome.seed} {outcome.verdict} ({done}): {outcome.message}", flush=True)
        if chosen.program:
            print(outcome.program)
        if chosen.folder is not None:
            chosen.folder.mkdir(exist_ok=True)
            note = f"# {outcome.family} {outcome.seed}: " + outcome.message.replace("\n", "\n# ") + "\n"
            (chosen.folder / f"{outcome.family}_{outcome.seed}.py").write_text(note + outcome.program)


if __name__ == "__main__":
    main()
