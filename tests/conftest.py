"""Shared fixtures: a pybullet client without a window, and tendon worlds in it."""

import os

import pybullet as p
import pytest
from link_scenes import probe_of

import bullet_tendon as bt

# A sanitizer has an allocator of its own, and keeps what is freed.
SANITIZED = "libasan" in os.environ.get("LD_PRELOAD", "")


def pytest_addoption(parser):
    parser.addoption("--run-slow", action="store_true", help="run the tests that are marked slow as well")


def pytest_collection_modifyitems(config, items):
    if config.getoption("--run-slow"):
        return
    for item in items:
        if item.get_closest_marker("slow"):
            item.add_marker(pytest.mark.skip(reason="needs --run-slow"))


@pytest.fixture
def client():
    """Number of a connected DIRECT client."""
    number = p.connect(p.DIRECT)
    yield number
    p.disconnect(number)


@pytest.fixture
def make_world(client):
    """make_world(dt, gravity, **solver options): a TendonWorld, with pybullet's time step [s] and gravity."""

    def make(dt=1 / 240, gravity=(0.0, 0.0, 0.0), **options):
        p.setTimeStep(dt, physicsClientId=client)
        p.setGravity(*gravity, physicsClientId=client)
        return bt.TendonWorld(client, bt.SolverOptions(**options))

    return make


@pytest.fixture
def probe(client):
    """The small sphere with which pybullet's own distances are taken."""
    return probe_of(client)
