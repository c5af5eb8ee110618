"""Gradient and Hessian of every energy term against central differences, at random states."""

import math

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

import bullet_tendon as bt
from bullet_tendon import _core

RANDOM = settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
SEEDS = st.integers(0, 2**32 - 1)
BONE, BORE, MOUTH = 0, 1, 2
ROUND, BALL = -1, -2  # bones whose surface is a cylinder, and a sphere
EXACT = 1e-6  # relative
REST, STIFFNESS = 0.02, 300.0
LAWS = {
    "linear": {},
    "1.5": {"exponent": 1.5},
    "square": {"exponent": 2.0},
    "cube": {"exponent": 3.0},
    "any": {"exponent": 2.3},
    "toe": {"exponent": 2.0, "toe_strain": 0.05},
    "tension only": {"exponent": 2.0, "tension_only": True},
    "ligament": {"exponent": 2.0, "toe_strain": 0.05, "tension_only": True},
    "linear, tension only": {"tension_only": True},
}


def slopes(function, x, step):
    """Derivatives of a number or an array by the entries of x: Richardson's central differences."""
    columns = []
    for k in range(x.size):

        def at(h, k=k):
            moved = x.astype(float).ravel()
            moved[k] += h
            return np.asarray(function(moved.reshape(x.shape)))

        coarse = (at(step) - at(-step)) / (2 * step)
        fine = (at(step / 2) - at(-step / 2)) / step
        columns.append((4 * fine - coarse) / 3)
    return np.stack(columns, axis=-1)


def agree(found, expected):
    """Within EXACT of the largest entry."""
    found = np.reshape(found, np.shape(expected))
    np.testing.assert_allclose(found, expected, rtol=0, atol=EXACT * np.abs(expected).max() + 1e-300)


def chain(world, n, **material):
    """n particles along x."""
    law = {"stiffness": STIFFNESS, **material}
    points = [[REST * k, 0, 0] for k in range(n)]
    return world.add_tendon(points, 1e-3, bt.Material(**law))


def crooked(random, n):
    """A chain with strains of both signs, none of them near a corner of a law (0 or the toe)."""
    strains = random.choice([-1, 1], n - 1) * random.uniform(0.08, 0.3, n - 1)
    edges = random.standard_normal((n - 1, 3)) + [1.5, 0, 0]
    edges *= (REST * (1 + strains) / np.linalg.norm(edges, axis=1))[:, None]
    return np.vstack([np.zeros(3), np.cumsum(edges, axis=0)])


def smooth(x, reach):
    """Whether springs of this reach are away from the corners of the laws."""
    strain = np.linalg.norm(x[reach:] - x[:-reach], axis=1) / (reach * REST) - 1
    corners = np.abs(np.subtract.outer(np.abs(strain), [0.0, 0.05]))
    return corners.min() > 1e-3


@pytest.mark.parametrize("shear", [False, True])
@pytest.mark.parametrize("law", LAWS)
@RANDOM
@given(seed=SEEDS)
def test_springs(make_world, law, shear, seed):
    random = np.random.default_rng(seed)
    t = chain(make_world(), 4, shear_stiffness=0.2 * STIFFNESS, **LAWS[law])
    x = crooked(random, 4)
    while not smooth(x, 2):
        x = crooked(random, 4)

    def term(at):
        return _core.testing.spring_term(t._core, t._slot, shear, at, at, 1.0)

    _, gradient, matrix = term(x)
    if np.abs(gradient).max() == 0:  # all compressed, and tension-only
        assert np.abs(matrix).max() == 0
        return
    agree(gradient, slopes(lambda at: term(at)[0], x, 1e-6))
    agree(matrix, slopes(lambda at: term(at)[1].ravel(), x, 1e-6))


