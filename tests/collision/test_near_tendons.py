"""Segments of tendons that could touch are found however tendons move, and whatever was searched before."""

import contextlib
from itertools import combinations_with_replacement

import numpy as np
import pytest
from brute_force import segment_segments
from hypothesis import given, settings
from hypothesis import strategies as st

import bullet_tendon as bt
from bullet_tendon import _core

RADIUS = 0.002  # m
TIMES = np.linspace(0.0, 1.0, 9)


def line(start, end, count):
    return np.linspace(start, end, count)


def helix(count, phase=0.0, radius=0.02, turns=4.0, height=0.1):
    angle = 2 * np.pi * turns * np.linspace(0, 1, count) + phase
    return np.c_[radius * np.cos(angle), radius * np.sin(angle), np.linspace(0, height, count)]


def wriggle(rng, count):
    steps = rng.normal(0, 1e-3, (count, 3)) + np.cumsum(rng.normal(0, 4e-4, (count, 3)), axis=0)
    return np.cumsum(steps, axis=0)


def trefoil(count):
    a = np.linspace(0, 5.9, count)
    return 0.004 * np.c_[np.sin(a) + 2 * np.sin(2 * a), np.cos(a) - 2 * np.cos(2 * a), np.sin(3 * a)]


def net():
    along = [line((0, y, 0), (0.1, y, 0), 40) for y in (0, 0.02)]
    return along + [line((x, -0.05, 0.006), (x, 0.05, 0.006), 40) for x in (0.03, 0.06)]


SCENES = {
    "net": lambda rng: net(),
    "helices": lambda rng: [helix(60, phase) for phase in (0.0, 2.1, 4.2)],
    "coil": lambda rng: [helix(150, turns=7.0, height=0.05)],
    "bundle": lambda rng: [line((0, 0.005 * k, 0), (0.08, 0.005 * k + 0.002, 0), 33) for k in range(4)],
    "tangle": lambda rng: [wriggle(rng, 50) for _ in range(3)],
    "knot": lambda rng: [trefoil(120)],
    "crowd": lambda rng: [line(*rng.uniform(x, x + 0.02, (2, 3)), 6) for x in rng.uniform(0, 0.03, (20, 3))],
}


def turned(x, axis, angle):
    """Points (n, 3) turned about their middle by Rodrigues' formula."""
    k, r = axis / np.linalg.norm(axis), x - x.mean(0)
    across = np.cross(k, r)
    return x.mean(0) + r + np.sin(angle) * across + (1 - np.cos(angle)) * np.cross(k, across)


def moved(rng, tendons, speed):
    """What tendons do in a step: all together, each by itself, turning, waving and trembling."""
    together = rng.normal(0, speed, 3)
    out = []
    for x in tendons:
        x = turned(x, rng.standard_normal(3), rng.normal(0, 10 * speed)) + together + rng.normal(0, speed, 3)
        wave = np.sin(rng.uniform(1, 20) * np.linspace(0, 1, len(x)) + rng.uniform(0, 6))
        out.append(x + np.outer(wave, rng.normal(0, speed, 3)) + rng.normal(0, 0.05 * speed, x.shape))
    return out


def will_touch(tendons, ahead):
    """Pairs (i, k, j, m) of segments that come within two radii of each other on their straight ways."""
    found = set()
    for i, p in enumerate(tendons):
        for j in range(i, len(tendons)):
            least = np.inf
            for t in TIMES:
                a, b = p + t * (ahead[i] - p), tendons[j] + t * (ahead[j] - tendons[j])
                least = np.minimum(least, segment_segments(a[:-1, None], a[1:, None], b[:-1], b[1:]))
            for k, m in np.argwhere(least < 2 * RADIUS):
                if i != j or k < m:
                    found.add((i, int(k), j, int(m)))
    return found


def is_joined(rest, k, m):
    return m - k <= 1 or rest[k + 1 : m].sum() < np.pi * RADIUS


def searcher(tendons):
    search = _core.testing.BroadPhase()
    for x in tendons:
        search.add(x, RADIUS)
    return search


def pairs_of(rows):
    return {tuple(row) for row in rows[:, :4].astype(int).tolist()}


def check(scene, seed, speed, steps, brute=True):
    rng = np.random.default_rng(seed)
    start = tendons = SCENES[scene](rng)
    rests = [np.linalg.norm(np.diff(x, axis=0), axis=1) for x in tendons]
    search = searcher(start)
    for step in range(steps):
        now = speed * (10 if step % 17 == 16 else 1)
        ahead = moved(rng, tendons, now)
        rows, _, _ = search.find(tendons, ahead, True)
        np.testing.assert_array_equal(rows, searcher(start).find(tendons, ahead, True)[0])
        if brute:
            for pair in will_touch(tendons, ahead) - pairs_of(rows):
                assert pair[0] == pair[2]
                if now > 3e-3:  # what turns far does not go straight, and comes no nearer to itself
                    continue
                assert is_joined(rests[pair[0]], pair[1], pair[3])
        tendons = ahead if rng.random() < 0.9 else moved(rng, tendons, speed)


