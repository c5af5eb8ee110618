"""A world that one thread reads while another steps it: what is read is the state between two steps."""

import threading

import numpy as np

import bullet_tendon as bt


def test_what_is_read_is_the_state_between_steps(make_world):
    """Positions of a long tendon, which take a while to be written and read."""
    world = make_world(gravity=(0, 0, -9.81))
    material = bt.Material(stiffness=1e3, damping=0.1)
    t = world.add_tendon([[0, 0, 0], [1.0, 0, 0]], 1e-3, material, 6000)
    t.grip(0)
    states = {t.positions.tobytes()}
    read, over = [], threading.Event()

    def reader():
        while not over.is_set():
            read.append(t.positions.tobytes())
            assert np.isfinite(t.tension).all()
            assert np.isfinite(world.contacts["position"]).all()

    thread = threading.Thread(target=reader)
    thread.start()
    for _ in range(150):
        world.step()
        states.add(t.positions.tobytes())
    over.set()
    thread.join()
    assert len(set(read)) > 3
    assert set(read) <= states


def test_two_threads_may_step_one_world(make_world):
    """Steps of both are taken one after the other: as many as were asked for, of the same bits."""
    ends = []
    for threads in (1, 2):
        world = make_world(gravity=(0, 0, -9.81))
        t = world.add_tendon([[0, 0, 0], [0.2, 0, 0]], 1e-3, bt.Material(stiffness=1e3, damping=0.1), 200)
        t.grip(0)
        core = world._core
        gravity = (0.0, 0.0, -9.81)

        def steps(count, core=core, gravity=gravity):
            for _ in range(count):
                core.step(1 / 240, gravity, False, None)

        workers = [threading.Thread(target=steps, args=(60 // threads,)) for _ in range(threads)]
        for worker in workers:
            worker.start()
        for worker in workers:
            worker.join()
        ends.append(t.positions)
    np.testing.assert_array_equal(*ends)
