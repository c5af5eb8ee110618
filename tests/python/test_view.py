"""Pictures: what the camera sees, and that nothing is left behind or disturbed."""

from types import SimpleNamespace

import numpy as np
import pybullet as p
import pytest
from pybullet_utils.bullet_client import BulletClient

from bullet_tendon import view
from bullet_tendon.errors import InvalidType, InvalidValue, UnknownId
from bullet_tendon.skin import Skin

SMALL = {"target": [0.0, 0.0, 0.0], "distance": 0.3, "yaw": 0.0, "pitch": 0.0, "width": 160, "height": 120}


@pytest.fixture
def client():
    number = p.connect(p.DIRECT)
    yield number
    p.disconnect(number)


def tendon(start=(-0.05, 0.0, 0.0), end=(0.05, 0.0, 0.0), n=11):
    return SimpleNamespace(
        positions=np.linspace(start, end, n), radius=0.005, tension=np.linspace(0, 100, n - 1), name="t"
    )


def box(client, size=0.02, position=(0.0, 0.0, 0.0), color=(0.9, 0.9, 0.9, 1.0)):
    shape = p.createVisualShape(p.GEOM_BOX, halfExtents=[size] * 3, rgbaColor=color, physicsClientId=client)
    solid = p.createCollisionShape(p.GEOM_BOX, halfExtents=[size] * 3, physicsClientId=client)
    return p.createMultiBody(1.0, solid, shape, position, physicsClientId=client)


def roundness(image) -> float:
    """Area of what is drawn over that of the ellipse in its bounding box."""
    drawn = (image < 250).any(axis=2)
    height, width = (np.ptp(np.flatnonzero(drawn.any(axis=axis))) + 1 for axis in (1, 0))
    return drawn.sum() / (np.pi / 4 * width * height)


def is_tendon(pixel):
    """The tendon's colour is r : g : b = 0.86 : 0.75 : 0.55, whatever the light."""
    pixel = pixel.astype(float)
    return np.allclose(pixel / pixel.sum(), np.array(view.TENDON_COLOR[:3]) / 2.16, atol=0.02)


def test_camera_sees_white_where_nothing_is(client):
    image = view.camera_image(client, **SMALL)
    assert image.shape == (120, 160, 3)
    assert image.dtype == np.uint8
    assert (image == 255).all()


def test_tendon_is_seen_where_it_is(client):
    image = view.render_scene(client, SMALL, tendons=[tendon()])
    scale = 60 / (0.3 * np.tan(np.radians(20)))  # pixels a metre, at the target
    assert is_tendon(image[60, 80])
    assert is_tendon(image[60, round(80 + 0.045 * scale)])
    assert (image[60, round(80 + 0.056 * scale)] == 255).all()
    assert (image[round(60 + 0.008 * scale), 80] == 255).all()


def test_tendon_is_lit_everywhere(client):
    """No black faces: the surface faces outwards and its normals are right, from all around."""
    for yaw in (0, 60, 120, 180, 240, 300):
        image = view.render_scene(client, {**SMALL, "yaw": yaw, "pitch": -35}, tendons=[tendon()])
        assert image.max(axis=2).min() > 80


@pytest.mark.parametrize("up", ["y", "z"])
def test_up_is_up(client, up):
    shift = {"y": (0.0, 0.03, 0.0), "z": (0.0, 0.0, 0.03)}[up]
    image = view.render_scene(
        client, {**SMALL, "up": up}, tendons=[tendon(shift, np.array(shift) + [0.03, 0, 0])]
    )
    rows = np.flatnonzero((image < 255).any(axis=(1, 2)))
    columns = np.flatnonzero((image < 255).any(axis=(0, 2)))
    assert rows.max() < 60
    assert columns.mean() > 80 if up == "z" else len(columns)


def test_bones_are_seen_through_and_restored(client):
    bones = [box(client), box(client, position=(0.0, 0.0, 0.05), color=(0.7, 0.8, 0.9, 1.0))]
    before = [p.getVisualShapeData(bone, physicsClientId=client) for bone in bones]
    alone = view.camera_image(client, **SMALL)
    solid = view.render_scene(client, SMALL, bones, [tendon()], bone_opacity=1.0)
    mixed = view.render_scene(client, SMALL, bones, [tendon()], bone_opacity=0.4)
    np.testing.assert_array_equal(solid[60, 80], alone[60, 80])
    assert not is_tendon(solid[60, 80])
    assert mixed[60, 80, 0] - int(mixed[60, 80, 2]) > 20  # the tendon's yellow shines through
    assert [p.getVisualShapeData(bone, physicsClientId=client) for bone in bones] == before
    np.testing.assert_array_equal(view.camera_image(client, **SMALL), alone)
    assert p.getNumBodies(physicsClientId=client) == 2


TWO_LINKS = """<robot name="two">{links}
<joint name="j" type="fixed"><parent link="a"/><child link="b"/></joint></robot>"""
LINK = """<link name="{name}"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
{visuals}</link>"""
VISUAL = """<visual><origin xyz="{x} 0 0"/><geometry><box size=".02 .02 .02"/></geometry>
<material name="{rgba}"><color rgba="{rgba}"/></material></visual>"""


