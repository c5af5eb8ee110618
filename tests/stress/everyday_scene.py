"""A scene of pybullet and bullet_tendon calls that keeps its own program, and laws that hold in every scene.

Every call to `scene.p`, to the world, and to what they return is written down with literal arguments, so that
a scene that goes wrong can be printed as a script. Loops are given as text: what runs is what is printed.
The laws use what a user can read, and share nothing with the package:

- every value is finite;
- momentum: what tendons gain in a step is what gravity, loads, hands and bodies give them;
- bodies without contacts of their own gain what gravity and the tendons' wrench give them, those that
  constraints join together;
- energy: tendons and bodies have no more than they began with and were given, at one instant: by BDF2
  velocities are means over the step, half a step behind the positions;
- centrelines keep their radius from every solid (formulas and triangles of brute_force.py).
"""

import inspect
import itertools
import sys
import tempfile
import time
import warnings
from functools import partial
from pathlib import Path

import numpy as np
import pybullet as p
from scipy.spatial import cKDTree

import bullet_tendon as bt

sys.path.append(str(Path(__file__).resolve().parents[1]))  # for a run as a script
import brute_force

STILL = {"linearDamping": 0, "angularDamping": 0, "jointDamping": 0}
G = 9.81
# Components of velocity and spin below which the motion is that of the forces [m/s, rad/s]: pybullet cuts off
# at 100, and the world foresees that from 99 on.
FASTEST = 98.99
# Steps are solved to 1e-9 of the largest force, or to the rounding of stiff springs; sums over hundreds of
# particles and substeps add up to less than this [-].
BALANCE = 1e-5
AVERAGED = 10  # steps: what is older has less than 1e-4 of the weight in a mean by BDF2
ENERGY = 0.02  # of what was moved to and fro: pybullet's explicit steps make and lose that [-]
EVERY = 4  # steps from one to the next whose laws are judged; the first ones all are
PARTS = 6  # points of a segment at which its distance is taken: a chord's middle is one of them
FAMILIES = {}
_files = itertools.count()


def family(build):
    """Enter a function of a Scene, which builds, runs and judges it, by its name."""
    FAMILIES[build.__name__] = build
    return build


class Wrong(AssertionError):
    """An oracle found a wrong value."""


class Named(int):
    """A number that a program calls by a name: a body, a shape, one of pybullet's constants."""

    def __new__(cls, value, text):
        number = super().__new__(cls, value)
        number.text = text
        return number


class File(str):
    """A path that a program calls by a shorter name."""

    __slots__ = ("text",)


def rounded(value):
    """The value with seven digits, as it is printed and passed on."""
    if isinstance(value, Named | File | bool | int | str | Recorded) or value is None:
        return value
    if isinstance(value, float | np.floating):
        return float(f"{value:.7g}")
    if isinstance(value, np.ndarray):
        return rounded(value.tolist())
    if isinstance(value, tuple):
        return tuple(rounded(v) for v in value)
    return [rounded(v) for v in value] if isinstance(value, list) else value


def literal(value) -> str:
    """Python text of an argument."""
    if isinstance(value, Named | File):
        return value.text
    if isinstance(value, Recorded):
        return value._name
    if isinstance(value, bt.Material):
        standard = bt.Material(stiffness=1.0)
        names = [n for n in vars(value) if n == "stiffness" or getattr(value, n) != getattr(standard, n)]
        return f"bt.Material({', '.join(f'{n}={getattr(value, n)!r}' for n in names)})"
    if isinstance(value, list | tuple):
        inner = ", ".join(literal(v) for v in value)
        return f"[{inner}]" if isinstance(value, list) else f"({inner}{',' if len(value) == 1 else ''})"
    return repr(value)


class Recorded:
    """An object whose calls and changes are written into a scene's program."""

    def __init__(self, scene, target, name):
        self.__dict__.update(_scene=scene, _target=target, _name=name)

    def __getattr__(self, attribute):
        found = getattr(self._target, attribute)
        if not callable(found):
            return found

        def call(*args, **kwargs):
            args = [rounded(a) for a in args]
            kwargs = {k: rounded(v) for k, v in kwargs.items()}
            return self._scene.call(self, attribute, found, args, kwargs)

        return call

    def __setattr__(self, attribute, value):
        value = rounded(value)
        self._scene.write(f"{self._name}.{attribute} = {literal(value)}")
        setattr(self._target, attribute, value)


class Client:
    """pybullet, of one client."""

    def __init__(self, number):
        self._number = number

    def __getattr__(self, name):
        found = getattr(p, name)
        if not callable(found):
            return Named(found, f"p.{name}") if isinstance(found, int) else found
        return lambda *args, **kwargs: found(*args, **kwargs, physicsClientId=self._number)


