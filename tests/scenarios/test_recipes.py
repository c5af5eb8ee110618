"""The manual's recipes run as they stand, and what they find agrees with laws that are not this code's."""

import runpy
from pathlib import Path

import numpy as np
import pybullet as p
import pytest
from bullet_tendon.scenarios import measure, topology

RECIPES = Path(__file__).parents[2] / "scenarios" / "manual" / "recipes"
CLIENTS = 16  # the most that a recipe connects
G = 9.81  # m/s^2

pytest.importorskip("matplotlib", reason="recipes draw figures")


@pytest.fixture
def run(tmp_path, monkeypatch):
    """run(name) -> what a recipe has defined at its end. Its clients stay open until the test ends."""
    monkeypatch.chdir(tmp_path)
    yield lambda name: runpy.run_path(str(RECIPES / f"{name}.py"))
    for client in range(CLIENTS):
        if p.isConnected(client):
            p.disconnect(client)


def size(vector) -> float:
    return float(np.linalg.norm(vector))


def test_graft_in_my_knee(run):
    """The bones carry the pull and the graft's weight, and friction takes about a capstan's share."""
    got = run("graft_in_my_knee")
    graft, way = got["graft"], np.diff(got["way"], axis=0)
    way /= np.linalg.norm(way, axis=1)[:, None]
    turns = np.arccos((way[1:] * way[:-1]).sum(1)).sum()
    mu = graft.material.friction * 0.5
    assert graft.tension[0] == pytest.approx(80, rel=1e-3)
    assert 80 * np.exp(-2 * mu * turns) < graft.tension[-1] < 80  # one particle turns round each edge
    bones = got["world"].wrench(got["femur"])[:3] + got["world"].wrench(got["tibia"])[:3]
    assert bones == pytest.approx(80 * got["down"] + [0, -G * graft.masses.sum(), 0], abs=0.05)
    assert len(got["world"].penetrations()) == 0


def test_ligament_with_slack(run):
    def blankevoort(strain, slope=2000, toe=0.06):
        toe_force = slope * max(strain, 0) ** 2 / (2 * toe)
        return toe_force if strain < toe else slope * (strain - toe / 2)

    measured = run("ligament_with_slack")["measured"]
    assert [force for _, force in measured] == pytest.approx([1, 10, 30, 60, 90, 120], rel=1e-3)
    for length, force in measured:
        assert force == pytest.approx(blankevoort(length / 0.032 - 1), rel=1e-3)


def test_tissue_over_time(run):
    """Relaxation by its convolution, hysteresis as it was measured, rupture at the published load."""
    got = run("tissue_over_time")
    material, held = got["material"], np.array(got["held"])
    ramp = np.arange(25) / 240
    elastic = material.stiffness * (0.01 * np.minimum(1, ramp / 0.1)) ** 2  # within the toe
    steps = np.diff(elastic)
    for at in (24, 240, 2400):
        late = (at + 1) / 240 - ramp[:-1] - 0.5 / 240  # in the middle of each step of the ramp
        relaxed = sum(g * (1 - np.exp(-late / time)) for g, time in material.relaxation)
        assert held[at] == pytest.approx((steps * (1 - relaxed)).sum(), rel=2e-3)
    assert 0.06 < got["loss"] < 0.11
    assert got["strength"] == pytest.approx(2422, rel=1e-3)
    assert size(got["hand"].force) < 1


def test_cartilage_of_my_joint(run):
    """The elastic foundation under a sphere: force pi K R d^2, area 2 pi R d, greatest pressure K d."""
    got = run("cartilage_of_my_joint")
    k = 10e6 * 0.55 / (1.45 * 0.1) / 0.006
    for load, depth, force, area, pressure in got["measured"]:
        assert force == pytest.approx(load, rel=1e-3)
        assert force == pytest.approx(np.pi * k * 0.03 * depth**2, rel=0.02)
        assert area == pytest.approx(2 * np.pi * 0.03 * depth, rel=0.05)
        assert pressure == pytest.approx(k * depth, rel=0.02)