@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("speed", [1e-5, 3e-4, 3e-3])
def test_nothing_that_will_touch_is_missed(scene, speed):
    check(scene, 1, speed, 6)


@pytest.mark.slow
@pytest.mark.parametrize("scene", SCENES)
@pytest.mark.parametrize("seed", range(40))
def test_lists_of_before_change_nothing_long(scene, seed):
    check(scene, seed, 10 ** np.random.default_rng(seed).uniform(-6, -2), 60, brute=seed % 10 == 0)


@settings(max_examples=25, deadline=None)
@given(scene=st.sampled_from(sorted(SCENES)), seed=st.integers(0, 2**32 - 1), power=st.floats(-6, -2))
def test_lists_of_before_change_nothing(scene, seed, power):
    """Lists that serve give the pairs that new ones give, and so do those that serve for one step."""
    check(scene, seed, 10**power, 25, brute=False)


def within_reach(x, y, x_ahead, y_ahead, off):
    """(k, m) whether segments could touch within the step, as far as distances tell; all motion is capped.

    off: by how much the distance may be off [m]; what touches within it counts if it is positive.
    """
    most, skins = 2 * 2 * RADIUS, 2 * 1.05 * RADIUS
    means = [(ahead - now).mean(0) for now, ahead in ((x, x_ahead), (y, y_ahead))]
    towards = min(most, np.linalg.norm(means[0] - means[1]))
    boxes = []
    for now, ahead, mean in ((x, x_ahead, means[0]), (y, y_ahead, means[1])):
        ends = np.stack([now[:-1], now[1:], (ahead - mean)[:-1], (ahead - mean)[1:]])
        boxes.append((ends.min(0), ends.max(0)))
    (low, high), (other_low, other_high) = boxes
    gap = np.maximum(low[:, None] - other_high, other_low - high[:, None]).max(-1)
    way, other_way = x_ahead - x, y_ahead - y
    moves = np.linalg.norm(way[:, None] - other_way, axis=-1)
    moves = np.maximum.reduce([moves[:-1, :-1], moves[1:, :-1], moves[:-1, 1:], moves[1:, 1:]])
    distance = segment_segments(x[:-1, None], x[1:, None], y[:-1], y[1:])
    return (gap < skins + towards + off) & (distance < skins + np.minimum(moves, most) + off)


class Drift:
    """Tendons that come and go by several radii, and turn and wave as they do, from step to step slowly."""

    def __init__(self, rng, tendons, steps):
        self.tendons = tendons
        self.shapes = []
        for x in tendons:
            wave = np.sin(rng.uniform(1, 12) * np.linspace(0, 1, len(x)) + rng.uniform(0, 6))
            way = 2 * RADIUS * (rng.standard_normal(3) + np.outer(wave, rng.standard_normal(3)))
            pace = rng.uniform(1, 8) / steps
            self.shapes.append((way, pace, rng.standard_normal(3), rng.normal(0, 0.05)))

    def at(self, step):
        out = []
        for x, (way, pace, axis, angle) in zip(self.tendons, self.shapes, strict=True):
            out.append(turned(x, axis, angle * np.sin(pace * step)) + np.sin(pace * step) * way)
        return out


def compare_with_brute_force(rng, scene, steps, foreseen):
    """All pairs of two tendons are those that brute force finds; of one tendon none of them is missed."""
    tendons = SCENES[scene](rng)
    search = searcher(tendons)
    rests = [np.linalg.norm(np.diff(x, axis=0), axis=1) for x in tendons]
    drift = Drift(rng, tendons, steps)
    parallel = 0.005 * 2 * RADIUS  # by which the points of nearly parallel segments are not the nearest
    found, collected, served = 0, 0, 0
    for step in range(steps):
        now = drift.at(step)
        ahead = drift.at(step + 1) if foreseen else now
        rows, searches, skipped = search.find(now, ahead, False)
        got = pairs_of(rows)
        found, collected, served = found + len(got), collected + searches, served + skipped
        for i, j in combinations_with_replacement(range(len(now)), 2):
            args = now[i], now[j], ahead[i], ahead[j]
            sure = {(i, int(k), j, int(m)) for k, m in np.argwhere(within_reach(*args, -parallel))}
            if i < j:
                possible = {(i, int(k), j, int(m)) for k, m in np.argwhere(within_reach(*args, 1e-12))}
                assert sure <= {pair for pair in got if pair[::2] == (i, j)} <= possible
                continue
            for _, k, _, m in sure - got:  # neighbours, and those along a straight stretch, cannot touch
                if k < m and not is_joined(rests[i], k, m):
                    stretch = now[i][k + 1 : m + 1]
                    arc = np.linalg.norm(np.diff(stretch, axis=0), axis=1).sum()
                    assert np.linalg.norm(stretch[-1] - stretch[0]) > 0.75 * arc
    return found, collected, served


