"""A knee at 1/240 s under what could make it unstable: compression, a drop, and fast flexion."""

from pathlib import Path

import numpy as np
import pybullet as p
import pytest
from bullet_tendon.scenarios.knee import KneeRig
from bullet_tendon.scenarios.knee_files import JOINTS

from bullet_tendon.generalized_bodies import jacobians_and_mass

KNEE = Path(__file__).resolve().parents[3] / "shared" / "knee"
SUPERIOR = [name for name, *_ in JOINTS].index("superior")
DROP = 30.0  # J
KNEES = [
    "own",
    pytest.param(
        "scanned",
        marks=[
            pytest.mark.slow,
            pytest.mark.skipif(
                not (KNEE / "ligaments.csv").exists(), reason="no real knee beside the checkout"
            ),
        ],
    ),
]


@pytest.fixture(params=KNEES)
def rig(request):
    with KneeRig(*([KNEE] * 3 if request.param == "scanned" else [])) as made:
        yield made


def kinetic(rig) -> float:
    """[J], of the tibia."""
    _, mass = jacobians_and_mass(rig.tibia[0], [rig.tibia[1]], rig.client)
    rates = rig._joints(velocity=True)
    return 0.5 * float(rates @ mass @ rates)


def stored(rig) -> float:
    """[J], in ligaments and cartilage."""
    rig.world._bodies.read()
    return rig.world._core.element_terms([], False)[0]


@pytest.mark.parametrize("degrees", [0, 15])
def test_600_newtons_of_compression_that_come_at_once(rig, degrees):
    """Bent further, this knee without muscles is pushed out of joint by a force along the tibia."""
    rig.flex(np.radians(degrees))
    rig.settle()
    start = rig.coordinates
    rig.load(superior=600.0)
    most = 0.0
    for _ in range(480):
        rig.step()
        assert rig.world.report.converged
        most = max(most, kinetic(rig))
    assert kinetic(rig) <= 0.02 * most  # it comes to rest, slowly where it turns
    assert rig.forces["cartilage"] > 600
    now = rig.coordinates
    assert 0 < now.superior - start.superior < 3e-3
    assert rig.settle()
    assert np.array(rig.coordinates) == pytest.approx(np.array(now), abs=2e-2)
    assert np.array(rig.coordinates)[3:] == pytest.approx(np.array(now)[3:], abs=1e-3)


def test_a_drop_of_30_joules_gains_no_energy_and_passes_through_nothing(rig):
    """Of the tibia onto the femur, at once; it bounces into its ligaments, and comes to rest."""
    rig.flex(np.radians(20))
    rig.settle()
    rested, below = rig.coordinates, stored(rig)
    _, mass = jacobians_and_mass(rig.tibia[0], [rig.tibia[1]], rig.client)
    speed = np.sqrt(2 * DROP / mass[SUPERIOR, SUPERIOR])
    p.resetJointState(rig.tibia[0], SUPERIOR, rig.joints[SUPERIOR], float(speed), rig.client)
    most, pressed = DROP + below, 0.0
    for _ in range(480):
        rig.step()
        energy = kinetic(rig) + stored(rig)
        assert energy <= most * (1 + 1e-3)
        assert rig.coordinates.superior - rested.superior < 0.012
        pressed = max(pressed, rig.forces["cartilage"])
    assert pressed > 600
    assert kinetic(rig) <= 0.05
    assert rig.settle()
    assert np.array(rig.coordinates) == pytest.approx(np.array(rested), abs=1e-3)


def test_flexion_at_5_hertz(rig):
    """Between 10 and 60 degrees. The tibia follows, and comes to rest where slow flexion brings it."""
    middle, swing = np.radians(35), np.radians(25)
    rig.flex(middle - swing)
    rig.settle()
    start, unsolved = rig.joints, 0
    for k in range(241):  # ends at the start of a period
        rig.turn(middle - swing * np.cos(2 * np.pi * 5 * k / 240))
        rig.step()
        unsolved += not rig.world.report.converged
        assert np.abs(rig.joints - start).max() < 0.7
        assert np.abs(rig.joints - start)[[0, 1, 3]].max() < 0.03
        assert kinetic(rig) < 2.0
    assert unsolved == 0
    rig.turn(middle - swing)
    assert rig.settle()
    assert rig.joints == pytest.approx(start, abs=2e-3)
