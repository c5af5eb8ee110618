"""Scenes of tendons over what turns: pulleys, tackles, windlasses, cranks, and of capstans that do not."""

import itertools
import math

import numpy as np
from everyday_scene import G, Scene, family, rounded

AXLE = 2**-0.5, 0.0, 0.0, 2**-0.5  # turns z to -y: a cylinder about the y axis


def wheel(scene: Scene, radius, mass, at, rail=None, friction=0.0, width=0.03):
    """A wheel on a hinge along y without damping or motor; rail: mass of a block that slides along z with it.

    Returns the body and the wheel's link.
    """
    shape = scene.shape("cylinder", (radius, width))
    links = [(mass, shape, [0, 0, 0], AXLE, scene.raw.JOINT_REVOLUTE)]
    if rail is not None:
        block = (rail, -1, [0, 0, 0], (0, 0, 0, 1), scene.raw.JOINT_PRISMATIC)
        links = [block, links[0]]
    columns = list(zip(*links, strict=True))
    body = scene.p.createMultiBody(
        basePosition=list(at),
        linkMasses=list(columns[0]),
        linkCollisionShapeIndices=list(columns[1]),
        linkVisualShapeIndices=[-1] * len(links),
        linkPositions=list(columns[2]),
        linkOrientations=[list(q) for q in columns[3]],
        linkInertialFramePositions=[[0, 0, 0]] * len(links),
        linkInertialFrameOrientations=[[0, 0, 0, 1]] * len(links),
        linkParentIndices=list(range(len(links))),
        linkJointTypes=list(columns[4]),
        linkJointAxis=[[0, 0, 1]] * len(links),
    )
    for k in range(len(links)):
        scene.p.changeDynamics(body, k, linearDamping=0, angularDamping=0, jointDamping=0)
        scene.p.setJointMotorControl2(body, k, scene.raw.VELOCITY_CONTROL, force=0)
    link = len(links) - 1
    scene.obstacle(body, link, "cylinder", (radius, width), friction)
    return body, link


def arc(centre, radius, first, last, parts=96):
    """Points on a circle in the plane y = 0, from angle to angle (of x to z)."""
    a = np.linspace(first, last, parts)
    return np.array(centre) + radius * np.c_[np.cos(a), 0 * a, np.sin(a)]


def laid(a, length, particles):
    """Radius of an arc whose chords, of particles evenly along a length, clear a circle of radius a."""
    return 1.001 * a / math.cos(min(length / (particles - 1) / (2 * a), 0.9))


def resampled_over(scene, wheels, radius, first, last, particles, load, **law):
    """A tendon along a serpentine that starts just off its wheels."""
    plain = np.array(serpentine(wheels, radius, first, last))
    length = np.linalg.norm(np.diff(plain, axis=0), axis=1).sum()
    smallest = min(size for _, _, size, _ in wheels) + radius
    off = laid(smallest, length, particles) - smallest
    line = serpentine(wheels, radius + off, first, last)
    return scene.world.add_tendon(line, radius, scene.material(load * G, **law), particles)


def serpentine(wheels, radius, first, last):
    """Over the first wheel, under the next and so on (or the other way around): ends at heights first, last.

    wheels: (centre x, centre z, radius, over), each beside the next by both radii and the tendon's width.
    """
    line = [[wheels[0][0] - wheels[0][2] - radius, 0, first]]
    for x, z, size, over in wheels:
        angles = (math.pi, 0) if over else (-math.pi, 0)
        line += arc((x, 0, z), size + radius, *angles).tolist()
    x, _, size, _ = wheels[-1]
    return [*line, [x + size + radius, 0, last]]


def taut_length(wheels, first, last):
    """Length of a taut line from `first` to `last` around wheels as in `serpentine`; None if it leaves any.

    Between circles of signed radii s_i r_i (positive: turned to the left) the line goes along d, with normal
    n to its left: C_2 - C_1 = L d + (s_2 r_2 - s_1 r_1) n.
    """
    circles = [(*first, 0.0), *[(x, z, -size if over else size) for x, z, size, over in wheels], (*last, 0.0)]
    length, ways = 0.0, []
    for (x, z, one), (u, v, other) in itertools.pairwise(circles):
        square = (u - x) ** 2 + (v - z) ** 2 - (other - one) ** 2
        if square <= 0:
            return None
        length += math.sqrt(square)
        ways.append(math.atan2(v - z, u - x) - math.atan2(other - one, math.sqrt(square)))
    for circle, (come, go) in zip(circles[1:-1], itertools.pairwise(ways), strict=True):
        wrap = math.copysign(1, circle[2]) * (go - come)  # all ways go to the right
        if wrap < 0:
            return None
        length += abs(circle[2]) * wrap
    return length


