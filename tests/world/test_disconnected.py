"""After the client is disconnected: what needs it says so, what is known can be read, saved and removed."""

import inspect

import numpy as np
import pybullet as p
import pytest

import bullet_tendon as bt

ROPE = bt.Material(stiffness=3e3, damping=3.0)
LINE = [[0.1, 0, 0], [0.2, 0, 0]]
URDF = '<robot name="r"><link name="a"/></robot>'


class Scene:
    """A world with one of everything, whose client is gone."""

    def __init__(self, path):
        client = p.connect(p.DIRECT)
        self.path = path
        path.write_text(URDF)
        self.world = world = bt.TendonWorld(client)
        box = p.createCollisionShape(p.GEOM_BOX, halfExtents=[0.02] * 3, physicsClientId=client)
        self.body = p.createMultiBody(1.0, box, physicsClientId=client)
        world.add_obstacle(self.body)
        self.tunnel = world.add_tunnel(self.body, -1, [-0.02, 0, 0], [0.02, 0, 0], 0.004, 0.1)
        self.t = world.add_tendon(LINE, 0.002, ROPE, 11, name="graft")
        self.thick = world.add_tendon(np.array(LINE) + [0, 0.1, 0], 0.005, ROPE, 11)
        self.grip = self.t.grip(0)
        self.attachment = self.t.attach(-1, self.body, position=[0.02, 0.02, 0])
        self.stand = p.createMultiBody(0, box, physicsClientId=client)
        self.path_between = [(self.body, -1, (0, 0, 0)), (self.stand, -1, (0, 0.1, 0))]
        facing = p.createMultiBody(0, box, -1, (0, 0, -0.001), physicsClientId=client)
        flat = [(0, 0, 0), (0.01, 0, 0), (0, 0.01, 0)]
        self.sides = (facing, -1, (flat, [(0, 1, 2)])), (self.body, -1, (flat, [(0, 2, 1)]))
        self.cartilage = world.add_cartilage(*self.sides)
        self.ligament = world.add_ligament(self.path_between, ROPE)
        world.step()
        self.state, self.snapshot = world.save_state(), world.snapshot()
        p.disconnect(client)


