"""Tendons side by side that are drawn around something rough: what capstan and curved_tunnel have in common.

A lane has tendon, hand (a grip at its last particle), start (the hand's place), first and last (directions
out of its ends), exponent (friction x angle), and logs, of the tensions in its ends.
"""

import numpy as np


def draw(scene, progress, travel: float, speed: float, back: float, start: float) -> None:
    """Draw all lanes by travel [m] and log ln(T) at both ends of each.

    The hands get from standstill to speed [m/s] in about the share `start` of the time; back [N] is the load
    on the slack ends.
    """
    steps = round(travel / speed / scene.time_step)
    for k in progress(range(steps), "drawing"):
        if k == steps // 2:
            scene.mark(f"{scene.time:.2f} s")
        for lane in scene.handles.lanes:
            share = (k + 1) / steps
            gently = share - start * (1 - np.exp(-share / start))
            lane.tendon.set_force(0, -back * min(1.0, 8 * share) * lane.first)
            lane.hand.target = lane.start + travel * gently * lane.last
        scene.step()
        for lane in scene.handles.lanes:
            lane.logs.append(np.log(lane.tendon.tension[[0, -1]]))
    scene.mark(f"{scene.time:.2f} s")


def measure(scene, lane, name: str, spacing: float, speed: float) -> None:
    """Compare the mean of ln(T1/T0) to the capstan equation, over the time in which one segment passes."""
    passing = round(spacing / (speed * scene.time_step))
    logs = np.array(lane.logs)[-passing:]
    gained = (logs[:, 1] - logs[:, 0]).mean()
    scene.measure(name, np.expm1(gained - lane.exponent))
    scene.record("measured", gained, lane.exponent)
    scene.record("capstan equation", lane.exponent, lane.exponent)
