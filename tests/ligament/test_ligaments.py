"""Ligaments: their law, their derivatives, and how bodies move under them."""

import math

import numpy as np
import pybullet as p
import pytest
from link_scenes import block

import bullet_tendon as bt
from bullet_tendon import _core

G = 9.81


def arm(client, lengths=(0.3, 0.25), axes=((0, 1, 0), (0.6, 0.8, 0))):
    """Links on hinges without motors, each 1 kg, hanging from the origin."""
    n = len(lengths)
    shapes = [
        p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.02, 0.03, length / 2], physicsClientId=client)
        for length in lengths
    ]
    body = p.createMultiBody(
        0,
        -1,
        -1,
        (0, 0, 0),
        linkMasses=[1.0] * n,
        linkCollisionShapeIndices=shapes,
        linkVisualShapeIndices=[-1] * n,
        linkPositions=[(0, 0, 0 if k == 0 else -lengths[k - 1]) for k in range(n)],
        linkOrientations=[(0, 0, 0, 1)] * n,
        linkInertialFramePositions=[(0, 0, -length / 2) for length in lengths],
        linkInertialFrameOrientations=[(0, 0, 0, 1)] * n,
        linkParentIndices=list(range(n)),
        linkJointTypes=[p.JOINT_REVOLUTE] * n,
        linkJointAxis=list(axes),
        physicsClientId=client,
    )
    for link in range(-1, n):
        damping = {"linearDamping": 0, "angularDamping": 0, "jointDamping": 0}
        p.changeDynamics(body, link, **damping, physicsClientId=client)
        p.setCollisionFilterGroupMask(body, link, 0, 0, client)
    for joint in range(n):
        p.setJointMotorControl2(body, joint, p.VELOCITY_CONTROL, force=0, physicsClientId=client)
    return body


LAWS = {
    "linear": bt.Material(stiffness=3e3),
    "power": bt.Material(stiffness=2e4, exponent=1.7, damping=8.0, damping_exponent=1.3),
    "ligament": bt.Material.ligament(5e3),
    "lengthening": bt.Material.ligament(5e3, damping_form="lengthening"),
}


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.filterwarnings("ignore::bullet_tendon.SlackWarning")
@pytest.mark.parametrize("rest", [0.24, 0.28, 0.4], ids=["taut", "toe", "slack"])
def test_gradient_and_hessian_are_derivatives_of_the_potential(make_world, client, name, rest):
    """By central differences, of a path through three links, two points of it on one link."""
    world = make_world()
    places = [(0, 0, 0), (0.1, 0.02, 0.1), (-0.05, 0.1, 0.15)]
    a, b, c = (block(client, 1.0, at) for at in places)
    path = [(a, -1, (0.02, 0.01, 0.03)), (b, -1, (0, 0, -0.02)), (b, -1, (0, 0.01, 0.02)), (c, -1, (0, 0, 0))]
    ligament = world.add_ligament(path, LAWS[name], rest_length=rest)
    world.step()
    rng = np.random.default_rng(3)
    moves = np.concatenate([rng.uniform(-0.004, 0.004, (3, 3)), rng.uniform(-0.05, 0.05, (3, 3))], axis=1)

    def term(by):
        """The term where each link is moved by a shift, and turned by a vector after the one in `moves`."""
        at = moves + by
        for k in range(3):
            at[k, 3:] = composed(by[k, 3:], moves[k, 3:])
        return _core.testing.ligament_term(world._core, ligament.slot, at, 1 / 240)

    _, gradient, hessian = term(np.zeros((3, 6)))
    size, step = max(np.abs(gradient).max(), 1e-3), 1e-6
    for k in range(18):
        by = np.zeros(18)
        by[k] = step
        ahead, behind = term(by.reshape(3, 6)), term(-by.reshape(3, 6))
        assert abs((ahead[0] - behind[0]) / (2 * step) - gradient[k]) <= 2e-6 * size
    directions = rng.standard_normal((6, 18))
    for d in directions:
        ends = [term(side * step * d.reshape(3, 6)) for side in (1, 0, -1)]
        curvature = (ends[0][0] - 2 * ends[1][0] + ends[2][0]) / step**2
        along = (ends[0][1] - ends[2][1]) @ d / (2 * step)
        assert along == pytest.approx(d @ hessian @ d, rel=1e-5, abs=1e-3 * size)
        assert curvature == pytest.approx(d @ hessian @ d, rel=0.05, abs=0.1 * size)


