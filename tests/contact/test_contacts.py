"""Contact: tendons at rest on bodies of every kind, slopes, and tendons against each other."""

import math

import numpy as np
import pybullet as p
import pytest

import bullet_tendon as bt

RADIUS, G = 0.004, 9.81
SOFT = bt.Material(stiffness=300.0, damping=0.3, friction=1.0)
CORNERS = np.array([[x, y, z] for z in (-0.05, 0.05) for y in (-0.2, 0.2) for x in (-0.3, 0.3)])
FACES = [[0, 2, 1], [1, 2, 3], [4, 5, 6], [5, 7, 6], [0, 1, 4], [1, 5, 4], [2, 6, 3], [3, 6, 7]]
FACES = np.array([*FACES, [0, 4, 2], [2, 4, 6], [1, 3, 5], [3, 7, 5]])
PUBLISHED = {"contact_stiffness": 50.0, "contact_threshold": 2e-4}


def write_obj(path):
    lines = [f"v {x} {y} {z}" for x, y, z in CORNERS] + [f"f {a} {b} {c}" for a, b, c in FACES + 1]
    path.write_text("\n".join(lines) + "\n")
    return str(path)


def static(client, kind, position, **shape):
    number = p.createCollisionShape(kind, physicsClientId=client, **shape)
    return p.createMultiBody(0, number, basePosition=position, physicsClientId=client)


def table(world, kind, tmp_path):
    """A static body whose highest place is the plane z = 0, as an obstacle with friction 0.5."""
    client, meshes = world.physicsClientId, ()
    if kind == "plane":
        body = static(client, p.GEOM_PLANE, [0, 0, 0])
    elif kind == "box":
        body = static(client, p.GEOM_BOX, [0, 0, -0.05], halfExtents=[0.3, 0.2, 0.05])
    elif kind == "sphere":
        body = static(client, p.GEOM_SPHERE, [0, 0, -2], radius=2.0)
    elif kind == "mesh":
        name = write_obj(tmp_path / "table.obj")
        flags = {"fileName": name, "flags": p.GEOM_FORCE_CONCAVE_TRIMESH}
        body, meshes = static(client, p.GEOM_MESH, [0, 0, -0.05], **flags), [name]
    else:
        write_obj(tmp_path / "table.obj")
        concave = ' concave="yes"' if kind == "concave urdf" else ""
        shape = f'<collision{concave}><geometry><mesh filename="table.obj"/></geometry></collision>'
        path = tmp_path / "table.urdf"
        path.write_text(f'<robot name="t"><link name="top">{shape}</link></robot>')
        body = p.loadURDF(str(path), [0, 0, -0.05], useFixedBase=True, physicsClientId=client)
    world.add_obstacle(body, friction=0.5, meshes=meshes)
    return body


KINDS = ["plane", "box", "sphere", "mesh", "urdf", "concave urdf"]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    "options", [{}, {"integrator": "bdf2"}, {"iteration": "single"}, {"bone_contact": "constraint"}], ids=str
)
def test_dropped_tendons_rest_at_their_radius(make_world, tmp_path, kind, options):
    """Distance zero, forces that carry the weight, no drift. On the ball the chords' middles touch."""
    world = make_world(1 / 240, (0, 0, -G), **options)
    body = table(world, kind, tmp_path)
    t = world.add_tendon([[-0.05, 0, 0.012], [0.05, 0, 0.012]], RADIUS, SOFT, 11)
    world.step(400)
    before, weight = t.positions, G * t.masses.sum()
    world.step(200)
    assert np.abs(t.positions - before).max() <= 1e-9
    contacts = world.contacts
    sagitta = 0.01**2 / 8 / 2.0 if kind == "sphere" else 0.0
    assert np.abs(contacts["distance"][contacts["normal_force"] > 0]).max() <= 2 * sagitta + 1e-6
    assert contacts["distance"].min() >= -1e-6
    up = (contacts["normal_force"][:, None] * contacts["normal"]).sum(0)
    if kind != "sphere":  # there friction carries a share
        np.testing.assert_allclose(up, [0, 0, weight], atol=1e-6 * weight)
    np.testing.assert_allclose(world.wrench(body)[:3], [0, 0, -weight], atol=1e-6 * weight)
    np.testing.assert_allclose(t.velocities, 0, atol=1e-9)


