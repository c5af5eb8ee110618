"""Bodies with collision shapes in awkward frames, and pybullet's own distances to check mirrors by."""

import numpy as np
import pybullet as p
import pytest

UNDAMPED = {"linearDamping": 0, "angularDamping": 0}
PROBE = 1e-4  # radius of the sphere that asks pybullet [m]
HULL_MARGIN = 1e-3  # what pybullet adds around a convex hull [m]
TETRA = np.array([[0.0, 0, 0], [0.3, 0, 0], [0, 0.4, 0], [0, 0, 0.5]])
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])


def cube(half, at=(0, 0, 0)):
    """Vertices (8, 3) [m] and triangles (12, 3) of a cube with edges of 2 half around `at`."""
    corners = half * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    quads = np.array([(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)])
    return corners + at, np.vstack([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])


def prism_mesh(radius, half, sides):
    """Vertices (2 sides, 3) [m] and triangles of the sides of a prism along y, with a flat top; open ends."""
    angles = np.pi / 2 + (np.arange(sides) + 0.5) * 2 * np.pi / sides
    x, z = radius * np.cos(angles), radius * np.sin(angles)
    vertices = np.concatenate([np.c_[x, np.full(sides, y), z] for y in (-half, half)])
    k, after = np.arange(sides), (np.arange(sides) + 1) % sides
    return vertices, np.concatenate([np.c_[k, after, k + sides], np.c_[after, after + sides, k + sides]])


def triangles_shape(client, vertices, faces):
    """A concave collision shape of the triangles as they are."""
    return p.createCollisionShape(
        p.GEOM_MESH,
        vertices=np.asarray(vertices).tolist(),
        indices=np.ravel(faces).tolist(),
        flags=p.GEOM_FORCE_CONCAVE_TRIMESH,
        physicsClientId=client,
    )


def mesh_obstacle(world, client, vertices, faces, friction=0.0):
    """The body of a static obstacle of the triangles as they are."""
    vertices, faces = np.asarray(vertices, float), np.asarray(faces)
    body = p.createMultiBody(0, triangles_shape(client, vertices, faces), physicsClientId=client)
    world.add_obstacle(body, friction=friction, convex=False, meshes=[(vertices, faces)])
    return body


def add_mesh(world, client, vertices, faces, friction=0.0):
    """The same; corners (k, 3, 3) of its triangles [m]."""
    mesh_obstacle(world, client, vertices, faces, friction)
    return np.asarray(vertices, float)[np.asarray(faces)]


def probe_of(client):
    """A function that asks pybullet for the distance from a world point to a link."""
    shape = p.createCollisionShape(p.GEOM_SPHERE, radius=PROBE, physicsClientId=client)
    body = p.createMultiBody(0, shape, physicsClientId=client)

    def closest(other, link, x):
        p.resetBasePositionAndOrientation(body, x, [0, 0, 0, 1], physicsClientId=client)
        found = p.getClosestPoints(body, other, 50.0, -1, link, physicsClientId=client)
        return min(row[8] for row in found) + PROBE

    return closest


def turn(rng):
    q = rng.normal(size=4)
    return (q / np.linalg.norm(q)).tolist()


def matrix(quaternion):
    return np.array(p.getMatrixFromQuaternion(quaternion)).reshape(3, 3)


def body_energy(client, bodies, gravity):
    """Kinetic, and of gravity [J], of rigid bodies; gravity: down [m/s^2]."""
    total = 0.0
    for body in bodies:
        velocity, spin = map(np.array, p.getBaseVelocity(body, client))
        centre, axes = p.getBasePositionAndOrientation(body, client)
        mass, _, moments = p.getDynamicsInfo(body, -1, client)[:3]
        turning = matrix(axes).T @ spin
        total += 0.5 * (mass * velocity @ velocity + turning @ (moments * turning))
        total += mass * gravity * centre[2]
    return total


def link_frame(client, body, link):
    """Position and rotation of a link's URDF frame in the world."""
    if link >= 0:
        position, orientation = p.getLinkState(
            body, link, computeForwardKinematics=True, physicsClientId=client
        )[:2]
    else:
        position, orientation = p.getBasePositionAndOrientation(body, physicsClientId=client)
    # getLinkState's own link frame is computed in single precision, 5e-7 m off; the centre of mass is not.
    local = p.getDynamicsInfo(body, link, physicsClientId=client)
    rotation = matrix(orientation) @ matrix(local[4]).T
    return np.array(position) - rotation @ local[3], rotation


def check_link(client, probe, body, link, shapes):
    """Ask from beside each shape's faces, where Bullet's rounding of edges and corners plays no part."""
    # Bullet's distance to a cylinder's mantle is only this exact itself.
    tolerance = 1e-5 if any(shape.kind == "cylinder" for shape in shapes) else 1e-9
    origin, axes = link_frame(client, body, link)
    for shape in shapes:
        middle, half = shape.bounds.mean(0), np.ptp(shape.bounds, axis=0) / 2
        for direction in np.vstack([np.eye(3), -np.eye(3)]):
            local = middle + direction * (half + 0.05)
            world = origin + axes @ (shape.position + shape.rotation @ local)
            others = []
            for other in shapes:
                x = other.rotation.T @ (axes.T @ (world - origin) - other.position)
                others.append(other.measure(x[None], x[None])[0][0])
            assert probe(body, link, world) == pytest.approx(min(others), abs=tolerance)


