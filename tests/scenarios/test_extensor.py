"""A patella and a quadriceps line in the project's knee: balance of the patella, and published ratios."""

import numpy as np
import pybullet as p
import pytest
from bullet_tendon.scenarios.knee import KneeRig

import bullet_tendon as bt

PULL = 200.0  # N


@pytest.fixture(scope="module")
def pulled():
    """By flexion [degrees]: forces under the pull, the way forwards that it makes [m], whether at rest."""
    found = {}
    with KneeRig() as rig:
        rig.flex(np.radians(10))
        rig.settle()
        for angle in (10, 20, 30, 50, 70, 90):
            rig.quadriceps(20.0)
            rig.flex(np.radians(angle))
            rested = rig.settle()
            start = rig.coordinates.anterior
            rig.quadriceps(PULL)
            rested &= rig.settle()
            found[angle] = rig.forces, rig.coordinates.anterior - start, rested
    return found


def test_the_knee_comes_to_rest_at_all_angles(pulled):
    assert all(rested for *_, rested in pulled.values())
    assert all(forces["quadriceps"] == pytest.approx(PULL) for forces, *_ in pulled.values())


def test_the_share_of_the_tendon_falls_with_flexion_as_in_cadavers(pulled):
    """Quadriceps over tendon: 0.86 at 10 degrees and 1.55 at 70 (eight knees, J Biomech 1988, 21:17)."""
    ratio = {angle: forces["quadriceps"] / forces["PT"] for angle, (forces, *_) in pulled.items()}
    assert ratio[10] == pytest.approx(0.86, abs=0.15)
    assert ratio[70] == pytest.approx(1.55, abs=0.15)
    assert ratio[10] < ratio[30] < ratio[50] < ratio[70]


def test_a_pull_near_extension_draws_the_tibia_forwards_and_tightens_the_acl(pulled):
    for angle in (10, 20, 30):
        forces, forwards, _ = pulled[angle]
        assert forwards > 1e-3
        assert forces["ACL"] > 30
    forwards = [pulled[angle][1] for angle in (20, 30, 50, 70, 90)]
    assert (np.diff(forwards) < 0).all()
    assert abs(forwards[-1]) < 5e-4


def test_the_forces_on_the_patella_balance():
    """By the geometry of the lines alone: tendon, quadriceps, retinacula and cartilage add up to nothing."""
    with KneeRig() as rig:
        rig.flex(np.radians(10))
        rig.settle()
        rig.quadriceps(PULL)
        rig.flex(np.radians(40))
        assert rig.settle()
        extensor = rig._extensor
        total = np.array(extensor.cartilage.wrench[:3])
        torque = np.array(extensor.cartilage.wrench[3:])
        centre = np.array(p.getBasePositionAndOrientation(extensor.patella, rig.client)[0])
        for line in rig.world.ligaments:
            if line.path[0][0] != extensor.patella:
                continue
            start, beyond = line.points[:2]
            force = line.force * (beyond - start) / np.linalg.norm(beyond - start)
            total += force
            torque += np.cross(start - centre, force)
        assert np.linalg.norm(total) < 0.05
        assert np.linalg.norm(torque) < 0.005


def test_without_a_quadriceps_nothing_is_added():
    with KneeRig() as rig:
        assert "PT" not in rig.forces
        count = p.getNumBodies(rig.client), len(rig.world.ligaments)
        for bad in (-1.0, float("nan"), "hard"):
            with pytest.raises(bt.TendonError):
                rig.quadriceps(bad)
        rig.flex(np.radians(45))
        with pytest.raises(bt.InvalidValue, match="20 degrees"):
            rig.quadriceps(100.0)
        assert (p.getNumBodies(rig.client), len(rig.world.ligaments)) == count


def test_a_quadriceps_that_lets_go_leaves_the_knee_where_it_was():
    with KneeRig() as rig:
        rig.flex(np.radians(20))
        rig.settle()
        rig.quadriceps(20.0)
        assert rig.settle()
        before = rig.coordinates
        rig.quadriceps(150.0)
        assert rig.settle()
        assert rig.coordinates.anterior - before.anterior > 1e-3
        rig.quadriceps(20.0)
        assert rig.settle()
        assert np.array(rig.coordinates) == pytest.approx(np.array(before), abs=1e-4)
