"""Argument checks: what fits comes back in the package's form, what does not is named."""

import math
import pathlib

import numpy as np
import pybullet as p
import pytest

import bullet_tendon as bt
from bullet_tendon import checks
from bullet_tendon.errors import InvalidType, InvalidValue, TendonError, UnknownId

NOT_NUMBERS = ["1", None, True, np.bool_(False), 1j, [1.0], {}]
NOT_FINITE = [math.nan, math.inf, -math.inf, np.float64("nan")]


@pytest.mark.parametrize("value", [2, 2.0, np.float32(2), np.int64(2)])
def test_number_gives_a_float(value):
    result = checks.number("x", value, above=0, at_least=2, at_most=2)
    assert result == 2.0
    assert type(result) is float


@pytest.mark.parametrize("value", NOT_NUMBERS)
def test_number_refuses_other_types(value):
    with pytest.raises(InvalidType, match="x = .*: must be a real number"):
        checks.number("x", value)


@pytest.mark.parametrize("value", NOT_FINITE)
def test_number_refuses_what_is_not_finite(value):
    with pytest.raises(InvalidValue, match="a finite number"):
        checks.number("x", value)


@pytest.mark.parametrize(
    ("value", "bounds", "allowed"),
    [
        (0, {"above": 0}, "a finite number > 0"),
        (0.9, {"at_least": 1}, "a finite number >= 1"),
        (1.1, {"at_most": 1}, "a finite number <= 1"),
        (-1, {"at_least": 0, "at_most": 0.5}, "a finite number >= 0 and <= 0.5"),
    ],
)
def test_bounds_are_told(value, bounds, allowed):
    with pytest.raises(InvalidValue) as caught:
        checks.number("x", value, **bounds)
    assert (caught.value.argument, caught.value.value, caught.value.allowed) == ("x", value, allowed)
    assert str(caught.value) == f"x = {value!r}: must be {allowed}"


@pytest.mark.parametrize("value", [3, np.int32(3), np.uint8(3)])
def test_integer_gives_an_int(value):
    result = checks.integer("n", value, at_least=3, at_most=3)
    assert result == 3
    assert type(result) is int


@pytest.mark.parametrize("value", [3.0, "3", True, None, np.float64(3)])
def test_integer_refuses_other_types(value):
    with pytest.raises(InvalidType, match="an integer"):
        checks.integer("n", value)


@pytest.mark.parametrize("value", [2, 6])
def test_integer_bounds(value):
    with pytest.raises(InvalidValue, match="an integer >= 3 and <= 5"):
        checks.integer("n", value, at_least=3, at_most=5)


def test_arrays_are_new_and_float():
    given = np.array([[1, 2, 3], [4, 5, 6]])
    result = checks.array("points", given, (None, 3))
    assert result.dtype == float
    result[0, 0] = 9
    assert given[0, 0] == 1
    np.testing.assert_array_equal(checks.vector("x", (1, 2, 3)), [1, 2, 3])


@pytest.mark.parametrize("value", [[1, 2], [[1, 2, 3]], 5.0, [1, 2, 3, 4], []])
def test_vectors_of_other_shapes(value):
    with pytest.raises(InvalidValue, match=r"of shape \(3,\)"):
        checks.vector("x", value)


@pytest.mark.parametrize("value", ["abc", [1, "b", 2], [1, [2], 3], [None, {}, 1], object()])
def test_vectors_of_other_things(value):
    with pytest.raises(InvalidType, match=r"numbers of shape \(3,\)"):
        checks.vector("x", value)


@pytest.mark.parametrize("bad", NOT_FINITE)
def test_vectors_are_finite(bad):
    with pytest.raises(InvalidValue, match="finite everywhere"):
        checks.vector("x", [0, bad, 1])


@pytest.mark.parametrize("value", ["c", None, 1, ["a"]])
def test_choices_are_listed(value):
    assert checks.choice("method", "a", ("a", "b")) == "a"
    with pytest.raises(InvalidValue, match="method = .*: must be one of 'a', 'b'"):
        checks.choice("method", value, ("a", "b"))


def test_a_truth_value_is_no_choice_of_numbers():
    assert checks.choice("end", 1, (0, 1)) == 1
    with pytest.raises(bt.InvalidValue, match="end = True"):
        checks.choice("end", True, (0, 1))


