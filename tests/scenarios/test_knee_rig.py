"""KneeRig beside an independent quasi-static solution (knee_oracle.py), and its words."""

from pathlib import Path

import numpy as np
import pybullet as p
import pytest
from bullet_tendon.scenarios.benchmarks.whole_knee import whole_knee
from bullet_tendon.scenarios.knee import DISLOCATED_LATERAL, MOST_UNSOLVED, KneeRig
from bullet_tendon.scenarios.reconstruction import FEMORAL, SLOPE, TIBIAL, reconstruct
from knee_oracle import Knee, Pose, Strands, read_obj, read_stl, refined

import bullet_tendon as bt
from bullet_tendon.equilibrium import Equilibrium
from bullet_tendon.stepper import Stepper

KNEE = Path(__file__).resolve().parents[3] / "shared" / "knee"
URDF = Path(bt.data_path("knee.urdf")).parent
real_knee = pytest.mark.skipif(
    not (KNEE / "ligaments.csv").exists(), reason="no real knee beside the checkout"
)
FLEXION = np.radians(25)
LOADS = 0.0, 30.0, 60.0, 100.0  # N
START = Pose(FLEXION, origin=(0.0, 5e-4, 0.0))


def oracle(cut=()) -> Knee:
    knee = Knee.of_files(KNEE)
    knee.strands = knee.strands.without(*cut) if cut else knee.strands
    return knee


def agree(rig, knee, pose, length=None) -> None:
    """Coordinates and forces within 1 %; of the largest, for those that are small beside it."""
    at = rig.coordinates
    translations = np.array([at.lateral, at.anterior, at.superior])
    largest = np.abs(pose.translations).max() if length is None else length
    assert translations == pytest.approx(pose.translations, rel=0.01, abs=0.01 * largest)
    assert (at.flexion, at.adduction, at.internal_rotation) == pytest.approx(
        (pose.flexion, pose.adduction, pose.internal), rel=0.01, abs=np.radians(0.15)
    )
    groups, forces = knee.groups(pose), rig.forces
    assert set(groups) == set(forces)
    largest = max(groups.values())
    for group, force in groups.items():
        assert forces[group] == pytest.approx(force, rel=0.01, abs=max(0.01 * largest, 0.2))


@real_knee
def test_the_real_knee_under_drawer_loads_is_where_it_is_in_balance():
    knee = oracle()
    pose = START
    with KneeRig(KNEE, KNEE, KNEE) as rig:
        rig.flex(FLEXION)
        for force in LOADS:
            rig.load(anterior=force)
            assert rig.settle()
            pose = knee.solve(pose, force=(force, 0.0, 0.0))
            agree(rig, knee, pose)


def loads_without_acl(rig):
    """Cuts the ACL, flexes, and gives each anterior force [N] under which the rig has settled."""
    rig.cut("ACL")
    rig.flex(FLEXION)
    for force in (5.0, 10.0, 20.0, 30.0, 60.0):
        rig.load(anterior=force)
        assert rig.settle()
        yield force


@real_knee
@pytest.mark.slow
def test_the_real_knee_without_its_acl():
    knee = oracle(["ACL"])
    pose = START
    with KneeRig(KNEE, KNEE, KNEE) as rig:
        for force in loads_without_acl(rig):
            pose = knee.solve(pose, force=(force, 0.0, 0.0))
            if force >= 20.0:  # below, the tibia slides far under little force
                agree(rig, knee, pose)


def pose_of(rig) -> Pose:
    at = rig.coordinates
    turned = Pose(at.flexion, at.adduction, at.internal_rotation)
    origin = np.linalg.solve(turned.joint_axes, [at.lateral, at.anterior, at.superior])
    return Pose(at.flexion, at.adduction, at.internal_rotation, tuple(origin))


def largest_force(knee, pose, force, shifts) -> float:
    """[N] that a knee holds at one of these anterior shifts [m], which begin near `pose`."""
    forces = []
    for shift in shifts:
        pose, force = knee.held(pose, shift, force)
        forces.append(force)
    assert max(forces) > max(forces[0], forces[-1]) + 1.0, "the largest force is between them"
    return max(forces)


