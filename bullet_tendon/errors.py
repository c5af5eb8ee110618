"""The package's exceptions: one hierarchy, and one form of message.

Owns: the types. Goes with no room of the core. Every message names the argument, the value that was given and
what is allowed, so that the reader can correct the call without opening the source.
"""

import sys
import warnings

_PACKAGE = __name__.split(".")[0]


class TendonError(Exception):
    """Base of everything this package raises on purpose.

    Example:
        >>> try:
        ...     world.add_tendon([(0, 0, 0)], 0.002, material)
        ... except bt.TendonError as problem:
        ...     print(problem)
        points = [(0, 0, 0)]: must be at least 2 points
    """

    def __reduce__(self):
        return _remade, (type(self), self.args, self.__dict__)  # the arguments of __init__ are not in args


class _BadArgument(TendonError):
    def __init__(self, argument: str, value: object, allowed: str):
        self.argument = argument
        self.value = value
        self.allowed = allowed
        super().__init__(f"{argument} = {_short(value)}: must be {allowed}")


class InvalidValue(_BadArgument, ValueError):
    """An argument of the right type whose value is out of range, non-finite or of a wrong shape.

    Example:
        >>> tendon.set_point_mass(0, float("nan"))
        Traceback (most recent call last):
        bullet_tendon.errors.InvalidValue: mass = nan: must be a finite number >= 0
    """


class InvalidType(_BadArgument, TypeError):
    """An argument of a wrong type.

    Example:
        >>> world.step("once")
        Traceback (most recent call last):
        bullet_tendon.errors.InvalidType: n = 'once': must be an integer
    """


class UnknownId(_BadArgument, KeyError):
    """A body, link, tendon or handle that does not exist (any more).

    Example:
        >>> tendon.attach(0, 99)
        Traceback (most recent call last):
        bullet_tendon.errors.UnknownId: bodyUniqueId = 99: must be the id of a body of this client: [0]
    """

    __str__ = Exception.__str__  # KeyError would print the repr of the message


class UrdfError(TendonError, ValueError):
    """A <tunnel> or <tendon> element of a URDF that cannot be used.

    Example:
        >>> with open("rope.urdf", "w") as file:
        ...     _ = file.write("<robot name='r'><link name='a'/><tendon name='t' radius='0.01'/></robot>")
        >>> world.load_urdf("rope.urdf")
        Traceback (most recent call last):
        bullet_tendon.errors.UrdfError: rope.urdf: <tendon name='t'>: <point> = '0 times': must be ...
    """

    def __init__(self, path: str, element: str, attribute: str, value: object, allowed: str):
        self.path, self.element, self.attribute = path, element, attribute
        self.value, self.allowed = value, allowed
        super().__init__(f"{path}: {element}: {attribute} = {_short(value)}: must be {allowed}")


class StateMismatch(_BadArgument, ValueError):
    """A saved state, or a snapshot, that does not fit the world as it is now: made of other parts.

    Example:
        >>> state = world.save_state()
        >>> world.remove_tendon(tendon)
        >>> world.restore_state(state)
        Traceback (most recent call last):
        bullet_tendon.errors.StateMismatch: state = 2: must be of a world with the tendons (), not ...
    """


class SnapshotError(_BadArgument, ValueError):
    """A snapshot that cannot be read: not one, damaged, or of another version.

    Example:
        >>> world.load_snapshot(world.snapshot()[:100])
        Traceback (most recent call last):
        bullet_tendon.errors.SnapshotError: source = 'bytes': must be a snapshot, a numpy npz file
    """


class CannotCopy(TendonError, TypeError):
    """A world, or a handle of one, that was going to be copied or pickled.

    Example:
        >>> import copy
        >>> copy.copy(tendon)
        Traceback (most recent call last):
        bullet_tendon.errors.CannotCopy: a Tendon cannot be copied or pickled: ...
    """

    def __init__(self, kind: str):
        super().__init__(
            f"a {kind} cannot be copied or pickled: it belongs to a world beside a pybullet client. Keep "
            "states with TendonWorld.snapshot() and load_snapshot(), or with save_state() and restore_state()"
        )


class NotCopied:
    """What copy and pickle refuse."""

    def __reduce_ex__(self, protocol):
        raise CannotCopy(type(self).__name__)


class StepWarning(RuntimeWarning):
    """A step that could not be solved was left out (SolverOptions.on_failure = "warn").

    Example:
        >>> import warnings
        >>> world.options = bt.SolverOptions(on_failure="warn")
        >>> tendon.set_force(0, (0, 0, 1e300))
        >>> with warnings.catch_warnings(record=True) as given:
        ...     world.step()
        >>> [warning.category.__name__ for warning in given], world.report.converged
        (['StepWarning'], False)
    """


class InsideWarning(RuntimeWarning):
    """A tendon that begins inside an obstacle, and is not attached there; or so near that it is stretched.

    A polyline through points at a radius from a round surface begins too near: its segments are chords.

    Example:
        >>> import warnings
        >>> world.add_obstacle(ball)
        >>> needle = world.add_tendon([(0, 0.05, -0.11), (0, -0.05, -0.11)], 0.001, material, particles=5)
        >>> with warnings.catch_warnings(record=True) as given:
        ...     world.step()
        >>> [warning.category.__name__ for warning in given]
        ['InsideWarning']
    """


class InertiaWarning(RuntimeWarning):
    """A base, or a link on a hinge, with mass and a shape, that pybullet does not turn for want of inertia.

    pybullet gives none to a mesh of triangles (GEOM_FORCE_CONCAVE_TRIMESH, or with indices).
    changeDynamics(localInertiaDiagonal=) sets it. The first step that reads the body gives the warning.

    Example:
        >>> import warnings
        >>> warnings.simplefilter("error", bt.InertiaWarning)  # a run in which all bodies that have mass turn
    """


