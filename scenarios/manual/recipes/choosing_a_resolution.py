"""
Particles, time step and integrator for an error that I can afford
==================================================================

Run the scene twice, the second time with half the time step or twice the particles. The difference tells the
error. This program does so for a tendon that swings with a weight.
"""

import numpy as np
import pybullet as p

import bullet_tendon as bt
from bullet_tendon import view

# %%
# The scene: a tendon of 0.3 m and 30 kN is held at one end, and let go at 60 degrees with 1 kg on the other.
# What matters to us is where the weight is after 1 s.


def bob(time_step, particles, integrator):
    client = p.connect(p.DIRECT)
    p.setGravity(0, 0, -9.81, client)
    p.setTimeStep(time_step, client)
    world = bt.TendonWorld(client, bt.SolverOptions(integrator=integrator))
    end = 0.3 * np.array([np.sin(np.pi / 3), 0, -np.cos(np.pi / 3)])
    tendon = world.add_tendon([(0, 0, 0), end], 0.003, bt.Material(stiffness=3e4, damping=30), particles)
    tendon.grip(0)
    tendon.set_point_mass(-1, 1.0)
    world.step(round(1 / time_step))
    p.disconnect(client)
    return tendon.positions[-1]


# %%
# Time step
# ---------
# Implicit Euler is of first order: half the step, half the error. BDF2 is of second order: half the step, a
# quarter of the error, at the same cost of a step.

best = bob(1 / 15360, 10, "bdf2")
rates, table = (240, 480, 960, 1920), []
print("time step   implicit Euler   BDF2")
for steps in rates:
    errors = [np.linalg.norm(bob(1 / steps, 10, name) - best) for name in ("implicit_euler", "bdf2")]
    table.append(errors)
    print(f"1/{steps:<4} s   {1e3 * errors[0]:8.2f} mm    {1e3 * errors[1]:8.3f} mm")

# %%
names = ("implicit Euler", "BDF2")
orders = np.log2(np.array(table)[:-1] / np.array(table)[1:]).mean(axis=0)
curves = [
    {"x": np.log2(rates), "y": np.log10(errors), "label": name, "marker": "o"}
    for name, errors in zip(names, np.transpose(table), strict=True)
]
labels = {"xlabel": "log2 of the steps per second", "ylabel": "log10 of the error [m]"}
view.figure("error.png", curves=curves, **labels)
print(f"orders: {orders[0]:.2f} and {orders[1]:.2f}")

# %%
# Particles
# ---------
# A tendon that is taut and touches nothing needs few particles. Over a bone it needs enough of them that it
# turns by less than 15 degrees at each; a ``ResolutionWarning`` tells where it turns by more.

for particles in (5, 10, 20, 40):
    away = np.linalg.norm(bob(1 / 960, particles, "bdf2") - bob(1 / 960, 80, "bdf2"))
    print(f"{particles:3} particles: {1e3 * away:.4f} mm")

# %%
# How to choose
# -------------
# - Statics: the time step does not matter. Use ``relax``, or implicit Euler at 1/240 s.
# - Something swings on a free rigid body, on an arm or on nothing: BDF2.
# - Tendons on bodies that are held or stopped: both integrators take implicit Euler there. Choose the time
#   step by its error.
# - Contact reduces the order to one. BDF2 is still at least as good.
#
# The :doc:`benchmarks </scenarios/benchmarks/README>` measure time against error: ``work_precision`` for six
# problems, ``multibody`` for bodies. To halve the error of a swing costs twice the time by implicit Euler,
# and 1.4 times by BDF2.
#
# .. image:: /scenarios/pictures/work_precision.png