@real_knee
@pytest.mark.slow
def test_the_real_knee_without_its_acl_holds_no_more_than_its_oracle():
    """Beyond 73 N nothing holds the tibia, which slides off in front. 100 N have no equilibrium in joint.

    The oracle's forces jump by up to 1 N where points pass the bends between flat triangles; a quarter of the
    tibial triangles' area halves that. Steps lead there under a load that grows slowly, by 0.5 N/s.
    """
    with KneeRig(KNEE, KNEE, KNEE) as rig:
        held = list(loads_without_acl(rig))[-1]
        knee = oracle(["ACL"])
        knee = Knee(knee.strands, knee.femur.corners, refined(read_stl(KNEE / "tibia_cartilage.stl")))
        shift = rig.coordinates.anterior
        limit = largest_force(knee, pose_of(rig), held, np.linspace(shift, shift + 5e-3, 26))
        for share in (0.97, 0.99):
            rig.load(anterior=share * limit)
            assert rig.settle()
            assert rig.coordinates.superior < 0.012
        held = rig.joints
        for force in (1.01 * limit, 100.0):
            rig.place(held)
            rig.load(anterior=force)
            loads = [(*rig.tibia, *load, p.LINK_FRAME) for load in rig._loads]
            with pytest.warns(bt.EquilibriumWarning, match="`within`"):
                rig.world.relax(bodies=[rig.tibia[0]], forces=loads, within=lambda: in_joint(rig))
            assert not rig.world.report.converged
        rig.place(held)
        force = 0.97 * limit
        while in_joint(rig) and force < 1.1 * limit:
            force += 0.5 * rig.time_step
            rig.load(anterior=force)
            rig.step()
        assert force == pytest.approx(limit, rel=0.01)


def in_joint(rig) -> bool:
    """Whether the tibia is still below the femur's condyles, over which it slides off in front."""
    return rig.coordinates.superior < 0.015


@real_knee
@pytest.mark.slow
@pytest.mark.parametrize("degrees", [0, 15, 50, 90])
def test_drawer_loads_at_other_angles(degrees):
    knee, angle = oracle(), np.radians(degrees)
    with KneeRig(KNEE, KNEE, KNEE) as rig:
        rig.flex(angle)
        for force in LOADS:
            rig.load(anterior=force)
            assert rig.settle()
            # Near the place found, which the oracle then finds by itself.
            start = pose_of(rig).moved(np.array([0.01, -0.02, 5e-4, 5e-4, 5e-4]))
            agree(rig, knee, knee.solve(start, force=(force, 0.0, 0.0)))


@real_knee
@pytest.mark.slow
def test_passive_flexion_of_the_real_knee():
    knee = oracle()
    pose = Pose(0.0, origin=(0.0, 5e-4, 0.0))
    with KneeRig(KNEE, KNEE, KNEE) as rig:
        for angle in np.radians(np.arange(0, 91, 15)):
            rig.flex(angle)
            assert rig.settle()
            pose = knee.solve(Pose(angle, pose.adduction, pose.internal, pose.origin))
            agree(rig, knee, pose)


@real_knee
def test_steps_of_a_240th_of_a_second_end_where_settle_ends():
    with KneeRig(KNEE, KNEE, KNEE) as rig:
        rig.flex(FLEXION)
        rig.load(anterior=60.0)
        assert rig.settle()
        settled, forces = rig.coordinates, rig.forces
        rig.load(anterior=58.0)
        rig.step(240)
        rig.load(anterior=60.0)
        rig.step(960)
        assert rig.coordinates == pytest.approx(settled, rel=0.01, abs=1e-5)
        assert rig.forces == pytest.approx(forces, rel=0.01, abs=0.5)


