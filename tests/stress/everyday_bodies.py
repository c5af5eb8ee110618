"""Scenes of bodies on tendons: hung, swung, dropped, knotted beside their centre, arms and fingers."""

import math

import numpy as np
from everyday_scene import FASTEST, File, G, Scene, family, rounded
from link_scenes import cube
from scipy.optimize import minimize

import bullet_tendon as bt

SIZE = 0.02  # m, of a body


def load(scene: Scene, mass, at=(0, 0, 0), size=SIZE):
    """A body of a random shape."""
    kind = scene.pick("sphere", "box", "cylinder", "capsule")
    sizes = {"sphere": (size,), "box": (size, 1.5 * size, 2 * size)}.get(kind, (size / 2, size))
    return scene.body(kind, sizes, mass, at)


def straight(scene, ends, material, particles, radius=5e-4):
    return scene.world.add_tendon(np.array(ends), radius, material, particles)


def settle(scene, *lines):
    """All steps but the first quarter bring bodies to rest: their speed is lost by a thousandth each ms."""
    lose = max(0.5, 1 - 3 * scene.dt)
    slow = "[p.resetBaseVelocity(b, *np.multiply(p.getBaseVelocity(b), {})) for b in {}]"
    bodies = "[" + ", ".join(b.text for b in scene.free) + "]"
    scene.energy = False
    scene.run(scene.steps, *lines, slow.format(round(lose, 6), bodies))


@family
def hung(scene):
    """A body on a straight tendon: it hangs at X = L (F/K)^(1/p), or at the stretch of the ligament's law."""
    scene.begin()
    mass, length = scene.log(1e-3, 100), scene.flat(0.03, 0.5)
    material = scene.material(mass * G)
    n = scene.whole(2, 60)
    stretch = length * (1 + stretched(material, mass * G))
    t = straight(scene, [(0, 0, 0), (0, 0, -length)], material, n)
    hand = t.grip(0)
    body = load(scene, mass, (0, 0, -length))
    hold = t.attach(-1, body)
    # It begins at the stretch that is right, and has to stay there.
    x = np.outer(np.linspace(0, -1, n), [0, 0, stretch])
    scene.p.resetBasePositionAndOrientation(body, [0, 0, -stretch], [0, 0, 0, 1])
    t.set_positions(x)
    scene.run(scene.steps)
    own = t._target.masses.sum() * G
    # The tendon's own weight is not in the formula.
    more = length * (stretched(material, mass * G + own) - stretched(material, mass * G))
    scene.near("height [m]", scene.place(body)[0][2], -stretch, absolute=2 * more + 2e-6 * length)
    scene.near("force on the body [N]", hold.force[2], mass * G, rel=2e-3, absolute=2 * own)
    scene.near("force on the hand [N]", hand.force[2], -mass * G, rel=2e-3, absolute=2 * own)


def stretched(material, force):
    """Strain at which a cross-section carries that."""
    toe = material.toe
    at_toe = material.stiffness * toe**material.exponent if toe < math.inf else math.inf
    if force <= at_toe:
        return (force / material.stiffness) ** (1 / material.exponent)
    return toe + (force - at_toe) / (material.exponent * at_toe / toe)


@family
def pretensioned(scene):
    """A tendon of a given rest length between two hands begins under the tension of its law, and keeps it."""
    scene.begin(gravity=False)
    force, length, n = scene.log(0.1, 2000), scene.flat(0.02, 0.4), scene.whole(2, 60)
    material = scene.material(force)
    rest = rounded(length / (1 + stretched(material, force)))
    force = carried(material, length / rest - 1)
    line = [(0, 0, 0), (0, 0, length)]
    t = scene.world.add_tendon(line, 1e-3, material, n, rest_length=rest, collides=scene.coin())
    hands = t.grip(0), t.grip(-1)
    scene.near("tension at the start [N]", t.tension, np.full(n - 1, force), rel=1e-6)
    scene.run(scene.steps)
    scene.near("tension [N]", t.tension, np.full(n - 1, force), rel=1e-6)
    scene.near("hands [N]", [h.force[2] for h in hands], [force, -force], rel=1e-6)


def carried(material, strain):
    """What a cross-section carries at a strain; see stretched."""
    low = min(strain, material.toe)
    at_low = material.stiffness * low**material.exponent
    return at_low + material.exponent * at_low / low * (strain - low)


def pendulum(scene):
    """A weight on a cord: (tendon, hand, mass, length, where it is let go, the longest of the cord)."""
    scene.begin()
    mass, length, first = scene.log(1e-3, 50), scene.flat(0.1, 1.0), scene.flat(0.1, 1.2)
    where = np.array([math.sin(first), 0, -math.cos(first)]) * length
    material = scene.material(3 * mass * G, density=500)
    t = straight(scene, [(0, 0, 0), where], material, scene.whole(2, 30))
    hand = t.grip(0)
    if scene.coin():
        t.set_point_mass(-1, mass)
    else:
        t.attach(-1, scene.body("sphere", (SIZE,), mass, where))
    own = t._target.masses.sum() - (0 if scene.free else mass)
    # At the lowest point the cord carries at most three weights; a fifth more for how it gets taut.
    longest = length * (1.002 + 1.2 * stretched(material, 3 * (mass + own) * G))
    return t, hand, mass, length, where, longest


@family
def swung(scene):
    """A pendulum never rises above where it was let go, stays in its plane, and its cord is no longer."""
    t, _, _, length, where, longest = pendulum(scene)
    highest = where[2] + 0.01 * length  # a step of gravity: first order in time

    def bound():
        x = t.positions[-1]
        scene.check(np.linalg.norm(x) <= longest, f"length {np.linalg.norm(x):.6g} m, at most {longest:.6g}")
        scene.check(x[2] <= highest, f"height {x[2]:.6g} m above {highest:.6g}, where it was let go")
        scene.check(abs(x[1]) <= 1e-3 * length, f"{x[1]:.3g} m out of its plane")

    scene.run(scene.steps, watch=bound)


@family
def tension_of_what_swings(scene):
    """A hand that stands still feels the tension beside it, and the weight of its particle."""
    t, hand, mass, *_ = pendulum(scene)

    def compare():
        beside = t.positions[1] - t.positions[0]
        right = t.tension[0] * beside / np.linalg.norm(beside) + t._target.masses[0] * scene.gravity
        largest = max(np.linalg.norm(hand.force), mass * G)
        scene.follow(hand, right)
        scene.near_end("force on the hand [N]", hand, 0.02 * largest)

    scene.run(scene.steps, watch=compare)


@family
def bounced(scene):
    """A body falls into a slack tendon, and does not bounce above where it was let go."""
    scene.begin()
    mass, length = scene.log(1e-3, 100), scene.flat(0.05, 0.3)
    n, drop = scene.whole(2, 60), scene.flat(0.01, 0.9)
    t = straight(scene, [(0, 0, 0), (0, 0, -length)], scene.material(mass * G), n)
    t.grip(0)
    body = load(scene, mass, (0, 0, -length))
    t.attach(-1, body)
    top = -length * (1 - drop)
    side = 0.5 * length * math.sqrt(1 - (1 - drop) ** 2)
    fold = np.interp(np.linspace(0, 1, n), [0, 0.5, 1], [0, 1, 0]) if n > 2 else np.zeros(n)
    x = np.c_[fold * side, 0 * fold, np.linspace(0, top, n)]
    if n > 2:
        t.set_positions(x)
        scene.p.resetBasePositionAndOrientation(body, [0, 0, top], [0, 0, 0, 1])

    def bound():
        z = scene.place(body)[0][2]
        scene.check(z <= scene.begun_at + 0.02 * length, f"height {z:.4g} m, let go at {scene.begun_at:.4g}")

    scene.begun_at = scene.place(body)[0][2]
    scene.run(scene.steps, watch=bound)


@family
def light_body_off_centre(scene):
    """1-10 g knotted beside the centre, and pulled by up to 1 kN: the knot stays where it is."""
    pulled_light_body(scene, "p.applyExternalForce")


@family
def told_force_on_light_body(scene):
    """The same, where the tendons are told of the force: no step is late."""
    pulled_light_body(scene, "world.apply_external_force")


