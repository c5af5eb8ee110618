"""Episodes of tasks in tests."""

from bullet_tendon.scenarios.tasks import TASKS


def run(task, policy, seed, **options):
    """The last observation and info of an episode, its rewards, and whether it ended by itself."""
    seen, info = task.reset(seed=seed, options=options)
    rewards, ended = [], False
    for _ in range(TASKS[type(task).__name__][1]):
        seen, reward, ended, _, info = task.step(policy(seen))
        rewards.append(reward)
        if ended:
            break
    return seen, info, rewards, ended