def test_the_projects_knee_is_where_its_own_oracle_is():
    """Of the same files: strands over a rim, and moments."""
    strands = Strands.read(URDF / "knee_ligaments.csv", "femur", "tibia")
    meshes = (read_obj(URDF / "meshes" / f"{bone}_cartilage.obj") for bone in ("femur", "tibia"))
    knee = Knee(strands, *meshes)
    pose = Pose(np.radians(5), origin=(0.0, -1e-3, 0.0))
    with KneeRig() as rig:
        rig.flex(np.radians(5))
        for load, moment in ((90.0, {}), (40.0, {"valgus": 4.0, "internal": 2.0})):
            rig.load(anterior=load, **moment)
            assert rig.settle()
            moments = (-moment.get("valgus", 0.0), moment.get("internal", 0.0), 0.0)
            pose = knee.solve(pose, force=(load, 0.0, 0.0), moment=moments)
            agree(rig, knee, pose)


def test_a_lateral_force_and_its_point_are_those_of_the_oracle():
    strands = Strands.read(URDF / "knee_ligaments.csv", "femur", "tibia")
    meshes = (read_obj(URDF / "meshes" / f"{bone}_cartilage.obj") for bone in ("femur", "tibia"))
    knee = Knee(strands, *meshes)
    point = (0.0, -0.05, 0.01)
    with KneeRig() as rig:
        rig.load(lateral=15.0, superior=60.0, point=point)
        assert rig.settle()
        start = Pose(0.0, origin=(0.0, -1e-3, 0.0))
        agree(rig, knee, knee.solve(start, force=(0.0, 60.0, 15.0), point=point))


@pytest.mark.parametrize(("friction", "coordinates", "tensions"), [(0.0, 1e-5, 2e-3), (0.1, 1e-4, 0.02)])
def test_a_graft_of_particles_in_two_tunnels_settles_where_damped_motion_ends(
    friction, coordinates, tensions
):
    """With friction in the bores, it remembers the way."""
    with KneeRig() as rig:
        rig.cut("ACL")
        rig.flex(np.radians(20))
        rig.settle()
        ends = []
        for body, tunnel in ((rig.femur, FEMORAL), (rig.tibia, TIBIAL)):
            rig.world.add_tunnel(*body, *tunnel, radius=0.0045, friction=friction)
            origin, axes = rig.world._bodies.frame(*body)
            ends.append([origin + axes @ np.array(point) for point in tunnel])
        points = [ends[0][1], ends[0][0], ends[1][0], ends[1][1]]
        graft = rig.world.add_tendon(points, 0.0035, bt.Material.preset("hamstring_graft"), particles=60)
        graft.attach(0, *rig.femur)
        graft.attach(-1, *rig.tibia)
        graft.shorten(0.0005)
        rig.load(anterior=90.0)
        assert rig.settle()
        forces = [(*rig.tibia, *load, p.LINK_FRAME) for load in rig._loads]
        rig.world.relax(bodies=[rig.tibia[0]], forces=forces)
        assert rig.world.report.converged
        found, tension = rig.coordinates, graft.tension
        assert tension[30] > 80
        rig.load(anterior=60.0)
        assert rig.settle()
        assert abs(rig.coordinates.anterior - found.anterior) > 2e-4
        rig.load(anterior=90.0)
        rig._relax = lambda tolerance: None  # kinetic damping alone
        # By the tolerance that is usual, the moment that is left turns the tibia by 2e-5 rad.
        assert rig.settle(tolerance=1e-4)
        assert rig.coordinates == pytest.approx(found, abs=coordinates)
        assert graft.tension == pytest.approx(tension, rel=tensions)


@pytest.mark.filterwarnings("ignore::bullet_tendon.ResolutionWarning")
@pytest.mark.parametrize(("seed", "loads"), [(5, 23), (10, 16)])
def test_a_knee_with_a_graft_comes_to_rest_under_random_loads(seed, loads, monkeypatch):
    """Where the graft lies on bone beside a mouth, in steps that end where other contacts press."""
    rng, (rig, _) = np.random.default_rng(seed), whole_knee()
    held, hold = [], Stepper.hold
    monkeypatch.setattr(Stepper, "hold", lambda *args: held.append(0) or hold(*args))
    with rig:
        for k in range(loads):
            if k % 12 == 0:
                rig.load()
                rig.flex(np.radians(rng.choice([0, 15, 30, 60, 90])))
                rig.settle()
            limits = {"anterior": (-100, 100), "superior": (0, 50), "internal": (-5, 5), "valgus": (-10, 10)}
            rig.load(**{name: rng.uniform(*ends) for name, ends in limits.items()})
            held.clear()
            assert rig.settle()
            assert len(held) < 100


