"""Visual bodies: what shows tendons, skins and tunnels in a pybullet client. No physics.

Owns: the visual bodies that it adds. Goes with no room of the core. They have no collision shape and mass 0,
so that nothing feels them. A `physicsClientId` may be the number or a BulletClient.
"""

from types import SimpleNamespace

import numpy as np
import pybullet as p

from . import checks
from .bodies import client_of
from .errors import InvalidValue
from .ligament import line_of
from .skin import Skin, twist_free_frames

TENDON_COLOR = (0.86, 0.75, 0.55, 1.0)
TAUT_COLOR = (0.80, 0.10, 0.08, 1.0)
TUNNEL_COLOR = (0.05, 0.55, 0.60, 1.0)
PALETTE = (TENDON_COLOR, (0.75, 0.35, 0.30, 1.0), (0.45, 0.60, 0.80, 1.0), (0.55, 0.70, 0.40, 1.0))
LIGAMENT_COLOR = (0.80, 0.55, 0.47, 1.0)
LIGAMENT_RADIUS = 0.001  # by which ligaments, which have no thickness, are drawn [m]
_MOST_VERTICES, _MOST_TRIANGLES = 131072, 174762  # createVisualShape fails beyond (pybullet 3.2.7)
_GRADE = 0.25  # steps of a piece's length, in radii: a joint's waist is then at least 0.96 of the radius
_TOLERANCE = 0.6  # of a grade, by which a length may differ before its piece is exchanged
_SHADES = 100  # of a colour that follows the tension


def checked_colors(colors) -> list[np.ndarray]:
    """Colours (4,) of tendons, at least one. Raises InvalidType or InvalidValue."""
    found = [checks.vector("colors", color, 4) for color in checks.sequence("colors", colors, "RGBA colours")]
    if not found:
        raise InvalidValue("colors", colors, "at least one colour")
    for color in found:
        if color.min() < 0 or color.max() > 1:
            raise InvalidValue("colors", color.tolist(), "RGBA from 0 to 1")
    return found


