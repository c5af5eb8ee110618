"""Ligaments that wrap around spheres, cylinders and ellipsoids: length, direction, balance."""

import math

import numpy as np
import pybullet as p
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

import bullet_tendon as bt
from bullet_tendon import _core


def body(client, mass, at=(0, 0, 0), turn=(0, 0, 0, 1)):
    shape = p.createCollisionShape(p.GEOM_SPHERE, radius=0.01, physicsClientId=client)
    made = p.createMultiBody(mass, shape, -1, at, turn, physicsClientId=client)
    dynamics = {"localInertiaDiagonal": (1e-3, 1e-3, 1e-3), "linearDamping": 0, "angularDamping": 0}
    p.changeDynamics(made, -1, **dynamics, physicsClientId=client)
    p.setCollisionFilterGroupMask(made, -1, 0, 0, client)
    return made


def shortest(kind, radius, a, b):
    """Length of the shortest way: around a circle, on a cylinder unrolled into the plane."""
    rise = 0.0
    if kind == "cylinder":
        rise, a, b = b[2] - a[2], np.array([*a[:2], 0]), np.array([*b[:2], 0])
    far, other = np.linalg.norm(a), np.linalg.norm(b)
    arc = math.acos(a @ b / far / other) - math.acos(radius / far) - math.acos(radius / other)
    around = math.sqrt(far**2 - radius**2) + radius * arc + math.sqrt(other**2 - radius**2)
    return math.hypot(around, rise)


@pytest.mark.parametrize("kind", ["sphere", "cylinder"])
def test_it_takes_the_shortest_way(make_world, client, kind):
    world = make_world()
    radius, turn = 0.02, Rotation.from_rotvec([0.3, -0.8, 0.5])
    centre = np.array([0.1, 0.2, 0.3])
    stand = body(client, 0, centre, turn.as_quat())
    wrap = world.add_wrap(stand, -1, (kind, radius), (0, 0, 0))
    a, b = np.array([0.03, 0.012, 0.01]), np.array([-0.028, 0.01, -0.02])
    ends = [body(client, 1.0, centre + turn.apply(v)) for v in (a, b)]
    path = [(end, -1, (0, 0, 0)) for end in ends]
    ligament = world.add_ligament(path, bt.Material(stiffness=1e3), wraps=[wrap])
    assert ligament.length == pytest.approx(shortest(kind, radius, a, b), rel=1e-9)
    assert len(ligament.points) == 4 and ligament.length > np.linalg.norm(a - b)
    p.resetBasePositionAndOrientation(ends[1], centre + turn.apply(b + [0, 0.05, 0]), (0, 0, 0, 1), client)
    assert ligament.length == pytest.approx(np.linalg.norm(a - b - [0, 0.05, 0]), rel=1e-9)
    assert len(ligament.points) == 2


AXES = (0.016, 0.021, 0.03)


def around(world, client, radii, a, b):
    """A ligament from a to b around an ellipsoid at the origin."""
    ends = [body(client, 1.0, at) for at in (a, b)]
    wrap = world.add_wrap(body(client, 0), -1, ("ellipsoid", radii), (0, 0, 0))
    path = [(end, -1, (0, 0, 0)) for end in ends]
    return world.add_ligament(path, bt.Material(stiffness=1e3), wraps=[wrap])


def test_an_ellipsoid_with_equal_axes_is_a_sphere(make_world, client):
    a, b = np.array([0.03, 0.012, 0.01]), np.array([-0.028, 0.01, -0.02])
    line = around(make_world(), client, (0.02, 0.02, 0.02), a, b)
    assert line.length == pytest.approx(shortest("sphere", 0.02, a, b), rel=1e-9)