def composed(first, then):
    """Rotation vector of the rotation by `then`, and the one by `first` after it."""
    from scipy.spatial.transform import Rotation

    return (Rotation.from_rotvec(first) * Rotation.from_rotvec(then)).as_rotvec()


def test_a_weight_hangs_by_the_law(make_world, client):
    world = make_world(1 / 240, (0, 0, -G))
    stand, weight = block(client, 0), block(client, 1.5, (0, 0, -0.2))
    material = bt.Material.ligament(4e3, toe_strain=0.04)
    ligament = world.add_ligament([(stand, -1, (0, 0, 0)), (weight, -1, (0, 0, 0.05))], material, 0.15)
    world.step(720)
    strain = math.sqrt(1.5 * G / material.stiffness)
    assert ligament.force == pytest.approx(1.5 * G, rel=1e-6)
    assert ligament.strain == pytest.approx(strain, rel=1e-5)
    np.testing.assert_allclose(world.wrench(weight)[:3], [0, 0, 1.5 * G], atol=1e-5)
    np.testing.assert_allclose(world.wrench(stand)[:3], [0, 0, -1.5 * G], atol=1e-5)


def test_a_block_and_tackle_halves_the_force(make_world, client):
    """A line from the stand down to a block and up again, held at a tension of half the weight."""
    world = make_world(1 / 240, (0, 0, -G))
    stand, weight = block(client, 0), block(client, 2.0, (0, 0, -0.3))
    path = [(stand, -1, (0.01, 0, 0)), (weight, -1, (0, 0, 0)), (stand, -1, (-0.01, 0, 0))]
    line = world.add_ligament(path, bt.Material(stiffness=1e3))
    line.set_tension(2.0 * G / 2 / math.cos(math.atan2(0.01, 0.3)))
    before = np.array(p.getBasePositionAndOrientation(weight, client)[0])
    world.step(240)
    np.testing.assert_allclose(p.getBasePositionAndOrientation(weight, client)[0], before, atol=1e-6)
    assert line.tension == line.force == pytest.approx(2.0 * G / 2 / math.cos(math.atan2(0.01, 0.3)))
    line.set_tension(None)
    assert line.tension is None


@pytest.mark.parametrize("spin", [(0, 0.2, 0), (2, 5, 9), (0, 40, 0)])
def test_the_force_is_that_of_the_place_where_bodies_end(make_world, client, spin):
    """However far a body turns within a step: its path has been measured where pybullet then has it."""
    world = make_world(1 / 240, (0, 0, -G))
    stand, body = block(client, 0), block(client, 2.0, (0.1, 0, -0.3), (0.04, 0.05, 0.2))
    p.resetBaseVelocity(body, (0.5, 0.2, 0), spin, client)
    path = [(stand, -1, (0, 0, 0)), (body, -1, (0, 0.02, 0.15))]
    ligament = world.add_ligament(path, bt.Material(stiffness=1e3), rest_length=0.2)
    for _ in range(60):
        world.step()
        assert ligament.force == pytest.approx(1e3 * ligament.strain, abs=1e-6)


@pytest.mark.parametrize("dt, error", [(1 / 240, 3e-3), (1 / 480, 8e-4)])
def test_links_on_hinges_are_followed_along_their_arcs(make_world, client, dt, error):
    """The path ends where pybullet has the links, to the second order in their turn."""
    world = make_world(dt, (0, 0, -G))
    stand, body = block(client, 0), arm(client)
    for joint, rate in enumerate((6.0, -8.0)):
        p.resetJointState(body, joint, 0.2, rate, client)
    path = [(stand, -1, (0.1, 0, 0)), (body, 1, (0, 0, -0.1))]
    ligament = world.add_ligament(path, bt.Material(stiffness=50.0), rest_length=0.3)
    off = []
    for _ in range(round(0.25 / dt)):
        world.step()
        off.append(abs(ligament.force / 50.0 - ligament.strain))
    assert max(off) <= error


