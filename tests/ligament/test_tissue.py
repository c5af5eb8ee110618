"""Time and load in the tissue of ligaments: relaxation, creep, hysteresis and rupture."""

import numpy as np
import pybullet as p
import pytest
from scipy.integrate import quad

import bullet_tendon as bt

ACL = ((0.154, 3.77), (0.161, 148.0), (0.682, 10988.0))  # PMC4407883


def body(client, mass, at=(0, 0, 0)):
    shape = p.createCollisionShape(p.GEOM_SPHERE, radius=0.01, physicsClientId=client)
    made = p.createMultiBody(mass, shape, -1, at, physicsClientId=client)
    p.changeDynamics(made, -1, linearDamping=0, angularDamping=0, physicsClientId=client)
    p.setCollisionFilterGroupMask(made, -1, 0, 0, client)
    return made


class Bench:
    """A ligament of 30 mm between a fixed body and one that is put where it is to be."""

    def __init__(self, world, client, **material):
        self.world, self.client, self.at = world, client, 0.03
        self.ends = body(client, 0), body(client, 0, (0, 0, -0.03))
        path = [(end, -1, (0, 0, 0)) for end in self.ends]
        self.ligament = world.add_ligament(path, bt.Material(stiffness=2e3, **material))

    def stretch(self, strain) -> float:
        """The force after a step that ends at this strain."""
        p.resetBasePositionAndOrientation(
            self.ends[1], (0, 0, -0.03 * (1 + strain)), (0, 0, 0, 1), self.client
        )
        self.world.step()
        return self.ligament.force


def relaxed(terms, t):
    return 1 - sum(g * (1 - np.exp(-t / time)) for g, time in terms)


def test_relaxation_is_that_of_the_integral(make_world, client):
    """A ramp of the strain and a hold, by a linear law: the convolution in closed form."""
    dt = 0.05
    world = make_world(dt)
    terms = ((0.3, 0.4), (0.25, 3.77))
    bench = Bench(world, client, relaxation=terms)
    bench.stretch(0)
    ramp = 20
    for step in range(1, 200):
        force = bench.stretch(0.04 * min(step, ramp) / ramp)
        t, rate = step * dt, 2e3 * 0.04 / (ramp * dt)
        exact = rate * quad(lambda u, t=t: relaxed(terms, t - u), 0, min(t, ramp * dt), epsrel=1e-12)[0]
        assert force == pytest.approx(exact, rel=1e-6)


def test_creep_is_that_of_the_inverse(make_world, client):
    """A constant force on one term and a linear law: the standard linear solid creeps exponentially."""
    dt, share, time, load = 1e-3, 0.4, 0.5, 20.0
    world = make_world(dt, tolerance=1e-10)
    stand, weight = body(client, 0), body(client, 1e-3, (0, 0, -0.03 * (1 + load / 2e3)))
    material = bt.Material(stiffness=2e3, relaxation=((share, time),))
    path = [(stand, -1, (0, 0, 0)), (weight, -1, (0, 0, 0))]
    ligament = world.add_ligament(path, material, rest_length=0.03)
    for step in range(1, 1500):
        at = p.getBasePositionAndOrientation(weight, client)[0]
        world.apply_external_force(weight, -1, (0, 0, -load), at, p.WORLD_FRAME)
        world.step()
        if step < 20:  # the velocity of creep begins at once
            continue
        elastic = load / (1 - share) * (1 - share * np.exp(-(1 - share) * step * dt / time))
        assert ligament.strain == pytest.approx(elastic / 2e3, rel=1e-6)


def test_the_acl_relaxes_as_published(make_world, client):
    world = make_world(1.0)
    bench = Bench(world, client, relaxation=ACL)
    start = bench.stretch(0) or bench.stretch(0.03)
    began = [bench.stretch(0.03) for _ in range(100)]
    ratio = (began[-1] - began[0]) / start
    # From a ramp of one second: G averaged over the second before.
    mean = lambda t: quad(lambda u: relaxed(ACL, t - u), 0, 1)[0]  # noqa: E731
    assert began[-1] / start == pytest.approx(mean(101) / mean(1), rel=1e-6)
    assert ratio < -0.1


def test_cycles_lose_energy_and_settle(make_world, client):
    """Preconditioning: the peak force falls from cycle to cycle, ever less."""
    world = make_world(1 / 240)
    bench = Bench(world, client, relaxation=((0.2, 0.5), (0.2, 4.0)))
    peaks, lost = [], []
    for _ in range(12):
        strains = 0.02 * (1 - np.cos(np.linspace(0, 2 * np.pi, 241)))
        forces = np.array([bench.stretch(strain) for strain in strains])
        peaks.append(forces.max())
        lost.append(((forces[1:] + forces[:-1]) / 2 * np.diff(strains)).sum())
    assert (np.diff(peaks) < 0).all() and abs(np.diff(peaks)[-1]) < 0.3 * abs(np.diff(peaks)[0])
    assert min(lost) > 0


@pytest.mark.parametrize("limit", [{"rupture_force": 50.0}, {"rupture_strain": 0.025}])
def test_it_ruptures_at_its_limit_and_is_told(make_world, client, limit):
    bench = Bench(make_world(), client, **limit)
    for strain in np.linspace(0, 0.0249, 50):
        assert bench.stretch(strain) == pytest.approx(2e3 * strain, abs=1e-6)
        assert not bench.ligament.ruptured
    bench.stretch(0.0251)
    assert bench.ligament.ruptured
    assert bench.stretch(0.03) == 0.0


def test_its_memory_is_part_of_the_state(make_world, client):
    world = make_world(0.05)
    bench = Bench(world, client, relaxation=ACL, rupture_force=500.0)
    bench.stretch(0.02)
    kept = world.save_state()
    ends = [bench.stretch(0.03) for _ in range(5)], world.state_hash()
    world.restore_state(kept)
    again = [bench.stretch(0.03) for _ in range(5)], world.state_hash()
    assert ends == again


def test_what_has_ruptured_remembers_nothing_more(make_world, client):
    """Its state does not depend on what was computed before it was restored."""
    bench = Bench(make_world(1 / 240), client, relaxation=ACL, rupture_force=50.0)
    bench.stretch(0.01)
    while not bench.ligament.ruptured:
        bench.stretch(0.03)
    kept, hashes = bench.world.snapshot(), []
    for fresh in (False, True):
        if fresh:
            p.resetSimulation(client)
        again = Bench(make_world(1 / 240), client, relaxation=ACL, rupture_force=50.0) if fresh else bench
        p.resetBasePositionAndOrientation(again.ends[1], (0, 0, -0.0309), (0, 0, 0, 1), client)
        again.world.load_snapshot(kept)
        again.world.step()
        hashes.append(again.world.state_hash())
    assert hashes[0] == hashes[1]


def test_bad_materials_are_refused():
    for wrong in (((0.5,),), ((0.5, 0.0),), ((-0.1, 1.0),), ((0.7, 1.0), (0.6, 2.0)), np.zeros((0, 2))):
        with pytest.raises(bt.InvalidValue):
            bt.Material(stiffness=1e3, relaxation=wrong)
    with pytest.raises(bt.InvalidValue):
        bt.Material(stiffness=1e3, rupture_force=0)