def test_a_loaded_graft_that_is_in_balance_stays_so_in_the_next_step():
    """The load alone would move the tibia's mouth by 1 to 2.6 mm in the step, and turn it by up to 77 mrad;
    ligaments and graft hold it."""
    rig, graft = whole_knee()
    with rig:
        rig.load(anterior=30.0)
        assert rig.settle()
        for load in ({"anterior": 60.0}, {"anterior": 100.0}, {"internal": 5.0}, {"valgus": 5.0}):
            rig.load(**load)
            rig._relax(1e-3)
            assert rig.world.report.converged
            tension, joints = graft.tension, rig.joints
            p.setTimeStep(1 / 120, rig.client)
            rig.step()
            report = rig.world.report
            assert report.converged and not report.reasons and report.iterations <= 6
            assert graft.tension == pytest.approx(tension, abs=0.01)
            assert rig.joints == pytest.approx(joints, abs=1e-7)
            rig.place(rig.joints)


def count_steps(rig) -> list[bool]:
    """Of each step from now on, whether it was solved."""
    solved, take = [], rig.step

    def step(n=1):
        take(n)
        solved.append(rig.world.report.converged)

    rig.step = step
    return solved


def test_flexing_settles_on_its_way_within_its_steps():
    with KneeRig() as rig:
        solved = count_steps(rig)
        assert rig.flex(np.radians(30), np.radians(10))  # settles at 10 and 20 degrees
        assert len(solved) >= 2 and rig.unsettled == 0
        solved.clear()
        assert not rig.flex(np.radians(60), np.radians(1), max_steps=2)
        assert len(solved) == 2
        assert rig.coordinates.flexion == np.radians(60)
        assert rig.settle()
        solved.clear()
        assert rig.flex(np.radians(50), duration=0.1)
        assert len(solved) == 24


def test_steps_of_a_knee_that_flexes_converge_quadratically():
    """Without the curvature of cartilage and wraps each iteration left 4 % of the residual: 4 iterations."""
    with KneeRig() as rig:
        rig.settle()
        iterations = []
        for k in range(120):
            rig._turn(np.radians(18.0) * (k + 1) / 240)
            rig.step()
            iterations.append(rig.world.report.iterations)
    assert np.mean(iterations) < 2.0


def test_steps_of_a_knee_that_flexes_fast_begin_near_their_end():
    """The femur turns by up to 4 degrees a step. Its bore takes the graft with it, and the middle follows."""
    rig, graft = whole_knee()
    with rig:
        rig.settle()
        solves = []
        for k in range(96):
            rig.turn(np.radians(20 + 30 * np.sin(2 * np.pi * 5 * (k + 1) / 240)))
            rig.step()
            solves.append(rig.world.report.counts["linear_solves"])
    assert np.mean(solves[12:]) < 8.0  # those before begin at once, from rest


def test_a_slack_graft_gets_taut_without_getting_into_bone():
    """A graft that hangs slack has no force, but is still led by steps that are solved."""
    rig, graft = whole_knee()
    rig.load()
    rig.flex(np.radians(60))
    for load in ({"anterior": -60, "internal": -4, "valgus": -2, "superior": 15}, {"anterior": 82}):
        rig.load(**load)
        assert rig.settle()
    assert graft.tension.min() > 10
    assert graft.tension.max() < 300
    rig.close()


def test_a_knee_out_of_joint_is_given_up():
    """A graft that pulls with 1,500 N dislocates the tibia, where steps are not solved."""
    with KneeRig(options=bt.SolverOptions(max_linear_solves=300)) as rig:
        solved = count_steps(rig)
        reconstruct(rig, tension=1500.0, fixed_at=np.radians(45), slope=1.2 * SLOPE)
        assert rig.unsettled > 0
        given_up = rig.unsettled
        assert solved.count(False) <= MOST_UNSOLVED * (given_up + 1)
        solved.clear()
        assert not rig.flex(np.radians(90), max_steps=3)
        assert len(solved) <= 3
        assert rig.coordinates.flexion == np.radians(90)
        solved.clear()
        rests = rig.settle(max_steps=4)  # it may be in balance where it was left, out of joint
        assert not rig.come_to_rest(max_steps=4)
        assert len(solved) <= 8
        assert rig.unsettled >= given_up + 2 + (not rests)


