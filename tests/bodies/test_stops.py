"""Joint limits that stop links: foreseen, believed while they hold, and let go of without a kick."""

import pybullet as p
import pytest
from link_scenes import HINGED, UNDAMPED, hinged, misfit

import bullet_tendon as bt

CORD = bt.Material(stiffness=3e4, damping=100.0)


def test_a_limit_is_foreseen(make_world, client, tmp_path):
    """A link swings into its limit: the end of the tendon on it does not go on for a step."""
    arm = hinged(client, tmp_path)
    world = make_world(1 / 240)
    t = world.add_tendon([[0.1, 0, 0], [0.1, 0, -0.2]], 0.002, CORD, 12)
    held = t.attach(0, arm, 0)
    rates = [8.0]
    for _ in range(30):
        world.step()
        rates.append(p.getJointState(arm, 0, client)[1])
        assert misfit(t, held, client) < 1e-4  # 3e-3 where the limit comes as a surprise
    assert rates[5] > 5
    assert abs(rates[-1]) < 2


def test_a_limit_that_was_changed_is_not_believed(make_world, client, tmp_path):
    """pybullet goes on telling the limit of the file: what passes it once is not stopped there again."""
    arm = hinged(client, tmp_path)
    p.changeDynamics(arm, 0, jointLowerLimit=-1, jointUpperLimit=1.5, physicsClientId=client)
    world = make_world(1 / 240)
    t = world.add_tendon([[0.1, 0, 0], [0.1, 0, -0.2]], 0.002, CORD, 12)
    held = t.attach(0, arm, 0)
    misfits = []
    for _ in range(30):
        world.step()
        misfits.append(misfit(t, held, client))
    assert p.getJointState(arm, 0, client)[0] > 0.6
    assert sum(m > 1e-4 for m in misfits) <= 2


@pytest.mark.parametrize("mass", [0.02, 1.0])
@pytest.mark.parametrize("stiffness", [1e3, 1e6])
def test_what_rests_on_a_limit_is_not_thrown_off_it(make_world, client, tmp_path, mass, stiffness):
    """A tendon above is tightened at once: the link gets no more energy than was put in."""
    path = tmp_path / "lever.urdf"
    text = HINGED.replace('lower="-1" upper="0.3"', 'lower="0" upper="1"').replace("0 1 0", "0 -1 0")
    path.write_text(text.replace('mass value="0.05"', f'mass value="{mass}"'))
    arm = p.loadURDF(str(path), useFixedBase=True, flags=p.URDF_USE_INERTIA_FROM_FILE, physicsClientId=client)
    p.changeDynamics(arm, 0, **UNDAMPED, jointDamping=0, physicsClientId=client)
    p.setJointMotorControl2(arm, 0, p.VELOCITY_CONTROL, force=0, physicsClientId=client)
    world = make_world(1 / 240, (0, 0, -9.81))
    cord = bt.Material(stiffness=stiffness, damping=1e-4 * stiffness)
    t = world.add_tendon([[0.05, 0, 0], [0.05, 0, 0.1]], 0.001, cord, 10)
    t.attach(0, arm, 0)
    hand = t.grip(-1)
    world.step(30)
    hand.target = hand.target + [0, 0, 200 / stiffness * 0.1]
    fastest = 0.0
    for _ in range(20):
        world.step()
        fastest = max(fastest, abs(p.getJointState(arm, 0, client)[1]))
    given = 0.5 * 200**2 / stiffness * 0.1
    assert 0.5 * (5e-5 + mass * 0.05**2) * fastest**2 <= 1.05 * given + 1e-6
