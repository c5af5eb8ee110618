"""Camera: tendons and bodies are seen, told apart and measured where they are, and nothing is disturbed."""

import gc
from pathlib import Path

import numpy as np
import pybullet as p
import pytest
from pybullet_utils.bullet_client import BulletClient

import bullet_tendon as bt
from bullet_tendon import errors, view

FACING = {"target": (0.0, 0.0, 0.0), "distance": 0.4, "yaw": 0.0, "pitch": 0.0}  # looks along +y
ROPE = bt.Material(stiffness=1e4, damping=1.0)


def box(client, half, position):
    shape = p.createVisualShape(p.GEOM_BOX, halfExtents=half, physicsClientId=client)
    solid = p.createCollisionShape(p.GEOM_BOX, halfExtents=half, physicsClientId=client)
    return p.createMultiBody(1.0, solid, shape, position, physicsClientId=client)


def rod(world, y=0.0, z=0.0, **arguments):
    return world.add_tendon([(-0.06, y, z), (0.06, y, z)], 0.005, ROPE, particles=13, **arguments)


def resident() -> int:
    """Memory of this process [kB]."""
    return 4 * int(Path("/proc/self/statm").read_text().split()[1])


def pixel(camera, point) -> tuple[int, int]:
    """Row and column at which a point is seen by a camera that looks along +y at 40 degrees."""
    x, y, z = point
    scale = camera._lens.height / (2 * np.tan(np.radians(20)) * (0.4 + y))
    return round(camera._lens.height / 2 - scale * z - 0.5), round(camera._lens.width / 2 + scale * x - 0.5)


def test_tendons_and_bodies_are_told_apart_where_they_are(make_world):
    world = make_world()
    body = box(world.physicsClientId, [0.02, 0.02, 0.02], (0.04, 0.0, 0.06))
    low, high = rod(world, z=-0.05), rod(world, z=0.0)
    with view.Camera(world, 160, 120, **FACING) as camera:
        seen = camera.segmentation()
        assert seen.shape == (120, 160) and seen.dtype == np.int32
        assert set(np.unique(seen)) == {-1, body, camera.label(low), camera.label(high)}
        assert (camera.label(low), camera.label(high)) == (-2, -3)
        for tendon in (low, high):
            for point in tendon.positions[1:-1]:
                assert seen[pixel(camera, point)] == camera.label(tendon)
            assert seen[pixel(camera, tendon.positions[-1] + (0.008, 0, 0))] == -1
        assert seen[pixel(camera, (0.04, 0.0, 0.06))] == body


def test_links_are_told_on_request(make_world):
    world = make_world()
    finger = p.loadURDF(
        bt.data_path("tendon_finger.urdf"), useFixedBase=True, physicsClientId=world.physicsClientId
    )
    with view.Camera(
        world, 96, 96, target=(0.03, 0, -0.02), distance=0.24, yaw=20, pitch=-35, up="y"
    ) as camera:
        assert set(np.unique(camera.segmentation())) == {-1, finger}
        numbers = set(np.unique(camera.segmentation(links=True))) - {-1}
    assert {number & ((1 << 24) - 1) for number in numbers} == {finger}
    assert {(number >> 24) - 1 for number in numbers} == {-1, 0, 1, 2}


def test_depth_is_the_distance_from_the_cameras_plane(make_world):
    world = make_world()
    box(world.physicsClientId, [0.02, 0.02, 0.02], (0.0, 0.1, 0.05))
    tendon = rod(world, y=0.03)
    with view.Camera(world, 161, 121, **FACING) as camera:
        depth = camera.depth()
        assert depth.dtype == np.float32 and np.isfinite(depth).all()
        assert depth[pixel(camera, (0.0, 0.08, 0.05))] == pytest.approx(0.4 + 0.08, abs=1e-4)
        nearest, quarter_pixel = 0.4 + 0.03 - tendon.radius, 0.25 * 2 * np.tan(np.radians(20)) * 0.43 / 121
        assert depth[pixel(camera, (0.0, 0.03, 0.0))] == pytest.approx(nearest, abs=quarter_pixel)
        assert depth[0, 0] == pytest.approx(20 * 0.4, rel=1e-3)


def test_what_is_in_front_hides_what_is_behind(make_world):
    world = make_world()
    body = box(world.physicsClientId, [0.02, 0.02, 0.02], (0.0, 0.0, 0.0))
    front, back = rod(world, y=-0.04), rod(world, y=0.04)
    with view.Camera(world, 160, 120, **FACING) as camera:
        seen = camera.segmentation()
        assert seen[60, 80] == camera.label(front)
        assert seen[54, 80] == body
        assert not (seen[40:80, 70:90] == camera.label(back)).any()
        p.resetBasePositionAndOrientation(body, (0, -0.07, 0), (0, 0, 0, 1), world.physicsClientId)
        assert camera.segmentation()[60, 80] == body


