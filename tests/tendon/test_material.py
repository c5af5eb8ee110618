"""Material: its law against closed forms, the paper's constants, and what it refuses."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import bullet_tendon as bt

LENGTH, RADIUS = 0.1, 0.004
OUT_OF_RANGE = {
    "stiffness": [0, -1, math.nan, math.inf],
    "exponent": [0.99, 0, math.nan],
    "toe_strain": [0, -0.1, math.inf],
    "damping": [-1e-9, math.nan],
    "damping_exponent": [0.5, math.inf],
    "damping_form": ["none", "", None],
    "shear_stiffness": [-1, 501.0],
    "bending_stiffness": [-1, math.nan],
    "density": [0, -1],
    "friction": [-0.1, math.inf],
}
NUMBERS = [name for name in OUT_OF_RANGE if name != "damping_form"]


@pytest.mark.parametrize(("name", "value"), [(n, v) for n, values in OUT_OF_RANGE.items() for v in values])
def test_out_of_range_is_refused(name, value):
    with pytest.raises(bt.InvalidValue) as caught:
        bt.Material(**{"stiffness": 1000.0, name: value})
    assert caught.value.argument == name
    assert f"{name} = {value!r}: must be " in str(caught.value)


@pytest.mark.parametrize("name", [*NUMBERS, "tension_only"])
@pytest.mark.parametrize("value", ["1", [1], 1j])
def test_other_types_are_refused(name, value):
    with pytest.raises(bt.InvalidType) as caught:
        bt.Material(**{"stiffness": 1000.0, name: value})
    assert caught.value.argument == name


def test_material_is_frozen_and_by_keyword():
    material = bt.Material(stiffness=1000.0)
    with pytest.raises(dataclasses.FrozenInstanceError):
        material.stiffness = 1.0
    with pytest.raises(TypeError):
        bt.Material(1000.0)
    assert material == bt.Material(stiffness=1000.0)


def tension_at(world, material, strains, n=2):
    """Tensions (strains, n-1) of a straight tendon of n particles at uniform strains."""
    t = world.add_tendon([[0, 0, 0], [LENGTH, 0, 0]], RADIUS, material, n)
    rest = t.positions
    found = []
    for strain in strains:
        t.set_positions(rest * (1 + strain))
        found.append(t.tension)
    return np.array(found)


@pytest.mark.parametrize("n", [2, 3, 9])
@pytest.mark.parametrize("exponent", [1.0, 1.5, 2.0, 2.3, 3.0])
def test_power_law_at_every_cross_section(make_world, exponent, n):
    """stiffness sgn(s) |s|^p, at the ends too, whatever the share of the shear springs."""
    strains = np.array([-0.3, -0.01, 0.0, 1e-4, 0.02, 0.5])
    material = bt.Material(stiffness=4e3, exponent=exponent, shear_stiffness=1e3)
    exact = 4e3 * np.sign(strains) * np.abs(strains) ** exponent
    found = tension_at(make_world(), material, strains, n)
    np.testing.assert_allclose(found, np.repeat(exact[:, None], n - 1, 1), rtol=1e-9, atol=1e-10)


def test_ligament_law(make_world):
    """Slope s^2/(2 e_t) within the toe region, Slope (s - e_t/2) beyond; nothing under compression."""
    slope, toe = 7e3, 0.06
    strains = np.array([-0.1, -1e-3, 1e-3, 0.03, 0.06, 0.0600001, 0.1, 0.4])
    exact = np.where(strains < toe, slope * strains**2 / (2 * toe), slope * (strains - toe / 2)) * (
        strains > 0
    )
    found = tension_at(make_world(), bt.Material.ligament(slope, toe, damping=0.0), strains)
    np.testing.assert_allclose(found[:, 0], exact, rtol=1e-10, atol=1e-9)


@pytest.mark.parametrize("exponent", [1.5, 3.0])
def test_beyond_the_toe_strain_the_law_is_its_tangent(make_world, exponent):
    toe, strains = 0.05, np.array([-0.2, 0.04, 0.08, 0.3])
    size = np.abs(strains)
    tangent = toe**exponent + exponent * toe ** (exponent - 1) * (size - toe)
    exact = 2e3 * np.sign(strains) * np.where(size < toe, size**exponent, tangent)
    material = bt.Material(stiffness=2e3, exponent=exponent, toe_strain=toe)
    np.testing.assert_allclose(tension_at(make_world(), material, strains)[:, 0], exact, rtol=1e-10)


def test_tension_only_neither_pushes_nor_brakes_while_slack(make_world):
    world = make_world(1e-3)
    material = bt.Material(stiffness=1e3, damping=5.0, tension_only=True)
    t = world.add_tendon([[0, 0, 0], [LENGTH, 0, 0]], RADIUS, material)
    speed = np.array([[1.0, 0, 0], [-1.0, 0, 0]])
    t.set_positions([[0.01, 0, 0], [LENGTH - 0.01, 0, 0]], speed)
    world.step(10)
    np.testing.assert_allclose(t.velocities, speed, atol=1e-12)
    assert (t.tension == 0).all()


@given(
    p=st.floats(1, 4),
    q=st.floats(1, 3),
    ks=st.floats(0.1, 1e6),
    kd=st.floats(0, 1e3),
    length=st.floats(1e-3, 0.1),
)
def test_from_springs_is_the_papers_spring(p, q, ks, kd, length):
    """ks |dx|^p and kd |rate|^q of a spring of that length, with strain s = dx/l and rate r = v/l."""
    material = bt.Material.from_springs(ks=ks, kd=kd, p=p, q=q, spring_length=length)
    dx, v = 0.03 * length, 0.7
    assert material.stiffness * (dx / length) ** p == pytest.approx(ks * dx**p, rel=1e-12)
    assert material.damping * (v / length) ** q == pytest.approx(kd * v**q, rel=1e-12)
    assert (material.exponent, material.damping_exponent) == (p, q)


@pytest.mark.parametrize("p", [1.0, 2.0])
@pytest.mark.parametrize("n", [2, 3])
def test_from_springs_in_short_chains(make_world, n, p):
    ks, spacing, dx = 500.0, LENGTH / (n - 1), 1e-3
    material = bt.Material.from_springs(ks=ks, p=p, spring_length=spacing)
    found = tension_at(make_world(), material, [dx / spacing], n)
    np.testing.assert_allclose(found, ks * dx**p, rtol=1e-10)


@pytest.mark.parametrize("p", [1.0, 1.5, 2.0])
def test_from_springs_inside_a_chain(make_world, p):
    """Moving one inner particle along the chain works against two structure and two shear springs."""
    ks, shear_ks, n, dx = 500.0, 80.0, 9, 2e-3
    spacing = LENGTH / (n - 1)
    material = bt.Material.from_springs(ks=ks, shear_ks=shear_ks, p=p, spring_length=spacing)
    t = make_world().add_tendon([[0, 0, 0], [LENGTH, 0, 0]], RADIUS, material, n)
    x = t.positions
    x[4, 0] += dx
    t.set_positions(x)
    assert t.energy == pytest.approx(2 * (ks + shear_ks) * dx ** (p + 1) / (p + 1), rel=1e-9)


@pytest.mark.parametrize(
    "bad", [{"ks": 0}, {"kd": -1}, {"p": 0.5}, {"q": 0}, {"spring_length": 0}, {"shear_ks": -1}]
)
def test_from_springs_refuses(bad):
    with pytest.raises(bt.InvalidValue) as caught:
        bt.Material.from_springs(**{"ks": 1.0, "spring_length": 0.01, **bad})
    assert caught.value.argument == next(iter(bad))


@pytest.mark.parametrize(("name", "slope"), [("native_acl", 7744.0), ("hamstring_graft", 85500.0)])
def test_presets(name, slope):
    material = bt.Material.preset(name, friction=0.02)
    assert 2 * material.toe * material.stiffness == pytest.approx(slope, rel=1e-12)
    assert material.tension_only
    assert material.friction == 0.02
    with pytest.raises(bt.InvalidValue, match="native_acl"):
        bt.Material.preset("rope")


def spun(make_world, form, q=1.0):
    """Two particles that turn about their middle: position and velocity before and after a step, and mass."""
    world = make_world(1e-3, tolerance=1e-14)
    material = bt.Material(stiffness=500.0, damping=0.5, damping_exponent=q, damping_form=form)
    half, w = np.array([LENGTH / 2, 0, 0]), 20.0
    t = world.add_tendon([-half, half], RADIUS, material)
    t.set_positions([-half, half], [[0, -w * LENGTH / 2, 0], [0, w * LENGTH / 2, 0]])
    before = t.velocities
    world.step()
    return t.positions, before, t.velocities, t.masses


def test_axial_damping_does_not_brake_a_rotation(make_world):
    """No torque: sum of m x1 cross (v1 - v0) is zero, which is implicit Euler's angular momentum balance."""
    x, before, after, masses = spun(make_world, "axial")
    torque = np.cross(x, masses[:, None] * (after - before)).sum(0) / 1e-3
    scale = np.abs(np.cross(x, masses[:, None] * after)).sum() / 1e-3
    np.testing.assert_allclose(torque, 0, atol=1e-10 * scale)