def test_a_load_that_leads_out_of_joint_ends_in_a_balance_there():
    """Backwards, at 60 degrees and without the ACL, a tibia slips off medially from about 60 N.

    Up to there it follows the load as it grows. From 0.8 of the load the equilibrium is out of joint.
    """
    with KneeRig() as rig:
        rig.cut("ACL")
        rig.flex(np.radians(60))
        assert rig.settle()
        rested = rig.joints
        for share in np.linspace(0.1, 0.6, 6):
            rig.load(anterior=-93.2 * share, lateral=-7.1 * share, valgus=-1.1 * share)
            assert rig.settle() and not rig.dislocated
        assert rig.coordinates.lateral == pytest.approx(-6.7e-3, abs=1e-3)  # also where motion creeps to
        for share in (0.8, 1.0):
            rig.place(rested)
            rig.load(anterior=-93.2 * share, lateral=-7.1 * share, valgus=-1.1 * share)
            solved = count_steps(rig)
            assert rig.settle() and rig.dislocated
            assert all(solved)
        assert rig.unsettled == 2, "balances out of joint"
        rig.place(rested)
        rig.load()
        assert rig.settle()
        assert rig.joints == pytest.approx(rested, abs=1e-4)


def test_no_equilibrium_is_looked_for_far_out_of_joint(monkeypatch):
    """Without the ACL, and pushed medially and in valgus. Steps lead further than the joint is wide."""
    with KneeRig() as rig:
        rig.cut("ACL")
        rig.flex(np.radians(25))
        assert rig.settle()
        looked, terms = [], Equilibrium._terms

        def look(equilibrium, elements=None):
            looked.append(abs(rig.coordinates.lateral))
            return terms(equilibrium, elements)

        monkeypatch.setattr(Equilibrium, "_terms", look)
        rig.load(lateral=-36.1, superior=40.8, valgus=4.8)
        solved = count_steps(rig)
        assert not rig.settle() and rig.dislocated
        assert looked and max(looked) <= 2 * DISLOCATED_LATERAL
        assert all(solved) and len(solved) < 10
        assert not rig.settle() and not rig.come_to_rest(), "it is out of joint until it is put back"


def test_groups_are_cut_by_the_beginning_of_their_names():
    with KneeRig() as rig:
        assert rig.forces["ACL"] == rig.forces["ACLam"] + rig.forces["ACLpl"]
        count = len(rig.ligaments)
        rig.cut("ACL")
        assert len(rig.ligaments) == count - 8
        with pytest.raises(KeyError):
            rig.forces["ACL"]
        with pytest.raises(bt.InvalidValue):
            rig.cut("ACL")


def test_what_cannot_be_a_knee_is_refused(tmp_path):
    table = tmp_path / "table.csv"
    table.write_text("strand,body\nA1,femur\n")
    for arguments in (
        {"bones": tmp_path},
        {"bones": ["only_one.stl"]},
        {"bones": {"femur": "x.stl"}},
        {"bones": 3},
        {"ligaments": tmp_path / "none.csv"},
        {"ligaments": table},
        {"cartilage": tmp_path},
        {"time_step": 0.0},
    ):
        with pytest.raises(bt.TendonError):
            KneeRig(**arguments)
    with KneeRig() as rig:
        for call in (
            lambda: rig.flex(3.0),
            lambda: rig.flex(float("nan")),
            lambda: rig.turn(3.0),
            lambda: rig.load(anterior=float("inf")),
            lambda: rig.load(point=(0, 0)),
            lambda: rig.flex(0.1, max_steps=0),
            lambda: rig.settle(tolerance=0.0),
            lambda: rig.settle(max_steps=0),
            lambda: rig.come_to_rest(0),
        ):
            with pytest.raises(bt.InvalidValue):
                call()
