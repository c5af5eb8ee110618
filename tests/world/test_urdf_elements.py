"""Reading <tunnel> and <tendon> elements: what is right comes out whole, what is wrong is named exactly."""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

from bullet_tendon.errors import InvalidType, UrdfError
from bullet_tendon.urdf_elements import MATERIAL_ATTRIBUTES, read_elements

URDF = Path(__file__).parents[2] / "urdf"
TUNNEL = '<tunnel name="bore" link="a" radius="0.004"><start xyz="0 0 0"/><end xyz="0 0.03 0"/></tunnel>'
TENDON = (
    '<tendon name="graft" radius="0.0035" particles="60">'
    '<material stiffness="5e4" exponent="2" tension_only="true" damping_form="axial"/>'
    '<point link="a" xyz="0 0 1e-3" attach="true"/><point xyz="0 -0.1 0"/></tendon>'
)


@pytest.fixture
def written(tmp_path):
    def write(*elements, robot='<robot name="r">{}</robot>'):
        path = tmp_path / "model.urdf"
        links = '<link name="a"/><link name="b"/>'
        path.write_text(robot.format(links + "".join(elements)), encoding="utf-8")
        return path

    return write


def refused(path) -> UrdfError:
    with pytest.raises(UrdfError) as caught:
        read_elements(path)
    return caught.value


def test_tunnel_comes_out_whole(written):
    (tunnel,) = read_elements(written(TUNNEL.replace(">", ' friction="0.1" chamfer="5e-4">', 1))).tunnels
    assert (tunnel.name, tunnel.link) == ("bore", "a")
    assert (tunnel.radius, tunnel.friction, tunnel.chamfer) == (0.004, 0.1, 5e-4)
    np.testing.assert_array_equal(tunnel.start, [0.0, 0.0, 0.0])
    np.testing.assert_array_equal(tunnel.end, [0.0, 0.03, 0.0])


def test_defaults(written):
    (tunnel,) = read_elements(written(TUNNEL)).tunnels
    assert tunnel.friction is None
    assert tunnel.chamfer == 0.0
    (tendon,) = read_elements(written(TENDON.replace(' particles="60"', ""))).tendons
    assert tendon.particles is None


def test_tendon_comes_out_whole(written):
    (tendon,) = read_elements(written(TENDON)).tendons
    assert (tendon.name, tendon.radius, tendon.particles) == ("graft", 0.0035, 60)
    assert [link for link, _ in tendon.points] == ["a", None]
    np.testing.assert_array_equal([xyz for _, xyz in tendon.points], [[0, 0, 1e-3], [0, -0.1, 0]])
    assert tendon.attachments == (0,)
    expected = {"stiffness": 5e4, "exponent": 2.0, "tension_only": True, "damping_form": "axial"}
    assert tendon.material == expected


def test_every_material_keyword_is_read(written):
    values = dict.fromkeys(MATERIAL_ATTRIBUTES, "1.5") | {"tension_only": "false", "damping_form": "axial"}
    values["relaxation"] = "0.1 0.5  0.2 30"
    attributes = " ".join(f'{name}="{value}"' for name, value in values.items())
    (tendon,) = read_elements(written(_with_material(f"<material {attributes}/>"))).tendons
    numbers = dict.fromkeys(MATERIAL_ATTRIBUTES, 1.5)
    terms = ((0.1, 0.5), (0.2, 30.0))
    assert tendon.material == numbers | {"tension_only": False, "damping_form": "axial", "relaxation": terms}


@pytest.mark.parametrize(("more", "tissue"), [("", False), (' tissue="true"', True)])
def test_preset_is_handed_on(written, more, tissue):
    (tendon,) = read_elements(written(_with_material(f'<material preset="hamstring_graft"{more}/>'))).tendons
    assert tendon.material == {"name": "hamstring_graft", "tissue": tissue}


def test_order_is_kept_and_other_elements_are_ignored(written):
    second = TUNNEL.replace("bore", "aaa")
    found = read_elements(written(TUNNEL, "<!-- note --><gazebo/>", second, TENDON))
    assert [tunnel.name for tunnel in found.tunnels] == ["bore", "aaa"]
    assert len(found.tendons) == 1


