"""
Reset and replay of a state
===========================

A state of the tendons is saved beside pybullet's own state. Both are put back, and the run repeats itself bit
by bit. In a file, a state outlives the program.
"""

import numpy as np
import pybullet as p

import bullet_tendon as bt
from bullet_tendon import view

# %%
# The scene is made by a function, because a file can only be read by a world that is made of the same parts.


def build():
    client = p.connect(p.DIRECT)
    p.setGravity(0, 0, -9.81, client)
    world = bt.TendonWorld(client)
    post = p.createCollisionShape(p.GEOM_CYLINDER, radius=0.02, height=0.1, physicsClientId=client)
    turn = p.getQuaternionFromEuler((np.pi / 2, 0, 0))
    world.add_obstacle(p.createMultiBody(0, post, -1, (0.06, 0, -0.1), turn, physicsClientId=client))
    material = bt.Material(stiffness=1e4, damping=10)
    tendon = world.add_tendon([(0, 0, 0), (0.25, 0, 0)], 0.003, material, particles=40, name="rope")
    tendon.grip(0)
    return client, world, tendon


client, world, tendon = build()
world.step(60)

# %%
# In memory
# ---------

of_tendons, of_bodies = world.save_state(), p.saveState(client)
world.step(120)
first = world.state_hash()

world.restore_state(of_tendons)
p.restoreState(of_bodies, physicsClientId=client)
world.step(120)
print(f"the same bits: {world.state_hash() == first}")

# %%
camera = {"target": (0.06, 0, -0.1), "distance": 0.45, "yaw": 0, "pitch": -20}
view.save_png("rope.png", view.render_scene(client, camera, tendons=[tendon]))

# %%
# A state takes memory until it is removed.

world.remove_state(of_tendons)
p.removeState(of_bodies, client)

# %%
# In a file
# ---------
# The second world could be in another process, or run on another day. Holds, rest lengths and velocities are
# in the file. The options of the solver and pybullet's bodies are not.

world.snapshot("rope.npz")
p.saveBullet("bodies.bullet", client)

client2, world2, tendon2 = build()
world2.load_snapshot("rope.npz")
p.restoreState(fileName="bodies.bullet", physicsClientId=client2)
print(f"the same positions: {np.array_equal(tendon2.positions, tendon.positions)}")

# %%
# A world of other parts refuses the file.

world2.add_tendon([(0, 0, 0.1), (0.1, 0, 0.1)], 0.003, bt.Material(stiffness=1e4))
try:
    world2.load_snapshot("rope.npz")
except bt.StateMismatch as problem:
    print(problem)