class TendonVisual:
    """A tendon shown by a piece of a tube per segment, cheap enough for every frame of a window or a camera.

    `tendon` has positions (n, 3) [m], radius [m] and, if `full_tension` [N] is given, tension (n-1,) [N]:
    segments are then coloured from `color` (no tension) to red (full). `sides`: of a piece's cross-section.
    `length` [m]: a piece covers as many segments as are no longer than that together now; None: one.
    A piece ends in a hemisphere that covers the beginning of the next one. Pieces are moved from frame to
    frame. Where a segment's length has changed by a quarter of the radius, another piece of that length takes
    its place, and is kept for later: pybullet gives back neither all of a shape's memory nor of a body's.

    Example:
        >>> from bullet_tendon import view
        >>> visual = view.TendonVisual(tendon, full_tension=10)
        >>> world.step(10)
        >>> visual.update()
        >>> visual.remove()
    """

    def __init__(
        self, tendon, physicsClientId=0, color=TENDON_COLOR, full_tension=None, sides=12, length=None
    ):
        self.tendon, self.color = tendon, checks.vector("color", color, 4)
        self.full_tension = full_tension
        if full_tension is not None:
            self.full_tension = checks.number("full_tension", full_tension, above=0.0)
        self._sides = checks.integer("sides", sides, at_least=3)
        self._client = client_of(physicsClientId)
        self._particles = len(tendon.positions)
        self._ends = _ends(np.asarray(tendon.positions, dtype=float), length)
        count = len(self._ends) - 1
        self._grades = np.full(count, -1)  # lengths of the pieces, in grades; -1: none
        self._shown = np.full(count, np.nan)
        self._pieces = [-1] * count
        self._shapes: dict[int, int] = {}  # pybullet's shapes by grade
        self._spare: dict[int, list[int]] = {}  # pieces that are not shown, by grade
        sphere = visual_shape(_sphere(tendon.radius, self._sides), self.color, self._client)
        self._start: int | None = visual_body(sphere, self._client)
        self.update()

    @property
    def bodies(self) -> list[int]:
        """Ids of the bodies that show it now: the pieces, then a sphere at the first particle."""
        return [] if self._start is None else [*self._pieces, self._start]

    def update(self):
        """Move the pieces to the tendon's present positions, and recolour them if asked for.

        Example:
            >>> from bullet_tendon import view
            >>> view.TendonVisual(tendon).update()
        """
        update_visuals([self])

    def remove(self):
        """Take the pieces away; a second call does nothing.

        Example:
            >>> from bullet_tendon import view
            >>> visual = view.TendonVisual(tendon)
            >>> visual.remove()
            >>> visual.bodies
            []
        """
        spare = [body for bodies in self._spare.values() for body in bodies]
        for body in [*self.bodies, *spare]:
            p.removeBody(body, physicsClientId=self._client)
        self._spare, self._start = {}, None

    def _points(self) -> np.ndarray:
        """Where the pieces end now, (k, 3) [m]. Raises InvalidValue if the tendon has other particles."""
        points = np.asarray(self.tendon.positions, dtype=float)
        if len(points) != self._particles:
            raise InvalidValue("tendon.positions", points, f"of shape ({self._particles}, 3)")
        return points[self._ends]

    def _place(self, points, lengths, turns) -> None:
        """Let the pieces end at `points`, of `lengths` (k-1,) [m] and quaternions `turns` (k-1, 4)."""
        self._fit(lengths)
        places, turns = points.tolist(), turns.tolist()
        for body, place, turn in zip(self._pieces, places[:-1], turns, strict=True):
            p.resetBasePositionAndOrientation(body, place, turn, physicsClientId=self._client)
        p.resetBasePositionAndOrientation(self._start, places[0], turns[0], physicsClientId=self._client)
        if self.full_tension is not None:
            self._recolour(np.asarray(self.tendon.tension, dtype=float))

    def _fit(self, lengths) -> None:
        """Exchange the pieces that have another length than they should."""
        grades = lengths / (_GRADE * self.tendon.radius)
        for i in np.flatnonzero(np.abs(grades - self._grades) > _TOLERANCE).tolist():
            if self._grades[i] >= 0:
                paint(self._pieces[i], -1, (*self.color[:3], 0.0), self._client)
                self._spare.setdefault(int(self._grades[i]), []).append(self._pieces[i])
            self._grades[i], self._shown[i] = round(grades[i]), np.nan
            self._pieces[i] = self._piece(int(self._grades[i]))

    def _piece(self, grade: int) -> int:
        """A piece of that length that is not shown yet."""
        spare = self._spare.get(grade)
        if spare:
            paint(spare[-1], -1, self.color, self._client)
            return spare.pop()
        if grade not in self._shapes:
            mesh = _piece(grade * _GRADE * self.tendon.radius, self.tendon.radius, self._sides)
            self._shapes[grade] = visual_shape(mesh, self.color, self._client)
        return visual_body(self._shapes[grade], self._client)

    def _recolour(self, tension) -> None:
        mean = np.add.reduceat(tension, self._ends[:-1]) / np.diff(self._ends)
        share = np.round(np.clip(mean / self.full_tension, 0.0, 1.0) * _SHADES) / _SHADES
        changed = np.flatnonzero(share != self._shown).tolist()
        for i in changed:
            color = (1 - share[i]) * self.color + share[i] * np.array(TAUT_COLOR)
            paint(self._pieces[i], -1, color, self._client)
            if i == 0:
                paint(self._start, -1, color, self._client)
        self._shown = share


def update_visuals(visuals) -> None:
    """Move the pieces of TendonVisuals to where their tendons are: the turns of all in one calculation."""
    if not visuals:
        return
    points = [visual._points() for visual in visuals]
    chords = np.concatenate([np.diff(line, axis=0) for line in points])
    lengths = np.linalg.norm(chords, axis=1)
    turns = _turns_from_x(chords, lengths)
    end = 0
    for visual, line in zip(visuals, points, strict=True):
        start, end = end, end + len(line) - 1
        visual._place(line, lengths[start:end], turns[start:end])


