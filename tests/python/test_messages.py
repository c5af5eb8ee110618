"""What worlds and their parts tell of themselves: one line with units; a page with costs and advice."""

import math
import pickle

import numpy as np
import pybullet as p
import pytest

import bullet_tendon as bt
from bullet_tendon.description import advise

STEEL = bt.Material(stiffness=1e4, damping=1.0, friction=0.3)


def box(world, friction=0.5, half=0.02):
    client = world.physicsClientId
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=[half] * 3, physicsClientId=client)
    body = p.createMultiBody(0, shape, basePosition=(0, 0, -half - 0.01), physicsClientId=client)
    world.add_obstacle(body, friction=friction)
    return body


def taut_over(world, body_radius=0.01, particles=8):
    """A tendon drawn tight over a cylinder, in steps that have settled."""
    client = world.physicsClientId
    shape = p.createCollisionShape(p.GEOM_CYLINDER, radius=body_radius, height=0.1, physicsClientId=client)
    turn = p.getQuaternionFromEuler([math.pi / 2, 0, 0])
    body = p.createMultiBody(0, shape, baseOrientation=turn, physicsClientId=client)
    world.add_obstacle(body, friction=0.5)
    reach = body_radius + 0.003
    line = [
        (-0.06, 0, -0.05),
        (-reach, 0, reach * 0.6),
        (0, 0, reach),
        (reach, 0, reach * 0.6),
        (0.06, 0, -0.05),
    ]
    tendon = world.add_tendon(line, 0.002, STEEL, particles, "rope")
    tendon.grip(0), tendon.grip(-1)
    tendon.shorten(0.004)
    world.step(120)
    return tendon


def test_everything_is_told_in_one_line(make_world):
    world = make_world()
    body = box(world)
    tendon = world.add_tendon([(0, 0, 0.01), (0.1, 0, 0.01)], 0.002, STEEL, 11, "rope")
    tendon.grip(0)
    tunnel = world.add_tunnel(body, -1, (0, 0, -0.02), (0, 0, 0.02), 0.004, chamfer=0.0005, name="bore")
    world.step()
    assert str(world) == repr(world)
    assert repr(world) == (
        f"<TendonWorld of client {world.physicsClientId}: 1 tendon (11 particles), 1 tunnel, 1 obstacle link>"
    )
    assert repr(tendon) == (
        "<Tendon 'rope': 11 particles, 100 mm long (rest 100 mm), radius 2 mm, tension 0 to 0 N, 1 held>"
    )
    assert repr(tunnel) == (
        f"<Tunnel 'bore' in body {body}, link -1: radius 4 mm, 40 mm long, friction of the link, "
        "chamfer 0.5 mm>"
    )
    assert repr(STEEL) == (
        "<Material: stiffness 10000 N, exponent 1, damping 1 N s, density 1120 kg/m^3, friction 0.3>"
    )
    tissue = bt.Material(stiffness=1e4, relaxation=((0.2, 0.1), (0.1, 20)), rupture_force=500)
    assert "relaxation 0.2 in 0.1 s + 0.1 in 20 s, rupture_force 500 N>" in repr(tissue)
    told = repr(world.report)
    assert told.startswith("<StepReport: converged by ") and " us (sense " in told and "\n" not in told
    world.remove_tendon(tendon)
    assert repr(tendon) == "<Tendon 'rope', removed>"


