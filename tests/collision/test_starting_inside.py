"""A tendon that begins inside an obstacle, and is not attached there, is told of once, before a step."""

import warnings

import numpy as np
import pybullet as p
import pytest
from brute_force import torus
from link_scenes import add_mesh, mesh_obstacle, prism_mesh

import bullet_tendon as bt

HALF, RADIUS = 0.03, 0.003
ROPE = bt.Material(stiffness=3e3, damping=3.0)
KINDS = {
    "box": {"shapeType": p.GEOM_BOX, "halfExtents": [HALF] * 3},
    "sphere": {"shapeType": p.GEOM_SPHERE, "radius": HALF},
    "cylinder": {"shapeType": p.GEOM_CYLINDER, "radius": HALF, "height": 2 * HALF},
    "capsule": {"shapeType": p.GEOM_CAPSULE, "radius": HALF, "height": HALF},
}


@pytest.fixture
def world(make_world):
    return make_world(gravity=(0, 0, -9.81))


def body_of(client, kind, at=(0, 0, 0)):
    shape = p.createCollisionShape(**KINDS[kind], physicsClientId=client)
    return p.createMultiBody(0, shape, -1, at, physicsClientId=client)


def through(world, depth, n=41, **more):
    """A tendon along y, `depth` beneath the surface at x = HALF."""
    x = HALF - depth
    t = world.add_tendon([[x, -0.08, 0], [x, 0.08, 0]], RADIUS, ROPE, n, **more)
    t.grip(0)
    t.grip(-1)
    return t


