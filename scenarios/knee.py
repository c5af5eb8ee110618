"""KneeRig: a knee of ligaments and cartilage whose flexion is held and whose other five freedoms are free.

The rig is that of cadaver tests. The femur is turned about the z axis of the laboratory, to the flexion that
is wanted, and held there. The tibia hangs on five joints without friction: Grood and Suntay's three axes
(1983, J Biomech Eng 105:136) with the shifts along them and the rotations about the last two. So held flexion
is exact, and joint positions are coordinates. There is no gravity and there are no muscles.
"""

import math
import os
import tempfile
from collections import namedtuple
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
import pybullet as p

import bullet_tendon as bt
from bullet_tendon import checks
from bullet_tendon.errors import InvalidValue
from bullet_tendon.view import PALETTE

from .extensor import Extensor
from .knee_files import JOINTS, Strand, bone_paths, read_strands, tibia_urdf

TOE_STRAIN = 0.06  # up to which the law of a strand is a parabola (Blankevoort and Huiskes 1991) [-]
LOADED_AT = (0.0, -0.1, 0.0)  # m, of the tibia
INCREMENT = np.radians(5.0)  # of flexion, after which the knee is settled on its way
TOLERANCE = 1e-3  # of the unbalanced force where the knee has settled [N]
ARM = 0.1  # of the couple that makes a moment [m]
# Of JOINTS: mass or inertia [kg, kg m^2], and the arm at which a moment counts as a force [m].
INERTIA = np.array([2.7, 2.7, 0.1, 2.7, 0.0045])
LEVER = np.array([1.0, 1.0, 0.1, 1.0, 0.1])
LONGEST, SHORTEST = 1 / 120, 1 / 1920  # steps while the knee settles [s]
MOST_STEPS, MOST_WAITED = 500, 360  # in which the knee settles; in which it comes to rest
# Steps that were not solved, after which a knee is given up. Each has used up the budget of a step.
MOST_UNSOLVED = 5
TYPICAL = 1e3  # N: forces in a knee
MOST_RELAXATIONS = 60  # steps of Newton's method
NEARLY = 1e-6  # motion in a step at rest [m, rad]
# The mean place of so many steps is that of as many before, to [m] and [rad] of JOINTS.
WINDOW, SAME_PLACE = 12, np.array([5e-6, 5e-6, 1e-4, 5e-6, 1e-4])
# From the middle of the femur, after which a condyle has left its plateau: half of their widths, about 30 mm
# across and 50 mm from front to back [m]; the way up past the condyles, which are about as high; and the
# adduction that opens the knee as far [rad].
DISLOCATED_LATERAL, DISLOCATED_ANTERIOR, DISLOCATED_SUPERIOR, DISLOCATED_ADDUCTION = 0.015, 0.025, 0.015, 0.5
GONE = 2.0  # of these, beyond which no equilibrium is looked for
LINE_RADIUS = 8e-4  # of a strand in pictures [m]


_Joints = namedtuple("_Joints", [joint[0] for joint in JOINTS])


class Coordinates(NamedTuple):
    """Of the tibia in the femur, after Grood and Suntay: angles [rad], and shifts [m] of the tibia's origin.

    flexion about the femur's z axis, internal_rotation about the tibia's y axis (long axis), adduction about
    the floating axis that is perpendicular to both. lateral, anterior, superior: components of the way from
    the femur's to the tibia's origin along these axes, in this order: z of the femur, floating axis, y of the
    tibia.
    """

    flexion: float
    adduction: float
    internal_rotation: float
    anterior: float
    superior: float
    lateral: float


class _Step(NamedTuple):
    """A step while motion is damped: whether it was solved in one piece, and the tibia's joints in it."""

    whole: bool
    moved: np.ndarray  # [m, rad]
    accelerations: np.ndarray  # [m/s^2, rad/s^2]