def test_flags_and_texts():
    assert checks.flag("on", np.bool_(True)) is True
    assert checks.text("name", "graft") == "graft"
    for value in (1, 0, "true", None):
        with pytest.raises(InvalidType, match="True or False"):
            checks.flag("on", value)
    with pytest.raises(InvalidType, match="a string"):
        checks.text("name", b"graft")
    with pytest.raises(InvalidValue, match="a non-empty string"):
        checks.text("name", "")


def test_errors_are_what_python_expects():
    """Each is a TendonError and the built-in that a caller would catch."""
    for error, builtin in ((InvalidValue, ValueError), (InvalidType, TypeError), (UnknownId, KeyError)):
        found = error("x", 1, "2")
        assert isinstance(found, TendonError)
        assert isinstance(found, builtin)
        assert str(found) == "x = 1: must be 2"


def test_long_values_are_cut():
    text = str(InvalidValue("points", list(range(1000)), "short"))
    assert len(text) < 200
    assert "..." in text


def test_numbers_beyond_floats_are_refused(make_world):
    """By the same errors as others: no overflow comes through."""
    world, law = make_world(), bt.Material(stiffness=1e3)
    line = [[0, 0, 0], [0, 0, 1]]
    for radius in (1e308, 10**400, 5e-324):
        with pytest.raises(InvalidValue, match="radius"):
            world.add_tendon(line, radius, law)
    assert world.tendons == ()
    for client in (2**31, 2**63, 10**400):
        with pytest.raises(bt.UnknownId, match="physicsClientId"):
            bt.TendonWorld(client)
    for springs in ({"ks": 5e-324}, {"p": 1e308}, {"p": 1e308, "spring_length": 2.0}):
        with pytest.raises(InvalidValue, match="ks = "):
            bt.Material.from_springs(**{"ks": 1.0, "spring_length": 0.1, **springs})
    with pytest.raises(InvalidType, match="tendon"):
        bt.Skin.tube(None)


class Hostile:
    """Whatever numpy, float or a message asks of it raises an error of its own."""

    def _refuse(self, *arguments, **named):
        raise OSError("hostile")

    __array__ = __float__ = __index__ = __len__ = __getitem__ = __iter__ = __repr__ = __fspath__ = _refuse


class HostileFloat(float):
    __float__ = __repr__ = Hostile._refuse


class HostileInt(int):
    __int__ = __index__ = __repr__ = Hostile._refuse


class Unfinished:
    """A sequence that ends badly when it is read: it says how often that was."""

    reads = 0
    __repr__ = Hostile._refuse

    def __len__(self):
        return 3

    def __getitem__(self, index):
        Unfinished.reads += 1
        if index == 2:
            raise RuntimeError("unfinished")
        return 1.0


@pytest.mark.parametrize(
    ("check", "make"),
    [
        (checks.number, lambda: Hostile()),
        (checks.number, lambda: HostileFloat(1.0)),
        (checks.integer, lambda: Hostile()),
        (checks.integer, lambda: HostileInt(1)),
        (checks.vector, lambda: Hostile()),
        (checks.vector, lambda: [Hostile()] * 3),
        (checks.vector, lambda: [HostileFloat(1.0)] * 3),
        (checks.vector, lambda: Unfinished()),
        (checks.flag, lambda: Hostile()),
        (checks.text, lambda: Hostile()),
        (checks.path, lambda: Hostile()),
    ],
)
def test_errors_of_the_value_itself_do_not_get_through(check, make):
    with pytest.raises(TendonError, match="x = .*must be"):
        check("x", make())


@pytest.mark.parametrize("name", ["a\0", pathlib.Path("\0.npz")])
def test_a_path_with_null_characters_is_refused(make_world, name):
    """No file has such a name; without a check open() raises a ValueError that names nothing."""
    with pytest.raises(InvalidValue, match="x = .*must be a path without null characters"):
        checks.path("x", name)
    with pytest.raises(InvalidValue, match="path = "):
        make_world().snapshot(name)


def test_a_sequence_that_ends_badly_is_read_and_refused():
    reads = Unfinished.reads
    with pytest.raises(TendonError, match="x = .*must be"):
        checks.vector("x", Unfinished())
    assert Unfinished.reads >= reads + 3


