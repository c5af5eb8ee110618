"""Mutation test of the suite: small faults go into the compiled core, one at a time. The tests have to fail.

    python tests/stress/mutants.py --count 40 --seed 1 [--rooms contact solver] [--json mutants.json]
    python tests/stress/mutants.py --only contact/contact.cpp:62:less_to_not_less [--folder build/mutants]

A copy of the checkout is built once. --folder keeps it for the next call, which compiles only what has
changed since. For each mutant the script compiles the changed file, links the core, and runs the tests until
one fails or takes longer than --test-seconds: first those that found other mutants, then those of its room,
then the others, the quick before the slow. A mutant that survives is printed with its line: either a test is
missing, or the mutant is equivalent, which has to be argued. At the end all tests that found a mutant run
without one. Needs g++, pybind11 and what the tests need.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import re
import shutil
import subprocess
import sys
import sysconfig
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
# Rooms whose code runs in every step of some scene.
HOT_ROOMS = ("tendon", "bodies", "collision", "contact", "integrator", "solver", "world")
# Files that only translate, validate or print.
UNKNOWN_SECONDS = 0.3  # of a test that has not run yet
SKIPPED = {"world/archive.h", "world/state_fields.h", "world/report.cpp"}

# Name, what is looked for, and what takes its place. Each changes one token of the code.
OPERATORS = [
    ("plus_to_minus", r" \+ ", " - "),
    ("minus_to_plus", r" - ", " + "),
    ("add_to_subtract", r" \+= ", " -= "),
    ("times_to_over", r"(?<=[\w)\]]) \* (?=[\w(])", " / "),
    ("less_to_not_less", r" < (?!.*>\()", " >= "),
    ("greater_to_not_greater", r" > ", " <= "),
    ("max_to_min", r"std::max\(", "std::min("),
    ("min_to_max", r"std::min\(", "std::max("),
    ("and_to_or", r" && ", " || "),
    ("or_to_and", r" \|\| ", " && "),
    ("true_to_false", r"\btrue\b", "false"),
    ("false_to_true", r"\bfalse\b", "true"),
    (
        "drop_statement",
        r"^(?P<indent> +)(?!return|const|auto|double|int|bool|Vec3)[\w.\[\]>-]+ [*+-]?= [^{}]*;$",
        r"\g<indent>;",
    ),
    ("drop_call", r"^(?P<indent> +)[a-z_]+\([^{}]*\);$", r"\g<indent>;"),
]


@dataclass
class Mutant:
    file: str  # below bullet_tendon/core
    line: int
    operator: str
    column: int
    before: str
    after: str
    result: str = ""  # "killed", "survived" or "does not build"
    test: str = ""  # the first that failed
    seconds: float = 0.0

    @property
    def name(self) -> str:
        return f"{self.file}:{self.line}:{self.operator}"


def mutants_of(path: Path) -> list[Mutant]:
    """All mutants of one source file: every operator at every place where it fits."""
    found = []
    for number, text in enumerate(path.read_text().splitlines(), 1):
        code = text.split("//")[0].rstrip()
        if (
            not code.strip()
            or re.match(r"\s*(#|template|using|constexpr|static_assert|for )", code)
            or '"' in code
        ):
            continue
        for name, pattern, by in OPERATORS:
            for match in re.finditer(pattern, code):
                after = code[: match.start()] + match.expand(by) + code[match.end() :]
                found.append(
                    Mutant(
                        str(path.relative_to(ROOT / "bullet_tendon/core")),
                        number,
                        name,
                        match.start(),
                        code,
                        after,
                    )
                )
    return found


def choose(rooms: list[str], count: int, seed: int) -> list[Mutant]:
    """`count` mutants, at most one a line; each room gets its share by the number of its lines."""
    every = []
    for room in rooms:
        for path in sorted((ROOT / "bullet_tendon/core" / room).glob("*.cpp")):
            if f"{room}/{path.name}" not in SKIPPED:
                every += mutants_of(path)
    random.Random(seed).shuffle(every)
    lines, chosen = set(), []
    for m in every:
        if (m.file, m.line) not in lines and len(chosen) < count:
            lines.add((m.file, m.line))
            chosen.append(m)
    return chosen


class Build:
    """An in-place build of a copy of the checkout that compiles only what has changed."""

    def __init__(self, folder: Path, jobs: int, test_seconds: float):
        import pybind11

        self.folder, self.jobs, self.test_seconds = folder, jobs, test_seconds
        self.trials = folder / "trials.txt"
        headers_changed = False
        shutil.rmtree(folder / "tests", ignore_errors=True)  # pytest would run what is tracked no more
        tracked = subprocess.run(
            ["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True
        ).stdout
        for name in tracked.split("\n"):
            if name and (ROOT / name).is_file():
                copy = folder / name
                if copy.is_file() and copy.read_bytes() == (ROOT / name).read_bytes():
                    continue
                copy.parent.mkdir(parents=True, exist_ok=True)
                shutil.copy(ROOT / name, copy)
                self.object_of(copy).unlink(missing_ok=True)
                headers_changed |= copy.suffix == ".h"
        for part in ("scenarios", "urdf"):  # as setup.py maps them into the package
            if not (folder / "bullet_tendon" / part).exists():
                os.symlink(folder / part, folder / "bullet_tendon" / part)
        self.flags = [
            "-std=c++17",
            "-O1",
            "-DNDEBUG",
            "-fPIC",
            "-fvisibility=hidden",
            "-fno-math-errno",
            "-fno-trapping-math",
        ]
        self.flags += ["-ffp-contract=off", "-I" + str(folder / "bullet_tendon/core")]
        self.flags += ["-I" + sysconfig.get_paths()["include"], "-I" + pybind11.get_include()]
        self.sources = [folder / n for n in tracked.split("\n") if re.match("bullet_tendon/core/.*cpp$", n)]
        self.outdated = [s for s in self.sources if headers_changed or not self.object_of(s).is_file()]
        self.module = folder / "bullet_tendon" / ("_core" + sysconfig.get_config_var("EXT_SUFFIX"))

    def object_of(self, source: Path) -> Path:
        return source.with_suffix(".o")

    def make(self, changed: list[Path]) -> bool:
        """Compiles `changed` and links. False: the compiler refuses it."""
        waiting, running, fine = list(changed), [], True
        while waiting or running:
            while waiting and len(running) < self.jobs:
                source = waiting.pop()
                command = ["g++", *self.flags, "-c", str(source), "-o", str(self.object_of(source))]
                running.append(subprocess.Popen(command, stderr=subprocess.DEVNULL))
            fine &= running.pop(0).wait() == 0
        objects = [str(self.object_of(s)) for s in self.sources]
        return fine and subprocess.run(["g++", "-shared", *objects, "-o", str(self.module)]).returncode == 0

    def first_failure(self, room: str, seconds: float) -> str:
        """Runs the tests of a room and those that found other mutants, then all others, until one fails."""
        files = {test.split("::")[0] for test in Trials(self.trials).kills}
        near = [f"tests/{room}", *sorted(f for f in files if (self.folder / f).is_file())]
        return self.run_tests(near, room, "near", seconds) or self.run_tests(["tests"], room, "far", seconds)

    def run_tests(self, tests: list[str], room: str, stage: str, seconds: float) -> str:
        """The last test that failed, or "" where all pass. At stage "all" a failure does not end the run."""
        limit = [f"faulthandler_timeout={self.test_seconds}", "faulthandler_exit_on_timeout=true"]
        command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--tb=no"]
        command += ["-o", limit[0], "-o", limit[1], "-p", "mutants", *["-x"] * (stage != "all"), *tests]
        environment = {
            **os.environ,
            "PYTHONPATH": os.pathsep.join([str(self.folder), str(self.folder / "tests/stress")]),
            "MUTANT_TRIALS": str(self.trials),
            "MUTANT_ROOM": f"tests/{room}/",
            "MUTANT_STAGE": stage,
        }
        try:
            code = subprocess.run(
                command, cwd=self.folder, env=environment, capture_output=True, timeout=seconds
            ).returncode
        except subprocess.TimeoutExpired:
            code = "timeout"
        if code in (0, 5):  # 5: no test was collected
            return ""
        failed = Trials(self.trials).last_failure
        return failed or f"exit code {code}"


class Trials:
    """What earlier runs showed about each test: its time, and how many mutants it found."""

    def __init__(self, file: Path):
        self.seconds: dict[str, float] = {}
        self.kills: dict[str, int] = {}
        self.last_failure = ""
        running = ""
        for entry in file.read_text().splitlines() if file.is_file() else []:
            what, seconds, test = entry.split(" ", 2)
            if what in ("start", "run") and running:  # the process ended within this test
                self._failed(running)
            running = test if what == "start" else ""
            if what == "run":
                self.last_failure = ""
            elif what == "failed":
                self._failed(test)
            elif what == "passed":
                self.seconds[test] = float(seconds)
        if running:
            self._failed(running)

    def _failed(self, test: str) -> None:
        self.kills[test] = self.kills.get(test, 0) + 1
        self.last_failure = test


# Hooks of pytest, for which this file is a plugin in the runs above. Tests that found most mutants come
# first, and the quick before the slow.


def _note(what: str, seconds: float, test: str) -> None:
    with open(os.environ["MUTANT_TRIALS"], "a") as file:
        file.write(f"{what} {seconds:.3f} {test}\n")


def pytest_collection_modifyitems(items):
    trials = Trials(Path(os.environ["MUTANT_TRIALS"]))
    room, stage = os.environ["MUTANT_ROOM"], os.environ["MUTANT_STAGE"]

    def is_near(item):
        return item.nodeid.startswith(room) or item.nodeid in trials.kills

    items[:] = [item for item in items if stage == "all" or is_near(item) == (stage == "near")]
    items.sort(
        key=lambda item: (
            -trials.kills.get(item.nodeid, 0),
            trials.seconds.get(item.nodeid, UNKNOWN_SECONDS),
        )
    )
    _note("run", 0, "-")


def pytest_runtest_logstart(nodeid, location):
    _note("start", 0, nodeid)


def pytest_runtest_logreport(report):
    if report.failed:
        _note("failed", report.duration, report.nodeid)
    elif report.when == "call" or report.skipped:
        _note("passed", report.duration, report.nodeid)


def judge(build: Build, mutant: Mutant, seconds: float) -> None:
    """Puts one mutant in, runs the tests, and takes it out again."""
    source = build.folder / "bullet_tendon/core" / mutant.file
    sound = build.object_of(source).read_bytes()
    text = source.read_text()
    lines = text.split("\n")
    lines[mutant.line - 1] = mutant.after
    start = time.monotonic()
    source.write_text("\n".join(lines))
    try:
        if not build.make([source]):
            mutant.result = "does not build"
            return
        mutant.test = build.first_failure(mutant.file.split("/")[0], seconds)
        mutant.result = "killed" if mutant.test else "survived"
    finally:
        source.write_text(text)
        build.object_of(source).write_bytes(sound)
        mutant.seconds = round(time.monotonic() - start, 1)


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--count", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--rooms", nargs="+", default=list(HOT_ROOMS), choices=HOT_ROOMS)
    parser.add_argument("--only", nargs="+", help="mutants by name: FILE:LINE:OPERATOR")
    parser.add_argument("--seconds", type=float, default=1200, help="limit of one run of tests")
    parser.add_argument("--test-seconds", type=float, default=300, help="limit of one test")
    parser.add_argument("--folder", type=Path, help="keeps the copy and its build here")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    mutants = choose(options.rooms, 10**9 if options.only else options.count, options.seed)
    if options.only:
        mutants = [m for m in mutants if m.name in options.only]
    with tempfile.TemporaryDirectory() as folder:
        build = Build((options.folder or Path(folder)).resolve(), options.jobs, options.test_seconds)
        if not build.make(build.outdated):
            raise SystemExit("the core does not build")
        for k, m in enumerate(mutants, 1):
            judge(build, m, options.seconds)
            print(f"{k}/{len(mutants)} {m.result:14s} {m.seconds:6.0f} s  {m.name}  {m.test}", flush=True)
            if m.result == "survived":
                print(f"    - {m.before.strip()}\n    + {m.after.strip()}", flush=True)
            if options.json:
                options.json.write_text(json.dumps([asdict(x) for x in mutants[:k]], indent=1))
        # A test that fails without any mutant as well has found none.
        build.make([])
        killers = sorted({m.test for m in mutants if "::" in m.test})
        if killers and (unsound := build.run_tests(killers, "", "all", options.seconds)):
            print(f"fails without a mutant: {unsound}")
    survived = sum(m.result == "survived" for m in mutants)
    built = sum(m.result != "does not build" for m in mutants)
    print(f"{built} mutants, {survived} survived")
    return int(survived > 0)


if __name__ == "__main__":
    sys.exit(main())