def test_none_at_all(written):
    found = read_elements(written())
    assert (found.tunnels, found.tendons) == ((), ())


def test_results_are_frozen(written):
    found = read_elements(written(TUNNEL, TENDON))
    for element in (found, found.tunnels[0], found.tendons[0]):
        with pytest.raises(dataclasses.FrozenInstanceError):
            element.name = "other"
    with pytest.raises(ValueError, match="read-only"):
        found.tunnels[0].start[0] = 1.0


@pytest.mark.parametrize("name", ["femur", "tibia", "knee"])
def test_packaged_models(name):
    found = read_elements(URDF / f"{name}.urdf")
    names = {"femur": ["femoral"], "tibia": ["tibial"], "knee": ["femoral", "tibial"]}[name]
    assert [tunnel.name for tunnel in found.tunnels] == names
    assert {tunnel.radius for tunnel in found.tunnels} == {0.004}


WRONG_TUNNELS = [  # what is written, what is written instead, the attribute that the message names
    ('name="bore"', "", "name"),
    ('link="a"', "", "link"),
    ('link="a"', 'link="c"', "link"),
    ('radius="0.004"', "", "radius"),
    ('radius="0.004"', 'radius="wide"', "radius"),
    ('radius="0.004"', 'radius="0"', "radius"),
    ('radius="0.004"', 'radius="nan"', "radius"),
    ('radius="0.004"', 'radius="inf"', "radius"),
    ('radius="0.004"', 'radius="1_0"', "radius"),
    ('radius="0.004"', 'radius="0.004" friction="-0.1"', "friction"),
    ('radius="0.004"', 'radius="0.004" chamfer="-1"', "chamfer"),
    ('radius="0.004"', 'radius="0.004" diameter="0.008"', "diameter"),
    ('<start xyz="0 0 0"/>', "", "<start>"),
    ('<start xyz="0 0 0"/>', '<start xyz="0 0 0"/><start xyz="0 0 0"/>', "<start>"),
    ('<start xyz="0 0 0"/>', '<start xyz="0 0 0"/><middle xyz="0 0 0"/>', "<middle>"),
    ('xyz="0 0.03 0"', 'xyz="0 0 0"', "end"),
]
WRONG_POINTS = [  # inside <start>, so the element named is the child too
    ('<start xyz="0 0 0"/>', "<start/>", "xyz"),
    ('<start xyz="0 0 0"/>', '<start xyz="0 0"/>', "xyz"),
    ('<start xyz="0 0 0"/>', '<start xyz="0 0 0 0"/>', "xyz"),
    ('<start xyz="0 0 0"/>', '<start xyz="0 x 0"/>', "xyz"),
    ('<start xyz="0 0 0"/>', '<start xyz="0 nan 0"/>', "xyz"),
    ('<start xyz="0 0 0"/>', '<start xyz="0 0 0" rpy="0 0 0"/>', "rpy"),
]


@pytest.mark.parametrize("old, new, attribute", WRONG_TUNNELS + WRONG_POINTS)
def test_wrong_tunnel_is_named(written, old, new, attribute):
    assert old in TUNNEL
    path = written(TUNNEL.replace(old, new))
    error = refused(path)
    element = "<tunnel" if old.startswith("name") else "<tunnel name='bore'>"
    _check(error, path, element, attribute)
    if (old, new, attribute) in WRONG_POINTS:
        assert "<start>" in error.element


