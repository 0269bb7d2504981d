"""Trains flow on a 3-D memory: ``python -m labeling.train_flow EPISODES --memory RUN --out FLOW``."""

import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import tyro

from labeling.core.errors import UsageError
from labeling.memory.settings.flow_settings import TrainFlowConfig
from labeling.runtime.cli import make_main, progress_bar, say_next
from labeling.runtime.help import CommandHelp
from labeling.training.command import Episodes, held_out, say

if TYPE_CHECKING:
    from labeling.memory.flow.flow_samples import Pair
    from labeling.memory.networks.weights import Memory
    from labeling.memory.view_prediction.scenes import SmallScene


@dataclass(frozen=True)
class TrainFlowCommand:
    """Trains a network that tells how far everything in a 3-D memory has moved from one view to the next. Needs no
    labels: it learns from pieces of standing scenes that are moved by known amounts.

    Keeps the best network in RUN/detector.safetensors; RUN is then a detector of what moves (labeling.detect3d). A run
    that was killed goes on where it stopped when the same command is given again; one that is told to stop (Ctrl-C,
    SIGTERM) loses nothing.
    """

    episodes: Episodes
    """What to learn from: episodes with depth and poses, one or several folders of them. Nothing in them may move, but
    with --supervised."""
    memory: Path
    """Folder of a labeling.train_memory run (grnn or cn3d). Its weights stay as they are."""
    out: Path
    """Folder of the run."""
    moving: Path | None = None
    """Episodes in which things move, with or without ground truth, which is not read: features are to match along the
    flow there, too."""
    val: Path | None = None
    """Episodes to choose the best by, as EPISODES. Without it every tenth of these is held out."""
    supervised: bool = False
    """Learn from what really moves in EPISODES, by their ground truth of masks and motion, instead of motion that is
    made up: for comparisons, as robots know no such truth."""
    device: str | None = None
    """cpu, cuda, ...; by default a GPU if there is one."""
    train: tyro.conf.OmitArgPrefixes[TrainFlowConfig] = field(default_factory=TrainFlowConfig)


def run(command: TrainFlowCommand) -> dict[str, Any]:
    """Trains and prints the final figures.

    Returns:
        What ``RUN/results.json`` holds.

    Raises:
        SbmError: if episodes, memory or settings are at fault.
    """
    from labeling.detectors.registry import choose_device
    from labeling.formats.atomic import write_json
    from labeling.memory.flow.flow_training import FlowTask
    from labeling.memory.networks.weights import load_memory
    from labeling.memory.settings.flow_settings import FlowSpec
    from labeling.runtime.interrupts import graceful_interrupt
    from labeling.training.config import RESULTS_FILE
    from labeling.training.loop import train

    if not command.episodes:
        raise UsageError("nothing to learn from was given: name one or several folders of episodes")
    command.train.check()
    device, memory = choose_device(command.device), load_memory(command.memory)
    FlowSpec(memory.spec, command.train.width)
    learn, validation, moving = _read(command, memory)
    print(
        f"{_count(learn)} pairs of views of {len(learn)} episodes to learn from, {_count(validation)} to choose by, "
        f"{_count(moving)} of episodes in which things move"
    )
    about = {"episodes": ", ".join(map(str, command.episodes)), "memory": str(command.memory)}
    task = FlowTask(memory, learn, moving, validation, command.train, device, about)
    with graceful_interrupt() as stop:
        progress = train(task, command.out, say, progress_bar, stop)
    best = next((one for one in progress.history if one["iteration"] == progress.best_iteration), {})
    results = {
        **about,
        "best_iteration": progress.best_iteration,
        "iterations": progress.iteration,
        "seed": command.train.seed,
        "validation": {name: value for name, value in best.items() if name != "iteration"},
    }
    write_json(command.out / RESULTS_FILE, results)
    print(f"detector of what moves: {command.out}")
    say_next("find what moves with it", "labeling.detect3d", "EPISODES", "--detector", command.out)
    return results


def _count(episodes: "Sequence[Sequence[Pair]]") -> int:
    return sum(map(len, episodes))


def _read(
    command: TrainFlowCommand, memory: "Memory"
) -> "tuple[Sequence[Sequence[Pair]], Sequence[Sequence[Pair]], Sequence[Sequence[SmallScene]]]":
    """Pairs of views to learn from, to choose by, and in which things move."""
    from labeling.memory.flow.true_pairs import read_true_pairs
    from labeling.memory.flow.view_pairs import read_view_pairs

    read = read_true_pairs if command.supervised else read_view_pairs
    pairs, notes = read(command.episodes, memory.spec)
    validation, notes_of_val = read([command.val], memory.spec) if command.val else ([], [])
    moving, notes_of_moving = read_view_pairs([command.moving], memory.spec) if command.moving else ([], [])
    notes += [*notes_of_val, *notes_of_moving]
    for note in notes:
        print(f"note: left out {note}")
    if command.val is None:
        pairs, validation = held_out(pairs)
    return pairs, validation, moving


HELP = CommandHelp(
    groups={
        "common options": ("episodes", "memory", "out", "moving", "val", "iterations", "seed", "supervised", "device"),
        "motion that is made up": ("pieces", "furthest-m", "furthest-turn-deg"),
    },
    examples=(
        ("EPISODES --memory MEMORY_RUN --out FLOW", "from pieces of standing scenes that are moved"),
        ("EPISODES --memory MEMORY_RUN --moving OTHERS --out FLOW", "and from features that match where things move"),
    ),
)
main = make_main("labeling.train_flow", TrainFlowCommand, run, about=HELP)

if __name__ == "__main__":
    sys.exit(main())
