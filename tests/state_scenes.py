"""A scene with everything that has state: holds, friction, a tunnel, tendons that touch, bodies."""

from pathlib import Path

import numpy as np
import pybullet as p

import bullet_tendon as bt


def build(client, bodies: bool, **options):
    """The world and its tendons. bodies: movable ones too."""
    p.setGravity(0, 0, -9.81, physicsClientId=client)
    p.setTimeStep(1 / 240, physicsClientId=client)
    world = bt.TendonWorld(client, bt.SolverOptions(**options))
    material = bt.Material(stiffness=2e4, exponent=1.5, damping=2.0, shear_stiffness=1e3, friction=0.5)
    plane = p.createMultiBody(
        0, p.createCollisionShape(p.GEOM_PLANE, physicsClientId=client), physicsClientId=client
    )
    half = [0.05, 0.05, 0.05]
    box = p.createCollisionShape(p.GEOM_BOX, halfExtents=half, physicsClientId=client)
    bone = p.createMultiBody(0, box, basePosition=(0.15, 0, 0.1), physicsClientId=client)
    for body in (plane, bone):
        world.add_obstacle(body, friction=0.8)
    world.add_tunnel(bone, -1, (0.04, 0, -0.05), (0.04, 0, 0.05), radius=0.008, chamfer=0.002)
    over = world.add_tendon([[0, 0, 0.17], [0.3, 0, 0.17]], 0.004, material, 20, name="over")
    through = world.add_tendon([[0.19, 0, 0.02], [0.19, 0, 0.3]], 0.004, material, 16, name="through")
    across = world.add_tendon([[0.05, -0.1, 0.2], [0.05, 0.1, 0.2]], 0.003, material, 12, name="across")
    over.grip(0)
    through.grip(-1, target=(0.19, 0, 0.29), stiffness=500.0, damping=1.0)
    across.set_force(3, (0.1, 0, 0))
    if bodies:
        _hang_weights(client, over, across)
    return world, (over, through, across)


def _hang_weights(client, over, across):
    ball = p.createCollisionShape(p.GEOM_SPHERE, radius=0.01, physicsClientId=client)
    weight = p.createMultiBody(0.2, ball, basePosition=tuple(over.positions[-1]), physicsClientId=client)
    over.attach(-1, weight)
    offset = {"baseInertialFramePosition": (0, 0.01, 0), "physicsClientId": client}
    heavy = p.createMultiBody(0.3, ball, basePosition=tuple(across.positions[-1] + (0, 0, -0.02)), **offset)
    across.attach(-1, heavy)
    across.grip(0)


def disturb(world):
    """Change whatever can be changed without changing what the world is made of."""
    for t in world.tendons:
        t.shorten(0.002)
        t.set_positions(t.positions + 0.01, np.ones((t.particles, 3)))
        t.set_force(1, (1, 2, 3))
        for hold in t.holds:
            hold.release()
    world.tendons[0].grip(4)
    world.step(7)


def run_from(folder, bodies: bool, steps: int) -> str:
    """The state's hash, some steps after the snapshot and pybullet's file in a folder."""
    client = p.connect(p.DIRECT)
    world, _ = build(client, bodies)
    world.load_snapshot(Path(folder) / "state.npz")
    p.restoreState(fileName=str(Path(folder) / "state.bullet"), physicsClientId=client)
    world.step(steps)
    return world.state_hash()
