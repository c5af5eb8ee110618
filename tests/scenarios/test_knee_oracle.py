"""The quasi-static knee of numpy and scipy: brute force, gradients, closed forms, its own convergence."""

import dataclasses
from pathlib import Path

import knee_oracle
import numpy as np
import pytest
from knee_oracle import Cylinders, Knee, Pose, Strands, Surface, law, law_energy, read_stl, refined

KNEE = Path(__file__).resolve().parents[3] / "shared" / "knee"
real_knee = pytest.mark.skipif(
    not (KNEE / "ligaments.csv").exists(), reason="no real knee beside the checkout"
)


def ball(radius: float, rings: int, centre=(0.0, 0.0, 0.0)):
    """Corners of a sphere of triangles."""
    polar = np.linspace(0, np.pi, rings + 1)
    around = np.linspace(0, 2 * np.pi, 2 * rings + 1)
    point = np.stack(
        [
            np.outer(np.sin(polar), np.cos(around)),
            np.outer(np.sin(polar), np.sin(around)),
            np.outer(np.cos(polar), np.ones_like(around)),
        ],
        axis=-1,
    )
    point[-1], point[:, -1] = point[-1, 0], point[:, 0]
    a, b, c, d = point[:-1, :-1], point[1:, :-1], point[1:, 1:], point[:-1, 1:]
    corners = np.concatenate([np.stack(t, axis=2).reshape(-1, 3, 3) for t in ((a, b, c), (a, c, d))])
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    return radius * corners[area > 1e-12] + centre


def plate(half: float, cells: int):
    """Corners of a square in the plane y = 0 that looks up."""
    grid = np.linspace(-half, half, cells + 1)
    point = np.stack(np.meshgrid(grid, [0.0], grid, indexing="ij"), axis=-1)[:, 0]
    a, b, c, d = point[:-1, :-1], point[:-1, 1:], point[1:, 1:], point[1:, :-1]
    return np.concatenate([np.stack(t, axis=2).reshape(-1, 3, 3) for t in ((a, b, c), (a, c, d))])


def random_strands(rng, count=9):
    femoral = rng.normal(0, 0.01, (count, 3)) + (0, 0.01, 0)
    tibial = rng.normal(0, 0.01, (count, 3)) - (0, 0.03, 0)
    slack = np.linalg.norm(femoral - tibial, axis=1) * rng.uniform(0.88, 1.03, count)
    extra = np.where(rng.random(count) < 0.5, 0.0, rng.uniform(0, 0.02, count))
    stiffness = rng.uniform(1e2, 3e3, count)
    none = Cylinders.none(count)
    return Strands([f"S{i}" for i in range(count)], femoral, tibial, stiffness, slack + extra, extra, none)


def around_cylinders(rng, strands):
    """The strands, each around a cylinder across its middle, of the femur or the tibia."""
    count = len(strands.names)
    along = strands.tibial - strands.femoral
    axes = np.cross(along, rng.normal(size=(count, 3))) + 0.2 * along
    offset = np.cross(along, axes) / np.linalg.norm(np.cross(along, axes), axis=1, keepdims=True)
    radii = rng.uniform(0.2, 0.4, count) * np.linalg.norm(along, axis=1)
    centres = (strands.femoral + strands.tibial) / 2 + 0.6 * radii[:, None] * offset
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    cylinders = Cylinders(centres, axes, radii, rng.random(count) < 0.5)
    return dataclasses.replace(strands, cylinders=cylinders)


def ball_on_plate(strands, cells=50, rings=140) -> Knee:
    """The lowest part of a ball of radius 20 mm."""
    femur = ball(0.02, rings, (0.0, 0.02, 0.0))
    return Knee(strands, femur[(femur[..., 1] < 0.006).all(axis=1)], plate(0.012, cells))


