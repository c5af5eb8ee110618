"""Where almost no force acts, a step is solved when nothing would move by what is left."""

import numpy as np
import pybullet as p
import pytest

import bullet_tendon as bt

# Nothing pulls at these strands: their tensions, of strain squared, fall from 1e-4 to 1e-6 N.
FROM = [(0.007245847, -0.001503692, -0.006725817), (-0.002870494, -0.008858688, 0.003644709)]
FROM.append((-0.008125562, -0.004123139, 0.004120069))
TO = [(-0.01513163, 0.03494414, -0.09711831), (0.09174883, 0.0009733155, 0.03447514)]
TO.append((0.04753334, 0.01814641, -0.07591838))


@pytest.mark.parametrize("toe", [0.02, 0.06])
@pytest.mark.parametrize("mass", [0.1, 1.067])
def test_strands_that_almost_nothing_pulls(make_world, client, mass, toe):
    """Ligaments without load, two of which touch, on a free body that drifts by millimetres a second."""
    world = make_world(0.003158)
    shape = p.createCollisionShape(p.GEOM_CAPSULE, radius=0.01, height=0.02, physicsClientId=client)
    body = p.createMultiBody(mass, shape, physicsClientId=client)
    p.changeDynamics(body, -1, linearDamping=0, angularDamping=0, physicsClientId=client)
    law = bt.Material.ligament(129066.66666666667 * toe, toe, friction=0.0)
    for start, end, n in zip(FROM, TO, (25, 14, 26), strict=True):
        t = world.add_tendon([start, end], 0.0005, law, n)
        t.attach(0, body)
        t.grip(-1)
    for _ in range(60):
        world.step()
        assert world.report.converged and world.report.iterations < 300
        velocity = np.linalg.norm(p.getBaseVelocity(body, client)[0])
        assert velocity < 0.02
