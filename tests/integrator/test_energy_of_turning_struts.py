"""A spring that pushes makes energy as an implicit step turns it: that is taken out of the step again."""

import numpy as np
import pytest

import bullet_tendon as bt

LENGTH, DT = 0.1, 1 / 240


def spun(make_world, particles, held, push, squeezed=0.8, **options):
    """A compressed tendon that turns about one end or its middle; K so that push = F dt^2/(l m) [-]."""
    world = make_world(DT, sleep=False, **options)
    density, radius = 1000.0, 1e-3
    mass = density * np.pi * radius**2 * LENGTH / (particles - 1)
    stiffness = push * LENGTH * mass / DT**2 / (1 - squeezed)
    material = bt.Material(stiffness=stiffness, density=density)
    t = world.add_tendon([[0, 0, 0], [LENGTH, 0, 0]], radius, material, particles)
    x = np.linspace([0, 0, 0], [squeezed * LENGTH, 0, 0], particles)
    if held:
        t.grip(0)
    about = x[0] if held else x.mean(0)
    spin = 0.25 / DT
    t.set_positions(x, np.cross([0, 0, spin], x - about))
    return world, t


@pytest.mark.parametrize("particles", [2, 3])
@pytest.mark.parametrize("held", [True, False])
@pytest.mark.parametrize("push", [1e-4, 1e-3, 1e-2])
def test_a_strut_that_turns_gains_no_energy(make_world, particles, held, push):
    """Elastic and kinetic energy never grow; without holds, momentum stays as well."""
    world, t = spun(make_world, particles, held, push)
    energy, momentum = t.energy, (t.masses[:, None] * t.velocities).sum(0)
    size = (t.masses * np.linalg.norm(t.velocities, axis=1)).sum()
    for _ in range(20):
        world.step()
        assert t.energy <= energy * (1 + 1e-10)
        energy = t.energy
        if not held:
            np.testing.assert_allclose((t.masses[:, None] * t.velocities).sum(0), momentum, atol=1e-9 * size)


@pytest.mark.parametrize("squeezed", [0.3, 0.8, 0.99])
@pytest.mark.parametrize(("particles", "held"), [(2, True), (2, False), (3, True), (10, False)])
@pytest.mark.parametrize("push", [1e-4, 1e-2, 1.0, 1e3])
def test_a_strut_never_has_more_energy_than_at_first_by_bdf2(make_world, particles, held, push, squeezed):
    """From step to step its energy swings about a mean that falls."""
    world, t = spun(make_world, particles, held, push, squeezed, integrator="bdf2")
    start = t.energy
    for _ in range(200):
        world.step()
        assert t.energy <= start * (1 + 1e-3)