def check_hull_faces(client, probe, body, link, shape):
    """From above the middle of each face, where Bullet's margin just lifts the plane."""
    origin, axes = link_frame(client, body, link)
    for face, normal in zip(shape.query.hull.simplices, shape.query.hull.equations[:, :3], strict=True):
        local = shape.query.hull.points[face].mean(0) + 0.02 * normal
        world = origin + axes @ (shape.position + shape.rotation @ local)
        assert shape.measure(local[None], local[None])[0][0] == pytest.approx(0.02, abs=1e-12)
        assert probe(body, link, world) == pytest.approx(0.02 - HULL_MARGIN, abs=2e-6)


def tetra_obj(path, groups=1):
    """An OBJ file of tetrahedra 1 m apart along x, each an object of its own."""
    lines = []
    for g in range(groups):
        lines.append(f"o part{g}")
        lines += ["v {} {} {}".format(*v) for v in TETRA + (g, 0, 0)]
        lines += ["f {} {} {}".format(*(f + 1 + 4 * g)) for f in FACES]
    path.write_text("\n".join(lines) + "\n")
    return path


def urdf_body(client, tmp_path, *collisions, **flags):
    """A base with the collisions given, and a child link with the same, both with inertial offsets."""
    link = (
        '<link name="{}"><inertial><origin xyz=".1 .2 .3" rpy=".3 .2 .1"/><mass value="1"/>'
        '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>{}</link>'
    )
    parts = "".join(
        f'<collision {attribute}><origin xyz=".5 -.4 .2" rpy="1 .5 .2"/>'
        f"<geometry>{geometry}</geometry></collision>"
        for geometry, attribute in collisions
    )
    joint = (
        '<joint name="j" type="continuous"><parent link="a"/><child link="b"/><axis xyz="0 1 0"/>'
        '<origin xyz="1 1 1" rpy=".1 .2 .3"/></joint>'
    )
    number = len(list(tmp_path.glob("*.urdf")))  # pybullet keeps files it has read: each needs its own name
    path = tmp_path / f"body{number}.urdf"
    path.write_text(f'<robot name="r">{link.format("a", parts)}{link.format("b", parts)}{joint}</robot>')
    body = p.loadURDF(str(path), [3, 2, 1], [0.5, 0.5, 0.5, 0.5], physicsClientId=client, **flags)
    p.resetJointState(body, 0, 0.7, physicsClientId=client)
    return body


HINGED = """<robot name="hinged"><link name="base"/><link name="arm">
<inertial><origin xyz="0.05 0 0"/><mass value="0.05"/><inertia ixx="1e-5" iyy="5e-5" izz="5e-5"/></inertial>
</link>
<joint name="hinge" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="0.3" effort="10" velocity="100"/></joint></robot>"""


def misfit(tendon, attachment, client):
    """How far an attached particle is from its place on the body [m]."""
    return away(tendon, attachment, *link_frame(client, attachment.bodyUniqueId, attachment.linkIndex))


def away(tendon, attachment, origin, axes):
    return np.linalg.norm(tendon.positions[attachment.particle] - origin - axes @ attachment.position)


def hinged(client, tmp_path):
    """A link on a hinge with a limit, in swing."""
    path = tmp_path / "hinged.urdf"
    path.write_text(HINGED)
    arm = p.loadURDF(str(path), useFixedBase=True, flags=p.URDF_USE_INERTIA_FROM_FILE, physicsClientId=client)
    p.changeDynamics(arm, 0, **UNDAMPED, jointDamping=0, physicsClientId=client)
    p.setJointMotorControl2(arm, 0, p.VELOCITY_CONTROL, force=0, physicsClientId=client)
    p.resetJointState(arm, 0, 0.0, 8.0, physicsClientId=client)
    return arm


def free_ball(client, mass, at=(0, 0, 0), radius=0.01):
    """A ball without damping."""
    ball = p.createCollisionShape(p.GEOM_SPHERE, radius=radius, physicsClientId=client)
    body = p.createMultiBody(mass, ball, -1, list(at), physicsClientId=client)
    p.changeDynamics(body, -1, **UNDAMPED, physicsClientId=client)
    return body


def block(client, mass, at=(0, 0, 0), half=(0.02, 0.03, 0.05), **dynamics):
    """A box that pybullet neither damps nor lets collide. dynamics: of p.changeDynamics."""
    shape = p.createCollisionShape(p.GEOM_BOX, halfExtents=half, physicsClientId=client)
    body = p.createMultiBody(mass, shape, -1, at, physicsClientId=client)
    p.changeDynamics(body, -1, **UNDAMPED, **dynamics, physicsClientId=client)
    p.setCollisionFilterGroupMask(body, -1, 0, 0, client)
    return body


def links_on_joints(
    client, kind, masses, axes, shape=-1, places=((0, 0, 0),), centre=(0, 0, 0), turned=(0, 0, 0, 1)
):
    """A fixed base with a link of each mass [kg] on a joint of this kind, without damping.

    places, axes: of the joints, one of each link. centre: of the links' masses, from their joints. turned: of
    each link in the last one's frame.
    """
    count = len(masses)
    body = p.createMultiBody(
        linkMasses=masses,
        linkCollisionShapeIndices=[shape] * count,
        linkVisualShapeIndices=[-1] * count,
        linkPositions=places,
        linkOrientations=[turned] * count,
        linkInertialFramePositions=[centre] * count,
        linkInertialFrameOrientations=[(0, 0, 0, 1)] * count,
        linkParentIndices=[0] * count,
        linkJointTypes=[kind] * count,
        linkJointAxis=axes,
        physicsClientId=client,
    )
    for joint in range(count):
        p.changeDynamics(body, joint, **UNDAMPED, jointDamping=0, physicsClientId=client)
    return body