@pytest.mark.parametrize("form", ["axial", "whole"])
@pytest.mark.parametrize("power", [1.0, 2.0, 1.5])
@RANDOM
@given(seed=SEEDS)
def test_damping(make_world, form, power, seed):
    """Its potential is C b l |r|^(q+1)/(q+1) a spring, with its strain rate or relative velocity / l."""
    random = np.random.default_rng(seed)
    damping, b = 3.0, 0.01
    t = chain(make_world(), 4, damping=damping, damping_exponent=power, damping_form=form)
    x = crooked(random, 4)
    before = x + REST * random.uniform(0.02, 0.1, (4, 1)) * random.standard_normal((4, 3))
    elastic = chain(make_world(), 4)
    lengths = np.linalg.norm(np.diff(before, axis=0), axis=1)
    rates = (np.linalg.norm(np.diff(x, axis=0), axis=1) - lengths) / (b * REST)
    if np.abs(rates).min() < 0.05:  # a corner of |r|^q
        return

    def potential(at):
        moved = np.diff(at - before, axis=0) / b
        speed = np.linalg.norm(moved, axis=1)
        if form == "axial":
            speed = np.abs(np.linalg.norm(np.diff(at, axis=0), axis=1) - lengths) / b
        return np.sum(damping * b * REST * (speed / REST) ** (power + 1) / (power + 1))

    def term(at):
        parts = zip(
            _core.testing.spring_term(t._core, t._slot, False, at, before, b)[1:],
            _core.testing.spring_term(elastic._core, elastic._slot, False, at, at, b)[1:],
            strict=True,
        )
        return [both - alone for both, alone in parts]

    gradient, matrix = term(x)
    agree(gradient, slopes(potential, x, 1e-6))
    agree(matrix, slopes(lambda at: term(at)[0].ravel(), x, 1e-6))


@pytest.mark.parametrize("clamps", [(), (0,), (0, -1)])
@RANDOM
@given(seed=SEEDS)
def test_bending(make_world, clamps, seed):
    random = np.random.default_rng(seed)
    t = chain(make_world(), 5, bending_stiffness=1e-3)
    for end in clamps:
        t.grip(end, direction=random.standard_normal(3) + [2, 0, 0])
    x = crooked(random, 5)

    def term(at):
        return _core.testing.bending_term(t._core, t._slot, at)

    _, gradient, matrix = term(x)
    agree(gradient, slopes(lambda at: term(at)[0], x, 1e-6))
    agree(matrix, slopes(lambda at: term(at)[1].ravel(), x, 1e-6))


@pytest.mark.parametrize("share", [0.3, 0.99, 1.01, 4.0])
@RANDOM
@given(seed=SEEDS)
def test_grip_with_a_force_limit(share, seed):
    """Below the limit its spring; beyond it a force of that size, towards the target."""
    random = np.random.default_rng(seed)
    k, most = 3e4, 7.0
    offset = share * most / k * unit(random)

    def term(x, slips=share > 1):
        return _core.testing.grip_term(k * x, most, slips, k)

    force, linearised, block = term(offset)
    np.testing.assert_allclose(force, min(1, 1 / share) * k * offset, rtol=1e-12)
    np.testing.assert_allclose(linearised, force, rtol=1e-12)
    agree(block, slopes(lambda x: term(x)[0], offset, 1e-3 * np.linalg.norm(offset)))
    assert np.linalg.eigvalsh(block).min() >= -1e-9 * k


def unit(random):
    vector = random.standard_normal(3)
    return vector / np.linalg.norm(vector)


def across(random, axis):
    """A random unit vector across an axis."""
    out = unit(random)
    out -= axis * (axis @ out)
    return out / np.linalg.norm(out)


def contact(random, kind, radius=0.005, offset=0.001, steep=0.0):
    """A contact of a kind around a random axis, and a position at a random depth [m].

    steep: slope of the plane of a mouth [-].
    """
    axis, place = unit(random), random.standard_normal(3) * 0.1
    out, slope = across(random, axis), steep * across(random, axis)
    depth = random.uniform(1e-4, 8e-4)
    normal = unit(random)
    x = {
        BONE: normal * (offset - depth) + np.cross(normal, unit(random)) * 0.01,
        BORE: place + out * (radius + depth) + axis * 0.02,
    }.get(kind)
    if kind == MOUTH:
        angle = random.uniform(0.2, 1.2)
        edge = place + radius * (out + slope @ out * axis)
        around = np.cross(axis, out) + slope @ np.cross(axis, out) * axis
        inwards = -out + out @ around * around / (around @ around)
        inwards /= np.linalg.norm(inwards)
        over = np.cross(inwards, around) / np.linalg.norm(around)
        x = edge + (offset - depth) * (math.cos(angle) * inwards + math.sin(angle) * over)
    stiffness, multiplier = 1e4, 3.0
    if kind in (ROUND, BALL):
        x = place + out * (radius - depth) + (axis * 0.02 if kind == ROUND else 0.0)
        kind, axis = BONE, axis if kind == ROUND else np.zeros(3)
    elif kind == BONE:
        radius = 0.0
    surface, smooth = (normal, offset, place, axis, radius, slope), (0.0, 0.0, np.zeros(3))

    def evaluate(at, definite=False):
        return _core.testing.contact_term(kind, at, *surface, stiffness, multiplier, *smooth, definite)

    return evaluate, x, stiffness, multiplier, (place, axis, radius, slope)