@pytest.mark.parametrize("flatness", [1.5, 3.0, 8.0])
def test_around_an_ellipsoid_it_is_a_geodesic_without_kinks(make_world, client, flatness):
    """The straight parts touch, and scipy's solution of the geodesic from one ends in the other."""
    world, rng, wrapped = make_world(), np.random.default_rng(3), 0
    for _ in range(40):
        radii = 0.02 * flatness ** rng.uniform(-0.5, 0.5, 3)
        a, b = (
            radii * v / np.linalg.norm(v) * (1.02 + rng.exponential(0.5)) for v in rng.normal(size=(2, 3))
        )
        line = around(world, client, tuple(radii), a, b)
        points = line.points
        if len(points) == 2:
            straight = a + np.linspace(0, 1, 2001)[:, None] * (b - a)
            assert ((straight / radii) ** 2).sum(axis=1).min() > 1 - 1e-6
            continue
        wrapped += 1
        arc = line.length - np.linalg.norm(points[1] - a) - np.linalg.norm(b - points[2])
        weights = 1 / radii**2
        comes, goes = ((v / np.linalg.norm(v)) for v in (points[1] - a, b - points[2]))

        def geodesic(_, state, w=weights):
            x, t = state[:3], state[3:]
            return [*t, *(-(w @ t**2) / (w**2 @ x**2) * w * x)]

        found = solve_ivp(geodesic, (0, arc), [*points[1], *comes], method="DOP853", rtol=1e-12, atol=1e-14)
        assert weights @ points[1] ** 2 == pytest.approx(1, abs=1e-9)
        assert (weights * points[1]) @ comes == pytest.approx(0, abs=1e-8 / radii.min())
        assert found.y[:3, -1] == pytest.approx(points[2], abs=1e-8 * radii.max())
        assert found.y[3:, -1] == pytest.approx(goes, abs=2e-7)
    assert wrapped > 4


def shortest_outside(radii, a, b, count=16):
    """Length of the shortest polyline whose points are outside of an ellipsoid, by SLSQP from four starts."""
    straight = np.linspace(a, b, count + 2)[1:-1]
    along = (b - a) / np.linalg.norm(b - a)
    aside = np.cross(along, [0.3, -0.5, 0.8])
    best = np.inf
    for angle in np.linspace(0, 2 * np.pi, 4, endpoint=False):
        push = Rotation.from_rotvec(angle * along).apply(aside / np.linalg.norm(aside))
        start = straight + np.sin(np.linspace(0, np.pi, count + 2))[1:-1, None] * 1.2 * radii.max() * push

        def squares(x):
            steps = np.diff(np.vstack([a, x.reshape(-1, 3), b]), axis=0)
            return (steps**2).sum() * 1e3, (2e3 * (steps[:-1] - steps[1:])).ravel()

        outside = {
            "type": "ineq",
            "fun": lambda x: (x.reshape(-1, 3) ** 2 / radii**2).sum(axis=1) - 1,
            "jac": lambda x: np.array(
                [np.eye(count)[k][:, None] * (2 * v / radii**2) for k, v in enumerate(x.reshape(-1, 3))]
            ).reshape(count, -1),
        }
        found = minimize(squares, start.ravel(), jac=True, method="SLSQP", constraints=outside)
        line = np.vstack([a, found.x.reshape(-1, 3), b])
        if found.success:
            best = min(best, np.linalg.norm(np.diff(line, axis=0), axis=1).sum())
    return best


@pytest.mark.parametrize("seed", range(2))
def test_around_an_ellipsoid_it_is_the_shortest_way(make_world, client, seed):
    """Beside a polyline of 17 chords, which cut corners by (turn of a chord)^2/24."""
    rng = np.random.default_rng(seed)
    radii = 0.02 * 2.5 ** rng.uniform(-0.5, 0.5, 3)
    a = radii * 1.4 * np.array([0.8, 0.5, -0.4])
    b = radii * 1.3 * np.array([-0.9, 0.2, 0.5])
    line = around(make_world(), client, tuple(radii), a, b)
    assert len(line.points) == 4
    assert line.length == pytest.approx(shortest_outside(radii, a, b), rel=5e-3)


def test_the_line_to_draw_lies_on_the_surface(make_world, client):
    world = make_world()
    a, b = np.array([0.03, 0.012, 0.012]), np.array([-0.028, 0.01, -0.02])
    for shape in (("sphere", 0.018), ("cylinder", 0.018), ("ellipsoid", AXES)):
        wrap = world.add_wrap(body(client, 0), -1, shape, (0, 0, 0))
        path = [(body(client, 1.0, at), -1, (0, 0, 0)) for at in (a, b)]
        line = world.add_ligament(path, bt.Material(stiffness=1e3), wraps=[wrap])
        radii = wrap.radii if shape[0] != "cylinder" else np.array([0.018, 0.018, np.inf])
        on = line.line[1:-1]
        assert len(on) > 6
        assert ((on / radii) ** 2).sum(axis=1) == pytest.approx(1, abs=1e-8)
        drawn = np.linalg.norm(np.diff(line.line, axis=0), axis=1).sum()
        assert line.length * 0.999 < drawn < line.length
        assert line.line[[1, -2]] == pytest.approx(line.points[[1, -2]], abs=1e-9)


