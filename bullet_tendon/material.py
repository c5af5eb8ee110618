"""Material: the law of a tendon's cross-section, and published tendon materials.

Owns: values, immutable. Goes with the core's room `tendon` (axial_law, axial_springs, bending).
"""

import dataclasses
import math

from . import _core, checks
from .errors import InvalidValue

_DENSITY = 1120.0  # kg/m^3 (Bennett et al. 1986; Ker 1981)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Material:
    """What a tendon is made of, per strain, so that results do not change with the number of particles.

    With strain s and strain rate r = ds/dt, a cross-section carries (paper, equation 4, per strain)::

        T = stiffness sgn(s) |s|^exponent + damping sgn(r) |r|^damping_exponent

    Args:
        stiffness: K [N], > 0: the tension at strain 1.
        exponent: p [-], >= 1.
        toe_strain: strain beyond which the law goes on along its tangent [-], or None. Exponent 2 with a toe
            strain e_t is the ligament law of Blankevoort 1991 with slope k = 2 e_t stiffness.
        tension_only: no force (nor damping) under compression: a rope, which folds under the least push. It
            has no effect where bending_stiffness > 0: such a tendon carries compression until it buckles.
        damping: C [N s^q], >= 0.
        damping_exponent: q [-], >= 1.
        damping_form: "axial" brakes changes of length only; "lengthening" only those that lengthen, as in the
            knee model of Lenhart et al. 2015; "whole" the whole relative velocity of a spring's ends, as
            printed in the paper, which brakes rigid rotations too (tendons only).
        shear_stiffness: the share of the stiffness that each shear spring (i, i+2) carries [N], between 0 and
            stiffness/2. A cross-section carries the stiffness in all, whatever the share.
        bending_stiffness: EI [N m^2], >= 0, of a discrete curvature energy (straight without load). 0 costs
            nothing.
        density: [kg/m^3], > 0.
        friction: coefficient of the tendon [-], >= 0; a pair's is the product of both, as in Bullet.
        relaxation: ((g_1, t_1), ...), shares [-] of the elastic tension that decay with the times t_i [s]
            (quasi-linear viscoelasticity, Fung 1993): G(t) = 1 - sum g_i (1 - exp(-t/t_i)). The shares are
            > 0 and at most 1 together. The law above is that of a load that comes at once.
        rupture_force, rupture_strain: tension [N] and strain [-] beyond which it ruptures, or None.

    Raises:
        InvalidType, InvalidValue: naming the argument.

    Example:
        >>> rope = bt.Material(stiffness=2e4, tension_only=True, friction=0.3)
        >>> rope.density
        1120.0
        >>> bt.Material(stiffness=-1)
        Traceback (most recent call last):
        bullet_tendon.errors.InvalidValue: stiffness = -1: must be a finite number > 0
    """

    stiffness: float
    exponent: float = 1.0
    toe_strain: float | None = None
    tension_only: bool = False
    damping: float = 0.0
    damping_exponent: float = 1.0
    damping_form: str = "axial"
    shear_stiffness: float = 0.0
    bending_stiffness: float = 0.0
    density: float = _DENSITY
    friction: float = 0.1
    relaxation: tuple = ()
    rupture_force: float | None = None
    rupture_strain: float | None = None

    def __post_init__(self):
        checks.number("stiffness", self.stiffness, above=0)
        checks.number("exponent", self.exponent, at_least=1)
        if self.toe_strain is not None:
            checks.number("toe_strain", self.toe_strain, above=0)
        checks.flag("tension_only", self.tension_only)
        checks.number("damping", self.damping, at_least=0)
        checks.number("damping_exponent", self.damping_exponent, at_least=1)
        checks.choice("damping_form", self.damping_form, ("axial", "whole", "lengthening"))
        checks.number("shear_stiffness", self.shear_stiffness, at_least=0, at_most=self.stiffness / 2)
        checks.number("bending_stiffness", self.bending_stiffness, at_least=0)
        checks.number("density", self.density, above=0)
        checks.number("friction", self.friction, at_least=0)
        if not (isinstance(self.relaxation, tuple) and not self.relaxation):
            terms = checks.array("relaxation", self.relaxation, (None, 2))
            if (terms <= 0).any() or terms[:, 0].sum() > 1 + 1e-12:
                allowed = "((share, time [s]), ...), all > 0, with shares of at most 1 together"
                raise InvalidValue("relaxation", self.relaxation, allowed)
            object.__setattr__(self, "relaxation", tuple(map(tuple, terms.tolist())))
        for limit in ("rupture_force", "rupture_strain"):
            if getattr(self, limit) is not None:
                checks.number(limit, getattr(self, limit), above=0)

    @classmethod
    def from_springs(cls, *, ks, kd=0.0, p=1.0, q=1.0, spring_length, shear_ks=0.0, **others) -> "Material":
        """The material whose springs have the paper's constants (equation 4), for one spacing.

        A spring of rest length l carries ks (l s)^p = (ks l^p) s^p. A cross-section is crossed by one
        structure spring and two shear springs.

        Args:
            ks: of a structure spring [N/m^p], > 0.
            kd: its damping [N (s/m)^q], >= 0.
            p, q: its exponents, >= 1.
            spring_length: its rest length [m], > 0.
            shear_ks: of a shear spring [N/m^p], whose rest length is twice that.
            others: further arguments of Material.

        Raises:
            InvalidType, InvalidValue: naming the argument.

        Example:
            >>> print(f"{bt.Material.from_springs(ks=1e6, spring_length=0.002).stiffness:.0f} N")
            2000 N
        """
        length = checks.number("spring_length", spring_length, above=0)
        p = checks.number("p", p, at_least=1)
        q = checks.number("q", q, at_least=1)
        structure = checks.number("ks", ks, above=0) * _power(length, p)
        shear = checks.number("shear_ks", shear_ks, at_least=0) * _power(2 * length, p)
        total = structure + 2 * shear
        if not 0 < structure <= total < math.inf:
            raise InvalidValue("ks", ks, "such that ks spring_length^p, shear springs too, is finite and > 0")
        damping = checks.number("kd", kd, at_least=0) * _power(length, q) * total / structure
        return cls(
            stiffness=total, exponent=p, damping=damping, damping_exponent=q, shear_stiffness=shear, **others
        )

    @classmethod
    def from_modulus(cls, youngs_modulus: float, radius: float, **others) -> "Material":
        """The material of a solid round section: stiffness E pi r^2 [N], the tension at strain 1.

        bending_stiffness stays 0: a bundle of fibres bends far more easily than a solid rod, whose EI is
        E pi r^4/4.

        Args:
            youngs_modulus: E [Pa], > 0, of the law's tangent at strain 1 if its exponent is 1; about 1.5e9 in
                tendon (Bennett et al. 1986).
            radius: r [m], > 0, of the tendon that gets it.
            others: further arguments of Material.

        Raises:
            InvalidType, InvalidValue: naming the argument.

        Example:
            >>> print(f"{bt.Material.from_modulus(1.5e9, radius=0.003).stiffness:.0f} N")
            42412 N
        """
        modulus = checks.number("youngs_modulus", youngs_modulus, above=0)
        radius = checks.number("radius", radius, above=0)
        stiffness = modulus * math.pi * radius * radius
        if not 0 < stiffness < math.inf:
            raise InvalidValue("youngs_modulus", youngs_modulus, "such that E pi r^2 is finite and > 0")
        return cls(**{"stiffness": stiffness, **others})

    @classmethod
    def ligament(cls, slope: float, toe_strain: float = 0.06, **others) -> "Material":
        """The ligament law of Blankevoort 1991: T = slope s^2/(2 e_t), beyond e_t slope (s - e_t/2).

        Tension only.

        Args:
            slope: [N per unit strain] beyond the toe strain, > 0.
            toe_strain: e_t [-], > 0.
            others: further arguments of Material. The damping is 0.003 slope [N s] otherwise, as in the knee
                model of Lenhart et al. 2015.

        Raises:
            InvalidType, InvalidValue: naming the argument.

        Example:
            >>> ligament = bt.Material.ligament(slope=2000, toe_strain=0.06)
            >>> print(f"{ligament.stiffness:.0f} N, {ligament.exponent}, {ligament.damping:.0f} N s")
            16667 N, 2.0, 6 N s
        """
        slope = checks.number("slope", slope, above=0)
        e_t = checks.number("toe_strain", toe_strain, above=0)
        law = {
            "stiffness": slope / (2 * e_t),
            "exponent": 2.0,
            "toe_strain": e_t,
            "tension_only": True,
            "damping": 0.003 * slope,
        }
        return cls(**{**law, **others})

    @classmethod
    def preset(cls, name: str, tissue: bool = False, **changes) -> "Material":
        """A published material by name.

        Args:
            name: "native_acl", its bundles "native_acl_anteromedial" and "native_acl_posterolateral",
                "patellar_tendon", "quadriceps_tendon", "hamstring_graft" (four strands),
                "hamstring_graft_2" or "hamstring_graft_5".
            tissue: with what time and load do to it: relaxation, and rupture at the published load. Damping
                is then 0. The slope is that of cycles of 1.5 Hz. Tendons lose 6 to 11 % of the energy of a
                cycle from slack, whatever its frequency from 0.2 to 11 Hz (Bennett et al. 1986).
            changes: arguments of ligament that differ.

        Raises:
            InvalidType, InvalidValue: for another name.

        Example:
            >>> print(f"{bt.Material.preset('native_acl', friction=0.05).toe_strain:.2f}")
            0.06
            >>> bt.Material.preset("hamstring_graft", tissue=True).rupture_force
            2422.0
        """
        preset = _PRESETS[checks.choice("name", name, tuple(_PRESETS))]
        law = {"slope": preset.slope, "toe_strain": preset.toe_strain}
        if checks.flag("tissue", tissue):
            law["slope"] /= _relaxed_to(preset.relaxation, _CYCLES)
            law.update(damping=0.0, relaxation=preset.relaxation, rupture_force=preset.rupture_force)
        return cls.ligament(**{**law, **changes})

    def of_tendon(self, area: float) -> _core.Material:
        """The material as the compiled core takes it, for a cross-section of `area` [m^2]."""
        rope = self.tension_only and self.bending_stiffness == 0
        return self._in_core(rope, self.shear_stiffness, self.bending_stiffness, self.density * area)

    def of_ligament(self) -> _core.Material:
        """The same of a ligament, which bends freely and has no mass."""
        return self._in_core(self.tension_only, 0.0, 0.0, 0.0)

    def _in_core(self, tension_only: bool, *stiffnesses_and_density: float) -> _core.Material:
        law = (self.stiffness, self.exponent, self.toe, tension_only, self.damping, self.damping_exponent)
        form = self.damping_form == "whole", self.damping_form == "lengthening"
        weights, times = zip(*self.relaxation, strict=True) if self.relaxation else ((), ())
        limits = self.rupture_force or 0.0, self.rupture_strain or 0.0
        return _core.Material(*law, *form, *stiffnesses_and_density, weights, times, *limits)

    def __repr__(self) -> str:
        """All that differs from the defaults, to the last digit: states are compared by it."""
        parts = []
        for field in dataclasses.fields(self):
            value = getattr(self, field.name)
            if value is True:
                parts.append(field.name)
            elif value != field.default or field.name in _TOLD:
                parts.append(f"{field.name} {_told(value)} {_UNITS.get(field.name, '')}".rstrip())
        return f"<Material: {', '.join(parts)}>"

    @property
    def toe(self) -> float:
        """toe_strain, or infinity."""
        return math.inf if self.toe_strain is None else float(self.toe_strain)