def test_the_mask_of_a_tendon_is_its_silhouette(make_world):
    """Its area is that of a stadium, to half a pixel along its rim."""
    world = make_world()
    tendon = rod(world)
    with view.Camera(world, 320, 240, **FACING) as camera:
        area = np.count_nonzero(camera.segmentation() == camera.label(tendon))
        scale = 240 / (2 * np.tan(np.radians(20)) * 0.4)
    radius, length = tendon.radius * scale, tendon.length * scale
    rim = 2 * length + 2 * np.pi * radius
    assert area == pytest.approx(2 * radius * length + np.pi * radius**2, abs=0.5 * rim)


def test_the_three_parts_are_of_one_moment(make_world):
    world = make_world()
    rod(world)
    with view.Camera(world, 64, 48, **FACING) as camera:
        rendering = camera.render()
        np.testing.assert_array_equal(rendering.rgb, camera.image())
        np.testing.assert_array_equal(rendering.depth, camera.depth())
        np.testing.assert_array_equal(rendering.segmentation, camera.segmentation())
        assert rendering.rgb.shape == (48, 64, 3) and rendering.rgb.dtype == np.uint8
        assert ((rendering.rgb < 255).any(axis=2) == (rendering.segmentation != -1)).all()


def test_it_follows_what_moves_stretches_comes_and_goes(make_world):
    world = make_world()
    tendon = rod(world)
    with view.Camera(world, 160, 120, **FACING) as camera:
        camera.image()
        longer = tendon.positions * (1.6, 1, 1) + (0, 0, 0.03)
        tendon.set_positions(longer)
        seen = camera.segmentation() == camera.label(tendon)
        for a, b in zip(longer[:-1], longer[1:], strict=True):
            for share in (0.0, 0.25, 0.5, 0.75, 1.0):
                assert seen[pixel(camera, (1 - share) * a + share * b)]
        other = rod(world, z=-0.03)
        assert camera.label(other) in camera.segmentation()
        world.remove_tendon(tendon)
        assert set(np.unique(camera.segmentation())) == {-1, -2}
        assert camera.label(other) == -2
        with pytest.raises(errors.UnknownId, match="tendon"):
            camera.label(tendon)


def test_looking_elsewhere(make_world):
    world = make_world()
    rod(world)
    with view.Camera(world, 64, 64, **FACING) as camera:
        assert (camera.segmentation() == -2).any()
        camera.look((0, 0, 0.5), 0.4, 0, 0)
        assert not (camera.segmentation() == -2).any()
        with pytest.raises(errors.InvalidValue, match="distance"):
            camera.look((0, 0, 0), 0.0, 0, 0)
        assert not (camera.segmentation() == -2).any()


def test_tension_colours_a_tendon(make_world):
    world = make_world()
    tendon = rod(world)
    with view.Camera(world, 160, 120, full_tension=100.0, **FACING) as camera:
        slack = camera.image()[60, 80].astype(float)
        tendon.grip(0), tendon.grip(-1, target=(0.06 * 1.05, 0, 0))
        world.step(50)
        assert tendon.tension.min() > 100
        taut = camera.image()[60, 80].astype(float)
    assert slack[1] / slack[0] == pytest.approx(0.75 / 0.86, abs=0.03)
    assert taut[1] / taut[0] < 0.2


def drawn_over_a_body(cameras, client):
    """States and ids of a run in which a tendon falls onto a body, while so many cameras look."""
    p.setGravity(0, 0, -9.81, physicsClientId=client)
    world = bt.TendonWorld(client)
    body = box(client, [0.01, 0.01, 0.01], (0.0, 0.0, -0.02))
    world.add_obstacle(body)
    tendon = rod(world, z=0.005)
    tendon.grip(0)
    states = []
    looking = [view.Camera(world, 32, 32, **FACING) for _ in range(cameras)]
    for k in range(60):
        if k == 30:
            saved = world.save_state(), p.saveState(physicsClientId=client)
        if k % 10 == 0:
            for camera in looking:
                camera.render(links=True)
        world.step()
        states.append((world.state_hash(), p.getBasePositionAndOrientation(body, client)))
    ids = [p.getBodyUniqueId(i, client) for i in range(p.getNumBodies(client))]
    shape = p.createVisualShape(p.GEOM_SPHERE, radius=0.01, physicsClientId=client)
    ids.append(p.createMultiBody(0, -1, shape, physicsClientId=client))
    p.removeBody(ids[-1], client)
    world.restore_state(saved[0])
    p.restoreState(saved[1], physicsClientId=client)
    for camera in looking:
        camera.render()
    states.append((world.state_hash(), p.getBasePositionAndOrientation(body, client)))
    for camera in looking:
        camera.close()
    return states, ids, p.getVisualShapeData(body, physicsClientId=client)


