"""Material: the law of a tendon's cross-section, and published tendon materials.

Owns: values, immutable. Goes with the core's room `tendon` (axial_law, axial_springs, bending).
"""

import dataclasses
import math

from . import checks
from .errors import InvalidValue

_DENSITY = 1120.0  # kg/m^3 (Bennett et al. 1986; Ker 1981)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Material:
    """What a tendon is made of, per strain, so that results do not change with the number of particles.

    With strain s and strain rate r = ds/dt, a cross-section carries (paper, equation 4, per strain)

        T = stiffness sgn(s) |s|^exponent + damping sgn(r) |r|^damping_exponent.

    stiffness: K [N], > 0: the tension at strain 1.
    exponent: p [-], >= 1.
    toe_strain: strain beyond which the law goes on along its tangent [-], or None. Exponent 2 with
        a toe strain e_t is the ligament law of Blankevoort 1991 with slope k = 2 e_t stiffness.
    tension_only: no force (nor damping) under compression.
    damping: C [N s^q], >= 0; damping_exponent: q [-], >= 1.
    damping_form: "axial" brakes changes of length only; "whole" the whole relative velocity of a
        spring's ends, as printed in the paper, which brakes rigid rotations too.
    shear_stiffness: the share of `stiffness` that each shear spring (i, i+2) carries [N], between 0
        and stiffness/2. A cross-section carries `stiffness` in all, whatever the share.
    bending_stiffness: EI [N m^2], >= 0, of a discrete curvature energy (straight without load). 0 costs
        nothing.
    density: [kg/m^3], > 0.
    friction: coefficient of the tendon [-], >= 0; a pair's is the product of both, as in Bullet.

    Raises InvalidType or InvalidValue naming the argument.
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

    def __post_init__(self):
        checks.number("stiffness", self.stiffness, above=0)
        checks.number("exponent", self.exponent, at_least=1)
        if self.toe_strain is not None:
            checks.number("toe_strain", self.toe_strain, above=0)
        checks.flag("tension_only", self.tension_only)
        checks.number("damping", self.damping, at_least=0)
        checks.number("damping_exponent", self.damping_exponent, at_least=1)
        checks.choice("damping_form", self.damping_form, ("axial", "whole"))
        checks.number("shear_stiffness", self.shear_stiffness, at_least=0, at_most=self.stiffness / 2)
        checks.number("bending_stiffness", self.bending_stiffness, at_least=0)
        checks.number("density", self.density, above=0)
        checks.number("friction", self.friction, at_least=0)

    @classmethod
    def from_springs(cls, *, ks, kd=0.0, p=1.0, q=1.0, spring_length, shear_ks=0.0, **others) -> "Material":
        """The material whose springs have the paper's constants (equation 4), for one spacing.

        ks [N/m^p] and kd [N (s/m)^q] of a structure spring of rest length spring_length [m], p and q
        its exponents, shear_ks [N/m^p] of a shear spring, whose rest length is twice that. A spring of
        rest length l carries ks (l s)^p = (ks l^p) s^p; a cross-section is crossed by one structure
        spring and two shear springs. `others` are further arguments of Material.
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

        youngs_modulus: E [Pa], > 0, of the law's tangent at strain 1 if its exponent is 1; about 1.5e9 in
        tendon (Bennett et al. 1986). radius: r [m], > 0, of the tendon that gets it. `others` are further
        arguments of Material. bending_stiffness stays 0: a bundle of fibres bends far more easily than a
        solid rod, whose EI is E pi r^4/4. Raises InvalidType or InvalidValue.
        """
        modulus = checks.number("youngs_modulus", youngs_modulus, above=0)
        radius = checks.number("radius", radius, above=0)
        stiffness = modulus * math.pi * radius * radius
        if not 0 < stiffness < math.inf:
            raise InvalidValue("youngs_modulus", youngs_modulus, "such that E pi r^2 is finite and > 0")
        return cls(**{"stiffness": stiffness, **others})

    @classmethod
    def ligament(cls, slope: float, toe_strain: float = 0.06, **others) -> "Material":
        """The ligament law of Blankevoort 1991: T = slope s^2/(2 e_t), then slope (s - e_t/2).

        slope [N per unit strain] beyond the toe strain e_t. Damping 0.003 slope [N s], as in the knee
        model of Lenhart et al. 2015. Tension only.
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
    def preset(cls, name: str, **changes) -> "Material":
        """A published material by name: "native_acl", "patellar_tendon" or "hamstring_graft"."""
        return cls.ligament(**{**_PRESETS[checks.choice("name", name, tuple(_PRESETS))], **changes})

    def core_arguments(self, area: float) -> tuple:
        """The material as the compiled core takes it, for a cross-section of `area` [m^2]."""
        law = (self.stiffness, self.exponent, self.toe, self.tension_only, self.damping)
        whole = self.damping_form == "whole"
        stiffnesses = (self.shear_stiffness, self.bending_stiffness)
        return (self.friction, *law, self.damping_exponent, whole, *stiffnesses, self.density * area)

    @property
    def toe(self) -> float:
        """toe_strain, or infinity."""
        return math.inf if self.toe_strain is None else float(self.toe_strain)


def _power(base: float, exponent: float) -> float:
    """base^exponent of a positive base, infinity where that is too large."""
    try:
        return base**exponent
    except OverflowError:
        return math.inf


# Slope [N per unit strain] and toe strain. Native ACL: 242 N/mm over 32 mm (Woo 1991). Grafts:
# 1.5 GPa (Bennett et al. 1986) on 45 and 57 mm^2 (Wilson 1999), toe region to 3 %.
_PRESETS = {
    "native_acl": {"slope": 242e3 * 0.032, "toe_strain": 0.06},
    "patellar_tendon": {"slope": 1.5e9 * 45e-6, "toe_strain": 0.03},
    "hamstring_graft": {"slope": 1.5e9 * 57e-6, "toe_strain": 0.03},
}
