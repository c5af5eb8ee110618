"""Random calls of the whole public API, with pybullet beside it.

Whatever is passed, a call does its work or raises a TendonError, and then the hash of the whole state is
what it was before. Nothing else may be raised, and no state may cease to be finite.
"""

import math

import numpy as np
import pybullet as p
import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, rule, run_state_machine_as_test

import bullet_tendon as bt

WILD = [math.nan, math.inf, -math.inf, 1e308, -1e308, 5e-324, 0, -1, -1.0, 2**70, None, "a", "", b"x", True]
WILD += [(), [], [1, 2], {}, object(), 1j, np.float32(0.5), np.int64(3), np.zeros((2, 2)), np.array("1")]
SETTERS = ["target", "stiffness", "damping", "direction"]
OPTIONS = ["tolerance", "integrator", "max_iterations", "on_failure"]
wild = st.sampled_from(WILD)


def mostly(*good):
    """One of the good values, or now and then anything."""
    return st.one_of(st.sampled_from(good), st.sampled_from(good), wild)


number = mostly(0.001, 0.01, 0.5, 1.0, 1e3)
index = mostly(-1, 0, 1, 2, 5, 99)
friction = mostly(None, 0.5)
point = st.one_of(
    st.lists(st.sampled_from([-0.1, 0.0, 0.05, 0.3]), min_size=3, max_size=3),
    st.lists(wild, min_size=3, max_size=3),
    wild,
)
points = st.one_of(st.lists(point, min_size=2, max_size=4), wild)
maybe = st.one_of(st.none(), point)
body = st.one_of(st.integers(-2, 6), wild)


