"""TendonWorld: the plug-in beside a pybullet client. One step in five rooms (see step)."""

import math
from time import perf_counter

import numpy as np
import pybullet as p

from . import _core, checks
from .bodies import Bodies, client_of
from .errors import InvalidType, InvalidValue, UnknownId
from .holds import Attachment
from .keeping import KeepsState
from .loading import load_urdf
from .material import Material
from .obstacles import Obstacles
from .options import SolverOptions
from .penetration import INSIDE
from .readouts import ReadsOut
from .relaxation import relax
from .report import CONTACT, PENETRATION, StepReport
from .sampling import particle_positions
from .stepping import TakesSteps
from .tendon import Tendon
from .tunnels import Tunnel


class TendonWorld(KeepsState, TakesSteps, ReadsOut):
    """The tendons of one pybullet client.

    physicsClientId: a connected client's number, or a BulletClient. options: SolverOptions.
    Gravity and the time step are pybullet's own, read at every step. Raises UnknownId or InvalidType.

    Threads: worlds share nothing that changes, so different threads can use different worlds at the same
    time, each with a pybullet client of its own. One world is used by one thread at a time: a script that
    reads or changes a world while another thread steps it has to take turns, by a lock of its own. The core
    lets other Python threads run while it solves.
    """

    def __init__(self, physicsClientId=0, options: SolverOptions | None = None):
        self._client = client_of(physicsClientId)
        super().__init__()
        self._connection = physicsClientId  # a BulletClient disconnects when nobody keeps it
        self._core = _core.World()
        self._bodies = Bodies(self._client)
        self._bodies.in_use = self._links_in_use
        self._obstacles = Obstacles(self._core, self._bodies)
        self._tendons: dict[int, Tendon] = {}
        self._tunnels: dict[int, Tunnel] = {}
        self._count = 0
        self._dt, self._last_gravity = 0.0, (0.0, 0.0, 0.0)  # of the last step
        self.options = SolverOptions() if options is None else options
        self._told, self._checked = (), (0.0, (0.0, 0.0, 0.0))  # pybullet's parameters, as told and checked
        self._report, self._unread = StepReport(), None

    @property
    def physicsClientId(self) -> int:
        return self._client

    @property
    def options(self) -> SolverOptions:
        """The solver's options; they can be replaced between steps."""
        return self._options

    @options.setter
    def options(self, value: SolverOptions) -> None:
        if not isinstance(value, SolverOptions):
            raise InvalidType("options", value, "SolverOptions")
        self._core.set_options(*value.core_arguments())
        self._options = value

    @property
    def tendons(self) -> tuple[Tendon, ...]:
        return tuple(self._tendons.values())

    @property
    def tunnels(self) -> tuple[Tunnel, ...]:
        return tuple(self._tunnels.values())

    def add_tendon(
        self,
        points,
        radius: float,
        material: Material,
        particles: int | None = None,
        name: str | None = None,
        inside: str = "allow",
    ) -> Tendon:
        """A tendon along the polyline points (m, 3) [m], world frame, at rest and without load.

        radius [m]; particles: resampled to that many, evenly by arc length (None: the points
        themselves). inside: what to do about a centreline that begins inside an obstacle, bores
        excepted: "allow" it, as for an insertion in a bone; "push_out" what is inside, the near way,
        until it clears the surface by about the radius; or "error". The last two raise InvalidValue where
        anything is (left) inside; see penetrations. Raises InvalidType or InvalidValue; then nothing
        has changed.
        """
        line = particle_positions(points, particles)
        radius = checks.number("radius", radius, above=0)
        area = math.pi * radius * radius
        if not 0 < area < math.inf:
            raise InvalidValue("radius", radius, "one with a finite cross-section > 0")
        if not isinstance(material, Material):
            raise InvalidType("material", material, "a Material")
        if checks.choice("inside", inside, INSIDE) != "allow":
            line = self._surroundings().cleared(line, radius, inside)
        name = f"tendon{self._next_number()}" if name is None else checks.text("name", name)
        if any(t.name == name for t in self.tendons):
            raise InvalidValue("name", name, "different from the names of the world's other tendons")
        m = material
        law = (m.stiffness, m.exponent, m.toe, m.tension_only, m.damping, m.damping_exponent)
        density = m.density * area
        stiffnesses = (m.shear_stiffness, m.bending_stiffness)
        whole = m.damping_form == "whole"
        slot = self._core.add_chain(line, radius, m.friction, *law, whole, *stiffnesses, density)
        tendon = Tendon(self, slot, name, radius, material)
        self._tendons[slot] = tendon
        return tendon

    def remove_tendon(self, tendon: Tendon) -> None:
        """Take a tendon out; its handles can no longer be used."""
        slot = self._slot_of("tendon", tendon, Tendon, self._tendons)
        del self._tendons[slot]
        tendon.removed = True
        self._core.remove_chain(slot)

    def add_obstacle(
        self,
        bodyUniqueId: int,
        linkIndex: int | None = None,
        friction: float | None = None,
        convex: bool | None = None,
        meshes=(),
    ) -> None:
        """Let tendons collide with a link (None: every link with a collision shape; -1: the base).

        friction: coefficient, multiplied with the tendon's; None: the body's lateralFriction.
        convex: whether meshes are convex hulls (True) or the triangles as they are (False); None:
        as pybullet holds them. meshes: for triangles that pybullet does not give back (those of
        createCollisionShape), in order: paths, or (vertices (v, 3) [m], triangles (t, 3)) in the
        shape's frame. Adding a link again replaces what was added. Raises InvalidType, InvalidValue
        or UnknownId; then nothing has changed.
        """
        self._obstacles.add(bodyUniqueId, linkIndex, friction, convex, meshes)

    def remove_obstacle(self, bodyUniqueId: int, linkIndex: int | None = None) -> None:
        """Let tendons no longer collide with a link (None: all links of the body)."""
        self._obstacles.remove(bodyUniqueId, linkIndex)

    def add_tunnel(
        self, bodyUniqueId, linkIndex, start, end, radius, friction=None, chamfer=0.0, name=None
    ) -> Tunnel:
        """A bore in a link, from start to end ((3,) each, in the link's URDF frame [m]).

        radius [m]; friction: coefficient of its wall, multiplied with the tendon's (None: the body's
        lateralFriction); chamfer: radius by which the mouths' edges are rounded [m]. The bone
        around it, if it is an obstacle, is not there within the bore. Raises InvalidType,
        InvalidValue or UnknownId; then nothing has changed.
        """
        self._bodies.require(bodyUniqueId, linkIndex)
        if len(self._tunnels) >= checks.MOST_TUNNELS:
            raise InvalidValue("tunnels", len(self._tunnels) + 1, f"at most {checks.MOST_TUNNELS}")
        start, end = checks.vector("start", start), checks.vector("end", end)
        radius = checks.number("radius", radius, above=0)
        chamfer = checks.number("chamfer", chamfer, at_least=0)
        length = float(np.linalg.norm(end - start))
        if length <= 2 * chamfer:
            raise InvalidValue("end", end, "farther from start than twice the chamfer")
        mu = self._obstacles.friction_of(bodyUniqueId, linkIndex, friction)
        name = f"tunnel{self._next_number()}" if name is None else checks.text("name", name)
        link = self._bodies.slot(bodyUniqueId, linkIndex)
        slot = self._core.add_tunnel(link, start, end, radius, chamfer, mu)
        where = (int(bodyUniqueId), int(linkIndex), start, end)
        tunnel = Tunnel(*where, radius, mu, chamfer, name, slot, link)
        self._tunnels[slot] = tunnel
        return tunnel

    def remove_tunnel(self, tunnel: Tunnel) -> None:
        """Fill a bore up again."""
        slot = self._slot_of("tunnel", tunnel, Tunnel, self._tunnels)
        del self._tunnels[slot]
        self._core.remove_tunnel(slot)

    def load_urdf(self, path: str, *args, obstacles: bool = True, **kwargs) -> int:
        """p.loadURDF(path, *args, **kwargs), and the file's <tunnel> and <tendon> elements.

        obstacles: whether every link with a collision shape becomes an obstacle. Returns the body's
        id. Raises UrdfError, naming file, element and attribute, before anything is loaded.
        """
        return load_urdf(self, path, args, kwargs, checks.flag("obstacles", obstacles))

    def step(self, n: int = 1) -> None:
        """n times: tendons, their reactions on the bodies, p.stepSimulation().

        Five rooms: sense (poses and inertia of touched links), near (distances that could matter),
        solve (the implicit step), react (wrenches), bullet (pybullet's own step).
        """
        for _ in range(checks.integer("n", n, at_least=1)):
            self.apply()
            start = perf_counter()
            p.stepSimulation(self._client)
            self._seconds["bullet"] = perf_counter() - start
            if self._core.any_held() and self._bodies.note(self._core):
                self._sense(self._dt, self._last_gravity)

    def apply(self) -> None:
        """step without p.stepSimulation, for a script that owns its loop: call it just before.

        Raises StepFailed, with the tendons as they were, where the step has no finite solution.
        """
        if not self._solve(*self._step_and_gravity()):
            return
        if self._bodies.links:
            start = perf_counter()
            self._bodies.push(self._core)
            self._seconds["react"] += perf_counter() - start

    def relax(self, tolerance: float = 1e-6, max_steps: int = 1000) -> None:
        """Static equilibrium of the tendons with the bodies held, directly; no time passes.

        tolerance: largest residual force over the largest force at hand [-]. Velocities are zero
        afterwards, pybullet is not stepped, nothing acts on bodies. The report tells iterations, residual
        and whether it converged within max_steps solutions. A tendon that can touch nothing is solved
        for at once, from however far away; with obstacles, tunnels or other tendons the way there is
        followed, so that nothing is passed through. Where nothing holds a tendon, all are put back and
        the report says that it did not converge. Raises InvalidType, InvalidValue or StepFailed.
        """
        tolerance = checks.number("tolerance", tolerance, above=0, at_most=1)
        relax(self, tolerance, checks.integer("max_steps", max_steps, at_least=1))

    def _links_in_use(self) -> set[int]:
        """Slots of the links that tunnels, obstacles and attachments refer to."""
        attached = {h.link_slot for t in self.tendons for h in t.holds if isinstance(h, Attachment)}
        return attached | {t.link_slot for t in self.tunnels} | self._obstacles.link_slots()

    def _names(self) -> dict[int, str]:
        return {slot: t.name for slot, t in self._tendons.items()}

    def _next_number(self) -> int:
        self._count += 1
        return self._count

    def _slot_of(self, argument, handle, kind, known) -> int:
        if not isinstance(handle, kind):
            raise InvalidType(argument, handle, f"a {kind.__name__}")
        slot = handle._slot if kind is Tendon else handle.slot
        if known.get(slot) is not handle:
            raise UnknownId(argument, handle, "one of this world, not removed")
        return slot


__all__ = ["CONTACT", "PENETRATION", "TendonWorld"]
