"""The learning rate over a training."""

import math

FLOOR = 0.01
"""Where the cosine ends, as a share of the highest rate."""


def learning_rate(highest: float, step: int, warmup: int = 0, progress: float = 0.0, schedule: str = "cosine") -> float:
    """Rises linearly during the warm-up; then falls along a cosine to a hundredth, or stays.

    Args:
        highest: rate at the end of the warm-up.
        step: number of the batch, from 0.
        warmup: batches over which the rate rises.
        progress: share of training that is over; of 1 and more, all of it.
        schedule: "cosine" or "constant".

    Source: Loshchilov and Hutter 2017, "SGDR: Stochastic Gradient Descent with Warm Restarts" (without restarts).
    """
    rate = highest * (min(1.0, (step + 1) / warmup) if warmup else 1.0)
    if schedule == "constant":
        return rate
    return rate * (FLOOR + (1 - FLOOR) * 0.5 * (1 + math.cos(math.pi * min(1.0, progress))))