def angle(scene, hinge):
    return scene.raw.getJointState(*hinge)[0]


def chord_error(t, size):
    """A chord of a polygon around a circle is nearer to its middle than its corners, by h^2 / (8 a^2)."""
    longest = np.linalg.norm(np.diff(t.positions, axis=0), axis=1).max()
    return (longest / size) ** 2 / 8


def hung(scene, tendon, mass, particle=0, size=0.01):
    """A load on an end: a weight of the particle, or a ball below it."""
    if scene.coin():
        tendon.set_point_mass(particle, mass)
        return
    at = tendon.positions[particle]
    tendon.attach(particle, scene.body("sphere", (size,), mass, at - (0, 0, size)))


def over_one(scene, mu):
    """A hinged wheel with a tendon over it: (hinge, tendon, size of the wheel with the tendon, load [kg])."""
    scene.begin()
    size, radius = scene.log(0.01, 0.1), scene.log(5e-4, 4e-3)
    radius = min(radius, 0.2 * size)
    load, mass = scene.log(0.005, 100), scene.log(0.003, 10)
    hinge = wheel(scene, size, mass, (0, 0, 0), friction=1.0)
    a = size + radius
    down = scene.flat(2, 5) * a
    n = scene.whole(30, 60)
    tendon = resampled_over(scene, [(0, 0, size, True)], radius, -down, -down, n, load, friction=mu)
    hung(scene, tendon, load, 0, min(0.01, size / 3))
    return hinge, tendon, a, load


class Rolls:
    """Sums up how far a wheel's rim slips on all of the tendon on it, in steps in which friction can hold it.

    size: radius of the wheel with the tendon, positive where the tendon passes over the wheel against the
    turn of its hinge [m].

    A tendon that stretches does not pass all of a wheel at one speed. Friction acts on what slips against its
    slip. If the rim is slower than all of the tendon on it, or faster, all friction has one direction, and
    the tensions beside the wheel differ by e^(mu phi). As long as they differ by less, the rim's speed lies
    between those of the tendon on it. Which of them it is depends on what happened before: where a load
    bounces, the place that sticks wanders along the wheel, and the rim's way in the end is that of no
    particle.

    What sticks gives way elastically, before it slips by mu psi / 10 of a segment that turns by psi, and
    comes back.
    """

    def __init__(self, scene, hinge, tendon, size, mu):
        self.scene, self.hinge, self.tendon, self.size, self.mu = scene, hinge, tendon._target, size, mu
        self.way = self.slipped = self.given = 0.0  # of the rim, by slip, elastically [m]
        self.share = math.inf  # of what friction can hold, that it holds after the last step [-]
        self.most = 0.0  # the largest in steps that were judged [-]
        self.away, self.turned = self._now()
        self.moved = np.zeros_like(self.away)

    def _now(self):
        """Positions about the axle [m], and the hinge's angle [rad]."""
        return self.tendon.positions - self.scene.place(*self.hinge)[0], angle(self.scene, self.hinge)

    def __call__(self):
        before, turned, last = self.away, self.turned, self.moved
        self.away, self.turned = self._now()
        self.moved = self.away - before
        on = segments_on(self.away, 1.02 * abs(self.size))
        # What strikes the tendon can slip within a step, and is held at its end.
        share_before, self.share = self.share, self._share_held(on, last)
        share = max(share_before, self.share)
        if share > 0.8:
            return
        along = np.diff((before + self.away) / 2, axis=0)[on]
        along /= np.linalg.norm(along, axis=1)[:, None]
        # Along a chord that touches the wheel, what turns with it moves as the rim does, at either end.
        ways = np.concatenate([np.einsum("ij,ij->i", self.moved[on + end], along) for end in (0, 1)])
        rim = (self.turned - turned) * self.size
        self.way += abs(rim)
        self.most = max(self.most, share)
        elastic = self.most * self.mu * 0.8 * abs(self.size) * chord_error(self.tendon, self.size)
        given = self.given + rim - np.clip(rim, ways.min(), ways.max())
        self.given = np.clip(given, -elastic, elastic)
        self.slipped += abs(given - self.given)

    def _share_held(self, on, last):
        """What friction bears on segments, of what it can [-]: more than 1 where it need not hold.

        It bears the difference of the tensions beside them, and what moves the tendon there. last: its way in
        the step before [m].
        """
        if not on.size or on[0] == 0 or on[-1] == self.tendon.particles - 2:
            return math.inf
        ways = np.diff(self.away[on[0] - 1 : on[-1] + 3], axis=0)
        wrap = abs(np.diff(np.unwrap(np.arctan2(ways[:, 0], ways[:, 2]))).sum())
        there = slice(on[0], on[-1] + 2)
        speed = np.abs(self.moved[there]).max() / self.scene.dt
        gained = np.abs(self.moved - last)[there].max() / self.scene.dt**2
        inertia = self.tendon.masses[there].sum() * (G + gained + speed**2 / abs(self.size))
        beside = self.tendon.tension[[on[0] - 1, on[-1] + 1]]
        least, most = beside.min() - inertia, beside.max() + inertia
        return math.log(most / least) / (self.mu * wrap) if least > 0 and self.mu * wrap > 0 else math.inf

    def check(self):
        """A hundredth of the way: the first order in time."""
        allowed = 0.01 * self.way + 0.02 * self.tendon.radius
        self.scene.near("slip of a wheel's rim on the tendon [m]", self.slipped, 0, absolute=allowed)


