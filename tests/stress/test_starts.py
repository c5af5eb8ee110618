"""From any start, however wrong, tendons stay finite and get back to their length."""

import numpy as np
import pytest

import bullet_tendon as bt

LENGTH, RADIUS = 0.2, 2e-3  # m


def slow(*values):
    return pytest.param(*values, marks=pytest.mark.slow)


def point(random, x):
    return np.tile(x[0], (len(x), 1)), 0.0


def nearly_a_point(random, x):
    return x[0] + 1e-9 * random.standard_normal(x.shape), 0.0


def flattened(random, x):
    """Anywhere in a thin disc."""
    return random.uniform(-0.05, 0.05, x.shape) * [1, 1, 1e-3], 0.0


def folded(random, x):
    """To and fro over a few segments, on itself."""
    there = np.abs((np.arange(len(x)) + 3) % 6 - 3)
    spacing = np.linalg.norm(x[1] - x[0])
    return np.outer(there * spacing, [1, 0, 0]) + 1e-6 * random.standard_normal(x.shape), 0.0


def exploded(random, x):
    return x, 100.0 * random.standard_normal(x.shape)


@pytest.mark.parametrize("start", [point, nearly_a_point, flattened, folded, exploded])
@pytest.mark.parametrize(("count", "seed"), [(3, 1), slow(200, 2), slow(200, 5)])
def test_back_to_rest_length(make_world, start, count, seed):
    random = np.random.default_rng(seed)
    unsolved = steps = 0
    for _ in range(count):
        world = make_world(1 / 240)
        n = int(random.integers(10, 41))
        exponent = random.choice([1.0, 1.5, 2.0])
        # A quadratic law has next to no stiffness at rest: soft ones are still on their way after 2 s.
        material = bt.Material(
            stiffness=10 ** random.uniform(4 if exponent == 2 else 2, 4.7),
            exponent=exponent,
            toe_strain=0.03,
            damping=random.uniform(0.5, 3),
            friction=random.uniform(0, 0.5),
        )
        t = world.add_tendon([[0, 0, 0], [LENGTH, 0, 0]], RADIUS, material, n)
        x, v = start(random, t.positions)
        t.set_positions(x, v if np.ndim(v) else None)
        for _ in range(480):
            world.step()
            unsolved, steps = unsolved + (not world.report.converged), steps + 1
            assert np.isfinite(t.positions).all()
            assert np.isfinite(t.velocities).all()
        # What friction holds in a tangle, a tenth of a newton, strains a quadratic law by 3e-3.
        within = 5e-3 if exponent == 2 else 1e-3
        assert t.length == pytest.approx(t.rest_length, rel=within), material
    print(f"{start.__name__}: {unsolved} of {steps} steps not converged")
