"""What a world tells of itself: one line for print, and a page with what a step cost and advice.

Owns: nothing. Goes with no room of the core. Advice names what is set badly, by how much, and what to set
instead.
"""

import math

import numpy as np
import pybullet as p

from .anchors import Attachment
from .reports import ROOMS

# A particle at which a tendon turns by more than this on a surface makes its tension inexact (limits in
# core/README.md, "On a mesh the tension ...") [degrees].
_TURN = 15.0
_SLOW = 0.1  # s: damping over stiffness from which a tendon visibly creeps back
_BRISK = 1e-3  # s: the same, of a tendon that does not ring on
_WORKING_STRAIN = 0.01  # at which a slack tendon is judged, if its toe does not end before
_PROPORTIONS = 0.1, 500.0  # of a link's shapes over the length of a tunnel in it: beyond, a unit is wrong
_CONSIDERED = (
    ("pairs_considered", "pairs of a tendon's part and a shape near each other"),
    ("pairs_culled", "left out by their boxes"),
    ("pairs_skipped", "too far since they were last measured"),
    ("pairs_reused", "measured from the triangles or planes of before"),
    ("pairs_queried", "measured anew"),
    ("tunnels_culled", "tendons and tunnels too far apart"),
    ("tendon_searches_skipped", "pairs of tendons that were apart, or whose lists were still valid"),
    ("tendons_asleep", "tendons asleep"),
)


def summary(world) -> str:
    """One line: what is in the world, and what its last step was."""
    particles = sum(tendon.particles for tendon in world.tendons)
    parts = [f"{_count(len(world.tendons), 'tendon')} ({_count(particles, 'particle')})"]
    parts += [_count(len(world.tunnels), "tunnel")] if world.tunnels else []
    parts += [_count(len(world.ligaments), "ligament")] if world.ligaments else []
    parts += [_count(len(world.cartilages), "cartilage")] if world.cartilages else []
    obstacles = len(world._obstacles.listing())
    parts += [_count(obstacles, "obstacle link")] if obstacles else []
    return f"<TendonWorld of client {world.physicsClientId}: {', '.join(parts)}>"


def describe(world) -> str:
    """The page of TendonWorld.describe."""
    advice = advise(world)
    lines = [summary(world)[1:-1], *_settings(world), *_contents(world), *_last_step(world), "advice:"]
    lines += [f"  - {line}" for line in advice] if advice else ["  nothing that looks wrong"]
    return "\n".join(lines)


def advise(world) -> list[str]:
    """Sentences about what is set badly; none, where nothing is."""
    dt = p.getPhysicsEngineParameters(world.physicsClientId)["fixedTimeStep"]
    lines = []
    for tendon in world.tendons:
        lines += [*_resolution(world, tendon), *_speed(tendon, dt), *_damping(world, tendon)]
    return [*lines, *_units(world), *_friction(world), *_inside(world), *_convergence(world)]


def _settings(world) -> list[str]:
    told = p.getPhysicsEngineParameters(world.physicsClientId)
    gravity = ", ".join(f"{told['gravityAcceleration' + axis]:g}" for axis in "XYZ")
    step = f"time step {1e3 * told['fixedTimeStep']:.4g} ms"
    return [f"{step}, gravity ({gravity}) m/s^2, {world.options.integrator}"]


def _contents(world) -> list[str]:
    lines = [f"  {part!r}" for part in (*world.tendons, *world.tunnels, *world.ligaments, *world.cartilages)]
    for body, link, *numbers in world._obstacles.listing():
        kinds = sorted({world._obstacles.shapes[number].kind for number in numbers})
        friction = world._obstacles.friction(body, link)
        lines.append(f"  obstacle body {body}, link {link}: {', '.join(kinds)}, friction {friction:g}")
    return lines


def _last_step(world) -> list[str]:
    report = world.report
    total = sum(report.seconds.values())
    if not report.counts:
        return ["no step yet"]
    rooms = ", ".join(f"{room} {1e6 * report.seconds[room]:.0f}" for room in ROOMS)
    lines = [f"last step {1e6 * total:.0f} us: {rooms}", f"  {report!r}"]
    told = [f"{report.counts[key]} {what}" for key, what in _CONSIDERED if report.counts.get(key)]
    if told:
        lines.append("  distances: " + "; ".join(told))
    for reason, count in report.reasons.items():
        lines.append(f"  solved again or cut {_count(count, 'time')}: {reason.replace('_', ' ')}")
    return lines