class LigamentLine:
    """A ligament for a TendonVisual: positions (k, 3) of its line [m], radius [m], tension (k-1,) [N]."""

    def __init__(self, ligament, frames: dict):
        self._ligament = ligament
        self.radius = LIGAMENT_RADIUS
        self.place(frames)

    @property
    def tension(self) -> np.ndarray:
        return np.full(len(self.positions) - 1, self._ligament.force)

    def place(self, frames: dict) -> None:
        """Let it be where the links are; frames: origin (3,) and axes (3, 3) by (bodyUniqueId, linkIndex)."""
        self.positions = line_of(self._ligament, frames)


class Lines:
    """The tendons and ligaments of a world, as TendonVisual shows them."""

    def __init__(self, world):
        self._world = world
        self._lines: dict = {}

    def now(self) -> list:
        """The world's tendons, then a LigamentLine for each ligament where it is now."""
        world = self._world
        ligaments = world.ligaments
        if not ligaments:
            return list(world.tendons)
        keys = {link for ligament in ligaments for link in ligament.links}
        frames = {key: world._bodies.frame(*key) for key in keys}
        for gone in self._lines.keys() - set(ligaments):
            del self._lines[gone]
        for ligament in ligaments:
            if ligament in self._lines:
                self._lines[ligament].place(frames)
            else:
                self._lines[ligament] = LigamentLine(ligament, frames)
        return [*world.tendons, *(self._lines[ligament] for ligament in ligaments)]


def mesh_body(skin, physicsClientId=0, color=TENDON_COLOR) -> int:
    """A visual body of `skin` (vertices, normals, triangles, world frame) as it is now; its body id.

    For one picture: it does not follow. Remove it with pybullet.removeBody; pybullet keeps some of
    a mesh's memory even then (about 0.5 kB a vertex), so do not make one per frame of a long film.

    Example:
        >>> from bullet_tendon import view
        >>> body = view.mesh_body(bt.Skin.tube(tendon))
        >>> p.removeBody(body)
    """
    client = client_of(physicsClientId)
    return visual_body(visual_shape(skin, checks.vector("color", color, 4), client), client)