@pytest.mark.parametrize(
    ("kind", "steep"),
    [(BONE, 0.0), (ROUND, 0.0), (BALL, 0.0), (BORE, 0.0), (MOUTH, 0.0), (MOUTH, 0.7), (MOUTH, 2.0)],
)
@RANDOM
@given(seed=SEEDS)
def test_contacts(kind, steep, seed):
    """The potential is N^2/(2k). What is definite leaves out what is negative: across a mouth's edge, N/d."""
    random = np.random.default_rng(seed)
    evaluate, x, stiffness, multiplier, rim = contact(random, kind, steep=steep)

    def potential(at):
        return max(0.0, multiplier - stiffness * evaluate(at)[0]) ** 2 / (2 * stiffness)

    _, normal, force, block, _ = evaluate(x)
    assert np.linalg.norm(force) > multiplier
    agree(-np.array(force), slopes(potential, x, 1e-7))
    hessian = -slopes(lambda at: evaluate(at)[2], x, 1e-7)
    agree(block, hessian)
    if kind == ROUND:
        around = np.cross(normal, rim[1])
        hessian -= min(0.0, around @ hessian @ around) * np.outer(around, around)
    elif kind == BALL:
        hessian = (normal @ hessian @ normal) * np.outer(normal, normal)
    elif kind == MOUTH:
        tangent = tangent_beside(x, *rim)
        along = np.cross(tangent, normal)
        hessian -= min(0.0, tangent @ hessian @ tangent) * np.outer(tangent, tangent)
        distance = evaluate(x)[0] + 0.001
        hessian += np.linalg.norm(force) / distance * np.outer(along, along)
    agree(evaluate(x, definite=True)[3], hessian)


def tangent_beside(x, place, axis, radius, slope):
    """The unit tangent of a mouth's edge at its point nearest to x: where their distance does not change."""
    one = np.cross(axis, np.eye(3)[np.abs(axis).argmin()])
    one /= np.linalg.norm(one)
    other = np.cross(axis, one)

    def point(angle):
        out = np.cos(angle) * one + np.sin(angle) * other
        return place + radius * (out + slope @ out * axis)

    def tangent(angle):
        around = np.cos(angle) * other - np.sin(angle) * one
        return around + slope @ around * axis

    coarse = np.linspace(0, 2 * np.pi, 721)
    best = coarse[np.argmin([np.linalg.norm(x - point(angle)) for angle in coarse])]
    bracket = best - coarse[1], best + coarse[1]
    way = tangent(brentq(lambda angle: (x - point(angle)) @ tangent(angle), *bracket, xtol=1e-14))
    return way / np.linalg.norm(way)


STRAIGHT = np.zeros((2, 3))


def agree_on_a_segment(kind, ends, offset, rim, stiffness, multiplier, bend=STRAIGHT):
    """The contact of a segment with ends (6,): forces and block against the potential N^2/(2k)."""

    def term(at):
        return _core.testing.edge_term(kind, at[:3], at[3:], offset, *rim, stiffness, multiplier, False, bend)

    def potential(at):
        return max(0.0, multiplier - stiffness * term(at)[0]) ** 2 / (2 * stiffness)

    force = np.concatenate(term(ends)[1:3])
    assert np.linalg.norm(force) > 0
    agree(-force, slopes(potential, ends, 1e-7))
    agree(term(ends)[3], -slopes(lambda at: np.concatenate(term(at)[1:3]), ends, 1e-7))


@pytest.mark.parametrize("steep", [0.0, 0.7, 2.0])
@RANDOM
@given(seed=SEEDS)
def test_edges(steep, seed):
    """A segment across the edge of a mouth: its nearest point goes with it."""
    random = np.random.default_rng(seed)
    evaluate, x, stiffness, multiplier, rim = contact(random, MOUTH, steep=steep)
    around = tangent_beside(x, *rim)
    along = np.cross(evaluate(x)[1], around) + random.uniform(-0.5, 0.5) * around
    ends = np.concatenate([x - random.uniform(1e-3, 4e-3) * along, x + random.uniform(1e-3, 4e-3) * along])

    agree_on_a_segment(MOUTH, ends, 0.001, rim, stiffness, multiplier)
    bend = random.uniform(-1, 1, (2, 3)) * 0.2 * np.linalg.norm(ends[3:] - ends[:3])
    agree_on_a_segment(MOUTH, ends, 0.001, rim, stiffness, multiplier, bend)