@pytest.mark.parametrize("kind", ["sphere", "cylinder", "ellipsoid"])
def test_the_gradient_is_the_derivative_of_the_length(make_world, client, kind):
    world = make_world()
    stand = body(client, 1.0)
    ends = [body(client, 1.0, at) for at in ((0.03, 0.012, 0.01), (-0.028, 0.01, -0.02))]
    size = AXES if kind == "ellipsoid" else 0.02
    wrap = world.add_wrap(stand, -1, (kind, size), (0.001, 0.002, 0), (0.1, 0.2, 0, 1))
    path = [(end, -1, (0.001, 0.002, 0.003)) for end in ends]
    ligament = world.add_ligament(path, bt.Material(stiffness=1e3), rest_length=0.06, wraps=[wrap])
    world.step()
    moves = np.zeros((3, 6))

    def term(by):
        return _core.testing.ligament_term(world._core, ligament.slot, moves + by, 1 / 240)

    gradient = term(np.zeros((3, 6)))[1]
    size, step = np.abs(gradient).max(), 1e-6
    assert size > 1
    for k in range(18):
        by = np.zeros(18)
        by[k] = step
        slope = (term(by.reshape(3, 6))[0] - term(-by.reshape(3, 6))[0]) / (2 * step)
        assert slope == pytest.approx(gradient[k], abs=1e-5 * size)


@pytest.mark.parametrize("kind", ["sphere", "cylinder"])
@pytest.mark.parametrize("on_wrap", [False, True], ids=["three links", "an end on the wrap's link"])
def test_the_hessian_is_the_derivative_of_the_gradient(make_world, client, kind, on_wrap):
    world = make_world()
    stand = body(client, 1.0, (0.002, -0.003, 0.001))
    places = (0.03, 0.012, 0.01), (-0.028, 0.01, -0.02)
    ends = [body(client, 1.0, at) for at in places]
    tilt = Rotation.from_rotvec([0.1, 0.2, 0.3]).as_quat()
    wrap = world.add_wrap(stand, -1, (kind, 0.02), (0.001, 0.002, 0), tuple(tilt))
    path = [(end, -1, (0.001, 0.002, 0.003)) for end in ends]
    if on_wrap:
        path[0] = (stand, -1, places[0])
    ligament = world.add_ligament(path, bt.Material(stiffness=1e3), rest_length=0.06, wraps=[wrap])
    assert len(ligament.points) == 4
    world.step()
    links = 3 - on_wrap

    def term(by):
        return _core.testing.ligament_term(world._core, ligament.slot, by, 1 / 240)

    hessian, step = term(np.zeros((links, 6)))[2], 1e-6
    for d in np.random.default_rng(1).standard_normal((8, 6 * links)):
        ahead, behind = (term(side * step * d.reshape(links, 6))[1] for side in (1, -1))
        assert (ahead - behind) @ d / (2 * step) == pytest.approx(d @ hessian @ d, rel=1e-5, abs=1e-2)


def test_two_weights_balance_over_a_pulley(make_world, client):
    """The heavier one falls with (m1 - m2) g/(m1 + m2), and the pulley carries both tensions."""
    world = make_world(1 / 240, (0, 0, -9.81))
    stand = body(client, 0)
    weights = [body(client, mass, (x, 0, -0.3)) for mass, x in ((1.0, 0.02), (1.2, -0.02))]
    turn = (math.sqrt(0.5), 0, 0, math.sqrt(0.5))  # the axis along y
    wrap = world.add_wrap(stand, -1, ("cylinder", 0.02 - 1e-9), (0, 0, 0), turn)
    # A point of the stand above the pulley keeps the path on its upper side.
    path = [(weights[0], -1, (0, 0, 0)), (stand, -1, (0, 0, 0.02)), (weights[1], -1, (0, 0, 0))]
    line = world.add_ligament(path, bt.Material(stiffness=1e5, damping=100.0), wraps=[wrap])
    world.step(60)
    speeds = [p.getBaseVelocity(weight, client)[0][2] for weight in weights]
    exact = 0.2 / 2.2 * 9.81 * 0.25
    assert speeds[0] == pytest.approx(exact, rel=0.02) and speeds[1] == pytest.approx(-exact, rel=0.02)
    tension = 2 * 1.0 * 1.2 / 2.2 * 9.81
    assert line.force == pytest.approx(tension, rel=0.02)
    assert world.wrench(stand)[2] == pytest.approx(-2 * tension, rel=0.02)