def told(world, steps=3):
    """Messages of the InsideWarnings of some steps."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        world.step(steps)
    assert all(w.category is bt.InsideWarning for w in caught)
    return [str(w.message) for w in caught]


def quiet(world, steps=3):
    return told(world, steps) == []


@pytest.mark.parametrize("depth", [0.001, 0.004, 0.015])
@pytest.mark.parametrize("kind", KINDS)
def test_told_once(world, client, kind, depth):
    world.add_obstacle(body_of(client, kind, (1, 0, 0)))
    body = body_of(client, kind)
    world.add_obstacle(body)
    t = through(world, depth)
    (message,) = told(world)
    assert repr(t.name) in message and f"body {body}, link -1" in message and f"{depth:.3g} m" in message
    assert quiet(world)


def test_a_closed_mesh(world, client):
    vertices, triangles = torus()
    size = np.ptp(vertices[:, 0])
    add_mesh(world, client, vertices, triangles)
    world.add_tendon([[-size, 0.03, 0.01], [size, 0.02, 0.03]], 0.02 * size, ROPE, 41)
    (message,) = told(world, 1)
    assert "deep inside body 0" in message


def test_an_open_mesh(world, client):
    """It has no inside: what crosses it is told without a depth."""
    sheet = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    add_mesh(world, client, 0.1 * sheet, [[0, 1, 2], [0, 2, 3]])
    world.add_tendon([[0.01, 0, -0.05], [0.02, 0.01, 0.05]], RADIUS, ROPE, 12)
    (message,) = told(world, 1)
    assert "across the open surface of body 0" in message


@pytest.mark.parametrize("depth", [0.002, 0.008, 0.02])
@pytest.mark.parametrize("kind", KINDS)
def test_insertions_are_not_told(world, client, kind, depth):
    """At one end or at both, straight or oblique, in the very link."""
    body = body_of(client, kind)
    world.add_obstacle(body)
    one = world.add_tendon([[HALF - depth, 0, 0], [0.1, 0.01, 0]], RADIUS, ROPE, 41)
    one.attach(0, body)
    loop = [[0, HALF - depth, 0], [0, 0.1, 0], [0, 0.1, 0.1], [0, 0, 0.1], [0, 0, HALF - depth]]
    both = world.add_tendon(loop, RADIUS, ROPE, 81)
    both.attach(0, body)
    both.attach(-1, body)
    assert quiet(world)


def test_attached_to_another_body_is_told(world, client):
    world.add_obstacle(body_of(client, "box"))
    other = body_of(client, "box", (1, 0, 0))
    t = world.add_tendon([[0.01, 0, 0], [0.1, 0, 0]], RADIUS, ROPE, 41)
    t.attach(0, other)
    assert len(told(world)) == 1


def test_deeper_than_its_attachment_is_told(world, client):
    """As a ligament that was drawn straight from its insertion through the bone."""
    body = body_of(client, "sphere")
    world.add_obstacle(body)
    t = world.add_tendon([[HALF - 0.001, 0, 0], [-0.1, 0.01, 0]], RADIUS, ROPE, 41)
    t.attach(0, body)
    assert len(told(world)) == 1


def test_what_is_outside_or_in_a_bore_is_not_told(world, client):
    body = body_of(client, "box")
    world.add_obstacle(body)
    world.add_tunnel(body, -1, [0, 0, -HALF], [0, 0, HALF], 0.006, 0.1)
    world.add_tendon([[0, 0, -0.1], [0, 0, 0.1]], RADIUS, ROPE, 41)
    through(world, -1.1 * RADIUS)
    through(world, -0.5 * RADIUS).set_positions(np.linspace([0.1, 0, 0.1], [0.2, 0, 0.1], 41))
    assert quiet(world)


@pytest.mark.parametrize("n", [2, 3, 4, 7])
def test_a_segment_through_a_whole_bore_is_not_told(world, client, n):
    """With no end in the bore, its middle is there; beside the bore it is told, and refused, as ever."""
    body = body_of(client, "box")
    world.add_obstacle(body)
    world.add_tunnel(body, -1, [0, 0, -HALF], [0, 0, HALF], 0.006, 0.1)
    line = np.array([[0, 0, -0.2], [0, 0, 0.2]])
    for inside in ("allow", "error", "push_out"):
        t = world.add_tendon(line + [0, 0.002, 0], RADIUS, ROPE, n, inside=inside, collides=inside == "allow")
        np.testing.assert_allclose(t.positions[:, :2], np.tile([0, 0.002], (n, 1)), atol=1e-12)
    assert len(world.penetrations()) == 0
    assert quiet(world)
    with pytest.raises(bt.InvalidValue, match="outside all obstacles"):
        world.add_tendon(line + [0, 0.01, 0], RADIUS, ROPE, n, inside="error")
    world.add_tendon(line + [0, 0.01, 0], RADIUS, ROPE, n)
    assert len(told(world)) == 1


def test_what_lies_in_a_bore_that_is_filled_up_is_told(world, client):
    body = body_of(client, "box")
    world.add_obstacle(body)
    bore = world.add_tunnel(body, -1, [0, 0, -HALF], [0, 0, HALF], 0.006, 0.1)
    world.add_tendon([[0, 0, -0.1], [0, 0, 0.1]], RADIUS, ROPE, 41).grip(-1)
    assert quiet(world)
    world.remove_tunnel(bore)
    assert len(told(world)) == 1


def test_what_is_inside_when_it_is_let_collide_is_told(world, client):
    body = body_of(client, "box")
    world.add_obstacle(body)
    t = world.add_tendon([[0, 0, -0.1], [0, 0, 0.1]], RADIUS, ROPE, 41)
    t.grip(-1)
    world.set_collision(t, body, False)
    assert quiet(world)
    world.set_collision(t, body, True)
    assert len(told(world)) == 1


def test_pushed_out_is_not_told(world, client):
    world.add_obstacle(body_of(client, "sphere"))
    through(world, 0.004, inside="push_out")
    assert quiet(world)


def test_put_inside_later(world, client):
    """By set_positions, by an obstacle that is added, and by one that is added again."""
    body = body_of(client, "box")
    world.add_obstacle(body)
    t = through(world, -0.02)
    assert quiet(world)
    for hold in t.holds:
        hold.release()
    x = t.positions - [0.03, 0, 0]
    t.set_positions(x)
    assert len(told(world)) == 1
    t.set_positions(x)
    assert quiet(world)
    t.set_positions(x)
    world.add_obstacle(body)
    assert len(told(world)) == 1
    world.add_obstacle(body_of(client, "box", (0, 0.06, 0)))
    t.set_positions(x)
    assert len(told(world)) == 1


def test_a_removed_tendon_is_not_told(world, client):
    world.add_obstacle(body_of(client, "box"))
    world.remove_tendon(through(world, 0.01))
    assert quiet(world)
    through(world, 0.01)
    assert len(told(world)) == 1


def test_relax_tells(world, client):
    world.add_obstacle(body_of(client, "sphere"))
    through(world, 0.002)
    with pytest.warns(bt.InsideWarning):
        world.relax(max_steps=2)


def test_as_an_error_it_leaves_everything_as_it_was(world, client):
    world.add_obstacle(body_of(client, "sphere"))
    through(world, 0.002)
    before = world.state_hash()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        with pytest.raises(bt.InsideWarning):
            world.apply()
        assert world.state_hash() == before
        world.apply()


def test_it_points_at_the_callers_line(world, client):
    world.add_obstacle(body_of(client, "sphere"))
    for call in (world.step, world.apply, world.relax):
        through(world, 0.002)
        with pytest.warns(bt.InsideWarning) as caught:
            call()
        assert caught[0].filename == __file__


@pytest.mark.parametrize("kind", KINDS)
def test_its_steps_stay_within_the_budget(make_world, client, kind):
    world = make_world(gravity=(0, 0, -9.81), max_linear_solves=400)
    world.add_obstacle(body_of(client, kind))
    t = through(world, 0.01)
    assert len(told(world, 1)) == 1
    for _ in range(30):
        world.step()
        assert world.report.counts["linear_solves"] <= 400 + 64 * 4
    assert np.isfinite(t.positions).all()


def test_a_urdfs_tendon(world, tmp_path):
    """Its points are attached to other links than the one that it goes through."""
    box = '<collision><geometry><box size=".06 .06 .06"/></geometry></collision>'
    mass = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    tendon = (
        '<tendon name="graft" radius="0.003" particles="41"><material stiffness="3e3"/>'
        '<point link="b" xyz="-.1 .01 0" attach="true"/><point link="b" xyz=".1 .01 0"/></tendon>'
    )
    joint = '<joint name="j" type="fixed"><parent link="a"/><child link="b"/></joint>'
    path = tmp_path / "model.urdf"
    links = f'<link name="a">{mass}{box}</link><link name="b">{mass}</link>'
    path.write_text(f'<robot name="r">{links}{joint}{tendon}</robot>')
    world.load_urdf(path, useFixedBase=True)
    (message,) = told(world)
    assert "'graft'" in message and "0.02 m deep" in message


def coiled(world, body, per_turn, **more):
    """A tendon along a helix at its radius from a cylinder along z: its chords are nearer."""
    turn = np.linspace(0, 6 * np.pi, 3 * per_turn + 1)
    helix = np.column_stack([np.cos(turn), np.sin(turn), 0.08 * turn - 0.75]) * (HALF + RADIUS)
    return world.add_tendon(np.vstack([helix, helix[-1] + [0, 0.1, 0]]), RADIUS, ROPE, **more)


@pytest.mark.parametrize("friction", [0.0, 0.5])
@pytest.mark.parametrize("per_turn", [12, 20])
@pytest.mark.parametrize("kind", ["cylinder", "mesh"])
def test_a_coil_that_begins_too_near(make_world, client, kind, per_turn, friction):
    """It is told how much longer its obstacle makes it; pushed out, it begins without load."""
    world = make_world()
    if kind == "mesh":
        vertices, faces = prism_mesh(HALF, HALF, 120)
        body = mesh_obstacle(world, client, vertices[:, [2, 0, 1]], faces, friction)  # along z
    else:
        body = body_of(client, kind)
        world.add_obstacle(body, friction=friction)
    t = coiled(world, body, per_turn)
    coil = 3 * per_turn
    lengths = np.linalg.norm(np.diff(t.positions, axis=0), axis=1)
    (message,) = told(world, 1)
    stretched = (1 / np.cos(np.pi / per_turn) - 1) * lengths[:coil].sum() / lengths.sum()
    assert repr(t.name) in message and f"nearer to body {body}, link -1" in message
    told_as = float(message.split(" % longer")[0].split()[-1])
    assert told_as == pytest.approx(100 * stretched, rel=0.1)
    load = t.tension.max()
    world.remove_tendon(t)
    t = coiled(world, body, per_turn, inside="push_out")
    assert quiet(world, 1)
    assert t.tension.max() < 0.01 * load
    middles = 0.5 * (t.positions[1:] + t.positions[:-1])[:coil]
    assert np.linalg.norm(middles[:, :2], axis=1).min() > HALF + 0.99 * RADIUS


def test_what_begins_too_near_on_a_plane_is_not_told(world, client):
    """Pushed out, it is no longer."""
    shape = p.createCollisionShape(p.GEOM_PLANE, planeNormal=[0, 0, 1], physicsClientId=client)
    world.add_obstacle(p.createMultiBody(0, shape, physicsClientId=client))
    line = [[-0.1, 0, 0.3 * RADIUS], [0.1, 0, 0.5 * RADIUS]]
    world.add_tendon(line, RADIUS, ROPE, 21)
    assert quiet(world)


def test_what_is_attached_may_begin_nearer(world, client):
    """Its end stays where it is, and it departs from there."""
    body = body_of(client, "sphere")
    world.add_obstacle(body)
    line = [[HALF, 0, 0], [HALF, 0.02, 0], [0, 0.1, 0]]
    t = world.add_tendon(line, RADIUS, ROPE, 31, inside="push_out")
    t.attach(0, body)
    np.testing.assert_allclose(t.positions[0], [HALF, 0, 0], atol=1e-12)
    assert quiet(world)


@pytest.mark.parametrize("below", [0.0, RADIUS])
@pytest.mark.parametrize("kind", ["box", "sphere"])
@pytest.mark.parametrize("n", [9, 41, 160])
def test_what_leads_through_a_bore_is_not_pushed_away_from_its_mouths(world, client, kind, n, below):
    """There is no surface, whatever the bone was before, also where the bore ends below it."""
    body = body_of(client, kind)
    world.add_obstacle(body)
    way = np.array([0, 0, 1.0])
    world.add_tunnel(body, -1, (below - HALF) * way, (HALF - below) * way, 1.3 * RADIUS, 0.1)
    aside = [0.2 * RADIUS, 0, 0]
    ends = np.array([-0.1 * way, 0.1 * way]) + aside
    t = world.add_tendon(ends, RADIUS, ROPE, n, inside="push_out")
    np.testing.assert_allclose(t.positions, np.linspace(*ends, n), atol=1e-12)
    assert quiet(world, 1)
