"""A graft through two tunnels in real bone surfaces, where these lie beside the checkout."""

from pathlib import Path

import numpy as np
import pybullet as p
import pytest
from bullet_tendon.scenarios import graft_passage
from bullet_tendon.scenarios.scene import Options, Scene

KNEE = Path(__file__).resolve().parents[3] / "shared" / "knee"
# Middles of the ACL's attachments in the knee's data, at full extension, where both frames coincide [m].
TIBIAL_FOOTPRINT = np.array([0.0142, -0.0213, -0.0010])
FEMORAL_FOOTPRINT = np.array([-0.0010, 0.0003, 0.0050])
# Up the tibial tunnel, 55 degrees to the plateau and 20 degrees from the sagittal plane, and up the
# femoral one, forwards and sideways out of the notch.
TIBIAL_AXIS = np.array([-np.cos(0.96) * np.cos(0.35), np.sin(0.96), np.cos(0.96) * np.sin(0.35)])
FEMORAL_AXIS = np.array([0.25, 0.80, 0.55])

pytestmark = pytest.mark.skipif(
    not (KNEE / "femur.stl").exists(), reason="no real bone surfaces beside the checkout"
)


def bone(scene, name) -> int:
    path = str(KNEE / name)
    shape = p.createCollisionShape(
        p.GEOM_MESH, fileName=path, flags=p.GEOM_FORCE_CONCAVE_TRIMESH, physicsClientId=scene.client
    )
    body = p.createMultiBody(0, shape, physicsClientId=scene.client)
    scene.world.add_obstacle(body, meshes=[path])
    return body


def real_scene(femoral_axis=FEMORAL_AXIS) -> Scene:
    scene = Scene(Options())
    p.setGravity(0, -9.81, 0, scene.client)
    tibia, femur = bone(scene, "tibia.stl"), bone(scene, "femur.stl")
    scene.bones = [tibia, femur]
    up = femoral_axis / np.linalg.norm(femoral_axis)
    tunnels = [
        scene.world.add_tunnel(tibia, -1, TIBIAL_FOOTPRINT - 0.040 * TIBIAL_AXIS, TIBIAL_FOOTPRINT, 0.004),
        scene.world.add_tunnel(femur, -1, FEMORAL_FOOTPRINT, FEMORAL_FOOTPRINT + 0.0385 * up, 0.004),
    ]
    graft_passage.prepare(scene, tunnels)
    return scene


@pytest.mark.parametrize("sideways", [0.35, 0.55, 0.8])
def test_graft_passes_through_real_bones(sideways):
    with real_scene(np.array([0.25, 0.80, sideways])) as scene:
        graft_passage.drive(scene, lambda steps, _: steps)
        # Wall time is not judged here.
        failed = [c for c in graft_passage.check(scene) if not c.ok and c.name != "speed"]
        assert not failed
        assert scene.measured["force on the femur, most"] > 0.5  # it did bear on the bones
        assert scene.measured["force on the tibia, most"] > 0.5