def _resolution(world, tendon) -> list[str]:
    """Of a tendon that turns too far at a particle that a body presses on."""
    contacts = world.contacts
    touching = contacts[(contacts["tendon"] == tendon.name) & (contacts["normal_force"] > 0)]
    touching = touching[touching["bodyUniqueId"] >= 0]
    if not len(touching):
        return []
    chords = np.diff(tendon.positions, axis=0)
    chords /= np.maximum(np.linalg.norm(chords, axis=1), 1e-12)[:, None]
    turns = np.degrees(np.arccos(np.clip(np.einsum("ij,ij->i", chords[1:], chords[:-1]), -1, 1)))
    near = np.unique(np.clip(np.r_[touching["segment"], touching["segment"] - 1], 0, len(turns) - 1))
    worst = near[np.argmax(turns[near])]
    if turns[worst] <= _TURN:
        return []
    needed = math.ceil((tendon.particles - 1) * turns[worst] / _TURN) + 1
    length = 1e3 * tendon.rest_length / (tendon.particles - 1)
    return [
        f"{tendon.name!r} turns by {turns[worst]:.0f} degrees at particle {worst + 1}, pressed by a body: "
        f"its segments of {length:.2g} mm are long for that curvature. Give it {needed} particles for "
        f"{_TURN:.0f} degrees"
    ]


def _speed(tendon, dt: float) -> list[str]:
    """Of a tendon that moves farther than its radius in a step."""
    fastest = float(np.linalg.norm(tendon.velocities, axis=1).max())
    if fastest * dt <= tendon.radius:
        return []
    return [
        f"{tendon.name!r} moves at {fastest:.3g} m/s, {fastest * dt / tendon.radius:.1f} radii a step: where "
        f"anything is near, steps are divided. {1e3 * tendon.radius / fastest:.2g} ms a step are enough"
    ]


def _damping(world, tendon) -> list[str]:
    """Of damping that is far from what the stiffness needs: by damping over stiffness, and where it is 0."""
    law = tendon.material
    if law.damping_exponent != 1.0:
        return []
    strain = max(float(np.max(tendon.strain)), min(_WORKING_STRAIN, law.toe))
    slope = law.stiffness * law.exponent * min(strain, law.toe) ** (law.exponent - 1)
    time = law.damping / slope
    if time > _SLOW:
        return [
            f"{tendon.name!r} takes {time:.2g} s to go back from a stretch (damping over stiffness): a "
            f"damping of {0.1 * _SLOW * slope:.3g} N s makes it {0.1 * _SLOW:g} s"
        ]
    if law.damping == 0 and world.options.integrator != "implicit_euler":
        return [
            f"{tendon.name!r} has no damping, and {world.options.integrator} gives little: it rings on. With "
            f"{_BRISK * slope:.2g} N s a stretch goes back in {1e3 * _BRISK:g} ms"
        ]
    return []


def _units(world) -> list[str]:
    """Of tunnels that are far longer, or far shorter, than the link that they are in is large."""
    lines = []
    for tunnel in world.tunnels:
        shapes = world._obstacles.of_link(tunnel.bodyUniqueId, tunnel.linkIndex)
        size = max((float(np.ptp(shape.bounds, axis=0).max()) for shape in shapes), default=math.inf)
        length = float(np.linalg.norm(tunnel.end - tunnel.start))
        least, most = _PROPORTIONS
        if math.isfinite(size) and not least * length <= size <= most * length:
            lines.append(
                f"tunnel {tunnel.name!r} is {length:.3g} m long, and the shapes of its link are {size:.3g} m "
                "large: give both in metres (meshScale is 0.001 for files in millimetres)"
            )
    return lines


def _friction(world) -> list[str]:
    lines = []
    smooth = [tendon.name for tendon in world.tendons if tendon.material.friction == 0 and tendon.collides]
    if smooth and world._obstacles:
        names = ", ".join(map(repr, smooth))
        lines.append(
            f"{names}: the material's friction is 0, so every contact is smooth, whatever it touches"
        )
    for body, link, *_ in world._obstacles.listing():
        if world._obstacles.friction(body, link) == 0:
            lines.append(
                f"obstacle body {body}, link {link} has no friction: give add_obstacle(friction=), or "
                "p.changeDynamics(lateralFriction=)"
            )
    return lines


def _inside(world) -> list[str]:
    found = world.penetrations()
    lines = []
    for name in dict.fromkeys(found["tendon"].tolist()):
        rows = found[found["tendon"] == name]
        tendon = next(t for t in world.tendons if t.name == name)
        rows = [r for r in rows if tendon._may_meet(int(r["bodyUniqueId"]), int(r["linkIndex"]))]
        if rows and not all(_is_insertion(tendon, row) for row in rows):
            lines.append(
                f"{name!r} is inside body {rows[0]['bodyUniqueId']}: see world.penetrations(), and "
                "add_tendon(inside='push_out')"
            )
    return lines


def _is_insertion(tendon, row) -> bool:
    attached = [hold for hold in tendon.holds if isinstance(hold, Attachment)]
    return any((a.bodyUniqueId, a.linkIndex) == (row["bodyUniqueId"], row["linkIndex"]) for a in attached)


def _convergence(world) -> list[str]:
    report = world.report
    if report.converged:
        return []
    if report.over_budget:
        return ["the last step was stopped by its budget: raise max_linear_solves or time_budget"]
    if not report.stops_settled:
        return ["the last step's joint limits, motors and contacts did not settle: shorten the time step"]
    found = f"the last step was not solved (residual {report.residual:.2g})"
    return [f"{found}: shorten the time step or lower the load"]


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"