def test_free_bodies_keep_their_momentum(make_world, client):
    world = make_world()
    a, b = block(client, 1.0), block(client, 0.3, (0.1, 0.02, 0.1))
    rng = np.random.default_rng(5)
    for _ in range(5):
        at = rng.uniform(-0.03, 0.03, (2, 3))
        world.add_ligament([(a, -1, at[0]), (b, -1, at[1])], bt.Material.ligament(5e3), rest_length=0.13)
    p.resetBaseVelocity(a, (0.2, -0.1, 0.3), (1, 2, 3), client)
    pulled = 0
    for _ in range(240):
        world.step()
        assert world.report.converged
        pulled += any(ligament.force > 1 for ligament in world.ligaments)
        np.testing.assert_allclose(world.wrench(a)[:3], -world.wrench(b)[:3], atol=1e-12)
        velocities = [np.array(p.getBaseVelocity(body, client)[0]) for body in (a, b)]
        np.testing.assert_allclose(velocities[0] + 0.3 * velocities[1], [0.2, -0.1, 0.3], atol=1e-12)
    assert pulled >= 10


@pytest.mark.parametrize("share", [1, 2, 4])
def test_forces_are_on_the_line_at_the_end_of_a_step(make_world, client, share):
    """A step changes the angular momentum by h (x_a - x_b) x F, with the centres of mass x at its start."""
    dt = 1 / 240 / share
    world = make_world(dt)
    masses, bodies = (1.0, 0.3), (block(client, 1.0), block(client, 0.3, (0.1, 0.02, 0.1)))
    path = [(body, -1, (0, 0, 0)) for body in bodies]
    world.add_ligament(path, bt.Material.ligament(1e4, damping=10.0), rest_length=0.14)
    p.resetBaseVelocity(bodies[1], (0.2, -0.4, 0.3), (0, 0, 0), client)
    lost, first = 0.0, None
    for _ in range(120 * share):
        before = [np.array(p.getBasePositionAndOrientation(body, client)[0]) for body in bodies]
        speeds = [np.array(p.getBaseVelocity(body, client)[0]) for body in bodies]
        start = sum(m * np.cross(x, v) for m, x, v in zip(masses, before, speeds, strict=True))
        first = start if first is None else first
        world.step()
        after = [np.array(p.getBasePositionAndOrientation(body, client)[0]) for body in bodies]
        speeds = [np.array(p.getBaseVelocity(body, client)[0]) for body in bodies]
        end = sum(m * np.cross(x, v) for m, x, v in zip(masses, after, speeds, strict=True))
        force = np.array(world.wrench(bodies[0])[:3])
        np.testing.assert_allclose(np.cross(after[0] - after[1], force), 0, atol=1e-12)
        np.testing.assert_allclose(end - start, dt * np.cross(before[0] - before[1], force), atol=1e-12)
        lost += end - start
    assert np.linalg.norm(lost) < 0.1 / share * np.linalg.norm(first)


def test_a_line_turns_a_hinge_by_its_lever(make_world, client):
    """A set tension against a motor that holds a joint: the torque is the tension times the lever."""
    world = make_world()
    stand, body = block(client, 0), arm(client, (0.3,), ((0, 1, 0),))
    path = [(stand, -1, (0.2, 0, -0.15)), (body, 0, (0, 0, -0.15))]
    line = world.add_ligament(path, bt.Material(stiffness=1e3))
    line.set_tension(12.0)
    p.setJointMotorControl2(body, 0, p.VELOCITY_CONTROL, targetVelocity=0, force=100, physicsClientId=client)
    world.step(60)
    assert p.getJointState(body, 0, client)[3] == pytest.approx(12.0 * 0.15, rel=1e-3)


@pytest.mark.parametrize("form, falls", [("axial", True), ("lengthening", False)])
def test_damping_only_while_lengthening(make_world, client, form, falls):
    """A shortening ligament is braked by axial damping, and not by one that acts while it lengthens."""
    world = make_world()
    stand, weight = block(client, 0), block(client, 1.0, (0, 0, -0.22))
    material = bt.Material(stiffness=1e3, damping=20.0, damping_form=form)
    ligament = world.add_ligament([(stand, -1, (0, 0, 0)), (weight, -1, (0, 0, 0))], material, 0.2)
    world.step()
    elastic = 1e3 * ligament.strain
    assert (ligament.force < 0.99 * elastic) == falls
    p.resetBaseVelocity(weight, (0, 0, -1.0), (0, 0, 0), client)
    world.step()
    assert ligament.force > 1.1 * 1e3 * ligament.strain