@pytest.mark.parametrize("foreseen", [True, False])
@pytest.mark.parametrize("scene", ["net", "helices", "bundle", "knot"])
def test_lists_that_serve_leave_out_nothing_within_reach(scene, foreseen):
    """Tendons come together and part slowly, so that lists serve for several steps and then run out."""
    found, collected, served = compare_with_brute_force(np.random.default_rng(3), scene, 30, foreseen)
    assert found > 100
    assert collected > len(SCENES[scene](np.random.default_rng(3)))
    assert served > 0


@settings(max_examples=8, deadline=None)
@given(
    scene=st.sampled_from(sorted(SCENES.keys() - {"tangle"})),  # which is laid through itself
    seed=st.integers(0, 2**32 - 1),
    steps=st.integers(8, 24),
    foreseen=st.booleans(),
)
def test_random_drift_leaves_out_nothing_within_reach(scene, seed, steps, foreseen):
    compare_with_brute_force(np.random.default_rng(seed), scene, steps, foreseen)


@pytest.mark.parametrize("scene", ["net", "helices", "coil", "bundle"])
def test_lists_of_what_moves_together_serve(scene):
    """At 1 m/s, and trembling; then one comes near."""
    rng = np.random.default_rng(0)
    tendons = SCENES[scene](rng)
    search = searcher(tendons)
    made = []
    for step in range(40):
        ahead = [x + [2e-3, 3e-3, 2e-3] + rng.normal(0, 1e-6, x.shape) for x in tendons]
        rows, searches, skipped = search.find(tendons, ahead, True)
        made.append(searches)
        assert len(rows) == 0
        assert step == 0 or skipped == len(tendons) * (len(tendons) + 1) // 2
        tendons = ahead
    assert made[0] > 0
    assert sum(made[1:]) == 0
    tendons[-1] = tendons[0] + [0, 0, 1.9 * RADIUS] if len(tendons) > 1 else 0.2 * tendons[-1]
    rows, searches, _ = search.find(tendons, tendons, True)
    assert searches > 0
    assert len(rows) > 0


def test_what_is_paid_out_can_touch():
    """Neighbours along a tendon do not touch, however they lie, until there is as much of it between them."""
    angle = np.linspace(0, 5.5, 24)
    loop = 1.3 * RADIUS * np.c_[np.cos(angle), np.sin(angle), 0.05 * angle]
    search = searcher([loop])
    rest = np.linalg.norm(np.diff(loop, axis=0), axis=1)
    counts = []
    for share in (1.0, 0.1, 1.0):
        search.set_rest(0, share * rest)
        counts.append(len(search.find([loop], [loop], True)[0]))
        assert len(search.find([loop], [loop], True)[0]) == counts[-1]
    assert counts[1] == 0 < counts[0] == counts[2]


def test_world_searches_again_after_a_jump(make_world):
    """Positions set from outside, and states put back, are motion like any other."""
    world = make_world()
    material = bt.Material(stiffness=1e3)
    first = world.add_tendon(line((0, 0, 0), (0.1, 0, 0), 20), RADIUS, material, 20)
    world.add_tendon(line((0.05, -0.05, 0.03), (0.05, 0.05, 0.03), 20), RADIUS, material, 20)
    world.step(3)
    assert world.report.counts["tendon_searches"] == 0
    assert world.report.counts["tendon_searches_skipped"] == 3
    apart = world.save_state()
    first.set_positions(first.positions + [0, 0, 0.03 - 2.05 * RADIUS])
    world.step()
    assert len(world.contacts) > 0
    touching = world.save_state()
    world.restore_state(apart)
    world.step()
    assert len(world.contacts) == 0
    world.restore_state(touching)
    world.step()
    assert len(world.contacts) > 0


def test_a_straight_tendon_is_not_searched_for_contacts_with_itself(make_world):
    """A hand leads one end about, by many times the margin of a list of candidates."""
    world = make_world(1 / 240)
    t = world.add_tendon([[0, 0, 0], [0.2, 0, 0]], RADIUS, bt.Material(stiffness=1e3), 40)
    t.grip(0)
    hand = t.grip(-1)
    searched = 0
    for k in range(60):
        hand.target = (0.21, 0.03 * np.sin(0.1 * k), 0.03 * np.cos(0.1 * k))
        world.step()
        searched += world.report.counts["tendon_searches"]
    assert searched == 0


@pytest.mark.parametrize("speed", [1e100, 1e160, 1e300])
def test_predictions_beyond_squares_search_no_segment_that_is_not_there(make_world, speed):
    """Tendons of 11 segments, whose hierarchies have 16 leaves, and speeds whose squares are not finite."""
    world = make_world()
    for k in range(2):
        t = world.add_tendon([[0, 0.01 * k, 0], [0.1, 0.01 * k, 0]], 1e-3, bt.Material(stiffness=1e3), 12)
        t.set_positions(t.positions, np.full((12, 3), (-1) ** k * speed))
    for _ in range(3):
        with contextlib.suppress(bt.StepFailed):
            world.step()
        assert all(np.isfinite(t.positions).all() for t in world.tendons)