class GroupForces(dict):
    """Tension by group [N]. The beginning of groups' names gives their sum: forces["ACL"]."""

    def __missing__(self, prefix):
        found = [
            force for group, force in self.items() if isinstance(prefix, str) and group.startswith(prefix)
        ]
        if not found:
            raise KeyError(prefix)
        return sum(found)


class KneeRig:
    """A right knee in a pybullet client of its own.

    bones, cartilage: meshes of femur and tibia, as a folder (femur.stl, tibia.stl; femur_cartilage.stl,
    tibia_cartilage.stl), two paths, or a mapping with the keys "femur" and "tibia". ligaments: a CSV table of
    strands in the columns of knee_files.COLUMNS, and CYLINDER where they pass around something, or a folder
    with ligaments.csv. None: the project's own knee. All meshes and the table are in the same frames, in
    metres: x anterior, y superior, z lateral, both bones' frames coincide at full extension. stiffness of a
    strand is in newtons per unit strain, its law is that of Material.ligament with a toe of 6 %.

    time_step [s]; options: SolverOptions of its world; gui: whether to open pybullet's window; modulus,
    poisson, thickness: of the cartilage, as in TendonWorld.add_cartilage. Raises InvalidType or InvalidValue.

    world: the TendonWorld; client: pybullet's; femur, tibia: (bodyUniqueId, linkIndex); strands: the files'
    rows by name; ligaments: handles by strand's name; cartilage: the handle; unsettled: how often the knee
    did not come to rest in joint, in settle, come_to_rest or flex. The client is closed by close(), or at
    the end of a with block.
    """

    def __init__(
        self,
        bones=None,
        ligaments=None,
        cartilage=None,
        *,
        world: bt.TendonWorld | None = None,
        step=None,
        time_step: float = 1 / 240,
        options: bt.SolverOptions | None = None,
        gui: bool = False,
        modulus: float = 10e6,
        poisson: float = 0.45,
        thickness: float = 0.006,
    ):
        meshes = bone_paths("bones", bones)
        surfaces = bone_paths("cartilage", cartilage, "_cartilage")
        self.strands = {strand.name: strand for strand in read_strands("ligaments", ligaments)}
        self.time_step = checks.number("time_step", time_step, above=0)
        foundation = {"modulus": modulus, "poisson": poisson, "thickness": thickness}
        self.unsettled = 0
        self._is_own = bones is None and cartilage is None
        self._extensor: Extensor | None = None
        self._owns_client = world is None
        self.client: int = p.connect(p.GUI if gui else p.DIRECT) if world is None else world.physicsClientId
        try:
            p.setTimeStep(self.time_step, self.client)
            self.world = bt.TendonWorld(self.client, options) if world is None else world
            self._step_world = self.world.step if step is None else step
            self._build(meshes, surfaces, foundation)
        except BaseException:
            self.close()
            raise

    def flex(
        self,
        angle: float,
        increment: float = INCREMENT,
        duration: float | None = None,
        max_steps: int = MOST_STEPS,
    ) -> bool:
        """Turn the femur to a flexion [rad] and hold it there, between -0.2 and 2.6.

        It goes there by increments [rad], under the present load, and settles after each but the last, in at
        most `max_steps` steps altogether. From where the knee does not come to rest, the femur is turned the
        rest of the way at once. Returns whether it came to rest everywhere on the way.

        With a duration [s] it turns at an even rate in that time instead, one step after the other, as
        tendons in its tunnels need it. Returns whether all steps were solved. Raises InvalidType,
        InvalidValue or StepFailed.
        """
        angle = checks.number("angle", angle, at_least=-0.2, at_most=2.6)
        increment = checks.number("increment", increment, above=0)
        left = checks.integer("max_steps", max_steps, at_least=1)
        if duration is not None:
            return self._turn_in(checks.number("duration", duration, above=0), angle)
        way = angle - self._flexion
        count = max(1, int(np.ceil(abs(way) / increment - 1e-9)))
        for k in range(1, count):
            self._turn(angle - way * (count - k) / count)
            at_rest, taken = self._settle(TOLERANCE, left)
            left -= taken
            if not at_rest or left == 0:
                self._turn(angle)
                return False
        self._turn(angle)
        return True

    def turn(self, angle: float) -> None:
        """Turn the femur to a flexion [rad] at once and hold it there, between -0.2 and 2.6.

        For motion step by step; `flex` goes there through equilibria. Raises InvalidType or InvalidValue.
        """
        self._turn(checks.number("angle", angle, at_least=-0.2, at_most=2.6))

    def load(
        self,
        anterior: float = 0.0,
        lateral: float = 0.0,
        superior: float = 0.0,
        internal: float = 0.0,
        valgus: float = 0.0,
        point=LOADED_AT,
    ) -> None:
        """Load the tibia, from now on, instead of the load before; all of it follows the tibia.

        anterior, lateral, superior: forces [N] along x, z and y of the tibia, at its `point` [m]. internal,
        valgus: moments [N m] about y and -x of the tibia. Raises InvalidType or InvalidValue.
        """
        names = "anterior", "superior", "lateral", "valgus", "internal"
        given = anterior, superior, lateral, valgus, internal
        values = [checks.number(name, value) for name, value in zip(names, given, strict=True)]
        point = checks.vector("point", point)
        self._force = np.array(values[:3])
        self._loads = self._as_forces(np.array([-values[3], values[4], 0.0]), point)

    def quadriceps(self, force: float) -> None:
        """Pull with a force of the quadriceps [N], from now on; of the project's own knee alone.

        The first call adds a patella with its tendon (extensor.py), which glides on the femur's cartilage.
        The knee is to be flexed by at most 20 degrees then, and by at most 90 under the pull. Raises
        InvalidType or InvalidValue.
        """
        force = checks.number("force", force, at_least=0)
        if self._extensor is None:
            if not self._is_own:
                raise InvalidValue("force", force, "given to the project's own knee: others have no patella")
            if self._flexion > np.radians(20.0) + 1e-9:
                raise InvalidValue("force", force, "first given at 20 degrees of flexion or less")
            self._extensor = Extensor(self)
        self._extensor.pull(force)

    def step(self, n: int = 1) -> None:
        """n steps of the world, under the load."""
        for _ in range(checks.integer("n", n, at_least=1)):
            self._push()
            self._step_world()

    def settle(self, tolerance: float = TOLERANCE, max_steps: int = MOST_STEPS) -> bool:
        """Let the knee come to rest under the load; whether it did within `max_steps` steps.

        tolerance: of the unbalanced force [N], and of the unbalanced moment over 0.1 m. The equilibrium is
        found by TendonWorld.relax, and seen by a step in which nothing moves. Where that fails, steps are
        taken with kinetic damping (Cundall), beside what implicit Euler damps. No time is meant to pass.
        Friction of tendons makes the end depend on the way. Large loads that come at once can also lead past
        an equilibrium that they would reach slowly.

        A load that the ligaments do not hold leads the tibia out of joint: it comes to rest `dislocated`, or
        goes beyond twice the displacements that this means. Then settle ends, and the tibia stays there until
        it is put back by place. It also ends after 5 steps that were not solved. Raises InvalidType,
        InvalidValue or StepFailed.
        """
        tolerance = checks.number("tolerance", tolerance, above=0)
        return self._settle(tolerance, checks.integer("max_steps", max_steps, at_least=1))[0]

    def come_to_rest(self, max_steps: int = MOST_WAITED) -> bool:
        """Let time pass until the tibia stays where it is; whether it did within `max_steps` steps.

        For tendons in the knee: they are led there by steps of `time_step`, with kinetic damping as in
        settle, and the tibia stays where its mean place in 12 steps is that in the 12 before. Strands in a
        bore can go to and fro between neighbouring contacts by some newtons, so that no single step is at
        rest. Raises InvalidType, InvalidValue or StepFailed.
        """
        max_steps = checks.integer("max_steps", max_steps, at_least=1)
        places: list[np.ndarray] = []

        def stays(_: _Step) -> bool:
            places.append(self._joints())
            if len(places) % WINDOW or len(places) < 2 * WINDOW:
                return False
            before, now = np.mean(places[-2 * WINDOW : -WINDOW], axis=0), np.mean(places[-WINDOW:], axis=0)
            return bool((np.abs(now - before) < SAME_PLACE).all())

        return self._damp(stays, max_steps, self.time_step, self.time_step)[0]

    @property
    def coordinates(self) -> Coordinates:
        """Where the tibia is in the femur, now."""
        at = _Joints(*self._joints().tolist())
        # The shifts are along axes that are not perpendicular: the tibia's y leans by the adduction.
        lean = math.sin(at.adduction)
        return Coordinates(
            flexion=self._flexion,
            adduction=at.adduction,
            internal_rotation=at.internal_rotation,
            anterior=at.anterior,
            superior=at.superior + lean * at.lateral,
            lateral=at.lateral + lean * at.superior,
        )

    @property
    def dislocated(self) -> bool:
        """Whether a condyle has left its plateau: the tibia is by 15 mm beside or above the place where the
        bones' frames coincide, by 25 mm before or behind it, or adducted or abducted by 0.5 rad. An
        equilibrium there tells nothing of the knee's laxity. settle and come_to_rest can find one.
        """
        return bool(self._displaced() > 1)

    @property
    def forces(self) -> GroupForces:
        """Tension of each group that was not cut, and the cartilage's force, as "cartilage" [N].

        With a quadriceps also "PT" (patellar tendon), "quadriceps" and "patellofemoral" (cartilage).
        """
        found = GroupForces()
        for name, ligament in self.ligaments.items():
            group = self.strands[name].group
            found[group] = found.get(group, 0.0) + ligament.force
        found["cartilage"] = float(np.linalg.norm(self.cartilage.wrench[:3]))
        if self._extensor is not None:
            found.update(self._extensor.forces)
        return found

    def cut(self, group: str) -> None:
        """Cut all strands of a group, or of all groups that begin with this name: cut("ACL").

        Raises InvalidType, or InvalidValue where there is none.
        """
        checks.text("group", group)
        cut = [name for name in self.ligaments if self.strands[name].group.startswith(group)]
        if not cut:
            groups = sorted({self.strands[name].group for name in self.ligaments})
            raise InvalidValue("group", group, f"the beginning of one of {', '.join(groups)}")
        for name in cut:
            self.world.remove_ligament(self.ligaments.pop(name))

    def lay(self, strand: Strand, name: str, share: float = 1.0) -> bt.Ligament:
        """Add a strand of a table to the world, with a share of its stiffness; it is not in `ligaments`."""
        bodies = {"femur": self.femur, "tibia": self.tibia}
        path = [(*bodies[bone], point) for bone, point in strand.path]
        wraps = [
            self.world.add_wrap(*bodies[c.bone], ("cylinder", c.radius), c.centre, c.orientation)
            for c in strand.cylinders
        ]
        material = bt.Material.ligament(share * strand.stiffness, TOE_STRAIN)
        return self.world.add_ligament(path, material, strand.slack, name, wraps)

    @property
    def joints(self) -> np.ndarray:
        """(5,) positions of knee_files.JOINTS [m, rad], for place()."""
        return self._joints()

    def place(self, joints, flexion: float | None = None) -> None:
        """Put the tibia where `joints` (5,) were read, at rest, and the femur at a flexion [rad], if given.

        Raises InvalidType or InvalidValue.
        """
        if flexion is not None:
            self._turn(checks.number("flexion", flexion, at_least=-0.2, at_most=2.6))
        for joint, position in enumerate(checks.vector("joints", joints, len(JOINTS))):
            p.resetJointState(self.tibia[0], joint, float(position), 0.0, self.client)

    def lines(self) -> tuple[list, list]:
        """The strands where they are now, as things to be drawn in a picture, and their colours by group."""
        tubes, colours = [], []
        groups = sorted({strand.group for strand in self.strands.values()})
        for name, ligament in self.ligaments.items():
            tubes.append(SimpleNamespace(positions=ligament.line, radius=LINE_RADIUS))
            colours.append(PALETTE[groups.index(self.strands[name].group) % len(PALETTE)])
        return tubes, colours

    def close(self) -> None:
        """Disconnect the client, if it is the rig's own; a second call does nothing."""
        if self._owns_client and p.isConnected(self.client):
            p.disconnect(self.client)

    def __enter__(self) -> "KneeRig":
        return self

    def __exit__(self, *_) -> None:
        self.close()

    def _build(self, meshes, surfaces, foundation: dict) -> None:
        self.femur = self._make_femur(meshes[0]), -1
        self.tibia = self._make_tibia(meshes[1]), len(JOINTS) - 1
        self._centre = np.array(p.getDynamicsInfo(*self.tibia, self.client)[3])
        self._turn(0.0)
        self.load()
        self.ligaments = {name: self.lay(strand, name) for name, strand in self.strands.items()}
        sides = [(*bone, path) for bone, path in zip((self.femur, self.tibia), surfaces, strict=True)]
        self.cartilage = self.world.add_cartilage(*sides, **foundation)

    def _make_femur(self, mesh) -> int:
        flags = p.GEOM_FORCE_CONCAVE_TRIMESH
        shape = p.createCollisionShape(
            p.GEOM_MESH, fileName=str(mesh), flags=flags, physicsClientId=self.client
        )
        look = p.createVisualShape(
            p.GEOM_MESH,
            fileName=str(mesh),
            rgbaColor=(0.93, 0.89, 0.78, 1),
            physicsClientId=self.client,
        )
        body = p.createMultiBody(0, shape, look, physicsClientId=self.client)
        self.world.add_obstacle(body, meshes=[str(mesh)])
        return body

    def _make_tibia(self, mesh) -> int:
        with tempfile.TemporaryDirectory() as folder:
            path = os.path.join(folder, "tibia.urdf")
            with open(path, "w", encoding="utf-8") as file:
                file.write(tibia_urdf(mesh))
            body = self.world.load_urdf(path, useFixedBase=True, flags=p.URDF_USE_INERTIA_FROM_FILE)
        for link in range(-1, len(JOINTS)):
            p.changeDynamics(
                body, link, linearDamping=0, angularDamping=0, jointDamping=0, physicsClientId=self.client
            )
            p.setCollisionFilterGroupMask(body, link, 0, 0, physicsClientId=self.client)
        joints = range(len(JOINTS))
        p.setJointMotorControlArray(
            body, joints, p.VELOCITY_CONTROL, forces=[0.0] * len(JOINTS), physicsClientId=self.client
        )
        return body

    def _joints(self, velocity: bool = False) -> np.ndarray:
        """(5,) positions, or rates, of JOINTS [m, rad]."""
        rows = p.getJointStates(self.tibia[0], range(len(JOINTS)), physicsClientId=self.client)
        return np.array([row[int(velocity)] for row in rows])

    def _stop(self) -> None:
        self.place(self._joints())

    def _turn(self, flexion: float) -> None:
        self._flexion = float(flexion)
        turn = p.getQuaternionFromEuler((0, 0, self._flexion))
        p.resetBasePositionAndOrientation(self.femur[0], (0, 0, 0), turn, self.client)

    def _turn_in(self, duration: float, angle: float) -> bool:
        start, steps, solved = self._flexion, max(1, round(duration / self.time_step)), True
        for k in range(1, steps + 1):
            self._turn(start + (angle - start) * k / steps)
            self.step()
            solved &= self.world.report.converged
        return solved

    def _settle(self, tolerance: float, max_steps: int) -> tuple[bool, int]:
        """Whether it came to rest, and the steps that this took."""

        def is_balanced(step: _Step) -> bool:
            unbalanced = np.abs(INERTIA / LEVER * step.accelerations).max()
            return step.whole and unbalanced <= tolerance and np.abs(step.moved).max() <= NEARLY

        self._stop()
        self._relax(tolerance)
        return self._damp(is_balanced, max_steps, LONGEST, SHORTEST)

    def _damp(self, is_at_rest, max_steps: int, longest: float, shortest: float) -> tuple[bool, int]:
        """Steps with kinetic damping until is_at_rest(step); whether it was, and the steps taken.

        Motion is stopped whenever the kinetic energy has passed a maximum. Steps [s] are halved where one had
        to be divided, because its forces are means of several places. At the end nothing moves.
        """
        step, last, unsolved = longest, 0.0, 0
        try:
            for taken in range(1, max_steps + 1):
                if not self._can_come_back():
                    break
                p.setTimeStep(step, self.client)
                places, rates = self._joints(), self._joints(velocity=True)
                self.step()
                now, report = self._joints(velocity=True), self.world.report
                whole = report.converged and not report.reasons
                if is_at_rest(_Step(whole, self._joints() - places, (now - rates) / step)):
                    self.unsettled += self.dislocated
                    return True, taken
                unsolved += not report.converged
                if unsolved >= MOST_UNSOLVED:
                    break
                energy, divides = INERTIA @ now**2, not whole and step > shortest
                if divides:
                    step /= 2
                if divides or energy < last:
                    self._stop()
                    energy = 0.0
                last = energy
        finally:
            p.setTimeStep(self.time_step, self.client)
            self._stop()
        self.unsettled += 1
        return False, taken

    def _relax(self, tolerance: float) -> None:
        """Put the tibia where the load is balanced. It stays where that is not found. Where the way there
        leads far out of joint (GONE), it goes up to the last place before that.

        Bodies that tendons are attached to are free as well.
        """
        bones = self.femur[0], self.tibia[0]
        held = {getattr(hold, "bodyUniqueId", bones[0]) for t in self.world.tendons for hold in t.holds}
        others = sorted(body for body in held - {*bones} if p.getDynamicsInfo(body, -1, self.client)[0] > 0)
        patella = [] if self._extensor is None else [self._extensor.patella]
        free = [self.tibia[0], *others, *patella]
        loads = [(*self.tibia, force, point, p.LINK_FRAME) for force, point in self._loads]
        largest = TYPICAL
        for _ in range(2):
            limits = {"max_steps": MOST_RELAXATIONS, "within": self._can_come_back, "quiet": True}
            self.world.relax(tolerance / largest, bodies=free, forces=loads, **limits)
            if not self.world.report.converged:
                return
            # The tolerance is of the largest force, which is known only now.
            at_hand = [*self.forces.values(), np.linalg.norm(self._force)]
            if self.world.report.residual * max(at_hand) <= tolerance:
                return
            largest = max(at_hand)

    def _displaced(self) -> float:
        """The largest displacement, over that from which the tibia is dislocated [-]."""
        at = self.coordinates
        return max(
            abs(at.lateral) / DISLOCATED_LATERAL,
            abs(at.anterior) / DISLOCATED_ANTERIOR,
            at.superior / DISLOCATED_SUPERIOR,
            abs(at.adduction) / DISLOCATED_ADDUCTION,
        )

    def _can_come_back(self) -> bool:
        return self._displaced() <= GONE

    def _push(self) -> None:
        """Put the load on the tibia for the next step."""
        for force, point in self._loads:
            self.world.apply_external_force(*self.tibia, force, point, p.LINK_FRAME)

    def _as_forces(self, moment, at) -> list:
        """(force, point) of the load, in the inertial frame of the tibia."""
        loads = [(self._force, at)] if self._force.any() else []
        size = np.linalg.norm(moment)
        if size > 0:
            axis = moment / size
            arm = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
            arm *= ARM / np.linalg.norm(arm)
            force = np.cross(moment, arm) / (2 * ARM**2)
            loads += [(force, arm), (-force, -arm)]
        return [(force, point - self._centre) for force, point in loads]