def test_tendons_and_ligaments_share_a_body(make_world, client):
    """A weight on a tendon and a ligament of the same stiffness side by side: half of it for each."""
    world = make_world(1 / 240, (0, 0, -G))
    stand, weight = block(client, 0), block(client, 2.0, (0, 0, -0.2))
    material = bt.Material(stiffness=2e3, damping=20.0)
    world.add_ligament([(stand, -1, (0.01, 0, 0)), (weight, -1, (0.01, 0, 0.05))], material)
    points = [(-0.01, 0, 0), (-0.01, 0, -0.15)]
    tendon = world.add_tendon(points, 1e-4, material, particles=6, collides=False)
    tendon.attach(0, stand, position=(-0.01, 0, 0))
    end = tendon.attach(-1, weight, position=(-0.01, 0, 0.05))
    world.step(480)
    assert world.ligaments[0].force == pytest.approx(G, rel=1e-3)
    assert -end.force[2] == pytest.approx(-G, rel=1e-3)


def test_bdf2_takes_implicit_euler_with_ligaments(make_world, client):
    paths = []
    for integrator in ("implicit_euler", "bdf2"):
        world = make_world(1 / 240, (0, 0, -G), integrator=integrator)
        stand, weight = block(client, 0), block(client, 1.0, (0.1, 0, -0.2))
        path = [(stand, -1, (0, 0, 0)), (weight, -1, (0, 0, 0.05))]
        world.add_ligament(path, bt.Material(stiffness=1e3))
        world.step(100)
        paths.append(p.getBasePositionAndOrientation(weight, client)[0])
    np.testing.assert_allclose(paths[0], paths[1], atol=1e-12)


def test_a_state_goes_on_with_the_same_bits(make_world, client):
    world = make_world(1 / 240, (0, 0, -G))
    stand, weight = block(client, 0), block(client, 1.0, (0.1, 0, -0.2))
    path = [(stand, -1, (0, 0, 0)), (weight, -1, (0, 0, 0.05))]
    ligament = world.add_ligament(path, bt.Material.ligament(4e3))
    world.step(20)
    kept, bodies = world.save_state(), p.saveState(client)
    world.step(20)
    ends = world.state_hash(), ligament.force
    world.restore_state(kept)
    p.restoreState(bodies, physicsClientId=client)
    world.step(20)
    assert (world.state_hash(), ligament.force) == ends
    data = world.snapshot()
    ligament.set_tension(5.0)
    world.load_snapshot(data)
    assert ligament.tension is None
    assert (world.state_hash(), ligament.force) == ends


def test_a_state_of_other_ligaments_is_refused(make_world, client):
    world = make_world(1 / 240, (0, 0, -G))
    stand, weight = block(client, 0), block(client, 1.0, (0.1, 0, -0.2))
    path = [(stand, -1, (0, 0, 0)), (weight, -1, (0, 0, 0.05))]
    ligament = world.add_ligament(path, bt.Material.ligament(4e3))
    kept = world.save_state()
    world.remove_ligament(ligament)
    with pytest.raises(bt.StateMismatch):
        world.restore_state(kept)
    assert ligament.removed and world.ligaments == ()
    with pytest.raises(bt.UnknownId):
        _ = ligament.force


def test_a_cut_ligament_lets_go(make_world, client):
    world = make_world(1 / 240, (0, 0, -G))
    stand, weight = block(client, 0), block(client, 1.0, (0, 0, -0.2))
    path = [(stand, -1, (0, 0, 0)), (weight, -1, (0, 0, 0.05))]
    ligament = world.add_ligament(path, bt.Material(stiffness=4e3, damping=20.0))
    world.step(240)
    before = p.getBasePositionAndOrientation(weight, client)[0][2]
    world.remove_ligament(ligament)
    world.step(24)
    fallen = before - p.getBasePositionAndOrientation(weight, client)[0][2]
    assert fallen == pytest.approx(G * 0.1**2 / 2, rel=0.06)


