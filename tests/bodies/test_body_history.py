"""BDF2 of tendons and free rigid bodies together: order, momentum, energy, and where it begins anew.

pybullet starts a body at rest with the velocity after a whole step: paths are those half a step later.
"""

import numpy as np
import pybullet as p
import pytest
from link_scenes import UNDAMPED, matrix
from scipy.integrate import solve_ivp

import bullet_tendon as bt

G, LENGTH, ANGLE, STIFFNESS = 9.81, 0.3, np.pi / 3, 3e4
HALF = np.array([0.02, 0.02, 0.03])  # m, half extents of a box
LIGHT = 1e-3  # kg/m^3: the tendon has no mass to speak of
SLACK = bt.Material(stiffness=1e3, density=LIGHT, tension_only=True)


def box(client, mass, at, velocity=(0, 0, 0), spin=(0, 0, 0)):
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=HALF.tolist(), physicsClientId=client)
    body = p.createMultiBody(mass, shape, -1, np.array(at).tolist(), physicsClientId=client)
    p.changeDynamics(body, -1, **UNDAMPED, physicsClientId=client)
    p.setCollisionFilterGroupMask(body, -1, 0, 0, client)
    p.resetBaseVelocity(body, velocity, spin, physicsClientId=client)
    return body


def place(client, body):
    return np.array(p.getBasePositionAndOrientation(body, client)[0])


def velocity(client, body):
    return np.array(p.getBaseVelocity(body, client)[0])


class Pendulum:
    """A box of 1 kg on a tendon of two particles, let go from 60 degrees; knot (3,) in the box [m]."""

    def __init__(self, make_world, client, dt, knot=(0, 0, 0), damping=0.0, **options):
        self.client, self.dt, self.damping = client, dt, damping
        self.knot = np.array(knot, float)
        self.world = make_world(dt, (0, 0, -G), integrator="bdf2", sleep=False, **options)
        end = LENGTH * np.array([np.sin(ANGLE), 0, -np.cos(ANGLE)])
        material = bt.Material(stiffness=STIFFNESS, damping=damping, density=LIGHT)
        self.tendon = self.world.add_tendon([[0, 0, 0], end], 1e-3, material, 2)
        self.hand = self.tendon.grip(0)
        self.body = box(client, 1.0, end - self.knot)
        self.hold = self.tendon.attach(-1, self.body)
        self.end = end

    def path(self, seconds):
        found = []
        for _ in range(round(seconds / self.dt)):
            self.world.step()
            found.append(place(self.client, self.body)[[0, 2]])
        return np.array(found)

    def errors(self, seconds):
        """RMS over the length: against the path, and against the path half a step later."""
        found, times = self.path(seconds), self.dt * (1 + np.arange(round(seconds / self.dt)))
        exact = self.exact(seconds + self.dt)
        return [
            np.sqrt(np.mean(np.sum((found - exact(times + later)[:2].T) ** 2, 1))) / LENGTH
            for later in (0, self.dt / 2)
        ]

    def exact(self, seconds):
        """x, z, the angle about y, and their rates: a rigid body on a massless spring."""
        inertia = (HALF[0] ** 2 + HALF[2] ** 2) / 3

        def rates(_, y):
            c, s = np.cos(y[2]), np.sin(y[2])
            arm = np.array([c * self.knot[0] + s * self.knot[2], -s * self.knot[0] + c * self.knot[2]])
            at, speed = y[:2] + arm, y[3:5] + y[5] * np.array([arm[1], -arm[0]])
            far = np.hypot(*at)
            pull = (STIFFNESS * (far - LENGTH) + self.damping * (speed @ at) / far) / LENGTH
            force = -pull * at / far
            spin = (arm[1] * force[0] - arm[0] * force[1]) / inertia
            return [*y[3:], force[0], force[1] - G, spin]

        start = [*(self.end - self.knot)[[0, 2]], 0, 0, 0, 0]
        return solve_ivp(
            rates, (0, seconds), start, method="DOP853", rtol=1e-10, atol=1e-12, dense_output=True
        ).sol


def test_a_bob_swings_with_second_order(make_world, client):
    coarse, fine = (Pendulum(make_world, client, dt).errors(2.0) for dt in (1 / 240, 1 / 480))
    assert coarse[0] <= 7e-3
    assert coarse[1] <= 2.5e-3
    assert 1.9 <= np.log2(coarse[1] / fine[1]) <= 2.1


def test_a_box_that_is_knotted_off_centre_swings_with_second_order(make_world, client):
    """It turns at up to 40 rad/s. The axial vibration is damped: no step would resolve it."""
    knot = (0.015, 0, 0.03)
    coarse, fine = (Pendulum(make_world, client, dt, knot, 30.0).errors(1.0)[1] for dt in (1 / 480, 1 / 960))
    assert coarse <= 3e-3
    assert np.log2(coarse / fine) >= 1.9


