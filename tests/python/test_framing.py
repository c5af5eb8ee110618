"""Framing: cameras see all that they should, from as near as that allows, by the matrices of pybullet."""

import numpy as np
import pybullet as p
import pytest

import bullet_tendon as bt
from bullet_tendon import errors, framing

ROPE = bt.Material(stiffness=1e4, damping=1.0)
DIRECTIONS = (
    {},
    {"yaw": 0, "pitch": 0, "fov": 20},
    {"yaw": -120, "pitch": 35, "up": "y", "fov": 60},
    {"yaw": 77, "pitch": -80},
)
FILLED = 1 - 2 * framing._MARGIN


def in_image(points, camera, aspect) -> np.ndarray:
    """(n, 2) places in the image, each from -1 to 1."""
    axis = {"y": 1, "z": 2}[camera.get("up", "z")]
    angles = camera.get("yaw", 30.0), camera.get("pitch", -30.0)
    seen = p.computeViewMatrixFromYawPitchRoll(camera["target"], camera["distance"], *angles, 0.0, axis)
    lens = p.computeProjectionMatrixFOV(camera.get("fov", 40.0), aspect, 1e-3, 100.0)
    both = np.reshape(lens, (4, 4)).T @ np.reshape(seen, (4, 4)).T
    clip = np.c_[points, np.ones(len(points))] @ both.T
    assert (clip[:, 3] > 0).all()
    return clip[:, :2] / clip[:, 3:]


@pytest.mark.parametrize("direction", DIRECTIONS)
@pytest.mark.parametrize("aspect", [0.5, 1.25, 3.0])
def test_a_fitted_camera_sees_all_points_and_could_not_be_nearer(direction, aspect):
    random = np.random.default_rng(3)
    for spread in ((0.1, 0.1, 0.1), (0.3, 0.01, 0.02), (0.0, 0.5, 0.5)):
        points = random.uniform(-1, 1, (30, 3)) * spread + (0.4, -2.0, 1.0)
        camera = framing.fitted(points, direction, aspect)
        assert camera == {**direction, "target": camera["target"], "distance": camera["distance"]}
        low, high = (f(in_image(points, camera, aspect), axis=0) for f in (np.min, np.max))
        assert (np.maximum(high, -low) <= FILLED + 1e-5).all()
        full = (np.abs(high - FILLED) < 1e-4) & (np.abs(low + FILLED) < 1e-4)
        assert full.any()  # both edges of one direction are touched


def test_one_point_is_seen_in_its_surroundings():
    camera = framing.fitted([(1.0, 2.0, 3.0)], {})
    np.testing.assert_allclose(camera["target"], (1, 2, 3), atol=0.01)
    assert 0.02 < camera["distance"] < 0.1


def test_no_points_are_refused():
    with pytest.raises(errors.InvalidValue, match="points"):
        framing.fitted(np.zeros((0, 3)), {})


def swinging(*extras):
    """A recording of a tendon that swings with a ball at its end; extras(client): further bodies."""
    client = p.connect(p.DIRECT)
    p.setGravity(0, 0, -9.81, client)
    world = bt.TendonWorld(client)
    ball = sphere(client, 0.02, (0.2, 0, 0))
    for extra in extras:
        extra(client)
    tendon = world.add_tendon([(0, 0, 0), (0.2, 0, 0)], 0.002, ROPE, 11)
    tendon.grip(0)
    tendon.attach(-1, ball)
    with bt.Recorder(world, every=1) as recorder:
        world.step(120)
    recording = recorder.recording
    p.disconnect(client)
    return recording


def sphere(client, radius, place, velocity=(0, 0, 0)) -> int:
    shape = p.createVisualShape(p.GEOM_SPHERE, radius=radius, physicsClientId=client)
    body = p.createMultiBody(0.1, -1, shape, place, physicsClientId=client)
    p.resetBaseVelocity(body, velocity, physicsClientId=client)
    return body


def test_an_overview_sees_the_tendon_and_its_ball_all_the_time():
    recording = swinging()
    camera = framing.overview(recording, {"yaw": 0, "pitch": 0})
    points = recording.tendons[0].positions.reshape(-1, 3)
    assert np.ptp(points[:, 2]) > 0.15  # it does swing
    seen = in_image(np.vstack([points, recording.links[0].position]), camera, framing.ASPECT)
    assert np.abs(seen).max() <= FILLED
    assert np.abs(seen).max() > 0.6 * FILLED  # the ball's edge is farther out


def test_what_is_huge_flies_away_or_was_out_of_the_image_does_not_count():
    alone = framing.overview(swinging(), {"yaw": 0, "pitch": 0})

    def floor(client):
        shape = p.createVisualShape(p.GEOM_BOX, halfExtents=[5, 5, 0.01], physicsClientId=client)
        p.createMultiBody(0, -1, shape, (0, 0, -0.3), physicsClientId=client)

    def parked(client):
        sphere(client, 0.03, (0, 0, 2.0), (0, 0, 0.5 * 9.81))

    def shot(client):
        sphere(client, 0.02, (0.1, 0, 0), (0, 0, 100.0))

    assert framing.overview(swinging(floor), {"yaw": 0, "pitch": 0}) == alone
    given = {"target": (0.1, 0, -0.1), "distance": 0.35, "yaw": 0, "pitch": 0}  # cuts the scene
    assert framing.overview(swinging(parked), given) == framing.overview(swinging(), given)
    assert framing.overview(swinging(parked), {"yaw": 0, "pitch": 0})["distance"] > 2
    assert framing.overview(swinging(shot), {"yaw": 0, "pitch": 0})["distance"] < 1.5


def test_a_closeup_sees_the_last_contacts(make_world):
    world = make_world(1 / 240, (0, 0, -9.81))
    solid = p.createCollisionShape(p.GEOM_SPHERE, radius=0.02, physicsClientId=world.physicsClientId)
    ball = p.createMultiBody(0, solid, physicsClientId=world.physicsClientId)
    world.add_obstacle(ball)
    tendon = world.add_tendon([(-0.1, 0, 0.03), (0.1, 0, 0.03)], 0.002, ROPE, 31)
    assert framing.closeup(bt.Recorder(world, every=1).recording, {}) is None
    grips = tendon.grip(0), tendon.grip(-1)
    with bt.Recorder(world, every=1) as recorder:
        for _ in range(60):
            for grip in grips:
                grip.target = grip.target - (0, 0, 0.0005)
            world.step()
    camera = framing.closeup(recorder.recording, {"yaw": 0})
    assert len(world.contacts)
    assert np.abs(in_image(world.contacts["position"], camera, framing.ASPECT)).max() < FILLED
    whole = framing.overview(recorder.recording, {"yaw": 0})
    assert camera["distance"] < 0.7 * whole["distance"]


@pytest.mark.parametrize("direction", DIRECTIONS)
def test_an_image_of_its_own_proportions_is_filled_both_ways(direction):
    points = np.random.default_rng(5).uniform(-0.1, 0.1, (200, 3)) * (1.5, 1.5, 1)
    aspect = framing.proportions(points, direction)
    assert 0.5 <= aspect <= 2.5
    seen = in_image(points, framing.fitted(points, direction, aspect), aspect)
    np.testing.assert_allclose(np.ptp(seen, axis=0), 2 * FILLED, rtol=0.05)
    line = [(0.0, 0, 0), (0.0, 0, 0.5)]
    assert framing.proportions(np.array(line), {"yaw": 0, "pitch": 0}) == 0.5
    assert framing.proportions(np.array(line)[:, ::-1], {"yaw": 0, "pitch": 0}) == 2.5
