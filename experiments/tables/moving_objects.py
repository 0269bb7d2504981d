"""What moves between two views of unseen rooms, found without a label: flow on a memory beside ICP residuals."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments.cache.memory_stages import MemoryJob, train_memories
from experiments.cache.moving_stages import CLUSTERS, RESIDUALS, FlowJob, MovingScores, score_moving, train_flows
from experiments.cache.origin import MACHINE, machine_of, machines
from experiments.cache.registry import experiment
from experiments.cache.stages import RunContext, Scale
from labeling.memory.settings.flow_settings import TrainFlowConfig
from labeling.memory.settings.memory_spec import MemorySize
from labeling.memory.settings.train_config import TrainMemoryConfig

if TYPE_CHECKING:
    from experiments.cache.episode_pool import EpisodePool

ENV, MODEL = "sbm_gym/Indoor-v0", "cn3d"
LEARN_SEED, TEST_SEED, MOVERS = 51, 52, 6
"""Of endless scenes. Settings were chosen on such scenes of other seeds."""
MADE_UP, MATCHED = "flow, made-up motion", "flow, made-up motion and matching"
SUPERVISED = "flow, supervised: true motion"
"""The same network in as many batches, from ground truth of the episodes in which things move."""
NOT_MATCHED = (MADE_UP, SUPERVISED)
"""Learn from known motion alone; features are not compared along the flow."""


@dataclass(frozen=True)
class Size:
    """How much of everything a scale has."""

    standing: int
    """Episodes in which nothing moves, to learn from; a tenth of them is to choose by."""
    moving: int
    """Episodes in which things move, whose motion is not told: features are to match in them."""
    test: int
    memory: MemorySize
    train_memory: TrainMemoryConfig
    train: TrainFlowConfig


SIZES: dict[Scale, Size] = {
    "smoke": Size(
        3,
        2,
        2,
        MemorySize((16, 16, 8), 0.32, 8, 8, 8, (32, 32)),
        TrainMemoryConfig(iterations=4, validate_every=2, inputs=2),
        TrainFlowConfig(iterations=4, validate_every=2),
    ),
    "quick": Size(
        30,
        20,
        40,
        MemorySize(),
        TrainMemoryConfig(iterations=400, validate_every=100),
        TrainFlowConfig(iterations=1000, validate_every=250, batch_size=4),
    ),
    "standard": Size(
        100,
        60,
        80,
        MemorySize(),
        TrainMemoryConfig(iterations=4000, validate_every=500),
        TrainFlowConfig(iterations=5000, validate_every=500, batch_size=4),
    ),
    "full": Size(
        300,
        200,
        200,
        MemorySize((64, 64, 32), 0.08, 32, 48, 64, (128, 128)),
        TrainMemoryConfig(iterations=40_000, validate_every=1000, batch_size=4),
        TrainFlowConfig(iterations=40_000, validate_every=1000, batch_size=8, width=32),
    ),
}


@experiment(
    "moving_objects",
    "what moves in unseen rooms, without a label: flow on a memory beside ICP residuals",
    pages=("memory.moving_objects",),
)
def run(context: RunContext) -> dict[str, Any]:
    """Records, trains and scores.

    Returns:
        Settings, the episodes, and for every method and seed the figures of ``score_moving``; methods that learn
        nothing have no seed.
    """
    from experiments.cache.episode_pool import pool_record, record

    size, pools = SIZES[context.scale], episode_pools(context.scale)
    episodes = {name: tuple(record(pool, context)) for name, pool in pools.items()}
    learn, choose = _split(episodes["standing"])
    memories = train_memories([_memory_job(learn, choose, seed, size) for seed in context.seeds], context)
    held = max(1, size.moving // 10)
    learnt = {
        MADE_UP: (learn, (), choose),
        MATCHED: (learn, episodes["moving"], choose),
        SUPERVISED: (episodes["moving"][held:], (), episodes["moving"][:held]),
    }
    jobs = [
        _flow_job(name, memory, own, moving, held_out, seed, size)
        for name, (own, moving, held_out) in learnt.items()
        for memory, seed in zip(memories, context.seeds, strict=True)
    ]
    flows = train_flows(jobs, context)
    named = [(RESIDUALS, None, RESIDUALS), (CLUSTERS, None, CLUSTERS)]
    named += [(job.title, job.seed, run) for job, run in zip(jobs, flows, strict=True)]
    scores = score_moving([MovingScores(run, episodes["test"], size.memory) for _, _, run in named], context)
    return {
        "settings": {
            "memory": asdict(size.memory),
            "model": MODEL,
            "train_memory": asdict(size.train_memory),
            "train": asdict(size.train),
        },
        "pools": {name: pool_record(pool, list(episodes[name])) for name, pool in pools.items()},
        "machines": machines([*memories, *flows]),
        "rows": [
            {"name": name, "seed": seed, MACHINE: None if seed is None else machine_of(method), **found}
            for (name, seed, method), found in zip(named, scores, strict=True)
        ],
    }


def made_up_flow(seed: int, context: RunContext) -> tuple[str, tuple[Path, ...]]:
    """Flow that has learnt from made-up motion, trained if it is not in the cache.

    Returns:
        Folder of its run, and the episodes to test on.
    """
    from experiments.cache.episode_pool import record

    size, pools = SIZES[context.scale], episode_pools(context.scale)
    learn, choose = _split(record(pools["standing"], context))
    (memory,) = train_memories([_memory_job(learn, choose, seed, size)], context)
    (flow,) = train_flows([_flow_job(MADE_UP, memory, learn, (), choose, seed, size)], context)
    return flow, tuple(record(pools["test"], context))


def episode_pools(scale: Scale) -> "dict[str, EpisodePool]":
    """Episodes in which things stand, in which they move, and to test on."""
    from experiments.cache.episode_pool import EpisodePool

    size = SIZES[scale]
    return {
        "standing": EpisodePool("rooms_flow_standing", ENV, "endless", size.standing, LEARN_SEED),
        "moving": EpisodePool("rooms_flow_moving", ENV, "endless", size.moving, LEARN_SEED, moving=MOVERS),
        "test": EpisodePool("rooms_flow_test", ENV, "endless", size.test, TEST_SEED, moving=MOVERS),
    }


def _split(standing: Sequence[Path]) -> tuple[tuple[Path, ...], tuple[Path, ...]]:
    """Episodes to learn from, and to choose by."""
    held = max(1, len(standing) // 10)
    return tuple(standing[:-held]), tuple(standing[-held:])


def _memory_job(learn: tuple[Path, ...], choose: tuple[Path, ...], seed: int, size: Size) -> MemoryJob:
    return MemoryJob(MODEL, learn, choose, size.memory, size.train_memory, seed)


def _flow_job(
    name: str,
    memory: str,
    learn: tuple[Path, ...],
    moving: tuple[Path, ...],
    choose: tuple[Path, ...],
    seed: int,
    size: Size,
) -> FlowJob:
    train = replace(size.train, matching=0.0) if name in NOT_MATCHED else size.train
    return FlowJob(memory, learn, moving, choose, train, seed, name, supervised=name == SUPERVISED)
