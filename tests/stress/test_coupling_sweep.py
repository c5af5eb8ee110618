"""A body on a tendon, light or heavy, soft or stiff, in long steps or short: no energy out of nothing."""

import itertools

import numpy as np
import pybullet as p
import pytest

import bullet_tendon as bt

LENGTH, G, PULL = 0.2, 9.81, 2000.0  # m, m/s^2, N
MASSES = (1e-4, 1e-2, 1.0, 1e2, 1e4)  # kg
STIFFNESSES = (1e2, 1e4, 1e6, 1e8)  # N per strain
STEPS = (1 / 1000, 1 / 240, 1 / 60)  # s


def slow(*values):
    return pytest.param(*values, marks=pytest.mark.slow)


class Bob:
    """A ball on a tendon that is held at its other end, and all energy there is, work of the pull apart."""

    def __init__(self, make_world, client, case, mass, stiffness, dt, **options):
        self.client, self.mass = client, mass
        self.gravity = G if case == "hanging" else 0.0
        self.pull = np.array([0, 0, -PULL if case == "pulled" else 0.0])
        self.world = make_world(dt, (0, 0, -self.gravity), **options)
        material = bt.Material(stiffness=stiffness, density=100.0)
        self.tendon = self.world.add_tendon([[0, 0, 0], [0, 0, -LENGTH]], 1e-3, material, 10)
        self.tendon.grip(0)
        ball = p.createCollisionShape(p.GEOM_SPHERE, radius=0.01, physicsClientId=client)
        self.body = p.createMultiBody(mass, ball, -1, [0, 0, -LENGTH], physicsClientId=client)
        p.setCollisionFilterGroupMask(self.body, -1, 0, 0, client)
        p.changeDynamics(self.body, -1, linearDamping=0, angularDamping=0, physicsClientId=client)
        self.tendon.attach(-1, self.body)
        if case == "free":
            p.resetBaseVelocity(self.body, [1.0, 0, 0], [0, 0, 0], client)
        self.start = self.energy()
        self.scale = max(mass * (0.5 + self.gravity * LENGTH), abs(self.pull[2]) * LENGTH)

    def place(self):
        return np.array(p.getBasePositionAndOrientation(self.body, self.client)[0])

    def velocity(self):
        return np.array(p.getBaseVelocity(self.body, self.client)[0])

    def motion(self, velocity) -> float:
        """Kinetic energy of the ball at that velocity [J]."""
        return 0.5 * self.mass * velocity @ velocity

    def energy(self) -> float:
        """Of motion, elastic, of height, less the work that the pull has done [J]."""
        lowered, t = self.place() + [0, 0, LENGTH], self.tendon
        heights = self.mass * lowered[2] + t.masses @ t.positions[:, 2]
        return self.motion(self.velocity()) + t.energy + self.gravity * heights - self.pull @ lowered

    def step(self) -> float:
        """Energy gained since the start, over the largest that was at hand."""
        if self.pull.any():
            at = self.place().tolist()
            p.applyExternalForce(self.body, -1, self.pull.tolist(), at, p.WORLD_FRAME, self.client)
        self.world.step()
        self.scale = max(self.scale, abs(self.pull @ (self.place() + [0, 0, LENGTH])))
        return (self.energy() - self.start) / self.scale


# A pull that comes all at once is not known before it has acted: that step is mended.
@pytest.mark.parametrize(("case", "most"), [("free", 1e-4), ("hanging", 1e-4), ("pulled", 1e-4)])
@pytest.mark.parametrize("seconds", [0.2, slow(10.0)])
def test_energy_and_convergence(make_world, client, case, most, seconds):
    gained = {}
    for values in itertools.product(MASSES, STIFFNESSES, STEPS):
        bob = Bob(make_world, client, case, *values)
        gains = []
        for _ in range(int(seconds / values[-1])):
            gains.append(bob.step())
            assert bob.world.report.converged, values
        assert np.isfinite(gains).all(), values
        gained[values] = max(gains)
        bob.world.remove_tendon(bob.tendon)
        p.removeBody(bob.body, client)
    worst = max(gained, key=gained.get)
    print(f"{case}: at most {gained[worst]:.2e} at (mass, stiffness, dt) = {worst}")
    assert gained[worst] <= most


@pytest.mark.parametrize("case", ["free", "hanging", "pulled"])
@pytest.mark.parametrize("seconds", [0.2, slow(10.0)])
def test_energy_by_bdf2(make_world, client, case, seconds):
    """pybullet's velocity is the mean of a step; that at a place is the mean of the two steps around it.

    Over the start, or over the first step, which is pybullet's: from rest it falls by g dt^2.
    """
    gained = {}
    for values in itertools.product(MASSES, STIFFNESSES, STEPS):
        bob = Bob(make_world, client, case, *values, integrator="bdf2")
        energies, scales = [], []
        for _ in range(max(int(seconds / values[-1]), 40)):
            before, rest = bob.velocity(), bob.energy() - bob.motion(bob.velocity())
            bob.step()
            assert bob.world.report.converged, values
            energies.append(rest + bob.motion(0.5 * (before + bob.velocity())))
            scales.append(bob.scale)
        gains = (np.array(energies[1:]) - max(bob.start, energies[1])) / scales[1:]
        assert np.isfinite(gains).all(), values
        gained[values] = gains.max()
        bob.world.remove_tendon(bob.tendon)
        p.removeBody(bob.body, client)
    worst = max(gained, key=gained.get)
    print(f"{case}: at most {gained[worst]:.2e} at (mass, stiffness, dt) = {worst}")
    assert gained[worst] <= 1e-6


@pytest.mark.parametrize(("mass", "stiffness"), [(0.1, 1e3), (0.126, 1152.0), (0.05, 550.0), (0.02, 4200.0)])
def test_what_pybullet_cuts_off_is_not_believed(make_world, client, mass, stiffness):
    """A pull that takes the body to the fastest rate at once: no gain, and its tension in ten steps."""
    bob = Bob(make_world, client, "pulled", mass, stiffness, 1 / 60)
    gains = [bob.step() for _ in range(60)]
    assert max(gains) <= 1e-4
    for _ in range(10):
        bob.step()
        assert bob.tendon.tension[-1] == pytest.approx(PULL, rel=1e-3)