def test_a_swing_of_a_minute_keeps_its_height(make_world, client):
    pendulum = Pendulum(make_world, client, 1 / 240)
    path = pendulum.path(60.0)
    angles = np.arctan2(np.abs(path[:, 0]), -path[:, 1])
    assert angles.max() <= ANGLE + 1e-3
    assert angles[-480:].max() >= 0.99 * ANGLE


class Chain:
    """Three boxes that fly and spin, joined by two tendons beside their centres; no gravity."""

    def __init__(self, make_world, client, dt, seed=3, n=12, **options):
        self.client, rng = client, np.random.default_rng(seed)
        self.world = make_world(dt, integrator="bdf2", sleep=False, tolerance=1e-12, **options)
        self.bodies = [
            box(client, m, at, rng.normal(size=3).tolist(), rng.normal(size=3).tolist())
            for at, m in (([0, 0, 0], 0.3), ([0.3, 0, 0], 0.7), ([0.6, 0.1, 0], 0.05))
        ]
        self.tendons = []
        for a, b in zip(self.bodies, self.bodies[1:], strict=False):
            ends = [place(client, body) + [0.01, 0.012, 0.02] for body in (a, b)]
            t = self.world.add_tendon(ends, 1e-3, bt.Material(stiffness=3e3), n)
            t.attach(0, a), t.attach(-1, b)
            self.tendons.append(t)

    def momentum(self):
        masses = [p.getDynamicsInfo(body, -1, self.client)[0] for body in self.bodies]
        of_bodies = sum(m * velocity(self.client, b) for m, b in zip(masses, self.bodies, strict=True))
        return of_bodies + sum(t.masses @ t.velocities for t in self.tendons)

    def misfit(self):
        """Largest distance of an attached particle from its point [m]."""
        most = 0.0
        for hold in (h for t in self.tendons for h in t.holds):
            axes = matrix(p.getBasePositionAndOrientation(hold.bodyUniqueId, self.client)[1])
            point = place(self.client, hold.bodyUniqueId) + axes @ hold.position
            tendon = next(t for t in self.tendons if hold in t.holds)
            most = max(most, np.linalg.norm(tendon.positions[hold.particle] - point))
        return most


@pytest.mark.parametrize("dt", [1 / 240, 1 / 1000])
@pytest.mark.parametrize("seed", range(3))
def test_bodies_and_tendons_keep_their_momentum(make_world, client, dt, seed):
    """Also where a step is divided, is of another length, or comes after rates that the user set."""
    chain = Chain(make_world, client, dt, seed)
    now = chain.momentum()
    for k in range(300):
        if k == 150:
            p.resetBaseVelocity(chain.bodies[1], [0.2, 0.1, -0.3], [1, 2, 3], physicsClientId=client)
            now = chain.momentum()
        p.setTimeStep(dt / (3 if 100 <= k < 110 else 1), physicsClientId=client)
        chain.world.step()
        before, now = now, chain.momentum()
        assert chain.world.report.converged
        if k != 150:
            np.testing.assert_allclose(now, before, atol=1e-11)


def test_attached_particles_stay_at_their_points(make_world, client):
    chain = Chain(make_world, client, 1 / 240)
    for _ in range(100):
        chain.world.step()
        if chain.world.report.counts["substeps"] == 1:
            assert chain.misfit() <= 1e-9


def test_a_hand_feels_what_momentum_changes_by(make_world, client):
    """Of every step, of tendon and body together, while the bob swings and the hand shakes."""
    pendulum = Pendulum(make_world, client, 1 / 240, (0.01, 0, 0.02), tolerance=1e-12)
    t, masses = pendulum.tendon, pendulum.tendon.masses.sum() + 1.0

    def momentum():
        return velocity(client, pendulum.body) + t.masses @ t.velocities

    now = momentum()
    for k in range(200):
        pendulum.hand.target = [0, 0.02 * np.sin(0.1 * k), 0]
        pendulum.world.step()
        before, now = now, momentum()
        gained = (now - before) * 240 - masses * np.array([0, 0, -G])
        np.testing.assert_allclose(gained, -pendulum.hand.force, atol=1e-8 * max(1.0, t.tension.max()))


def test_a_body_on_a_slack_tendon_falls_as_pybullet_has_it(make_world, client):
    world = make_world(1 / 240, (0, 0, -G), integrator="bdf2")
    body, alone = box(client, 0.5, [0, 0, 0]), box(client, 0.5, [1, 0, 0])
    t = world.add_tendon([[0, 0, 0.02], [0, 0, 0.01]], 1e-3, SLACK, 3, rest_length=0.5)
    t.grip(0), t.attach(-1, body)
    for _ in range(60):
        world.step()
        np.testing.assert_allclose(velocity(client, body), velocity(client, alone), atol=1e-6)
    assert place(client, body)[2] < -0.2


