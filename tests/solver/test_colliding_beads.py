"""Light beads on one cord that collide, with friction, in long steps: they lock each other and the cord.

No solution may be found for such a step. What is taken then has to be finite, and near to where things were.
"""

import numpy as np
import pybullet as p
import pytest

import bullet_tendon as bt

G = 9.81


def string_of_beads(client, seed):
    """A cord with 2 to 6 beads that swings, falls, hangs or becomes slack: world, cord, its length, a motion.

    The motion is a grip and the way [m] that it takes along x, or None.
    """
    rng = np.random.default_rng(seed)
    at = {"physicsClientId": client}
    p.setTimeStep(1 / rng.choice([60, 80, 120, 240]), **at)
    p.setGravity(0, 0, -G, **at)
    count, size = int(rng.integers(2, 7)), np.exp(rng.uniform(np.log(0.008), np.log(0.03)))
    radius = size / rng.uniform(6, 14)
    bore, mu = radius * rng.uniform(1.2, 2.2), rng.uniform(0.3, 1.0)
    mode = rng.choice(["swing", "drop", "hang", "slack"])
    length = size * count * rng.uniform(1.5, 4)
    world = bt.TendonWorld(physicsClientId=client)
    masses = [np.exp(rng.uniform(np.log(1e-3), np.log(50e-3))) for _ in range(count)]
    stiffness = np.exp(rng.uniform(np.log(300), np.log(2e4)))
    damping, bending = rng.choice([0.0, 1.0]), rng.choice([0, 1e-5 * stiffness * radius])
    law = bt.Material(
        stiffness=stiffness, density=1100.0, friction=1.0, damping=damping, bending_stiffness=bending
    )
    particles = int(rng.integers(16, 50))
    along = np.array([0, 0, -1.0] if mode == "hang" else [1.0, 0, 0])
    cord = world.add_tendon([np.zeros(3), length * along], radius, law, particles=particles)
    first, last = cord.grip(0), None
    if mode == "slack" or (mode == "drop" and rng.random() < 0.5):
        last = cord.grip(-1)
    gap, kind = (length - count * size) / (count + 1), rng.choice(["sphere", "box", "cylinder"])
    turn = p.getQuaternionFromEuler([0, np.pi / 2, 0])
    shapes = {
        "sphere": lambda: p.createCollisionShape(p.GEOM_SPHERE, radius=size / 2, **at),
        "box": lambda: p.createCollisionShape(p.GEOM_BOX, halfExtents=[size / 2] * 3, **at),
        "cylinder": lambda: p.createCollisionShape(
            p.GEOM_CYLINDER, radius=size / 2, height=size, collisionFrameOrientation=turn, **at
        ),
    }
    bodies = []
    for k in range(count):
        place = (along * ((k + 1) * gap + (k + 0.5) * size)).tolist()
        turned = turn if mode == "hang" else [0, 0, 0, 1]
        body = p.createMultiBody(masses[k], shapes[kind](), basePosition=place, baseOrientation=turned, **at)
        p.changeDynamics(body, -1, lateralFriction=mu, restitution=0.0, **at)
        bodies.append(body)
        world.add_tunnel(body, -1, (-size / 2, 0, 0), (size / 2, 0, 0), bore, friction=mu)
        world.add_obstacle(body, friction=mu)
    if last is None and rng.random() < 0.7:
        mass, place = np.exp(rng.uniform(np.log(1e-3), np.log(50e-3))), along * (length + size / 4)
        knob = p.createMultiBody(mass, shapes["sphere"](), basePosition=place.tolist(), **at)
        world.add_obstacle(knob, friction=mu)
        cord.attach(-1, knob)
        bodies.append(knob)
    motion = None
    if mode == "slack":
        motion = last, -rng.uniform(0.2, 0.6) * length
    if mode == "swing" and rng.random() < 0.5:
        motion = first, rng.uniform(-0.5, 0.5) * length
    if rng.random() < 0.4:
        speed = rng.uniform(0.2, 2)
        for body in bodies:
            p.resetBaseVelocity(body, (speed * rng.normal(size=3)).tolist(), **at)
    return world, cord, length, motion


def steps_of(client, seed, steps):
    """Makes the scene, and yields world, cord and length after each of so many steps."""
    world, cord, length, motion = string_of_beads(client, seed)
    start = np.array(motion[0].target) if motion else None
    for k in range(steps):
        if motion and k < 50:
            motion[0].target = tuple(start + [motion[1] * (k + 1) / 50, 0, 0])
        world.step()
        yield world, cord, length


@pytest.mark.filterwarnings("ignore::bullet_tendon.ResolutionWarning")
@pytest.mark.parametrize("seed, steps", [(0, 38), (6, 13), (56, 5), (81, 23)])
def test_a_locked_string_is_not_thrown(client, seed, steps):
    """Steps without a solution do not fail, and no particle gets farther than the cord is long."""
    for _, cord, length in steps_of(client, seed, steps):
        assert np.abs(cord.positions).max() <= 1.2 * length


@pytest.mark.filterwarnings("ignore::bullet_tendon.ResolutionWarning")
def test_bodies_that_part_after_a_release(client):
    """Beads that touched in one step and not in the next one are other bodies; the step is solved again."""
    for _, cord, _ in steps_of(client, 10, 46):
        assert np.isfinite(cord.positions).all()
