"""Scenes of tendons that touch themselves and each other: folds, knots, braids."""

import numpy as np
from everyday_scene import Scene, family, nearest


def apart(scene, tendons, allowed=0.1):
    """Segments that are not neighbours are a diameter apart.

    Neighbours: as far along as half of the tightest turn of a tube, pi radii; a tenth of a diameter for
    chords between particles, and half a radius for what moves.
    """
    for k, first in enumerate(tendons):
        for second in tendons[: k + 1]:
            gap, moved = nearest(first, second), 0.0
            for t in (first, second):
                moved = max(moved, min(np.abs(t.velocities).max() * scene.dt, t.radius / 2))
            right = first.radius + second.radius
            message = f"{first.name} and {second.name} are {gap:.4g} m apart, touching is {right:.4g} m"
            scene.check(gap >= (1 - allowed) * right - moved, message)


@family
def folded(scene: Scene):
    """A stiff tendon is held in its middle, and both ends are pulled to one side: it folds.

    A fold is pressed together by at most the forces on it, and what moves comes from their work.
    """
    scene.begin(gravity=scene.coin())
    radius, length, force = scene.log(5e-4, 4e-3), scene.flat(0.05, 0.3), scene.log(0.05, 100)
    material = scene.material(
        force, bending_stiffness=scene.log(1e-7, 1e-3), damping=scene.pick(0.0, 1.0, 20.0)
    )
    n = scene.whole(9, 60)
    t = scene.world.add_tendon([(-length / 2, 0, 0), (length / 2, 0, 0)], radius, material, n)
    hand = t.grip(n // 2)
    for end in (0, -1):
        t.set_force(end, (0, 0, -force))
    scene.run(scene.steps)
    apart(scene, scene.tendons, 0.2)
    weight = t._target.masses.sum() * -scene.gravity
    right = np.array([0, 0, -2 * force]) - weight
    scene.near("force on the hand [N]", hand.force, right, rel=1e-6, absolute=scene.inertia(t))


def trefoil(scene, radius, length, particles, material):
    """A tendon laid as an open overhand knot, ends along x."""
    a = np.linspace(-0.9 * np.pi, 0.9 * np.pi, 160)
    loop = np.c_[np.sin(a) + 2 * np.sin(2 * a), np.cos(a) - 2 * np.cos(2 * a), -1.5 * np.sin(3 * a)]
    loop *= 0.03 * length
    # A closed trefoil is cut open where it is outermost, and its ends are led away from each other.
    first, last = (
        loop[0] + 0.2 * length * np.array([0.8, -0.6, 0]),
        loop[-1] + 0.2 * length * np.array([-0.8, -0.6, 0]),
    )
    line = np.vstack([first, loop, last])
    return scene.world.add_tendon(line, radius, material, particles)


@family
def overhand_knot(scene):
    """An overhand knot is pulled: it never passes through itself, and both hands feel the same pull."""
    scene.begin(gravity=False)
    length = scene.flat(0.1, 0.4)
    radius = scene.flat(0.003, 0.006) * length
    material = scene.material(
        500.0, friction=scene.flat(0, 0.5), bending_stiffness=scene.pick(0.0, scene.log(1e-6, 1e-4))
    )
    t = trefoil(scene, radius, length, 60, material)
    scene.check(nearest(t._target, t._target) > 2 * radius, "the scene is laid through itself")
    hands = t.grip(0), t.grip(-1)
    x = t.positions
    way = (x[-1] - x[0]) / np.linalg.norm(x[-1] - x[0])
    slack = t.length - np.linalg.norm(x[-1] - x[0])
    # Nowhere near the length of a tight knot (16 diameters).
    left = max(0.3 * slack, slack - 0.5 * (t.length - 50 * 2 * radius))
    goes = scene.flat(0.2, 1) * (slack - left)
    begun = np.array(hands[0].target)

    def watch():
        if len(scene.seconds) % 20 == 0:
            apart(scene, scene.tendons)

    start, go = (np.round(v, 7).tolist() for v in (begun, -goes / 2 * way))
    away = f"{hands[0]._name}.target = np.add({start}, np.multiply({go}, s))"
    scene.lead(hands[1], goes / 2 * way, scene.steps, away, watch=watch)


@family
def knot_on_post(scene):
    """A loop around a cylinder with crossed ends is pulled by up to 200 N: it stays outside the cylinder."""
    scene.begin(gravity=False)
    force, size = scene.log(0.5, 200), scene.log(0.008, 0.03)
    radius = scene.flat(0.05, 0.12) * size
    scene.body("cylinder", (size, 0.4), 0, (0, 0, 0), friction=1.0)
    a = 1.12 * size + radius
    turns = np.linspace(-1.5 * np.pi, 1.5 * np.pi, 80)
    helix = np.c_[a * np.cos(turns), a * np.sin(turns), 1.3 * radius * turns / np.pi]
    first, last = helix[0] + [4 * a, 0, 0], helix[-1] + [4 * a, 0, 0]
    mu = scene.flat(0, 0.4)
    material = scene.material(force, friction=mu)
    t = scene.world.add_tendon(np.vstack([first, helix, last]), radius, material, 60)
    t.set_force(0, (force, 0, 0))
    hand = t.grip(-1)
    scene.run(scene.steps // 2)
    scene.lead(hand, (scene.flat(0.001, 0.01), 0, 0), scene.steps // 2)
    apart(scene, scene.tendons, 0.2)
    scene.no_opposed_contacts()


@family
def braid(scene):
    """Two strands twisted about each other and pulled share the pull, and do not pass through each other."""
    scene.begin(gravity=False)
    radius, length, force = scene.log(5e-4, 3e-3), 0.0, scene.log(1, 500)
    length = scene.flat(40, 80) * radius
    turns, circle = scene.flat(0.5, 1.5), 1.15 * radius
    material = scene.material(force, friction=scene.flat(0, 0.5))
    n = scene.whole(40, 60)
    u = np.linspace(0, 1, 120)
    hands = []
    for k in range(2):
        angle = 2 * np.pi * turns * u + np.pi * k
        line = np.c_[length * u, circle * np.cos(angle), circle * np.sin(angle)]
        t = scene.world.add_tendon(line, radius, material, n)
        t.grip(0)
        hands.append(t.grip(-1))
    stretch = scene.flat(0.002, 0.02) * length

    def watch():
        if len(scene.seconds) % 20 == 0:
            apart(scene, scene.tendons)

    start = np.array(hands[1].target)
    other = f"{hands[1]._name}.target = np.add({np.round(start, 7).tolist()}, [{stretch!r} * s, 0, 0])"
    scene.lead(hands[0], (stretch, 0, 0), scene.steps, other, watch=watch)
    pulls = [t.tension.mean() for t in scene.tendons]
    scene.near("shares of the strands [N]", pulls[0], pulls[1], rel=0.05, absolute=1e-3 * force)