def test_bad_calls_change_nothing(make_world, client):
    world = make_world()
    a, b = block(client, 0), block(client, 1.0, (0.1, 0, 0))
    good, material = [(a, -1, (0, 0, 0)), (b, -1, (0, 0, 0))], bt.Material(stiffness=1e3)
    for path, error in (
        ([good[0]], bt.InvalidValue),
        ([good[0], (a, -1, (0.1, 0, 0))], bt.InvalidValue),  # through one body alone
        ([good[0], (b, 0, (0, 0, 0))], bt.UnknownId),
        ([good[0], (77, -1, (0, 0, 0))], bt.UnknownId),
        ([good[0], (b, -1, (0, 0, np.nan))], bt.InvalidValue),
        ([good[0], (b, -1, (0, 0))], bt.InvalidValue),
        (3, bt.InvalidType),
    ):
        with pytest.raises(error):
            world.add_ligament(path, material)
    with pytest.raises(bt.InvalidType):
        world.add_ligament(good, 1e3)
    with pytest.raises(bt.InvalidValue):
        world.add_ligament(good, material, rest_length=0)
    with pytest.raises(bt.InvalidValue):
        world.add_ligament(good, bt.Material(stiffness=1e3, damping=1.0, damping_form="whole"))
    with pytest.warns(bt.SlackWarning, match=r"rest length of 0.2 m is 100% beyond its path of 0.1 m"):
        ligament = world.add_ligament(good, material, rest_length=0.2, name="slack")
    with pytest.raises(bt.InvalidValue):
        world.add_ligament(good, material, name="slack")
    with pytest.raises(bt.InvalidValue):
        ligament.set_tension(-1)
    with pytest.raises(bt.InvalidValue):
        world.options = bt.SolverOptions.published()
    assert world.ligaments == (ligament,)
    published = bt.TendonWorld(client, bt.SolverOptions.published())
    with pytest.raises(bt.InvalidValue):
        published.add_ligament(good, material)


def test_a_body_in_use_is_missed(make_world, client):
    world = make_world()
    a, b = block(client, 0), block(client, 1.0, (0.1, 0, 0))
    world.add_ligament([(a, -1, (0, 0, 0)), (b, -1, (0, 0, 0))], bt.Material(stiffness=1e3))
    world.step()
    p.removeBody(b, client)
    with pytest.raises(bt.UnknownId):
        world.step()


MEETING = 1e-4  # share of the rest length below which a segment is held together


@pytest.mark.parametrize("beside", [0.0, 0.004])
@pytest.mark.parametrize("mass", [0.05, 0.5, 2.0])
@pytest.mark.parametrize("collide", [False, True])
def test_a_muscle_holds_what_it_has_drawn_together(make_world, client, collide, mass, beside):
    """A force has no direction where its two points meet. There it holds up to 10 N, in any direction.

    The sets of contacts of the boxes that it draws on each other may go in circles in a step.
    """
    world = make_world(gravity=(0, 0, 0))
    half, circles = (0.02, 0.02, 0.02), 0
    ground, body = block(client, 0, half=half), block(client, mass, (0.05, beside, beside / 2), half=half)
    p.setCollisionFilterPair(ground, body, -1, -1, int(collide), client)
    line = world.add_ligament([(ground, -1, (0.02, 0, 0)), (body, -1, (-0.02, 0, 0))], LAWS["linear"])
    rest = line.rest_length
    line.set_tension(10.0)
    for _ in range(480):
        world.step()
        assert world.report.converged == world.report.stops_settled
        assert world.report.counts["linear_solves"] < 200
        circles += not world.report.stops_settled
        assert line.force == 10.0
    assert line.length < 0.01 * rest
    for sense in ((0, 0.6, 0.8), (0, -0.8, 0.6)):
        for load, leaves in ((4.0, False), (11.0, True)):
            state, bodies = world.save_state(), p.saveState(physicsClientId=client)
            for _ in range(120):
                at = line.points[-1]
                world.apply_external_force(body, -1, load * np.array(sense), at, p.WORLD_FRAME)
                world.step()
                assert world.report.converged == world.report.stops_settled
                circles += not world.report.stops_settled
            assert line.length > 0.2 * rest if leaves else line.length < 0.05 * rest
            world.restore_state(state), p.restoreState(bodies, physicsClientId=client)
    assert circles <= 1


