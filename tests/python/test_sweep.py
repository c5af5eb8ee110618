"""sweep: the same results on every executor, in order, resumed where it was killed."""

import concurrent.futures
import hashlib
import json
import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pybullet as p
import pytest

import bullet_tendon as bt

COUNT = 200


def swing(case, rng):
    """A tendon that swings for five steps from a random start: its state, bit by bit."""
    client = p.connect(p.DIRECT)
    try:
        p.setGravity(0, 0, -9.81, client)
        world = bt.TendonWorld(client)
        points = [(0, 0, 0), case["length"] * (rng.random(3) + 0.1)]
        tendon = world.add_tendon(points, 0.002, bt.Material(stiffness=1e3), 6)
        tendon.grip(0)
        world.step(5)
        return hashlib.sha256(tendon.positions.tobytes()).hexdigest()
    finally:
        p.disconnect(client)


CASES = [{"length": 0.05 + 0.001 * k} for k in range(COUNT)]


@pytest.fixture(scope="module")
def serial():
    return bt.sweep(swing, CASES, seed=3, progress=False)


def draw(case, rng):
    return case, float(rng.random())


def fail_at(case, rng):
    if case == 5:
        raise bt.InvalidValue("case", case, "another one")  # cannot be unpickled
    return case


def log_and_wait(case, rng):
    path, number = case
    time.sleep(0.03)
    with open(path, "a") as file:
        file.write(f"{number}\n")
    return number * rng.random()


def give_lambda(case, rng):
    return lambda: case


def die(case, rng):
    os._exit(1)


def test_seeds_are_those_of_spawn():
    children = np.random.SeedSequence(7).spawn(4)
    expected = [("abcd"[k], np.random.default_rng(child).random()) for k, child in enumerate(children)]
    assert bt.sweep(draw, list("abcd"), seed=7, progress=False) == expected


def test_cases_differ_and_seeds_change_them(serial):
    assert len(set(serial)) == COUNT
    assert bt.sweep(swing, CASES[:3], seed=4, progress=False) != serial[:3]


@pytest.mark.parametrize("count", [1, 2])
def test_processes_give_the_same(serial, count):
    cases = CASES if count == 2 else CASES[:20]
    assert bt.sweep(swing, cases, executor=count, seed=3, progress=False) == serial[: len(cases)]


def test_no_more_processes_are_started_than_there_are_cases(serial):
    assert bt.sweep(swing, CASES[:1], executor=10**30, seed=3, progress=False) == serial[:1]
    assert bt.sweep(swing, [], executor=10**30, progress=False) == []


def test_threads_give_the_same_and_stay_open(serial):
    with concurrent.futures.ThreadPoolExecutor(3) as pool:
        assert bt.sweep(swing, CASES, executor=pool, seed=3, progress=False) == serial
        assert pool.submit(len, "ab").result() == 2


def test_an_unordered_map_gives_the_same(serial):
    with multiprocessing.get_context("spawn").Pool(2) as pool:
        assert bt.sweep(swing, CASES, executor=pool.imap_unordered, seed=3, progress=False) == serial


def test_loky_gives_the_same(serial):
    loky = pytest.importorskip("loky")
    with loky.get_reusable_executor(2) as pool:
        assert bt.sweep(swing, CASES, executor=pool, seed=3, progress=False) == serial


@pytest.fixture(scope="module")
def dask_client():
    distributed = pytest.importorskip("distributed")
    options = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": None}
    with distributed.LocalCluster(**options) as cluster, distributed.Client(cluster) as client:
        yield client


def test_dask_gives_the_same(serial, dask_client):
    with dask_client.get_executor() as pool:
        assert bt.sweep(swing, CASES, executor=pool, seed=3, progress=False) == serial


def test_a_client_of_dask_is_refused_with_what_to_write(dask_client):
    with pytest.raises(bt.InvalidType, match="get_executor"):
        bt.sweep(swing, CASES, executor=dask_client)