def test_cameras_leave_states_and_ids_as_they_are_without():
    found = []
    for cameras in (0, 2):
        client = p.connect(p.DIRECT)
        found.append(drawn_over_a_body(cameras, client))
        p.disconnect(client)
    assert found[0] == found[1]


def test_memory_is_constant_while_a_tendon_moves_and_stretches(make_world):
    world = make_world()
    tendon = rod(world)
    start, random = tendon.positions, np.random.default_rng(1)
    with view.Camera(world, 16, 16, full_tension=10.0, **FACING) as camera:
        for frame in range(1500):
            tendon.set_positions(start * (random.uniform(0.7, 1.4), 1, 1) + random.normal(0, 1e-3, (13, 3)))
            camera.render()
            if frame == 500:
                before = resident()
    assert resident() - before < 1000  # a mesh for each frame took 77 kB: 77,000 in all


def ball(client, radius, position, color=(0.3, 0.4, 0.5, 1.0)):
    shape = p.createVisualShape(p.GEOM_SPHERE, radius=radius, rgbaColor=color, physicsClientId=client)
    return p.createMultiBody(1.0, -1, shape, position, physicsClientId=client)


def test_round_bodies_are_seen_as_what_they_are_and_followed(client):
    """The mask and the depth of a sphere, against those of a sphere."""
    body, other = ball(client, 0.04, (0, 0, 0)), ball(client, 0.02, (0.06, 0.1, 0.05))
    before = [p.getVisualShapeData(k, physicsClientId=client) for k in (body, other)]
    with view.Camera(client, 401, 401, **FACING) as camera:
        for at in ((0.0, 0.0, 0.0), (-0.03, 0.02, 0.01)):
            p.resetBasePositionAndOrientation(body, at, (0, 0, 0, 1), client)
            rendering = camera.render()
            half = np.tan(np.radians(20)) * (2 * (np.arange(401) + 0.5) / 401 - 1)
            ray = np.stack([*np.meshgrid(half, -half), np.ones((401, 401))], axis=-1)  # x, z and y
            middle = np.array([at[0], at[2], 0.4 + at[1]])
            square = (ray**2).sum(-1)
            nearest = ray @ middle / square
            inside = 0.04**2 - (middle @ middle - nearest**2 * square)
            mask = rendering.segmentation == body
            rim = 2 * np.sqrt(np.pi * (inside > 0).sum())
            assert mask.sum() == pytest.approx((inside > 0).sum(), abs=0.5 * rim)
            clear = mask & (inside > 0.5 * 0.04**2)  # where it slopes by at most 1
            exact = nearest - np.sqrt(np.maximum(inside, 0) / square)
            # A pixel is 0.7 mm: half of one along both sides, and twice a quarter, by the mesh.
            np.testing.assert_allclose(rendering.depth[clear], exact[clear], atol=9e-4)
            assert other in rendering.segmentation
            assert set(np.unique(camera.segmentation(links=True))) == {-1, body, other}
        p.changeVisualShape(body, -1, rgbaColor=(1, 0, 0, 1), physicsClientId=client)
        red = camera.image()[mask].astype(int)
        assert (red[:, 0] > 2 * red[:, 1]).all()
        p.changeVisualShape(body, -1, rgbaColor=before[0][0][7], physicsClientId=client)
        p.removeBody(other, client)
        assert set(np.unique(camera.segmentation())) == {-1, body}
        assert [p.getVisualShapeData(body, physicsClientId=client)] == before[:1]


def test_a_link_that_is_not_only_round_is_drawn_as_pybullet_draws_it(client):
    shapes = p.createVisualShapeArray(
        shapeTypes=[p.GEOM_SPHERE, p.GEOM_BOX],
        radii=[0.03, 0],
        halfExtents=[[0, 0, 0], [0.02, 0.02, 0.02]],
        visualFramePositions=[[-0.05, 0, 0], [0.05, 0, 0]],
        physicsClientId=client,
    )
    body = p.createMultiBody(1.0, -1, shapes, physicsClientId=client)
    with view.Camera(client, 64, 64, **FACING) as camera:
        rendering = camera.render()
        assert np.array_equal(rendering.rgb, camera._lens.take(client).rgb)
        assert set(np.unique(rendering.segmentation)) == {-1, body}


