"""Virtual reconstructions of the ACL: a graft through two tunnels of a KneeRig, its tension, and the laxity
after.

The graft is one ligament from the outer end of the femoral tunnel, over the tunnels' inner mouths, to the
outer end of the tibial tunnel. It slides over the mouths without friction. That makes a reconstruction cheap
enough for maps and sweeps. Friction in the tunnels and the hardware of Tendon.fix are left out.
"""

import functools

import numpy as np
from bullet_tendon.urdf.femur_field import femur, notch, sagittal_profile

import bullet_tendon as bt
from bullet_tendon import checks
from bullet_tendon.errors import InvalidValue

from .knee import KneeRig

# Tunnels of knee.urdf, in the bones' frames: inner mouth and outer end [m].
FEMORAL = (-0.004, -0.0005, 0.00968), (0.00368, 0.03139, 0.03005)
TIBIAL = (0.005, -0.02248, -0.002), (0.02146, -0.05099, -0.01581)
TENSION, FIXED_AT = 80.0, np.radians(20.0)  # N; flexion at which the graft is fixed
# Slope of a four-strand hamstring graft, in the law of the preset "hamstring_graft" [N].
SLOPE, TOE = 1.5e9 * 57e-6, 0.03
DRAWER = 90.0  # N
ANGLES = 0, 15, 30, 60, 90  # degrees, at which a reconstruction is tested
# Ranges from which reconstructions are drawn: place of the femoral mouth on Bernard's grid, shifts of the
# tibial tunnel [m], tension at fixation [N], slope of the graft's law [N].
PLAN = {
    "deep": (0.20, 0.45),
    "low": (0.06, 0.50),
    "forward": (-0.004, 0.004),
    "lateral": (-0.003, 0.003),
    "tension": (20.0, 120.0),
    "slope": (0.6 * SLOPE, 1.2 * SLOPE),
}
# Blumensaat's line of the project's femur: a point of it [mm], and its direction to the rear, in the x-y
# plane.
ROOF = np.array([10.0, -10.0])
TO_THE_REAR = np.array([-np.sin(np.radians(40.0)), np.cos(np.radians(40.0))])
AWAY_FROM_ROOF = np.array([-TO_THE_REAR[1], TO_THE_REAR[0]])


def reconstruct(
    rig: KneeRig,
    femoral=FEMORAL,
    tibial=TIBIAL,
    tension: float = TENSION,
    fixed_at: float = FIXED_AT,
    slope: float = SLOPE,
) -> bt.Ligament:
    """Cut the ACL, lay a graft through two tunnels, and fix it under a tension.

    femoral, tibial: inner mouth and outer end of the tunnels, in the bones' frames [m]. tension [N]: of the
    graft when it is fixed at the flexion `fixed_at` [rad]. slope [N]: of its law beyond the toe. Returns the
    graft. Raises InvalidType or InvalidValue.
    """
    tension = checks.number("tension", tension, above=0)
    law = bt.Material.ligament(checks.number("slope", slope, above=0), TOE)
    if rig.forces.get("ACLam") is not None:
        rig.cut("ACL")
    (inner_f, outer_f), (inner_t, outer_t) = femoral, tibial
    points = [(rig.femur, outer_f), (rig.femur, inner_f), (rig.tibia, inner_t), (rig.tibia, outer_t)]
    graft = rig.world.add_ligament([(*bone, tuple(point)) for bone, point in points], law, name="graft")
    graft.set_tension(tension)
    rig.load()
    rig.flex(fixed_at)
    rig.settle()
    fix(graft, slope)
    rig.settle()
    return graft


def fix(graft: bt.Ligament, slope: float) -> None:
    """Fix a graft where it is, under the tension that is set: from now on its law decides.

    slope [N]: of its law, Material.ligament with the toe TOE. Nothing moves.
    """
    tension = graft.tension
    strain = tension / slope + TOE / 2 if tension > slope * TOE / 2 else np.sqrt(2 * TOE * tension / slope)
    graft.rest_length = graft.length / (1 + strain)
    graft.set_tension(None)


