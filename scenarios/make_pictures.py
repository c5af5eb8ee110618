"""Makes the pictures of the READMEs anew, and tells which are older than what they are drawn from.

python -m bullet_tendon.scenarios.make_pictures                  all, some minutes
python -m bullet_tendon.scenarios.make_pictures wrap_condyle     single ones

A picture carries a stamp: a hash of the code (without comments and docstrings) of its scenario or task, and
of figures.py, which lays pictures out. What many scenarios share is left out, because it changes often
and pictures seldom with it. Scenarios run in an empty folder, so that they show the project's own bones.

A picture of a benchmark is drawn from the record that the benchmark wrote (harness.record_file), in a second.
Its stamp is a hash of the record, of the benchmark's code, and of harness.py, which draws it.
"""

import argparse
import ast
import contextlib
import hashlib
import json
import os
import struct
import sys
import tempfile
import zlib
from pathlib import Path

from bullet_tendon.scenarios import runner
from bullet_tendon.scenarios.benchmarks import harness

from bullet_tendon import errors, view

FOLDER = Path(__file__).resolve().parent / "pictures"
SCENARIOS = (
    "acl_reconstruction",
    "graft_passage",
    "super_elasticity",
    "tendon_finger",
    "tunnel_placement",
    "wrap_condyle",
)
BENCHMARKS = ("coupling", "haptic", "multibody", "work_precision")
TASKS = {  # and the modules that their pictures come from, beside those of all tasks
    "GraftPassage": ("graft_passage",),
    "GraftTension": ("graft_tension", "knee_task"),
    "KnotTie": ("knot_tie",),
    "PulleyLift": ("pulley_lift",),
    "TendonFinger": ("tendon_finger",),
    "TunnelPlacement": ("tunnel_placement", "knee_task"),
    "learning": ("search",),
}
KEYWORD = b"bullet_tendon"


def main(arguments: list[str] | None = None) -> int:
    """The command line. Returns the exit status: 0, or 2 for bad usage."""
    parser = argparse.ArgumentParser(f"python -m {__package__}.make_pictures", description="Makes pictures.")
    parser.add_argument("names", nargs="*", help="of scenarios, tasks and benchmarks; without one: all")
    known = *SCENARIOS, *TASKS, *BENCHMARKS
    names = parser.parse_args(arguments).names or known
    unknown = sorted(set(names) - set(known))
    if unknown:
        parser.error(f"unknown {', '.join(unknown)}; known: {', '.join(known)}")
    for name in names:
        try:
            make(name, FOLDER / f"{name}.png")
        except errors.InvalidValue as problem:
            parser.error(str(problem))
        print(FOLDER / f"{name}.png")
    return 0


def make(name: str, path: Path) -> None:
    """Draw one picture into a file, with its stamp."""
    with tempfile.TemporaryDirectory() as folder, _inside(folder):
        if name in BENCHMARKS:
            harness.draw("it.png", harness.known()[name].panels(harness.read_record(name)))
        elif name in TASKS:
            _draw_task(name)
        else:
            runner.run(runner.known()[name], runner.Options(picture=True), view.progress, "it.png")
        drawn = Path("it.png").read_bytes()
    path.write_bytes(_stamped(drawn, digest(name)))


def _draw_task(name: str) -> None:
    """An episode of a task's expert, or the learning curves."""
    from bullet_tendon.scenarios.tasks.__main__ import draw_episode, draw_learning  # needs gymnasium

    if name == "learning":
        draw_learning("it.png")
    else:
        draw_episode("it.png", name, "expert", 0)


def digest(name: str) -> str:
    """A hash of what a picture comes from: code, and the record of a benchmark."""
    here = Path(__file__).resolve().parent
    total = hashlib.sha256()
    if name in BENCHMARKS:
        files = [here / "benchmarks" / f"{module}.py" for module in (name, "harness")]
        total.update(json.dumps(harness.read_record(name)).encode())
    elif name in TASKS:
        files = [here / "tasks" / f"{module}.py" for module in TASKS[name]]
    else:
        files = [here / f"{name}.py", Path(view.__file__).with_name("figures.py")]
    for file in files:
        total.update(_code(file.read_text(encoding="utf-8")).encode())
    return total.hexdigest()[:16]


def stamp(path: Path) -> str:
    """The stamp of a picture; "" of one without."""
    for kind, body in _chunks(path.read_bytes()):
        if kind == b"tEXt" and body.startswith(KEYWORD + b"\0"):
            return body.partition(b"\0")[2].decode()
    return ""


def _code(text: str) -> str:
    """Python code without comments, docstrings and layout."""
    tree = ast.parse(text)
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef)) and ast.get_docstring(node):
            node.body = body[1:]
    return ast.dump(tree)


def _chunks(data: bytes):
    """Kind and body of the parts of a PNG file."""
    at = 8
    while at < len(data):
        (length,) = struct.unpack(">I", data[at : at + 4])
        yield data[at + 4 : at + 8], data[at + 8 : at + 8 + length]
        at += 12 + length


def _stamped(data: bytes, text: str) -> bytes:
    """A PNG file with a text before its end."""
    body = b"tEXt" + KEYWORD + b"\0" + text.encode()
    chunk = struct.pack(">I", len(body) - 4) + body + struct.pack(">I", zlib.crc32(body))
    return data[:-12] + chunk + data[-12:]


@contextlib.contextmanager
def _inside(folder: str):
    """With this working directory (contextlib.chdir came with Python 3.11)."""
    before = os.getcwd()
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(before)


if __name__ == "__main__":
    sys.exit(main())