@pytest.mark.parametrize("kind", ["plane", "box", "mesh"])
@pytest.mark.parametrize("iteration", ["newton", "single"])
def test_the_papers_spring_yields_by_weight_over_stiffness(make_world, tmp_path, kind, iteration):
    """The spring's rest length exceeds touching by the threshold."""
    world = make_world(1 / 240, (0, 0, -G), iteration=iteration, **PUBLISHED)
    table(world, kind, tmp_path)
    rope = bt.Material(stiffness=300.0, damping=0.3, friction=0.0)
    t = world.add_tendon([[-0.05, 0, 0.005], [0.05, 0, 0.005]], RADIUS, rope, 11)
    world.step(1500)
    depth = G * t.masses / PUBLISHED["contact_stiffness"]
    height = RADIUS + PUBLISHED["contact_threshold"] - depth
    np.testing.assert_allclose(t.positions[1:-1, 2], height[1:-1], atol=5e-7)
    contacts = world.contacts
    assert contacts["normal_force"].sum() == pytest.approx(G * t.masses.sum(), rel=1e-6)
    np.testing.assert_allclose(contacts["distance"], t.positions[:, 2] - RADIUS, atol=1e-9)


def test_contact_table(make_world, tmp_path):
    world = make_world(1 / 240, (0, 0, -G))
    assert len(world.contacts) == 0
    body = table(world, "box", tmp_path)
    t = world.add_tendon([[-0.05, 0, RADIUS], [0.05, 0, RADIUS]], RADIUS, SOFT, 11, name="graft")
    world.step(50)
    c = world.contacts
    assert c.dtype.names[:6] == ("tendon", "segment", "bodyUniqueId", "linkIndex", "other_tendon", "kind")
    assert set(c["tendon"]) == {"graft"}
    assert set(zip(c["bodyUniqueId"], c["linkIndex"], c["kind"], c["other_tendon"], strict=True)) == {
        (body, -1, "bone", "")
    }
    np.testing.assert_allclose(c["normal"], np.tile([0, 0, 1.0], (len(c), 1)), atol=1e-12)
    start, end = t.positions[c["segment"]], t.positions[c["segment"] + 1]
    share = (c["position"][:, :1] - start[:, :1]) / (end - start)[:, :1]
    np.testing.assert_allclose(c["position"], start + share * (end - start), atol=1e-12)
    assert ((share >= -1e-9) & (share <= 1 + 1e-9)).all()
    assert c["segment"].min() >= 0
    assert c["segment"].max() <= 9
    assert (c["friction_force"] <= 0.5 * c["normal_force"] + 1e-12).all()


@pytest.mark.parametrize("options", [{}, {"bone_contact": "constraint"}, PUBLISHED], ids=str)
@pytest.mark.parametrize(("angle", "holds"), [(0.40, True), (0.52, False)])
def test_a_slope_holds_as_long_as_friction_does(make_world, tmp_path, angle, holds, options):
    """mu = 0.5: tan(0.40) = 0.42 holds without creep, tan(0.52) = 0.57 slides by g (sin - mu cos)."""
    gravity = (G * math.sin(angle), 0, -G * math.cos(angle))
    world = make_world(1 / 240, gravity, **options)
    table(world, "plane", tmp_path)
    rest = RADIUS + options.get("contact_threshold", 0.0)
    t = world.add_tendon([[0, -0.05, rest], [0, 0.05, rest]], RADIUS, SOFT, 11)
    world.step(240)
    place, speed = t.positions[:, 0], t.velocities[:, 0]
    world.step(240)
    if holds:
        np.testing.assert_allclose(t.positions[:, 0], place, atol=1e-8)
    else:
        gained = t.velocities[:, 0].mean() - speed.mean()
        assert gained == pytest.approx(G * (math.sin(angle) - 0.5 * math.cos(angle)), rel=1e-3)


@pytest.mark.parametrize("angle", [0.10, 0.40])
def test_the_papers_step_holds_on_a_slope(make_world, tmp_path, angle):
    """mu = 0.5. The friction springs keep their stretch, K u = m g sin(angle), from step to step."""
    gravity = (G * math.sin(angle), 0, -G * math.cos(angle))
    world = make_world(1 / 240, gravity, iteration="single", **PUBLISHED)
    body = table(world, "plane", tmp_path)
    rest = RADIUS + PUBLISHED["contact_threshold"]
    t = world.add_tendon([[0, -0.05, rest], [0, 0.05, rest]], RADIUS, SOFT, 11)
    world.step(240)
    place = t.positions[:, 0]
    world.step(240)
    np.testing.assert_allclose(t.positions[:, 0], place, atol=1e-8)
    weight = t.masses.sum() * np.array(gravity)
    np.testing.assert_allclose(world.wrench(body)[:3], weight, atol=1e-6 * np.linalg.norm(weight))