def tunnel_mesh(start, end, radius, rings=2, lines=6):
    """A wire frame (vertices, normals, triangles) of a bore between two points (3,) [m], of a radius [m].

    Example:
        >>> from bullet_tendon import view
        >>> wires = view.tunnel_mesh((0, 0, 0), (0, 0, 0.03), radius=0.004)
        >>> wires.vertices.shape[1], wires.triangles.shape[1]
        (3, 3)
    """
    start, end = checks.vector("start", start), checks.vector("end", end)
    radius = checks.number("radius", radius, above=0.0)
    _, across, aside = twist_free_frames([start, end])[0].T
    angle = np.linspace(0.0, 2 * np.pi, 37)
    circle = radius * (np.cos(angle)[:, None] * across + np.sin(angle)[:, None] * aside)
    curves = [start + part * (end - start) + circle for part in np.linspace(0.0, 1.0, rings)]
    curves += [np.array([start, end]) + spoke for spoke in circle[: 36 : 36 // lines]]
    wires = [Skin.tube(SimpleNamespace(positions=curve, radius=0.05 * radius), ring=8) for curve in curves]
    shift = np.cumsum([0] + [len(wire.vertices) for wire in wires])
    return SimpleNamespace(
        vertices=np.vstack([wire.vertices for wire in wires]),
        normals=np.vstack([wire.normals for wire in wires]),
        triangles=np.vstack([wire.triangles + at for wire, at in zip(wires, shift, strict=False)]),
    )


def visual_shape(mesh, color, client: int) -> int:
    """pybullet's id of a visual shape; mesh: vertices, normals, triangles. Raises InvalidValue: too large."""
    if len(mesh.vertices) > _MOST_VERTICES or len(mesh.triangles) > _MOST_TRIANGLES:
        sizes = (len(mesh.vertices), len(mesh.triangles))
        allowed = f"at most {_MOST_VERTICES} vertices and {_MOST_TRIANGLES} triangles"
        raise InvalidValue("mesh (vertices, triangles)", sizes, allowed)
    return p.createVisualShape(
        p.GEOM_MESH,
        vertices=mesh.vertices.tolist(),
        normals=mesh.normals.tolist(),
        indices=mesh.triangles.ravel().tolist(),
        rgbaColor=list(color),
        physicsClientId=client,
    )


def paint(body: int, link: int, color, client: int) -> None:
    """Give all shapes of a link a colour (4,)."""
    p.changeVisualShape(body, link, rgbaColor=list(color), physicsClientId=client)


def _ends(points, length) -> np.ndarray:
    """Particles at which pieces end, the first one too; length: see TendonVisual."""
    segments = len(points) - 1
    each = 1
    if length is not None:
        total = np.linalg.norm(np.diff(points, axis=0), axis=1).sum()
        each = max(1, int(min(segments, length * segments / max(total, np.finfo(float).tiny))))
    return np.append(np.arange(0, segments, each), segments)


def visual_body(shape: int, client: int) -> int:
    """pybullet's id of a body of a visual shape and nothing else."""
    return p.createMultiBody(0, -1, shape, physicsClientId=client)


def _piece(length, radius, sides) -> SimpleNamespace:
    """A cylinder along x from 0 to `length`, open at 0, with a hemisphere beyond `length`."""
    angle = np.linspace(0.0, np.pi / 2, 2 + sides // 4)
    x = np.concatenate([[0.0], length + radius * np.sin(angle[:-1])])
    radii = np.concatenate([[radius], radius * np.cos(angle[:-1])])
    slope = np.concatenate([[0.0], np.sin(angle[:-1])])  # x of the normals
    return _turned(x, radii, slope, sides, length + radius)


def _sphere(radius, sides) -> SimpleNamespace:
    """A sphere around the origin, open where it meets the x axis at -radius."""
    angle = np.linspace(-np.pi / 2, np.pi / 2, 3 + sides // 2)[1:-1]
    return _turned(radius * np.sin(angle), radius * np.cos(angle), np.sin(angle), sides, radius)


def _turned(x, radii, slope, sides, tip) -> SimpleNamespace:
    """The mesh of circles at x (k,), with radii and x components of normals (k,), closed at x = tip."""
    angle = np.arange(sides) * (2 * np.pi / sides)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    along = np.repeat(x, sides)[:, None]
    around = (radii[:, None, None] * circle).reshape(-1, 2)
    normals = np.sqrt(1 - slope**2)[:, None, None] * circle
    row = sides * np.arange(len(x) - 1)[:, None]
    one = np.arange(sides)
    other = (one + 1) % sides
    a, b, c, d = row + one, row + other, row + sides + one, row + sides + other
    walls = np.stack([a, b, c, b, d, c], axis=-1).reshape(-1, 3)
    last = sides * (len(x) - 1)
    cap = np.stack([last + one, last + other, np.full(sides, last + sides)], axis=1)
    return SimpleNamespace(
        vertices=np.vstack([np.hstack([along, around]), [tip, 0.0, 0.0]]),
        normals=np.vstack([np.hstack([np.repeat(slope, sides)[:, None], normals.reshape(-1, 2)]), [1, 0, 0]]),
        triangles=np.vstack([walls, cap]).astype(np.int32),
    )


def _turns_from_x(vectors, lengths) -> np.ndarray:
    """Quaternions (n, 4) that turn x the short way onto the vectors (n, 3), whose lengths are (n,)."""
    length = lengths[:, None]
    x, y, z = np.where(length > 0, vectors / np.where(length > 0, length, 1.0), [1.0, 0.0, 0.0]).T
    turns = np.stack([0 * x, -z, y, 1 + x], axis=1)
    turns[x < -1 + 1e-12] = [0.0, 0.0, 1.0, 0.0]
    return turns / np.linalg.norm(turns, axis=1)[:, None]