def gap_through_mouth(start, end, steep):
    """Of a segment that passed through a mouth of radius 2.5 mm and keeps 2 mm from its edge [m]."""
    rim = np.zeros(3), np.array([0.0, 0, 1]), 2.5e-3, np.array([steep, 0, 0])
    return _core.testing.edge_term(MOUTH, start, end, 2e-3, *rim, 1e3, 0.0, True, STRAIGHT)[0]


@pytest.mark.parametrize("steep", [0.0, 0.7])
@pytest.mark.parametrize(
    "end", [(1.9e-3, 0, -0.9e-3), (1.2e-3, 1e-3, -4e-3), (1e-3, 0, 3e-3), (1e-3, 0, 6e-3)]
)
def test_the_gap_of_a_segment_through_a_mouth_is_continuous(end, steep):
    """Its lower end is forced through the wall of the bore, at several depths below the mouth."""
    for depth in (0.5e-3, 1e-3, 3e-3):
        ways = np.linspace(1.5e-3, 4e-3, 501)
        starts = [(x, 0, steep * x - depth) for x in ways]
        gaps = [gap_through_mouth(np.array(start), np.array(end), steep) for start in starts]
        if end[2] < 0:
            assert np.abs(np.diff(gaps)).max() < 2 * 5e-6 * np.hypot(1, steep)
            continue
        share = depth / (end[2] - steep * end[0] + depth)
        before = (1 - share) * ways + share * end[0] < 2.5e-3
        assert np.abs(np.diff(gaps)[before[1:]]).max() < 2 * 5e-6 * np.hypot(1, steep)


def test_a_segment_that_passes_outside_a_mouth_is_deep():
    """It is as far within the bone as it is beyond the edge."""
    for off_axis, gap in ((3e-3, -2.5e-3), (2e-3, -1.5e-3)):
        start, end = np.array([off_axis, 0, -5e-3]), np.array([off_axis, 0, 5e-3])
        assert gap_through_mouth(start, end, 0.0) == pytest.approx(gap, abs=1e-9)


@pytest.mark.parametrize("kind", [ROUND, BALL])
@RANDOM
@given(seed=SEEDS)
def test_chords_of_a_round_bone(kind, seed):
    """A segment over a round bone: its nearest point goes with it, and presses along the radius."""
    random = np.random.default_rng(seed)
    _, x, stiffness, multiplier, rim = contact(random, kind)
    place, axis = rim[:2]
    out = (x - place) - axis * (axis @ (x - place))
    around = np.cross(axis if kind == ROUND else unit(random), out / np.linalg.norm(out))
    along = around + random.uniform(-0.5, 0.5) * axis
    ends = np.concatenate([x - random.uniform(1e-3, 4e-3) * along, x + random.uniform(1e-3, 4e-3) * along])

    agree_on_a_segment(BONE, ends, 0.0, rim, stiffness, multiplier)


