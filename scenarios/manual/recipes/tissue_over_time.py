"""
A graft that relaxes and ruptures
=================================

A graft that is held at one length loses tension, because tissue relaxes. It loses energy in every cycle.
Beyond its load it ruptures.
"""

import numpy as np
import pybullet as p

import bullet_tendon as bt
from bullet_tendon import view

client = p.connect(p.DIRECT)
world = bt.TendonWorld(client)

# %%
# The graft
# ---------
# ``tissue=True`` gives a preset its relaxation and its rupture load. Your own constants go into
# ``Material(relaxation=((share, time), ...), rupture_force=)``.

material = bt.Material.preset("hamstring_graft", tissue=True)
graft = world.add_tendon([(0, 0, 0), (0.1, 0, 0)], 0.004, material, particles=11)
graft.grip(0)
hand = graft.grip(-1)


def stretch(strain):
    hand.target = (0.1 * (1 + strain), 0, 0)
    world.step()
    return graft.tension.mean()


# %%
# Relaxation
# ----------
# It is pulled to 1 % of strain within 0.1 s, and held for 10 s.

times = np.arange(1, 2425) / 240
held = [stretch(0.01 * min(1, t / 0.1)) for t in times]
print(f"{max(held):.0f} N at first, {held[-1]:.0f} N after {times[-1]:.0f} s")

# %%
view.figure("relaxation.png", curves=[{"x": times, "y": held}], xlabel="time [s]", ylabel="tension [N]")

# %%
# Hysteresis
# ----------
# The area within a loop of force and strain is the energy that is lost in a cycle. Tendons lose 6 to 11 % of
# the work of loading, at any frequency from 0.2 to 11 Hz (Bennett et al. 1986).

strains = 0.015 * (1 - np.cos(2 * np.pi * np.arange(5 * 240 + 1) / 240))
forces = np.array([stretch(strain) for strain in strains])
work = (forces[-240:] + forces[-241:-1]) / 2 * np.diff(strains[-241:])
loss = work.sum() / work[work > 0].sum()
print(f"{loss:.1%} lost in a cycle of 1 s")

# %%
loop = [{"x": 100 * strains[-241:], "y": forces[-241:]}]
view.figure("hysteresis.png", curves=loop, xlabel="strain [%]", ylabel="tension [N]")

# %%
# Rupture
# -------
# One segment ruptures, and carries nothing from then on.

strain, strength = 0.03, 0.0
while not graft.ruptured:
    strength = graft.tension.max()
    strain += 1e-5
    stretch(strain)

world.step(60)
print(f"{strength:.0f} N before it ruptured in segment {graft.ruptured_segments[0]}")
print(f"{np.linalg.norm(hand.force):.1f} N in the hand after that")