REFUSED = {
    "add_tendon": lambda s: s.world.add_tendon(LINE, 0.002, ROPE, 11),
    "add_tendon inside": lambda s: s.world.add_tendon(LINE, 0.002, ROPE, 11, inside="push_out"),
    "add_obstacle": lambda s: s.world.add_obstacle(s.body),
    "add_tunnel": lambda s: s.world.add_tunnel(s.body, -1, [0, 0, 0], [0, 0, 1], 0.01),
    "add_ligament": lambda s: s.world.add_ligament(s.path_between, ROPE),
    "add_wrap": lambda s: s.world.add_wrap(s.body, -1, ("sphere", 0.01), (0, 0, 0)),
    "add_cartilage": lambda s: s.world.add_cartilage(*s.sides),
    "set_tension": lambda s: s.ligament.set_tension(3.0),
    "rest_length": lambda s: setattr(s.ligament, "rest_length", 0.1),
    "ligament.length": lambda s: s.ligament.length,
    "load_urdf": lambda s: s.world.load_urdf(s.path),
    "step": lambda s: s.world.step(),
    "apply": lambda s: s.world.apply(),
    "apply_external_force": lambda s: s.world.apply_external_force(
        s.body, -1, [0, 0, 1], [0, 0, 0], p.WORLD_FRAME
    ),
    "apply_joint_force": lambda s: s.world.apply_joint_force(s.body, 0, 1.0),
    "relax": lambda s: s.world.relax(),
    "wrench": lambda s: s.world.wrench(s.body),
    "describe": lambda s: s.world.describe(),
    "penetrations": lambda s: s.world.penetrations(),
    "restore_state": lambda s: s.world.restore_state(s.state),
    "load_snapshot": lambda s: s.world.load_snapshot(s.snapshot),
    "attach": lambda s: s.t.attach(3, s.body),
    "attach there": lambda s: s.t.attach(3, s.body, position=[0, 0, 0]),
    "grip": lambda s: s.t.grip(3),
    "pull": lambda s: s.t.pull(3, 10.0, s.body, -1, (0, 0, 0)),
    "fix": lambda s: s.t.fix(3, s.body, -1, (0, 0, 0), "button"),
    "set_force": lambda s: s.t.set_force(3, [0, 0, 1]),
    "set_point_mass": lambda s: s.t.set_point_mass(3, 1.0),
    "set_positions": lambda s: s.t.set_positions(s.t.positions),
    "set_positions thick": lambda s: s.thick.set_positions(s.thick.positions),
    "set_collision": lambda s: s.world.set_collision(s.t, s.body, False),
    "collides": lambda s: setattr(s.t, "collides", False),
    "collides_with": lambda s: s.t.collides_with(s.body),
    "ends": lambda s: s.tunnel.ends,
    "shorten": lambda s: s.t.shorten(0.001),
    "grip.target": lambda s: setattr(s.grip, "target", [0, 0, 0]),
    "grip.stiffness": lambda s: setattr(s.grip, "stiffness", 10.0),
    "grip.damping": lambda s: setattr(s.grip, "damping", 10.0),
    "grip.max_force": lambda s: setattr(s.grip, "max_force", 10.0),
    "grip.direction": lambda s: setattr(s.grip, "direction", [1, 0, 0]),
}
THERE = {"ends", "points", "line", "length", "strain"}  # where links are now is pybullet's
READ = {
    "save_state": lambda s: s.world.save_state(),
    "snapshot": lambda s: s.world.snapshot(),
    "state_hash": lambda s: s.world.state_hash(),
    "is_attached_to": lambda s: s.t.is_attached_to(s.body),
    "depths": lambda s: s.cartilage.depths(),
    "skin": lambda s: bt.Skin.tube(s.t).vertices,
}
TAKEN_OUT = {
    "remove_state": lambda s: s.world.remove_state(s.state),
    "release": lambda s: (s.attachment.release(), s.grip.release()),
    "remove_obstacle": lambda s: s.world.remove_obstacle(s.body),
    "remove_tunnel": lambda s: s.world.remove_tunnel(s.tunnel),
    "remove_cartilage": lambda s: s.world.remove_cartilage(s.cartilage),
    "remove_ligament": lambda s: s.world.remove_ligament(s.ligament),
    "remove_tendon": lambda s: s.world.remove_tendon(s.t),
}


@pytest.fixture
def scene(tmp_path):
    return Scene(tmp_path / "model.urdf")


@pytest.mark.parametrize("call", REFUSED)
def test_what_needs_the_client_says_so(scene, call):
    before = scene.world.state_hash()
    with pytest.raises(bt.UnknownId, match="connected pybullet client") as caught:
        REFUSED[call](scene)
    assert caught.value.argument == "physicsClientId"
    assert scene.world.state_hash() == before and len(scene.world.tendons) == 2


@pytest.mark.parametrize("call", READ)
def test_what_is_known_can_be_read(scene, call):
    READ[call](scene)


def test_every_attribute_can_be_read(scene):
    world = scene.world
    for part in (world, scene.t, scene.grip, scene.attachment, scene.tunnel, scene.ligament, scene.cartilage):
        names = [n for n, _ in inspect.getmembers(type(part), lambda m: isinstance(m, property))]
        for name in set(names) - THERE:
            getattr(part, name)
    assert np.isfinite(scene.t.positions).all() and world.report.converged


def test_everything_can_be_taken_out(scene):
    for call in TAKEN_OUT.values():
        call(scene)
    assert scene.world.tunnels == scene.world.ligaments == () and scene.world.tendons == (scene.thick,)


def test_every_public_method_is_asked_here():
    called = {name.split()[0].removeprefix("grip.") for name in (*REFUSED, *READ, *TAKEN_OUT)}
    for kind in (bt.TendonWorld, bt.Tendon, bt.Grip, bt.Attachment, bt.Ligament, bt.Cartilage):
        methods = [n for n, _ in inspect.getmembers(kind, inspect.isfunction) if not n.startswith("_")]
        assert set(methods) <= called, set(methods) - called