@pytest.mark.parametrize("shares", [(0.3, 0.6), (0.0, 0.4), (0.7, 1.0), (0.0, 1.0)])
@RANDOM
@given(seed=SEEDS)
def test_pairs(shares, seed):
    """Two segments that touch inside, or at an end of one or both: their nearest points go with them."""
    random = np.random.default_rng(seed)
    normal, along = unit(random), unit(random)
    along -= normal * (normal @ along)
    along /= np.linalg.norm(along)
    angle = random.uniform(0.4, 2.7)
    other = np.cos(angle) * along + np.sin(angle) * np.cross(normal, along)
    # At an end, the segment leans away beyond it.
    lean = [0.5 * (s == 0.0) - 0.5 * (s == 1.0) for s in shares]
    along, other = along + lean[0] * normal, other - lean[1] * normal
    apart, (a, b) = random.uniform(1.5e-3, 1.95e-3), random.uniform(2e-3, 4e-3, 2)
    u, w = shares
    top, low = 0.1 * random.standard_normal(3) + np.array([apart * normal, 0 * normal])
    x = np.array(
        [top - u * a * along, top + (1 - u) * a * along, low - w * b * other, low + (1 - w) * b * other]
    )

    def pair(at):
        return _core.testing.pair_term(at, 2e-3, 1e4, 3.0, x)

    def potential(at):
        return max(0.0, 3.0 - 1e4 * pair(at)[0]) ** 2 / 2e4

    assert np.linalg.norm(pair(x)[1]) > 0
    agree(-pair(x)[1], slopes(potential, x, 1e-7))
    agree(pair(x)[2], -slopes(lambda at: pair(at)[1].ravel(), x, 1e-7))


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-8, 1e-7, 1e-6])
def test_the_block_of_parallel_segments_is_no_rounding(angle):
    """Where both points can slide without end, only the first one does, and with it the other."""
    turned = 1e-2 * np.array([np.cos(angle), np.sin(angle), 0])
    x = np.array([[-1e-2, 0, 1.9e-3], [1e-2, 0, 1.9e-3], -turned, turned])
    _, forces, block = _core.testing.pair_term(x, 2e-3, 1e4, 3.0, x)
    normal_force = np.sum(forces[:2], 0)[2]
    assert np.abs(block).max() < 1e4
    assert np.linalg.eigvalsh(block).min() == pytest.approx(-normal_force / 1.9e-3)


CROSSED = np.array([[-3e-3, 0, 1.9e-3], [2e-3, 0, 1.9e-3], [0, -2e-3, 0], [1e-3, 4e-3, 0]])


@pytest.mark.parametrize("height", np.linspace(1.9e-3, -1.9e-3, 9))
def test_pairs_that_cross(height):
    """Segments that are pushed through each other are pushed back to their side, by all of the depth."""
    x = CROSSED.copy()
    x[:2, 2] = height
    gap, forces, _ = _core.testing.pair_term(x, 2e-3, 1e4, 0.0, CROSSED)
    assert gap == pytest.approx(height - 2e-3, abs=1e-12)
    assert np.sum(forces[:2], 0) == pytest.approx([0, 0, 1e4 * (2e-3 - height)], abs=1e-9)


@pytest.mark.parametrize("angle", np.linspace(0, 2.6, 9))
def test_pairs_that_turn(angle):
    """A segment that goes around another one's end within a step is pushed off where it is then."""
    up = np.array([0, np.sin(angle), np.cos(angle)])
    low = [[0, -3e-3, 0], [0, 0, 0]]
    start, x = (np.array([[-2e-3, 0, 0], [2e-3, 0, 0]] + low) for _ in range(2))
    start[:2, 2] += 1.95e-3
    x[:2] += 1.95e-3 * up
    gap, forces, _ = _core.testing.pair_term(x, 2e-3, 1e4, 0.0, start)
    assert gap == pytest.approx(-5e-5, abs=1e-12)
    assert np.sum(forces[:2], 0) == pytest.approx(0.5 * up, abs=1e-9)


@pytest.mark.parametrize("slides", [False, True])
@RANDOM
@given(seed=SEEDS)
def test_friction(slides, seed):
    """Sticking it is a spring; sliding, its potential is the limit times the distance."""
    random = np.random.default_rng(seed)
    tangent_stiffness, limit = 50.0, 0.02
    normal = unit(random)
    tangent_anchor = np.cross(normal, unit(random))
    tangent_anchor *= (10 if slides else 0.3) * limit / tangent_stiffness / np.linalg.norm(tangent_anchor)
    x = normal * 5e-4
    normal_only = (0.001, np.zeros(3), np.zeros(3), 0.0, np.zeros(3), 1e4, 3.0)

    def evaluate(at, tangent_stiffness=tangent_stiffness, limit=limit):
        return _core.testing.contact_term(
            BONE, at, normal, *normal_only, tangent_stiffness, limit, tangent_anchor, True
        )

    def pull(at):
        return np.subtract(evaluate(at)[2], evaluate(at, 0.0, 0.0)[2])

    def potential(at):
        away = tangent_anchor + at - normal * (normal @ (tangent_anchor + at))
        size = np.linalg.norm(away)
        return limit * size if slides else 0.5 * tangent_stiffness * size**2

    assert evaluate(x)[4] == slides
    agree(-pull(x), slopes(potential, x, 1e-7 if slides else 1e-6))
    agree(evaluate(x)[3] - evaluate(x, 0.0, 0.0)[3], -slopes(pull, x, 1e-6))