def crossing(world, speed=0.0, friction=0.3):
    """Two tendons that cross at right angles, one above the other, 1 mm apart."""
    rope = bt.Material(stiffness=1e3, damping=0.5, friction=friction)
    gap = 2 * RADIUS + 1e-3
    low = world.add_tendon([[-0.1, 0, 0], [0.1, 0.003, 0]], RADIUS, rope, 21)
    high = world.add_tendon([[0.002, -0.1, gap], [0, 0.1, gap]], RADIUS, rope, 21)
    high.set_positions(high.positions, np.tile([0.05 * speed, 0, -speed], (21, 1)))
    return low, high


def between(a, b):
    """Least distance of two polylines, by sampling each segment finely."""
    fine = np.linspace(0, 20, 401)
    points = [np.column_stack([np.interp(fine, np.arange(21), x[:, c]) for c in range(3)]) for x in (a, b)]
    return np.sqrt(((points[0][:, None] - points[1][None]) ** 2).sum(2).min())


@pytest.mark.parametrize("at", [(0, 0, 0), (0.3, -0.2, 0.5)])
def test_centrelines_that_meet_are_parted_across_both(make_world, at):
    """They are put through each other. The direction in which they part is perpendicular to the segments."""
    world = make_world(1e-4)
    lines = np.array([[[-0.05, 0, 0], [0.05, 0, 0]], [[0, -0.05, 0], [0, 0.05, 0]]]) + at
    for line in lines:
        world.add_tendon(line, RADIUS, bt.Material(stiffness=1e3, damping=1.0), 4)
    world.step()
    contacts = world.contacts
    assert len(contacts) == 1
    assert contacts["normal_force"][0] > 0
    np.testing.assert_allclose(np.abs(contacts["normal"][0]), [0, 0, 1], atol=1e-9)


@pytest.mark.parametrize("solver", ["banded", "pcg"])
def test_crossed_tendons_pull_against_each_other(make_world, solver):
    world = make_world(1 / 240, linear_solver=solver)
    low, high = crossing(world)
    low.grip(0), low.grip(-1)
    ends = [high.grip(0), high.grip(-1)]
    for _ in range(120):
        for end in ends:
            end.target = end.target - [0, 0, 2e-4]
        world.step()
        assert between(low.positions, high.positions) >= 0.98 * 2 * RADIUS
    contacts = world.contacts
    assert set(contacts["kind"]) == {"tendon"}
    assert set(contacts["tendon"]) | set(contacts["other_tendon"]) == {low.name, high.name}
    assert contacts["normal_force"].max() > 1
    world.step(240)
    assert between(low.positions, high.positions) >= 0.98 * 2 * RADIUS


@pytest.mark.parametrize("iteration", ["newton", "single"])
@pytest.mark.parametrize("speed", [0.3, 3.0])
def test_colliding_tendons_keep_their_momentum(make_world, speed, iteration):
    world = make_world(1 / 960, iteration=iteration, linear_tolerance=1e-14, tolerance=1e-10)
    low, high = crossing(world, speed)

    def momentum():
        return sum((t.masses[:, None] * t.velocities).sum(0) for t in (low, high))

    before, size, touched = momentum(), np.linalg.norm(momentum()), False
    for _ in range(60):
        world.step()
        touched |= len(world.contacts) > 0 and world.contacts["normal_force"].max() > 0
        assert np.abs(momentum() - before).max() <= 1e-9 * size
        if iteration == "newton":
            assert between(low.positions, high.positions) >= 0.98 * 2 * RADIUS
    assert touched
    assert np.abs((low.masses[:, None] * low.velocities).sum(0)).max() > 0.05 * size


def test_friction_of_a_constrained_end_that_is_pushed_on_a_plate(make_world, client):
    """What stops a particle within an iteration is no normal force: its friction would throw the next one."""
    world = make_world(1 / 240, (0, 0, -9.81), bone_contact="constraint", on_failure="warn")
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.2, 0.2, 0.02], physicsClientId=client)
    plate = p.createMultiBody(0, shape, -1, (0, 0, -0.02), physicsClientId=client)
    world.add_obstacle(plate, friction=1.0)
    way, foot = np.array([math.sin(0.2), 0, math.cos(0.2)]), np.array([0, 0, 1.05e-3])
    cord = bt.Material(stiffness=500.0, damping=0.5, friction=0.7)
    t = world.add_tendon([foot, foot + 0.05 * way], 1e-3, cord, 30)
    t.set_force(-1, -0.2 * way)
    solves = 0
    for _ in range(40):
        world.step()
        solves += world.report.counts["linear_solves"]
    assert solves < 60_000