class Calls(RuleBasedStateMachine):
    """Handles are never thrown away, so that most of them are stale after a while.

    set: attributes of grips that were set, and refused: those that were not, by name, of all runs.
    """

    set, refused = set(), set()

    def __init__(self):
        super().__init__()
        self.client = p.connect(p.DIRECT)
        p.setGravity(0, 0, -9.81, physicsClientId=self.client)
        self.world = bt.TendonWorld(self.client)
        self.tendons, self.tunnels, self.holds, self.states, self.snapshots = [], [], [], [], []
        self.new_body(1.0)
        self.add_good_tendon(0.0)
        self.holds.append(self.tendons[0].grip(0, None, 10.0))

    def teardown(self):
        p.disconnect(self.client)

    def attempt(self, call, keep=None):
        before = self.world.state_hash()
        try:
            made = call()
        except bt.TendonError as refused:
            assert isinstance(refused, (ValueError, TypeError, KeyError, RuntimeError))
            assert self.world.state_hash() == before, refused
            return
        if keep is not None:
            keep.append(made)
        for t in self.world.tendons:
            assert np.isfinite(t.positions).all()

    def pick(self, handles, k):
        return handles[k % len(handles)] if handles else None

    @rule(y=st.sampled_from([0.0, 0.02, 0.2]))
    def add_good_tendon(self, y):
        material = bt.Material(stiffness=1e3, damping=1.0)
        self.attempt(
            lambda: self.world.add_tendon([[0, y, 0.1], [0.2, y, 0.1]], 0.005, material, 8), self.tendons
        )

    @rule(x=points, radius=number, n=mostly(None, 2, 3, 10), name=mostly(None, "a", "b"), k=number, e=number)
    def add_tendon(self, x, radius, n, name, k, e):
        def call():
            return self.world.add_tendon(x, radius, bt.Material(stiffness=k, exponent=e), n, name)

        self.attempt(call, self.tendons)

    @rule(k=st.integers(0, 50), odd=st.one_of(st.none(), wild))
    def remove_tendon(self, k, odd):
        self.attempt(lambda: self.world.remove_tendon(self.pick(self.tendons, k) if odd is None else odd))

    @rule(mass=st.sampled_from([0.0, 0.0, 1.0]))
    def new_body(self, mass):
        shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.05] * 3, physicsClientId=self.client)
        p.createMultiBody(mass, shape, basePosition=(0.1, 0, 0.02), physicsClientId=self.client)

    @rule(k=st.integers(0, 5))
    def remove_body(self, k):
        if p.getNumBodies(self.client) > 1:
            p.removeBody(p.getBodyUniqueId(k % p.getNumBodies(self.client), self.client), self.client)

    @rule(
        b=body,
        link=mostly(None, -1, 0),
        friction=mostly(None, 0.5),
        convex=mostly(None, True),
        meshes=mostly(()),
    )
    def add_obstacle(self, b, link, friction, convex, meshes):
        self.attempt(lambda: self.world.add_obstacle(b, link, friction, convex, meshes))

    @rule(b=body, link=mostly(None, -1))
    def remove_obstacle(self, b, link):
        self.attempt(lambda: self.world.remove_obstacle(b, link))

    @rule(b=body, link=mostly(-1), a=point, c=point, r=number, mu=friction, chamfer=mostly(0.0, 0.001))
    def add_tunnel(self, b, link, a, c, r, mu, chamfer):
        self.attempt(lambda: self.world.add_tunnel(b, link, a, c, r, mu, chamfer), self.tunnels)

    @rule(k=st.integers(0, 50), odd=st.one_of(st.none(), wild))
    def remove_tunnel(self, k, odd):
        self.attempt(lambda: self.world.remove_tunnel(self.pick(self.tunnels, k) if odd is None else odd))

    @rule(k=st.integers(0, 50), i=index, b=body, link=mostly(-1), at=st.one_of(st.none(), point))
    def attach(self, k, i, b, link, at):
        if self.tendons:
            self.attempt(lambda: self.pick(self.tendons, k).attach(i, b, link, at), self.holds)

    @rule(
        k=st.integers(0, 50),
        i=index,
        at=st.one_of(st.none(), point),
        s=mostly(None, 10.0),
        d=number,
        e=mostly(None),
    )
    def grip(self, k, i, at, s, d, e):
        if self.tendons:
            self.attempt(lambda: self.pick(self.tendons, k).grip(i, at, s, d, e), self.holds)

    @rule(k=st.integers(0, 50), name=st.sampled_from(SETTERS), to=st.one_of(point, number))
    def change_grip(self, k, name, to):
        grips = [hold for hold in self.holds if isinstance(hold, bt.Grip)]
        hold = self.pick([g for g in grips if not g.released] if k < 40 else grips, k)
        if hold is None:
            return
        done = []
        self.attempt(lambda: setattr(hold, name, to), done)
        (self.set if done else self.refused).add(name)

    @rule(k=st.integers(0, 50))
    def release(self, k):
        if self.holds:
            self.attempt(self.pick(self.holds, k).release)

    @rule(k=st.integers(0, 50), i=index, f=point)
    def set_force(self, k, i, f):
        if self.tendons:
            self.attempt(lambda: self.pick(self.tendons, k).set_force(i, f))

    @rule(k=st.integers(0, 50), shift=point, v=points)
    def set_positions(self, k, shift, v):
        t = self.pick(self.tendons, k)
        if t is not None:
            try:
                x = [[a + b for a, b in zip(row, shift, strict=True)] for row in t.positions]
            except (TypeError, ValueError, bt.TendonError):
                x = shift
            self.attempt(lambda: t.set_positions(x, v if isinstance(v, list) else None))

    @rule(k=st.integers(0, 50), length=mostly(0.01, -0.01), end=mostly(0, 1))
    def shorten(self, k, length, end):
        if self.tendons:
            self.attempt(lambda: self.pick(self.tendons, k).shorten(length, end))

    @rule(
        name=st.sampled_from(["tolerance", "integrator", "max_iterations", "on_failure"]),
        to=mostly("bdf2", 1e-8),
    )
    def options(self, name, to):
        self.attempt(lambda: setattr(self.world, "options", bt.SolverOptions(**{name: to})))
        self.attempt(lambda: setattr(self.world, "options", to))
        self.world.options = bt.SolverOptions()

    @rule(n=st.sampled_from([1, 1, 2, 0, -1, None, "2", 1.5]))
    def step(self, n):
        self.attempt(lambda: self.world.step(n))

    @rule(b=body, link=mostly(-1, 0))
    def read_out(self, b, link):
        self.attempt(lambda: self.world.wrench(b, link))
        assert np.isfinite(self.world.contacts["normal_force"]).all()
        for t in self.tendons:
            before = self.world.state_hash()
            self.attempt(lambda t=t: (t.tension, t.strain, t.length, t.energy, t.rest_length, t.masses))
            assert self.world.state_hash() == before

    @rule()
    def save(self):
        self.attempt(self.world.save_state, self.states)
        self.attempt(self.world.snapshot, self.snapshots)

    @rule(k=st.integers(0, 50), odd=st.one_of(st.none(), wild))
    def restore(self, k, odd):
        self.attempt(lambda: self.world.restore_state(self.pick(self.states, k) if odd is None else odd))
        self.attempt(lambda: self.world.load_snapshot(self.pick(self.snapshots, k) if odd is None else odd))

    @rule(k=st.integers(0, 50))
    def remove_state(self, k):
        self.attempt(lambda: self.world.remove_state(self.pick(self.states, k)))

    @rule(tolerance=mostly(1e-6), most=mostly(20))
    def relax(self, tolerance, most):
        self.attempt(lambda: self.world.relax(tolerance, 20 if isinstance(most, int) and most > 20 else most))

    @rule()
    def reset(self):
        p.resetSimulation(physicsClientId=self.client)
        self.new_body(0.0)
        p.setGravity(0, 0, -9.81, physicsClientId=self.client)


@pytest.mark.parametrize(
    ("runs", "calls"), [pytest.param(12, 30, id="reduced"), pytest.param(1000, 100, marks=pytest.mark.slow)]
)
@pytest.mark.filterwarnings("ignore::bullet_tendon.StepWarning")
def test_random_calls(runs, calls):
    sweep = settings(
        max_examples=runs,
        stateful_step_count=calls,
        deadline=None,
        derandomize=True,
        suppress_health_check=list(HealthCheck),
    )
    Calls.set.clear(), Calls.refused.clear()
    run_state_machine_as_test(Calls, settings=sweep)
    assert {"target", "stiffness", "damping"} <= Calls.set
    assert Calls.refused
