"""A tendon attached on or in a shape leaves it as if nothing touched it there, however finely it is divided.

Without the smaller contact distance beside the attachment its particles are pushed out by the radius, over a
segment that is shorter than that: 9.8 kN on the surface, 70 kN at a depth of 2 mm, with segments of 0.7 mm.
Inside of triangles, which repel on both sides, they would be pushed to both sides of the surface: 1.4 kN to
8.8 MN.
"""

import numpy as np
import pybullet as p
import pytest
from link_scenes import mesh_obstacle

import bullet_tendon as bt
from bullet_tendon import shapes

RADIUS, LENGTH, HALF = 0.001, 0.1, 0.03
MATERIAL = bt.Material(stiffness=2e4, damping=2.0, friction=0.3)
SHAPES = {
    "box": (p.GEOM_BOX, {"halfExtents": [HALF] * 3}),
    "sphere": (p.GEOM_SPHERE, {"radius": HALF}),
    "cylinder": (p.GEOM_CYLINDER, {"radius": HALF, "height": 2 * HALF}),
    "half space": (p.GEOM_PLANE, {}),
}


@pytest.fixture
def world(make_world):
    return make_world()


def bone(client, kind, mass=0.0):
    geometry, sizes = SHAPES[kind]
    shape = p.createCollisionShape(geometry, physicsClientId=client, **sizes)
    at = (0, 0, HALF if kind == "half space" else 0)
    return p.createMultiBody(mass, shape, -1, at, physicsClientId=client)


def attached(world, body, depth, tilt, particles):
    """A straight tendon from a depth [m] under the top of a shape, at an angle to the normal [rad]."""
    start = np.array([0, 0, HALF - depth])
    way = LENGTH * np.array([np.sin(tilt), 0, np.cos(tilt)])
    t = world.add_tendon([start, start + way], RADIUS, MATERIAL, particles)
    t.attach(0, body)
    return t


@pytest.mark.parametrize("particles", [10, 150, 300])
@pytest.mark.parametrize("tilt", [0.0, 0.8, 1.3])
@pytest.mark.parametrize("depth", [0.0, 0.0005, 0.002])
@pytest.mark.parametrize("kind", SHAPES)
def test_no_tension_arises(world, client, kind, depth, tilt, particles):
    body = bone(client, kind)
    world.add_obstacle(body)
    t = attached(world, body, depth, tilt, particles)
    for _ in range(20):
        world.step()
        assert world.report.converged
    assert np.abs(t.tension).max() < 1e-3 * MATERIAL.stiffness * 1e-3


def test_the_finger_of_the_package_is_not_pulled(make_world, client):
    """Its tendons end in the box of its last link, which is an obstacle unless the user says otherwise.

    With the whole radius as contact distance 26 kN pull at it in the third step, which takes seconds.
    """
    world = make_world()
    flags = p.URDF_USE_INERTIA_FROM_FILE
    robot = world.load_urdf(bt.data_path("tendon_finger.urdf"), useFixedBase=True, flags=flags)
    for joint in range(p.getNumJoints(robot, client)):
        p.setJointMotorControl2(robot, joint, p.VELOCITY_CONTROL, force=0, physicsClientId=client)
    world.step(10)
    assert max(np.abs(t.tension).max() for t in world.tendons) < 1
    assert max(abs(p.getJointState(robot, j, client)[0]) for j in range(3)) < 1e-4


@pytest.mark.parametrize("depth", [0.0, 0.001])
def test_away_from_the_attachment_it_lies_on_the_surface(make_world, client, depth):
    """Pressed down along a plate: nearer than the radius over ten times the depth and the radius alone."""
    world = make_world(gravity=(0, 0, -9.81))
    body = bone(client, "half space")
    world.add_obstacle(body)
    t = attached(world, body, depth, np.pi / 2 - 0.15, 101)
    world.step(480)
    heights = t.positions[:, 2] - HALF
    arc = np.linspace(0, LENGTH, 101)
    np.testing.assert_array_less(np.minimum(RADIUS, 0.1 * arc - depth) - 0.01 * RADIUS, heights)
    np.testing.assert_allclose(heights[arc > 10 * (depth + RADIUS) + 0.01], RADIUS, atol=0.01 * RADIUS)


