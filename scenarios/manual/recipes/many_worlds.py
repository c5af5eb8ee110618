"""
Many worlds
===========

``sweep`` runs one function over many cases: in this thread, on processes, or on a cluster. Worlds in one
process can also run on threads, because the core lets other threads run while it solves.
"""

from concurrent.futures import ThreadPoolExecutor

import pybullet as p

import bullet_tendon as bt
from bullet_tendon import view

# %%
# One case builds its own client and its own world, and returns plain numbers. ``rng`` is a random generator
# that belongs to the case: it does not depend on the executor.


def hang(case, rng):
    client = p.connect(p.DIRECT)
    p.setGravity(0, 0, -9.81, client)
    world = bt.TendonWorld(client)
    material = bt.Material(stiffness=case["stiffness"], damping=5)
    tendon = world.add_tendon([(0, 0, 0), (0, 0, -0.2)], 0.002, material, particles=20)
    tendon.grip(0)
    tendon.set_point_mass(-1, 1.0 + 0.01 * rng.standard_normal())
    world.relax()
    p.disconnect(client)
    return {"stretch": tendon.length - tendon.rest_length, "load": tendon.tension[0]}


# %%
# With ``executor=2`` the cases run on two processes. Then the function has to be in a file, and the call
# under ``if __name__ == "__main__":``. With ``file="sweep.jsonl"`` finished cases survive a kill.

cases = [{"stiffness": stiffness} for stiffness in (500, 1000, 2000, 4000)]
results = bt.sweep(hang, cases, seed=1, progress=False)
for case, result in zip(cases, results, strict=True):
    print(f"{case['stiffness']:5} N: {1e3 * result['stretch']:6.3f} mm under {result['load']:.3f} N")

# %%
loads = [case["stiffness"] for case in cases], [1e3 * result["stretch"] for result in results]
curve = {"x": loads[0], "y": loads[1], "marker": "o"}
view.figure("stretch.png", curves=[curve], xlabel="stiffness [N]", ylabel="stretch [mm]")

# %%
# Threads: one world belongs to one thread at a time. Results are the same bits.

with ThreadPoolExecutor(2) as threads:
    again = bt.sweep(hang, cases, seed=1, progress=False, executor=threads)

print(f"the same results on threads: {again == results}")
