"""How deep what is touched comes into a tendon under load, and that few distances are asked for."""

import numpy as np
import pybullet as p
import pytest
from bullet_tendon.scenarios import wrap_condyle
from bullet_tendon.scenarios.scene import Options

import bullet_tendon as bt

RADIUS, BORE = 0.004, 0.0045  # m


def circle_distance(x, radius):
    """Of points (k, 3) from the circle around z in the plane z = 0."""
    return np.hypot(np.hypot(x[:, 0], x[:, 1]) - radius, x[:, 2])


@pytest.mark.parametrize("friction", [0.0, 0.1])
@pytest.mark.parametrize("segment", [0.0015, 0.003])
def test_around_the_mouth_of_a_tunnel(make_world, client, segment, friction):
    """Out of a bore, over its edge by 90 degrees and along the bone's flat surface."""
    world = make_world(1 / 240)
    half = [0.05, 0.05, 0.02]
    box = p.createCollisionShape(p.GEOM_BOX, halfExtents=half, physicsClientId=client)
    bone = p.createMultiBody(0, box, basePosition=[0, 0, -0.02], physicsClientId=client)
    world.add_obstacle(bone, friction=1.0)
    world.add_tunnel(bone, -1, [0, 0, -0.02], [0, 0, 0.02], radius=BORE, friction=1.0)
    material = bt.Material(stiffness=6e4, damping=10.0, friction=friction)
    line = [[0, 0, -0.035], [0, 0, 0.006], [0.045, 0, 0.006]]
    t = world.add_tendon(line, RADIUS, material, round(0.086 / segment))
    t.grip(0)
    before = 0.0
    for load, deepest in ((500.0, 0.01), (2000.0, 0.02)):
        for k in range(360):
            t.set_force(-1, [before + (load - before) * min(1, (k + 1) / 240), 0, 0])
            world.step()
            assert world.report.converged
        before = load
        x = t.positions
        fine = np.concatenate([np.linspace(a, b, 20) for a, b in zip(x[:-1], x[1:], strict=True)])
        assert circle_distance(fine, BORE).min() >= (1 - deepest) * RADIUS
        within = x[x[:, 2] < 0]
        assert np.hypot(within[:, 0], within[:, 1]).max() <= BORE - RADIUS + deepest * RADIUS
        beyond = fine[np.hypot(fine[:, 0], fine[:, 1]) > BORE]
        assert beyond[:, 2].min() >= (1 - deepest) * RADIUS
        assert np.hypot(x[0, 0] - x[-1, 0], x[0, 2] - x[-1, 2]) > 0.03  # and it does go around


def wrapped(missed, **options):
    """Positions at the end, and how many distances were asked for; missed: the checks that do not hold."""
    with wrap_condyle.build(Options()) as scene:
        scene.world.options = bt.SolverOptions(**options)
        wrap_condyle.drive(scene, lambda steps, _: steps)
        assert [c.name for c in wrap_condyle.check(scene) if not c.ok] == missed
        return scene.handles.tendon.positions, scene.measured["distances asked for, a step"]


@pytest.mark.parametrize(
    "friction",
    [wrap_condyle.FRICTION, *(pytest.param(mu, marks=pytest.mark.slow) for mu in (0.03, 0.3))],
)
def test_around_the_condyle(monkeypatch, friction):
    """With distances reused and with every one measured anew the same; all its own checks hold.

    The project's femur lets the tendon slip off its side with the smaller friction.
    """
    monkeypatch.setattr(wrap_condyle, "FRICTION", friction)
    slips = friction < 0.1 and not wrap_condyle.REAL.exists()
    missed = ["wrapped by"] if slips else []
    reused, few = wrapped(missed)
    anew, many = wrapped(missed, reuse_tolerance=0.0)
    assert np.abs(reused - anew).max() <= 1e-7
    assert many >= 10 * few


@pytest.mark.parametrize(
    ("radius", "first", "second"), [(0.03, 0.08, 0.11), (0.02, 0.06, 0.06), (0.05, 0.07, 0.2)]
)
def test_length_around_a_cylinder(make_world, client, radius, first, second):
    """sqrt(d1^2 - R^2) + sqrt(d2^2 - R^2) + R phi: d1 and d2 from the axis to the ends, R to the line."""
    world = make_world(1 / 240)
    cylinder = p.createCollisionShape(p.GEOM_CYLINDER, radius=radius, height=0.2, physicsClientId=client)
    world.add_obstacle(p.createMultiBody(0, cylinder, physicsClientId=client))
    around = radius + 0.002
    ends = np.array([[-first, -0.3 * first], [second, 0.2 * second]]) / np.hypot(1, [[0.3], [0.2]])
    ends = np.c_[ends, [0.0, 0.0]]
    top = np.array([0.0, 2 * around, 0.0])
    t = world.add_tendon([ends[0], top, ends[1]], 0.002, bt.Material(stiffness=3e4, damping=3.0), 120)
    t.grip(0)
    t.grip(-1)
    angle = np.arccos(ends[0] @ ends[1] / (first * second))
    angle = 2 * np.pi - angle if np.cross(ends[1], ends[0])[2] < 0 else angle
    phi = angle - np.arccos(around / first) - np.arccos(around / second)
    exact = np.sqrt(first**2 - around**2) + np.sqrt(second**2 - around**2) + around * phi
    by = (t.rest_length - 0.999 * exact) / 240
    for _ in range(240):
        t.shorten(by)
        world.step()
    world.relax(1e-8)
    assert world.report.converged
    assert t.tension.min() > 1.0
    assert t.length == pytest.approx(exact, rel=1e-3)


@pytest.mark.parametrize("kind", ["sphere", "cylinder"])
def test_a_tendon_that_slides_around_a_curve_stays_on_it(make_world, client, kind):
    """Pressed to the surface, it goes 1/25 of its radius of curvature a step. Half the square of that beside
    the surface is where the tangent at the start would take it."""
    world = make_world(1 / 240)
    curve, radius, speed, n = 0.05, 0.002, 0.5, 21
    if kind == "sphere":
        shape = p.createCollisionShape(p.GEOM_SPHERE, radius=curve, physicsClientId=client)
    else:
        shape = p.createCollisionShape(p.GEOM_CYLINDER, radius=curve, height=0.2, physicsClientId=client)
    turn = p.getQuaternionFromEuler([np.pi / 2, 0, 0])
    world.add_obstacle(
        p.createMultiBody(0, shape, baseOrientation=turn, physicsClientId=client), friction=0.0
    )
    angle = np.linspace(0, 1.5, 200)
    line = (curve + radius) * np.c_[np.cos(angle), 0 * angle, np.sin(angle)]
    t = world.add_tendon(line, radius, bt.Material(stiffness=1e3, damping=1.0, friction=0.0), n)

    def outward():
        return t.positions / np.linalg.norm(t.positions, axis=1)[:, None]

    t.set_positions(t.positions, speed * np.cross([0, -1, 0], outward()))
    for step in range(40):
        for i, out in enumerate(outward()):
            t.set_force(i, -8 * t.masses[i] * speed**2 / curve * out)
        world.step()
        if step >= 10:  # it has come down to the surface
            middles = 0.5 * (t.positions[1:] + t.positions[:-1])
            np.testing.assert_allclose(np.linalg.norm(middles, axis=1), curve + radius, atol=1.5e-6)