def test_memory_is_constant_while_round_bodies_move_come_and_go(client):
    random = np.random.default_rng(1)
    with view.Camera(client, 16, 16, **FACING) as camera:
        balls = [ball(client, 0.01, random.normal(0, 0.03, 3)) for _ in range(4)]
        for frame in range(1500):
            for one in balls:
                place = random.normal(0, 0.03, 3).tolist()
                p.resetBasePositionAndOrientation(one, place, (0, 0, 0, 1), client)
            shown = (0.3, 0.4, 0.5, float(frame % 3 > 0))
            p.changeVisualShape(balls[0], -1, rgbaColor=shown, physicsClientId=client)
            camera.render()
            if frame == 500:
                before = resident()
    assert resident() - before < 1000


def test_a_camera_that_is_no_longer_used_gives_its_client_back(client):
    camera = view.Camera(client, 8, 8)
    own = camera._layer._client
    assert p.isConnected(own)
    del camera
    gc.collect()
    assert not p.isConnected(own)


def test_one_picture_of_a_world_shows_its_tendons(make_world):
    world = make_world()
    rod(world)
    bare = view.camera_image(world.physicsClientId, width=64, height=48, **FACING)
    seen = view.camera_image(world, width=64, height=48, **FACING)
    assert (bare == 255).all()
    assert (seen[24, 23:42] < 255).any(axis=1).all()
    assert p.getNumBodies(world.physicsClientId) == 0


def test_ligaments_are_seen_along_their_paths_and_follow_their_bodies(make_world):
    world = make_world()
    client = world.physicsClientId
    left, right = (
        p.createMultiBody(1.0, basePosition=(x, 0, 0), physicsClientId=client) for x in (-0.1, 0.1)
    )
    tendon = rod(world, z=0.06)
    path = [(left, -1, (0, 0, 0)), (left, -1, (0.1, 0, 0.04)), (right, -1, (0, 0, 0))]
    ligament = world.add_ligament(path, ROPE)
    with view.Camera(world, 320, 240, **FACING) as camera:
        for shift in (0.0, -0.04):
            for body, x in ((left, -0.1), (right, 0.1)):
                p.resetBasePositionAndOrientation(body, (x, 0, shift), (0, 0, 0, 1), client)
            seen = camera.segmentation()
            assert (camera.label(tendon), camera.label(ligament)) == (-2, -3)
            for a, b in zip(ligament.points[:-1], ligament.points[1:], strict=True):
                row, column = pixel(camera, 0.6 * a + 0.4 * b)  # which a line of 1.6 pixels may miss
                assert (seen[row - 1 : row + 2, column - 1 : column + 2] == -3).any()
        world.remove_ligament(ligament)
        assert -3 not in camera.segmentation()


def test_ligaments_are_seen_along_their_wraps(make_world):
    world = make_world()
    client = world.physicsClientId
    stand = p.createMultiBody(0, physicsClientId=client)
    ball = p.createMultiBody(1.0, basePosition=(0.06, 0, -0.015), physicsClientId=client)
    wrap = world.add_wrap(stand, -1, ("ellipsoid", (0.04, 0.08, 0.03)), (0, 0, 0))
    path = [(stand, -1, (-0.06, 0, -0.015)), (ball, -1, (0, 0, 0))]
    ligament = world.add_ligament(path, ROPE, wraps=[wrap])
    with view.Camera(world, 320, 240, **FACING) as camera:
        seen = camera.segmentation()
        top = ligament.line[np.abs(ligament.line[:, 2]).argmax()]
        assert abs(top[2]) > 0.028
        row, column = pixel(camera, top)
        assert (seen[row - 1 : row + 2, column - 1 : column + 2] == -2).any()
        row, column = pixel(camera, np.array((0, 0, -0.015)))
        assert not (seen[row - 1 : row + 2, column - 1 : column + 2] == -2).any()


def test_a_client_without_tendons():
    client = BulletClient(p.DIRECT)
    body = box(client._client, [0.02, 0.02, 0.02], (0, 0, 0))
    with view.Camera(client, 32, 32, **FACING) as camera:
        assert set(np.unique(camera.segmentation())) == {-1, body}
        client.disconnect()
        with pytest.raises(errors.UnknownId, match="physicsClientId"):
            camera.image()


@pytest.mark.parametrize(
    ("argument", "value"),
    [("width", 0), ("samples", 0), ("distance", -1.0), ("up", "x"), ("colors", []), ("full_tension", 0.0)],
)
def test_refusals(make_world, argument, value):
    with pytest.raises(errors.InvalidValue, match=argument):
        view.Camera(make_world(), **{argument: value})


def test_a_closed_camera_refuses(make_world):
    camera = view.Camera(make_world(), 8, 8)
    camera.close()
    camera.close()
    with pytest.raises(errors.UnknownId, match="camera"):
        camera.image()
    with pytest.raises(errors.UnknownId, match="physicsClientId"):
        view.Camera(9999)
