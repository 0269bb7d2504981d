"""Trains a 3-D memory on episodes: ``python -m labeling.train_memory EPISODES --model grnn --out RUN``."""

import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import tyro

from labeling.core.errors import UsageError
from labeling.memory.settings.memory_spec import MemorySize, Model
from labeling.memory.settings.train_config import TrainMemoryConfig
from labeling.runtime.cli import make_main, progress_bar, say_next
from labeling.runtime.help import CommandHelp
from labeling.training.command import Episodes, held_out, say

if TYPE_CHECKING:
    from labeling.memory.view_prediction.scenes import SmallScene


@dataclass(frozen=True)
class TrainMemoryCommand:
    """Trains a feature memory of scenes in 3-D by letting it predict views it has not been given. Needs no labels.

    Keeps the best network in RUN/memory.safetensors, by what it predicts of --val: pictures (grnn, tower) or features
    (cn3d). A run that was killed goes on where it stopped when the same command is given again; one that is told to
    stop (Ctrl-C, SIGTERM) loses nothing.
    """

    episodes: Episodes
    """What to learn from: episodes with depth and poses, one or several folders of them. Nothing in them may move."""
    out: Path
    """Folder of the run."""
    model: Model = "grnn"
    """"grnn" writes its memory with a recurrent network and decodes pictures of other views; "cn3d" takes the mean of
    what views have seen and predicts features, by contrast; "tower" is a 2-D network to compare with."""
    val: Path | None = None
    """Episodes to choose the best by. Without it every tenth of EPISODES is held out."""
    device: str | None = None
    """cpu, cuda, ...; by default a GPU if there is one."""
    size: tyro.conf.OmitArgPrefixes[MemorySize] = field(default_factory=MemorySize)
    train: tyro.conf.OmitArgPrefixes[TrainMemoryConfig] = field(default_factory=TrainMemoryConfig)


def run(command: TrainMemoryCommand) -> dict[str, Any]:
    """Trains and prints the final figures.

    Returns:
        What ``RUN/results.json`` holds.

    Raises:
        SbmError: if episodes or settings are at fault.
    """
    from labeling.detectors.registry import choose_device
    from labeling.formats.atomic import write_json
    from labeling.memory.networks.weights import MEMORY_FILE
    from labeling.memory.view_prediction.training import MemoryTask
    from labeling.runtime.interrupts import graceful_interrupt
    from labeling.training.config import RESULTS_FILE
    from labeling.training.loop import train

    if not command.episodes:
        raise UsageError("nothing to learn from was given: name one or several folders of episodes")
    command.train.check()
    spec, device = command.size.spec(command.model), choose_device(command.device)
    learn, validation = _read(command)
    print(f"{len(learn)} episodes to learn from, {len(validation)} to choose by")
    about = {"episodes": ", ".join(map(str, command.episodes))}
    task = MemoryTask(spec, learn, validation, command.train, device, about)
    with graceful_interrupt() as stop:
        progress = train(task, command.out, say, progress_bar, stop)
    best = next((one for one in progress.history if one["iteration"] == progress.best_iteration), {})
    results = {
        **about,
        "model": command.model,
        "best_iteration": progress.best_iteration,
        "iterations": progress.iteration,
        "seed": command.train.seed,
        "validation": {name: value for name, value in best.items() if name != "iteration"},
    }
    write_json(command.out / RESULTS_FILE, results)
    print(f"memory: {command.out / MEMORY_FILE}")
    say_next("look at what it predicts", "labeling.imagine", command.out, "EPISODE", "--out", "PICTURES")
    return results


def _read(command: TrainMemoryCommand) -> "tuple[list[SmallScene], list[SmallScene]]":
    """Episodes to learn from and to choose by."""
    from labeling.memory.view_prediction.scenes import read_scenes

    spec = command.size.spec(command.model)
    scenes, notes = read_scenes(command.episodes, spec, command.train.around)
    validation: list[SmallScene] = []
    if command.val is not None:
        validation, more = read_scenes([command.val], spec, command.train.around)
        notes += more
    for note in notes:
        print(f"note: left out {note}")
    return (scenes, validation) if command.val is not None else held_out(scenes)


HELP = CommandHelp(
    groups={
        "common options": ("episodes", "out", "model", "val", "iterations", "inputs", "targets", "seed", "device"),
        "size of the memory": ("voxels", "voxel-m", "channels", "planes", "width", "picture", "around"),
    },
    examples=(
        ("EPISODES --out RUN", "GRNN, to predict pictures"),
        ("EPISODES --model cn3d --val OTHERS --out RUN", "C-N3D, to predict features"),
        ("EPISODES --voxels 64 64 32 --voxel-m .08 --channels 32 --out RUN", "finer, for a GPU"),
    ),
)
main = make_main("labeling.train_memory", TrainMemoryCommand, run, about=HELP)

if __name__ == "__main__":
    sys.exit(main())