MPI_PROGRAM = """
import json, sys
import bullet_tendon as bt
import test_sweep
from mpi4py.futures import MPIPoolExecutor

if __name__ == "__main__":
    with MPIPoolExecutor(path=sys.path) as pool:
        found = bt.sweep(test_sweep.swing, test_sweep.CASES, executor=pool, seed=3, progress=False)
    print(json.dumps(found))
"""


def import_path():
    """The environment of a program that finds what this process finds."""
    return {**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}


def test_mpi_gives_the_same(serial, tmp_path):
    pytest.importorskip("mpi4py")
    mpiexec = shutil.which("mpiexec", path=f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}")
    if mpiexec is None:
        pytest.skip("mpiexec is not installed")
    program = tmp_path / "program.py"
    program.write_text(MPI_PROGRAM)
    may = {"OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1"}
    command = [mpiexec, "-n", "3", sys.executable, "-m", "mpi4py.futures", str(program)]
    # Open MPI refuses more processes than cores by default, MPICH does not know the option.
    if (
        "Open MPI"
        in subprocess.run([mpiexec, "--version"], capture_output=True, text=True, check=True).stdout
    ):
        command.insert(1, "--oversubscribe")
    done = subprocess.run(command, capture_output=True, text=True, env={**import_path(), **may}, timeout=120)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout.splitlines()[-1]) == serial


@pytest.mark.parametrize("executor", [None, 2])
def test_an_error_names_its_case_and_shows_where(executor):
    with pytest.raises(bt.CaseFailed, match=r"case 5 \(5\)") as failure:
        bt.sweep(fail_at, range(12), executor=executor, progress=False)
    assert "fail_at" in str(failure.value) and "must be another one" in str(failure.value)
    assert failure.value.index == 5 and failure.value.case == 5


def test_what_cannot_be_pickled_names_its_case():
    with pytest.raises(bt.CaseFailed, match="pickle"):
        bt.sweep(give_lambda, [1], executor=1, progress=False)
    with pytest.raises(bt.CaseFailed, match="pickle"):
        bt.sweep(lambda case, rng: case, [1], executor=1, progress=False)


def test_a_process_that_dies_is_told():
    with pytest.raises(bt.CaseFailed, match="terminated abruptly"):
        bt.sweep(die, [1, 2], executor=1, progress=False)


def test_finished_cases_are_in_the_file_after_a_failure(tmp_path):
    path = tmp_path / "sweep.jsonl"
    with pytest.raises(bt.CaseFailed):
        bt.sweep(fail_at, range(12), progress=False, file=path)
    lines = [json.loads(line) for line in path.read_text().splitlines()]
    assert lines[0] == {"function": "fail_at", "seed": 0}
    assert [(line["index"], line["case"], line["result"]) for line in lines[1:]] == [
        (k, k, k) for k in range(5)
    ]