class Scene:
    """A client and a world; draws random numbers, builds, runs and judges.

    Families set what does not hold in them: `energy` False where motors or moved bodies do work that is not
    counted, `solids` to what centrelines must keep away from. options: of SolverOptions.
    """

    def __init__(self, seed: int, steps: int = 240, **options):
        self.rng, self.steps, self.options = np.random.default_rng(seed), steps, options
        self._ends_of = {}  # by hold: what near_end compared with in the last steps
        self.lines, self.names = [], itertools.count()
        self.seconds, self.unconverged, self.told, self.begun = [], 0, [], False
        self.tendons, self.grips, self.links, self.solids, self.bores = [], [], set(), [], []
        self.free, self.pushed, self.energy = [], {}, True
        self._settled = True  # the last step converged
        self.joined = []  # sets of free bodies that constraints join
        self._loads = [np.zeros(3)]  # sums of what is pushed, of the last steps
        self.work = self.turnover = 0.0
        self._gained = None  # (step, energy gained without that of motion, that, what is allowed)
        self._slow = {}  # speeds of soft hands in the last step
        self.heights = {}
        self.client = p.connect(p.DIRECT)
        self.raw = Client(self.client)
        self.p = Recorded(self, self.raw, "p")
        self.space = {"p": self.raw, "np": np, "bt": bt}
        self.folder = tempfile.TemporaryDirectory()

    def close(self):
        p.disconnect(self.client)
        self.folder.cleanup()

    # Random numbers, with four digits

    def flat(self, low, high) -> float:
        return float(f"{self.rng.uniform(low, high):.4g}")

    def log(self, low, high) -> float:
        return float(f"{np.exp(self.rng.uniform(np.log(low), np.log(high))):.4g}")

    def whole(self, low, high) -> int:
        """low ... high, both of them."""
        return int(self.rng.integers(low, high + 1))

    def coin(self) -> bool:
        return bool(self.rng.integers(2))

    def pick(self, *choices):
        return choices[self.rng.integers(len(choices))]

    def direction(self) -> np.ndarray:
        x = self.rng.normal(size=3)
        return x / np.linalg.norm(x)

    # The program

    def write(self, line):
        self.lines.append(line)

    def call(self, owner, attribute, found, args, kwargs):
        """Do it, and write it down unless it only reads."""
        text = ", ".join([*map(literal, args), *(f"{k}={literal(v)}" for k, v in kwargs.items())])
        line = f"{owner._name}.{attribute}({text})"
        if attribute.startswith("get") or attribute in ("wrench", "penetrations"):
            return found(*_plain(args), **_plain(kwargs))
        name = f"{attribute.removeprefix('add_').removeprefix('create').removeprefix('load').lower()}"
        name += str(next(self.names))
        self.write(line)  # before it is done: a call that fails is the last line
        result = found(*_plain(args), **_plain(kwargs))
        self._note(owner, attribute, args, kwargs, result)
        if isinstance(result, bt.Tendon | bt.Grip | bt.Attachment | bt.Tunnel):
            self.lines[-1] = f"{name} = {line}"
            self.space[name] = result
            return Recorded(self, result, name)
        if isinstance(result, int) and attribute.startswith(("create", "load")):
            self.lines[-1] = f"{name} = {line}"
            self.space[name] = result
            return Named(result, name)
        return result

    def _note(self, owner, attribute, args, kwargs, result):
        """What the laws have to know of a call to the world or a tendon."""
        if attribute == "add_tendon":
            self._know(result)
        elif attribute == "grip":
            self.grips.append(result)
        elif attribute == "attach":
            self.links.add((result.bodyUniqueId, result.linkIndex))
        elif attribute == "add_tunnel":
            self.links.add((result.bodyUniqueId, result.linkIndex))
            self.bores.append(result)
        elif attribute == "add_obstacle" or (attribute == "load_urdf" and owner._name == "world"):
            body = int(args[0]) if attribute == "add_obstacle" else result
            self.links |= {(body, k) for k in range(-1, self.raw.getNumJoints(body))}
            for tendon in self.world._target.tendons[len(self.tendons) :]:
                self._know(tendon)

    def _know(self, tendon):
        """A tendon, and the loads that it will be given."""
        self.tendons.append(tendon)
        push = tendon.set_force

        def set_force(particle, force):
            push(particle, force)
            self.pushed[tendon, particle % tendon.particles] = np.array(force, float)

        tendon.set_force = set_force

    def source(self, function, *args) -> object:
        """Put a function's source and a call of it with literal arguments into the program; the result."""
        name = f"{function.__name__}{next(self.names)}"
        text = inspect.getsource(function).rstrip()
        if text not in self.lines:
            self.lines.append(text)
        args = [rounded(a) for a in args]
        self.write(f"{name} = {function.__name__}({', '.join(map(literal, args))})")
        self.space[name] = function(*args)
        return self.space[name], name

    def file(self, name, text) -> File:
        """A file of the text; the program writes it beside itself."""
        path = File(Path(self.folder.name) / f"{next(_files)}_{name}")
        path.text = repr(name)
        Path(path).write_text(text)
        self.write(f'open({name!r}, "w").write("""{text}""")')
        return path

    def program(self) -> str:
        """The scene as a script."""
        head = "import numpy as np\nimport pybullet as p\n"
        if any("ConvexHull" in line for line in self.lines):
            head += "from scipy.spatial import ConvexHull\n"
        return head + "\nimport bullet_tendon as bt\n\np.connect(p.DIRECT)\n" + "\n".join(self.lines) + "\n"

    # Parts

    def begin(self, dt=None, gravity=True):
        """A world; dt [s]: None: random."""
        self.dt = rounded(self.log(1 / 1000, 1 / 60) if dt is None else dt)
        self.gravity = np.array([0, 0, -G * bool(gravity)])
        self.p.setTimeStep(self.dt)
        self.p.setGravity(*self.gravity.tolist())
        named = ", ".join(f"{name}={value!r}" for name, value in self.options.items())
        self.write(f"world = bt.TendonWorld({f'options=bt.SolverOptions({named})' if named else ''})")
        self.space["world"] = bt.TendonWorld(self.client, bt.SolverOptions(**self.options))
        self.world = Recorded(self, self.space["world"], "world")
        return self.world

    def material(self, force=10.0, soft=False, **fixed) -> bt.Material:
        """A random one that `force` [N] stretches by at most a tenth."""
        changes = {"friction": self.pick(0.0, self.flat(0.02, 0.8)), **fixed}
        slope = self.log(10 * force, 10 * force if soft else max(1e5, 20 * force))
        kind = self.pick("preset", "ligament", "linear", "power")
        if kind == "preset":
            name = self.pick("native_acl", "patellar_tendon", "hamstring_graft")
            return bt.Material.preset(name, **changes)
        if kind == "ligament":
            return bt.Material.ligament(2 * slope, self.flat(0.02, 0.06), **changes)
        damping = self.pick(0.0, rounded(slope * self.log(1e-5, 3e-3)))
        law = {"stiffness": slope, "damping": damping, "density": self.log(500, 2000), **changes}
        if kind == "power":
            exponent = self.flat(1, 2)
            law |= {"exponent": exponent, "stiffness": rounded(slope * 10 ** (exponent - 1))}
        return bt.Material(**law)

    def shape(self, kind, sizes) -> Named:
        """sizes as in brute_force: of a box its edges, else radius and height."""
        if kind == "box":
            half = [s / 2 for s in sizes]
            return self.p.createCollisionShape(self.raw.GEOM_BOX, halfExtents=half)
        if kind == "sphere":
            return self.p.createCollisionShape(self.raw.GEOM_SPHERE, radius=sizes[0])
        geometry = self.raw.GEOM_CYLINDER if kind == "cylinder" else self.raw.GEOM_CAPSULE
        return self.p.createCollisionShape(geometry, radius=sizes[0], height=sizes[1])

    def body(self, kind, sizes, mass=0.0, at=(0, 0, 0), turn=(0, 0, 0, 1), friction=None) -> Named:
        """A body of one shape, without damping; friction: of an obstacle (None: it is none)."""
        body = self.body_of(self.shape(kind, sizes), mass, at, turn)
        if friction is not None:
            self.obstacle(body, -1, kind, sizes, friction)
        return body

    def body_of(self, shape, mass, at, turn) -> Named:
        """A body of a shape that pybullet knows, without damping."""
        body = self.p.createMultiBody(mass, shape, -1, list(at), list(turn))
        if mass:
            self.p.changeDynamics(body, -1, linearDamping=0, angularDamping=0)
            self.free.append(body)
        return body

    def obstacle(self, body, link, kind, sizes, friction):
        self.world.add_obstacle(body, link, friction=friction)
        self.solids.append((body, link, kind, sizes))

    def mesh(self, vertices, faces, name, at=(0, 0, 0), friction=0.0) -> Named:
        """A static obstacle of triangles; name: of the (vertices, faces) in the program."""
        line = (
            f"shape = p.createCollisionShape(p.GEOM_MESH, vertices={name}[0].tolist(), "
            f"indices={name}[1].ravel().tolist(), flags=p.GEOM_FORCE_CONCAVE_TRIMESH)"
        )
        self.code(line)
        body = self.p.createMultiBody(0, Named(self.space["shape"], "shape"), -1, list(at))
        self.code(f"world.add_obstacle({body.text}, friction={friction!r}, convex=False, meshes=[{name}])")
        self.links.add((int(body), -1))
        self.solids.append((body, -1, "mesh", vertices[faces]))
        return body

    def code(self, *lines):
        """Run and write down lines of text."""
        for line in lines:
            self.write(line)
            exec(line, self.space)

    def hand(self, tendon, particle=-1, **kwargs):
        return tendon.grip(particle, **kwargs)

    # Running

    def run(self, steps, *lines, watch=None):
        """Steps, each after the lines of text (k: its number); watch() is called after each."""
        body = ["    " + line for line in lines]
        self.write("\n".join([f"for k in range({steps}):", *body, "    world.step()"]))
        code = compile("\n".join(lines), "driving", "exec")
        world = self.world._target
        self._start()
        for k in range(steps):
            self.space["k"] = k
            step = len(self.seconds) + 1
            look = step <= EVERY or step % EVERY == 0
            self._measure(look)
            exec(code, self.space)
            self.rates_before = {b: np.concatenate(self.raw.getBaseVelocity(b)) for b in self.free}
            self.begun = True
            with warnings.catch_warnings(record=True) as told:
                warnings.simplefilter("always")
                start = time.perf_counter()
                try:
                    world.step()
                finally:
                    self.seconds.append(time.perf_counter() - start)
            self.told += [str(w.message) for w in told if "swig" not in str(w.message).lower()]
            self._judge(step, look)
            if watch is not None:
                watch()

    def lead(self, grip, way, steps, *lines, watch=None):
        """Lead a grip by `way` [m], starting and stopping softly."""
        start = grip._target.target
        first, way = literal(rounded(start)), literal(rounded(way))
        go = f"{grip._name}.target = np.add({first}, np.multiply({way}, s))"
        self.run(steps, *ease(steps), go, *lines, watch=watch)

    # Laws

    def check(self, holds, message):
        if not holds:
            raise Wrong(message)

    def near(self, what, value, right, rel=0.0, absolute=0.0):
        """abs(value - right) <= absolute + rel |right|, of numbers or vectors."""
        off = np.linalg.norm(np.subtract(value, right))
        allowed = absolute + rel * np.linalg.norm(right)
        shown = f"{np.round(value, 6).tolist()} instead of {np.round(right, 6).tolist()}"
        self.check(off <= allowed, f"{what}: {shown} (allowed {allowed:.3g})")

    def follow(self, hold, end):
        """Note what the force of a hold is at the end of this step."""
        self._ends_of.setdefault(hold, []).append(end)
        del self._ends_of[hold][:-AVERAGED]

    def near_end(self, what, hold, absolute):
        """The force of a hold is that of the step's end by implicit Euler, once it is followed.

        By BDF2 it is the mean of the step: an average, with positive weights, of the ends of this step and of
        the last ones. The weights of older ones are nothing (core/bodies/body_history.h).
        """
        ends = self._ends_of[hold]
        if self.options.get("integrator") != "bdf2":
            ends = ends[-1:]
        self.near(what, hold.force, np.clip(hold.force, np.min(ends, 0), np.max(ends, 0)), absolute=absolute)

    def _start(self):
        """What is stored when time begins is moved once."""
        if not self.begun:
            self.energy &= not self._overlaps()  # what overlaps is pushed apart
            self.energy_at_start = self._stored() + self._moving()
            at_height = sum(self.heights.values())
            self.turnover = abs(self.energy_at_start - at_height)

    def _overlaps(self):
        """Whether a tendon begins a hundredth of its radius inside a solid, itself or another one."""
        for k, t in enumerate(self.tendons):
            points = brute_force.subdivided(t.positions, PARTS)
            if any((self.gaps(points, solid) < 0.99 * t.radius).any() for solid in self.solids):
                return True
            if any(nearest(t, other) < 0.99 * (t.radius + other.radius) for other in self.tendons[: k + 1]):
                return True
        return False

    def _measure(self, look=True):
        """What the laws compare a step with. look: whether its momentum will be judged."""
        self._targets = [g.target for g in self.grips]
        self._ends = {key: key[0].positions[key[1]] for key in self.pushed}
        if look:
            self._before = [(t, t.velocities, t.masses) for t in self.tendons]
            self._looked = len(self.seconds)

    def speed(self, body):
        return np.array(self.raw.getBaseVelocity(body)[0])

    def place(self, body, link=-1):
        """Position and rotation matrix of a link's URDF frame."""
        if link < 0:
            x, q = self.raw.getBasePositionAndOrientation(body)
        else:
            x, q = self.raw.getLinkState(body, link, computeForwardKinematics=True)[4:6]
        return np.array(x), np.array(p.getMatrixFromQuaternion(q)).reshape(3, 3)

    def mass(self, body, link=-1) -> float:
        return self.raw.getDynamicsInfo(body, link)[0]

    def _judge(self, step, look):
        report = self.world.report
        self.unconverged += not report.converged
        if self.energy:
            self._count_work()
        self._bound_of_last_step()
        self._loads = [*self._loads[1 - AVERAGED :], sum(self.pushed.values(), np.zeros(3))]
        if look or step == self.steps:
            self._finite(step)
            self._soft_hands(step)
            self._energy_bound(step)
        # A step that is solved again changes what was read after the one before. One that was left over
        # budget owes motion to the next one.
        settled, self._settled = self._settled and report.converged, report.converged
        if look and settled and "released" not in report.reasons:
            self._momentum(step)
        if step % 40 == 0 or step == self.steps:
            self.no_overlap(step)

    def _finite(self, step):
        for t in self.tendons:
            for what in ("positions", "velocities", "tension"):
                self.check(np.isfinite(getattr(t, what)).all(), f"step {step}: {what} of {t.name} not finite")
        for hold in (h for t in self.tendons for h in t.holds):
            self.check(np.isfinite(hold.force).all(), f"step {step}: force of a hold not finite")
        for body, link in self.links:
            values = self.raw.getBasePositionAndOrientation(body)[0] + tuple(self.world.wrench(body, link))
            self.check(np.isfinite(values).all(), f"step {step}: body {body} not finite")
        if step % 30 == 0:
            rows = self.world.contacts
            for field in ("position", "normal", "distance", "normal_force", "friction_force"):
                self.check(np.isfinite(rows[field]).all(), f"step {step}: {field} of a contact not finite")

    def _soft_hands(self, step):
        """A soft hand at rest gives its stiffness times its way."""
        for g in self.grips:
            if g.stiffness is None or g.released or g.slipping:
                continue
            way = g._tendon.positions[g.particle] - g.target
            # Its damper brakes the motion relative to the target.
            led = (g.target - self._targets[self.grips.index(g)]) / self.dt
            speed = np.linalg.norm(g._tendon.velocities[g.particle]) + np.linalg.norm(led)
            rested, self._slow[g] = self._slow.get(g, np.inf), speed
            if max(speed, rested) * self.dt < 1e-3 * np.linalg.norm(way):
                # The mean of a step differs from its end by less than what a hundredth of the way, and its
                # damper, can do.
                allowed = 0.01 * g.stiffness * np.linalg.norm(way) + 2 * g.damping * speed + 1e-6
                self.near(
                    f"step {step}: force on a soft hand [N]", g.force, g.stiffness * way, absolute=allowed
                )

    def _momentum(self, step):
        """sum of m dv/dt = m g + loads - (forces on hands and bodies), of all tendons together."""
        total, largest = np.zeros(3), 0.0
        for t, v, m in self._before:
            if not np.array_equal(m, t.masses):  # reeled in: mass comes and goes
                return
            total += m @ (t.velocities - v) / self.dt - m.sum() * self.gravity
            largest = max(largest, np.abs(t.tension).max(), m.sum() * G)
            # A tendon at rest falls asleep at up to 1e-5 radii a second; it has no speed then.
            largest += m.sum() * 1e-5 * t.radius / self.dt / BALANCE * t.asleep
        for force in self.pushed.values():
            largest = max(largest, np.linalg.norm(force))
        given = [g.force for g in self.grips] + [self.world.wrench(*link)[:3] for link in self.links]
        for force in given:
            total += force
            largest = max(largest, np.linalg.norm(force))
        # By BDF2 loads act as the averages that near_end tells of.
        loads = self._loads if self.options.get("integrator") == "bdf2" else self._loads[-1:]
        load = np.clip(total, np.min(loads, 0), np.max(loads, 0))
        self.near(f"step {step}: momentum of the tendons [N]", total, load, absolute=BALANCE * largest + 1e-7)
        together = set().union(*self.joined)
        for bodies in [*self.joined, *({b} for b in self.free if b not in together)]:
            self._momentum_of(sorted(bodies), step, largest)

    def _momentum_of(self, bodies, step, largest):
        """Of bodies on tendons alone, slower than FASTEST."""
        if any(self.raw.getContactPoints(bodyA=b) or self.raw.getNumJoints(b) for b in bodies):
            return
        speeds = np.array([[self.speed(b), self.rates_before[b][:3]] for b in bodies])
        if np.abs(speeds).max() > FASTEST:
            return
        masses = np.array([self.mass(b) for b in bodies])
        gained = masses @ (speeds[:, 0] - speeds[:, 1]) / self.dt
        given = sum(self.world.wrench(b)[:3] + self.applied(b) for b in bodies) + masses.sum() * self.gravity
        rounding = 1e-12 * masses.sum() / self.dt * np.linalg.norm(speeds)
        allowed = 1e-5 * max(largest, masses.sum() * G) + rounding
        self.near(f"step {step}: momentum of body {bodies} [N]", gained, given, absolute=allowed)

    def applied(self, body):
        """External force of this step on a body; the scene's lines may set `applied` = {body: force}."""
        return np.array(self.space.get("applied", {}).get(int(body), (0, 0, 0)), float)

    def _stored(self):
        """Of springs and of height [J]."""
        total = sum(t.energy - self._moving_tendon(t) for t in self.tendons)
        total += sum(self._lifted(t, -t.masses @ t.positions @ self.gravity) for t in self.tendons)
        total += sum(self._height(*which) for which in self._links_of_bodies())
        for g in self.grips:
            if g.stiffness is not None and not g.released:
                apart = g._tendon.positions[g.particle] - g.target
                total += 0.5 * g.stiffness * apart @ apart
        return total

    def _links_of_bodies(self):
        for body in {int(b) for b, _ in self.links} | {int(b) for b in self.free}:
            yield from ((body, link) for link in range(-1, self.raw.getNumJoints(body)))

    def _motion(self, body, link):
        """Place, orientation, velocity and spin of a centre of mass."""
        if link < 0:
            return *self.raw.getBasePositionAndOrientation(body), *self.raw.getBaseVelocity(body)
        state = self.raw.getLinkState(body, link, computeLinkVelocity=True, computeForwardKinematics=True)
        return state[0], state[1], state[6], state[7]

    def _height(self, body, link):
        mass = self.mass(body, link)
        if mass == 0:
            return 0.0
        return self._lifted((body, link), -mass * np.dot(self._motion(body, link)[0], self.gravity))

    def _moving_tendon(self, t):
        return 0.5 * t.masses @ (t.velocities**2).sum(1)

    def _moving(self):
        """Of motion, by the velocities that pybullet and the tendons have [J]."""
        total = sum(map(self._moving_tendon, self.tendons))
        for body, link in self._links_of_bodies():
            info = self.raw.getDynamicsInfo(body, link)
            if info[0] == 0:
                continue
            _, q, v, w = self._motion(body, link)
            spin = np.array(p.getMatrixFromQuaternion(q)).reshape(3, 3).T @ w
            total += 0.5 * info[0] * np.dot(v, v) + 0.5 * spin @ (np.array(info[2]) * spin)
        return total

    def _lifted(self, what, energy):
        """Its energy of height; what that changes by is moved to and fro."""
        self.turnover += abs(energy - self.heights.get(what, energy))
        self.heights[what] = energy
        return energy

    def _count_work(self):
        """Of hands and loads, in the last step [J]."""
        for g, target in zip(self.grips, self._targets, strict=True):
            self.energy &= not g.slipping  # what a slipping hand stores is not known
            self._give(g.force @ (target - g.target))
        for (t, k), force in self.pushed.items():
            if (t, k) in self._ends:
                self._give(force @ (t.positions[k] - self._ends[t, k]))
        for body in self.free:
            self._give(self.applied(body) @ self.speed(body) * self.dt)

    def _give(self, work):
        self.work += work
        self.turnover += abs(work)

    def _energy_bound(self, step):
        """There is no more than there was and was given."""
        if any(self.raw.getContactPoints(bodyA=b) for b in self.free):  # pybullet pushes apart what overlaps
            self.energy = False
        if not self.energy:
            return
        gained, moving = self._stored() - self.energy_at_start - self.work, self._moving()
        # A nanojoule: rounding of springs of 1e6 N at rest.
        self._gained = step, gained, moving, ENERGY * self.turnover + 1e-9
        if self.options.get("integrator") != "bdf2":
            self._bound_of_last_step()

    def _bound_of_last_step(self):
        """Judge the energy that was noted.

        By BDF2 the energy of motion at the end of a step is between those by the mean velocities of this step
        and of the next one. With that of this step alone, half a step behind, an exact pendulum seems to gain
        half a step's work of its springs and weights while it rises.
        """
        noted, self._gained = self._gained, None
        if noted is None or not self.energy:
            return
        step, gained, moving, allowed = noted
        gained += min(moving, self._moving())
        message = f"step {step}: {gained:.3g} J out of nothing, {self.turnover:.3g} J moved"
        self.check(gained <= allowed, message)

    def no_overlap(self, step=None):
        """No centreline nearer to a solid than its radius.

        A tenth of it is allowed: between particles that touch, a chord is nearer than they are. The plane of
        a contact belongs to the place that was foreseen: over the way of one step, and at most over a radius,
        a surface can bend away from it. Near a bore's mouth, whose rim is sharp, another fifth of the radius.
        At the arc s from where it is tied to the solid, at the distance d, it keeps d + s / 10 at least, once
        that is outside; less a tenth of a segment, which has a contact where it is nearest.
        """
        for t in self.tendons:
            x = t.positions
            for solid in self.solids:
                speed = np.abs(t.velocities).max() + np.linalg.norm(self.raw.getBaseVelocity(solid[0])[0])
                allowed = 0.1 * t.radius + min(speed * self.dt, t.radius / 2)
                if solid[2] == "mesh" and step not in (80, 160, self.steps, None):
                    continue
                points = brute_force.subdivided(x, PARTS)
                held = [h.particle for h in t.holds if getattr(h, "bodyUniqueId", None) == int(solid[0])]
                beside, kept = self._beside(held, x), self._kept(t, held, x, solid)
                self._outside(t, points[~beside], kept[~beside], solid, allowed, step)

    def _outside(self, t, points, kept, solid, allowed, step):
        bone = ~self.drilled(points, *solid[:2])
        points = points[bone]
        gap = self.gaps(points, solid) - kept[bone]
        for where, reach in self.mouths():
            gap[np.linalg.norm(points - where, axis=1) < reach] += 0.2 * t.radius
        if len(gap):
            message = f"step {step}: {t.name} (radius {t.radius}) {-gap.min():.3g} m inside {solid[2]} "
            self.check(gap.min() >= -allowed, message + f"of body {solid[0]} (allowed {allowed:.2g})")

    def _beside(self, held, x):
        """Which points of `subdivided(x, PARTS)` are on a segment of a particle tied to the solid."""
        near = np.zeros(PARTS * (len(x) - 1) + 1, bool)
        for k in held:
            near[max(PARTS * (k - 1), 0) : PARTS * (k + 1) + 1] = True
        return near

    def _kept(self, t, held, x, solid):
        """Distance that points of `subdivided(x, PARTS)` have to keep from the solid."""
        lengths = np.linalg.norm(np.diff(x, axis=0), axis=1)
        arcs = np.concatenate([[0], np.cumsum(np.repeat(lengths / PARTS, PARTS))])
        kept = np.full(len(arcs), t.radius)
        for k in held:
            away = np.maximum(np.abs(arcs - arcs[PARTS * k]) - lengths.max(), 0)
            kept = np.minimum(kept, self.gaps(x[k : k + 1], solid)[0] + 0.1 * away)
        return np.where(kept < 0, -np.inf, kept)

    def gaps(self, points, solid):
        """Signed distances of points to a solid, as if it had no bores; in these, infinite."""
        body, link, kind, sizes = solid
        origin, axes = self.place(body, link)
        local = (points - origin) @ axes
        exact = signed_to_mesh if kind == "mesh" else partial(brute_force.signed_distance, kind)
        found = exact(sizes=sizes, x=local)
        return np.where(self.drilled(points, body, link), np.inf, found)

    def mouths(self):
        """Centres of the bores' mouths, and three radii around them."""
        for bore in self.bores:
            origin, axes = self.place(bore.bodyUniqueId, bore.linkIndex)
            yield from ((origin + axes @ end, 3 * bore.radius) for end in (bore.start, bore.end))

    def drilled(self, points, body, link):
        """Which points are in a bore of the link, or in front of a mouth by less than five times its radius.

        A bore is drilled through to the surface, if its wall meets that within two radii of a mouth.
        """
        inside = np.zeros(len(points), bool)
        for bore in self.bores:
            if (bore.bodyUniqueId, bore.linkIndex) == (int(body), link):
                along, aside = self.in_bore(points, bore)
                length, beyond = np.linalg.norm(bore.end - bore.start), 5 * bore.radius
                inside |= (along > -beyond) & (along < length + beyond) & (aside < 1.05 * bore.radius)
        return inside

    def in_bore(self, points, bore):
        """Places along the axis from its start, and distances from it [m]."""
        along, aside = self._from_axis(points, bore)
        return along, np.linalg.norm(aside, axis=1)

    def _from_axis(self, points, bore):
        """Places along the axis from its start, and vectors from the axis (k, 3), world frame [m]."""
        origin, axes = self.place(bore.bodyUniqueId, bore.linkIndex)
        way = (bore.end - bore.start) / np.linalg.norm(bore.end - bore.start)
        off = (points - origin) @ axes - bore.start
        along = off @ way
        return along, (off - along[:, None] * way) @ axes.T

    def in_clearance(self):
        """Particles within a bore keep their radius from its wall, where there is bone around it.

        Beside a mouth this holds of the particle, or of the quadratic B-spline there, on which segments are
        pressed.
        """
        for bore in self.bores:
            length = np.linalg.norm(bore.end - bore.start)
            for t in self.tendons:
                line = np.array(t.positions)
                along, aside = self.in_bore(line, bore)
                inside = (along > 0) & (along < length) & (aside < 2 * bore.radius)
                inside[inside] = self._has_wall(line[inside], bore)
                mouths = 1 + np.flatnonzero(inside[1:-1] & ~(inside[:-2] & inside[2:]))
                curve = (line[mouths - 1] + 6 * line[mouths] + line[mouths + 1]) / 8
                aside[mouths] = np.minimum(aside[mouths], self.in_bore(curve, bore)[1])
                over = (aside[inside] + t.radius - bore.radius).max(initial=0.0)
                moved = min(np.abs(t.velocities).max() * self.dt, t.radius / 2)
                self.check(over <= 0.05 * t.radius + moved, f"{over:.3g} m into the wall of a bore")

    def passes(self, tendon, bore):
        """The tendon runs through the bore: its centreline crosses the middle of that within the wall."""
        points = brute_force.subdivided(tendon.positions, PARTS)
        along, aside = self.in_bore(points, bore)
        middle = np.linalg.norm(bore.end - bore.start) / 2
        crossings = np.flatnonzero((along[1:] > middle) != (along[:-1] > middle))
        least = np.minimum(aside[crossings], aside[crossings + 1]).min(initial=np.inf)
        self.check(least < bore.radius, f"{tendon.name} is {least:.3g} m beside the axis of a bore")

    def _has_wall(self, points, bore):
        """Whether the wall of a bore beside points is in one of its link's solids, or it has none."""
        aside = self._from_axis(points, bore)[1]
        off_axis = np.maximum(np.linalg.norm(aside, axis=1), 1e-12)[:, None]
        wall = points + (1.06 * bore.radius / off_axis - 1.0) * aside
        solids = [s for s in self.solids if (int(s[0]), s[1]) == (int(bore.bodyUniqueId), bore.linkIndex)]
        found = np.full(len(points), not solids)
        for solid in solids:
            found |= self.gaps(wall, solid) < 0
        return found

    def no_opposed_contacts(self):
        """At rest a contact carries at most what the tension's turning and loads press.

        Twice that, because friction presses as well, and both sides of a bore can.
        """
        pressed = 0.0
        for t in self.tendons:
            pull = np.abs(t.tension).max()
            pressed += pull * turning(t.positions).sum() + t.masses.sum() * G
            pressed += t.masses.sum() * np.abs(t.velocities).max() / self.dt
        pressed += sum(np.linalg.norm(f) for f in self.pushed.values())
        pressed += sum(np.linalg.norm(g.force) for g in self.grips)
        pressed += sum(self.mass(b) * G for b in self.free)
        found = self.world.contacts["normal_force"].sum()
        self.check(found <= 2 * pressed, f"contacts of {found:.4g} N where loads can press {pressed:.4g} N")

    def capstan_range(self, tendon, friction, slack, pull=None, edges=False, chords=0, wedges=False):
        """T1/T0 of the ends within e^(+-mu phi); slack [N]: what weights and inertia may add.

        phi is the turning of the polyline; a hundredth for ends that are not straight. pull (3,) [N]: load on
        the first particle, from which the tendon turns too once that segment lies on the post. edges: a
        particle on a sharp edge, where it turns by an angle, is held by normals between those of both its
        segments. Where it is pressed beside the particle alone, T' cos b = T + mu N and T' sin b = N. chords:
        round posts in a row; where a tendon comes onto one, T cos a = T' cos(b / 2), with a <= b / 2 and the
        angle b at a particle. wedges: where a segment lies between two surfaces, as a belt in a V-groove,
        their normal forces are larger than what turns it; the turning counts by their sum over that of the
        vectors.
        """
        t = tendon._target
        if not len(self.world.contacts):  # it has slipped off, and flies
            return
        first, last = t.tension[0], t.tension[-1]
        x = t.positions
        if pull is not None:
            first = np.linalg.norm(pull)
            x = np.concatenate([[x[0] + np.divide(pull, first)], x])
        turned = turning(x)
        held = self.wedged(t) if wedges else 1.0
        coefficient = 1.01 * friction * held
        grown = np.exp(coefficient * turned.sum())
        if edges:
            grown = 1.0 / np.maximum(np.cos(turned) - coefficient * np.sin(turned), 0.17).prod()
        grown /= np.cos(turned.max() / 2) ** chords
        message = (
            f"tensions {first:.4g} and {last:.4g} N, beyond a factor of {grown:.4g} (slack {slack:.3g} N)"
        )
        self.check(max(first, last) <= 1.01 * grown * max(min(first, last), 0) + slack, message)

    def wedged(self, tendon) -> float:
        """Normal forces over the size of their vectors' sum, on the segment where it is largest."""
        contacts = self.world.contacts
        own = contacts[contacts["tendon"] == tendon.name]
        largest = 1.0
        for segment in np.unique(own["segment"]):
            on_it = own[own["segment"] == segment]
            total = np.linalg.norm(on_it["normal_force"] @ on_it["normal"])
            largest = max(largest, on_it["normal_force"].sum() / max(total, 1e-300))
        return largest

    def inertia(self, tendon) -> float:
        """Sum of |mass x acceleration| over a tendon's particles [N]."""
        t = tendon._target
        old = next(v for other, v, _ in self._before if other is t)
        time = self.dt * (len(self.seconds) - self._looked)
        return float(t.masses @ np.linalg.norm(t.velocities - old, axis=1) / time)

    def restless(self, tendon) -> float:
        """Inertia and weight of a tendon's particles: the most that they can add to a tension [N]."""
        return self.inertia(tendon) + float(tendon._target.masses.sum()) * G


