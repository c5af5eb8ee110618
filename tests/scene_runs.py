"""Runs of scenarios in tests: with changed constants or solver options, and with all their checks."""

from bullet_tendon.scenarios import runner

import bullet_tendon as bt


def run(module, monkeypatch, changes):
    """Outcome of a scenario whose constants (by name) are changed."""
    for name, value in changes.items():
        monkeypatch.setattr(module, name, value)
    return runner.run(module)


def holds(module, monkeypatch, **changes):
    """Run a scenario with changed constants: all its own checks have to hold. Returns its scene."""
    outcome = run(module, monkeypatch, changes)
    assert not outcome.cut and not outcome.failure
    assert outcome.checks
    assert outcome.failed == []
    return outcome.scene


def with_options(module, monkeypatch, **options):
    """Let a scenario's world have these solver options."""
    build = module.build

    def changed(run_options):
        scene = build(run_options)
        scene.world.options = bt.SolverOptions(**options)
        return scene

    monkeypatch.setattr(module, "build", changed)
