"""Arithmetic with scenes: a room without one of its objects and with another, from memories of three rooms.

The thesis' claim (2.6): memories in 3-D do it, a network without geometry does not. The networks are those of
``view_prediction``.
"""

from dataclasses import asdict
from typing import Any

from experiments.cache.memory_stages import (
    NO_CHANGE,
    REPROJECTION,
    ArithmeticScores,
    score_arithmetics,
    train_memories,
)
from experiments.cache.object_rooms import Exchanges, record_exchanges
from experiments.cache.origin import machines
from experiments.cache.registry import experiment
from experiments.cache.stages import RunContext
from experiments.tables.view_prediction import GRNN, NOTHING_LEARNT, SIZES, TOWER, memory_jobs

ARITHMETIC = (GRNN, TOWER)
"""Methods that decode pictures."""
UNCHANGED = "A as it is"
"""What who does nothing would give: true pictures of A."""


@experiment(
    "scene_arithmetic",
    "memories of rooms A - B + C, decoded: GRNN, a 2-D network, coloured points, and A as it is",
    pages=("memory.view_prediction",),
)
def run(context: RunContext) -> dict[str, Any]:
    """Records, trains what has not been trained, and scores.

    Returns:
        Settings, and by method and seed the figures of predicted views by the number of inputs.
    """
    size = SIZES[context.scale]
    rooms = record_exchanges(Exchanges(size.test, seed=3), context)
    episodes = {part: tuple(folders) for part, folders in rooms.items()}
    jobs = memory_jobs(context, ARITHMETIC)
    runs = train_memories([job for _, job in jobs], context)
    methods: list[tuple[str, int | None, str]] = [(UNCHANGED, None, NO_CHANGE), (NOTHING_LEARNT, None, REPROJECTION)]
    methods += [(name, job.seed, folder) for (name, job), folder in zip(jobs, runs, strict=True)]
    wanted = [ArithmeticScores(method, episodes, size.memory, size.inputs, size.targets) for _, _, method in methods]
    scores = score_arithmetics(wanted, context)
    return {
        "settings": {
            "memory": asdict(size.memory),
            "exchanges": size.test,
            "inputs": list(size.inputs),
            "targets": size.targets,
        },
        "machines": machines(runs),
        "rows": [
            {"name": name, "seed": seed, "inputs": found}
            for (name, seed, _), found in zip(methods, scores, strict=True)
        ],
    }