def test_what_holds_and_joins_is_told_in_one_line(make_world):
    world = make_world()
    client = world.physicsClientId
    stand, body = box(world), p.createMultiBody(1.0, basePosition=(0, 0, 0.2), physicsClientId=client)
    tendon = world.add_tendon([(0, 0, 0.01), (0.1, 0, 0.01)], 0.002, STEEL, 11, "rope")
    hand, knot = tendon.grip(0), tendon.attach(-1, body, -1, (0.1, 0, -0.19))
    assert repr(hand) == "<Grip of particle 0 of 'rope': force (0, 0, 0) N>"
    assert repr(knot) == f"<Attachment of particle 10 of 'rope' at body {body}, link -1: force (0, 0, 0) N>"
    wrap = world.add_wrap(stand, -1, ("ellipsoid", (0.01, 0.02, 0.03)), (0.2, 0, 0))
    assert repr(wrap) == f"<Wrap, ellipsoid of 10, 20, 30 mm on body {stand}, link -1>"
    line = world.add_ligament([(stand, -1, (0, 0, 0)), (body, -1, (0, 0, 0))], STEEL, 0.2, "line", [wrap])
    assert repr(line) == "<Ligament 'line': 230 mm long (rest 200 mm), force 0 N, with wraps>"
    line.set_tension(5)
    assert repr(line).endswith("under a tension of 5 N>")
    lower = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]) * 0.02
    sides = (stand, -1, (lower, [(0, 1, 2), (0, 2, 3)])), (body, -1, (lower, [(0, 2, 1), (0, 3, 2)]))
    with pytest.warns(bt.CartilageWarning):
        pad = world.add_cartilage(*sides, name="pad")
    between = f"body {stand}, link -1 and body {body}, link -1"
    assert repr(pad) == f"<Cartilage 'pad' between {between}: 0 mm^2 pressed by 0 N>"
    assert "1 ligament, 1 cartilage" in repr(world)
    for part in (line, pad):
        assert repr(part) in world.describe()
    button = tendon.fix(5, body, -1, (0, 0, -0.1), "button", stiffness=1e5)
    assert repr(button) == "<Fixation of particle 5 by button: 0 of 958 N, slipped by 0 mm>"
    device = tendon.pull(6, 20, body, -1, (0, 0, -0.1))
    assert repr(device) == f"<Tensioner between particle 6 and body {body}, link -1: 20 N>"
    beside = world.add_tendon([(0, 0.1, 0.01), (0.1, 0.1, 0.01)], 0.002, STEEL, 11)
    assert repr(bt.Bundle([tendon, beside])) == "<Bundle of 2 strands: 0 N, shares 0, 0 %>"
    device.release(), button.release(), hand.release()
    assert "released" in repr(device) and "released" in repr(button) and "released" in repr(hand)
    world.remove_ligament(line), world.remove_cartilage(pad)
    assert repr(line) == "<Ligament 'line', removed>" and repr(pad) == "<Cartilage 'pad', removed>"


def test_materials_that_differ_are_told_differently_to_the_last_digit():
    base = {"stiffness": 1e4 / 3, "exponent": 2.0, "toe_strain": 0.03, "tension_only": True}
    others = [
        {**base, "stiffness": np.nextafter(base["stiffness"], 0)},
        {**base, "tension_only": False},
        {**base, "toe_strain": 0.03000000001},
        {**base, "damping_form": "whole"},
        {**base, "bending_stiffness": 1e-9},
        {**base, "shear_stiffness": 1.0},
        {**base, "friction": 0.0},
        {**base, "relaxation": ((0.1, 2.0),)},
        {**base, "relaxation": ((0.1, 2.0000000000000004),)},
        {**base, "rupture_force": 1e3},
    ]
    told = [repr(bt.Material(**one)) for one in (base, *others)]
    assert len(set(told)) == len(told)
    assert "damping_form whole" in told[4] and "tension_only" in told[0]
    assert repr(bt.Material(**base)) == told[0]


def test_the_page_tells_contents_and_costs(make_world):
    world = make_world()
    assert "no step yet" in world.describe()
    tendon = taut_over(world, particles=60)
    page = world.describe()
    lines = page.splitlines()
    assert lines[0] == repr(world)[1:-1]
    assert lines[1] == "time step 4.167 ms, gravity (0, 0, 0) m/s^2, implicit_euler"
    assert repr(tendon) in page
    assert "obstacle body 0, link -1: cylinder, friction 0.5" in page
    assert any(line.startswith("last step ") and " us: sense " in line for line in lines)
    assert "advice:" in lines


def advice(world, *words):
    """The pieces of advice in which all words are."""
    return [line for line in advise(world) if all(word in line for word in words)]


def test_a_good_scene_gets_no_advice(make_world):
    world = make_world()
    taut_over(world, particles=90)
    assert advise(world) == []
    assert "nothing that looks wrong" in world.describe()


@pytest.mark.parametrize("factor", [1.0, 1000.0, 0.001])
def test_a_tunnel_and_its_bone_in_other_units(make_world, factor):
    """A bone of 60 mm and its tunnel of 30 mm, where one of them is in millimetres, taken for metres."""
    world = make_world()
    client, half = world.physicsClientId, 0.03 * max(factor, 1.0)
    bone = p.createMultiBody(
        0,
        p.createCollisionShape(p.GEOM_BOX, halfExtents=3 * [half], physicsClientId=client),
        physicsClientId=client,
    )
    world.add_obstacle(bone)
    length = 0.03 / min(factor, 1.0)
    world.add_tunnel(bone, -1, (0, 0, 0), (0, 0, length), radius=0.15 * length, name="drilled")
    told = advice(world, "'drilled'", "metres")
    assert len(told) == (factor != 1.0)