WRONG_TENDONS = [
    ('name="graft"', "", "name", "<tendon>"),
    ('radius="0.0035"', "", "radius", "<tendon name='graft'>"),
    ('radius="0.0035"', 'radius="-0.0035"', "radius", "<tendon name='graft'>"),
    ('particles="60"', 'particles="1"', "particles", "<tendon name='graft'>"),
    ('particles="60"', 'particles="6.5"', "particles", "<tendon name='graft'>"),
    ('particles="60"', 'particles="' + "9" * 5000 + '"', "particles", "<tendon name='graft'>"),
    ('particles="60"', 'colour="red"', "colour", "<tendon name='graft'>"),
    ("</tendon>", "<spring/></tendon>", "<spring>", "<tendon name='graft'>"),
    ('<point xyz="0 -0.1 0"/>', "", "<point>", "<tendon name='graft'>"),
    ('link="a" xyz', 'link="c" xyz', "link", "<point>"),
    ('link="a" xyz', "xyz", "link", "<point>"),
    ('attach="true"', 'attach="yes"', "attach", "<point>"),
    ('xyz="0 -0.1 0"', 'xyz="0 -0.1 0" radius="1"', "radius", "<point>"),
    ('stiffness="5e4"', "", "stiffness", "<material>"),
    ('stiffness="5e4" exponent="2"', 'preset="x"', "tension_only", "<material>"),
    ('stiffness="5e4"', 'stiffness="0"', "stiffness", "<material>"),
    ('stiffness="5e4"', 'stiffness="5e4" young="1e9"', "young", "<material>"),
    (
        'stiffness="5e4" exponent="2" tension_only="true" damping_form="axial"',
        'preset=""',
        "preset",
        "<material>",
    ),
    ('exponent="2"', 'exponent="0.5"', "exponent", "<material>"),
    ('exponent="2"', 'density="-1"', "density", "<material>"),
    ('exponent="2"', 'damping="nan"', "damping", "<material>"),
    ('exponent="2"', 'toe_strain="0"', "toe_strain", "<material>"),
    ('exponent="2"', 'relaxation="0.1"', "relaxation", "<material>"),
    ('exponent="2"', 'rupture_force="0"', "rupture_force", "<material>"),
    ('tension_only="true"', 'tension_only="2"', "tension_only", "<material>"),
    ('damping_form="axial"', 'damping_form=""', "damping_form", "<material>"),
]


@pytest.mark.parametrize("old, new, attribute, element", WRONG_TENDONS)
def test_wrong_tendon_is_named(written, old, new, attribute, element):
    assert old in TENDON
    path = written(TENDON.replace(old, new))
    error = refused(path)
    _check(error, path, element, attribute)
    assert "<tendon" in error.element


@pytest.mark.parametrize("material", ["", "<material preset='a'/><material preset='b'/>"])
def test_one_material(written, material):
    path = written(_with_material(material))
    _check(refused(path), path, "<tendon name='graft'>", "<material>")


@pytest.mark.parametrize("element, kind", [(TUNNEL, "tunnel"), (TENDON, "tendon")])
def test_names_are_unique_within_a_kind(written, element, kind):
    path = written(element, element)
    _check(refused(path), path, f"<{kind} name=", "name")


def test_a_tunnel_and_a_tendon_may_share_a_name(written):
    found = read_elements(written(TUNNEL, TENDON.replace("graft", "bore")))
    assert [e.name for e in found.tunnels] == [e.name for e in found.tendons] == ["bore"]


@pytest.mark.parametrize("kind, element", [("tunnel", TUNNEL), ("tendon", TENDON)])
def test_elements_in_the_wrong_place_are_not_overlooked(written, kind, element):
    path = written(f'<link name="c">{element}</link>')
    _check(refused(path), path, f"<{kind}>", "place")


def test_broken_xml(written):
    path = written(TUNNEL, robot="<robot>{}")
    _check(refused(path), path, "file", "XML")


def test_other_root(written):
    path = written(robot="<sdf>{}</sdf>")
    _check(refused(path), path, "<sdf>", "root")


def test_missing_file(tmp_path):
    path = tmp_path / "absent.urdf"
    _check(refused(path), path, "file", "path")


def test_directory(tmp_path):
    _check(refused(tmp_path), tmp_path, "file", "path")


@pytest.mark.parametrize("path", [None, 3, math.nan, ["knee.urdf"]])
def test_not_a_path(path):
    with pytest.raises(InvalidType, match="path"):
        read_elements(path)


def _with_material(material: str) -> str:
    head, rest = TENDON.split("<material", 1)
    return head + material + rest.split("/>", 1)[1]


def _check(error: UrdfError, path, element: str, attribute: str):
    message = str(error)
    assert str(path) in message
    assert element in message
    assert attribute in message
    assert error.path == str(path)
    assert element in error.element
    assert attribute in error.attribute
    assert "must be" in message
    assert isinstance(error, ValueError)
