"""Runs episodes of a task by a policy, or searches a policy: see README.md.

python -m bullet_tendon.scenarios.tasks                                   lists the tasks
python -m bullet_tendon.scenarios.tasks GraftPassage --policy expert --episodes 100 --picture passage.png
python -m bullet_tendon.scenarios.tasks GraftPassage --train graft_passage.npz --minutes 10
"""

import argparse
import dataclasses
import itertools
import json
import sys
from importlib.resources import files
from time import perf_counter

import gymnasium
import numpy as np
from bullet_tendon.scenarios.scene import REPLAY_FRAMES, placed

from bullet_tendon import Recorder, Recording, errors, framing, view

from . import TASKS
from .episodes import Episode, evaluate, run_episode
from .policies import POLICIES, make_policy, module_of
from .search import search
from .task import Task

MOMENTS = 5  # of an episode, in a picture
PIXELS = 640  # edge of a square with the area of their images
BONE_OPACITY = 0.4  # in them


def main(arguments: list[str] | None = None) -> int:
    """The command line. Returns the exit status: 0, or 2 for bad usage."""
    parser = _parser()
    wanted = parser.parse_args(arguments)
    if wanted.name is None:
        _list()
        return 0
    if wanted.name not in TASKS:
        parser.error(f"unknown task {wanted.name!r}; known: {', '.join(TASKS)}")
    try:
        if wanted.train:
            _train(wanted)
        else:
            _evaluate(wanted)
    except (errors.MissingExtra, errors.InvalidValue) as problem:
        parser.error(str(problem))
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("python -m bullet_tendon.scenarios.tasks", description="Runs a task.")
    parser.add_argument("name", nargs="?", help="of the task; without one, all are listed")
    parser.add_argument("--policy", choices=POLICIES, default="expert", help="default: %(default)s")
    parser.add_argument("--episodes", type=int, default=10, help="how many (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="of the first episode, or of the search")
    parser.add_argument("--processes", type=int, help="that run episodes (default: this one; 2 to train)")
    parser.add_argument("--picture", metavar="FILE", default="", help="draw the first episode into FILE")
    parser.add_argument(
        "--replay", metavar="FILE.html", default="", help="write a replay of the first episode"
    )
    parser.add_argument(
        "--json", metavar="FILE", nargs="?", const="-", help="write the outcomes to FILE, or print them"
    )
    parser.add_argument("--train", metavar="FILE", default="", help="search a policy, and write it to FILE")
    parser.add_argument("--minutes", type=float, default=10, help="for the search (default: %(default)s)")
    return parser


def _list() -> None:
    width = max(map(len, TASKS))
    for name in TASKS:
        print(f"{name:{width}}  {(module_of(name).__doc__ or '').partition(chr(10))[0]}")


def _train(wanted) -> None:
    found = search(wanted.name, wanted.minutes, wanted.processes or 2, wanted.seed)
    np.savez(wanted.train, **found)
    seconds, spent, episodes, reward, success = found["curve"][-1]
    print(f"{wanted.name}: {episodes:.0f} episodes in {seconds:.0f} s, {spent:.0f} s of processor time")
    print(f"last test: mean reward {reward:.3g}, {100 * success:.0f} % successes; written to {wanted.train}")


def _evaluate(wanted) -> None:
    seeds = range(wanted.seed, wanted.seed + wanted.episodes)
    start = perf_counter()
    episodes = evaluate(wanted.name, wanted.policy, seeds, wanted.processes)
    record = _record(wanted, episodes, perf_counter() - start)
    print(_sentence(record), file=sys.stderr if wanted.json == "-" else sys.stdout)
    if wanted.json:
        text = json.dumps(record, indent=2)
        if wanted.json == "-":
            print(text)
        else:
            with open(wanted.json, "w", encoding="utf-8") as file:
                file.write(text + "\n")
    if wanted.picture:
        draw_episode(wanted.picture, wanted.name, wanted.policy, wanted.seed)
    if wanted.replay:
        record_episode(wanted.name, wanted.policy, wanted.seed).save(wanted.replay)


def _record(wanted, episodes: list[Episode], seconds: float) -> dict:
    return {
        "task": wanted.name,
        "policy": wanted.policy,
        "first_seed": wanted.seed,
        "success": float(np.mean([episode.success for episode in episodes])),
        "reward": float(np.mean([episode.reward for episode in episodes])),
        "seconds": seconds,
        "episodes": [episode._asdict() for episode in episodes],
    }


def _sentence(record: dict) -> str:
    count, share = len(record["episodes"]), 100 * record["success"]
    return (
        f"{record['task']}, {record['policy']}: {count} episodes, {share:.0f} % successes, "
        f"mean reward {record['reward']:.3g}, {record['seconds']:.1f} s"
    )


def draw_episode(path: str, task: str, policy: str, seed: int) -> None:
    """A picture of an episode: images of moments, the last one also from near, above the reward so far.

    From near is where tendons touch something. Needs the extra `view`.
    """
    rewards: list[float] = []
    recording = record_episode(task, policy, seed, lambda _, reward: rewards.append(reward))
    last = len(rewards) - 1
    points = framing.surroundings(recording, recording.camera)
    aspect = framing.proportions(points, recording.camera)
    size = {"width": round(PIXELS * aspect**0.5), "height": round(PIXELS / aspect**0.5)}
    whole = {**framing.fitted(points, recording.camera, aspect), **size}
    shots = [(moment, "", whole) for moment in np.unique(np.linspace(0, last, MOMENTS).astype(int)).tolist()]
    near = framing.closeup(recording, recording.camera, aspect)
    if near is not None:
        shots.append((last, ", closer", {**near, **size}))
    shown: list[tuple] = []
    steps = itertools.count()

    def look(env, _) -> None:
        step = next(steps)
        for title, camera in [shot[1:] for shot in shots if shot[0] == step]:
            time = step / env.unwrapped.metadata["render_fps"]
            shown.append((f"{time:.1f} s{title}", _image(env.unwrapped, camera)))

    with gymnasium.make(f"{__package__}:bullet_tendon/{task}-v0") as env:
        run_episode(env, make_policy(policy, task, np.random.default_rng(seed)), seed, look)
        times = np.arange(len(rewards)) / env.unwrapped.metadata["render_fps"]
    curve = {"x": times, "y": np.array(rewards), "label": "reward so far"}
    view.figure(path, shown, [curve], xlabel="time [s]", ylabel="reward so far", title=f"{task}, {policy}")


def _image(task: Task, camera: dict) -> np.ndarray:
    """(height, width, 3) uint8 of a task now, with bones one can look into."""
    tunnels = [placed(tunnel, task.client) for tunnel in task.world.tunnels]
    lines, colors = task.lines()
    return view.render_scene(task.client, camera, task.bones, lines, tunnels, BONE_OPACITY, colors)


def draw_learning(path: str) -> None:
    """A picture of how the shipped policies were found: rewards of tests against processor time."""
    curves = []
    for task, (module, _) in TASKS.items():
        file = files(__package__).joinpath(f"{module}.npz")
        if not file.is_file():
            continue
        with file.open("rb") as stream, np.load(stream) as data:
            _, spent, _, reward, success = data["curve"].T
        label = f"{task}: {100 * success[-1]:.0f} % succeed"
        gain = 100 * (reward - reward[0]) / np.abs(reward[0])
        curves.append({"x": spent, "y": gain, "label": label, "marker": "o"})
    view.figure(
        path,
        (),
        curves,
        xlabel="processor time of all episodes [s]",
        ylabel="mean reward beyond that of the fit [%]",
        title="Learning: the fit to the expert, then CMA-ES",
    )


def record_episode(task: str, policy: str, seed: int, watch=None) -> Recording:
    """A recording of an episode, for a replay (needs the extra `replay`); watch: see episodes.run_episode.

    Its camera sees the whole scene.
    """
    with gymnasium.make(f"{__package__}:bullet_tendon/{task}-v0") as env:
        env.reset(seed=seed)  # so that the recording begins where the episode does
        scene = env.unwrapped
        told = {"camera": scene.camera, "title": f"{task}, {policy}", "most_frames": REPLAY_FRAMES}
        with Recorder(scene.world, every=1, **told) as recorder:
            run_episode(env, make_policy(policy, task, np.random.default_rng(seed)), seed, watch)
        found = recorder.recording
        return dataclasses.replace(found, camera=framing.overview(found, scene.camera))


if __name__ == "__main__":
    sys.exit(main())
