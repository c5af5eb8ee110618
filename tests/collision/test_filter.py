"""Pairs that do not collide: which contacts are left out, and that nothing else is."""

import numpy as np
import pybullet as p
import pytest

import bullet_tendon as bt

ROPE = bt.Material(stiffness=1e3, damping=1.0)


def box(client, z=0.0, mass=0.0):
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.1, 0.1, 0.01], physicsClientId=client)
    return p.createMultiBody(mass, shape, -1, [0, 0, z], physicsClientId=client)


def across(world, z, y=0.0, **more):
    return world.add_tendon([[-0.05, y, z], [0.05, y, z]], 2e-3, ROPE, 12, **more)


@pytest.fixture
def scene(make_world, client):
    """Two tendons that fall on a box, one on the other: world, body, tendons."""
    world = make_world(gravity=(0, 0, -9.81))
    body = box(client)
    world.add_obstacle(body)
    return world, body, across(world, 0.013), across(world, 0.018)


def kinds(world):
    return {(c["tendon"], c["kind"]) for c in world.contacts}


def test_without_a_choice_all_collide(scene):
    world, _, low, high = scene
    world.step(60)
    assert {(low.name, "bone"), (low.name, "tendon")} <= kinds(world)
    assert high.positions[:, 2].min() > 0.013


def test_two_tendons_pass_through_each_other(scene):
    world, _, low, high = scene
    world.set_collision(high, low, False)
    world.step(120)
    assert kinds(world) == {(low.name, "bone"), (high.name, "bone")}
    assert np.allclose([low.positions[:, 2], high.positions[:, 2]], 0.012, atol=1e-4)
    world.set_collision(low, high, True)
    world.step(120)
    assert abs(low.positions - high.positions).max(axis=1).min() > 0


@pytest.mark.parametrize("which", ["body", "link"])
def test_a_tendon_falls_through_a_body(scene, which):
    world, body, low, high = scene
    world.set_collision(low, body if which == "body" else (body, -1), False)
    world.set_collision(low, high, False)
    world.step(60)
    assert low.positions[:, 2].max() < -0.02
    assert kinds(world) == {(high.name, "bone")}


def test_a_tendon_that_does_not_collide_falls_through_everything(make_world, client):
    world = make_world(gravity=(0, 0, -9.81))
    body = box(client)
    world.add_obstacle(body)
    world.add_tunnel(body, -1, [0, 0, -0.01], [0, 0, 0.01], 0.004)
    ground = p.createMultiBody(
        0, p.createCollisionShape(p.GEOM_PLANE, physicsClientId=client), -1, [0, 0, -0.1]
    )
    world.add_obstacle(ground)
    low, ghost = across(world, 0.013), across(world, 0.02, collides=False)
    assert not ghost.collides
    assert low.collides
    world.step(120)
    assert ghost.positions[:, 2].max() < -0.5
    assert {name for name, _ in kinds(world)} == {low.name}


def test_a_tendon_that_does_not_collide_costs_no_distances(make_world, client):
    world = make_world()
    world.add_obstacle(box(client))
    across(world, 0.012, collides=False)
    across(world, 0.0125, y=0.001, collides=False)
    world.step(3)
    counts = world.report.counts
    assert counts["pairs_considered"] == counts["tendon_searches"] == counts["contacts"] == 0


def test_a_bore_is_left_out_with_its_link(make_world, client):
    world = make_world()
    body = box(client)
    world.add_tunnel(body, -1, [0, 0, -0.01], [0, 0, 0.01], 0.003)
    t = world.add_tendon([[0, 0, -0.05], [0, 0, 0.05]], 2e-3, ROPE, 21)
    ends = [t.grip(0), t.grip(-1)]
    for k in range(50):
        for grip in ends:
            grip.target = [0.0001 * k, 0, grip.target[2]]
        world.step()
    assert "bore" in {kind for _, kind in kinds(world)}
    world.set_collision(t, body, False)
    world.step(60)
    assert len(world.contacts) == 0
    assert t.positions[:, 0].min() > 0.004


def test_a_tendon_that_does_not_meet_itself(make_world):
    """The legs of a hairpin are led through each other: they touch, or not."""
    touching = []
    for enabled in (True, False):
        world = make_world()
        t = world.add_tendon([[0, 0, 0], [0.1, 0, 0], [0.1, 0.01, 0], [0, 0.01, 0]], 2e-3, ROPE, 40)
        world.set_collision(t, t, enabled)
        hand = t.grip(0)
        t.grip(-1)
        for k in range(50):
            hand.target = [0, 2e-4 * k, 0]
            world.step()
        touching.append(len(world.contacts))
    assert touching[0] > 0
    assert touching[1] == 0


def test_choices_are_part_of_the_state(scene):
    world, body, low, high = scene
    world.set_collision(low, high, False)
    state, data, mark = world.save_state(), world.snapshot(), world.state_hash()
    for put_back in (lambda: world.restore_state(state), lambda: world.load_snapshot(data)):
        world.set_collision(low, high, True)
        world.set_collision(low, body, False)
        high.collides = False
        assert world.state_hash() != mark
        put_back()
        assert world.state_hash() == mark
        assert high.collides


def test_a_slot_that_is_used_again_collides(scene, client):
    world, body, low, high = scene
    world.set_collision(low, high, False)
    low.collides = False
    world.set_collision(high, body, False)
    world.remove_tendon(low)
    p.removeBody(body, client)
    again = across(world, 0.013)
    assert again.collides
    world.add_obstacle(box(client))
    world.step(60)
    assert {(again.name, "bone"), (again.name, "tendon")} <= kinds(world)
    assert high.positions[:, 2].min() > 0.013


def test_what_cannot_be_chosen_is_refused(scene, client):
    world, body, low, high = scene
    other = box(client, 1.0)
    mark = world.state_hash()
    for b in (other, (other, -1), (body, 3), 99, (99, -1)):
        with pytest.raises(bt.UnknownId, match="^b = |linkIndex"):
            world.set_collision(low, b, False)
    for where in ((99,), (-1,), (None,), ("box",), (True,), (body, 3), (body, None)):
        with pytest.raises(bt.UnknownId, match="bodyUniqueId|linkIndex"):
            low.collides_with(*where)
    for b in ("box", None, 1.5, True, (body,), (body, -1, 0)):
        with pytest.raises(bt.InvalidType, match="^b = "):
            world.set_collision(low, b, False)
    with pytest.raises(bt.InvalidType, match="enabled"):
        world.set_collision(low, high, 1)
    with pytest.raises(bt.InvalidType, match="^a = "):
        world.set_collision(body, low, False)
    with pytest.raises(bt.InvalidType, match="collides"):
        across(world, 0.5, collides="no")
    assert world.state_hash() == mark
    world.remove_tendon(high)
    with pytest.raises(bt.UnknownId, match="^b = "):
        world.set_collision(low, high, False)
