"""Argument checks: each returns the value in the form the package works with, or raises.

They run before anything changes, so that a refused call leaves no trace. Here too: how many particles, shapes
and tunnels the core can address. Goes with no room of the core, which trusts what comes from here.
"""

import numbers
import os

import numpy as np

from .errors import InvalidType, InvalidValue

MOST_PARTICLES = 32_768  # of a tendon: more are a slip of the unit or of the axis, and a step of seconds


def number(argument: str, value, *, above=None, at_least=None, at_most=None) -> float:
    """A finite real number within the bounds given, as a float."""
    if isinstance(value, (bool, np.bool_)) or not isinstance(value, (numbers.Real, np.number)):
        raise InvalidType(argument, value, "a real number")
    allowed = _range_text("a finite number", above, at_least, at_most)
    try:
        result = float(value)
    except Exception:  # whatever its conversion raises, an overflow for one
        raise InvalidValue(argument, value, allowed) from None
    inside = (
        np.isfinite(result)
        and (above is None or result > above)
        and (at_least is None or result >= at_least)
        and (at_most is None or result <= at_most)
    )
    if not inside:
        raise InvalidValue(argument, value, allowed)
    return result


def integer(argument: str, value, *, at_least=None, at_most=None) -> int:
    """An integer within the bounds given (bool is refused, numpy integers are accepted)."""
    if isinstance(value, (bool, np.bool_)) or not isinstance(value, (int, np.integer)):
        raise InvalidType(argument, value, "an integer")
    try:
        result = int(value)
    except Exception:  # a subclass's own __int__
        raise InvalidType(argument, value, "an integer") from None
    below = at_least is not None and result < at_least
    beyond = at_most is not None and result > at_most
    if below or beyond:
        raise InvalidValue(argument, value, _range_text("an integer", None, at_least, at_most))
    return result


def vector(argument: str, value, size: int = 3) -> np.ndarray:
    """A finite vector of `size` numbers, as a new float array (size,)."""
    return array(argument, value, (size,))


def as_array(value) -> np.ndarray:
    """What numpy makes of a value; array(None) where its own __array__, __len__ or __float__ raises."""
    try:
        return np.asarray(value)
    except Exception:
        return np.array(None)


def array(argument: str, value, shape: tuple) -> np.ndarray:
    """A finite float array of the shape given; None in `shape` stands for any length >= 1."""
    given = as_array(value)
    if given.dtype.kind not in "iuf":  # neither text nor complex numbers, which numpy would convert
        raise InvalidType(argument, value, f"real numbers of shape {_shape_text(shape)}")
    result = given.astype(float)
    fits = result.shape == shape or (
        result.ndim == len(shape)
        and all(
            have >= 1 if want is None else have == want
            for have, want in zip(result.shape, shape, strict=True)
        )
    )
    if not fits:
        raise InvalidValue(argument, value, f"of shape {_shape_text(shape)}")
    if not np.isfinite(result).all():
        raise InvalidValue(argument, value, "finite everywhere")
    return result


def sequence(argument: str, value, items: str) -> list:
    """What an iterable of `items` yields; neither text nor bytes."""
    try:
        if not isinstance(value, (str, bytes)):
            return list(value)
    except Exception:  # no iterable, or one that raises on its way
        pass
    raise InvalidType(argument, value, items)


def choice(argument: str, value, allowed: tuple):
    """One of the values in `allowed` (bool is no number of them)."""
    known = isinstance(value, type(allowed[0])) and not isinstance(value, bool)
    if not known or value not in allowed:
        raise InvalidValue(argument, value, "one of " + ", ".join(map(repr, allowed)))
    return value


def flag(argument: str, value) -> bool:
    """True or False."""
    if not isinstance(value, (bool, np.bool_)):
        raise InvalidType(argument, value, "True or False")
    return bool(value)


def text(argument: str, value) -> str:
    """A non-empty string."""
    if not isinstance(value, str):
        raise InvalidType(argument, value, "a string")
    if not value:
        raise InvalidValue(argument, value, "a non-empty string")
    return value


def path(argument: str, value) -> str:
    """A path, as a string."""
    if not isinstance(value, (str, os.PathLike)):
        raise InvalidType(argument, value, "a path")
    try:
        name = os.fsdecode(value)
    except Exception:  # whatever its __fspath__ raises
        raise InvalidType(argument, value, "a path") from None
    if "\0" in name:  # no file system has such a name, and open() raises a plain ValueError
        raise InvalidValue(argument, value, "a path without null characters")
    return name


def _range_text(what, above, at_least, at_most) -> str:
    bounds = [
        f"{sign} {bound:g}"
        for sign, bound in ((">", above), (">=", at_least), ("<=", at_most))
        if bound is not None
    ]
    return what + (" " + " and ".join(bounds) if bounds else "")


def _shape_text(shape: tuple) -> str:
    sizes = ", ".join("m" if size is None else str(size) for size in shape)
    return f"({sizes},)" if len(shape) == 1 else f"({sizes})"
