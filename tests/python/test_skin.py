"""The surface mesh: counts, topology, volumes, rigid motions, bound meshes."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from test_centreline import AWKWARD, arc, helix, line

from bullet_tendon.errors import InvalidType, InvalidValue
from bullet_tendon.skin import Skin


def fake(points, radius=0.004):
    return SimpleNamespace(positions=np.array(points, dtype=float), radius=radius)


def volume(vertices, triangles):
    a, b, c = (vertices[corner] for corner in triangles.T)
    return np.einsum("ij,ij->", a, np.cross(b, c)) / 6


def edge_uses(triangles):
    edges = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    return np.unique(edges, axis=0, return_counts=True)


@pytest.mark.parametrize(
    ("particles", "layers", "vertices", "triangles"), [(20, 13, 158, 312), (60, 123, 1478, 2952)]
)
def test_table_1_meshes(particles, layers, vertices, triangles):
    skin = Skin.tube(fake(helix(particles)), ring=12, layers=layers)
    assert skin.vertices.shape == skin.normals.shape == (vertices, 3)
    assert skin.triangles.shape == (triangles, 3)
    assert skin.triangles.dtype == np.int32
    assert skin.centres.shape == (layers, 3)


@pytest.mark.parametrize(("ring", "layers"), [(3, 2), (12, 13), (7, None)])
def test_tube_is_closed_and_consistently_oriented(ring, layers):
    skin = Skin.tube(fake(helix(9)), ring=ring, layers=layers)
    edges, uses = edge_uses(skin.triangles)
    assert (uses == 2).all()
    assert len(skin.vertices) - len(edges) + len(skin.triangles) == 2
    directed = skin.triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    assert len(np.unique(directed, axis=0)) == len(directed)  # each direction of an edge once


def test_straight_tube_is_the_exact_prism():
    skin = Skin.tube(fake(line(20)), ring=12, layers=13, radius=0.003)
    prism = 0.5 * 12 * np.sin(2 * np.pi / 12) * 0.003**2 * 0.1
    assert volume(skin.vertices, skin.triangles) == pytest.approx(prism, rel=1e-12)
    np.testing.assert_allclose(skin.centres, line(13), atol=1e-15)


def test_radius_per_layer_makes_the_exact_frustum():
    skin = Skin.tube(fake(line(5)), ring=8, layers=2, radius=[0.002, 0.004])
    base = 0.5 * 8 * np.sin(2 * np.pi / 8)
    exact = base * 0.1 / 3 * (0.002**2 + 0.002 * 0.004 + 0.004**2)
    # flat quadrilaterals of a frustum: any diagonal gives the same solid
    assert volume(skin.vertices, skin.triangles) == pytest.approx(exact, rel=1e-12)


def test_bending_keeps_the_volume():
    tendon = fake(line(40))
    skin = Skin.tube(tendon, ring=12, layers=123)
    straight = volume(skin.vertices, skin.triangles)
    tendon.positions = arc(40, np.pi, 0.1 / np.pi)
    assert volume(skin.vertices, skin.triangles) == pytest.approx(straight, rel=2e-3)


def test_layers_lie_on_the_smooth_curve_and_end_at_its_ends():
    tendon = fake(arc(20, 2.0, 0.05))
    centres = Skin.tube(tendon, layers=97).centres
    np.testing.assert_array_equal(centres[[0, -1]], tendon.positions[[0, -1]])
    sagitta = 0.05 * (1 - np.cos(2.0 / 19 / 2))
    error = abs(np.linalg.norm(centres, axis=1) - 0.05)
    assert error.max() < 0.2 * sagitta  # the end segments see one neighbour only
    assert error[6:-6].max() < 0.02 * sagitta


def test_normals_are_unit_and_outward():
    skin = Skin.tube(fake(helix(60)), layers=123)
    normals = skin.normals
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-12)
    outward = skin.vertices[:-2] - np.repeat(skin.centres, 12, axis=0)
    outward /= np.linalg.norm(outward, axis=1)[:, None]
    cosine = np.einsum("ij,ij->i", normals[:-2], outward)
    assert cosine[12:-12].min() > 0.99
    assert cosine.min() > 0.3  # the rims share their normal with the caps
    start, end = (
        c / np.linalg.norm(c)
        for c in (skin.centres[0] - skin.centres[1], skin.centres[-1] - skin.centres[-2])
    )
    assert normals[-2] @ start > 0.99
    assert normals[-1] @ end > 0.99


@pytest.mark.parametrize("points", AWKWARD.values(), ids=AWKWARD.keys())
def test_awkward_curves_have_finite_skins(points):
    tendon = fake(points)
    skin = Skin.tube(tendon)
    assert np.isfinite(skin.vertices).all() and np.isfinite(skin.normals).all()
    sound = fake(helix(len(tendon.positions)))
    skin = Skin.tube(sound, layers=9)
    sound.positions = tendon.positions
    assert np.isfinite(skin.vertices).all() and np.isfinite(skin.normals).all()


@st.composite
def rigid_motions(draw, largest=1.5):
    axis = np.array(draw(st.tuples(*[st.floats(-1, 1)] * 3))) + [0.0, 0.0, 1.5]
    angle = draw(st.floats(-largest, largest))
    shift = draw(st.tuples(*[st.floats(-2, 2)] * 3))
    return Rotation.from_rotvec(angle * axis / np.linalg.norm(axis)), np.array(shift)


@settings(max_examples=40, deadline=None)
@given(st.lists(rigid_motions(), min_size=1, max_size=3), st.integers(0, 2**32 - 1))
def test_rigid_motions_carry_the_mesh_rigidly(motions, seed):
    """Up to 90 degrees between two looks, for a centreline that is bent."""
    rng = np.random.default_rng(seed)
    start = helix(15) + 1e-3 * rng.standard_normal((15, 3))
    tendon = fake(start)
    skin = Skin.bind(
        tendon, helix(15)[rng.integers(0, 15, 40)] + 0.004 * rng.standard_normal((40, 3)), [[0, 1, 2]]
    )
    vertices, normals = skin.vertices, skin.normals
    for rotation, shift in motions:
        tendon.positions = rotation.apply(tendon.positions) + shift
        vertices, normals = rotation.apply(vertices) + shift, rotation.apply(normals)
        np.testing.assert_allclose(skin.vertices, vertices, atol=1e-10)
        np.testing.assert_allclose(skin.normals[:3], normals[:3], atol=1e-7)


@settings(max_examples=40, deadline=None)
@given(rigid_motions(largest=3.1))
def test_any_rigid_motion_keeps_every_distance_within_a_layer(motion):
    rotation, shift = motion
    tendon = fake(helix(15))
    skin = Skin.tube(tendon)
    centres = rotation.apply(skin.centres) + shift
    edge = np.linalg.norm(np.diff(skin.vertices[:12], axis=0), axis=1)
    tendon.positions = rotation.apply(tendon.positions) + shift
    np.testing.assert_allclose(skin.centres, centres, atol=1e-10)
    np.testing.assert_allclose(np.linalg.norm(np.diff(skin.vertices[:12], axis=0), axis=1), edge, atol=1e-10)


def test_a_swinging_bow_does_not_roll():
    """A string that swings through its straight line to the other side moves, it does not turn over."""
    a = np.linspace(0.0, 1.0, 21)
    tendon = fake(line(21))
    skin = Skin.tube(tendon, ring=4)
    first = skin.vertices[40:44] - skin.centres[10]
    for height in 0.01 * np.cos(np.linspace(0.0, 40.0, 300)):
        tendon.positions = line(21) + height * np.sin(np.pi * a)[:, None] * [0.0, 1.0, 0.0]
        edge = skin.vertices[40:44] - skin.centres[10]
        np.testing.assert_allclose(edge, first, atol=1e-6)


def test_bound_mesh_round_trip_and_following():
    tendon = fake(helix(30))
    tube = Skin.tube(tendon, ring=10, layers=41)
    rng = np.random.default_rng(3)
    user = tube.vertices + 0.001 * rng.standard_normal(tube.vertices.shape)
    skin = Skin.bind(tendon, user, tube.triangles)
    np.testing.assert_allclose(skin.vertices, user, atol=1e-12)
    np.testing.assert_array_equal(skin.triangles, tube.triangles)
    start = tendon.positions
    tendon.positions = start * [1.0, 1.1, 0.9]
    assert abs(skin.vertices - user).max() > 1e-4
    tendon.positions = start
    np.testing.assert_allclose(skin.vertices, user, atol=1e-8)


def test_bound_mesh_follows_where_the_tube_goes():
    tendon = fake(line(30))
    tube = Skin.tube(tendon, ring=10, layers=31)
    skin = Skin.bind(tendon, tube.vertices, tube.triangles)
    tendon.positions = arc(30, 2.0, 0.05)
    np.testing.assert_allclose(skin.vertices, tube.vertices, atol=1e-9)


def test_results_are_copies_and_kept_until_the_tendon_moves():
    tendon = fake(helix(10))
    skin = Skin.tube(tendon)
    vertices, normals = skin.vertices, skin.normals
    skin.vertices[:] = skin.normals[:] = skin.centres[:] = skin.triangles[:] = 0
    np.testing.assert_array_equal(skin.vertices, vertices)
    np.testing.assert_array_equal(skin.normals, normals)
    assert skin.triangles.any() and skin.centres.any()
    tendon.positions = tendon.positions + 0.01
    np.testing.assert_allclose(skin.vertices, vertices + 0.01, atol=1e-12)


@pytest.mark.parametrize(
    ("arguments", "error", "name"),
    [
        ({"ring": 2}, InvalidValue, "ring"),
        ({"ring": 3.5}, InvalidType, "ring"),
        ({"layers": 1}, InvalidValue, "layers"),
        ({"radius": 0.0}, InvalidValue, "radius"),
        ({"radius": [0.1, 0.2]}, InvalidValue, "radius"),
        ({"layers": 2, "radius": [0.1, -0.2]}, InvalidValue, "radius"),
        ({"radius": float("nan")}, InvalidValue, "radius"),
    ],
)
def test_tube_refuses(arguments, error, name):
    with pytest.raises(error) as caught:
        Skin.tube(fake(helix(10)), **arguments)
    assert caught.value.argument == name


@pytest.mark.parametrize(
    ("vertices", "triangles", "error", "name"),
    [
        (np.eye(3), [[0, 1, 3]], InvalidValue, "triangles"),
        (np.eye(3), [[0, 1, -1]], InvalidValue, "triangles"),
        (np.eye(3), [[0.0, 1.0, 2.0]], InvalidType, "triangles"),
        (np.eye(3), [0, 1, 2], InvalidValue, "triangles"),
        (np.eye(3), np.empty((0, 3), dtype=int), InvalidValue, "triangles"),
        (np.eye(3)[:, :2], [[0, 1, 2]], InvalidValue, "vertices"),
        (np.full((3, 3), np.inf), [[0, 1, 2]], InvalidValue, "vertices"),
    ],
)
def test_bind_refuses(vertices, triangles, error, name):
    with pytest.raises(error) as caught:
        Skin.bind(fake(helix(10)), vertices, triangles)
    assert caught.value.argument == name


def test_other_refusals():
    with pytest.raises(InvalidValue, match="tendon.positions"):
        Skin.tube(fake([[0.0, 0.0, 0.0]]))
    with pytest.raises(InvalidValue, match="length > 0"):
        Skin.tube(fake(np.zeros((4, 3))), layers=3)
    tendon = fake(helix(10))
    skin = Skin.tube(tendon)
    tendon.positions = helix(11)
    with pytest.raises(InvalidValue, match="as bound"):
        _ = skin.vertices
