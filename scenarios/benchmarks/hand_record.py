"""A hand's jerky way along a line, sampled at 1 kHz.

A hand that follows a path moves in submovements, each with the speed of a minimum-jerk movement (Flash and
Hogan 1985, Journal of Neuroscience 5). Between them it rests, goes back, or slips at once. Physiological
tremor is added (8 to 12 Hz), and the position is rounded to the steps of a device's encoder.
"""

import numpy as np

RATE = 1000  # Hz
PULL, PULL_TIME = (0.004, 0.015), (0.12, 0.35)  # of a submovement [m], [s]
BACK, SLIP = (0.001, 0.004), (0.002, 0.005)  # m
SLIP_TIME = 0.015  # s
PAUSE = (0.02, 0.15)  # s
SHARES = (0.7, 0.15, 0.15)  # of pulls, pull-backs and slips
TREMOR, TREMOR_RATE = 2e-4, (8.0, 12.0)  # m, Hz
ENCODER = 3e-5  # m


def hand_record(length: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Distances along the way (n,) [m], from 0 until `length` is reached, and what is off it (n, 3) [m]."""
    random = np.random.default_rng(seed)
    parts, at = [np.zeros(1)], 0.0
    while length - at > ENCODER:
        way, time = _submovement(random)
        way = np.clip(way, -at, length - at)
        t = np.arange(1, round(time * RATE) + 1) / round(time * RATE)
        parts.append(at + way * t**3 * (10 - 15 * t + 6 * t**2))  # Flash and Hogan, equation (3)
        at += way
        parts.append(np.full(round(random.uniform(*PAUSE) * RATE), at))
    along = np.concatenate(parts)
    time = np.arange(len(along)) / RATE
    rates, phases = random.uniform(*TREMOR_RATE, (3, 1)), random.uniform(0, 2 * np.pi, (3, 1))
    tremor = (TREMOR * np.minimum(time, 1) * np.sin(2 * np.pi * rates * time + phases)).T
    return _read(along), _read(tremor)


def _read(positions) -> np.ndarray:
    """What the encoder tells of positions [m]."""
    return ENCODER * np.round(positions / ENCODER)


def _submovement(random) -> tuple[float, float]:
    """Its signed length [m] and its duration [s]."""
    kind = random.choice(3, p=SHARES)
    if kind == 0:
        return random.uniform(*PULL), random.uniform(*PULL_TIME)
    if kind == 1:
        return -random.uniform(*BACK), random.uniform(*PULL_TIME)
    return random.uniform(*SLIP), SLIP_TIME
