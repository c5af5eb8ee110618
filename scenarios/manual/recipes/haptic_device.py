"""
1 kHz with a haptic device
==========================

A haptic device tells where the hand is, and wants a force back every millisecond. A soft grip is the virtual
coupling between the two. ``time_budget`` bounds the time of a step.
"""

import time

import numpy as np
import pybullet as p

import bullet_tendon as bt
from bullet_tendon import view

# %%
# ``time_budget`` is in seconds. A step that reaches it ends early and says so in ``report.over_budget``. The
# time step of pybullet is that of the device.

rate = 1000
client = p.connect(p.DIRECT)
p.setTimeStep(1 / rate)
p.setGravity(0, -9.81, 0)
world = bt.TendonWorld(client, bt.SolverOptions(time_budget=0.5e-3))

flags = p.URDF_USE_INERTIA_FROM_FILE
femur = world.load_urdf(bt.data_path("femur.urdf"), useFixedBase=True, flags=flags)
(tunnel,) = world.tunnels
entry, outlet = tunnel.ends
axis = (outlet - entry) / np.linalg.norm(outlet - entry)

# %%
# The graft lies before the tunnel, and its first end is a little within it. The coupling has 2,000 N/m and
# 5 N s/m. A stiffer one feels more direct, and makes the device buzz sooner.

graft = world.add_tendon(
    [entry + 0.005 * axis, entry - 0.055 * axis], 0.003, bt.Material.preset("hamstring_graft"), particles=40
)
hand = graft.grip(0, stiffness=2000, damping=5)
graft.grip(-1, stiffness=300, damping=2)  # the tissue that holds the graft back
start = hand.target

# %%
# ``read_device`` stands for the driver of your device. Here the hand goes into the tunnel and trembles.


def read_device(t):
    return start + axis * 0.03 * min(t, 1.0) + 2e-4 * np.sin(2 * np.pi * 9 * t) * np.array([1.0, 0.0, 0.0])


forces, seconds, late = [], [], 0
for k in range(rate):
    begin = time.perf_counter()
    hand.target = read_device(k / rate)
    world.step()
    forces.append(hand.force)  # send this to the device
    seconds.append(time.perf_counter() - begin)
    late += world.report.over_budget

forces = np.array(forces)
print(f"largest force on the hand {np.linalg.norm(forces, axis=1).max():.1f} N")
print(f"largest change in a step {np.linalg.norm(np.diff(forces, axis=0), axis=1).max():.2f} N")
print(f"half of the steps took less than a millisecond: {np.median(seconds) < 1e-3}")

# %%
times = np.arange(rate) / rate
curves = [{"x": times, "y": forces[:, i], "label": "xyz"[i]} for i in range(3)]
view.figure("hand.png", curves=curves, xlabel="time [s]", ylabel="force on the hand [N]")

# %%
# The benchmark ``haptic`` (:doc:`/scenarios/benchmarks/README`) measures the times of such a loop, step by
# step. The first step looks whether tendons begin inside bones. Take it before the device is switched on.
