"""Obstacles: which links tendons feel, what is measured and what is not, and what is refused."""

import numpy as np
import pybullet as p
import pytest

import bullet_tendon as bt

RADIUS, G = 0.004, 9.81
BORE = 1.5 * RADIUS
SOFT = bt.Material(stiffness=300.0, damping=0.3, friction=1.0)


def box(client, position=(0, 0, -0.05), half=(0.3, 0.2, 0.05), mass=0.0):
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=half, physicsClientId=client)
    return p.createMultiBody(mass, shape, basePosition=position, physicsClientId=client)


def two_link_body(client):
    """A static base, and a fixed link beside it; a table either."""
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.1, 0.2, 0.05], physicsClientId=client)
    return p.createMultiBody(
        0,
        shape,
        basePosition=[-0.15, 0, -0.05],
        linkMasses=[0],
        linkCollisionShapeIndices=[shape],
        linkVisualShapeIndices=[-1],
        linkPositions=[[0.3, 0, 0]],
        linkOrientations=[[0, 0, 0, 1]],
        linkInertialFramePositions=[[0, 0, 0]],
        linkInertialFrameOrientations=[[0, 0, 0, 1]],
        linkParentIndices=[0],
        linkJointTypes=[p.JOINT_FIXED],
        linkJointAxis=[[0, 0, 1]],
        physicsClientId=client,
    )


def over(world, x=0.0, height=0.006, length=0.1, n=11):
    line = [[x - length / 2, 0.01, height], [x + length / 2, 0.01, height]]
    return world.add_tendon(line, RADIUS, SOFT, n)


@pytest.fixture
def falling(make_world):
    return make_world(1 / 240, (0, 0, -G))


def test_what_is_no_obstacle_is_not_felt(falling, client):
    box(client)
    t = over(falling)
    falling.step(60)
    np.testing.assert_allclose(t.positions[:, 2], 0.006 - G / 240**2 * 60 * 61 / 2, rtol=1e-9)
    assert len(falling.contacts) == 0


def test_far_obstacles_cost_no_query(falling, client):
    """A box test says that nothing can touch: all features are culled."""
    falling.add_obstacle(box(client, [0, 0, -1.0]))
    t = over(falling)
    falling.step()
    counts = falling.report.counts
    features = 2 * t.particles - 1
    assert (counts["pairs_queried"], counts["pairs_considered"], counts["contacts"]) == (0, 0, 0)
    assert counts["pairs_culled"] == features


def test_resting_contacts_are_not_measured_again(make_world, client):
    falling = make_world(1 / 240, (0, 0, -G), sleep=False)
    falling.add_obstacle(box(client))
    over(falling, height=RADIUS)
    falling.step()
    assert falling.report.counts["pairs_queried"] > 0
    falling.step(200)
    counts = falling.report.counts
    assert counts["pairs_queried"] == 0
    assert counts["contacts"] >= 11


def test_planes_are_reused_within_the_tolerance_only(make_world, client):
    """The same slow slide: fewer queries where contact planes may be reused, and the same motion."""
    queries, ends = [], []
    body = box(client)
    for tolerance in (0.0, 1e-6):
        world = make_world(1 / 240, (0, 0, -G), reuse_tolerance=tolerance)
        world.add_obstacle(body, friction=0.0)
        t = over(world, height=RADIUS)
        t.set_positions(t.positions, np.tile([0.005, 0, 0], (11, 1)))
        asked = 0
        for _ in range(60):
            world.step()
            asked += world.report.counts["pairs_queried"]
        queries.append(asked)
        ends.append(t.positions)
    assert queries[0] >= 60 * 11
    assert queries[1] < queries[0] / 4
    np.testing.assert_allclose(ends[0], ends[1], atol=2e-6)


def test_every_link_is_an_obstacle_or_one_alone(falling, client):
    body = two_link_body(client)
    left, right = over(falling, -0.15), over(falling, 0.15)
    falling.add_obstacle(body)
    falling.step(200)
    assert {(c["tendon"], c["linkIndex"]) for c in falling.contacts} == {(left.name, -1), (right.name, 0)}
    for link in (-1, 0):
        below = falling.wrench(body, link)
        np.testing.assert_allclose(
            below[:3], [0, 0, -G * left.masses.sum()], atol=1e-6 * G * left.masses.sum()
        )
    falling.remove_obstacle(body, 0)
    falling.step(20)
    assert right.positions[:, 2].max() < 0
    assert left.positions[:, 2].min() == pytest.approx(RADIUS, abs=1e-6)
    falling.remove_obstacle(body)
    falling.step(20)
    assert left.positions[:, 2].max() < 0


def test_adding_again_replaces(falling, client):
    body = box(client)
    t = over(falling)
    for friction in (0.1, 0.2, 0.3):
        falling.add_obstacle(body, -1, friction)
    falling.step(200)
    places = falling.contacts["position"]
    assert len(np.unique(places, axis=0)) == len(places)  # once each
    forces = falling.contacts["normal_force"]
    assert forces.sum() == pytest.approx(G * t.masses.sum(), rel=1e-6)