@pytest.mark.parametrize("seed", range(3))
def test_free_bodies_keep_their_momentum_around_an_ellipsoid(make_world, client, seed):
    world, rng, masses = make_world(), np.random.default_rng(seed), (0.5, 0.3, 0.4)
    places = (0, 0, 0), (0.035, 0.012, 0.01), (-0.033, 0.01, -0.02)
    bodies = [body(client, mass, at) for mass, at in zip(masses, places, strict=True)]
    wrap = world.add_wrap(bodies[0], -1, ("ellipsoid", AXES), (0.001, 0, 0.002), (0.1, 0.3, 0, 1))
    path = [(bodies[1], -1, (0.002, 0, 0)), (bodies[2], -1, (0, 0.001, 0))]
    line = world.add_ligament(path, bt.Material(stiffness=100.0), rest_length=0.06, wraps=[wrap])
    for one in bodies:
        p.resetBaseVelocity(one, rng.normal(size=3) * 0.1, rng.normal(size=3), client)

    def momentum():
        speeds = [np.array(p.getBaseVelocity(one, client)[0]) for one in bodies]
        return sum(mass * speed for mass, speed in zip(masses, speeds, strict=True))

    start, wrapped = momentum(), 0
    for _ in range(40):
        world.step()
        wrapped += len(line.points) == 4 and abs(line.force) > 1
        assert world.report.converged
        np.testing.assert_allclose(momentum(), start, atol=1e-12)
    assert wrapped > 4


def test_a_weight_over_an_ellipsoid_comes_to_rest(make_world, client):
    world = make_world(1 / 240, (0, 0, -9.81))
    stand, weight = body(client, 0), body(client, 1.0, (0.04, 0.005, -0.05))
    wrap = world.add_wrap(stand, -1, ("ellipsoid", (0.03, 0.02, 0.015)), (0, 0, 0))
    path = [(stand, -1, (-0.05, 0, -0.005)), (stand, -1, (0, 0.003, 0.03)), (weight, -1, (0, 0, 0.01))]
    line = world.add_ligament(path, bt.Material.ligament(3e3), wraps=[wrap])
    world.relax(bodies=[weight])
    assert world.report.converged
    world.step()
    assert line.force == pytest.approx(9.81, rel=1e-5)


def test_bad_wraps_are_refused(make_world, client):
    world = make_world()
    stand, other = body(client, 0), body(client, 1.0, (0.1, 0, 0))
    for shape in (
        ("cone", 0.01),
        ("sphere", 0),
        ("ellipsoid", (1, 1)),
        ("ellipsoid", (1, 1, 0)),
        ("ellipsoid", (11, 1, 1)),
    ):
        with pytest.raises(bt.InvalidValue):
            world.add_wrap(stand, -1, shape, (0, 0, 0))
    with pytest.raises(bt.InvalidType):
        world.add_wrap(stand, -1, 0.01, (0, 0, 0))
    with pytest.raises(bt.InvalidValue):
        world.add_wrap(stand, -1, ("sphere", 0.01), (0, 0, 0), (0, 0, 0, 0))
    with pytest.raises(bt.UnknownId):
        world.add_wrap(77, -1, ("sphere", 0.01), (0, 0, 0))
    path = [(stand, -1, (0, 0, 0)), (other, -1, (0, 0, 0))]
    for wraps in ([3], None, 3):
        with pytest.raises(bt.InvalidType, match="wraps"):
            world.add_ligament(path, bt.Material(stiffness=1e3), wraps=wraps)
    assert world.ligaments == ()