def test_laxity_of_my_knee(run):
    """The tibia is in equilibrium, and its ACL is what holds the knee of a Lachman test."""
    got = run("laxity_of_my_knee")
    rig, intact, cut = got["rig"], got["intact"], got["cut"]
    assert intact == sorted(intact) and cut == sorted(cut)
    assert 3.5 < intact[-1] < 8.5 and 10.4 < cut[-1] < 15.4  # mm, cadavers within a standard deviation
    assert got["shares"]["ACLam"] > 40 and not any(group.startswith("ACL") for group in rig.forces)
    axes = np.reshape(p.getMatrixFromQuaternion(p.getLinkState(*rig.tibia, 0, 1, rig.client)[5]), (3, 3))
    total = 90 * axes[:, 0] + rig.cartilage.wrench[:3] * (1 if rig.cartilage.second == rig.tibia else -1)
    for name, ligament in rig.ligaments.items():
        points = np.array(ligament.points)  # from the femur, around a bone or not, to the tibia
        on_tibia = any(c.bone == "tibia" for c in rig.strands[name].cylinders) and len(points) == 4
        way = points[0] - points[1] if on_tibia else points[-2] - points[-1]
        total += ligament.force * way / size(way)
    assert size(total) < 0.1
    rig.close()


def test_learn_a_task(run):
    pytest.importorskip("gymnasium.vector", reason="the recipe needs gymnasium (extra gym)")
    got = run("learn_a_task")
    assert sum(got["by_expert"]) > sum(got["at_random"])
    assert len(got["by_expert"]) < 120 == len(got["at_random"])
    seen = got["vector_observations"](3, 5)
    for seed in range(3):
        got["env"].reset(seed=seed)
        for _ in range(5):
            alone, *_ = got["env"].step(np.zeros(2, np.float32))
        assert np.array_equal(alone, seen[seed])
    got["env"].close()


def test_pretension_and_fixation(run):
    """Two springs in parallel: of a pull against the world the graft keeps k_joint / (k_joint + k_graft)."""
    got = run("pretension_and_fixation")
    graft, joint = np.array(got["history"]).T
    assert graft[[200, 700]] == pytest.approx(80, rel=1e-3)
    assert joint[[200, 700]] == pytest.approx([0, 80], abs=0.1)
    assert got["by_hand"] == pytest.approx(80 * 150 / 350, rel=1e-3)
    assert joint[479] == pytest.approx(80 * 150 / 350, rel=1e-3)
    assert got["by_tensioner"] == pytest.approx(80, rel=0.01)


def test_multi_strand_graft(run):
    """Torques about the bone's centre are in balance, and each strand follows its law."""
    got = run("multi_strand_graft")
    forces = np.array(got["forces"])
    assert forces.sum() == pytest.approx(400, rel=1e-3)
    assert forces[:2] == pytest.approx(forces[2:], rel=1e-3)
    slope, strains = 1.5e9 * 57e-6 / 4, np.array([strand.strain.mean() for strand in got["strands"]])
    assert forces == pytest.approx(slope * strains**2 / 0.06, rel=2e-3)  # within the toe of 3 %


def test_torque_controlled_arm(run):
    """The controller's springs carry the weight, by the mass matrix of two rods in closed form."""
    got = run("torque_controlled_arm")
    load = G * (1 + got["cord"].masses.sum())
    m, length = 0.5, 0.3
    inertia, square = m * (length**2 + 0.02**2) / 12, m * length**2
    for rate, off in ((30, got["soft"]), (120, got["stiff"])):
        first, second = np.radians(off) + got["aim"]
        c = np.cos(second)
        last = inertia + square / 4
        both = last + square / 2 * c
        mass = [[2 * both - last + inertia + 1.25 * square, both], [both, last]]
        x = length * np.cos([first, first + second])  # a turn about y lowers what is at x > 0
        held = np.array(mass) @ (rate**2 * -np.radians(off))
        assert held == pytest.approx(-load * np.array([x.sum(), x[1]]), rel=5e-3)  # it swings by a little
    assert got["told"] == pytest.approx(0, abs=0.01)
    assert got["cord"].tension == pytest.approx(G, rel=2e-3)


def test_tendon_over_pulley(run):
    got = run("tendon_over_pulley")
    assert got["loaded"] == pytest.approx(G, rel=1e-2)
    assert got["pulled"] / got["loaded"] == pytest.approx(np.exp(0.2 * np.pi), rel=1e-2)


