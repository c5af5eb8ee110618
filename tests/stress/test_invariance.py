"""Scale and place do not matter, passive systems do not gain energy, free tendons keep their momentum."""

import numpy as np
import pybullet as p
import pytest

import bullet_tendon as bt


def slow(value):
    return pytest.param(value, marks=pytest.mark.slow)


def draped(client, scale, offset, steps=120):
    """Positions and tension over the scale, and the run's largest tension: a tendon falls over a box."""
    p.resetSimulation(physicsClientId=client)
    p.setTimeStep(1 / 240, physicsClientId=client)
    p.setGravity(0, 0, -9.81 * scale, physicsClientId=client)
    world = bt.TendonWorld(client, bt.SolverOptions(reuse_tolerance=1e-6 * scale))
    box = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.05 * scale] * 3, physicsClientId=client)
    body = p.createMultiBody(0, box, basePosition=offset, physicsClientId=client)
    world.add_obstacle(body, friction=0.5)
    material = bt.Material(stiffness=1e3 * scale**4, damping=2.0 * scale**4, exponent=1.5, friction=0.4)
    ends = np.array([[-0.12, 0.01, 0.07], [0.15, 0.01, 0.07]]) * scale
    # Rest lengths are told before the offset rounds them.
    t = world.add_tendon(np.linspace(*ends, 20), 0.004 * scale, material)
    t.set_positions(t.positions + offset)
    t.set_force(0, (0, 0, -0.05 * scale**4))
    most = 0.0
    for _ in range(steps):
        world.step()
        assert world.report.converged
        most = max(most, np.abs(t.tension).max())
    assert len(world.contacts)
    return (t.positions - offset) / scale, t.tension / scale**4, most / scale**4


def assert_same(one, other):
    """Positions to 1e-6 of the tendon's length, tensions to 1e-6 of the largest in the run."""
    assert np.abs(one[0] - other[0]).max() <= 1e-6 * 0.27
    assert np.abs(one[1] - other[1]).max() <= 1e-6 * one[2]


@pytest.mark.parametrize("scale", [1e-3, 1e3, slow(1e-2), slow(0.1), slow(10.0), slow(1e2)])
def test_scale(client, scale):
    assert_same(draped(client, 1.0, np.zeros(3)), draped(client, scale, np.zeros(3)))


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_place(client, axis):
    assert_same(draped(client, 1.0, np.zeros(3)), draped(client, 1.0, 1e3 * np.eye(3)[axis]))


def crossed(client, offset, integrator):
    """Two weighted tendons that slide over a capsule and on each other: positions, less the offset."""
    p.resetSimulation(physicsClientId=client)
    p.setTimeStep(1 / 240, physicsClientId=client)
    p.setGravity(0, 0, -9.81, physicsClientId=client)
    world = bt.TendonWorld(client, bt.SolverOptions(integrator=integrator))
    capsule = p.createCollisionShape(p.GEOM_CAPSULE, radius=0.05, height=0.4, physicsClientId=client)
    turn = p.getQuaternionFromEuler([np.pi / 2, 0, 0.1])
    body = p.createMultiBody(0, capsule, basePosition=offset, baseOrientation=turn, physicsClientId=client)
    world.add_obstacle(body, friction=0.6)
    material = bt.Material(stiffness=2e3, exponent=1.5, damping=3.0, shear_stiffness=100.0, friction=0.5)
    x = np.column_stack([np.linspace(-0.15, 0.14, 26), 0.003 * np.sin(np.arange(26)), np.full(26, 0.06)])
    tendons = [
        world.add_tendon(x, 0.004, material),
        world.add_tendon(x[::-1] * [0.8, 1, 1] + [0, 0.02, 0.01], 0.003, material),
    ]
    for t in tendons:
        t.set_positions(t.positions + offset)
    tendons[0].set_point_mass(0, 0.03), tendons[0].set_point_mass(-1, 0.02)
    tendons[1].set_point_mass(0, 0.01), tendons[1].set_force(0, (0.02, -0.01, 0))
    met = 0
    for _ in range(150):
        world.step()
        met += "tendon" in world.contacts["kind"]
    assert met >= 3  # 11 or more steps: that they meet at all is what is asked
    return np.concatenate([t.positions - offset for t in tendons])


