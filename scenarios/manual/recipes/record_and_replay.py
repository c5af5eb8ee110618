"""
Record, plot and replay a run
=============================

A recorder keeps a run: centrelines, tensions, contacts, poses, and numbers of your own. The run can be
plotted, saved, and played in a browser.
"""

import numpy as np
import pybullet as p

import bullet_tendon as bt

client = p.connect(p.DIRECT)
p.setGravity(0, 0, -9.81)
world = bt.TendonWorld(client)

# %%
# A rope with a weight falls over a post.

post = p.createMultiBody(
    0,
    p.createCollisionShape(p.GEOM_CYLINDER, radius=0.015, height=0.1),
    p.createVisualShape(p.GEOM_CYLINDER, radius=0.015, length=0.1),
    (0.1, 0, -0.05),
    p.getQuaternionFromEuler((np.pi / 2, 0, 0)),
)
world.add_obstacle(post, friction=1.0)
material = bt.Material(stiffness=2e4, damping=20, friction=0.3)
rope = world.add_tendon([(0, 0, 0), (0.3, 0, 0)], 0.003, material, particles=60, name="rope")
hand = rope.grip(0)
rope.set_point_mass(-1, 0.2)

# %%
# ``every=4`` keeps each fourth step by itself. ``scalars`` are functions whose numbers are kept as well. A
# recorder takes a small part of a step, and its memory is bounded. ``camera`` is the direction from which the
# replay is seen. It begins where all is in sight, unless a ``target`` and a ``distance`` are given too.

scalars = {"pull on the hand [N]": lambda: np.linalg.norm(hand.force)}
camera = {"yaw": 15, "pitch": -15}
with bt.Recorder(world, every=4, scalars=scalars, camera=camera, title="A rope over a post") as recorder:
    for _ in range(480):
        world.step()

print(recorder)

# %%
# The numbers
# -----------
# A recording has one array for each thing, with one row for each frame.

recording = recorder.recording
track = recording.tendon("rope")
print(f"positions {track.positions.shape}, tension {track.tension.shape}")
times, pull = recording.scalar("pull on the hand [N]")
print(f"largest pull {pull.max():.1f} N at {times[pull.argmax()]:.3f} s")

# %%
# The plot
# --------

figure = bt.plot(recorder, "run.png")

# %%
# The files
# ---------
# The HTML file opens without network and server. The npz file has all of the recording.

recorder.save("run.html")
recorder.save("run.npz")
again = bt.Recorder.load("run.npz")
print(f"the same tensions: {np.array_equal(again.tendon('rope').tension, track.tension)}")
