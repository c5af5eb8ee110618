"""KnotTie: knots tied by the expert, by hands that do not tie one, and what is observed of crossings."""

import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium")

from bullet_tendon.scenarios import measure, overhand_knot, topology  # noqa: E402
from bullet_tendon.scenarios.tasks import TASKS, knot_tie  # noqa: E402
from task_runs import run  # noqa: E402

from bullet_tendon.errors import InvalidType, InvalidValue  # noqa: E402

HORIZON = TASKS["KnotTie"][1]


@pytest.fixture(scope="module")
def task():
    env = knot_tie.KnotTie()
    yield env
    env.close()


@pytest.mark.parametrize("mirrored", [False, True])
def test_expert_ties_a_trefoil_of_either_hand(task, mirrored):
    """A trefoil is told from its mirror image by the signs of its crossings, which are all equal."""
    for loop in range(2):
        seen, info, rewards, ended = run(task, knot_tie.expert, 40 + loop, mirrored=mirrored, loop=loop)
        assert info["is_success"] and ended
        assert topology.determinant(topology.closed_far(task.cord.positions)) == 3
        for grip in (task.hand, task.standing):
            assert np.linalg.norm(grip.force) == pytest.approx(20, rel=0.02)
        assert all(finger.released for finger in task.fingers)
        writhe = seen[93:117].reshape(8, 3)[:, 2].sum()
        assert abs(writhe) >= 3 and (writhe < 0) == mirrored
        assert sum(rewards) == pytest.approx(10 - 0.02 * len(rewards))


def test_pulling_at_once_ties_nothing(task):
    seen, info, rewards, ended = run(task, lambda _: [0, 0, 0, 1], 2)
    assert ended and not info["is_success"] and len(rewards) == 1
    assert np.linalg.norm(task.hand.force) == pytest.approx(20, rel=0.02)
    span = task.cord.positions[-1] - task.cord.positions[0]
    assert np.linalg.norm(span) == pytest.approx(0.36, rel=0.01)
    assert np.allclose(seen[93:117], 0)


def test_knot_has_to_be_pulled(task):
    """After all way-points of the expert, and as many more that lead nowhere, nothing is a success."""
    seen, _ = task.reset(seed=40, options={"loop": 0})
    action = [0, 0, 0, -1]
    for step in range(HORIZON):
        wanted = knot_tie.expert(seen)
        action = wanted if wanted[3] < 0 else action
        seen, _, ended, _, info = task.step(action)
        assert ended == (step == HORIZON - 1) == task.episode.is_pulled
        assert not info["is_success"] or ended
    assert np.linalg.norm(task.hand.force) == pytest.approx(20, rel=0.02)


def test_cord_never_passes_through_itself(task):
    """With the expert, and with a hand that wanders: the centreline's strands stay two radii apart."""
    rng = np.random.default_rng(2)
    for policy in (knot_tie.expert, lambda _: [*rng.uniform(-1, 1, 3), -1]):
        seen, _ = task.reset(seed=3)
        rest = measure.rest_lengths(task.cord)
        for _ in range(HORIZON):
            seen, _, ended, _, _ = task.step(policy(seen))
            assert task.world.report.converged
            x = task.cord.positions
            assert measure.with_itself(x, overhand_knot.NEIGHBOURS, rest) > 0.97 * 2 * overhand_knot.RADIUS
            if ended:
                break


def test_random_actions_tie_nothing(task):
    rng = np.random.default_rng(5)
    assert not any(run(task, lambda _: rng.uniform(-1, 1, 4), seed)[1]["is_success"] for seed in range(20))


def test_hand_is_limited_in_speed_and_force(task):
    task.reset(seed=6)
    start = task.hand.target
    task.step([1, 1, 1, -1])
    assert np.linalg.norm(task.cord.positions[-1] - start) <= 50 * 0.3 / 120 + 1e-6
    for _ in range(4):
        task.step([1, 1, 1, -1])
    assert np.linalg.norm(task.hand.force) == pytest.approx(20, rel=1e-3)
    assert task.hand.slipping


def test_observed_crossings_are_those_of_the_projection(task):
    """Against crossings that are found by intersecting all pairs of segments in the plane, one by one."""
    seen, _ = task.reset(seed=7)
    for _ in range(9):
        seen = task.step(knot_tie.expert(seen))[0]
    x = task.cord.positions
    found = []
    up = knot_tie.ABOVE / np.linalg.norm(knot_tie.ABOVE)
    for i in range(len(x) - 1):
        for j in range(i + 2, len(x) - 1):
            matrix = np.column_stack([x[i + 1] - x[i], x[j] - x[j + 1], up])
            u, w, height = np.linalg.solve(matrix, x[j] - x[i])  # x_i is moved up by height to meet x_j
            if 0 <= u < 1 and 0 <= w < 1:
                over, under = (i + u, j + w) if height < 0 else (j + w, i + u)
                upper, lower = (np.diff(x, axis=0)[int(at)] for at in (over, under))
                sign = np.sign(np.linalg.det(np.column_stack([upper, lower, up])))
                found.append((over / 90, under / 90, sign))
    expected = np.zeros((8, 3))
    expected[: len(found)] = sorted(found)
    assert len(found) >= 2
    assert np.allclose(seen[93:117].reshape(8, 3), expected, atol=1e-6)


def test_options_fix_what_is_random(task):
    seen, _ = task.reset(seed=1, options={"turn": 0.3, "mirrored": False, "loop": 0, "aside": (1, -1)})
    assert np.allclose(task.cord.positions[0], _turned(0.3) @ (-0.12, 0, 0) + (0.02, -0.02, 0))
    again, _ = task.reset(seed=2, options={"turn": 0.3, "mirrored": False, "loop": 0, "aside": (1, -1)})
    assert np.array_equal(seen, again)
    mirrored, _ = task.reset(seed=2, options={"turn": 0.0, "mirrored": True, "loop": 0, "aside": (0, 0)})
    plain, _ = task.reset(seed=2, options={"turn": 0.0, "mirrored": False, "loop": 0, "aside": (0, 0)})
    assert np.allclose(mirrored[:93].reshape(31, 3) * (1, -1, 1), plain[:93].reshape(31, 3), atol=1e-6)


def _turned(angle):
    return np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])


@pytest.mark.parametrize(
    ("options", "error"),
    [
        ({"turn": 1.0}, InvalidValue),
        ({"mirrored": 1}, InvalidType),
        ({"loop": 5}, InvalidValue),
        ({"aside": (0, 0, 0)}, InvalidValue),
    ],
)
def test_refused_options(task, options, error):
    with pytest.raises(error, match=next(iter(options))):
        task.reset(seed=0, options=options)
    assert task.observation_space.contains(task.reset(seed=0)[0])


@pytest.mark.slow
def test_expert_over_a_hundred_seeds(task):
    made = [run(task, knot_tie.expert, 9000 + seed)[1]["is_success"] for seed in range(100)]
    assert sum(made) >= 95