def ease(steps):
    """Lines that set s from 0 to 1, at rest at both ends."""
    return f"s = (k + 1) / {steps}", "s *= s * (3 - 2 * s)"


def turning(x):
    """Angles between neighbouring segments of a polyline (n, 3)."""
    way = np.diff(x, axis=0)
    way /= np.linalg.norm(way, axis=1)[:, None]
    across = np.linalg.norm(np.cross(way[:-1], way[1:]), axis=1)
    return np.arctan2(across, np.einsum("ij,ij->i", way[:-1], way[1:]))


def signed_to_mesh(sizes, x):
    """Distances (k,) to a closed mesh of triangles, negative inside (its winding number).

    Of even triangles the nearest one is among the 24 with the nearest centres. Where these are more than 4 mm
    away, a lower bound will do; there every sixth point is asked whether it is inside.
    """
    centres = sizes.mean(1)
    away, around = cKDTree(centres).query(x, min(24, len(sizes)))
    distance = away[:, 0] - np.linalg.norm(sizes - centres[:, None], axis=2).max()
    near = distance < 0.004
    for k in np.flatnonzero(near):
        distance[k] = brute_force.point_triangles(x[k], sizes[around[k]]).min()
    near |= np.arange(len(x)) % 6 == 0
    near &= (x >= sizes.min((0, 1))).all(1) & (x <= sizes.max((0, 1))).all(1)
    distance[near] *= np.where(np.abs(winding(x[near], sizes)) > 0.5, -1, 1)
    return distance