def test_errors_of_the_value_itself_do_not_get_through_the_world(make_world):
    world = make_world()
    t = world.add_tendon([[0, 0, 0], [0, 0, 1]], 0.01, bt.Material(stiffness=1e3), 4)
    before = world.state_hash()
    for call in (
        lambda: world.add_tendon(Hostile(), 0.01, bt.Material(stiffness=1e3)),
        lambda: world.add_tendon([[0, 0, 0], [0, 0, 1]], Hostile(), bt.Material(stiffness=1e3)),
        lambda: world.load_snapshot(Hostile()),
        lambda: world.step(Hostile()),
        lambda: t.set_force(0, Hostile()),
        lambda: t.set_positions(Hostile()),
        lambda: bt.Skin.tube(t, Hostile()),
        lambda: bt.Skin.bind(t, [[0, 0, 0], [1, 0, 0], [0, 1, 0]], Hostile()),
        lambda: world.add_ligament(Hostile(), bt.Material(stiffness=1e3)),
        lambda: bt.Bundle(Hostile()),
        lambda: bt.Bundle(np.array(0)),
        lambda: bt.sweep(len, Hostile()),
        lambda: bt.sweep(len, np.array(0)),
        lambda: bt.Recorder(world, title=Hostile()),
        lambda: t.is_attached_to(Hostile()),
        lambda: t.is_attached_to(np.zeros(3)),
    ):
        with pytest.raises(TendonError):
            call()
        assert world.state_hash() == before


@pytest.mark.parametrize("far", [1e155, 1e300])
def test_a_bore_that_cannot_be_measured_is_not_made(make_world, client, far):
    world, bone = make_world(), p.createMultiBody(0, physicsClientId=client)
    world.add_tendon([[0, 0, 0], [0, 0, 1]], 0.01, bt.Material(stiffness=1e3), 4)
    before = world.state_hash()
    with pytest.raises(InvalidValue, match="end = .*nearer than"):
        world.add_tunnel(bone, -1, (0, 0, 0), (0, 0, far), 0.02)
    assert world.state_hash() == before and not world.tunnels


def test_ids_may_be_numpys(make_world, client):
    world = make_world()
    ball = p.createCollisionShape(p.GEOM_SPHERE, radius=0.1, physicsClientId=client)
    bone = p.createMultiBody(0, ball, physicsClientId=client)
    tendon = world.add_tendon([[0, 0, 1], [0, 0, 2]], 0.01, bt.Material(stiffness=1e3), 4)
    world.add_obstacle(bone)
    for body in (np.int64(bone), (np.int64(bone), np.int32(-1))):
        for enabled in (False, True):
            world.set_collision(tendon, body, enabled)
            assert tendon.collides_with(bone) is enabled
    tendon.attach(0, bone)
    assert tendon.is_attached_to(np.int64(bone))


def test_soft_bodies_are_refused_before_a_step(make_world, client, tmp_path):
    """pybullet gives them a pose, and a mass that is a number from anywhere."""
    p.resetSimulation(p.RESET_USE_DEFORMABLE_WORLD, physicsClientId=client)
    path = tmp_path / "cloth.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3\nf 1 3 4\n")
    cloth = p.loadSoftBody(str(path), mass=1, useMassSpring=1, useBendingSprings=1, physicsClientId=client)
    bone = p.createMultiBody(0, physicsClientId=client)
    world, material = make_world(), bt.Material(stiffness=1e3)
    tendon = world.add_tendon([[0, 0, 0], [0, 0, 1]], 0.01, material, 4)
    before = world.state_hash()
    for call in (
        lambda: tendon.attach(0, cloth),
        lambda: tendon.pull(0, 1.0, cloth, -1, (0, 0, -1)),
        lambda: world.add_obstacle(cloth),
        lambda: world.add_tunnel(cloth, -1, (0, 0, 0), (0, 0, 1), 0.02),
        lambda: world.add_wrap(cloth, -1, ("sphere", 0.1), (0, 0, 0)),
        lambda: world.add_ligament([(cloth, -1, (0, 0, 0)), (bone, -1, (0, 0, 1))], material),
        lambda: world.relax(bodies=[cloth]),
    ):
        with pytest.raises(InvalidValue, match="soft"):
            call()
    assert world.state_hash() == before
    world.step()
