"""TendonWorld: the plug-in beside a pybullet client; what a user calls, put together from its parts.

Owns: the compiled core, the tendons and tunnels by the core's slots, and one object for each concern, made
with what it needs: Bodies, Obstacles, Stepper, States, Readouts. Nothing is computed here. Goes with the
core's room `world`.
"""

import math
import weakref
from collections.abc import Callable, Sequence
from os import PathLike

import numpy as np
import pybullet as p
from numpy.typing import ArrayLike

from . import _core, checks
from .anchors import LinkAnchor, Numbers
from .bodies import Bodies, client_of
from .cartilage import LAWS, RESOLUTION, Cartilage, foundation_of, grid_of, look, side_of
from .description import describe, summary
from .equilibrium import Equilibrium, HeldTendons
from .errors import EquilibriumWarning, InvalidType, InvalidValue, NotCopied, UnknownId, warn
from .ligament import (
    Ligament,
    Wrap,
    checked_path,
    checked_rest,
    checked_wrap,
    path_length,
    points_of,
    wrap_arguments,
)
from .loading import load_urdf
from .material import Material
from .obstacles import Obstacles, core_friction
from .options import SolverOptions
from .penetration import INSIDE
from .placement import Placement
from .relaxation import Relaxation
from .reports import CONTACT, PENETRATION, Readouts, StepReport
from .states import States
from .step_listeners import StepListeners
from .stepper import Stepper
from .tendon import Tendon, particle_positions
from .tunnels import Tunnel

# Most of the rest length of a tendon in lengths of its polyline [-]. Particles nearer to each other than a
# millionth of the rest length between them are spread, so that the polyline would not be the one given.
MOST_SLACK = 1e5