def drawer(rig: KneeRig, angle: float, zero: float | None = None, force: float = DRAWER) -> float:
    """Anterior place of the tibia under a drawer [N] at a flexion [rad], less `zero` [m].

    zero: anterior place without a load; None: where this knee itself rests.
    """
    rig.load()
    rig.flex(angle)
    rig.settle()
    start = rig.coordinates.anterior if zero is None else zero
    rig.load(anterior=force)
    rig.settle()
    found = rig.coordinates.anterior - start
    rig.load()
    rig.settle()
    return found


def on_bernards_grid(deep: float, low: float) -> tuple[np.ndarray, np.ndarray]:
    """Inner mouth and outer end of a femoral tunnel [m], by Bernard's quadrant method on the project's femur.

    deep: share of the lateral condyle's depth along Blumensaat's line, from its rear; low: share of the
    condyle's height, away from that line. The mouth lies on the lateral wall of the notch; the tunnel is
    parallel to that of knee.urdf. Raises InvalidValue where there is no wall.
    """
    checks.number("deep", deep, at_least=0, at_most=1)
    checks.number("low", low, at_least=0, at_most=1)
    along, height = _lateral_condyle()
    at = ROOF + (along[1] - deep * (along[1] - along[0])) * TO_THE_REAR + low * height * AWAY_FROM_ROOF
    sideways = np.linspace(0.0, 25.0, 501)
    line = np.stack([np.full_like(sideways, at[0]), np.full_like(sideways, at[1]), sideways], axis=1)
    inside = femur(line) < 0
    if inside[0] or not inside.any() or notch(line[:1])[0] > 0:
        raise InvalidValue("deep, low", (deep, low), "a place on the lateral wall of the notch")
    mouth = 1e-3 * line[inside.argmax()]
    return mouth, mouth + np.subtract(FEMORAL[1], FEMORAL[0])


def to_bernards_grid(point) -> tuple[float, float]:
    """(deep, low) as on_bernards_grid takes them, of a point (3,) in the femur's frame [m]."""
    along, height = _lateral_condyle()
    offset = 1e3 * np.asarray(point)[:2] - ROOF
    deep = (along[1] - offset @ TO_THE_REAR) / (along[1] - along[0])
    return float(deep), float(offset @ AWAY_FROM_ROOF / height)


@functools.cache
def _lateral_condyle() -> tuple[tuple[float, float], float]:
    """Its extent along Blumensaat's line, from ROOF (first, last), and its height from that line [mm]."""
    x, y = np.meshgrid(np.linspace(-35, 45, 321), np.linspace(-35, 25, 241), indexing="ij")
    points = np.stack([x, y, np.full_like(x, 20.0)], axis=-1)
    inside = sagittal_profile(points, lateral=True) < 0
    offset = np.stack([x[inside], y[inside]], axis=1) - ROOF
    along, away = offset @ TO_THE_REAR, offset @ AWAY_FROM_ROOF
    return (float(along.min()), float(along.max())), float(away.max())


def virtual_reconstruction(case: dict, rng) -> dict:
    """One reconstruction of the project's knee, as a function for bullet_tendon.sweep.

    case: angles [degrees], and any of PLAN; what is missing is drawn from rng. Returns them, with drawer [mm]
    and internal rotation under 5 N m [degrees] by angle, the most force of the graft [N], and whether the
    knee came to rest in joint every time.
    """
    drawn = {name: rng.uniform(*span) for name, span in PLAN.items()}
    plan = {name: float(case.get(name, value)) for name, value in drawn.items()}
    with KneeRig() as rig:
        femoral = on_bernards_grid(plan["deep"], plan["low"])
        tibial = np.array(TIBIAL) + [plan["forward"], 0.0, plan["lateral"]]
        graft = reconstruct(rig, femoral, tibial, tension=plan["tension"], slope=plan["slope"])
        drawers, rotations, forces = [], [], [graft.force]
        for angle in np.radians(case.get("angles", ANGLES)):
            drawers.append(1e3 * drawer(rig, angle))
            rested = rig.coordinates.internal_rotation
            rig.load(internal=5.0)
            rig.settle()
            rotations.append(float(np.degrees(rig.coordinates.internal_rotation - rested)))
            forces.append(graft.force)
            rig.load()
            rig.settle()
        at_rest = rig.unsettled == 0
    return {**plan, "drawer": drawers, "rotation": rotations, "force": max(forces), "at_rest": at_rest}