def pulled_light_body(scene, apply):
    scene.begin()
    mass, force = scene.log(1e-3, 0.01), scene.log(0.1, 1000)
    lever, length = scene.flat(0.001, 0.008), scene.flat(0.05, 0.3)
    body = scene.body("sphere", (0.01,), mass)
    t = straight(scene, [(0, 0, length), (lever, 0, 0)], scene.material(force), scene.whole(2, 40), 1e-3)
    t.grip(0)
    hold = t.attach(-1, body)
    scene.run(scene.steps // 4)
    way = [round(v, 4) for v in (force * (np.array([0, 0, -1]) + 0.2 * scene.direction())).tolist()]
    push = f"x = p.getBasePositionAndOrientation({body.text})[0]"
    go = f"{apply}({body.text}, -1, {way!r}, x, p.WORLD_FRAME)"
    told = not apply.startswith("p.")
    applied = f"applied = {{int({body.text}): {way!r}}}"
    for lines, unknown in (((push, go, applied), force), (("applied = {}",), 0.0)):
        if not told:
            scene.run(5, *lines)  # a force is learned from what it did
        # Of a told force, the solver leaves a share of 1e-9 (SolverOptions.tolerance).
        more = (2e-9 if told else 2.0) * unknown / mass * scene.dt**2
        scene.run(scene.steps // 3, *lines, watch=lambda more=more: at_its_place(scene, t, hold, more))


def at_its_place(scene, t, hold, more):
    """An attached particle is where the body has its point.

    The body goes straight in a step, its points around: by the square of its angle. more [m]: the way in a
    step under forces that the world learns from what they do, or that it leaves unbalanced. Not judged: what
    pybullet or the world stop (FASTEST), where the forces on it are not known.
    """
    motion = np.abs(scene.raw.getBaseVelocity(hold.bodyUniqueId))
    if max(motion.max(), np.abs(scene.rates_before[hold.bodyUniqueId]).max()) > FASTEST:
        return
    origin, axes = scene.place(hold.bodyUniqueId, hold.linkIndex)
    spin = np.linalg.norm(scene.raw.getBaseVelocity(hold.bodyUniqueId)[1])
    arm = np.linalg.norm(hold.position)
    allowed = 1e-7 + arm * min(2.0, 0.5 * (spin * scene.dt) ** 2) + more
    right = origin + axes @ hold.position
    scene.near("place of an attached particle [m]", t.positions[hold.particle], right, absolute=allowed)


def equilibrium(anchors, lengths, law, mass, start):
    """Where a weight hangs from straight strands: the least of springs' energies and height."""

    def energy(x):
        strain = np.maximum(np.linalg.norm(anchors - x, axis=1) / lengths - 1, 0)
        return (lengths * law(strain)).sum() + mass * G * x[2]

    scale = np.abs(lengths).max()
    found = minimize(lambda u: energy(u * scale) / (mass * G * scale), start / scale, method="Nelder-Mead",
                     options={"xatol": 1e-10, "fatol": 1e-14, "maxiter": 20000, "maxfev": 20000})  # fmt: skip
    return found.x * scale


def spring_energy(material):
    """Integral of the law over the strain, of tension."""
    k, p, toe = material.stiffness, material.exponent, material.toe

    def law(s):
        low = np.minimum(s, toe)
        beyond = s - low
        at_toe = 0.0 if toe == math.inf else k * toe**p
        slope = 0.0 if toe == math.inf else p * at_toe / toe
        return k * low ** (p + 1) / (p + 1) + at_toe * beyond + slope * beyond**2 / 2

    return law


def on_strands(scene, count, mass, particles, material, insertion, radius, collides=True):
    """A body on strands from hands around above it; returns the tendons, the hands' places and the body."""
    length = scene.flat(0.04, 0.2)
    ball = scene.body("sphere", (0.01,), mass)
    tendons, places = [], []
    for k in range(count):
        a = 2 * np.pi * (k + scene.flat(-0.2, 0.2)) / count
        tilt = scene.flat(0.2, 0.8)
        way = np.array([math.sin(tilt) * math.cos(a), math.sin(tilt) * math.sin(a), math.cos(tilt)])
        end = insertion * scene.direction()
        place = end + length * way
        t = scene.world.add_tendon([place, end], radius, material, particles, collides=collides)
        t.grip(0)
        t.attach(-1, ball)
        tendons.append(t)
        places.append(t.positions[0])
    return tendons, np.array(places), ball


def balanced(scene, tendons, body, mass, allowed=0.01):
    """Forces on the body are its weight and what its speed changed by in the last step."""
    weight = np.array([0, 0, -mass * G])
    given = sum(h.force for t in tendons for h in t.holds if hasattr(h, "linkIndex"))
    largest = max(np.linalg.norm(h.force) for t in tendons for h in t.holds)
    change = mass * np.linalg.norm(scene.speed(body) - scene.rates_before[body][:3]) / scene.dt
    scene.near("forces on the body [N]", given, -weight, absolute=allowed * largest + change)


def hangs_at_rest(scene, tendons, places, body, mass, material):
    """Where statics say. The tendons' own weight shifts it by its share of the load's stretch."""
    lengths = np.array([t.rest_length for t in tendons])
    right = equilibrium(places, lengths, spring_energy(material), mass, scene.place(body)[0] - (0, 0, 1e-4))
    own = sum(t._target.masses.sum() for t in tendons) / mass
    stretch = lengths.max() * stretched(material, mass * G)
    speed = np.linalg.norm(scene.speed(body))
    still = speed * scene.steps * scene.dt * 0.1 < 0.01 * stretch
    if still:
        where = scene.place(body)[0]
        scene.near(
            "place of the body [m]", where, right, absolute=(0.05 + own) * stretch + 1e-3 * lengths.max()
        )


@family
def damped_strands(scene):
    """Up to eight tension-only strands with rate damping and inner particles carry a body."""
    scene.begin()
    count, mass = scene.whole(3, 8), scene.log(1e-3, 100)
    material = bt.Material.ligament(scene.log(20 * mass * G, 2e3 * mass * G), scene.flat(0.02, 0.06))
    lever = scene.pick(0.0, 0.008)
    tendons, places, body = on_strands(scene, count, mass, scene.whole(3, 30), material, lever, 1e-4)
    settle(scene)
    balanced(scene, tendons, body, mass)
    if lever == 0 and scene.dt > 1 / 300:
        hangs_at_rest(scene, tendons, places, body, mass, material)


@family
def strands_at_one_insertion(scene):
    """Strands that end at one point, and so do not collide, share a load."""
    scene.begin()
    count, mass = scene.whole(3, 8), scene.log(1e-3, 50)
    material = bt.Material.ligament(scene.log(20 * mass * G, 2e3 * mass * G), scene.flat(0.02, 0.06))
    tendons, places, body = on_strands(
        scene, count, mass, scene.whole(5, 40), material, scene.flat(0, 1e-3), scene.log(2e-4, 1e-3), False
    )
    settle(scene)
    balanced(scene, tendons, body, mass)


@family
def heavy_ends(scene):
    """Strands of two particles whose ends weigh much for their stiffness: no lasting chatter."""
    scene.begin()
    count, mass = scene.whole(3, 8), scene.log(0.1, 10)
    radius, length = scene.log(1e-3, 4e-3), 0.1
    end = scene.log(1e-5, 2e-4)  # kg, of half a strand
    density = round(2 * end / (np.pi * radius**2 * length), 3)
    slope = scene.log(20 * mass * G, 2e3 * mass * G)
    material = bt.Material(
        stiffness=slope, tension_only=True, density=density, damping=scene.pick(0.0, 1e-3 * slope)
    )
    tendons, places, body = on_strands(scene, count, mass, 2, material, 0.009, 1e-4)
    settle(scene)
    balanced(scene, tendons, body, mass)


@family
def strands_between_bodies(scene):
    """One to eight strands between one to four bodies and hands: momentum and energy of all."""
    scene.begin(gravity=scene.coin())
    corners = [(0, 0, 0), (0.1, 0, 0), (0, 0.1, 0), (0.06, 0.06, 0.1)]
    bodies = [load(scene, scene.log(1e-3, 100), x) for x in corners[: scene.whole(1, 4)]]
    heaviest = max(scene.mass(b) for b in bodies) * G
    material, apart = scene.material(heaviest), scene.coin()
    for _ in range(scene.whole(1, 8)):
        first = scene.pick(*bodies)
        others = [b for b in bodies if b is not first]
        at = lambda b: scene.place(b)[0] + 0.01 * scene.direction()  # noqa: E731
        start = at(first)
        end = at(scene.pick(*others)) if others and scene.coin() else start + 0.1 * scene.direction()
        t = scene.world.add_tendon([start, end], 5e-4, material, scene.whole(2, 30), collides=apart)
        t.attach(0, first)
        other = next((b for b in others if np.linalg.norm(scene.place(b)[0] - end) < 0.0101), None)
        if other is None:
            t.grip(-1)
        else:
            t.attach(-1, other)
    scene.run(scene.steps)


@family
def struts(scene):
    """One to four slender rods between cables to each other and to hands, struck: momentum and energy."""
    scene.begin(gravity=scene.coin())
    rods = [rod(scene, (0.5 * k, 0, 0)) for k in range(scene.whole(1, 4))]
    heaviest = max(scene.mass(body) for body, _ in rods) * G
    material = scene.material(heaviest * scene.log(1, 100))
    for body, ends in rods:
        for end in ends:
            for _ in range(scene.whole(1, 3)):
                others = [found for found in rods if found[0] is not body]
                other, far = scene.pick((None, end + scene.flat(0.05, 0.3) * scene.direction()), *others)
                place = far if other is None else scene.pick(*far)
                tie(scene, body, end, other, place, material, 1 - scene.flat(0, 0.05))
        strike(scene, body, scene.flat(0, 2), scene.flat(0, 30))
    scene.run(scene.steps)


def rod(scene, at):
    """A slender body, and its two ends."""
    kind, length = scene.pick("cylinder", "capsule", "box"), scene.flat(0.1, 0.4)
    width = length / scene.log(8, 60)
    sizes = rounded((width, width, length) if kind == "box" else (width / 2, length))
    body = scene.body(kind, sizes, scene.log(5e-3, 1), at, random_turn(scene))
    origin, axes = scene.place(body)
    return body, [origin + side * 0.5 * length * axes[:, 2] for side in (1, -1)]


def random_turn(scene):
    turn = np.append(scene.direction(), scene.flat(-1, 1))
    return rounded(turn / np.linalg.norm(turn))


def tie(scene, body, place, other, far, material, share):
    """A cable that collides with nothing, shorter by a share than from its place on a body to a far one."""
    length = round(share * np.linalg.norm(far - place), 6)
    t = scene.world.add_tendon(
        [place, far], 5e-4, material, scene.whole(2, 12), rest_length=length, collides=False
    )
    t.attach(0, body)
    t.grip(-1) if other is None else t.attach(-1, other)


def strike(scene, body, speed, spin):
    """Give it a velocity and a spin."""
    motion = [rounded(size * scene.direction()) for size in (speed, spin)]
    scene.p.resetBaseVelocity(body, *motion)


@family
def spun(scene):
    """A disc, a plate or a bar that spins on one to three cords: energy and momentum."""
    scene.begin(gravity=scene.coin())
    sizes = rounded([scene.log(0.01, 0.2) for _ in range(3)])
    body = scene.body("box", sizes, scene.log(0.01, 1), turn=random_turn(scene))
    material = scene.material(scene.mass(body) * G * scene.log(1, 30))
    origin, axes = scene.place(body)
    for _ in range(scene.whole(1, 3)):
        place = origin + axes @ (0.5 * np.array(sizes) * [scene.flat(-1, 1) for _ in range(3)])
        far = place + scene.flat(0.1, 0.4) * scene.direction()
        tie(scene, body, place, None, far, material, 1 + scene.flat(0, 0.1))
    strike(scene, body, scene.flat(0, 1), scene.flat(5, 70))
    scene.run(scene.steps)


@family
def point_masses(scene):
    """Beads on a cord between two hands: the hands carry their weight."""
    scene.begin()
    n, count = scene.whole(5, 60), scene.whole(1, 4)
    masses = [scene.log(1e-3, 20) for _ in range(count)]
    material = scene.material(4 * sum(masses) * G)
    span, sag = scene.flat(0.1, 0.5), scene.flat(0.02, 0.1)
    t = straight(scene, [(0, 0, 0), (span / 2, 0, -sag), (span, 0, 0)], material, n)
    hands = t.grip(0), t.grip(-1)
    for m in masses:
        t.set_point_mass(scene.whole(1, n - 2), m)
    scene.world.relax()
    relaxed = scene.world.report.converged
    scene.run(scene.steps)
    weight = t._target.masses.sum() * G
    carried = -sum(h.force[2] for h in hands)
    moving = t._target.masses @ np.abs(t.velocities) @ np.ones(3) / scene.dt
    scene.near("weight on the hands [N]", carried, weight, rel=1e-6, absolute=moving)
    # It began in its equilibrium: nothing moves. Rounding of springs as stiff as these: micrometres.
    if relaxed:
        scene.near("speed in equilibrium [m/s]", np.abs(t.velocities).max(), 0, absolute=1e-4)


@family
def net(scene):
    """A ball falls on a net of three strands each way, which it does not fit through: it is caught."""
    scene.begin(dt=scene.log(1 / 1000, 1 / 100))
    span, radius, mass = scene.flat(0.1, 0.3), scene.log(1e-3, 3e-3), scene.log(5e-3, 5)
    gap, size = span / 4, 0.35 * span
    material = scene.material(20 * mass * G, friction=scene.flat(0, 0.6))
    n, high = scene.whole(16, 40), 2.1 * radius
    for place in (-gap, 0, gap):
        for line in ([(-span, place, 0), (span, place, 0)], [(place, -span, high), (place, span, high)]):
            t = straight(scene, line, material, n, radius)
            t.grip(0)
            t.grip(-1)
    ball = scene.body("sphere", (size,), mass, (0, 0, size + 4 * radius + scene.flat(0, 0.05)), friction=1.0)
    scene.run(scene.steps)
    x, y, z = scene.place(ball)[0]
    scene.check(max(abs(x), abs(y)) > span / 2 or z > 0, f"the ball fell through: it is at {z:.3g} m")


@family
def cut_steps(scene):
    """Where a step is taken in parts, the tension beside a hold is still the force on it.

    A body is let fall into a bight over a sharp box, then rests: what holds a particle gets its tension, and
    the weight and the acceleration of that particle.
    """
    scene.begin()
    radius, mass = scene.log(5e-4, 2e-3), scene.log(0.01, 50)
    size = scene.flat(10, 30) * radius
    scene.body("cylinder", (size, 0.1), 0, (0, 0, 0), (2**-0.5, 0, 0, 2**-0.5), friction=1.0)
    a, n = 1.01 * size + radius, scene.whole(20, 60)
    angles = np.linspace(np.pi, 0, 30)
    off = (a + radius) / math.cos(min(0.9, 8 * a / n / (2 * a)))
    over = np.c_[off * np.cos(angles), 0 * angles, off * np.sin(angles)]
    line = [[-off, 0, -2.5 * off], *over.tolist(), [off, 0, -2.5 * off]]
    t = scene.world.add_tendon(line, radius, scene.material(mass * G), n)
    hand = t.grip(0)
    hold = t.attach(-1, load(scene, mass, line[-1], size / 3))
    before, forces = [t.velocities], [0.0]

    def compare():
        v, t0 = t.velocities, t._target
        for particle, held in ((0, hand), (-1, hold)):
            x = t.positions
            away = x[1] - x[0] if particle == 0 else x[-2] - x[-1]
            pull = t.tension[particle] * away / np.linalg.norm(away)
            inertia = t0.masses[particle] * (scene.gravity - (v[particle] - before[0][particle]) / scene.dt)
            largest = max(np.abs(t.tension).max(), np.linalg.norm(held.force))
            steady = abs(largest - forces[0]) < 0.002 * largest and np.abs(v).max() * scene.dt < 0.01 * radius
            scene.follow(held, pull + inertia)
            if steady and not scene.world.report.reasons.get("released"):
                scene.near_end("force on a hold [N]", held, 0.01 * largest)
        before[0], forces[0] = v, np.abs(t.tension).max()

    scene.run(scene.steps, watch=compare)


ARM_LINK = """<link name="{name}"><inertial><origin xyz="{half} 0 0"/><mass value="{mass}"/>
<inertia ixx="{small}" iyy="{large}" izz="{large}" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><origin xyz="{half} 0 0"/><geometry><box size="{box} {wide} {wide}"/></geometry></collision></link>
"""
HINGE = """<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>
<origin xyz="{x} 0 0"/><axis xyz="0 1 0"/><limit lower="{low}" upper="{high}" effort="1e4" velocity="100"/>
</joint>
"""
EYELET = """<tunnel name="{name}" link="{link}" radius="{radius}" chamfer="{chamfer}" friction="0">
<start xyz="{start} 0 {z}"/><end xyz="{end} 0 {z}"/></tunnel>
"""
STRING = """<tendon name="{name}" radius="{radius}" particles="{particles}">
<material stiffness="{stiffness}" damping="{damping}"/><point link="{last}" xyz="{x} 0 {z}" attach="true"/>
<point link="base" xyz="{out} 0 {z}"/></tendon>
"""


def links(lengths, masses, wide, low, high):
    """URDF text of a base and links in a row along x, on hinges about y."""
    text, parent, x = '<link name="base"/>\n', "base", 0.0
    for k, (length, mass) in enumerate(zip(lengths, masses, strict=True)):
        large = f"{mass * (length**2 + wide**2) / 12:.6g}"
        numbers = {"half": f"{length / 2:.6g}", "box": f"{0.8 * length:.6g}", "wide": wide, "mass": mass}
        text += ARM_LINK.format(name=f"l{k}", small=f"{mass * wide**2 / 6:.6g}", large=large, **numbers)
        text += HINGE.format(name=f"j{k}", parent=parent, child=f"l{k}", x=x, low=low, high=high)
        parent, x = f"l{k}", length
    return text


def freed(scene, robot, motors=False):
    for k in range(scene.raw.getNumJoints(robot)):
        scene.p.changeDynamics(robot, k, linearDamping=0, angularDamping=0, jointDamping=0)
        if not motors:
            scene.p.setJointMotorControl2(robot, k, scene.raw.VELOCITY_CONTROL, force=0)


@family
def arm(scene):
    """An arm of a URDF whose motors hold it against a tendon: their torques are force times arm."""
    scene.begin()
    count = scene.whole(1, 4)
    lengths = [scene.flat(0.05, 0.3) for _ in range(count)]
    masses = [scene.log(0.05, 5) for _ in range(count)]
    text = f'<robot name="arm">\n{links(lengths, masses, 0.02, -3, 3)}</robot>\n'
    robot = scene.p.loadURDF(
        scene.file("arm.urdf", text), useFixedBase=True, flags=scene.raw.URDF_USE_INERTIA_FROM_FILE
    )
    freed(scene, robot, motors=True)
    scene.energy = False  # motors
    pose = [scene.flat(-0.6, 0.6) for _ in range(count)]
    for k, q in enumerate(pose):
        scene.p.resetJointState(robot, k, q)
        scene.p.setJointMotorControl2(robot, k, scene.raw.POSITION_CONTROL, targetPosition=q, force=1e4)
    tip, axes = scene.place(robot, count - 1)
    end = tip + axes @ (0.8 * lengths[-1], 0, 0.01)
    far = end + scene.flat(0.05, 0.3) * (scene.direction() * (1, 0, 1) + (0, 0, 1.5))
    force = scene.log(0.1, 1000)
    t = straight(scene, [far, end], scene.material(force), scene.whole(2, 40))
    hold = t.attach(-1, robot, count - 1)
    pull = force * (far - end) / np.linalg.norm(far - end)
    t.set_force(0, pull)
    scene.run(scene.steps - 20)
    before = joints(scene, robot)[:, 0]
    scene.run(20)
    motors = joints(scene, robot)
    if np.abs(motors[:, 0] - before).max() > 20e-5:  # it is not at rest
        return
    # At the same time steps pybullet's motors answer a force given by hand: only that is theirs to tell.
    where, force = [rounded(v.tolist()) for v in (hold.position, hold.force)]
    place = (
        f"p.multiplyTransforms(*p.getLinkState({robot.text}, {count - 1})[4:6], {where!r}, [0, 0, 0, 1])[0]"
    )
    push = f"p.applyExternalForce({robot.text}, {count - 1}, {force!r}, {place}, p.WORLD_FRAME)"
    scene.code("for k in range(20):\n    " + push + "\n    p.stepSimulation()")
    by_hand = joints(scene, robot)
    scene.near("hinges under the tendon [rad]", motors[:, 0], by_hand[:, 0], absolute=1e-4 + 20 * 2e-5)
    largest = np.abs(by_hand[:, 2]).max()
    scene.near("torques of the motors [N m]", motors[:, 2], by_hand[:, 2], absolute=0.02 * largest)


def joints(scene, robot):
    """Angle, rate and motor torque of each joint."""
    states = [scene.raw.getJointState(robot, k) for k in range(scene.raw.getNumJoints(robot))]
    return np.array([[s[0], s[1], s[3]] for s in states])


def in_its_stops(scene, robot, low, high):
    """pybullet's stops give way by less than this under what pulls here."""
    angles = [scene.raw.getJointState(robot, k)[0] for k in range(scene.raw.getNumJoints(robot))]
    scene.check(low - 0.1 <= min(angles) and max(angles) <= high + 0.1, f"hinges at {np.round(angles, 3)}")


def pulled(scene, robot, names, most, low, high):
    """Random pulls along the free ends, changed a few times."""
    scene.energy = False  # the forces turn with the ends
    for _ in range(scene.whole(1, 4)):
        lines = []
        for name in names:
            k = [t.name for t in scene.world.tendons].index(name)
            lines += [
                f"t = world.tendons[{k}]",
                "e = t.positions[-1] - t.positions[-2]",
                f"t.set_force(-1, e / np.linalg.norm(e) * {scene.flat(0, most)})",
            ]
        scene.run(scene.steps // 4, *lines, watch=lambda: in_its_stops(scene, robot, low, high))


@family
def tendon_finger(scene):
    """The package's own finger, motors off, pulled at both tendons by up to 6 N, stays in its stops."""
    scene.begin(gravity=scene.coin())
    path = File(bt.data_path("tendon_finger.urdf"))
    path.text = 'bt.data_path("tendon_finger.urdf")'
    robot = scene.world.load_urdf(
        path,
        useFixedBase=True,
        flags=scene.raw.URDF_USE_INERTIA_FROM_FILE,
        obstacles=False,
    )
    freed(scene, robot)
    most = scene.pick(0.6, 6.0)
    pulled(scene, robot, ("flexor", "extensor"), most, -0.1, 1.2)


@family
def finger_from_urdf(scene):
    """A finger of one to three links with random eyelets, pulled by two tendons against its stops."""
    scene.begin(gravity=scene.coin())
    count, radius = scene.whole(1, 3), scene.log(4e-4, 1e-3)
    lengths = [scene.flat(0.02, 0.06) for _ in range(count)]
    masses = [scene.log(3e-3, 0.2) for _ in range(count)]
    low, high, bore = -0.1, scene.flat(1.0, 1.7), round(scene.flat(1.3, 2) * radius, 7)
    z, chamfer = scene.flat(0.004, 0.008), round(radius, 7)
    # Eyelets begin 5 mm from a hinge: bent further, the rims of two mouths would pass through each other.
    high = round(min(high, 1.9 * np.arctan(0.005 / (z + bore + chamfer))), 4)
    text = links(lengths, masses, 0.006, low, high)
    for name, side in (("flexor", -z), ("extensor", z)):
        text += EYELET.format(
            name=f"{name} base", link="base", radius=bore, chamfer=chamfer, start=-0.02, end=-0.005, z=side
        )
        for k, length in enumerate(lengths):
            end = length - 0.006 if k < count - 1 else 0.6 * length
            text += EYELET.format(
                name=f"{name} {k}",
                link=f"l{k}",
                radius=bore,
                chamfer=chamfer,
                start=0.005,
                end=round(end, 6),
                z=side,
            )
        law = {"stiffness": scene.log(2e3, 5e4), "damping": scene.log(0.1, 5)}
        text += STRING.format(
            name=name,
            radius=radius,
            particles=60,
            last=f"l{count - 1}",
            x=round(0.8 * lengths[-1], 6),
            out=-0.06,
            z=side,
            **law,
        )
    path = scene.file("finger.urdf", f'<robot name="finger">\n{text}</robot>\n')
    robot = scene.world.load_urdf(
        path, useFixedBase=True, flags=scene.raw.URDF_USE_INERTIA_FROM_FILE, obstacles=False
    )
    freed(scene, robot)
    pulled(scene, robot, ("flexor", "extensor"), scene.log(0.1, 20), low, high)


@family
def reeling_in(scene):
    """A load is reeled in: it rises by the length that was taken, less the change of stretch."""
    scene.begin()
    mass, length, n = scene.log(1e-3, 50), scene.flat(0.1, 0.4), scene.whole(10, 60)
    material = scene.material(mass * G)
    t = straight(scene, [(0, 0, 0), (0, 0, -length)], material, n)
    t.grip(0)
    body = load(scene, mass, (0, 0, -length))
    t.attach(-1, body)
    scene.energy = False  # the reel's work
    # The end segment is paid out to four times its length at most.
    taken = scene.pick(scene.flat(0.1, 0.5) * length, -scene.flat(0.1, 0.9) * 3 * length / (n - 1))
    part = round(taken / scene.steps, 9)
    scene.run(scene.steps, f"{t._name}.shorten({part!r}, end=0)")
    rest = length - part * scene.steps
    scene.near("rest length [m]", t.rest_length, rest, rel=1e-9)
    if t.tension.min() > 0.01 * mass * G:
        # Straight between its ends, but for what its own inertia bends. A load that flies leaves it slack,
        # under the few millinewtons that this inertia takes.
        apart = np.linalg.norm(t.positions[0] - t.positions[-1])
        scene.near("length [m]", t.length, apart, rel=1e-3)
    deepest = t.rest_length * (1 + 3 * stretched(material, 3 * mass * G)) + abs(part)
    scene.check(
        -scene.place(body)[0][2] <= 1.1 * deepest + 1e-3, f"the load is at {scene.place(body)[0][2]:.4g} m"
    )


def jointed(scene, kind, masses, shape, places, axes):
    """A fixed base with links of one shape on joints without damping."""
    count = len(masses)
    body = scene.p.createMultiBody(
        linkMasses=masses,
        linkCollisionShapeIndices=[shape] * count,
        linkVisualShapeIndices=[-1] * count,
        linkPositions=places,
        linkOrientations=[[0, 0, 0, 1]] * count,
        linkInertialFramePositions=[[0, 0, 0]] * count,
        linkInertialFrameOrientations=[[0, 0, 0, 1]] * count,
        linkParentIndices=[0] * count,
        linkJointTypes=[kind] * count,
        linkJointAxis=axes,
    )
    for k in range(count):
        scene.p.changeDynamics(body, k, linearDamping=0, angularDamping=0, jointDamping=0)
    return body


@family
def gripped(scene):
    """Jaws that motors close on a cord press it with the force of the motors, and stop there."""
    scene.begin(gravity=False)
    force, radius, n = scene.log(0.5, 500), scene.log(5e-4, 3e-3), scene.whole(15, 50)
    speed = 2 * radius / (scene.whole(10, scene.steps // 3) * scene.dt)
    # What a motor gives a jaw in a step: pybullet lets no force resist more than 100 m/s.
    mass = rounded(min(100.0, max(1e-3, force * scene.dt / scene.log(0.3 * speed, 50))))
    kind, edge = scene.raw.JOINT_PRISMATIC, 10 * radius
    shape = scene.shape("box", (2 * edge, edge, 2 * edge))
    off, jaws = edge / 2 + 3 * radius, scene.pick((-1, 1), (-1,))
    places, axes = [[0, side * off, 0] for side in jaws], [[0, -side, 0] for side in jaws]
    body = jointed(scene, kind, [mass] * len(jaws), shape, places, axes)
    scene.world.add_obstacle(body, friction=1.0)
    if len(jaws) == 1:
        anvil = scene.p.createMultiBody(0, shape, -1, [0, edge / 2 + radius, 0])
        scene.world.add_obstacle(anvil, friction=1.0)
    length, pull = 6 * edge, scene.log(1e-3, 100)
    material = scene.material(pull, friction=scene.flat(0.05, 0.8))
    slack = length / (1 + stretched(material, pull))
    cord = scene.world.add_tendon(
        [[-length / 2, 0, 0], [length / 2, 0, 0]], radius, material, n, rest_length=slack
    )
    for end in (0, -1):
        cord.grip(end)
    scene.energy = False  # the motors' work
    for k in range(len(jaws)):
        if scene.coin():
            goal = {"controlMode": scene.raw.VELOCITY_CONTROL, "targetVelocity": speed}
        else:
            goal = {"controlMode": scene.raw.POSITION_CONTROL, "targetPosition": 3 * radius}
            goal |= {"maxVelocity": speed}
        scene.p.setJointMotorControl2(body, k, force=force, **goal)
    fastest = 0.0

    def watch():
        nonlocal fastest
        rates = [scene.raw.getJointState(body, k)[1] for k in range(len(jaws))]
        fastest = max(fastest, *np.abs(rates))

    scene.run(scene.steps, watch=watch)
    # A jaw goes into the cord before its motor is known, and comes out by half a radius in a step at most.
    most = 1.1 * speed + radius / scene.dt
    scene.check(fastest <= most, f"a jaw moves at {fastest:.4g} m/s (at most {most:.4g})")
    # Nothing holds a cord that lies loosely between two jaws to the middle.
    ways = sum(scene.raw.getJointState(body, k)[0] for k in range(len(jaws)))
    scene.near("way of the jaws [m]", ways, 2 * radius * len(jaws), absolute=0.01 * radius * len(jaws))
    # Two may swing together on the cord: what one of them gives to it, the other one lacks.
    given = np.mean([abs(scene.world.wrench(body, k)[1]) for k in range(len(jaws))])
    scene.near("mean force of the jaws [N]", given, force, rel=0.02)


@family
def torque_controlled(scene):
    """Cords through the bores of a block draw it along its slider, against a spring that the user computes.

    The spring is explicit: alone, it is stable up to a stiffness of 4 m/dt^2. Where the tendons are not told
    of its force, they learn it a step late.
    """
    scene.begin(gravity=False)
    cords, pull, radius = scene.whole(1, 3), scene.log(1, 200), scene.flat(5e-4, 1.5e-3)
    stiffness = rounded(2 * cords * pull / scene.flat(2, 8) / radius)
    told = scene.coin()
    mass = rounded(stiffness * scene.dt**2 / scene.log(0.02, 0.4 if told else 0.1))
    damping = rounded(2 * scene.flat(0.2, 0.7) * math.sqrt(stiffness * mass))
    thick, bore, mu = (
        scene.flat(6, 12) * radius,
        scene.flat(1.2, 2.5) * radius,
        scene.pick(0.0, scene.flat(0, 0.3)),
    )
    edges = (40 * radius, 20 * cords * radius, thick)
    kind = scene.raw.JOINT_PRISMATIC
    block = jointed(scene, kind, [mass], scene.shape("box", edges), [[0, 0, 0]], [[1, 0, 0]])
    scene.p.setJointMotorControl2(block, 0, scene.raw.VELOCITY_CONTROL, force=0)
    scene.obstacle(block, 0, "box", edges, 1.0)
    scene.energy, ends, hands = False, [], []
    near, far, beside = -15 * radius, -55 * radius, thick / 2 + 3 * radius
    for k in range(cords):
        y = (k - (cords - 1) / 2) * 20 * radius
        mouths = [near, y, -thick / 2], [near, y, thick / 2]
        scene.world.add_tunnel(block, 0, *mouths, bore, friction=1.0)
        line = [[far, y, -beside], [near, y, -beside], [near, y, beside], [far, y, beside]]
        cord = scene.world.add_tendon(line, radius, scene.material(pull, friction=mu), scene.whole(40, 60))
        hands.append(cord.grip(0))
        ends.append(cord)
    lines = [
        f"x, v = p.getJointState({block.text}, 0)[:2]",
        f"f = -{stiffness!r} * x - {damping!r} * v",
        f"world.apply_joint_force({block.text}, 0, f)"
        if told
        else f"p.setJointMotorControl2({block.text}, 0, p.TORQUE_CONTROL, force=f)",
    ]
    for share in (0.25, 0.5, 0.75, 1.0):
        for cord in ends:
            cord.set_force(-1, (-rounded(share * pull), 0, 0))
        scene.run(scene.steps // 6, *lines)
    given, drawn, rates, momenta = [], [], [], []

    def watch():
        given.append(scene.space["f"])
        drawn.append(sum(hand.force[0] + pull for hand in hands))
        rates.append(scene.raw.getJointState(int(block), 0)[1])
        momenta.append(sum((cord.masses[:, None] * np.abs(cord.velocities)).sum() for cord in ends))

    scene.run(scene.steps // 3, *lines, watch=watch)
    last, time = slice(-16, None), 16 * scene.dt
    right = np.mean(drawn[last]) + mass * (rates[-1] - rates[-17]) / time
    absolute = 2 * max(momenta) / time  # the cords' own
    scene.near("force of the spring [N]", np.mean(given[last]), right, rel=0.005, absolute=absolute)
    scene.in_clearance()


@family
def stalled(scene):
    """A lever that a motor turns against a tendon comes to rest where the tension's torque is the motor's."""
    scene.begin(gravity=False)
    torque, arm, length, n = (
        scene.log(0.01, 100),
        scene.log(0.03, 0.4),
        scene.flat(0.1, 0.4),
        scene.whole(2, 40),
    )
    speed = scene.log(0.01, 0.05) / scene.dt
    inertia = torque * scene.dt / scene.log(0.3 * speed, 50)  # as in `gripped`
    half = 0.3 * arm
    mass = rounded(inertia / (2 / 3 * half**2))  # a cube
    shape = scene.shape("box", (2 * half, 2 * half, 2 * half))
    body = jointed(scene, scene.raw.JOINT_REVOLUTE, [mass], shape, [[0, 0, 0]], [[0, -1, 0]])
    # It stretches by a tenth of the arm at most.
    stiffness = scene.log(10 * torque / arm * max(1, length / arm), 1e4 * torque / arm)
    material = bt.Material(stiffness=rounded(stiffness), damping=rounded(stiffness * scene.log(1e-4, 3e-3)))
    t = straight(scene, [(length, 0, arm), (0, 0, arm)], material, n)
    t.grip(0)
    t.attach(-1, body, 0, [0, 0, arm])
    scene.energy = False  # the motor's work
    scene.p.setJointMotorControl2(body, 0, scene.raw.VELOCITY_CONTROL, targetVelocity=speed, force=torque)
    torques = []

    def watch():
        way = t.positions[-2] - t.positions[-1]
        lever = abs(np.cross(t.positions[-1], way / np.linalg.norm(way))[1])
        torques.append(t.tension[-1] * lever)

    scene.run(scene.steps, watch=watch)
    # A light lever goes to and fro by a step's way at its speed.
    scene.near("torque of the tension [N m]", np.mean(torques[-10:]), torque, rel=0.01)


def join(scene, a, b, kind, at_a, at_b, turn_b=(0, 0, 0, 1)):
    """A constraint of free bodies, at points of their frames."""
    scene.p.setCollisionFilterPair(a, b, -1, -1, 0)
    number = scene.p.createConstraint(a, -1, b, -1, kind, [0, 0, 1], at_a, at_b, [0, 0, 0, 1], turn_b)
    meant = [group for group in scene.joined if group & {int(a), int(b)}]
    scene.joined = [group for group in scene.joined if group not in meant]
    scene.joined.append(set().union({int(a), int(b)}, *meant))
    return number


@family
def joined_bodies(scene):
    """Bodies that constraints join swing on one or two cords; one more is taken up, and the last one let go.

    Constraints that are made while bodies move only take energy.
    """
    scene.begin()
    kind = scene.pick(scene.raw.JOINT_POINT2POINT, scene.raw.JOINT_FIXED)
    masses = [scene.log(0.01, 2) for _ in range(scene.whole(2, 4))]
    length, bodies, numbers = scene.flat(0.1, 0.5), [], []
    for k, mass in enumerate(masses):
        bodies.append(load(scene, mass, (scene.flat(-0.2, 0.2) * SIZE, 0, -length - 2 * SIZE * k)))
        if k:
            middle = 0.5 * (scene.place(bodies[k])[0] + scene.place(bodies[k - 1])[0])
            at = [(middle - scene.place(bodies[i])[0]).tolist() for i in (k - 1, k)]
            numbers.append(join(scene, bodies[k - 1], bodies[k], kind, *at))
    for k in sorted({0, scene.pick(0, len(bodies) - 1)}):
        at = scene.place(bodies[k])[0]
        t = straight(
            scene,
            [(0.3 * length * bool(k), 0, 0), at],
            scene.material(3 * G * sum(masses)),
            scene.whole(2, 30),
        )
        t.grip(0)
        t.attach(-1, bodies[k])
    speed = scene.log(0.1, 3)
    scene.p.resetBaseVelocity(bodies[-1], [speed, 0, 0], [0, 0, 0])
    scene.run(scene.steps // 2)
    if scene.coin():
        place, turn = scene.raw.getBasePositionAndOrientation(bodies[-1])
        beside = np.add(place, [4 * SIZE, 0, 0]).tolist()
        more = load(scene, scene.log(0.01, 2), beside)
        scene.energy = False  # it begins at rest, in another's motion
        back = scene.raw.invertTransform(place, turn)
        at, _ = scene.raw.multiplyTransforms(*back, beside, [0, 0, 0, 1])
        fixed = scene.raw.JOINT_FIXED
        join(scene, bodies[-1], more, fixed, list(at), [0, 0, 0], list(turn))
    elif numbers and scene.coin():
        scene.p.removeConstraint(numbers[-1])
        scene.joined = [group - {int(bodies[-1])} for group in scene.joined]
    scene.run(scene.steps - scene.steps // 2)


def keeps_still(scene, body, weight, at):
    """Whether pybullet by itself holds a body, with a weight [N] at a point of its frame."""
    raw, fastest = scene.raw, 0.0
    state = raw.saveState()
    for _ in range(scene.steps):
        place = raw.getBasePositionAndOrientation(body)
        point = raw.multiplyTransforms(*place, at, (0, 0, 0, 1))[0]
        raw.applyExternalForce(body, -1, (0, 0, -weight), point, raw.WORLD_FRAME)
        raw.stepSimulation()
        velocity, spin = raw.getBaseVelocity(body)
        fastest = max(fastest, np.linalg.norm(velocity) + np.linalg.norm(at) * np.linalg.norm(spin))
    raw.restoreState(state)
    raw.removeState(state)
    return fastest < 0.01  # m/s: it creeps in most, and slips at once in some


@family
def shackle(scene):
    """A load hangs from a light shackle, and the shackle from a rope that runs through its eye."""
    scene.begin()
    radius, mass, weight = scene.log(5e-4, 3e-3), scene.log(0.005, 1), scene.log(0.05, 50)
    bore, size = scene.flat(1.3, 2.5) * radius, scene.flat(8, 20) * radius
    mu, force = scene.pick(0.0, scene.flat(0.05, 0.6)), G * (mass + weight)
    wide, down = scene.flat(5, 10) * size, scene.flat(3, 10) * size
    eye = scene.body("box", (size, size / 2, size), mass, friction=scene.pick(None, 1.0))
    ends = [[-0.5 * size, 0, 0.3 * size], [0.5 * size, 0, 0.3 * size]]
    scene.world.add_tunnel(eye, -1, *ends, bore, friction=1.0, chamfer=scene.pick(0.0, 0.5 * radius))
    out = 0.5 * size + 0.1 * wide  # more than a segment beside the mouths
    line = [[-wide, 0, down], [-out, 0, 0.3 * size], [out, 0, 0.3 * size], [wide, 0, down]]
    rope = scene.world.add_tendon(line, radius, scene.material(force, friction=mu), scene.whole(40, 60))
    held, hand = rope.grip(0), rope.grip(-1)
    hook = (0, 0, -size / 2)
    cord = straight(scene, (hook, (0, 0, -3 * size)), scene.material(G * weight), scene.whole(2, 20))
    cord.attach(0, eye, position=hook)
    cord.attach(-1, scene.body("sphere", (size / 4,), weight, (0, 0, -3 * size)))
    scene.lead(hand, (0, 0, scene.flat(0, 0.5) * down), scene.steps // 3)
    settle(scene)
    own = G * sum(float(t._target.masses.sum()) for t in (rope, cord))
    moving = sum(scene.mass(b) * np.linalg.norm(scene.speed(b)) for b in scene.free) / scene.dt
    given = -held.force[2] - hand.force[2]
    scene.near("force on both hands [N]", given, force + own, rel=0.01, absolute=moving + scene.inertia(rope))
    scene.in_clearance()
    scene.capstan_range(rope, mu, scene.restless(rope) + moving, edges=True)


@family
def bead(scene):
    """A bead on a cord between two hands that come together: it slides to the lowest place and stays."""
    scene.begin()
    size = scene.log(0.005, 0.05)
    radius = size / scene.flat(6, 12)
    span, slack = scene.flat(60, 200) * radius, scene.flat(0.1, 0.5)
    mu, mass = scene.pick(0.0, scene.flat(0.05, 0.4)), rounded(scene.log(300, 8000) * size**3)
    line = [[-span / 2, 0, 0], [span / 2, 0, 0]]
    cord = scene.world.add_tendon(line, radius, scene.material(G * mass, friction=mu), scene.whole(20, 60))
    held, hand = cord.grip(0), cord.grip(-1)
    kind = scene.pick("sphere", "cylinder", "box")
    sizes = {"sphere": (size / 2,), "cylinder": (size / 2, size), "box": (size, size, size)}[kind]
    body = scene.body(kind, sizes, mass, (scene.flat(-0.2, 0.2) * span, 0, 0), friction=mu)
    bore = scene.flat(1.3, 2.5) * radius
    tunnel = scene.world.add_tunnel(body, -1, (-size / 2, 0, 0), (size / 2, 0, 0), bore, friction=mu)
    scene.lead(hand, (-slack * span, 0, 0), scene.steps // 3)
    settle(scene)
    scene.passes(cord, tunnel._target)
    given = -held.force[2] - hand.force[2]
    moving = mass * np.linalg.norm(scene.speed(body)) / scene.dt
    weight = G * (mass + float(cord._target.masses.sum()))
    scene.near("force on both hands [N]", given, weight, rel=0.01, absolute=moving + scene.inertia(cord))


@family
def held_in_jaws(scene):
    """Jaws that motors press on a box hold it, and a load that hangs from the box by a cord."""
    scene.begin()
    mass, size = scene.log(0.01, 2), scene.log(0.01, 0.05)
    load = rounded(mass * scene.log(0.1, 10))
    force = rounded(scene.flat(4, 20) * G * (mass + load) / 2)  # of a jaw; the coefficient of friction is one
    shape = scene.shape("box", (size, 0.2 * size, size))
    jaw = rounded(mass * scene.log(0.3, 3))  # pybullet itself does not hold a box that is much lighter
    places, axes = [[0, side * 0.6 * size, 0] for side in (-1, 1)], [[0, -side, 0] for side in (-1, 1)]
    jaws = jointed(scene, scene.raw.JOINT_PRISMATIC, [jaw] * 2, shape, places, axes)
    box = scene.body("box", (size, size, size), mass)
    for body, link in ((jaws, 0), (jaws, 1), (box, -1)):
        scene.p.changeDynamics(body, link, lateralFriction=1.0)
    for k in range(2):
        if scene.coin():
            goal = {"controlMode": scene.raw.VELOCITY_CONTROL, "targetVelocity": 0.1 * size / scene.dt}
        else:
            goal = {"controlMode": scene.raw.POSITION_CONTROL, "targetPosition": size}
        scene.p.setJointMotorControl2(jaws, k, force=force, **goal)
    for _ in range(30):
        scene.p.stepSimulation()
    if not keeps_still(scene, box, G * load, (0, 0, -size / 2)):
        return  # pybullet itself does not hold it
    scene.energy = False  # the motors' work
    start = scene.place(box)[0][2]
    hook, end = (0, 0, start - size / 2), (0, 0, start - size / 2 - scene.flat(0.1, 0.4))
    material = scene.material(G * load, damping=rounded(G * load * scene.log(0.3, 3)))
    cord = straight(scene, (hook, end), material, scene.whole(2, 20), 1e-3)
    cord.attach(0, box)
    cord.attach(-1, scene.body("sphere", (0.02,), load, end))
    given = []
    scene.run(scene.steps, watch=lambda: given.append(cord.tension[0]))
    # What hangs from a spring, and is let go, pulls it by (1 + n) times its weight at most, with f ~ s^n.
    weight = G * (load + cord._target.masses.sum())
    most = 1.05 * (1 + material.exponent) * weight
    scene.check(max(given) <= most, f"the cord is pulled by {max(given):.4g} N (at most {most:.4g})")
    fallen = start - scene.place(box)[0][2]
    scene.check(fallen < 0.1 * size, f"the box slips by {fallen:.4g} m")


def lifting(scene, momenta):
    """The mean force that gives bodies the change of their momenta in the second half of the steps [N]."""
    half = len(momenta) // 2
    return (momenta[-1] - momenta[half - 1]) / (scene.dt * (len(momenta) - half))


JOINTED_BOX = """<link name="{name}"><inertial><origin xyz="0 0 {z:.6g}"/><mass value="{mass:.6g}"/>
<inertia ixx="{i:.6g}" iyy="{i:.6g}" izz="{i:.6g}"/></inertial><collision><origin xyz="0 0 {z:.6g}"/>
<geometry><box size="{size}"/></geometry></collision></link>
"""
BOX_JOINT = """<joint name="{child} joint" type="{kind}"><parent link="{parent}"/><child link="{child}"/>
<origin xyz="{x:.6g} 0 {z:.6g}"/><axis xyz="{axis}"/>
<limit lower="{low}" upper="{high}" effort="1e4" velocity="100"/></joint>
"""


def jointed_box(name, mass, size, z, parent, x, at, axis, kind="revolute", low=-0.1, high=1.5):
    """URDF text of a box around z below a joint, which is at (x, 0, at) of the parent."""
    inertia = mass * max(size) ** 2 / 12
    sizes = " ".join(f"{side:.6g}" for side in size)
    joint = {"parent": parent, "x": x, "z": at, "axis": axis, "kind": kind, "low": low, "high": high}
    return JOINTED_BOX.format(name=name, mass=mass, i=inertia, z=z, size=sizes) + BOX_JOINT.format(
        child=name, **joint
    )


def lifts(scene, hand, box, torque, lift):
    """Whether pybullet by itself closes the fingers, by a torque on each hinge [N m], and lifts the box."""
    raw = scene.raw
    state, before = raw.saveState(), raw.getBasePositionAndOrientation(box)[0][2]
    for k in range(scene.steps):
        if k >= scene.steps // 3:
            lift(raw, k - scene.steps // 3)
        for joint in range(1, 5):
            raw.setJointMotorControl2(hand, joint, raw.TORQUE_CONTROL, force=torque)
        raw.stepSimulation()
    end = raw.getBasePositionAndOrientation(box)[0][2]
    way = raw.getJointState(hand, 0)[0]
    raw.restoreState(state)
    raw.removeState(state)
    lift(raw, 0)
    return way - (end - before) < 0.2 * way


@family
def gripper(scene):
    """A hand on a rail closes two fingers on a box by tendons, and lifts it, where torques on hinges do."""
    scene.begin()
    size, mass = scene.log(0.01, 0.06), scene.log(0.01, 2)  # half of the box's width
    length, arm = scene.flat(1.5, 1.8) * size, 0.33 * size
    pull = rounded(scene.log(3, 30) * 2 * length / arm * mass * G / 2)  # the coefficient of friction is one
    high = 2 * length + 1.33 * size  # of the hand
    text = '<link name="base"/>\n'
    wide, thick = (4 * size, 1.3 * size, 0.6 * size), (0.4 * size, size, 0.95 * length)
    rail = {"kind": "prismatic", "low": -1, "high": 1}
    text += jointed_box("hand", mass * scene.log(1, 10), wide, 0, "base", 0, high, "0 0 1", **rail)
    for side in (1, -1):
        parent, x, z = "hand", 1.83 * size * side, -0.4 * size
        for k in range(2):
            own, name = mass * scene.log(0.03, 0.5), f"{side} {k}"
            limit = scene.flat(0.3, 0.6) if k else 1.5
            text += jointed_box(
                name, own, thick, -length / 2, parent, x, z, f"0 {side} 0", high=round(limit, 3)
            )
            parent, x, z = name, 0, -length
    path = scene.file("gripper.urdf", f'<robot name="gripper">\n{text}</robot>\n')
    hand = scene.p.loadURDF(path, useFixedBase=True, flags=scene.raw.URDF_USE_INERTIA_FROM_FILE)
    freed(scene, hand)
    scene.body("box", (20 * size, 20 * size, 2 * size), 0, (0, 0, -size))
    box = scene.body("box", (2 * size, 1.3 * size, 2 * size), mass, (scene.flat(-0.1, 0.1) * size, 0, size))
    for body, link in [(hand, k) for k in range(5)] + [(box, -1)]:
        scene.p.changeDynamics(body, link, lateralFriction=1.0)
    way = size / scene.steps

    def lift(world, step):
        goal = rounded(way * step)
        world.setJointMotorControl2(hand, 0, world.POSITION_CONTROL, targetPosition=goal, force=1e4)

    lift(scene.p, 0)
    if not lifts(scene, hand, box, pull * arm, lift):
        return  # pybullet itself does not
    scene.energy = False  # the motor's work
    radius, material = 0.026 * size, scene.material(pull)
    for side, first in ((1, 1), (-1, 3)):
        x = (1.83 * size - arm) * side
        scene.world.add_tunnel(hand, 0, (x, 0, 0.4 * size), (x, 0, -0.4 * size), 2 * radius)
        ends = (-arm * side, 0, -0.25 * length), (-arm * side, 0, -0.75 * length)
        scene.world.add_tunnel(hand, first, *ends, 2 * radius)
        line = (x, 0, high + 2 * size), (x, 0, high - 0.4 * size - 1.8 * length)
        t = straight(scene, line, material, scene.whole(20, 60), radius)
        t.attach(-1, hand, first + 1)
        t.set_force(0, (0, 0, pull))
    start = scene.place(box)[0][2]
    scene.run(scene.steps // 3)
    for step in range(0, 2 * scene.steps // 3, 10):
        lift(scene.p, step)
        scene.run(10)
        in_its_stops(scene, hand, -0.1, 1.5)
    # Equal pulls let both fingers swing to one side together, and the box with them, by a part of its size.
    slipped = scene.raw.getJointState(hand, 0)[0] - (scene.place(box)[0][2] - start)
    scene.check(slipped < 0.5 * size, f"the box slips by {slipped:.4g} m")


@family
def loaded_tray(scene):
    """A tray on four cords, with boxes that stand on it or drop onto it: the cords carry all of them.

    At steps of more than 1/100 s pybullet lets boxes sink deep into a light tray that they strike.
    """
    scene.begin(scene.log(1 / 1000, 1 / 100))
    mass, wide, length = scene.log(0.02, 2), 0.2, scene.flat(0.2, 0.5)
    loads = [scene.log(0.02, 2) for _ in range(scene.whole(1, 3))]
    weight = G * (mass + sum(loads))
    scene.energy = False  # pybullet pushes bodies apart that touch
    tray = scene.body("box", (wide, wide, 0.01), mass, (0, 0, -length))
    material = scene.material(weight, damping=rounded(weight * scene.log(1, 10)))
    spread, cords = scene.flat(1.0, 1.3), []
    for x in (-0.45 * wide, 0.45 * wide):
        for y in (-0.45 * wide, 0.45 * wide):
            ends = (spread * x, spread * y, 0), (x, y, 0.005 - length)
            cords.append(straight(scene, ends, material, scene.whole(2, 12), 1e-3))
            cords[-1].grip(0)
            cords[-1].attach(-1, tray)
    drop, boxes = scene.pick(0.0, scene.log(1e-3, 0.02)), []
    for k, load_mass in enumerate(loads):
        at = (scene.flat(-0.02, 0.02), 0.06 * (k - (len(loads) - 1) / 2), 0.025 - length + drop)
        boxes.append(scene.body("box", (0.04, 0.04, 0.04), load_mass, at))
    scene.joined = [{int(body) for body in (tray, *boxes)}]
    given, heights, momenta = [], [], []

    def watch():
        momenta.append(sum(scene.speed(body)[2] * scene.mass(body) for body in (tray, *boxes)))
        up = [(cord.positions[0] - cord.positions[1])[2] for cord in cords]
        slopes = np.array(up) / [np.linalg.norm(cord.positions[0] - cord.positions[1]) for cord in cords]
        given.append(sum(cord.tension[0] * slope for cord, slope in zip(cords, slopes, strict=True)))
        heights.append(min(scene.place(box)[0][2] for box in boxes) - scene.place(tray)[0][2])

    scene.run(scene.steps, watch=watch)
    scene.check(min(heights) > 0.015, f"a box is {min(heights):.4g} m above the middle of the tray")
    carried = np.mean(given[scene.steps // 2 :])
    lifted = lifting(scene, momenta)
    own = sum(cord._target.masses.sum() for cord in cords) * G
    scene.near("what the cords carry [N]", carried, weight + lifted, rel=0.02, absolute=own)


def bar(scene, kind, half, length, mass, at, turn, friction):
    """An obstacle along its z axis; half: of its width [m]. "hull" and "faces" are boxes of triangles."""
    box = (2 * half, 2 * half, length)
    if kind in ("cylinder", "capsule", "box"):
        return scene.body(kind, box if kind == "box" else (half, length), mass, at, turn, friction)
    if kind == "prism":
        sides = scene.pick(6, 12, 32)
        angles = 2 * np.pi * (np.arange(sides) + 0.5) / sides
        ends = (-length / 2, length / 2)
        corners = [(half * np.cos(a), half * np.sin(a), z) for z in ends for a in angles]
        inner = "cylinder", (half * np.cos(np.pi / sides), length)  # what is in a facet's rise is not judged
    else:
        corners, faces = cube(1)
        corners, inner = corners * [half, half, length / 2], ("box", box)
    shape = scene.p.createCollisionShape(scene.raw.GEOM_MESH, vertices=corners)
    body = scene.body_of(shape, mass, at, turn)
    triangles = {"convex": False, "meshes": [(corners, faces)]} if kind == "faces" else {}
    scene.world.add_obstacle(body, friction=friction, **triangles)
    scene.solids.append((body, -1, *inner))
    return body


@family
def laid_along_cords(scene):
    """A bar that is laid, or dropped, on two taut cords along it, or across them, stays on them."""
    scene.begin()
    half = scene.log(0.003, 0.03)
    length, span = scene.flat(3, 10) * half, scene.flat(15, 30) * half
    apart, radius = scene.flat(1.0, 1.3) * half, scene.flat(0.03, 0.2) * half
    mass, drop = scene.log(200, 8000) * half**2 * length, scene.pick(1e-3, scene.log(1e-3, 0.5)) * half
    kind = scene.pick("box", "hull", "faces", "cylinder", "capsule", "prism")
    # Taut enough for the bar not to tilt on the cords, nor to spread them.
    force = min(G * mass * scene.flat(10, 50) * half * span / apart**2, 2000.0)
    friction, damping = scene.flat(0.1, 1.0), rounded(force * scene.log(0.3, 3))
    material = scene.material(force, friction=friction, damping=damping)
    rest = rounded(1 / (1 + stretched(material, force)))
    lean, particles, holds = scene.pick(0.0, scene.log(1e-9, 0.01)), scene.whole(2, 30), []
    for side in (-1, 1):
        along = span / 2 * np.array([np.cos(lean), side * np.sin(lean), 0])
        line = [[0, side * apart / 2, 0] - along, [0, side * apart / 2, 0] + along]
        cord = scene.world.add_tendon(line, radius, material, particles, rest_length=rest * span)
        holds += [cord.grip(0), cord.grip(-1)]
    if kind in ("box", "hull", "faces"):
        yaw, height = scene.pick(0.0, scene.log(1e-6, 0.3), np.pi / 2), half + radius
    else:  # in the groove of the cords, which it must not cross: on two points it would topple
        yaw = scene.pick(0.0, scene.log(1e-6, 0.3) * apart / length)
        height = math.sqrt((half + radius) ** 2 - (apart / 2 - (yaw + lean) * length) ** 2)
    x = scene.flat(-0.1, 0.1) * span
    turned = np.array([math.cos(yaw / 2), math.sin(yaw / 2)]) * math.sqrt(0.5)
    turn = [-turned[1], turned[0], turned[1], turned[0]]  # its axis along x, then by yaw about z
    body = bar(scene, kind, half, length, mass, (x, 0, height + drop), turn, scene.flat(0.1, 1.0))
    given, momenta = [], []

    def watch():
        given.append(-sum(hold.force[2] for hold in holds))
        momenta.append(mass * scene.speed(body)[2])
        place = scene.place(body)[0]
        scene.check(place[2] > 0.3 * half, f"the bar is at {place[2]:.4g} m, between or below the cords")
        aside = np.hypot(place[0] - x, place[1])
        scene.check(aside < 0.5 * half + drop, f"the bar has moved aside by {aside:.4g} m")

    scene.run(scene.steps, watch=watch)
    weight = G * (mass + sum(t.masses.sum() for t in scene.tendons))
    carried = np.mean(given[scene.steps // 2 :])
    scene.near("what the hands carry [N]", carried, weight + lifting(scene, momenta), rel=0.02)


@family
def gripped_cord(scene):
    """Jaws that motors close on a hanging cord press it with their force, and hold what hangs from it.

    Beyond 100 m/s in a step pybullet cuts off what stops a jaw, before its motor acts.
    """
    scene.begin()
    scene.energy = False  # the motors' work
    load, radius, length = scene.log(0.01, 2), scene.log(5e-4, 3e-3), 0.3
    damping = rounded(G * load * scene.log(0.3, 3))
    # One that can push is a strut where the hand comes down, and pushes the jaws aside.
    material = scene.material(G * load, friction=1.0, damping=damping, tension_only=True)
    cord = scene.world.add_tendon([(0, 0, 0), (0, 0, -length)], radius, material, scene.whole(6, 40))
    hand = cord.grip(0)
    weight = scene.body("sphere", (0.01,), load, (0, 0, -length))
    cord.attach(-1, weight)
    friction, away = scene.flat(0.2, 1.0), scene.flat(0.01, 0.04)
    kind, thick = scene.pick("box", "sphere", "capsule"), scene.flat(2, 5) * radius
    sizes = {"box": (2 * thick, 6 * thick, 8 * thick), "sphere": (thick,), "capsule": (thick, 4 * thick)}
    sizes = sizes[kind]
    shape = scene.shape(kind, sizes)
    places = [[side * (away + thick + radius), 0, -scene.flat(0.07, 0.1)] for side in (-1, 1)]
    places[1][2] = places[0][2]
    # The load begins at the slack cord, which it may pull by three times its weight.
    force = rounded(scene.flat(4, 12) * G * (load + float(cord._target.masses.sum())) / (2 * friction))
    time = scene.steps * scene.dt
    speed = rounded(away / (scene.flat(0.1, 0.3) * time))
    soon = force * 0.1 * time / speed
    mass = rounded(max(min(scene.log(0.01, 0.3), soon), force * scene.dt / 50))
    jaws = jointed(scene, scene.raw.JOINT_PRISMATIC, [mass] * 2, shape, places, [[1, 0, 0], [-1, 0, 0]])
    for k in range(2):
        scene.p.changeDynamics(jaws, k, linearDamping=0.04, angularDamping=0.04)  # pybullet's own
        scene.obstacle(jaws, k, kind, sizes, friction)
        scene.p.setJointMotorControl2(jaws, k, scene.raw.VELOCITY_CONTROL, targetVelocity=speed, force=force)

    heights = []

    def measure():
        heights.append(scene.place(weight)[0][2])

    def watch():
        measure()
        for k in range(2):
            rate = scene.raw.getJointState(jaws, k)[1]
            message = f"jaw {k} moves by {rate:.4g} m/s (its motor by {speed:.4g})"
            scene.check(abs(rate) < 1.2 * speed, message)

    scene.run(scene.steps // 2, watch=watch)
    reached = [scene.raw.getJointState(jaws, k)[0] for k in range(2)]
    scene.near("places of the jaws [m]", reached, [away, away], rel=0.02, absolute=0.1 * radius)
    pressed = [abs(scene.world._target.wrench(jaws, k)[0]) for k in range(2)]
    scene.near("what the jaws press with [N]", pressed, [force, force], rel=0.02)
    # Where the jaws do not hold it, the load falls by as much as the hand.
    scene.lead(hand, (0, 0.03, -0.04), scene.steps - scene.steps // 2, watch=measure)
    quarter = scene.steps // 4
    fallen = np.mean(heights[quarter : 2 * quarter]) - np.mean(heights[-quarter:])
    scene.check(fallen < 0.02, f"the load falls by {fallen:.4g} m")


@family
def attached_to_limb(scene):
    """A tendon attached at a limb's surface, or beneath it, is led around the limb, and comes to rest."""
    scene.begin(gravity=False)
    kind, size = scene.pick("sphere", "capsule", "cylinder", "box"), scene.log(0.005, 0.05)
    length, radius = size * scene.flat(3, 8), rounded(size * scene.log(0.02, 0.2))
    sizes = {"sphere": (size,), "box": (2 * size, 2 * size, length)}.get(kind, (size, length))
    turn = rounded(scene.rng.normal(size=4))
    turn = (turn / np.linalg.norm(turn)).tolist()
    mu = scene.pick(0.0, scene.flat(0.05, 0.8))
    limb = scene.body(kind, sizes, scene.pick(0.0, scene.log(0.05, 2)), (0, 0, 0), turn, friction=1.0)
    if scene.free:
        fixed = (limb, -1, -1, -1, scene.raw.JOINT_FIXED, [0, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, 0, 1])
        scene.p.createConstraint(*fixed, childFrameOrientation=turn)
        scene.free.clear()  # its momentum is the constraint's
    axes = np.array(scene.raw.getMatrixFromQuaternion(turn)).reshape(3, 3)
    half = {"sphere": size, "capsule": length / 2 + size}.get(kind, length / 2)
    deep = scene.pick(0.0, scene.flat(0, 0.5)) * radius
    if kind == "sphere" or scene.coin():
        out, start = axes[:, 2], (half - deep) * axes[:, 2]
    else:
        out, start = axes[:, 0], axes @ [size - deep, 0, scene.flat(-0.4, 0.4) * length]
    side = np.cross(out, scene.direction())
    side /= np.linalg.norm(side)
    force, long = scene.log(0.1, 300), 4 * half + 6 * size
    lean, far = scene.flat(0.0, 1.2), scene.flat(1.4, 2.2)
    ends = [start, start + long * (np.cos(lean) * out + np.sin(lean) * side)]
    material = scene.material(force, friction=mu)
    tendon = straight(scene, rounded(ends), material, scene.whole(8, 60), radius)
    attached = tendon.attach(0, limb)
    hand = tendon.grip(-1, stiffness=rounded(2 * force / size), damping=rounded(2 * force / size * scene.dt))
    aim = start + 1.1 * long * (np.cos(far) * out + np.sin(far) * side)
    scene.lead(hand, aim - ends[1], scene.steps // 2)
    scene.run(scene.steps // 4)
    pulls = []
    scene.run(scene.steps // 4, watch=lambda: pulls.append(np.linalg.norm(hand.force)))
    still = scene.restless(tendon)
    scene.near("force on the limb [N]", scene.world.wrench(limb)[:3], -hand.force, rel=0.01, absolute=still)
    # Beside its attachment it rises from the limb by a tenth of its length, whatever the friction.
    slack = still + 0.02 * np.linalg.norm(attached.force)
    scene.capstan_range(tendon, mu + 0.1, slack, edges=True, wedges=True)
    swings = np.abs(tendon._target.velocities).max() * scene.dt > 0.01 * radius
    restless = max(pulls) - min(pulls)
    message = f"the hand's force changes by {restless:.3g} N"
    scene.check(swings or restless < 0.05 * max(pulls) + still, message)
