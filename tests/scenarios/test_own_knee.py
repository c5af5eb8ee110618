"""The project's own knee: its files are what the generators make, and it is as lax as published."""

import csv
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from bullet_tendon.scenarios.knee import KneeRig
from bullet_tendon.urdf.make_bones import BONES
from bullet_tendon.urdf.make_ligaments import BUNDLES
from knee_oracle import Knee, Pose, Strands, read_obj

import bullet_tendon as bt

URDF = Path(bt.data_path("knee.urdf")).parent
# Anterior drawer under 90 N [mm]: mean and standard deviation of 12 knees, intact and without ACL
# (PMC7148266).
PUBLISHED = {
    0: ((4.0, 1.4), (10.0, 2.9)),
    30: ((6.0, 2.5), (12.9, 2.5)),
    60: ((4.7, 2.4), (9.4, 2.7)),
    90: ((3.7, 2.3), (7.7, 2.5)),
}


@pytest.fixture(scope="module")
def rows():
    with open(URDF / "knee_ligaments.csv", newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture(scope="module")
def surfaces():
    return {bone: read_obj(URDF / "meshes" / f"{bone}_cartilage.obj") for bone in ("femur", "tibia")}


def knee(surfaces, *cut) -> Knee:
    strands = Strands.read(URDF / "knee_ligaments.csv", "femur", "tibia")
    return Knee(strands.without(*cut) if cut else strands, surfaces["femur"], surfaces["tibia"])


def edge_counts(corners):
    """How many triangles have each edge, and how many separate patches there are."""
    vertices, index = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    triangles = index.reshape(-1, 3)
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    patch = np.arange(len(vertices))
    for _ in range(len(vertices)):
        joined = np.minimum(patch[edges[:, 0]], patch[edges[:, 1]])
        after = patch.copy()
        np.minimum.at(after, edges.ravel(), np.repeat(joined, 2))
        if (after == patch).all():
            break
        patch = after
    return np.unique(edges, axis=0, return_counts=True)[1], len(np.unique(patch))


@pytest.mark.parametrize("module", ["make_ligaments", "make_cartilage"])
def test_generators_reproduce_their_files(module, tmp_path):
    run = [sys.executable, str(URDF / f"{module}.py"), "--out", str(tmp_path)]
    subprocess.run(run, check=True, capture_output=True, timeout=300)
    made = sorted(tmp_path.iterdir())
    assert len(made) == {"make_ligaments": 1, "make_cartilage": 2}[module]
    for path in made:
        kept = URDF / path.name if path.suffix == ".csv" else URDF / "meshes" / path.name
        numbers = [
            np.array([word for word in text.replace(",", " ").split() if _is_number(word)], float)
            for text in (path.read_text(), kept.read_text())
        ]
        np.testing.assert_allclose(numbers[0], numbers[1], rtol=0, atol=2e-6)


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def points_of(row) -> np.ndarray:
    return np.array([float(row[f"{c}_m"]) for c in "xyz"])


def test_insertions_lie_on_the_bones(rows):
    for row in rows:
        if not row["cylinder_radius_m"]:
            field = BONES[row["body"]][0](1e3 * points_of(row)[None])[0]
            assert field == pytest.approx(0.0, abs=0.02)


def test_strands_have_the_bundles_stiffness_and_reference_strain(rows):
    """The lengths are those of the strands in a rig at full extension."""
    with KneeRig() as rig:
        rig.place(np.zeros(5))
        for name, bundle in BUNDLES.items():
            strands = {n: strand for n, strand in rig.strands.items() if strand.group == name}
            assert len(strands) == bundle.strands
            total = sum(strand.stiffness for strand in strands.values())
            assert total == pytest.approx(bundle.stiffness, rel=1e-4)
            for each, strand in strands.items():
                length = rig.ligaments[each].length
                assert length / strand.slack - 1 == pytest.approx(bundle.strain, abs=2e-4)


def test_no_strand_cuts_deep_into_the_bone_that_it_passes():
    """At the angles where they are taut; what is inside of a straight one is 2.4 to 8 mm deep there."""
    wrapped = {name for name, bundle in BUNDLES.items() if bundle.around}
    with KneeRig() as rig:
        for degrees in (0, 15, 30):
            rig.flex(np.radians(degrees))
            assert rig.settle()
            for bone, link in (("femur", rig.femur), ("tibia", rig.tibia)):
                origin, axes = rig.world._bodies.frame(*link)
                for name, strand in rig.strands.items():
                    if strand.group in wrapped and rig.ligaments[name].force > 0:
                        path = _dense((rig.ligaments[name].line - origin) @ axes)
                        assert BONES[bone][0](1e3 * path).min() > -0.8


def _dense(path) -> np.ndarray:
    """Points along a path (k, 3)."""
    shares = np.linspace(0, 1, 20)[:, None]
    return np.concatenate([a + shares * (b - a) for a, b in zip(path[:-1], path[1:], strict=True)])


@pytest.mark.parametrize(("bone", "patches"), [("femur", 1), ("tibia", 2)])
def test_cartilage_is_an_even_sheet_outside_its_bone(bone, patches, surfaces):
    corners = surfaces[bone]
    counts, found = edge_counts(corners)
    assert counts.max() == 2
    assert found == patches
    depth = BONES[bone][0](1e3 * corners.mean(axis=1))
    assert depth.min() > -0.05
    assert depth.max() < 2.5  # the field is roughly a distance
    assert 1.5 < depth.mean() < 2.1
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    outward = BONES[bone][0](
        1e3 * (corners.mean(axis=1) + 1e-4 * across / np.linalg.norm(across, axis=1)[:, None])
    )
    assert (outward > depth).mean() > 0.995
    area = np.linalg.norm(across, axis=1) / 2
    assert area.max() < 4e-6


@pytest.mark.parametrize(
    "flexion", [pytest.param(a, marks=[] if a == 30 else pytest.mark.slow) for a in PUBLISHED]
)
def test_drawer_is_within_a_standard_deviation_of_cadavers(flexion, surfaces):
    intact, cut = knee(surfaces), knee(surfaces, "ACL")
    unloaded = Pose(0.0, origin=(0.0, -1.5e-3, 0.0))
    for angle in np.radians(np.arange(0, flexion + 1, 15)):
        start = Pose(angle, unloaded.adduction, unloaded.internal, unloaded.origin)
        unloaded = intact.solve(start)
    for model, (mean, deviation) in zip((intact, cut), PUBLISHED[flexion], strict=True):
        pose = unloaded
        for force in (10.0, 50.0, 90.0):
            pose = model.solve(pose, force=(force, 0.0, 0.0))
        drawer = 1e3 * (pose.translations - unloaded.translations)[1]
        assert abs(drawer - mean) < deviation


def test_a_knee_without_its_medial_ligament_dislocates():
    with KneeRig() as rig:
        for cut, dislocated in (("", False), ("MCL", True)):
            if cut:
                rig.cut(cut)
            rig.load()
            rig.flex(np.radians(60.0), increment=np.radians(20.0))
            rig.settle()
            assert not rig.dislocated
            rig.load(anterior=134.0)
            assert rig.settle()
            assert rig.dislocated == dislocated


def test_forces_that_follow_the_tibia_are_balanced_where_they_alone_make_the_matrix_indefinite():
    """Its symmetric part has a negative eigenvalue there, and itself has none."""
    with KneeRig() as rig:
        rig.cut("MCL")
        rig.flex(np.radians(25.0))
        rig.settle()
        rig.load(anterior=38.5, lateral=-16.1, superior=4.6)
        assert rig.settle() and not rig.dislocated
        assert np.degrees(rig.coordinates.internal_rotation) == pytest.approx(-15.28, abs=0.1)


def test_a_knee_without_its_medial_ligament_that_is_slack_settles():
    """Between 20 and 50 degrees no ligament is taut, and hardly any force is there."""
    with KneeRig() as rig:
        rig.cut("MCL")
        assert rig.flex(np.radians(50.0)) and rig.settle()
        assert rig.unsettled == 0
        assert max(rig.forces.values()) < 1e-3