def two_links(client, path, *colors):
    """A body of two links: one box on the first for each colour but the last, which is the second's."""
    boxes = [VISUAL.format(x=0.04 * i - 0.04, rgba=rgba) for i, rgba in enumerate(colors)]
    links = LINK.format(name="a", visuals="".join(boxes[:-1])) + LINK.format(name="b", visuals=boxes[-1])
    path.write_text(TWO_LINKS.format(links=links))
    return p.loadURDF(str(path), physicsClientId=client)


def test_hidden_restores_every_link_even_after_an_error(client, tmp_path):
    body = two_links(client, tmp_path / "a.urdf", "1 0.2 0 1", "0 0 1 0.5")
    before = p.getVisualShapeData(body, physicsClientId=client)
    image = view.camera_image(client, **SMALL)
    assert (image < 255).any()
    with pytest.raises(KeyError), view.hidden([body], client):
        assert (view.camera_image(client, **SMALL) == 255).all()
        raise KeyError
    assert p.getVisualShapeData(body, physicsClientId=client) == before
    np.testing.assert_array_equal(view.camera_image(client, **SMALL), image)


def test_hidden_refuses_what_pybullet_could_not_restore(client, tmp_path):
    body = two_links(client, tmp_path / "a.urdf", "1 0 0 1", "0 1 0 1", "0 0 1 0.5")
    before = p.getVisualShapeData(body, physicsClientId=client)
    with pytest.raises(InvalidValue, match="one colour per link"), view.hidden([body], client):
        pass
    assert p.getVisualShapeData(body, physicsClientId=client) == before


def test_pictures_do_not_disturb_the_simulation():
    def fall(pictures):
        client = p.connect(p.DIRECT)
        p.setGravity(0, 0, -9.81, physicsClientId=client)
        ground = box(client, 0.05)
        p.changeDynamics(ground, -1, mass=0, physicsClientId=client)
        body = box(client, 0.01, (0.01, 0.0, 0.08))
        t = tendon((-0.1, 0.0, 0.07), (0.1, 0.0, 0.07))
        visual = view.TendonVisual(t, client) if pictures else None
        for i in range(60):
            if pictures and i % 20 == 0:
                view.render_scene(client, SMALL, [ground, body], [t], [((0, 0, 0), (0, 0, 0.1), 0.01)])
                visual.update()
            p.stepSimulation(physicsClientId=client)
        state = p.getBasePositionAndOrientation(body, physicsClientId=client)
        state += p.getBaseVelocity(body, physicsClientId=client)
        p.disconnect(client)
        return state

    assert fall(pictures=True) == fall(pictures=False)


def test_tendon_visual_follows_and_goes(client):
    t = tendon()
    visual = view.TendonVisual(t, BulletClientStub(client))
    assert p.getNumBodies(physicsClientId=client) == len(visual.bodies) == 11
    ends = (
        [0.05, 0.03, -0.02],
        [-0.15, 0.0, 0.0],
        [-0.05, 0.0, 0.03],
    )  # against x; short
    for end in ends * 2:
        t.positions = np.linspace([-0.05, 0.0, 0.0], end, 11)
        visual.update()
        assert len(set(visual.bodies)) == 11
        assert p.getNumBodies(physicsClientId=client) <= 31  # a piece for each length that a segment had
        start = p.getBasePositionAndOrientation(visual.bodies[-1], physicsClientId=client)[0]
        np.testing.assert_allclose(start, t.positions[0], atol=1e-12)
        for i, body in enumerate(visual.bodies[:-1]):
            place, turn = p.getBasePositionAndOrientation(body, physicsClientId=client)
            np.testing.assert_allclose(place, t.positions[i], atol=1e-12)
            axis = np.reshape(p.getMatrixFromQuaternion(turn), (3, 3))[:, 0]
            chord = t.positions[i + 1] - t.positions[i]
            np.testing.assert_allclose(axis, chord / np.linalg.norm(chord), atol=1e-6)
            assert not p.getCollisionShapeData(body, -1, physicsClientId=client)
            assert p.getDynamicsInfo(body, -1, physicsClientId=client)[0] == 0.0
    visual.remove()
    visual.remove()
    assert p.getNumBodies(physicsClientId=client) == 0


class BulletClientStub:
    def __init__(self, client):
        self._client = client


def test_tension_colours_the_segments(client):
    t = tendon()
    visual = view.TendonVisual(t, client, full_tension=100.0)
    colors = [p.getVisualShapeData(body, physicsClientId=client)[0][7] for body in visual.bodies[:-1]]
    np.testing.assert_allclose(colors[0], view.TENDON_COLOR, atol=1e-6)
    np.testing.assert_allclose(colors[-1], view.TAUT_COLOR, atol=1e-6)
    greens = [color[1] for color in colors]
    assert greens == sorted(greens, reverse=True)
    t.tension = np.zeros(10)
    visual.update()
    assert p.getVisualShapeData(visual.bodies[-2], physicsClientId=client)[0][7][1] == pytest.approx(0.75)