@pytest.mark.parametrize("executor", [None, 2])
def test_a_killed_sweep_goes_on_and_repeats_nothing_finished(tmp_path, executor):
    path, log, count = tmp_path / "sweep.jsonl", tmp_path / "log.txt", 40
    cases = [(str(log), number) for number in range(count)]
    call = f"bt.sweep(test_sweep.log_and_wait, {cases!r}, executor={executor!r}, seed=2, file={str(path)!r})"
    script = tmp_path / "program.py"
    script.write_text(f"import bullet_tendon as bt, test_sweep\nif __name__ == '__main__':\n    {call}\n")
    running = subprocess.Popen(
        [sys.executable, str(script)], env=import_path(), start_new_session=True,
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    while running.poll() is None and not (path.exists() and path.read_bytes().count(b"\n") > 10):
        time.sleep(0.005)
    os.killpg(running.pid, signal.SIGKILL)
    running.wait()
    finished = path.read_bytes().count(b"\n") - 1
    assert 10 <= finished < count
    # As if it had been killed while it wrote a line.
    with open(path, "ab") as file:
        file.write(b'{"index": 3, "ca')
    log.unlink()
    found = bt.sweep(log_and_wait, cases, executor=executor, seed=2, file=path, progress=False)
    assert len(log.read_text().split()) == count - finished
    assert found == [
        k * np.random.default_rng(s).random() for k, s in enumerate(np.random.SeedSequence(2).spawn(count))
    ]
    again = bt.sweep(log_and_wait, cases, executor=executor, seed=2, file=path, progress=False)
    assert again == found and len(log.read_text().split()) == count - finished


def arrays(case, rng):
    return {"at": np.arange(3) * case["x"], "n": np.int64(2), "pair": (1, float("nan")), 5: True}


def test_results_are_the_same_fresh_and_from_the_file(tmp_path):
    path = tmp_path / "sweep.jsonl"
    cases = [{"x": np.float64(0.1)}, {"x": 1 / 3}]
    fresh = bt.sweep(arrays, cases, file=path, progress=False)
    known = bt.sweep(arrays, cases, file=path, progress=False)
    assert repr(fresh) == repr(known)
    assert fresh[1]["at"] == (np.arange(3) / 3).tolist() and list(fresh[0]) == ["at", "n", "pair", "5"]


def test_cases_may_be_added_but_not_changed(tmp_path):
    path = tmp_path / "sweep.jsonl"
    first = bt.sweep(draw, ["a", "b"], file=path, progress=False)
    assert bt.sweep(draw, ["a", "b", "c"], file=path, progress=False)[:2] == first
    before = path.read_bytes()
    for cases, seed, function in ((["a", "x", "c"], 0, draw), (["a", "b", "c"], 1, draw), (["a"], 0, draw),
                                  (["a", "b", "c"], 0, fail_at)):  # fmt: skip
        with pytest.raises(bt.InvalidValue, match="file of this sweep"):
            bt.sweep(function, cases, seed=seed, file=path, progress=False)
    assert path.read_bytes() == before


@pytest.mark.parametrize("text", ["my notes\n", "my notes", '{"a": 1}'])
def test_a_file_of_something_else_is_refused_and_kept(tmp_path, text):
    path = tmp_path / "notes.txt"
    path.write_text(text)
    with pytest.raises(bt.InvalidValue, match="line 1"):
        bt.sweep(draw, ["a"], file=path, progress=False)
    assert path.read_text() == text


def test_a_sweep_that_was_killed_in_its_first_line_starts_again(tmp_path):
    path = tmp_path / "sweep.jsonl"
    first = bt.sweep(draw, ["a"], file=path, progress=False)
    whole = path.read_bytes()
    for size in (0, 5):
        path.write_bytes(whole[:size])
        assert bt.sweep(draw, ["a"], file=path, progress=False) == first
        assert path.read_bytes() == whole


@pytest.mark.parametrize(
    ("changes", "argument"),
    [
        ({"function": 3}, "function"),
        ({"cases": 3}, "cases"),
        ({"cases": "abc"}, "cases"),
        ({"seed": -1}, "seed"),
        ({"seed": 0.5}, "seed"),
        ({"executor": 0}, "executor"),
        ({"executor": True}, "executor"),
        ({"executor": "dask"}, "executor"),
        ({"progress": 1}, "progress"),
        ({"file": 3}, "file"),
        ({"cases": [object()], "file": "sweep.jsonl"}, r"cases\[0\]"),
    ],
)
def test_bad_arguments_are_named(changes, argument, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    arguments = {"function": draw, "cases": ["a"], "progress": False, **changes}
    with pytest.raises(bt.TendonError, match=f"^{argument} = .*must be"):
        bt.sweep(arguments.pop("function"), arguments.pop("cases"), **arguments)
    assert not list(tmp_path.iterdir())


def test_no_cases_give_no_results(tmp_path):
    assert bt.sweep(draw, [], progress=False) == []
    assert bt.sweep(draw, iter([]), executor=2, progress=False, file=Path(tmp_path, "x.jsonl")) == []


def test_a_bar_counts_the_cases(capsys):
    pytest.importorskip("tqdm")
    bt.sweep(draw, ["a", "b"])
    assert "2/2" in capsys.readouterr().err