def test_at_the_radius_nothing_changes(make_world, client):
    """Attached to a plate at its height on it, a tendon that is pressed down lies on it from the start."""
    world = make_world(gravity=(0, 0, -9.81))
    body = bone(client, "half space")
    world.add_obstacle(body)
    t = attached(world, body, -RADIUS, np.pi / 2, 101)
    world.step(240)
    np.testing.assert_allclose(t.positions[:, 2] - HALF, RADIUS, atol=0.001 * RADIUS)


def test_what_is_attached_elsewhere_is_kept_out(make_world, client):
    """The attachment to one bone leaves the distance from another one as it is."""
    world = make_world(gravity=(0, 0, -9.81))
    plate, other = bone(client, "half space"), bone(client, "sphere")
    p.resetBasePositionAndOrientation(other, (0, 0, 0), (0, 0, 0, 1), physicsClientId=client)
    world.add_obstacle(plate)
    t = attached(world, other, -RADIUS, np.pi / 2, 101)
    world.step(240)
    np.testing.assert_allclose(t.positions[:, 2] - HALF, RADIUS, atol=0.001 * RADIUS)


# Distance of the surface from the middle, in the direction of unit vectors (k, 3) [HALF].
MESHES = {
    "ball": lambda d: np.ones(len(d)),
    "box": lambda d: 1 / np.abs(d).max(1),
    "bone": lambda d: 1 + 0.25 * np.sin(5 * d[:, 0] + 1) * np.sin(4 * d[:, 1]) + 0.2 * d[:, 2] ** 2,
}


def mesh_of(kind, rows):
    """Vertices [m] and triangles of a closed mesh with `rows` rows of faces between its poles."""
    round_, down = np.arange(2 * rows), np.arange(rows - 2)[:, None]
    turn, tilt = np.pi / rows * round_, np.pi / rows * np.arange(1, rows)[:, None]
    ring = np.stack([np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt) + 0 * turn], -1)
    way = np.vstack([ring.reshape(-1, 3), [[0, 0, 1], [0, 0, -1]]])
    at = lambda row, k: (2 * rows * row + k % (2 * rows)).ravel()  # noqa: E731
    top, bottom = len(way) - 2 + 0 * round_, len(way) - 1 + 0 * round_
    faces = [
        (at(down, round_), at(down + 1, round_), at(down + 1, round_ + 1)),
        (at(down, round_), at(down + 1, round_ + 1), at(down, round_ + 1)),
        (top, at(0, round_), at(0, round_ + 1)),
        (bottom, at(rows - 2, round_ + 1), at(rows - 2, round_)),
    ]
    return HALF * MESHES[kind](way)[:, None] * way, np.concatenate([np.stack(f, -1) for f in faces])


class Insertion:
    """A tendon attached in a mesh under the middle of some face; the seed chooses face and sizes."""

    def __init__(self, world, kind, seed, depth=None):
        rng = np.random.default_rng(seed)
        vertices, faces = mesh_of(kind, int(rng.integers(6, 40)))
        faces = faces[:, :: rng.choice([-1, 1])]  # wound either way
        face = rng.integers(len(faces))
        corners = vertices[faces[face]]
        normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        normal *= np.sign(normal @ corners[0]) / np.linalg.norm(normal)
        side = np.cross(normal, rng.normal(size=3))
        self.side = side / np.linalg.norm(side)
        tilt = rng.uniform(0, 1.2)
        self.way = np.cos(tilt) * normal + np.sin(tilt) * self.side
        self.depth = rng.uniform(0.5e-3, 8e-3) if depth is None else depth
        radius, segment = np.exp(rng.uniform(np.log([3e-4, 3e-4]), np.log([2e-3, 1e-2])))
        start = corners.mean(0) - self.depth * normal
        self.vertices, self.faces = vertices, faces
        self.body = mesh_obstacle(world, world.physicsClientId, vertices, faces)
        material = bt.Material(stiffness=2e4, damping=20.0)
        particles = int(0.08 / segment) + 2
        self.tendon = world.add_tendon([start, start + 0.08 * self.way], radius, material, particles)
        self.hold = self.tendon.attach(0, self.body)


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("kind", MESHES)
def test_no_tension_arises_in_a_mesh(world, kind, seed):
    insertion = Insertion(world, kind, seed)
    for _ in range(20):
        world.step()
        assert world.report.converged
    assert np.abs(insertion.tendon.tension).max() < 0.02