@pytest.mark.parametrize("q", [1.0, 2.0])
def test_whole_damping_brakes_a_rotation(make_world, q):
    """The torque of C |w|^(q-1) w, w = (v_j - v_i)/l, on both ends."""
    x, before, after, masses = spun(make_world, "whole", q)
    torque = np.cross(x, masses[:, None] * (after - before)).sum(0) / 1e-3
    w = (after[1] - after[0]) / LENGTH
    expected = -np.cross(x[1] - x[0], 0.5 * np.linalg.norm(w) ** (q - 1) * w)
    assert abs(expected[2]) > 0.1
    np.testing.assert_allclose(torque, expected, atol=1e-9 * abs(expected[2]))


def test_modulus_gives_the_stiffness_of_a_section(make_world):
    """X = F L/(E A), of a solid round section."""
    world = make_world(gravity=(0, 0, -1e-9))
    modulus, radius, force = 1.2e9, 2e-3, 50.0
    t = world.add_tendon([[0, 0, 0], [0.1, 0, 0]], radius, bt.Material.from_modulus(modulus, radius), 10)
    t.grip(0)
    t.set_force(-1, [force, 0, 0])
    world.relax()
    assert t.length - 0.1 == pytest.approx(force * 0.1 / (modulus * math.pi * radius**2), rel=1e-6)
    chosen = bt.Material.from_modulus(modulus, radius, exponent=1.5, bending_stiffness=1e-4, friction=0.3)
    assert (chosen.exponent, chosen.bending_stiffness, chosen.friction) == (1.5, 1e-4, 0.3)


@pytest.mark.parametrize(
    ("modulus", "radius", "named"),
    [(0, 1e-3, "youngs_modulus"), (-1, 1e-3, "youngs_modulus"), (1e9, 0, "radius"), (1e300, 1e9, "youngs")],
)
def test_moduli_that_are_none_are_refused(modulus, radius, named):
    with pytest.raises(bt.InvalidValue, match=named):
        bt.Material.from_modulus(modulus, radius)
