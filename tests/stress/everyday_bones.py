"""Scenes of tendons in and on bones: bores, oblique mouths, meshes, sheets, plates, what starts inside."""

import numpy as np
from brute_force import Triangles, subdivided
from everyday_scene import Scene, family, turning
from scipy.spatial import ConvexHull


def bone(count, sizes, waves):
    """Vertices and triangles of a smooth closed surface: a sphere of even points, stretched and waved."""
    i = np.arange(count) + 0.5
    z, a = 1 - 2 * i / count, 2.3999632 * i
    d = np.c_[np.sqrt(1 - z * z) * np.cos(a), np.sqrt(1 - z * z) * np.sin(a), z]
    faces = ConvexHull(d).simplices
    p, q, r = d[faces].transpose(1, 0, 2)
    inward = np.einsum("ij,ij->i", np.cross(q - p, r - p), p) < 0
    faces[inward] = faces[inward][:, ::-1]
    swell = 1 + sum(h * np.sin(d @ np.array([u, v, w]) + f) for h, u, v, w, f in waves)
    return d * np.array(sizes) * swell[:, None], faces


def random_bone(scene: Scene, count=None, waves=3, friction=0.0):
    """A bone around the origin; returns its body and triangles (t, 3, 3)."""
    sizes = [scene.flat(0.02, 0.05) for _ in range(3)]
    waved = [[scene.flat(0, 0.06), *(scene.flat(-3, 3) for _ in range(4))] for _ in range(waves)]
    count = scene.pick(300, 600, 1000) if count is None else count
    (vertices, faces), name = scene.source(bone, count, sizes, waved)
    return scene.mesh(vertices, faces, name, friction=friction), vertices[faces]


def surface_on(triangles, origin, way):
    """Where a ray leaves a surface for good: its farthest crossing, and the face's normal."""
    a, b, c = np.moveaxis(triangles, 1, 0)
    normal = np.cross(b - a, c - a)
    facing = normal @ way
    with np.errstate(divide="ignore", invalid="ignore"):
        t = np.einsum("ij,ij->i", a - origin, normal) / facing
    x = origin + t[:, None] * way
    inside = np.isfinite(t) & (t > 0)
    for u, v in ((a, b), (b, c), (c, a)):
        inside &= np.einsum("ij,ij->i", np.cross(v - u, x - u), normal) >= 0
    k = np.flatnonzero(inside)[np.argmax(t[inside])]
    return x[k], normal[k] / np.linalg.norm(normal[k])


def drilled(scene, body, first, last, radius, fit, chamfer):
    """A bore from mouth to mouth, as URDF frames have it (the body's base is the world's frame here)."""
    scene.world.add_tunnel(body, -1, first, last, radius, friction=1.0, chamfer=chamfer, name="bore")
    return round(fit * radius, 7)


def graft_through(scene, first, last, radius, force, mu):
    """A tendon along a bore's axis and out of both ends by 25-60 mm."""
    way = (last - first) / np.linalg.norm(last - first)
    line = [first - scene.flat(0.025, 0.06) * way, last + scene.flat(0.025, 0.06) * way]
    return scene.world.add_tendon(line, radius, scene.material(force, friction=mu), scene.whole(30, 60)), way


def clearance(scene, point) -> float:
    """Distance of a point from the nearest solid [m]."""
    return min(scene.gaps(point[None], solid)[0] for solid in scene.solids)