@pytest.mark.parametrize("mass", [0.02, 1.0])
def test_nothing_is_remembered_when_a_body_is_let_go(make_world, client, mass):
    """It swings under up to 2 kN, and is let go: the next step gives it gravity alone."""
    world = make_world(1 / 240, (0, 0, -G), integrator="bdf2")
    body = box(client, mass, [0, 0, -LENGTH], velocity=[1.0, 0, 0])
    t = world.add_tendon([[0, 0, 0], [0, 0, -LENGTH]], 1e-3, bt.Material(stiffness=1e5, density=LIGHT), 9)
    hand, hold = t.grip(0), t.attach(-1, body)
    for k in range(10):
        hand.target = [0, 0, 1e-4 * k]
        world.step()
    assert np.linalg.norm(hold.force) > 10 * mass
    hold.release()
    before = velocity(client, body)
    world.step()
    np.testing.assert_allclose(velocity(client, body) - before, [0, 0, -G / 240], atol=1e-9)


@pytest.mark.parametrize("dt", [1 / 1000, 1 / 240])
@pytest.mark.parametrize("mass", [0.02, 0.5, 3.0])
def test_a_released_spring_gives_no_more_than_it_had(make_world, client, dt, mass):
    world = make_world(dt, integrator="bdf2")
    body = box(client, mass, [0, 0, -LENGTH])
    material = bt.Material(stiffness=1e4, tension_only=True, density=LIGHT)
    t = world.add_tendon([[0, 0, 0], [0, 0, -LENGTH]], 1e-3, material, 9)
    t.grip(0, target=[0, 0, 0.03]), t.attach(-1, body)
    fixed = p.createConstraint(
        body, -1, -1, -1, p.JOINT_FIXED, *[(0, 0, 0)] * 2, [0, 0, -LENGTH], physicsClientId=client
    )
    world.step(100)
    stored = t.energy
    assert stored == pytest.approx(0.5 * 1e4 / LENGTH * 0.03**2, rel=0.05)
    p.removeConstraint(fixed, client)
    for _ in range(round(0.5 / dt)):
        world.step()
        assert 0.5 * mass * velocity(client, body) @ velocity(client, body) + t.energy <= 1.05 * stored


def test_beside_an_articulated_body_impulses_are_opposite_all_the_same(make_world, client):
    """A ball hangs from a hinged arm: of the ball and the tendon together, in every step."""
    world = make_world(1 / 240, (0, 0, -G), integrator="bdf2", tolerance=1e-12)
    link = {"linkMasses": [0.3], "linkCollisionShapeIndices": [-1], "linkVisualShapeIndices": [-1]}
    link |= {"linkPositions": [[0, 0, 0]], "linkOrientations": [[0, 0, 0, 1]], "linkParentIndices": [0]}
    link |= {"linkInertialFramePositions": [[0.1, 0, 0]], "linkJointTypes": [p.JOINT_REVOLUTE]}
    link |= {"linkInertialFrameOrientations": [[0, 0, 0, 1]], "linkJointAxis": [[0, 1, 0]]}
    arm = p.createMultiBody(0, **link, physicsClientId=client)
    p.setJointMotorControl2(arm, 0, p.VELOCITY_CONTROL, force=0, physicsClientId=client)
    ball = box(client, 0.1, [0.2, 0, -LENGTH])
    t = world.add_tendon([[0.2, 0, 0], [0.2, 0, -LENGTH]], 1e-3, bt.Material(stiffness=3e3), 12)
    above = t.attach(0, arm, 0)
    t.attach(-1, ball)
    now, mass, lowest = np.zeros(3), 0.1 + t.masses.sum(), 0.0
    for _ in range(120):
        world.step()
        before, now = now, 0.1 * velocity(client, ball) + t.masses @ t.velocities
        gained = 240 * (now - before) - mass * np.array([0, 0, -G])
        np.testing.assert_allclose(gained, -above.force, atol=1e-7 * max(1.0, t.tension.max()))
        lowest = min(lowest, place(client, ball)[2])
    assert lowest < -LENGTH - 0.15


def test_a_known_force_that_begins_at_once_is_not_overshot(make_world, client):
    """A stiff tendon holds a body against a load that it is told, from the first step on with that load."""
    world = make_world(1 / 60, (0, 0, -G), integrator="bdf2")
    body = box(client, 1.0, [0, 0, -0.3])
    tendon = world.add_tendon([(0, 0, 0), (0, 0, -0.3)], 1e-3, bt.Material(stiffness=1e7, density=100.0), 4)
    tendon.grip(0)
    tendon.attach(-1, body)
    world.step(60)
    assert tendon.tension[-1] == pytest.approx(G, rel=1e-3)
    for _ in range(3):
        at = p.getBasePositionAndOrientation(body)[0]
        world.apply_external_force(body, -1, [0, 0, -100.0], at, p.WORLD_FRAME)
        world.step()
        assert tendon.tension[-1] == pytest.approx(G + 100, rel=0.02)