# Units of the arguments, and those that are told even where they are the defaults.
_UNITS = {
    "stiffness": "N",
    "damping": "N s",
    "shear_stiffness": "N",
    "bending_stiffness": "N m^2",
    "density": "kg/m^3",
    "rupture_force": "N",
}
_TOLD = ("stiffness", "exponent", "damping", "density", "friction")


def _told(value) -> str:
    """A value of a material: a name, a number, or terms (g, t) of the relaxation."""
    if isinstance(value, str):
        return value
    if isinstance(value, tuple):
        return " + ".join(f"{_shortest(share)} in {_shortest(time)} s" for share, time in value)
    return _shortest(value)


def _shortest(value: float) -> str:
    """A number in few digits where that is exact, else in all of them."""
    short = f"{value:.6g}"
    return short if float(short) == value else repr(float(value))


def _power(base: float, exponent: float) -> float:
    """base^exponent of a positive base, infinity where that is too large."""
    try:
        return base**exponent
    except OverflowError:
        return math.inf


def _relaxed_to(relaxation: tuple, frequency: float) -> float:
    """Storage modulus of slow to fast cycles [Hz] over that of a load that comes at once [-]."""
    slow = [(g, 2 * math.pi * frequency * t) for g, t in relaxation]
    return 1 - sum(g / (1 + x * x) for g, x in slow)