class AttachmentWarning(RuntimeWarning):
    """A particle that is attached to a point farther away than its radius, to which the next step draws it.

    It is given by Tendon.attach: `position` is in the link's URDF frame, not in that of its centre of mass.

    Example:
        >>> import warnings
        >>> with warnings.catch_warnings(record=True) as given:
        ...     knot = tendon.attach(-1, ball, position=(0, 0, 0.05))
        >>> print(given[0].message)
        particle 10 of tendon 'tendon1' is 0.04 m away from its point on body 0, link -1: the next step ...
    """


class ResolutionWarning(RuntimeWarning):
    """A taut tendon that turns so far at one particle, on a body or another tendon, that it is not exact.

    More than 15 degrees on a mesh, 20 degrees at an edge, the mouth of a tunnel or where one segment alone
    touches a round shape or another tendon, 45 degrees where several do. Also where one segment turns by
    more than 45 degrees around the tendon with which it is twisted. It is given once for each tendon. It
    tells how far the tension can be off while the tendon slides on there, when one particle has the whole
    turn. More particles, or a finer mesh, are the cure.

    Example:
        >>> import warnings
        >>> warnings.simplefilter("error", bt.ResolutionWarning)  # a run that must not be inexact
    """


class SlackWarning(RuntimeWarning):
    """A ligament whose rest length is far beyond its path, so that it carries nothing.

    It is given by add_ligament.

    Example:
        >>> import warnings
        >>> stand = p.createMultiBody(0)
        >>> path = [(stand, -1, (0, 0, 0)), (ball, -1, (0, 0, 0))]
        >>> with warnings.catch_warnings(record=True) as given:
        ...     line = world.add_ligament(path, material, rest_length=0.22, name="line")
        >>> print(given[0].message)
        ligament 'line' is slack: its rest length of 0.22 m is 100% beyond its path of 0.11 m
    """


class CartilageWarning(RuntimeWarning):
    """Surfaces of cartilage that are far apart, or that do not face each other, or a layer pressed flat.

    The first two are given by add_cartilage. The last one is given by the first step, or relax, in which a
    depth exceeds the thickness.

    Example:
        >>> import warnings
        >>> warnings.simplefilter("error", bt.CartilageWarning)
    """


class EquilibriumWarning(RuntimeWarning):
    """Bodies for which relax found no equilibrium, such as under a load that nothing holds.

    It tells why the search ended, and what force is unbalanced there.

    Example:
        >>> import warnings
        >>> with warnings.catch_warnings(record=True) as given:
        ...     world.relax(bodies=[ball], max_steps=20)  # which falls
        >>> print(given[0].message)
        no equilibrium of bodies [0] was found in 20 steps: `max_steps` are used up. 0.981 N are ...
    """


class MissingExtra(TendonError, ImportError):
    """An optional package is needed for what was asked, and is not installed.

    Example:
        >>> print(bt.MissingExtra("matplotlib", "view", "composing a figure"))
        composing a figure needs matplotlib, which is not installed: pip install 'bullet_tendon[view]' or ...
    """

    def __init__(self, package: str, extra: str, purpose: str):
        super().__init__(
            f"{purpose} needs {package}, which is not installed: "
            f"pip install 'bullet_tendon[{extra}]' or pip install {package}"
        )


class StepFailed(TendonError, RuntimeError):
    """A step that could not be solved; the tendons are as they were before it.

    Example:
        >>> tendon.set_force(0, (0, 0, 1e300))
        >>> try:
        ...     world.step()
        ... except bt.StepFailed as problem:
        ...     print(problem.tendon, problem.particle, tendon.positions[0].tolist())
        tendon1 0 [0.0, 0.0, 0.0]
    """

    def __init__(self, tendon: str, particle: int, residual: float, tolerance: float):
        self.tendon, self.particle, self.residual = tendon, particle, residual
        super().__init__(
            f"step not solved: residual = {residual:.3g} at particle {particle} of tendon "
            f"{tendon!r}: must be <= {tolerance:.3g} (shorten the time step or lower the load)"
        )


class CaseFailed(TendonError, RuntimeError):
    """A case of a sweep whose function, or whose executor, raised; failure: the traceback as text.

    Example:
        >>> try:
        ...     bt.sweep(lambda case, rng: 1 / case, [1, 0], progress=False)
        ... except bt.CaseFailed as problem:
        ...     print(problem.index, problem.case, problem.failure.splitlines()[-1])
        1 0 ZeroDivisionError: division by zero
    """

    def __init__(self, index: int, case: object, failure: str):
        self.index, self.case, self.failure = index, case, failure
        super().__init__(f"case {index} ({_short(case)}) failed:\n{failure}")


def warn(warning: Warning) -> None:
    """Give a warning at the place outside of this package that has called it."""
    level, frame = 2, sys._getframe(1)
    while frame.f_back is not None and frame.f_globals.get("__name__", "").split(".")[0] == _PACKAGE:
        frame, level = frame.f_back, level + 1
    warnings.warn(warning, stacklevel=level)


def _remade(kind: type, args: tuple, attributes: dict) -> TendonError:
    """An error as another process has pickled it."""
    error = kind.__new__(kind, *args)
    error.__dict__.update(attributes)
    return error


def _short(value: object, limit: int = 120) -> str:
    try:
        text = repr(value)
    except Exception:  # its own __repr__, which is not what was wrong with the call
        text = object.__repr__(value)
    return text if len(text) <= limit else text[: limit - 4] + " ..."