@pytest.mark.parametrize(("given", "body_friction", "expected"), [(None, 0.8, 0.4), (0.3, 0.8, 0.15)])
def test_friction_is_the_product(make_world, client, given, body_friction, expected):
    """Sliding on a table: the force along it over the normal force, and the deceleration."""
    h = 1e-3
    world = make_world(h, (0, 0, -G))
    body = box(client)
    p.changeDynamics(body, -1, lateralFriction=body_friction, physicsClientId=client)
    world.add_obstacle(body, friction=given)
    material = bt.Material(stiffness=300.0, damping=0.3, friction=0.5)
    t = world.add_tendon([[0, -0.05, RADIUS], [0, 0.05, RADIUS]], RADIUS, material, 11)
    t.set_positions(t.positions, np.tile([1.0, 0, 0], (11, 1)))
    world.step(40)
    before = t.velocities[:, 0].mean()
    world.step(20)
    after = t.velocities[:, 0].mean()
    assert (before - after) / (20 * h) == pytest.approx(expected * G, rel=1e-3)
    contacts = world.contacts
    np.testing.assert_allclose(
        contacts["friction_force"], expected * contacts["normal_force"], rtol=1e-3, atol=1e-9
    )


def table_of(kind, client):
    """A body and its link with a horizontal surface at height 0, or with a bore around the x axis."""
    if kind == "base":
        return box(client), -1
    if kind == "bore":
        return p.createMultiBody(0, physicsClientId=client), -1
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.5, 0.5, 0.1], physicsClientId=client)
    one = {"linkVisualShapeIndices": [-1], "linkPositions": [[0, 0, -0.1]], "linkParentIndices": [0]}
    one |= {"linkOrientations": [[0, 0, 0, 1]], "linkInertialFramePositions": [[0, 0, 0]]}
    one |= {"linkInertialFrameOrientations": [[0, 0, 0, 1]], "linkJointAxis": [[1, 0, 0]]}
    one |= {"linkJointTypes": [p.JOINT_PRISMATIC], "linkMasses": [1e4], "linkCollisionShapeIndices": [shape]}
    return p.createMultiBody(0, physicsClientId=client, **one), 0


@pytest.mark.parametrize("kind", ["base", "link", "bore"])
@pytest.mark.parametrize("given", [None, 0.3])
def test_friction_follows_the_body_while_none_is_given(make_world, client, kind, given):
    """What slides slows down by the coefficient that pybullet has in each step."""
    h = 1e-3
    world = make_world(h, (0, 0, -G))
    body, link = table_of(kind, client)
    material = bt.Material(stiffness=300.0, damping=0.3, friction=0.5)
    height = RADIUS if kind != "bore" else 0.999 * (RADIUS - BORE)
    t = world.add_tendon([[0, 0, height], [0.1, 0, height]], RADIUS, material, 11)
    if kind == "bore":
        bore = world.add_tunnel(body, link, (-0.2, 0, 0), (0.3, 0, 0), BORE, friction=given)
    else:
        world.add_obstacle(body, link, friction=given)
    for now in (0.8, 0.2, 0.6):
        p.changeDynamics(body, link, lateralFriction=now, physicsClientId=client)
        told = given or now
        if kind == "bore":
            assert bore.friction == told
        assert "has no friction" not in world.describe()
        t.set_positions(t.positions, np.tile([1.0, 0, 0], (11, 1)))
        world.step(30)
        before = t.velocities[:, 0].mean()
        world.step(10)
        after = t.velocities[:, 0].mean()
        assert (before - after) / (10 * h) == pytest.approx(0.5 * told * G, rel=2e-3)


def test_obstacles_move_with_their_body(falling, client):
    """A table that is moved up carries the tendon along."""
    body = box(client)
    falling.add_obstacle(body)
    t = over(falling)
    falling.step(100)
    for k in range(1, 101):
        place = [0, 0, -0.05 + 1e-4 * k]
        p.resetBasePositionAndOrientation(body, place, [0, 0, 0, 1], physicsClientId=client)
        falling.step()
    falling.step(100)
    np.testing.assert_allclose(t.positions[:, 2], 0.01 + RADIUS, atol=1e-6)


def test_refused_obstacles_change_nothing(falling, client):
    body = box(client)
    empty = p.createMultiBody(0, basePosition=[0, 0, -1], physicsClientId=client)
    t = over(falling)
    for error, argument, arguments in (
        (bt.UnknownId, "bodyUniqueId", (99,)),
        (bt.UnknownId, "bodyUniqueId", ("box",)),
        (bt.UnknownId, "linkIndex", (body, 0)),
        (bt.UnknownId, "linkIndex", (body, -2)),
        (bt.InvalidValue, "friction", (body, -1, -0.1)),
        (bt.InvalidType, "friction", (body, -1, "rough")),
        (bt.InvalidType, "convex", (body, -1, 0.1, "yes")),
        (bt.InvalidValue, "bodyUniqueId", (empty,)),
        (bt.InvalidValue, "linkIndex", (empty, -1)),
        (bt.InvalidValue, "meshes", (body, -1, None, None, ["surplus.obj"])),
    ):
        with pytest.raises(error) as caught:
            falling.add_obstacle(*arguments)
        assert caught.value.argument == argument
    falling.step(30)
    assert t.positions[:, 2].max() < 0
    with pytest.raises(bt.UnknownId, match=f"bodyUniqueId = {body}: must be a body that"):
        falling.remove_obstacle(body)
    falling.add_obstacle(body)
    with pytest.raises(bt.UnknownId, match=r"linkIndex = 3: must be a link .* obstacle: \[-1"):
        falling.remove_obstacle(body, 3)
    falling.remove_obstacle(body, -1)


@pytest.mark.parametrize(("body", "link"), [(7, -1), (0, 0), (0, -2), (0, 1.0), ("0", -1), (True, -1)])
def test_unknown_links_are_refused(make_world, client, body, link):
    world = make_world()
    box(client)
    t = over(world)
    for use in (
        lambda: t.attach(0, body, link),
        lambda: world.wrench(body, link),
        lambda: world.add_obstacle(body, link),
    ):
        with pytest.raises(bt.UnknownId):
            use()
    t.grip(0)  # it is still free