def test_the_signed_distance_is_that_of_the_sphere_it_approaches():
    rng = np.random.default_rng(1)
    points = rng.normal(size=(300, 3))
    points *= (rng.uniform(0.2, 1.8, 300) / np.linalg.norm(points, axis=1))[:, None]
    distance, gradient = Surface(ball(1.0, 90))(points)
    assert distance == pytest.approx(np.linalg.norm(points, axis=1) - 1, abs=2e-3)
    assert np.abs(np.linalg.norm(gradient, axis=1) - 1).max() < 1e-12


def test_the_distance_is_the_least_over_all_triangles_sampled_densely():
    rng = np.random.default_rng(2)
    surface = Surface(ball(1.0, 7))
    weights = rng.dirichlet((0.6, 0.6, 0.6), 4000)
    samples = np.einsum("wk,fkj->wfj", weights, surface.corners).reshape(-1, 3)
    for point in rng.uniform(-1.5, 1.5, (40, 3)):
        least = np.linalg.norm(samples - point, axis=1).min()
        found = abs(surface(point[None])[0][0])
        assert found <= least + 1e-12
        assert found == pytest.approx(least, abs=3e-3)


def test_nothing_is_behind_the_edge_of_an_open_surface():
    beside = np.array([[0.02, -0.001, 0.0], [0.0, -0.001, 0.013], [0.0, -0.001, 0.0]])
    assert (np.sign(Surface(plate(0.012, 8))(beside)[0]) == (1, 1, -1)).all()


def test_tension_is_the_slope_of_the_strands_energy():
    strain, slack, stiffness = np.linspace(-0.02, 0.2, 221), 0.03, 820.0
    step = 1e-7
    slope = law_energy(strain + step, stiffness, slack) - law_energy(strain - step, stiffness, slack)
    assert slope / (2 * step * slack) == pytest.approx(law(strain, stiffness), abs=1e-4)


def test_the_way_around_a_cylinder_is_the_shortest():
    """Of the ways that leave the straight line, meet the cylinder, and follow a helix."""
    rng = np.random.default_rng(2)
    strands = around_cylinders(rng, random_strands(rng))
    c = strands.cylinders
    first, last, between = c.around(strands.femoral, strands.tibial, c.centres, c.axes)
    assert (between > 0).all()
    for k in range(len(between)):
        a, b, axis, radius = strands.femoral[k], strands.tibial[k], c.axes[k], c.radii[k]

        def flat(point, k=k, axis=axis):
            return point - c.centres[k] - (point - c.centres[k]) @ axis * axis

        e1 = flat(first[k]) / radius
        e2 = np.cross(axis, e1)

        def at(place, k=k, e1=e1, e2=e2, axis=axis, radius=radius, first=first):
            angle, rise = place
            return first[k] - radius * e1 + radius * (np.cos(angle) * e1 + np.sin(angle) * e2) + rise * axis

        end = np.arctan2(flat(last[k]) @ e2, flat(last[k]) @ e1), (last[k] - first[k]) @ axis

        def length(x, at=at, a=a, b=b, radius=radius):
            turn, rise = x[2] - x[0], x[3] - x[1]
            ways = np.linalg.norm(at(x[:2]) - a), np.linalg.norm(b - at(x[2:]))
            return sum(ways) + np.hypot(radius * turn, rise)

        found = np.array([0.0, 0.0, *end])
        for point, place in ((first[k], found[:2]), (last[k], found[2:])):
            assert np.linalg.norm(flat(point)) == pytest.approx(radius, rel=1e-9)
            assert at(place) == pytest.approx(point, abs=1e-12)
        least = length(found)
        shifts = np.concatenate([np.eye(4), -np.eye(4), rng.normal(size=(40, 4))])
        for shift in 1e-4 * shifts * [1 / radius, 1, 1 / radius, 1]:
            assert length(found + shift) >= least
        assert np.linalg.norm(a - first[k]) + between[k] + np.linalg.norm(b - last[k]) == pytest.approx(least)