def nearest(first, second):
    """Smallest distance of two centrelines, or of one to itself beyond its neighbourhood.

    That is as far along as half of the tightest turn of a tube, pi radii.
    """
    x, y = first.positions, second.positions
    i, j = np.meshgrid(np.arange(len(x) - 1), np.arange(len(y) - 1), indexing="ij")
    pairs = np.ones(i.shape, bool)
    if first is second:
        h = first.rest_length / (len(x) - 1)
        pairs = (j - i - 1) * h >= np.pi * first.radius
    i, j = i[pairs], j[pairs]
    return (
        brute_force.segment_segments(x[i], x[i + 1], y[j], y[j + 1]).min(initial=np.inf) if len(i) else np.inf
    )


def winding(points, triangles):
    """How often a closed mesh goes around each point (van Oosterom and Strackee 1983)."""
    corner = triangles[None] - points[:, None, None]
    length = np.linalg.norm(corner, axis=-1)
    a, b, c = np.moveaxis(corner, 2, 0)
    la, lb, lc = np.moveaxis(length, 2, 0)
    dot = lambda u, v: np.einsum("...i,...i->...", u, v)  # noqa: E731
    above = dot(a, np.cross(b, c))
    below = la * lb * lc + dot(a, b) * lc + dot(b, c) * la + dot(c, a) * lb
    return np.arctan2(above, below).sum(-1) / (2 * np.pi)


def _plain(values):
    """Arguments with the objects behind what is recorded."""
    bare = lambda v: v._target if isinstance(v, Recorded) else v  # noqa: E731
    if isinstance(values, dict):
        return {k: bare(v) for k, v in values.items()}
    return [bare(v) for v in values]