@pytest.mark.parametrize("aside", [0.0, 1.0])
@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("kind", MESHES)
def test_from_a_mesh_the_whole_pull_arrives(world, kind, seed, aside):
    """Without friction, pulled along itself or to the side: the tension of one end is that of the other."""
    insertion, pull = Insertion(world, kind, seed), 50.0
    way = insertion.way + aside * insertion.side
    insertion.tendon.set_force(-1, pull * way / np.linalg.norm(way))
    world.step(480)
    assert np.linalg.norm(insertion.hold.force) == pytest.approx(pull, rel=0.02)
    assert insertion.tendon.tension[[0, -1]] == pytest.approx(pull, rel=0.02)


@pytest.mark.parametrize("kind", MESHES)
def test_an_insertion_in_a_mesh_is_restored(world, kind):
    """What is known of sides is no state: the steps after a restored snapshot have the same bits."""
    insertion = Insertion(world, kind, 3)
    insertion.tendon.set_force(-1, 20 * insertion.side)
    world.step(10)
    state, found = world.snapshot(), []
    for _ in range(2):
        world.load_snapshot(state)
        world.step(30)
        found.append(insertion.tendon.positions.tobytes())
    assert found[0] == found[1]


@pytest.mark.parametrize("kind", MESHES)
def test_the_rest_of_the_tendon_stays_out_of_the_mesh(world, kind):
    """Pulled round the mesh, it is kept out from ten times the depth of its attachment and its radius on."""
    insertion = Insertion(world, kind, 11, depth=1e-3)
    insertion.tendon.set_force(-1, 5 * insertion.side - 3 * insertion.way)
    world.step(480)
    surface = shapes.mesh(insertion.vertices, insertion.faces)
    x = insertion.tendon.positions
    arc = np.linspace(0, 0.08, len(x))
    beyond = x[arc > 10 * (insertion.depth + insertion.tendon.radius)]
    assert len(beyond) > 2
    assert not surface.contains(beyond).any()
    assert surface.measure(beyond, beyond)[0].min() > 0.95 * insertion.tendon.radius


def test_an_open_mesh_encloses_nothing():
    vertices, faces = mesh_of("ball", 12)
    assert shapes.mesh(vertices, faces).solid is not None
    assert shapes.mesh(vertices, faces[vertices[faces].mean(1)[:, 2] < 0]).solid is None


@pytest.mark.parametrize("turn", [0.4, 0.6, 0.8])
def test_a_tendon_departs_from_a_wheel_alike_at_every_height(make_world, client, turn):
    """It runs around the side of a long cylinder, across its axis, from a point of its surface."""
    angle = np.linspace(0, turn, 8)
    off = HALF + np.where(angle > 0, RADIUS, 0)
    arc = np.stack([off * np.cos(angle), off * np.sin(angle), 0 * angle], 1)
    along = np.array([-np.sin(turn), np.cos(turn), 0])
    shape = p.createCollisionShape(p.GEOM_CYLINDER, radius=HALF, height=0.2, physicsClientId=client)
    found = []
    for height in (0, 0.05):
        world = make_world()
        body = p.createMultiBody(0, shape, -1, (0, 0, -height), physicsClientId=client)
        world.add_obstacle(body, friction=0.0)
        t = world.add_tendon([*arc, arc[-1] + 0.03 * along], RADIUS, MATERIAL)
        t.attach(0, body)
        t.grip(-1, target=t.positions[-1] + 3e-4 * along)
        world.step(120)
        assert (world.contacts["normal_force"] > 0).sum() >= 3
        found.append(t.positions)
    np.testing.assert_allclose(*found, atol=1e-10)
