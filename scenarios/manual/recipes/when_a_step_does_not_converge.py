"""
When a step does not converge
=============================

A step is solved until its residual is below a tolerance. If it does not get there, the report tells why. This
program makes such a step on purpose, by a budget that is far too small.
"""

import warnings

import numpy as np
import pybullet as p

import bullet_tendon as bt
from bullet_tendon import view

client = p.connect(p.DIRECT)
p.setGravity(0, 0, -9.81)
world = bt.TendonWorld(client, bt.SolverOptions(max_linear_solves=1))
tendon = world.add_tendon(
    [(0, 0, 0), (0.2, 0, 0)], 0.002, bt.Material(stiffness=1e5, damping=1), particles=60, name="rope"
)
tendon.grip(0)
tendon.set_point_mass(-1, 1.0)

# %%
# What the report says
# --------------------
# ``converged`` is False. ``ended_by`` names the rule that ended the step. ``worst`` is the particle with the
# largest residual, and ``reasons`` counts why parts of the step were solved again.


def tell(report):
    print(f"converged {report.converged}, ended by {report.ended_by}, residual {report.residual:.0e}")


world.step()
tell(world.report)
print(f"worst: particle {world.report.worst[1]} of {world.report.worst[0]!r}")

# %%
# What to do
# ----------
# 1. ``ended_by == "budget"``: raise ``max_linear_solves`` or ``time_budget``.

world.options = bt.SolverOptions()
world.step()
tell(world.report)

# %%
# 2. ``ended_by == "failure"``: halve the time step. Look whether two anchors contradict each other, whether a
#    tendon is led through a bone (``world.penetrations()``), and whether tendons were laid through each
#    other.
# 3. Add damping. A stiff material without damping rings at a period far below the time step.
# 4. Give the tendon a ``bending_stiffness`` where it is pushed together: a rope without one crumples.
# 5. Steps that end "rounding" are solved: no smaller residual can be computed.
#
# ``world.describe()`` tells what is in the world, and gives advice where something is set badly.

print(world.describe())

# %%
# Count such steps in every run:

unconverged, iterations = 0, []
for _ in range(240):
    world.step()
    unconverged += not world.report.converged
    iterations.append(world.report.iterations)

print(f"{unconverged} of 240 steps did not converge")

# %%
# A step that needs many more iterations than those beside it is worth a look.

curve = {"x": range(240), "y": iterations}
view.figure("iterations.png", curves=[curve], xlabel="step", ylabel="iterations")

# %%
# A step without any finite solution
# ----------------------------------
# It raises ``StepFailed`` and leaves the tendons as they were. For long runs ``on_failure="warn"`` leaves the
# step out and gives a ``StepWarning``.

world.options = bt.SolverOptions(on_failure="warn")
tendon.set_force(-1, (0, 0, -1e300))
with warnings.catch_warnings(record=True) as given:
    warnings.simplefilter("always")
    world.step()

print([warning.category.__name__ for warning in given])
print(f"positions are finite: {np.isfinite(tendon.positions).all()}")