def test_long_segments_over_a_small_cylinder(make_world):
    world = make_world()
    tendon = taut_over(world, particles=9)
    (line,) = advice(world, "'rope'", "particles")
    needed = int(line.split("Give it ")[1].split()[0])
    assert needed > tendon.particles
    finer = make_world()
    finer.add_tendon([(0, 1, 0), (0.1, 1, 0)], 0.002, STEEL, 5)
    assert advice(finer, "particles") == []


def test_a_tendon_that_moves_by_radii_a_step(make_world):
    world = make_world(1 / 240)
    tendon = world.add_tendon([(0, 0, 0), (0.1, 0, 0)], 0.002, STEEL, 11)
    tendon.set_positions(tendon.positions, np.tile([0.0, 0.0, 4.8], (11, 1)))
    (line,) = advice(world, "radii a step")
    assert "10.0 radii" in line and "0.42 ms" in line
    tendon.set_positions(tendon.positions)
    assert advice(world, "radii a step") == []


@pytest.mark.parametrize(("seconds", "told"), [(0.003, 0), (0.4, 1)])
def test_damping_is_held_against_the_stiffness(make_world, seconds, told):
    """A stretch of a massless tendon that is let go decays as exp(-t K / C)."""
    world = make_world()
    material = bt.Material(stiffness=1e4, damping=seconds * 1e4)
    world.add_tendon([(0, 0, 0), (0.1, 0, 0)], 0.002, material, 11)
    found = advice(world, "to go back")
    assert len(found) == told
    assert not told or "takes 0.4 s" in found[0] and "100 N s" in found[0]


@pytest.mark.parametrize("name", ["native_acl", "patellar_tendon", "hamstring_graft"])
def test_published_materials_get_no_advice(make_world, name):
    world = make_world(integrator="bdf2")
    world.add_tendon([(0, 0, 0), (0.1, 0, 0)], 0.003, bt.Material.preset(name), 21)
    assert advise(world) == []


def test_no_damping_is_told_where_the_integrator_has_none(make_world):
    for integrator, told in (("implicit_euler", 0), ("bdf2", 1)):
        world = make_world(integrator=integrator)
        world.add_tendon([(0, 0, 0), (0.1, 0, 0)], 0.002, bt.Material(stiffness=1e4), 11)
        assert len(advice(world, "no damping")) == told


def test_bodies_and_materials_without_friction(make_world):
    world = make_world()
    body = box(world, friction=0.0)
    world.add_tendon(
        [(0, 0, 0.01), (0.1, 0, 0.01)], 0.002, bt.Material(stiffness=1e4, friction=0.0), 11, "rope"
    )
    assert len(advice(world, f"obstacle body {body}", "no friction")) == 1
    assert len(advice(world, "'rope'", "friction is 0")) == 1
    world.add_obstacle(body, friction=0.2)
    assert advice(world, "no friction") == []


def test_a_tendon_inside_a_body_unless_it_is_attached_there(make_world):
    world = make_world()
    body = box(world)
    tendon = world.add_tendon([(0, 0, -0.03), (0.1, 0, -0.03)], 0.002, STEEL, 11, "rope")
    assert len(advice(world, "'rope'", f"inside body {body}")) == 1
    tendon.attach(0, body)
    assert advice(world, "inside") == []


def test_a_step_that_was_stopped(make_world):
    world = make_world(max_linear_solves=1)
    tendon = world.add_tendon([(0, 0, 0), (0.1, 0, 0)], 0.002, bt.Material(stiffness=1e5), 40)
    tendon.grip(0)
    tendon.set_force(-1, (0, 0, 50))
    world.step(3)
    assert not world.report.converged
    assert len(advice(world, "last step")) == 1


@pytest.mark.parametrize(
    "error",
    [
        bt.TendonError("text"),
        bt.InvalidValue("n", -1, "an integer >= 1"),
        bt.UnknownId("bodyUniqueId", 3, "the id of a body"),
        bt.UrdfError("a.urdf", "<tendon name='t'>", "radius", -1.0, "above 0"),
        bt.MissingExtra("k3d", "replay", "a replay"),
        bt.StepFailed("graft", 3, 1.0, 1e-9),
        bt.CaseFailed(4, {"a": 1}, "text"),
        bt.errors.CannotCopy("Tendon"),
    ],
    ids=lambda error: type(error).__name__,
)
def test_errors_reach_other_processes_whole(error):
    again = pickle.loads(pickle.dumps(error))
    assert type(again) is type(error) and str(again) == str(error)
    assert again.args == error.args and vars(again) == vars(error)