@pytest.mark.parametrize("rest", [1e-6, 0.01, 0.1])
@pytest.mark.parametrize("load", [0.0, 2.0, 8.0])
def test_it_holds_by_a_spring_up_to_its_tension(make_world, client, load, rest):
    """Of a point mass: e load / T from the point, e = 1e-4 rest lengths, and 1e-7 m at least."""
    world = make_world(gravity=(0, 0, 0))
    ground, body = block(client, 0), block(client, 1.0, (0.03, 0.01, 0))
    path = [(ground, -1, (0, 0, 0)), (body, -1, (0, 0, 0))]
    line = world.add_ligament(path, bt.Material(stiffness=1e3, tension_only=True))
    line.rest_length = rest
    line.set_tension(10.0)
    for k in range(720):
        at = p.getBasePositionAndOrientation(body, client)[0]
        world.apply_external_force(body, -1, (0, 0, load if k > 360 else 0), at, p.WORLD_FRAME)
        world.step()
        assert world.report.converged
    place = p.getBasePositionAndOrientation(body, client)[0]
    least = max(MEETING * rest, 1e-7)
    np.testing.assert_allclose(place, (0, 0, least * load / 10.0), atol=1e-3 * least)


@pytest.mark.parametrize("apart", [0.0, 0.3, 0.9, 1.1])
def test_derivatives_where_two_points_nearly_meet(make_world, client, apart):
    world = make_world()
    first, other = block(client, 1.0), block(client, 2.0, (0.1, 0, 0))
    rest, way = 0.2, np.array([2, -1, 2]) / 3
    at = np.array([0.05, 0.01, 0.02])
    path = [(first, -1, at), (other, -1, at - (0.1, 0, 0) + apart * MEETING * rest * way)]
    line = world.add_ligament(path, LAWS["linear"], rest_length=rest)
    line.set_tension(7.0)
    world.step(), world.relax()
    p.resetBasePositionAndOrientation(first, (0, 0, 0), (0, 0, 0, 1), client)
    p.resetBasePositionAndOrientation(other, (0.1, 0, 0), (0, 0, 0, 1), client)
    world._bodies.read()

    def term(by):
        return _core.testing.ligament_term(world._core, line.slot, by.reshape(2, 6), 1 / 240)

    _, gradient, hessian = term(np.zeros(12))
    step = 1e-9
    for k in range(12):
        by = step * np.eye(12)[k]
        ahead, behind = term(by), term(-by)
        assert (ahead[0] - behind[0]) / (2 * step) == pytest.approx(gradient[k], abs=1e-4 * 7.0)
        if k < 3 or 6 <= k < 9:  # the arms do not turn
            np.testing.assert_allclose(
                ((ahead[1] - behind[1]) / (2 * step))[[0, 1, 2, 6, 7, 8]],
                hessian[k][[0, 1, 2, 6, 7, 8]],
                atol=1e-3 * np.abs(hessian).max() + 1e-6,
            )


@pytest.mark.parametrize("tension", [50.0, 300.0])
def test_an_equilibrium_where_two_points_meet(make_world, client, tension):
    """Of a block on springs, which a muscle draws to a point beside their equilibrium and holds there."""
    world = make_world(gravity=(0, 0, -G))
    ground, body = block(client, 0), block(client, 0.5, (0.03, 0.01, -0.1))
    spring = bt.Material(stiffness=200.0, damping=5.0, tension_only=True)
    for way in ((0.3, 0, 0), (-0.3, 0, 0), (0, 0.3, 0), (0, -0.3, 0), (0, 0, 0.3)):
        for at in ((0.02, 0, 0), (-0.02, 0, 0), (0, 0.02, 0)):
            world.add_ligament([(ground, -1, way), (body, -1, at)], spring, rest_length=0.2)
    muscle = world.add_ligament([(ground, -1, (0.004, 0, 0.03)), (body, -1, (0, 0, 0))], spring)
    muscle.set_tension(tension)
    world.relax(bodies=[body])
    assert world.report.converged
    assert 0 < muscle.length < MEETING * muscle.rest_length
    place = p.getBasePositionAndOrientation(body, client)[0]
    for _ in range(240):
        world.step()
        assert world.report.converged
    np.testing.assert_allclose(p.getBasePositionAndOrientation(body, client)[0], place, atol=1e-8)