@pytest.mark.parametrize("around", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_generalized_forces_are_the_slope_of_the_energy(seed, around):
    rng = np.random.default_rng(seed)
    strands = random_strands(rng)
    knee = ball_on_plate(around_cylinders(rng, strands) if around else strands)
    pose = Pose(0.3, *rng.normal(0, 0.03, 2), (*rng.normal(0, 5e-4, 1), 6e-4, 1e-4))
    assert len(knee.pressed(pose)[0]) > 20
    step, forces = 1e-7, knee.residual(pose)
    for unit, force in zip(np.eye(5), forces, strict=True):
        slope = (knee.energy(pose.moved(step * unit)) - knee.energy(pose.moved(-step * unit))) / (2 * step)
        assert -slope == pytest.approx(force, abs=1e-3 * np.abs(forces).max())


@pytest.mark.parametrize("depth", [1e-4, 3e-4])
def test_a_ball_on_a_plate_carries_the_closed_form(depth):
    """Of a ball of radius R at the depth d, the foundation carries pi K (R d^2 - d^3/3).

    The facets leave the sphere by 0.3 um.
    """
    knee = ball_on_plate(random_strands(np.random.default_rng(0)).without("S"), 160, 280)
    force = knee.wrench(Pose(0.0, origin=(0.0, depth, 0.0)))[1]
    exact = np.pi * knee.foundation * (0.02 * depth**2 - depth**3 / 3)
    assert -force == pytest.approx(exact, rel=0.02)


def test_equilibrium_is_where_loads_balance():
    rng = np.random.default_rng(5)
    knee = ball_on_plate(random_strands(rng, 14), 24, 80)
    load = {"force": (20.0, -10.0, 3.0), "moment": (0.0, 0.3, 0.0)}
    pose = knee.solve(Pose(0.2), tolerance=0.2, **load)  # the facets' edges are felt
    assert np.abs(knee.residual(pose, **load)).max() < 0.2
    assert np.abs(knee.residual(pose)).max() > 1.0


def test_what_is_held_is_in_balance_where_it_was_found_under_the_load():
    rng = np.random.default_rng(5)
    knee = ball_on_plate(random_strands(rng, 14), 24, 80)
    pose = knee.solve(Pose(0.2), tolerance=0.2, force=(20.0, 0.0, 0.0))
    start = pose.moved(np.array([1e-3, 1e-3, 1e-5, 1e-5, 1e-5]))
    found, force = knee.held(start, pose.translations[1], 15.0, tolerance=0.2)
    assert force == pytest.approx(20.0, abs=0.5)
    assert found.translations == pytest.approx(pose.translations, abs=1e-5)


@real_knee
def test_the_real_knee_hardly_depends_on_the_size_of_its_triangles():
    """A quarter of the triangles' area changes places by 10 um and forces by half a newton or 1 %."""
    coarse = Knee.of_files(KNEE)
    fine = Knee(coarse.strands, coarse.femur.corners, refined(read_stl(KNEE / "tibia_cartilage.stl")))
    pose = coarse.solve(Pose(np.radians(25), origin=(0.0, 5e-4, 0.0)), force=(100.0, 0.0, 0.0))
    again = fine.solve(pose, force=(100.0, 0.0, 0.0))
    assert again.translations == pytest.approx(pose.translations, abs=1e-5)
    found = fine.groups(again)
    for group, tension in coarse.groups(pose).items():
        assert found[group] == pytest.approx(tension, abs=0.5, rel=0.01)


@real_knee
def test_what_is_far_from_the_femur_is_left_out_of_nothing(monkeypatch):
    pose = Pose(np.radians(25), 0.05, -0.1, (0.007, 0.001, 0.0))
    wrench = Knee.of_files(KNEE).wrench(pose)
    monkeypatch.setattr(knee_oracle, "NEAR", 4e-3)
    assert Knee.of_files(KNEE).wrench(pose) == pytest.approx(wrench, rel=1e-12)