class TendonWorld(NotCopied):
    """The tendons of one pybullet client.

    Gravity and the time step are pybullet's own, read at every step. Once the client is disconnected, what
    steps or changes the world and its tendons, or has to ask pybullet, raises UnknownId. What is known can
    still be read, saved and removed. Worlds and their handles cannot be copied or pickled (CannotCopy): see
    snapshot.

    Threads: worlds share nothing that changes, so different threads can use different worlds at the same
    time, each with a pybullet client of its own. One world is used by one thread at a time: a script that
    reads or changes a world while another thread steps it has to take turns, by a lock of its own. The core
    lets other Python threads run while it solves.

    Args:
        physicsClientId: a connected client's number, or a BulletClient.
        options: of the solver; None: the defaults.

    Raises:
        UnknownId: where no such client is connected.
        InvalidType: for what is neither a number nor a client, or no SolverOptions.

    Example:
        >>> fast = bt.TendonWorld(options=bt.SolverOptions(integrator="bdf2"))
        >>> fast.physicsClientId, fast.tendons
        (0, ())
    """

    def __init__(self, physicsClientId: int = 0, options: SolverOptions | None = None):
        client = client_of(physicsClientId)
        self._connection = physicsClientId  # a BulletClient disconnects when nobody keeps it
        self._core = _core.World()
        self._numbers = Numbers()
        self._tendons: dict[int, Tendon] = {}
        self._tunnels: dict[int, Tunnel] = {}
        self._ligaments: dict[int, Ligament] = {}  # another one after each change
        self._cartilages: dict[int, Cartilage] = {}
        parts = self._tendons, self._tunnels
        self._bodies = Bodies(client, self._core, self._links_in_use)
        self._obstacles = Obstacles(self._core, self._bodies)
        self._placement = Placement(self._bodies, self._obstacles, *parts)
        chosen = SolverOptions() if options is None else options
        places = self._core, self._bodies, self._obstacles
        self._stepper = Stepper(client, *places, self._placement, self._tendons, self._cartilages, chosen)
        self._states = States(*places, *parts, self._numbers, self._stepper)
        self._readouts = Readouts(*places, *parts)
        self._listeners = StepListeners()

    def __repr__(self) -> str:
        return summary(self)

    @property
    def physicsClientId(self) -> int:
        """Number of the pybullet client that its bodies are in."""
        return self._bodies.client

    @property
    def options(self) -> SolverOptions:
        """The solver's options; they can be replaced between steps. Raises InvalidType."""
        return self._stepper.options

    @options.setter
    def options(self, value: SolverOptions) -> None:
        self._stepper.options = value

    @property
    def tendons(self) -> tuple[Tendon, ...]:
        """Its tendons that were not removed, in the order in which they were added."""
        return tuple(self._tendons.values())

    @property
    def tunnels(self) -> tuple[Tunnel, ...]:
        """Its tunnels that were not removed, in the order in which they were added."""
        return tuple(self._tunnels.values())

    @property
    def ligaments(self) -> tuple[Ligament, ...]:
        """Its ligaments that were not removed, in the order in which they were added."""
        return tuple(self._ligaments.values())

    @property
    def cartilages(self) -> tuple[Cartilage, ...]:
        """Its cartilages that were not removed, in the order in which they were added."""
        return tuple(self._cartilages.values())

    def add_tendon(
        self,
        points: ArrayLike,
        radius: float,
        material: Material,
        particles: int | None = None,
        name: str | None = None,
        inside: str = "allow",
        rest_length: float | None = None,
        collides: bool = True,
    ) -> Tendon:
        """A tendon along a polyline, at rest.

        Args:
            points: (m, 3) the polyline [m], world frame.
            radius: of its cross-section [m], > 0.
            material: its law, density and friction.
            particles: resampled to that many, evenly by arc length; None: the points themselves.
            name: different from those of the world's other tendons; None: one is made up.
            inside: what to do about a centreline that begins inside an obstacle, bores excepted. "allow" it,
                as for an insertion in a bone; "push_out" what is inside or nearer than the radius, the near
                way, until the segments clear the surface by about the radius, but beside ends that begin so
                near; or "error". The last two raise InvalidValue where anything is (left) inside: see
                penetrations. The next step gives an InsideWarning for each link that it is inside of then,
                and not attached to there; and where obstacles are so near that they stretch it by 0.1 %.
            rest_length: length of its centreline without load [m], spread over the segments in proportion to
                their lengths; > 0, and at most 1e5 times the length of the polyline. The tendon starts where
                it is, under the tension that follows. None: it starts without load.
            collides: whether it makes contacts (see Tendon.collides). Clearance in bores, and what is inside,
                is looked at only where it does.

        Returns:
            The tendon's handle.

        Raises:
            InvalidType, InvalidValue: for what is out of range, also where it lies in a bore that is not
                wider than it is. Then nothing has changed.

        Example:
            >>> rope = world.add_tendon([(0, 0, 0), (0.1, 0, 0)], 0.002, material, particles=11, name="rope")
            >>> rope.positions.shape, rope.tension.shape
            ((11, 3), (10,))
            >>> world.add_tendon([(0, 0, 0), (0.1, 0, 0)], -0.002, material)
            Traceback (most recent call last):
            bullet_tendon.errors.InvalidValue: radius = -0.002: must be a finite number > 0
        """
        self._bodies.require_client()
        line = particle_positions(points, particles)
        radius = checks.number("radius", radius, above=0)
        area = math.pi * radius * radius
        if not 0 < area < math.inf:
            raise InvalidValue("radius", radius, "one with a finite cross-section > 0")
        if not isinstance(material, Material):
            raise InvalidType("material", material, "a Material")
        collides = checks.flag("collides", collides)
        if rest_length is not None:
            length = float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())
            rest_length = checks.number("rest_length", rest_length, above=0, at_most=MOST_SLACK * length)
        if checks.choice("inside", inside, INSIDE) != "allow" and collides:
            line = self._readouts.surroundings().cleared(line, radius, inside)
        if collides:
            self._placement.require_clearance("points", points, line, radius)
        name = f"tendon{self._numbers.next()}" if name is None else checks.text("name", name)
        if any(t.name == name for t in self.tendons):
            raise InvalidValue("name", name, "different from the names of the world's other tendons")
        slot = self._core.add_tendon(line, radius, material.friction, material.of_tendon(area))
        if rest_length is not None:
            rest = self._core.rest(slot)
            self._core.set_rest(slot, rest * (rest_length / rest.sum()))
            self._core.set_state(slot, line, np.zeros_like(line))
        if not collides:
            self._core.set_collides(slot, False)
        parts = self._core, self._bodies, self._placement, self._numbers
        tendon = Tendon(*parts, slot, name, radius, material)
        tendon._world = weakref.proxy(self)
        self._tendons[slot] = tendon
        self._placement.new.add(slot)
        self._placement.added.add(slot)
        return tendon

    def remove_tendon(self, tendon: Tendon) -> None:
        """Take a tendon out; its handles can no longer be used.

        Raises:
            InvalidType, UnknownId: where it is not one of this world's tendons.

        Example:
            >>> world.remove_tendon(tendon)
            >>> tendon.removed, world.tendons
            (True, ())
        """
        slot = self._slot_of("tendon", tendon, Tendon, self._tendons)
        _ = self._stepper.report  # which may name it
        del self._tendons[slot]
        tendon.removed = True
        self._placement.forget(slot)
        self._core.remove_tendon(slot)

    def add_obstacle(
        self,
        bodyUniqueId: int,
        linkIndex: int | None = None,
        friction: float | None = None,
        convex: bool | None = None,
        meshes: Sequence = (),
    ) -> None:
        """Let tendons collide with a link. Adding a link again replaces what was added.

        Args:
            bodyUniqueId: the body.
            linkIndex: the link, -1 for the base; None: every link with a collision shape.
            friction: coefficient, multiplied with the tendon's; None: the link's lateralFriction, as pybullet
                has it in each step.
            convex: whether meshes are convex hulls (True) or the triangles as they are (False); None: as
                pybullet holds them.
            meshes: for triangles that pybullet does not give back (those of createCollisionShape), in order:
                paths, (path, meshScale), or (vertices (v, 3) [m], triangles (t, 3)) in the shape's frame.
                They must be as large as pybullet's, and where pybullet has them. pybullet does not tell the
                meshScale of createCollisionShape.

        Raises:
            InvalidType, InvalidValue, UnknownId: then nothing has changed.

        Example:
            >>> world.add_obstacle(ball, friction=1.0)
            >>> tendon.collides_with(ball)
            True
        """
        self._obstacles.add(bodyUniqueId, linkIndex, friction, convex, meshes)
        self._placement.changed_obstacles(int(bodyUniqueId))

    def remove_obstacle(self, bodyUniqueId: int, linkIndex: int | None = None) -> None:
        """Let tendons no longer collide with a link.

        Args:
            bodyUniqueId: the body.
            linkIndex: the link, -1 for the base; None: all links of the body.

        Raises:
            InvalidType, InvalidValue, UnknownId: then nothing has changed.

        Example:
            >>> world.add_obstacle(ball)
            >>> world.remove_obstacle(ball)
            >>> world.remove_obstacle(ball)
            Traceback (most recent call last):
            bullet_tendon.errors.UnknownId: bodyUniqueId = 0: must be a body that was added as an obstacle
        """
        self._obstacles.remove(bodyUniqueId, linkIndex)
        self._placement.find_mouths(int(bodyUniqueId))

    def set_collision(self, a: Tendon, b: Tendon | int | tuple[int, int], enabled: bool) -> None:
        """Whether a tendon makes contacts with another one, with itself (b is a), or with a body.

        Of a link, its shapes and its tunnels are meant. A tendon that does not collide at all
        (Tendon.collides) makes none either way. The choice is part of the saved state.

        Args:
            a: the tendon.
            b: a Tendon; a bodyUniqueId: all its links that are obstacles or have tunnels now; or
                (bodyUniqueId, linkIndex).
            enabled: whether they collide.

        Raises:
            InvalidType, UnknownId: where a tendon was removed, a body or link does not exist, or is no
                obstacle and has no tunnel. Then nothing has changed.

        Example:
            >>> world.add_obstacle(ball)
            >>> world.set_collision(tendon, ball, False)
            >>> tendon.collides_with(ball)
            False
        """
        one = self._slot_of("a", a, Tendon, self._tendons)
        enabled = checks.flag("enabled", enabled)
        self._bodies.require_client()
        if isinstance(b, Tendon):
            self._core.set_tendons_collide(one, self._slot_of("b", b, Tendon, self._tendons), enabled)
            return
        for link in self._solid_slots("b", b):
            self._core.set_link_collides(one, link, enabled)
        if enabled:
            self._placement.new.add(one)

    def add_tunnel(
        self,
        bodyUniqueId: int,
        linkIndex: int,
        start: ArrayLike,
        end: ArrayLike,
        radius: float,
        friction: float | None = None,
        chamfer: float = 0.0,
        name: str | None = None,
    ) -> Tunnel:
        """A bore in a link, from start to end.

        The bone around it, if it is an obstacle, is not there within the bore. A mouth is where the bore
        meets the bone's surface, at whatever slope, if that is within two radii of the end given. Otherwise
        it is a circle across the axis at that end.

        Args:
            bodyUniqueId: the body.
            linkIndex: the link, -1 for the base.
            start, end: (3,) ends of its axis [m], in the link's URDF frame.
            radius: [m], > 0. A bore has to be wider than the tendons that lie in it.
            friction: coefficient of its wall, multiplied with the tendon's; None: the link's lateralFriction,
                as pybullet has it in each step.
            chamfer: radius by which the mouths' edges are rounded [m]; 0: sharp.
            name: of the bore; None: one is made up.

        Raises:
            InvalidType, InvalidValue, UnknownId: then nothing has changed.

        Example:
            >>> eyelet = world.add_tunnel(ball, -1, (0, 0, -0.01), (0, 0, 0.01), radius=0.003, name="eyelet")
            >>> eyelet.ends.round(3).tolist()
            [[0.0, 0.0, -0.12], [0.0, 0.0, -0.1]]
        """
        self._bodies.require(bodyUniqueId, linkIndex)
        start, end = checks.vector("start", start), checks.vector("end", end)
        radius = checks.number("radius", radius, above=0)
        chamfer = checks.number("chamfer", chamfer, at_least=0)
        if not 2 * chamfer < math.dist(start, end) < 1e150:  # its square is a number
            raise InvalidValue(
                "end", end, "farther from start than twice the chamfer, and nearer than 1e150 m"
            )
        if friction is not None:
            friction = checks.number("friction", friction, at_least=0)
        self._placement.require_width(bodyUniqueId, linkIndex, start, end, radius)
        name = f"tunnel{self._numbers.next()}" if name is None else checks.text("name", name)
        where = (int(bodyUniqueId), int(linkIndex), start, end)
        link = self._bodies.slot(bodyUniqueId, linkIndex)
        slot = self._core.add_tunnel(link, start, end, radius, chamfer, core_friction(friction))
        tunnel = Tunnel(*where, radius, chamfer, name, slot, link, friction, self._bodies, self._core)
        self._tunnels[slot] = tunnel
        self._placement.find_mouths_of(tunnel)
        return tunnel

    def remove_tunnel(self, tunnel: Tunnel) -> None:
        """Fill a bore up again. The next step gives an InsideWarning of a tendon that lies in it.

        Raises:
            InvalidType, UnknownId: where it is not one of this world's tunnels.

        Example:
            >>> eyelet = world.add_tunnel(ball, -1, (0, 0, -0.01), (0, 0, 0.01), radius=0.003)
            >>> world.remove_tunnel(eyelet)
            >>> world.tunnels
            ()
        """
        slot = self._slot_of("tunnel", tunnel, Tunnel, self._tunnels)
        del self._tunnels[slot]
        self._core.remove_tunnel(slot)
        self._placement.filled(tunnel.bodyUniqueId)

    def add_wrap(
        self,
        bodyUniqueId: int,
        linkIndex: int,
        shape: tuple,
        position: ArrayLike,
        orientation: ArrayLike = (0, 0, 0, 1),
    ) -> Wrap:
        """A surface of a link that ligaments wrap around without friction: see add_ligament.

        Args:
            bodyUniqueId: the body.
            linkIndex: the link, -1 for the base.
            shape: ("sphere", radius), ("cylinder", radius) or ("ellipsoid", (a, b, c)) [m], with the
                semi-axes along x, y and z, at most 10 times as long as each other. A cylinder has no ends.
            position: (3,) of its centre, in the link's URDF frame [m].
            orientation: quaternion (x, y, z, w) in that frame; a cylinder's axis is its z.

        Raises:
            InvalidType, InvalidValue, UnknownId: then nothing has changed.

        Example:
            >>> roller = world.add_wrap(ball, -1, ("cylinder", 0.01), (0, 0, 0), (0.5**0.5, 0, 0, 0.5**0.5))
            >>> roller.axes[:, 2].round(3).tolist()
            [0.0, -1.0, 0.0]
        """
        return checked_wrap(self._bodies, bodyUniqueId, linkIndex, shape, position, orientation)

    def add_ligament(
        self,
        path: Sequence,
        material: Material,
        rest_length: float | None = None,
        name: str | None = None,
        wraps: Sequence = (),
    ) -> Ligament:
        """A massless ligament along a path of points of links, sliding freely through the inner ones.

        It acts on all its bodies implicitly, together with tendons. Links that cannot move cost nothing. It
        touches nothing by itself, and its bodies take implicit Euler. It needs SolverOptions with
        iteration="newton" and an implicit integrator. It gives a SlackWarning where the rest length is more
        than a quarter beyond the path.

        Args:
            path: two points or more, each (bodyUniqueId, linkIndex, (x, y, z)) in the link's URDF frame [m].
                The ligament is straight between them.
            material: its axial law is taken, as that of a cross-section: stiffness, exponent, toe_strain,
                tension_only, damping, relaxation, rupture.
            rest_length: [m], > 0; None: the length of the path now.
            name: of the ligament; None: one is made up.
            wraps: of add_wrap; between two points of the path it takes the shortest way around the first of
                them that is in its way. One whose surface encloses a point of the path is left out there.

        Raises:
            InvalidType, InvalidValue, UnknownId: a path on one link alone, for one; then nothing has changed.

        Example:
            >>> stand = p.createMultiBody(0)
            >>> path = [(stand, -1, (0, 0, 0)), (ball, -1, (0, 0, 0))]
            >>> line = world.add_ligament(path, bt.Material(stiffness=100, damping=5), name="line")
            >>> world.step(240)
            >>> round(line.force, 3), round(line.strain, 4)
            (0.981, 0.0098)
        """
        self._stepper.require_iterating("add_ligament")
        path = checked_path(self._bodies, path)
        if not isinstance(material, Material):
            raise InvalidType("material", material, "a Material")
        if material.damping > 0 and material.damping_form == "whole":
            raise InvalidValue("material", material, 'one whose damping_form is "axial" or "lengthening"')
        name = f"ligament{self._numbers.next()}" if name is None else checks.text("name", name)
        if any(ligament.name == name for ligament in self.ligaments):
            raise InvalidValue("name", name, "different from the names of the world's other ligaments")
        if not isinstance(wraps, (tuple, list)) or not all(isinstance(wrap, Wrap) for wrap in wraps):
            raise InvalidType("wraps", wraps, "a sequence of what add_wrap has returned")
        wraps = tuple(wraps)
        for wrap in wraps:
            self._bodies.require(wrap.bodyUniqueId, wrap.linkIndex, "wraps")
        length = path_length(points_of(self._bodies, path))
        rest = checks.number("path", length, above=0) if wraps else checked_rest(name, rest_length, length)
        if wraps and rest_length is not None:
            checks.number("rest_length", rest_length, above=0)
        slots = [self._bodies.slot(body, link) for body, link, _ in path]
        around = wrap_arguments(self._bodies, wraps)
        points = [at for *_, at in path]
        slot = self._core.add_ligament(slots, points, rest, material.of_ligament(), around)
        ligament = Ligament(self._core, self._bodies, slot, name, material, path, wraps)
        self._ligaments = {**self._ligaments, slot: ligament}
        if wraps:
            ligament.rest_length = checked_rest(name, rest_length, ligament.length)
        return ligament

    def remove_ligament(self, ligament: Ligament) -> None:
        """Cut a ligament; its handle can no longer be used.

        Args:
            ligament: of this world.

        Raises:
            InvalidType, UnknownId: not one of this world's ligaments.

        Example:
            >>> stand = p.createMultiBody(0)
            >>> line = world.add_ligament([(stand, -1, (0, 0, 0)), (ball, -1, (0, 0, 0))], material)
            >>> world.remove_ligament(line)
            >>> line.removed, world.ligaments
            (True, ())
        """
        slot = self._slot_of("ligament", ligament, Ligament, self._ligaments)
        self._ligaments = {number: kept for number, kept in self._ligaments.items() if number != slot}
        ligament.removed = True
        self._core.remove_ligament(slot)

    def add_cartilage(
        self,
        first: tuple,
        second: tuple,
        modulus: float = 10e6,
        poisson: float = 0.45,
        thickness: float = 0.006,
        damping: float | None = None,
        spacing: float = 0.0005,
        cache: bool = False,
        name: str | None = None,
        resolution: float | None = None,
        law: str = "linear",
    ) -> Cartilage:
        """Cartilage between two links: an elastic foundation of surface B against the distance to surface A.

        Each point of B that is at a depth d behind A is pushed out along the gradient of the distance by the
        pressure p = K d, K = E (1 - nu)/((1 + nu)(1 - 2 nu))/thickness (Bei and Fregly 2004), times the area
        of the triangles for which it stands. With law="logarithmic" the pressure of a layer of thickness h is
        p = -K h ln(1 - d/h) (Blankevoort et al. 1991): it is K d of small depths, and grows without bound
        towards d = h. Where d exceeds the thickness, a step gives a CartilageWarning, once for each
        cartilage; behind two thicknesses nothing is pushed out. The distance is measured once, on a grid of
        nodes, with smooth interpolation. It acts implicitly, together with ligaments and tendons, and has no
        friction. Surfaces may be open: nothing is behind their borders. pybullet's own contact between the
        two links has to be switched off. It needs SolverOptions with iteration="newton" and an implicit
        integrator. It gives a CartilageWarning where the surfaces are more than 50 mm apart, or do not face
        each other.

        Args:
            first: (bodyUniqueId, linkIndex, mesh) of A. mesh: the path of an STL or OBJ file, or (vertices
                (v, 3) [m], triangles (t, 3)), in the link's URDF frame; its faces look outwards.
            second: the same of B.
            modulus: E [Pa], > 0.
            poisson: nu [-], >= 0 and < 0.5.
            thickness: of both layers together [m], at least the spacing.
            damping: c [s/m] of the factor 1 + c dd/dt of the pressure (Hunt and Crossley 1975); None: none.
            spacing: of the grid's nodes [m].
            cache: keeps the grid in a file beside the mesh of A, which has to be a path.
            name: of the cartilage; None: one is made up.
            resolution: sides of the boxes within which triangles of B that face the same way are merged into
                one point, with their area and their centre of area [m]; None: the spacing; 0: none are. The
                force differs from that of all triangles by less than 1 % where about a hundred of the points
                are pressed.
            law: "linear" or "logarithmic". The latter is followed up to 0.95 thickness, where p = 3 K h, and
                goes on along its tangent.

        Raises:
            InvalidType, InvalidValue, UnknownId: a closed mesh that is wound inwards, or a layer that is
                thinner than the spacing, for two; then nothing has changed.

        Example:
            >>> plate = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]) * 0.02 - (0.01, 0.01, 0)
            >>> lower, upper = (plate, [(0, 1, 2), (0, 2, 3)]), (plate, [(0, 2, 1), (0, 3, 2)])
            >>> stand = p.createMultiBody(0, basePosition=(0, 0, -0.11))
            >>> pad = world.add_cartilage((stand, -1, lower), (ball, -1, upper), damping=1.0)
            >>> world.step(240)
            >>> round(pad.max_pressure, 1), round(pad.foundation / 1e9, 3)
            (2452.5, 6.322)
        """
        self._stepper.require_iterating("add_cartilage")
        link_a, surface_a, file = side_of(self._bodies, "first", first)
        link_b, surface_b, _ = side_of(self._bodies, "second", second)
        if link_a == link_b:
            raise InvalidValue("second", link_b, "another link than the first")
        spacing = checks.number("spacing", spacing, above=0)
        thickness = checks.number("thickness", thickness, above=0)
        if thickness < spacing:
            raise InvalidValue("thickness", thickness, f"at least the grid's spacing of {spacing:g} m")
        if resolution is None:
            resolution = RESOLUTION * spacing
        resolution = checks.number("resolution", resolution, at_least=0)
        foundation = foundation_of(modulus, poisson, thickness)
        damping = 0.0 if damping is None else checks.number("damping", damping, at_least=0)
        logarithmic = checks.choice("law", law, LAWS) == "logarithmic"
        if checks.flag("cache", cache) and file is None:
            raise InvalidValue("cache", cache, "False for a mesh that is not a path")
        name = f"cartilage{self._numbers.next()}" if name is None else checks.text("name", name)
        if any(cartilage.name == name for cartilage in self.cartilages):
            raise InvalidValue("name", name, "different from the names of the world's other cartilages")
        beside = file.with_suffix(f"{file.suffix}.distances.npz") if cache else None
        grid = grid_of(surface_a, spacing, thickness, beside)
        normals = surface_b.normals
        areas = np.linalg.norm(normals, axis=1)
        slots = [self._bodies.slot(*link) for link in (link_a, link_b)]
        slot = self._core.add_cartilage(
            slots[0],
            grid,
            slots[1],
            surface_b.corners.mean(axis=1),
            areas,
            surface_b.patches(),
            normals / areas[:, None],
            resolution,
            foundation,
            thickness,
            logarithmic,
            damping,
        )
        layer = foundation, thickness
        cartilage = Cartilage(self._core, self._bodies, slot, name, (link_a, link_b), layer)
        self._cartilages[slot] = cartilage
        self._bodies.read()
        look(name, self._core, slot, surface_b)
        return cartilage

    def remove_cartilage(self, cartilage: Cartilage) -> None:
        """Take cartilage out; its handle can no longer be used.

        Args:
            cartilage: of this world.

        Raises:
            InvalidType, UnknownId: not one of this world's cartilages.

        Example:
            >>> plate = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]) * 0.02 - (0.01, 0.01, 0)
            >>> lower, upper = (plate, [(0, 1, 2), (0, 2, 3)]), (plate, [(0, 2, 1), (0, 3, 2)])
            >>> stand = p.createMultiBody(0, basePosition=(0, 0, -0.11))
            >>> pad = world.add_cartilage((stand, -1, lower), (ball, -1, upper))
            >>> world.remove_cartilage(pad)
            >>> world.cartilages
            ()
        """
        slot = self._slot_of("cartilage", cartilage, Cartilage, self._cartilages)
        del self._cartilages[slot]
        cartilage.removed = True
        self._core.remove_cartilage(slot)

    def load_urdf(self, path: str | PathLike, *args, obstacles: bool = True, **kwargs) -> int:
        """``p.loadURDF(path, *args, **kwargs)``, and the file's <tunnel> and <tendon> elements.

        With `globalScaling` these are as much larger as the links: points in links, radii and chamfers.
        Materials, and points in the world frame, stay.

        Args:
            path: of the file.
            obstacles: whether every link with a collision shape becomes an obstacle.

        Returns:
            The body's id.

        Raises:
            UrdfError: naming file, element and attribute, before anything is loaded.

        Example:
            >>> path, flags = bt.data_path("tendon_finger.urdf"), p.URDF_USE_INERTIA_FROM_FILE
            >>> finger = world.load_urdf(path, useFixedBase=True, flags=flags)
            >>> [tendon.name for tendon in world.tendons[1:]], len(world.tunnels)
            (['flexor', 'extensor'], 8)
        """
        self._bodies.require_client()
        return load_urdf(self, path, args, kwargs, checks.flag("obstacles", obstacles))

    def step(self, n: int = 1) -> None:
        """n times: tendons, their reactions on the bodies, p.stepSimulation().

        Five rooms: sense (poses and inertia of touched links), near (distances that could matter), solve (the
        implicit step), react (wrenches), bullet (pybullet's own step).

        Args:
            n: how many steps, >= 1.

        Raises:
            StepFailed, UnknownId, InvalidValue: as apply does.

        Example:
            >>> hand = tendon.grip(0)
            >>> world.step(240)
            >>> world.report.converged
            True
        """
        self._listeners.next_begins()
        for _ in range(checks.integer("n", n, at_least=1)):
            self._stepper.step()
            self._listeners.complete()

    def apply(self) -> None:
        """A step without p.stepSimulation, for a script that owns its loop: call it just before.

        Forces are read after p.stepSimulation. Only what the bodies do in that tells whether what holds one
        has let it go, or whether an unknown force has pulled at it. Then the next apply solves the step
        again and gives the bodies the difference of the impulses. wrench and the force of grips and
        attachments contain that difference from then on, as a force over the next step: its mean over time,
        and its impulse between two readings, are right; that of a single step can be late. `step` finds a
        release right after p.stepSimulation, and pulls late, as here. Contacts and tensions are those of the
        last step alone.

        Raises:
            StepFailed: where the step has no finite solution (see SolverOptions.on_failure), with the tendons
                as they were.
            UnknownId: where the client was disconnected, or a body removed that something here refers to.
            InvalidValue: where pybullet's time step, gravity or a body is not finite.

        Example:
            >>> for _ in range(10):
            ...     world.apply()
            ...     _ = p.stepSimulation()
        """
        self._listeners.next_begins()
        self._stepper.apply()
        self._listeners.applied()

    def apply_external_force(
        self, bodyUniqueId: int, linkIndex: int, forceObj: ArrayLike, posObj: ArrayLike, flags: int
    ) -> None:
        """p.applyExternalForce, of which the tendons know before they are stepped.

        A force that is given to pybullet alone is seen only by what it has done. Where it pulls at a tendon,
        the step is then solved again, and a light body can be far away by then.

        Args:
            bodyUniqueId: the body.
            linkIndex: the link, -1 for the base.
            forceObj: (3,) force during the next step [N].
            posObj: (3,) the point that it acts at [m].
            flags: p.WORLD_FRAME; or p.LINK_FRAME, for both in the link's inertial frame, as pybullet takes
                it.

        Raises:
            InvalidType, InvalidValue, UnknownId: then nothing has changed.

        Example:
            >>> hand, knot = tendon.grip(0), tendon.attach(-1, ball)
            >>> for _ in range(480):
            ...     centre, _ = p.getBasePositionAndOrientation(ball)
            ...     world.apply_external_force(ball, -1, (0, 0, -20), centre, p.WORLD_FRAME)
            ...     world.step()
            >>> print(f"{knot.force[2]:.2f} N")  # 20 N and the weight of 0.1 kg
            20.98 N
        """
        given = self._checked_force(bodyUniqueId, linkIndex, forceObj, posObj, flags)
        self._bodies.apply_external_force(*given)

    def apply_joint_force(self, bodyUniqueId: int, jointIndex: int, force: float) -> None:
        """p.setJointMotorControl2 with p.TORQUE_CONTROL, of which the tendons know before they are stepped.

        pybullet does not report what a controller puts on joints. It is seen only by what it has done, a step
        late. Tell the tendons of stiff controllers, and of torques that begin or end at once. `relax` does
        not count them.

        Args:
            bodyUniqueId: the body.
            jointIndex: a hinge or a slider of it, whose own motor is switched off or goes on.
            force: during the next step, along or about the joint's axis [N], [N m].

        Raises:
            InvalidType, InvalidValue, UnknownId: then nothing has changed.

        Example:
            >>> path = bt.data_path("tendon_finger.urdf")
            >>> finger = p.loadURDF(path, useFixedBase=True)
            >>> p.setJointMotorControl2(finger, 0, p.VELOCITY_CONTROL, force=0)
            >>> for _ in range(24):
            ...     world.apply_joint_force(finger, 0, 0.02)
            ...     world.step()
        """
        force = checks.number("force", force)
        self._bodies.require_joint(bodyUniqueId, jointIndex)
        self._bodies.apply_joint_force(int(bodyUniqueId), int(jointIndex), force)

    def relax(
        self,
        tolerance: float = 1e-6,
        max_steps: int = 1000,
        bodies: Sequence = (),
        forces: Sequence = (),
        within: Callable[[], bool] | None = None,
        quiet: bool = False,
    ) -> None:
        """Static equilibrium of the tendons with the bodies held, directly; no time passes.

        With `bodies`, these are put first where ligaments, cartilage, tendons, gravity, `forces` and those
        told by apply_external_force balance, by Newton's method, and are at rest there. Tendons that touch
        these bodies, or are attached to them, follow in small steps. Other bodies, and joints that
        are not listed, stay where they are. Limits of joints act; motors, contacts and constraints of
        pybullet do not.
        Where no equilibrium is found, nothing has moved, the report says that it did not converge, and an
        EquilibriumWarning says why. There may be none: a load can be more than what holds the bodies.

        Velocities are zero afterwards, pybullet is not stepped, nothing acts on bodies. The report tells
        iterations, residual and whether it converged. A tendon that can touch nothing is solved for at once,
        from however far away. With obstacles, tunnels or other tendons the way there is followed, so that
        nothing is passed through. Where nothing holds a tendon, all are put back and the report says that it
        did not converge.

        Args:
            tolerance: largest residual force over the largest force at hand [-]. The weight that the heaviest
                of `bodies` has on earth counts as one.
            max_steps: the most solutions.
            bodies: what is free, each a bodyUniqueId (a rigid body, or a body with all its joints and, unless
                it is fixed, its base), or (bodyUniqueId, joints) for some of its hinges and sliders.
            forces: on these, for this call alone, each (bodyUniqueId, linkIndex, forceObj, posObj, flags) as
                apply_external_force takes it. Those with p.LINK_FRAME follow the link.
            within: tells whether pybullet's bodies may be where they are, such as in a joint that a load can
                dislocate. The search ends where a step leads to a place where they may not. They stay at the
                last place before it, and the report says that it did not converge.
            quiet: leaves the EquilibriumWarning out, for callers who read the report.

        Raises:
            InvalidType, InvalidValue, UnknownId: for arguments out of range, or bodies that cannot be free.
            StepFailed: where there is no finite solution.

        Example:
            >>> hand = tendon.grip(0)
            >>> tendon.set_point_mass(-1, 1.0)
            >>> world.relax()
            >>> print(f"{tendon.tension[-1]:.3f} N, {1e3 * (tendon.length - tendon.rest_length):.3f} mm")
            9.811 N, 0.098 mm

            A ball on a ligament:

            >>> stand = p.createMultiBody(0)
            >>> line = world.add_ligament([(stand, -1, (0, 0, 0)), (ball, -1, (0, 0, 0))], material)
            >>> world.relax(bodies=[ball])
            >>> round(line.force, 4), world.report.converged
            (0.981, True)
        """
        tolerance = checks.number("tolerance", tolerance, above=0, at_most=1)
        max_steps = checks.integer("max_steps", max_steps, at_least=1)
        if not isinstance(bodies, (tuple, list)):
            raise InvalidType("bodies", bodies, "a sequence of bodyUniqueIds or (bodyUniqueId, joints)")
        if not isinstance(forces, (tuple, list)):
            raise InvalidType("forces", forces, "a sequence")
        if forces and not bodies:
            raise InvalidValue("forces", forces, "none where no bodies are free")
        if within is not None and not callable(within):
            raise InvalidType("within", within, "a function without arguments, or None")
        quiet = checks.flag("quiet", quiet)
        if bodies:
            has_tendons_left = self._balance(bodies, forces, tolerance, max_steps, within, quiet)
            for cartilage in self.cartilages:
                cartilage._tell_flat()
            if not has_tendons_left:
                return
        self._relaxation().run(tolerance, max_steps)

    @property
    def report(self) -> StepReport:
        """What the last step did and what it skipped; of a step that failed, what was tried."""
        return self._stepper.report

    def describe(self) -> str:
        """What is in the world, what the last step cost by room, what it skipped, and advice: lines of text.

        Advice is given on tendons that turn far at a particle on a body, that move by more than their radius
        a step, that are overdamped, or not damped where the integrator does not either; on obstacles without
        friction; on tendons inside of bodies; and on steps that were not solved.

        Raises:
            UnknownId: the client was disconnected, or an obstacle's body removed.

        Example:
            >>> world.step()
            >>> print(world.describe().splitlines()[0])
            TendonWorld of client 0: 1 tendon (11 particles)
        """
        self._bodies.require_client()
        return describe(self)

    @property
    def contacts(self) -> np.ndarray:
        """Structured array of the last step's contacts (fields: reports.CONTACT), sorted by tendon.

        position: (3,) on the centreline [m]; normal: (3,) from the body to the tendon; distance between the
        surfaces [m], negative where they overlap; forces [N]. kind: "bone", "bore", "mouth" or "tendon"
        (another tendon, or the tendon itself; bodyUniqueId is then -1).
        """
        return self._readouts.contacts()

    def wrench(self, bodyUniqueId: int, linkIndex: int = -1) -> np.ndarray:
        """Force and torque of all tendons on a link, the mean over the last step.

        As Attachment.force, it contains what the step before it lacked when it was read (see apply).
        On a free body that turns by a tenth of a radian or more within the step, or would be swung by half of
        one, arms are those that it turns to.

        Args:
            bodyUniqueId: the body.
            linkIndex: the link, -1 for the base. Static links have one too.

        Returns:
            (6,) force [N] and torque about the centre of mass [N m], world frame. Zero for links that no
            tendon can touch.

        Raises:
            InvalidType, InvalidValue, UnknownId: for what is no link.

        Example:
            >>> hand, knot = tendon.grip(0), tendon.attach(-1, ball)
            >>> world.step(480)
            >>> print(f"{world.wrench(ball)[2]:.3f} N")
            0.981 N
        """
        return self._readouts.wrench(bodyUniqueId, linkIndex)

    def penetrations(self) -> np.ndarray:
        """The tendons' segments that are inside an obstacle or cross its surface, now.

        Stretches in a bore of the link are left out. Obstacles added after a tendon are seen too. No step
        asks for this.

        Returns:
            A structured array with the fields reports.PENETRATION. position (3,): the deepest point of the
            segment's centreline [m]; normal (3,): the near way out; depth [m] of that point beneath the
            surface. Open surfaces have no inside: where they are crossed, depth and normal are nan.

        Raises:
            UnknownId: where an obstacle's body was removed from pybullet, or the client disconnected.

        Example:
            >>> world.add_obstacle(ball)
            >>> needle = world.add_tendon([(0, 0.05, -0.11), (0, -0.05, -0.11)], 0.001, material, particles=5)
            >>> print(f"{1e3 * world.penetrations()['depth'].max():.1f} mm")
            10.0 mm
        """
        return self._readouts.penetrations()

    def save_state(self) -> int:
        """Keep all state of the tendons in memory.

        Positions, velocities, the integrator's history, multipliers, friction anchors, contact planes,
        memberships of tunnels, rest lengths, forces, holds, the last step's contacts, length and gravity.
        Not: the options, and pybullet's bodies, for which p.saveState stands beside it. That in turn does not
        keep forces that were applied and not stepped yet, the time step, gravity, motor commands and bodies
        added or removed since.

        Returns:
            An id for restore_state and remove_state.

        Example:
            >>> state, before = world.save_state(), world.state_hash()
            >>> world.step(10)
            >>> world.restore_state(state)
            >>> world.state_hash() == before
            True
        """
        return self._states.save()

    def restore_state(self, state: int) -> None:
        """Put the state of save_state back; it can be put back any number of times.

        Together with p.restoreState the run then goes on with the same bits. Grips and attachments made since
        are released; those released since hold again, and their handles with them.

        Raises:
            UnknownId: for what is no saved state.
            StateMismatch: where tendons, tunnels or obstacles were added, removed or replaced since, or
                bodies that they refer to removed. Then nothing has changed.

        Example:
            >>> state = world.save_state()
            >>> hand = tendon.grip(0)
            >>> world.restore_state(state)
            >>> hand.released
            True
        """
        self._bodies.require_client()
        self._states.restore(state)

    def remove_state(self, state: int) -> None:
        """Forget a saved state.

        Raises:
            UnknownId, InvalidType: for what is no saved state.

        Example:
            >>> world.remove_state(world.save_state())
        """
        self._states.remove(state)

    def state_hash(self) -> str:
        """A hash of the whole state, options included: equal for equal bits.

        Example:
            >>> before = world.state_hash()
            >>> world.step()
            >>> world.state_hash() == before
            False
        """
        return self._states.hash(self._links_in_use())

    def snapshot(self, path: str | PathLike | None = None) -> bytes:
        """The state (see save_state) as a numpy npz file.

        Versioned, without pickle: another version of its layout is refused. p.saveBullet stands beside it for
        the bodies.

        Args:
            path: where it is written; None: nowhere.

        Returns:
            The file's bytes.

        Example:
            >>> state = world.snapshot()
            >>> world.step(10)
            >>> world.load_snapshot(state)
            >>> float(tendon.positions[-1, 2])
            -0.1
        """
        return self._states.snapshot(path)

    def load_snapshot(self, source: bytes | str | PathLike) -> None:
        """Put back a snapshot.

        The world must have been made of the same parts in the same order, as a script does that is run again:
        tendons (names, particles, materials, radii), tunnels and obstacles, on bodies of the same ids. Holds
        become those of the snapshot: handles of the same tendon, particle, kind and body go on, others are
        released, and what is missing is made (Tendon.holds).

        Args:
            source: the bytes, or the path of the file.

        Raises:
            InvalidType: for another source.
            SnapshotError: for what cannot be read, is of another version or contradicts itself.
            StateMismatch: for a snapshot of another world. Then nothing has changed.

        Example:
            >>> world.load_snapshot(b"no snapshot")
            Traceback (most recent call last):
            bullet_tendon.errors.SnapshotError: source = 'bytes': must be a snapshot, a numpy npz file
        """
        self._bodies.require_client()
        self._states.load_snapshot(source)

    def _balance(self, bodies, forces, tolerance: float, max_steps: int, within, quiet: bool) -> bool:
        """Put bodies where they are in equilibrium, with the tendons that act on them.

        Whether there are tendons to relax after that.
        """
        _, gravity = self._stepper.step_and_gravity()
        self._bodies.require_alive()
        loads = [(*told, False) for told in self._bodies.external_forces]
        for force in forces:
            if not isinstance(force, (tuple, list)) or len(force) != 5:
                raise InvalidType("forces", force, "(bodyUniqueId, linkIndex, forceObj, posObj, flags)")
            loads.append(self._checked_force(*force))
        found = Equilibrium(self._bodies, self._core, self._obstacles.measure, bodies, gravity, loads, within)
        for force in forces:
            if force[0] not in found.free:
                raise InvalidValue("forces", force, f"one on a body that is free, of {sorted(found.free)}")
        attached = {h.link_slot for t in self.tendons for h in t.holds if isinstance(h, LinkAnchor)}
        solid = self._obstacles.link_slots() | {t.link_slot for t in self.tunnels}
        coupled = bool(self._tendons) and bool((attached | solid) & set(found.slots))
        kept = self._stepper.checkpoint() if coupled else None
        if coupled:
            found.tendons = HeldTendons(self._core, self.tendons, self._relaxation(), gravity)
        try:
            search = found.find(tolerance, max_steps)
        except BaseException:
            if coupled:
                self._stepper.take_back(kept)
            raise
        if search.found or search.has_left:
            self._bodies.rest()
        elif coupled:
            self._stepper.take_back(kept)
        self._stepper.forbid_resolve()
        report = self._stepper.report
        report.iterations, report.residual, report.tolerance = search.steps, search.residual, tolerance
        report.converged = search.found
        if not search.found and not quiet:
            place = "at the last place where they may be" if search.has_left else "put back"
            warn(
                EquilibriumWarning(
                    f"no equilibrium of bodies {sorted(found.free)} was found in {search.steps} steps: "
                    f"{search.failure}. {search.unbalanced:.3g} N are unbalanced. They are {place}. The load "
                    "may be more than what holds them: lower it, or come to it by small steps"
                )
            )
        return search.found and bool(self._tendons) and not coupled

    def _relaxation(self) -> Relaxation:
        alone = len(self._tendons) == 1 and not self._obstacles and not self._tunnels
        around = self._readouts.surroundings
        return Relaxation(self._core, self._stepper, self._states, self._bodies, self.tendons, alone, around)

    def _checked_force(self, body, link, force, point, flags) -> tuple:
        """Body, link, force (3,), point (3,), and whether these are in the link's inertial frame."""
        force, point = checks.vector("forceObj", force), checks.vector("posObj", point)
        self._bodies.require(body, link)
        if checks.integer("flags", flags) not in (p.WORLD_FRAME, p.LINK_FRAME):
            raise InvalidValue("flags", flags, "p.WORLD_FRAME or p.LINK_FRAME")
        return int(body), int(link), force, point, flags == p.LINK_FRAME

    def _links_in_use(self) -> set[int]:
        """Slots of the links that tunnels, obstacles, attachments and ligaments refer to."""
        attached = {h.link_slot for t in self.tendons for h in t.holds if isinstance(h, LinkAnchor)}
        attached.update(*(element.link_slots for element in (*self.ligaments, *self.cartilages)))
        return attached | {t.link_slot for t in self.tunnels} | self._obstacles.link_slots()

    def _solid_slots(self, argument, body) -> set[int]:
        """Slots of the links of a body, or of (body, link), that are obstacles or have tunnels."""
        is_link = isinstance(body, tuple) and len(body) == 2
        if not is_link and (not isinstance(body, (int, np.integer)) or isinstance(body, bool)):
            raise InvalidType(argument, body, "a Tendon, a bodyUniqueId, or (bodyUniqueId, linkIndex)")
        self._bodies.require(*(body if is_link else (body, -1)), argument)
        wanted = tuple(map(int, body)) if is_link else int(body)
        solid = self._obstacles.link_slots() | {t.link_slot for t in self.tunnels}
        alive = {slot: self._bodies.links[slot] for slot in solid if not self._bodies.is_gone(slot)}
        found = {slot for slot, link in alive.items() if wanted in (link, link[0])}
        if not found:
            raise UnknownId(argument, body, "a link that is an obstacle or has a tunnel")
        return found

    def _slot_of(self, argument, handle, kind, known) -> int:
        if not isinstance(handle, kind):
            raise InvalidType(argument, handle, f"a {kind.__name__}")
        slot = handle._slot if kind is Tendon else handle.slot
        if known.get(slot) is not handle:
            raise UnknownId(argument, handle, "one of this world, not removed")
        return slot


__all__ = ["CONTACT", "PENETRATION", "TendonWorld"]