def segments_on(away, size) -> np.ndarray:
    """Segments that are nearer to an axle along y through the origin than a distance [m]."""
    start, way = away[:-1, ::2], np.diff(away[:, ::2], axis=0)
    share = -np.einsum("ij,ij->i", start, way) / np.maximum(np.einsum("ij,ij->i", way, way), 1e-300)
    return np.flatnonzero(np.linalg.norm(start + np.clip(share, 0, 1)[:, None] * way, axis=1) < size)


@family
def pulley_sticks(scene):
    """What sticks rolls: the wheel turns by the tendon's way over R + r."""
    mu = scene.flat(0.6, 1.2)
    hinge, tendon, a, load = over_one(scene, mu)
    hand = tendon.grip(-1)
    scene.run(scene.steps // 2)
    rolls = Rolls(scene, hinge, tendon, -a, mu)
    way = scene.flat(0.3, 1.5) * a * scene.pick(1, -1)
    scene.lead(hand, (0, 0, -way), scene.steps - scene.steps // 2, watch=rolls)
    rolls.check()


@family
def pulley_smooth(scene):
    """No force has an arm about the axis of a smooth wheel: it does not turn, whatever runs over it.

    Allowed: a fiftieth of the tendon's way, and 0.02 rad.
    """
    hinge, tendon, a, load = over_one(scene, 0.0)
    hand = tendon.grip(-1)
    way = scene.pick(0.0, scene.flat(0.3, 1.5) * a)
    scene.lead(hand, (0, 0, -way), scene.steps)
    turned = angle(scene, hinge)
    scene.near("angle of a smooth wheel [rad]", turned, 0, absolute=0.02 + 0.02 * way / a)


def in_series(scene, mu):
    """Two to four wheels in a row, a load at one end and a hand at the other."""
    scene.begin()
    radius, count = scene.log(5e-4, 2e-3), scene.whole(2, 4)
    sizes = [scene.flat(8, 20) * radius for _ in range(count)]
    load, x, wheels, hinges = scene.log(0.01, 20), 0.0, [], []
    drop = 1.3 * (max(sizes) * 2 + 2 * radius)
    for k, size in enumerate(sizes):
        x += 0 if k == 0 else sizes[k - 1] + size + 2 * radius + 0.1 * min(sizes)
        wheels.append((x, -drop * (k % 2), size, k % 2 == 0))
        hinges.append(wheel(scene, size, scene.log(0.005, 2), (x, 0, -drop * (k % 2)), friction=1.0))
    last = -2 * drop if count % 2 else drop
    tendon = resampled_over(scene, wheels, radius, -2 * drop, last, 60, load, friction=mu)
    hung(scene, tendon, load, 0, 0.4 * sizes[0])
    return hinges, [-((-1) ** k) * (s + radius) for k, s in enumerate(sizes)], tendon, np.sign(last), load


@family
def pulleys_in_series(scene):
    """Every wheel that the tendon sticks to turns by its way over R + r; neighbours the other way around."""
    mu = scene.flat(0.6, 1.0)
    hinges, sizes, tendon, up, load = in_series(scene, mu)
    hand = tendon.grip(-1)
    scene.run(scene.steps // 2)
    wheels = [Rolls(scene, hinge, tendon, a, mu) for hinge, a in zip(hinges, sizes, strict=True)]
    way = scene.flat(0.3, 0.8) * min(map(abs, sizes))
    steps = scene.steps - scene.steps // 2
    scene.lead(hand, (0, 0, up * way), steps, watch=lambda: [rolls() for rolls in wheels])
    for rolls in wheels:
        rolls.check()


@family
def smooth_pulleys_in_series(scene):
    """Without friction the tension is the same on both ends, and no wheel turns.

    A chord may stand at half the turn of a particle to each circle: a polygon has as many places of rest.
    """
    hinges, sizes, tendon, up, load = in_series(scene, 0.0)
    tendon.grip(-1)
    scene.run(scene.steps)
    for hinge in hinges:
        scene.near("angle of a smooth wheel [rad]", angle(scene, hinge), 0, absolute=0.02)
    scene.capstan_range(tendon, 0.0, scene.restless(tendon), chords=len(hinges))


@family
def block_and_tackle(scene):
    """Blocks on rails, each carried by two strands: the way of the hand, and the momentum of the blocks."""
    scene.begin()
    radius, count = scene.log(5e-4, 2e-3), scene.whole(1, 2)
    size, mu = scene.flat(8, 20) * radius, scene.pick(0.0, scene.flat(0.05, 0.8))
    load, lift = scene.log(0.05, 50), scene.flat(0.3, 1.0) * size
    step, drop = 2 * (size + radius) + 0.1 * size, 6 * size
    wheels, blocks = [], []
    for k in range(2 * count):
        low = k % 2 == 0
        wheels.append((k * step, -drop * low, size, not low))
        hinge = wheel(
            scene, size, scene.log(0.005, 1), (k * step, 0, -drop * low), load if low else None, friction=1.0
        )
        blocks += [hinge] if low else []
    tendon = resampled_over(scene, wheels, radius, 0.0, -drop / 2, 60, load, friction=mu)
    tendon.grip(0)
    hand = tendon.grip(-1)
    rising = [0.0] * count

    def momentum():
        """Nothing but tendons and gravity moves a block along its rail."""
        for k, (body, link) in enumerate(blocks):
            speed = scene.raw.getJointState(body, 0)[1]
            mass = scene.mass(body, 0) + scene.mass(body, link)
            gained = mass * (speed - rising[k]) / scene.dt
            given = scene.world.wrench(body, link)[2] - mass * G
            rising[k] = speed
            if scene.world.report.converged and "released" not in scene.world.report.reasons:
                # Joint rows are solved in pybullet by 50 iterations: a hundredth of the load.
                scene.near(
                    "momentum of a block [N]", gained, given, absolute=0.01 * mass * G + 1e-3 * abs(given)
                )

    # pybullet's prismatic joint and wheel are solved by iterations, which have no exact energy.
    scene.lead(hand, (0, 0, -lift), scene.steps, watch=momentum)
    for k, (body, _) in enumerate(blocks):
        wheels[2 * k] = (2 * k * step, scene.raw.getJointState(body, 0)[0] - drop, size, False)
    around = [(x, z, at + radius, over) for x, z, at, over in wheels]
    path = taut_length(around, tendon.positions[0, ::2], tendon.positions[-1, ::2])
    taut = tendon._target.tension.min() > 0
    h = tendon.rest_length / (tendon.particles - 1)
    loose = (2 * count) * (
        np.pi * (size + radius) * chord_error(tendon, size + radius) + h * h / (size + radius)
    )
    # A block that weighs less than the other ones is drawn up to the wheels, and out of the tackle.
    if taut and path is not None:
        scene.near("length around the tackle [m]", tendon.length, path, absolute=loose + 0.2 * radius)


@family
def windlass(scene):
    """A motor winds a load up at the drum's rate times R + r."""
    scene.begin(dt=scene.log(1 / 1000, 1 / 100))
    size, radius = scene.log(0.01, 0.06), scene.log(5e-4, 2e-3)
    radius = min(radius, 0.15 * size)
    a, load = size + radius, scene.log(0.01, 50)
    drum = wheel(scene, size, scene.log(0.05, 5), (0, 0, 0), friction=1.0)
    n, down = scene.whole(40, 60), scene.flat(4, 6) * a
    off = laid(a, math.pi * a + down, n)
    line = [*arc((0, 0, 0), off, math.pi, 0).tolist(), [off, 0, -down]]
    material = scene.material(load * G, friction=scene.flat(0.1, 0.8))
    tendon = scene.world.add_tendon(line, radius, material, n)
    tendon.attach(0, *drum)
    hung(scene, tendon, load, -1, size / 3)
    scene.energy = False  # the motor's work
    motor = f"p.setJointMotorControl2({drum[0].text}, 0, p.VELOCITY_CONTROL, targetVelocity={{}}, force=1e5)"
    scene.code(motor.format(0.0))
    scene.run(scene.steps // 4)
    turn, steps = scene.flat(0.5, 1.5), scene.steps - scene.steps // 4
    z, before, length = tendon.positions[-1, 2], angle(scene, drum), tendon.length
    rate = turn / (steps * scene.dt)  # about -y, as the drum stands
    scene.run(steps, "w = " + repr(round(rate, 6)) + " * min(1, k / 60)", motor.format("w"))
    wound = abs(angle(scene, drum) - before) * a
    risen, stretched = tendon.positions[-1, 2] - z, tendon.length - length
    # The first particle goes around on the drum; the load swings by less than the drum's chord errors.
    allowed = wound * (0.01 + chord_error(tendon, a)) + 0.1 * radius + abs(stretched)
    scene.near("way of the load [m]", risen, wound - stretched, absolute=allowed)


@family
def pulley_onto_its_stop(scene):
    """A motor drives a pulley's block onto the end of its rail: the load rises by twice the block's way.

    The wheel rolls along the tendon.
    """
    scene.begin(dt=scene.log(1 / 1000, 1 / 100))
    size, radius = scene.log(0.01, 0.06), scene.log(5e-4, 2e-3)
    radius = min(radius, 0.15 * size)
    a, load, mu = size + radius, scene.log(0.01, 20), scene.pick(0.0, scene.flat(0.3, 1.0))
    disc, block = scene.log(0.003, 5), load * scene.log(0.5, 5)
    hinge = wheel(scene, size, disc, (0, 0, 0), rail=block, friction=1.0)
    end, down = scene.flat(0.5, 1.5) * size, scene.flat(4, 6) * a
    scene.p.changeDynamics(hinge[0], 0, jointLowerLimit=-end, jointUpperLimit=end)
    tendon = resampled_over(
        scene, [(0, 0, size, True)], radius, -down, -down, scene.whole(30, 60), load, friction=mu
    )
    hung(scene, tendon, load, 0, size / 3)
    tendon.grip(-1)
    scene.energy = False  # the motor's work
    # Of twice that, pybullet's own motor drives a light block through the limit, without any tendon too.
    force = round(1.5 * (2 * load + disc + block) * G, 3)
    motor = (
        f"p.setJointMotorControl2({hinge[0].text}, 0, p.VELOCITY_CONTROL, targetVelocity={{}}, force={force})"
    )
    scene.code(motor.format(0.0))
    scene.run(scene.steps // 4)
    steps, rolls, pulls = scene.steps - scene.steps // 4, Rolls(scene, hinge, tendon, -a, mu), []

    fall = 2 * end * G * (2 * load + disc + block)  # twice the energy of all falling by the rail's length
    fastest = math.sqrt(2 * fall / (disc + block)) + 4 * end / (steps * scene.dt)

    def watch():
        rolls()
        pulls.append(-scene.world._target.wrench(*hinge)[2])
        speed = abs(scene.raw.getJointState(hinge[0], 0)[1])
        scene.check(speed < fastest, f"block at {speed:.3g} m/s (allowed {fastest:.3g})")

    z, length = tendon.positions[0, 2], tendon.length
    begun = scene.raw.getJointState(hinge[0], 0)[0]  # the motor may have yielded to the load's fall
    rate = (end - begun) / (0.5 * steps * scene.dt)
    scene.run(steps, "w = " + repr(round(rate, 6)) + " * min(1, k / 30)", motor.format("w"), watch=watch)
    way = scene.raw.getJointState(hinge[0], 0)[0] - begun
    # A load that was thrown up and falls into its tendon can be more than the motor holds, and a motor that
    # cannot bring the block to its rate in 30 steps may be late.
    if max(pulls) + (disc + block) * (G + abs(rate) / (30 * scene.dt)) < 0.95 * force:
        scene.near("way of the block [m]", way, end - begun, absolute=0.01 * end)
    loose = abs(way) * (0.01 + 2 * chord_error(tendon, a)) + 0.1 * radius
    # After the stop the load can fly on: a strand that bears next to nothing is not straight.
    if tendon._target.tension.min() > 0.1 * load * G:
        risen, stretched = tendon.positions[0, 2] - z, tendon.length - length
        scene.near("way of the load [m]", risen, 2 * way - stretched, absolute=2 * loose + abs(stretched))
    if mu > 0:
        rolls.check()


@family
def crank(scene):
    """A crank pin on a motor pulls a tendon through a ring: the tendon ends on the pin's circle."""
    scene.begin(dt=scene.log(1 / 1000, 1 / 100))
    size, load = scene.log(0.01, 0.05), scene.log(0.01, 20)
    drum = wheel(scene, size / 3, scene.log(0.05, 2), (0, 0, 0))
    scene.world.remove_obstacle(*drum)
    scene.solids.clear()
    radius = scene.log(5e-4, 2e-3)
    scene.body("cylinder", (4 * radius, 0.05), 0, (size + 5 * radius, 0, -4 * size), AXLE, friction=0.3)
    x = size
    line = [[x, 0, 0], [x, 0, -scene.flat(8, 12) * size]]
    tendon = scene.world.add_tendon(line, radius, scene.material(load * G), scene.whole(15, 60))
    pin = tendon.attach(0, drum[0], drum[1])
    hung(scene, tendon, load, -1)
    scene.energy = False  # the motor's work
    motor = f"p.setJointMotorControl2({drum[0].text}, 0, p.VELOCITY_CONTROL, targetVelocity={{}}, force=1e5)"
    scene.code(motor.format(0.0))
    # At most a fifth of gravity on the pin: the tendon stays taut.
    rate = min(math.sqrt(0.2 * G / size), scene.flat(0.5, 3) / (scene.steps * scene.dt))

    def on_the_pin():
        if len(scene.seconds) < 20:  # a motor is learned from what it did
            return
        where, axes = scene.place(*drum)
        right = where + axes @ pin.position
        # getLinkState's place is of single precision; what turns goes straight in a step, foreseen or not.
        allowed = 1e-6 + 1e-3 * size + 2 * size * (rate * scene.dt) ** 2
        scene.near("end on the crank pin [m]", tendon.positions[0], right, absolute=allowed)

    scene.run(scene.steps, motor.format(round(rate, 6)), watch=on_the_pin)


def on_a_post(scene, mu, turns, force):
    """A fixed cylinder with a tendon around it by an angle: (tendon, hand, angle)."""
    size, radius = scene.log(0.008, 0.06), scene.log(5e-4, 3e-3)
    radius = min(radius, 0.15 * size)
    post = scene.body("cylinder", (size, 0.4), 0, (0, 0, 0), AXLE, friction=1.0)
    a, pitch = size + radius, 2.6 * radius
    around = np.linspace(0, turns, 90)
    out = scene.flat(1, 3) * a
    length = turns * a + 2 * out
    n = int(np.clip(length / (0.35 * a), 30, 60))
    off = laid(a, length, n)
    helix = np.c_[-off * np.sin(around), pitch * around / (2 * np.pi), off * np.cos(around)]
    end = lambda t, s: np.array([s * -np.cos(t), 0, s * -np.sin(t)])  # noqa: E731
    first, last = helix[0] + out * end(0, -1), helix[-1] + out * end(turns, 1)
    line = np.vstack([first, helix, last])
    tendon = scene.world.add_tendon(line, radius, scene.material(force, friction=mu), n)
    return post, tendon, end(turns, 1)


@family
def capstan(scene):
    """A tendon around a fixed post holds, or slides at, tensions within a factor of e^(mu phi)."""
    scene.begin(gravity=False)
    mu, force = scene.flat(0.0, 0.6), scene.log(0.1, 2000)
    post, tendon, way = on_a_post(scene, mu, scene.flat(1.5, 6), force)
    tendon.set_force(0, (force, 0, 0))
    hand = tendon.grip(-1)
    scene.run(scene.steps // 3)
    scene.lead(hand, scene.flat(0.001, 0.02) * way, scene.steps - scene.steps // 3)
    scene.capstan_range(tendon, mu, scene.restless(tendon), pull=(force, 0, 0))
    scene.no_opposed_contacts()


@family
def moving_post(scene):
    """A bone moves under a tendon, led by its velocity or a motor: tensions stay in the capstan's range."""
    scene.begin(gravity=False)
    mu, force = scene.flat(0.0, 0.5), scene.log(0.1, 500)
    post, tendon, _ = on_a_post(scene, mu, scene.flat(1.0, 4), force)
    scene.energy = False  # whoever moves the post does work
    tendon.set_force(0, (force, 0, 0))
    tendon.grip(-1)
    to_hand = np.linalg.norm(np.diff(tendon.positions[-2:], axis=0))
    most = min(0.02, to_hand)
    speed = scene.direction() * scene.flat(0.1, 0.5) * most / (scene.steps * scene.dt)
    speed[1] = 0
    spin = scene.pick(0.0, scene.flat(-1, 1) / (scene.steps * scene.dt))
    line = "p.resetBasePositionAndOrientation({0}, np.multiply({1}, k * {2}), q)"
    turned = (
        f"q = p.multiplyTransforms([0, 0, 0], p.getQuaternionFromEuler([0, {spin!r} * k * {scene.dt!r}, 0])"
    )
    turned += f", [0, 0, 0], {list(AXLE)!r})[1]"
    speed = [round(v, 6) for v in speed.tolist()]
    moving = f"p.resetBaseVelocity({post.text}, {speed!r}, [0, {spin!r}, 0])"
    scene.run(scene.steps, turned, line.format(post.text, speed, repr(scene.dt)), moving)
    scene.capstan_range(tendon, mu, scene.restless(tendon) + 0.02 * force, pull=(force, 0, 0))


@family
def yoyo(scene):
    """A spool unwinds from its string, whose end a hand holds: it rolls, and its weight drives it."""
    scene.begin(dt=scene.log(1 / 1000, 1 / 120))
    size, mass, turns = scene.log(0.01, 0.06), scene.log(0.02, 20), scene.whole(2, 5)
    radius, mu = rounded(size * scene.log(0.01, 0.06)), scene.flat(0.2, 0.8)
    a, width = size + radius, 2.5 * turns * radius
    # It does not tilt where the string leaves it.
    inertia = rounded(0.5 * mass * size * size * scene.log(0.3, 3))
    spool = scene.body("cylinder", (size, 4 * width), mass, turn=AXLE, friction=1.0)
    scene.p.changeDynamics(spool, -1, localInertiaDiagonal=[1e3 * inertia, 1e3 * inertia, inertia])
    per_turn, up = scene.whole(14, 30), scene.flat(2, 6) * a
    angles = np.linspace(-2 * math.pi * turns, 0, per_turn * turns + 1)
    inner = scene.pick(a, a / math.cos(math.pi / per_turn))
    coil = np.c_[inner * np.cos(angles), width * angles / (2 * math.pi * turns), inner * np.sin(angles)]
    rise = np.arange(1, max(2, round(up / (2 * math.pi * a / per_turn)))) * 2 * math.pi * a / per_turn
    line = np.vstack([coil, np.c_[0 * rise + inner, 0 * rise, rise]])
    material = scene.material(30 * mass * G, friction=mu, density=1000)
    tendon = scene.world.add_tendon(rounded(line), radius, material, inside="push_out")
    tendon.attach(0, spool)
    tendon.grip(-1)
    driven = G / (1 + inertia / (mass * a * a))
    # Until a turn is left, or it spins at 80 rad/s: pybullet cuts off 100 rad/s.
    way = min(1.4 * math.pi * a * (turns - 1), (80 * a) ** 2 / (2 * driven))
    scene.run(min(600, max(2, round(math.sqrt(2 * way / driven) / scene.dt))))
    motion, fallen = scene.raw.getBaseVelocity(spool), -scene.place(spool)[0][2]
    share = tendon.length * math.pi * radius**2 * 1000 / mass
    scene.near("rolling speed [m/s]", motion[0][2], motion[1][1] * a, rel=0.02 + chord_error(tendon, a))
    right = -math.sqrt(2 * driven * max(0, fallen))
    scene.near("speed of the fall [m/s]", motion[0][2], right, rel=0.03 + share + chord_error(tendon, a))