# Relaxation of tendon: Fung's spectrum S(t) = C/t, one term a decade from 10 ms to 1000 s (Puso and Weiss
# 1998). Its loss does not depend on the frequency. C gives 8 to 11 % in a cycle from slack, as Bennett et al.
# 1986 measured. Constants that are fitted to ramps of seconds have no terms that are fast enough for that:
# those of the ACL below lose 5 % at 0.2 Hz, and 0.1 % at 11 Hz.
_OF_TENDON = tuple((0.058, 10.0**decade) for decade in range(-2, 4))
# Human ACL (PMC4407883).
_OF_ACL = ((0.154, 3.77), (0.161, 148.24), (0.682, 10987.98))
_CYCLES = 1.5  # Hz: the middle of 0.2 to 11 Hz, in which the modulus of tendon was measured


@dataclasses.dataclass(frozen=True)
class _Preset:
    """slope [N per unit strain], toe_strain [-], rupture_force [N]."""

    slope: float
    toe_strain: float
    rupture_force: float
    relaxation: tuple = _OF_TENDON


# Native ACL: 242 N/mm over 32 mm, 2160 N (Woo 1991). Its bundles: 5 kN each (Blankevoort and Huiskes 1991),
# and half of the load each. Tendons: 1.5 GPa (Bennett et al. 1986), toe region to 3 %. Patellar tendon
# 45 mm^2 and 1784 N, four strands of hamstring 57 mm^2 and 2422 N (Wilson 1999); two strands 23 mm^2
# and 2330 N (Hamner 1999); five strands as 5/4 of four. Quadriceps tendon 91 mm^2 and 2186 N (Shani 2016).
_PRESETS = {
    "native_acl": _Preset(242e3 * 0.032, 0.06, 2160.0, _OF_ACL),
    "native_acl_anteromedial": _Preset(5e3, 0.06, 1080.0, _OF_ACL),
    "native_acl_posterolateral": _Preset(5e3, 0.06, 1080.0, _OF_ACL),
    "patellar_tendon": _Preset(1.5e9 * 45e-6, 0.03, 1784.0),
    "quadriceps_tendon": _Preset(1.5e9 * 91e-6, 0.03, 2186.0),
    "hamstring_graft": _Preset(1.5e9 * 57e-6, 0.03, 2422.0),
    "hamstring_graft_2": _Preset(1.5e9 * 23e-6, 0.03, 2330.0),
    "hamstring_graft_5": _Preset(1.5e9 * 71.25e-6, 0.03, 3027.5),
}
