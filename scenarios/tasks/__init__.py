"""Tasks for reinforcement learning by the interface of gymnasium (extra `gym`).

Importing this package registers the tasks, so that

    gymnasium.make("bullet_tendon.scenarios.tasks:bullet_tendon/GraftPassage-v0")

makes one. gymnasium.make_vec(..., vectorization_mode="vector_entry_point") divides many among processes.
"""

from bullet_tendon.errors import MissingExtra

try:
    import gymnasium
except ImportError:
    raise MissingExtra("gymnasium", "gym", "a task") from None

# Name: module, and the number of steps after which an episode is truncated.
TASKS = {
    "GraftPassage": ("graft_passage", 120),
    "PulleyLift": ("pulley_lift", 120),
    "TendonFinger": ("tendon_finger", 288),
    "KnotTie": ("knot_tie", 20),
    "GraftTension": ("graft_tension", 24),
    "TunnelPlacement": ("tunnel_placement", 1),
}


def _register() -> None:
    for name, (module, horizon) in TASKS.items():
        where = f"{__name__}.{module}"
        gymnasium.register(
            id=f"bullet_tendon/{name}-v0",
            entry_point=f"{where}:{name}",
            vector_entry_point=f"{where}:{name}Vector",
            max_episode_steps=horizon,
        )


_register()