def led_sideways(scene, tendon, way, force, mu):
    """One end is pulled, the other is led out and sideways by a soft or rigid hand; then all is judged."""
    tendon.set_force(0, -force * way)
    soft = {"stiffness": scene.log(200, 2e4), "damping": scene.flat(0, 5)}
    hand = tendon.grip(-1, **scene.pick(soft, soft, {}))
    side = np.cross(way, scene.direction())
    out, aside = scene.flat(0.002, 0.02) * way, scene.flat(0, 0.04) * side / np.linalg.norm(side)
    # What a hand leads into a solid, no contact keeps out.
    if clearance(scene, hand._target.target + out + aside) < 2 * tendon.radius:
        aside = -aside
    scene.lead(hand, out + aside, 2 * scene.steps // 3)
    scene.run(scene.steps - 2 * scene.steps // 3)
    scene.in_clearance()
    scene.no_opposed_contacts()
    scene.capstan_range(tendon, mu, scene.restless(tendon), edges=True, wedges=True)


def led_through_bore(scene, body, first, last, radius, force, mu):
    """Drill a bore of this radius [m] from first to last, and lead a graft in it sideways."""
    graft = drilled(scene, body, first, last, radius, scene.flat(0.5, 0.95), scene.pick(0.0, 0.2 * radius))
    tendon, way = graft_through(scene, first, last, graft, force, mu)
    led_sideways(scene, tendon, way, force, mu)


@family
def oblique_mouth(scene):
    """A bore at 0.5-0.9 rad to a box's face, its mouth 0-3 mm below it: the graft stays out of the bone."""
    scene.begin(gravity=False)
    size, tilt = scene.flat(0.04, 0.08), scene.flat(0.5, 0.9)
    radius, below = scene.log(1.5e-3, 5e-3), scene.flat(0, 3e-3)
    mu, force = scene.pick(0.0, scene.flat(0.02, 0.5)), scene.log(0.5, 500)
    body = scene.body("box", (4 * size, 4 * size, size), friction=1.0)
    way = np.array([np.sin(tilt), 0, np.cos(tilt)])
    last = (size / 2 - below) / np.cos(tilt) * way
    first = -size / 2 / np.cos(tilt) * way
    led_through_bore(scene, body, first, last, radius, force, mu)


@family
def graft_in_bone(scene):
    """A graft through a random bore of a random bone, led sideways under load."""
    scene.begin(gravity=False)
    mu, force = scene.pick(0.0, scene.flat(0.02, 0.5)), scene.log(0.5, 1000)
    body, triangles = random_bone(scene, friction=1.0)
    axis, through = scene.direction(), 0.2 * np.ptp(triangles, axis=(0, 1)) * scene.rng.uniform(-0.5, 0.5, 3)
    last, first = (surface_on(triangles, through, s * axis)[0] for s in (1, -1))
    radius = scene.log(1.5e-3, 4e-3)
    first, last = first + scene.flat(0, 2e-3) * axis, last - scene.flat(0, 2e-3) * axis
    led_through_bore(scene, body, first, last, radius, force, mu)


@family
def tight_bore(scene):
    """A tendon of nearly the bore's radius runs in it; one as wide, or wider, is refused."""
    scene.begin(gravity=False)
    length, bore = scene.flat(0.02, 0.08), scene.log(1e-3, 5e-3)
    fit = scene.pick(scene.flat(0.9, 0.999), 1.0, scene.flat(1.0, 1.3))
    force = scene.log(0.1, 1000)
    body = scene.body("box", (0.1, 0.1, length))
    way = np.array([0, 0, 1.0])
    add = [
        lambda: scene.world.add_tunnel(body, -1, [0, 0, -length / 2], [0, 0, length / 2], bore, friction=0.0),
        lambda: graft_through(scene, -length / 2 * way, length / 2 * way, round(fit * bore, 9), force, 0.0),
    ]
    made = [part() for part in (add if scene.coin() else add[::-1])]
    tendon = next(m[0] for m in made if isinstance(m, tuple))
    tendon.set_force(0, -force * way)
    hand = tendon.grip(-1)
    steps = 3 if fit >= 1 else scene.steps
    scene.lead(hand, scene.flat(0.001, 0.02) * way, steps)
    scene.check(fit < 1, f"a tendon of {tendon.radius} m was let into a bore of {bore} m")
    # A straight smooth bore takes nothing.
    t = tendon._target
    scene.near("tensions", t.tension[0], t.tension[-1], absolute=1e-3 * force + scene.restless(tendon))
    scene.in_clearance()


@family
def suture(scene):
    """A suture through holes of one to three plates: the tension stays in the capstan's range."""
    scene.begin(gravity=False)
    mu, force = scene.pick(0.0, scene.flat(0.02, 0.4)), scene.log(0.1, 100)
    radius, thick = scene.log(2e-4, 1e-3), scene.flat(2e-3, 6e-3)
    bore, plates = scene.flat(1.3, 3) * radius, scene.whole(1, 3)
    gap, line = scene.flat(0.008, 0.02), []
    for k in range(plates):
        z = k * (thick + gap)
        body = scene.body("box", (0.06, 0.06, thick), 0, (0, 0, z), friction=1.0)
        shift = scene.flat(-0.3, 0.3) * gap
        scene.world.add_tunnel(body, -1, [shift, 0, -thick / 2], [shift, 0, thick / 2], bore, friction=1.0)
        line += [[shift, 0, z - thick / 2 - 0.1 * gap], [shift, 0, z + thick / 2 + 0.1 * gap]]
    line = [[line[0][0], 0, -0.03], *line, [line[-1][0], 0, line[-1][2] + 0.03]]
    tendon = scene.world.add_tendon(line, radius, scene.material(force, friction=mu), 60)
    tendon.set_force(0, (0, 0, -force))
    hand = tendon.grip(-1)
    scene.lead(hand, (scene.flat(-0.01, 0.01), 0, scene.flat(0.001, 0.01)), 2 * scene.steps // 3)
    scene.run(scene.steps // 3)
    scene.in_clearance()
    scene.no_opposed_contacts()
    scene.capstan_range(tendon, mu, scene.restless(tendon), edges=True)


@family
def over_coarse_bone(scene):
    """Without friction the tension over a bone of any coarseness is the same at both ends.

    A chain of segments on facets comes to rest where corners of both catch: a twentieth.
    """
    scene.begin(gravity=False)
    force = scene.log(1, 2000)
    body, triangles = random_bone(scene, scene.pick(60, 120, 300), waves=1)
    tendon, way = draped(scene, triangles, force, 0.0, scene.whole(40, 60))
    scene.no_opposed_contacts()
    t = tendon._target
    ratio = t.tension[0] / t.tension[-1]
    slack = scene.restless(tendon) / max(t.tension[-1], 1e-9)
    if len(scene.world.contacts) and not any("resol" in text or "coarse" in text for text in scene.told):
        scene.near("ratio of the ends' tensions", ratio, 1, absolute=0.05 + slack)


def draped(scene, triangles, force, mu, particles, radius=None):
    """A tendon laid over a mesh by a hull of its section in the plane y = 0, pulled down at both ends."""
    radius = scene.log(1e-3, 4e-3) if radius is None else radius
    corners = triangles.reshape(-1, 3)
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    cut = edges[(edges[:, 0, 1] < 0) & (edges[:, 1, 1] >= 0)]
    u = -cut[:, 0, 1] / (cut[:, 1, 1] - cut[:, 0, 1])
    section = (cut[:, 0] + u[:, None] * (cut[:, 1] - cut[:, 0]))[:, [0, 2]]
    angles = np.linspace(np.pi, 0, 61)
    facing = np.c_[np.cos(angles), np.sin(angles)]
    # The section's hull, farther out by the radius and what a bone that is not a prism sticks out beside it.
    off = 1.6 * radius + 5e-4
    far = (section @ facing.T).argmax(0)
    over = section[far] + off * facing
    low = corners[:, 2].min() - 0.02
    line = np.vstack([[over[0][0], 0, low], np.c_[over[:, 0], 0 * angles, over[:, 1]], [over[-1][0], 0, low]])
    keep = np.r_[True, np.linalg.norm(np.diff(line, axis=0), axis=1) > 1e-5]
    tendon = scene.world.add_tendon(line[keep], radius, scene.material(force, friction=mu), particles)
    tendon.set_force(0, (0, 0, -force))
    hand = tendon.grip(-1)
    scene.run(scene.steps // 3)
    scene.lead(hand, (0, 0, -scene.flat(0.0005, 0.004)), scene.steps // 3)
    scene.run(scene.steps - 2 * (scene.steps // 3))
    return tendon, hand


@family
def over_bone(scene):
    """A tendon over a smooth random bone with friction: capstan's range, and forces that balance."""
    scene.begin(gravity=False)
    mu, force = scene.flat(0.0, 0.5), scene.log(0.5, 2000)
    _, triangles = random_bone(scene, scene.pick(600, 1000), friction=1.0)
    tendon, hand = draped(scene, triangles, force, mu, scene.whole(40, 60))
    scene.no_opposed_contacts()
    scene.capstan_range(tendon, mu, scene.restless(tendon) + 0.02 * force, edges=True)


@family
def folded_over_bone(scene):
    """The same with bending stiffness, which keeps corners round and makes no step hang."""
    scene.begin(gravity=False)
    force = scene.log(0.5, 100)
    _, triangles = random_bone(scene, 600, friction=1.0)
    mu = scene.flat(0.0, 0.5)
    material = scene.material
    scene.material = lambda *a, **k: material(*a, **k, bending_stiffness=scene.log(1e-6, 1e-3))
    draped(scene, triangles, force, mu, scene.whole(40, 60))
    scene.no_opposed_contacts()


@family
def grip_against_bone(scene):
    """A hand of limited strength leads an end against a box or a bone, and slips."""
    scene.begin(gravity=False)
    force, size = scene.log(1, 500), scene.flat(0.02, 0.05)
    if scene.coin():
        scene.body("box", (2 * size, 2 * size, 2 * size), friction=scene.flat(0, 1))
    else:
        random_bone(scene, 300, friction=scene.flat(0, 1))
        size = np.ptp(scene.solids[0][3], axis=(0, 1))[2] / 2
    radius = scene.log(5e-4, 3e-3)
    line = [[0.003, 0.002, size + 0.01 + 0.1], [0.003, 0.002, size + 0.01]]
    t = scene.world.add_tendon(line, radius, scene.material(force), scene.whole(10, 60))
    most = scene.log(1, 200)
    hand = t.grip(-1, max_force=most)
    t.grip(0, stiffness=1000.0)
    below = -scene.flat(0.01, 0.02) * np.array([0.2, 0, 1])
    scene.lead(hand, below, scene.steps, watch=lambda: within(scene, hand))


def within(scene, hand):
    """A hand with a limit never gives more, and says where it slips."""
    strength, most = np.linalg.norm(hand.force), hand.max_force
    scene.check(strength <= most * (1 + 1e-6), f"the hand gives {strength:.6g} N, at most {most}")
    t = scene.tendons[0]
    away = np.linalg.norm(t.positions[hand.particle] - hand.target)
    # Until it slips it yields by a thousandth of the radius, as it is documented.
    scene.check(
        hand.slipping or away < 1.01e-3 * t.radius,
        f"the hand is {away:.3g} m off its place and does not say so",
    )


@family
def starts_inside(scene):
    """A tendon that begins in a bone: refused, pushed out, or told of; it does not fly away."""
    scene.begin(gravity=scene.coin())
    inside = scene.pick("allow", "push_out", "error")
    if scene.coin():
        size = scene.flat(0.02, 0.05)
        scene.body("box", (2 * size, 2 * size, 2 * size), friction=scene.flat(0, 1))
    else:
        random_bone(scene, 300, friction=scene.flat(0, 1))
        size = np.ptp(scene.solids[0][3], axis=(0, 1))[2] / 2
    depth, radius = scene.log(1e-4, 0.015), scene.log(5e-4, 3e-3)
    x = scene.flat(0.06, 0.1)
    line = [(-x, 0.001, size - depth), (x, 0.001, size - depth)]
    t = scene.world.add_tendon(line, radius, scene.material(10.0), scene.whole(10, 60), inside=inside)
    points = subdivided(t.positions, 8)
    deepest = -min(scene.gaps(points, solid).min() for solid in scene.solids)
    message = f"a centreline {deepest:.3g} m inside was accepted with inside={inside!r}"
    scene.check(inside == "allow" or deepest < 0.01 * radius, message)
    t.grip(0)
    t.grip(-1)
    if inside == "allow":  # documented: it is kept inside
        scene.solids.clear()
        scene.energy = False
    # A surface that overlaps an edge is pushed off it, which lifts the tendon by a radius at most.
    scene.work += t._target.masses.sum() * np.linalg.norm(scene.gravity) * radius
    scene.run(scene.steps)
    far = np.abs(t.positions).max()
    scene.check(far < 3 * x, f"thrown {far:.3g} m away")


def sheet(rows, columns, sizes, bulge, across):
    """Vertices and triangles of a thin open sheet, bulged upwards along x, and by `across` along y."""
    u, v = np.meshgrid(np.linspace(-1, 1, rows), np.linspace(-1, 1, columns), indexing="ij")
    vertices = np.stack([sizes[0] * u, sizes[1] * v, -bulge * u * u - across * v * v], -1).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(rows - 1), np.arange(columns - 1), indexing="ij")
    at = lambda i, j: (i * columns + j).ravel()  # noqa: E731
    first = np.stack([at(i, j), at(i + 1, j), at(i + 1, j + 1)], -1)
    return vertices, np.concatenate([first, np.stack([at(i, j), at(i + 1, j + 1), at(i, j + 1)], -1)])


@family
def thin_sheet(scene):
    """A tendon drawn over a thin open sheet (cartilage) by up to 2 kN does not pass through it."""
    scene.begin(gravity=False)
    force, bulge = scene.log(1, 2000), scene.flat(0.004, 0.03)
    sizes, rows = [scene.flat(0.02, 0.05), 0.02], scene.whole(8, 24)
    mu = scene.pick(0.0, scene.flat(0.02, 0.4))
    # On a ridge it would slide down, and off the sheet: it lies in a groove.
    across = -scene.flat(0.2, 0.8) * bulge
    (vertices, faces), name = scene.source(sheet, rows, rows, sizes, bulge, across)
    scene.mesh(vertices, faces, name, friction=1.0)
    scene.solids.clear()  # it has no inside
    radius = scene.log(8e-4, 3e-3)
    # A line off its surface, its ends pulled down beside the sheet, where no edge is met.
    a = np.linspace(-1.2, 1.2, 40)
    steep = np.c_[2 * bulge / sizes[0] * a, 0 * a, 1 + 0 * a]
    off = (1.05 * radius + 5e-4) * steep / np.linalg.norm(steep, axis=1)[:, None]
    line = np.c_[sizes[0] * a, 0 * a + 1e-4, -bulge * a * a] + off
    t = scene.world.add_tendon(line, radius, scene.material(force, friction=mu), scene.whole(30, 60))
    slope = np.array([1, 0, -2.4 * bulge / sizes[0]])
    slope /= np.linalg.norm(slope)
    t.set_force(0, force * slope * (-1, 1, 1))
    hand = t.grip(-1)
    triangles = Triangles(vertices[faces])
    off_the_side = []  # a tendon can slide down the side, and then pass below the sheet

    def above():
        """Every segment above the sheet by its radius, but at the sheet's border."""
        x = t.positions
        over = np.abs(x[:, 0]) < sizes[0]
        if (np.abs(x[over, 1]) > 0.9 * sizes[1]).any():
            off_the_side.append(True)
        if len(scene.seconds) % 60 or off_the_side:
            return
        moved = min(np.abs(t.velocities).max() * scene.dt, radius / 2)
        for a, b in zip(x[:-1], x[1:], strict=True):
            if max(abs(a[0]), abs(b[0])) < 0.95 * sizes[0] and max(abs(a[1]), abs(b[1])) < 0.9 * sizes[1]:
                gap = triangles.distance(a, b)
                below = (
                    -bulge * (a[0] / sizes[0]) ** 2 - across * (a[1] / sizes[1]) ** 2 > a[2] + 0.5 * radius
                )
                scene.check(not below, f"a particle is below the sheet, at {np.round(a, 5).tolist()}")
                scene.check(gap > 0.95 * radius - moved, f"{gap:.3g} m from the sheet (radius {radius})")

    scene.run(scene.steps // 2, watch=above)
    scene.lead(hand, scene.flat(0.001, 0.005) * slope, scene.steps // 2, watch=above)
    if not off_the_side:
        scene.capstan_range(t, mu, scene.restless(t) + 0.02 * force, edges=True)


@family
def end_pushed_on_plate(scene):
    """A free end is pushed on a flat plate by up to 5 N: it stays above, and the plate carries the push."""
    scene.begin(gravity=scene.coin())
    radius, length, force = scene.log(5e-4, 3e-3), scene.flat(0.01, 0.08), scene.log(0.01, 5)
    scene.body("box", (0.4, 0.4, 0.04), 0, (0, 0, -0.02), friction=scene.flat(0, 1))
    tilt = scene.flat(0, 0.8)
    way = np.array([np.sin(tilt), 0, np.cos(tilt)])
    foot = np.array([0, 0, 1.05 * radius])
    bending = scene.pick(0.0, scene.log(1e-6, 1e-3))
    material = scene.material(10 * force, bending_stiffness=bending)
    t = scene.world.add_tendon([foot, foot + length * way], radius, material, scene.whole(5, 60))
    if scene.coin():
        t.set_force(0, (0, 0, -force))
    t.set_force(-1, -force * way)
    scene.run(scene.steps)


@family
def laid_on_each_other(scene):
    """Tendons laid along the same line, or nearly, part until they only touch."""
    scene.begin(gravity=False)
    radius, count, length = scene.log(5e-4, 3e-3), scene.whole(2, 3), scene.flat(0.05, 0.2)
    material, n = scene.material(50.0), scene.whole(5, 40)
    for _ in range(count):
        off = scene.pick(0.0, scene.log(1e-6, 1.0) * radius)
        side = off * scene.direction() * (0, 1, 1)
        t = scene.world.add_tendon([side, side + (length, 0, 0)], radius, material, n)
        scene.code(f"{t._name}.grip(0), {t._name}.grip(-1)")
    scene.grips += [h for t in scene.tendons for h in t.holds]
    scene.energy = False  # what overlaps is pushed apart
    scene.run(scene.steps)
    # In the middle they touch at most; beside the ends, their distance grows by a tenth of the arc length.
    middle = [subdivided(t.positions, 4)[2 * (n - 1) - 2 : 2 * (n - 1) + 3] for t in scene.tendons]
    right = min(2 * radius, 0.05 * length)
    for k, x in enumerate(middle):
        for y in middle[:k]:
            apart = np.linalg.norm(x[:, None] - y, axis=2).min()
            scene.check(apart > 0.8 * right, f"{apart:.3g} m apart instead of {right:.3g}")
    scene.check(max(turning(t.positions).max() for t in scene.tendons) < 2.5, "folded")