def test_suture_and_knot(run):
    """Under the pull of the hands the knot stays a trefoil (determinant 3), and passes through nothing."""
    got = run("suture_and_knot")
    suture, radius = got["suture"], got["radius"]
    assert topology.determinant(topology.closed_far(suture.positions)) == 3
    assert suture.tension[[0, -1]] == pytest.approx(5, rel=1e-3)
    rest = measure.rest_lengths(suture)
    assert measure.with_itself(suture.positions, np.pi * radius, rest) > 0.97 * 2 * radius


def test_finger_from_my_urdf(run):
    """About the hinge: tension times arm carries the phalanx's weight (upwards here) and the damping."""
    got = run("finger_from_my_urdf")
    angle, rate = p.getJointState(got["finger"], 0)[:2]
    x = got["flexor"].positions
    nearest = np.argmin(np.linalg.norm(0.5 * (x[1:] + x[:-1]), axis=1))
    along = (x[nearest + 1] - x[nearest]) / size(x[nearest + 1] - x[nearest])
    arm = size(np.cross(x[nearest], along))
    weight = 0.03 * G * 0.02 * np.cos(angle)
    assert 1.2 < angle < 1.5
    assert got["flexor"].tension[nearest] * arm == pytest.approx(weight + 0.0005 * rate, rel=0.05)


def test_forces_contact_tension(run):
    """All forces of the tendon add up to its weight, and its tension grows at most as over a capstan."""
    got = run("forces_contact_tension")
    tendon = got["tendon"]
    assert got["total"] == pytest.approx([0, 0, -G * tendon.masses.sum()], abs=1e-3)
    assert got["knot"].force[2] == pytest.approx(-0.5 * -G, rel=1e-2)
    assert 1 <= tendon.tension.max() / tendon.tension.min() < 1.02 * np.exp(0.2 * np.pi)


def test_saved_states(run, capsys):
    run("saved_states")
    said = capsys.readouterr().out
    assert "the same bits: True" in said
    assert "the same positions: True" in said
    assert "source = 'rope.npz'" in said


def test_haptic_device(run):
    """Coupling and tissue are springs in series; friction in the tunnel adds at most a capstan's share."""
    got = run("haptic_device")
    graft, hand = got["graft"], got["hand"]
    spring = 2000 * (graft.positions[0] - hand.target)
    assert size(hand.force - spring) < 0.2 * size(spring)
    pull = got["forces"][-100:].mean(axis=0) @ -got["axis"]
    series = 0.03 / (1 / 2000 + 1 / 300)
    weight = G * graft.masses.sum()
    assert 0.95 * series - weight < pull < series * np.exp(0.5 * graft.material.friction * np.pi) + weight


def test_many_worlds(run):
    """Hooke's law of each case, and equal results on threads."""
    got = run("many_worlds")
    assert got["again"] == got["results"]
    for case, result in zip(got["cases"], got["results"], strict=True):
        assert result["stretch"] == pytest.approx(0.2 * result["load"] / case["stiffness"], rel=2e-3)
        assert result["load"] == pytest.approx(G, rel=0.05)


def test_choosing_a_resolution(run):
    assert run("choosing_a_resolution")["orders"] == pytest.approx([1, 2], abs=0.1)


def test_when_a_step_does_not_converge(run, capsys):
    got = run("when_a_step_does_not_converge")
    said = capsys.readouterr().out
    assert "converged False, ended by budget" in said
    assert got["unconverged"] == 0
    assert "['StepWarning']" in said


def test_record_and_replay(run, tmp_path):
    """The recording begins and ends with the run, and has what the world says, in single precision."""
    pytest.importorskip("k3d", reason="the recipe writes a replay")
    got = run("record_and_replay")
    rope, track = got["rope"], got["track"]
    assert len(got["recording"]) == 121
    assert np.allclose(track.positions[-1], rope.positions, rtol=0, atol=1e-7)
    assert np.allclose(track.tension[-1], rope.tension, rtol=1e-6, atol=0)
    assert got["pull"][-1] == pytest.approx(size(got["hand"].force), rel=1e-6)
    assert np.array_equal(got["again"].tendon("rope").tension, track.tension)
    assert (tmp_path / "run.html").stat().st_size < 3e6