@pytest.mark.parametrize("integrator", ["implicit_euler", "bdf2"])
def test_place_of_what_slides(client, integrator):
    """Friction is solved for so exactly that rounding far from the origin decides nothing."""
    here = crossed(client, np.zeros(3), integrator)
    for offset in ([1e3, 0, 0], [600.0, 500, -620]):
        assert np.abs(crossed(client, np.array(offset), integrator) - here).max() <= 1e-6 * 0.29


def random_material(rng):
    return bt.Material(
        stiffness=10 ** rng.uniform(1, 4),
        exponent=rng.choice([1.0, 1.5, 2.0, 3.0]),
        damping=rng.choice([0.0, 0.01, 1.0]),
        damping_exponent=rng.choice([1.0, 2.0]),
        tension_only=bool(rng.integers(2)),
        friction=rng.choice([0.0, 0.3, 1.0]),
    )


@pytest.mark.parametrize(
    ("count", "crumpled"),
    [
        (20, 0.002),
        pytest.param(1000, 0.002, marks=pytest.mark.slow),
        pytest.param(1000, 0.01, marks=pytest.mark.slow, id="touching themselves"),
    ],
)
def test_passive_systems_do_not_gain_energy(client, make_world, count, crumpled):
    """In steps that converged; one that did not is reported as such and claims nothing."""
    rng = np.random.default_rng(8)
    grown, unconverged = 0.0, 0
    for _ in range(count):
        p.resetSimulation(physicsClientId=client)
        world = make_world(10 ** rng.uniform(-4, -1.5))
        n = int(rng.integers(2, 25))
        line = np.cumsum(rng.normal(size=(n, 3)) * crumpled + [0.02, 0, 0], axis=0)
        t = world.add_tendon(line, 0.002, random_material(rng))
        for i in rng.choice(n, rng.integers(0, 2), replace=False):
            t.grip(int(i))
        t.set_positions(t.positions + 1e-3 * rng.normal(size=(n, 3)), rng.normal(size=(n, 3)))
        world.step()  # a rigid grip takes its particle back within the first step
        start = before = t.energy
        for _ in range(40):
            world.step()
            after = t.energy
            if world.report.converged:
                grown = max(grown, (after - before) / start)
            unconverged += not world.report.converged
            before = after
    print(f"energy grew by at most {grown:.1e} of the start's in {count * 40 - unconverged} converged steps")
    assert grown <= 1e-9
    assert unconverged <= 0.01 * 40 * count


@pytest.mark.parametrize("steps", [2000, slow(100_000)])
def test_a_free_tendon_keeps_its_angular_momentum(make_world, steps):
    """Implicit Euler loses dt sum m v_1 x v_0 by itself, whatever the forces: that part is taken off."""
    dt = 1e-4
    world = make_world(dt)
    material = bt.Material(stiffness=100.0, damping=0.5)
    t = world.add_tendon([[0, 0, 0], [0.2, 0, 0]], 0.004, material, 10)
    rng = np.random.default_rng(3)
    spin = np.cross([0, 0, 3.0], t.positions - [0.1, 0, 0])
    t.set_positions(t.positions, spin + 0.1 * rng.normal(size=(10, 3)))

    def momentum():
        return (t.masses[:, None] * np.cross(t.positions, t.velocities)).sum(0)

    start, own, v = momentum(), np.zeros(3), t.velocities
    for _ in range(steps):
        world.step()
        now = t.velocities
        own += dt * (t.masses[:, None] * np.cross(now, v)).sum(0)
        v = now
    drift = np.linalg.norm(momentum() - start - own) / np.linalg.norm(start)
    print(f"angular drift {drift:.2e}, Euler's own {np.linalg.norm(own) / np.linalg.norm(start):.2e}")
    assert drift <= 1e-6