def test_a_piece_covers_the_segments_that_its_length_allows(client):
    t = tendon()  # ten segments of 10 mm
    visual = view.TendonVisual(t, client, full_tension=100.0, length=0.031)
    assert len(visual.bodies) == 5
    places = [p.getBasePositionAndOrientation(body, physicsClientId=client)[0] for body in visual.bodies[:-1]]
    np.testing.assert_allclose(places, t.positions[[0, 3, 6, 9]], atol=1e-12)
    greens = [p.getVisualShapeData(body, physicsClientId=client)[0][7][1] for body in visual.bodies[:-1]]
    shares = [t.tension[0:3].mean() / 100, t.tension[3:6].mean() / 100, t.tension[6:9].mean() / 100, 1.0]
    np.testing.assert_allclose(greens, [0.75 + share * (0.10 - 0.75) for share in shares], atol=4e-3)


def test_tunnels_are_drawn_and_removed(client):
    image = view.render_scene(client, SMALL, tunnels=[((-0.03, 0.0, 0.0), (0.03, 0.0, 0.0), 0.01)])
    assert (image[:, :80] < 255).any() and (image[:, 80:] < 255).any()
    assert p.getNumBodies(physicsClientId=client) == 0


def test_bullet_client_object_is_accepted():
    client = BulletClient(p.DIRECT)
    body = view.mesh_body(Skin.tube(tendon()), client)
    assert client.getNumBodies() == 1
    client.removeBody(body)
    client.disconnect()


def test_refusals(client):
    with pytest.raises(UnknownId, match="physicsClientId"):
        view.camera_image(client + 1, **SMALL)
    for name, value in {"distance": 0.0, "width": 0, "up": "w", "fov": 0.0, "target": [0.0, 1.0]}.items():
        with pytest.raises(InvalidValue, match=name):
            view.camera_image(client, **{**SMALL, name: value})
    with pytest.raises(InvalidType, match="yaw"):
        view.camera_image(client, **{**SMALL, "yaw": "left"})
    with pytest.raises(InvalidValue, match="bone_opacity"):
        view.render_scene(client, SMALL, bone_opacity=1.5)
    for bodies, problem in (([99], UnknownId), ([True], UnknownId), (3, InvalidType), ("a", InvalidType)):
        with pytest.raises(problem, match="bones"):
            view.render_scene(client, SMALL, bones=bodies, bone_opacity=1.0)
        with pytest.raises(problem, match="bodies"), view.hidden(bodies, client):
            pass
    for colors, problem in ((3, InvalidType), ([], InvalidValue), ([(255, 0, 0, 1)], InvalidValue)):
        with pytest.raises(problem, match="colors"):
            view.Camera(client, colors=colors)
    for camera in (3, {**SMALL, "zoom": 2}):
        with pytest.raises(InvalidValue, match="camera"):
            view.render_scene(client, camera)
    huge = SimpleNamespace(vertices=np.zeros((131073, 3)), normals=None, triangles=np.zeros((1, 3), int))
    with pytest.raises(InvalidValue, match="131072"):
        view.mesh_body(huge, client)


@pytest.mark.parametrize("kind", ["sphere", "cylinder", "capsule"])
def test_round_bodies_are_round_in_pictures(client, kind):
    shape, sizes = {
        "sphere": (p.GEOM_SPHERE, {"radius": 0.05}),
        "cylinder": (p.GEOM_CYLINDER, {"radius": 0.05, "length": 0.04}),
        "capsule": (p.GEOM_CAPSULE, {"radius": 0.05, "length": 0.04}),
    }[kind]
    look = p.createVisualShape(shape, **sizes, rgbaColor=(0.3, 0.4, 0.5, 1.0), physicsClientId=client)
    turn = p.getQuaternionFromEuler((np.pi / 2, 0, 0))  # the camera looks along the axis
    body = p.createMultiBody(1.0, -1, look, (0.01, 0.3, 0.02), turn, physicsClientId=client)
    before = p.getVisualShapeData(body, physicsClientId=client)
    camera = {**SMALL, "target": (0.01, 0.3, 0.02), "width": 400, "height": 400}
    assert roundness(view.render_scene(client, camera)) == pytest.approx(1, abs=0.005)
    assert roundness(view.camera_image(client, **camera)) == pytest.approx(1, abs=0.005)
    assert p.getVisualShapeData(body, physicsClientId=client) == before


def test_a_round_link_of_two_colours_is_drawn_too(client):
    shapes = p.createVisualShapeArray(
        shapeTypes=[p.GEOM_SPHERE] * 2,
        radii=[0.02] * 2,
        visualFramePositions=[[-0.03, 0, 0], [0.03, 0, 0]],
        rgbaColors=[[1, 0, 0, 1], [0, 0, 1, 1]],
        physicsClientId=client,
    )
    p.createMultiBody(1.0, -1, shapes, physicsClientId=client)
    image = view.render_scene(client, SMALL)
    left, right = (image[60, column].astype(int) for column in (80 - 16, 80 + 16))
    assert left[0] > left[2] + 50 and right[2] > right[0] + 50
