"""A tendon needs a bore that is wider than it is. What lies in a narrower one is refused, nothing else."""

import numpy as np
import pybullet as p
import pytest

import bullet_tendon as bt

HALF, BORE = 0.05, 0.006
ROPE = bt.Material(stiffness=3e3, damping=3.0)
PLACE, TURN = np.array([0.3, -0.1, 0.2]), p.getQuaternionFromEuler([0.4, -0.7, 1.1])
AXES = np.array(p.getMatrixFromQuaternion(TURN)).reshape(3, 3)
THICK = [1.0, 1.01, 1.5, 4.0]
URDF = """<robot name="r"><link name="a"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<tunnel name="narrow" link="a" radius="0.004"><start xyz="-.05 0 0"/><end xyz=".05 0 0"/></tunnel>
<tendon name="thick" radius="{}" particles="21"><material stiffness="3e3"/>
<point link="a" xyz="-.1 0 0"/><point link="a" xyz=".1 0 0"/></tendon></robot>"""


def there(points):
    return PLACE + np.asarray(points, float) @ AXES.T


@pytest.fixture
def world(make_world):
    return make_world()


@pytest.fixture
def bone(world, client):
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[HALF] * 3, physicsClientId=client)
    body = p.createMultiBody(0, shape, -1, PLACE, TURN, physicsClientId=client)
    world.add_obstacle(body)
    return body


def drill(world, bone, radius=BORE, **more):
    return world.add_tunnel(bone, -1, [-HALF, 0, 0], [HALF, 0, 0], radius, 0.1, **more)


def lay(world, points, radius, n=21):
    return world.add_tendon(there(points), radius, ROPE, n)


THROUGH, ACROSS = [[-0.1, 0, 0], [0.1, 0, 0]], [[0.01, 0.1, 0.002], [0.012, -0.1, 0.003]]
INTO = [[-0.2, 0, 0], [-0.045, 0, 0.001]]


@pytest.mark.parametrize("ratio", THICK)
@pytest.mark.parametrize("points", [THROUGH, ACROSS, INTO], ids=["through", "across", "into"])
@pytest.mark.parametrize("n", [2, 21])
def test_points_in_a_narrow_bore_are_refused(world, bone, ratio, points, n):
    tunnel, before = drill(world, bone, name="tibial"), world.state_hash()
    with pytest.raises(bt.InvalidValue, match="tibial") as caught:
        lay(world, points, ratio * BORE, n)
    assert caught.value.argument == "points"
    assert f"{BORE:g}" in str(caught.value) and f"{ratio * BORE:g}" in str(caught.value)
    assert world.tendons == () and world.tunnels == (tunnel,) and world.state_hash() == before
    lay(world, points, 0.99 * BORE, n)


BESIDE = [[-0.1, 0, BORE], [0.1, 0, BORE]]
OVER = [[-HALF - 0.01, 0, -0.1], [-HALF - 0.01, 0, 0.1]]
UP_TO = [[-0.2, 0, 0], [-HALF, 0, 0]]
ALONG_THE_FACE = [[-HALF, -0.1, 0], [-HALF, 0.1, 0]]
ON_ITS_AXIS_FAR_AWAY = [[0.2, 0, 0], [0.4, 0, 0]]


@pytest.mark.parametrize(
    "points",
    [BESIDE, OVER, UP_TO, ALONG_THE_FACE, ON_ITS_AXIS_FAR_AWAY],
    ids=["on the wall", "over the mouth", "up to the mouth", "along the face", "on its axis far away"],
)
@pytest.mark.parametrize("n", [2, 21])
def test_a_thick_tendon_elsewhere_is_allowed(world, bone, points, n):
    """Also before the bore is made, and put there later."""
    tunnel = drill(world, bone)
    t = lay(world, points, 1.5 * BORE, n)
    world.remove_tunnel(tunnel)
    drill(world, bone)
    t.set_positions(t.positions)


@pytest.mark.parametrize("ratio", THICK)
def test_a_bore_made_around_a_thick_tendon_is_refused(world, bone, ratio):
    """As where a bore is filled and a narrower one made while the tendon is in it."""
    wide = drill(world, bone, 5 * BORE)
    lay(world, THROUGH, ratio * BORE)
    world.step(3)
    world.remove_tunnel(wide)
    before = world.state_hash()
    with pytest.raises(bt.InvalidValue, match="tendon") as caught:
        drill(world, bone)
    assert (caught.value.argument, caught.value.value) == ("radius", BORE)
    assert f"> {ratio * BORE:g}" in str(caught.value)
    assert world.tunnels == () and world.state_hash() == before
    drill(world, bone, 1.01 * ratio * BORE)
    world.step(3)
    assert world.report.converged


def test_a_thick_tendon_cannot_be_put_into_a_narrow_bore(world, bone, client):
    """Where the bore is now: the bone may have moved."""
    drill(world, bone)
    t = lay(world, ON_ITS_AXIS_FAR_AWAY, 1.1 * BORE)
    x = t.positions
    with pytest.raises(bt.InvalidValue, match="0.006"):
        t.set_positions(there(np.linspace(*THROUGH, 21)))
    np.testing.assert_array_equal(t.positions, x)
    away = PLACE + [0, 0, 1.0]
    p.resetBasePositionAndOrientation(bone, away, TURN, physicsClientId=client)
    t.set_positions(there(np.linspace(*THROUGH, 21)))
    with pytest.raises(bt.InvalidValue, match=r"0\.0066"):
        t.set_positions(there(np.linspace(*THROUGH, 21)) + [0, 0, 1.0])


@pytest.mark.parametrize(("radius", "fits"), [(0.0039, True), (0.004, False), (0.008, False)])
def test_a_urdf_with_a_thick_tendon_in_its_tunnel_is_refused(world, tmp_path, radius, fits):
    path = tmp_path / "model.urdf"
    path.write_text(URDF.format(radius))
    if fits:
        world.load_urdf(path, useFixedBase=True)
        world.step(3)
        return
    with pytest.raises(bt.UrdfError, match="thick") as caught:
        world.load_urdf(path, useFixedBase=True)
    assert "0.004" in str(caught.value) and f"{radius:g}" in str(caught.value)
    assert world.tendons == () and world.tunnels == () and p.getNumBodies(world.physicsClientId) == 0


def test_a_bore_of_a_body_that_is_gone_is_told(world, bone, client):
    drill(world, bone)
    t = lay(world, ON_ITS_AXIS_FAR_AWAY, 1.1 * BORE)
    p.removeBody(bone, client)
    with pytest.raises(bt.UnknownId):
        t.set_positions(t.positions)
