"""Makes the weights of ``compact`` from photographs: ``python -m experiments.pretrain_compact``."""

import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from experiments.pretraining.world_views import WORLDS, WorldViewsConfig
from labeling.core.errors import UsageError
from labeling.runtime.cli import make_main
from labeling.runtime.help import CommandHelp
from labeling.runtime.ranges import Positive, check_ranges
from labeling.training.command import say

MAX_BYTES = 20_000_000


@dataclass(frozen=True)
class CompactConfig:
    """Takes photographs, trains the detector on them, fits its confidences, tries it in worlds, and writes weights and
    figures. Every part is kept and gone on with, if the command is killed and started again.
    """

    photographs: Path = Path("out/photographs")
    """Folder with train and val, made if they are missing."""
    count: int = 6000
    """Photographs to train on."""
    val_count: int = 600
    """Held-out photographs."""
    size: int = 192
    """Of photographs, pixels."""
    workers: int = 2
    """Processes that take photographs."""
    out: Path = Path("out/pretrain")
    """Folder of the run: checkpoint, history, weights before calibration."""
    weights: Path = Path("labeling/detectors/weights/compact.safetensors")
    """File for the weights."""
    results: Path = Path("experiments/results/pretrain_compact.json")
    """File for the figures."""
    minutes: Positive[float] = 90.0
    """Time for training; a run that is cut short has learned with a schedule of this length."""
    steps: Positive[int] = 6000
    """Batches at most; training ends when either is used up."""
    batch_size: int = 16
    """Views in a batch."""
    learning_rate: float = 1e-3
    """Greatest, of AdamW."""
    seed: int = 0
    """Of photographs and training."""
    calibrate: Literal["photographs", "worlds", "none"] = "photographs"
    """What confidences are fitted on: held-out photographs, or views of the worlds' training scenes."""
    views: WorldViewsConfig = field(default_factory=WorldViewsConfig)
    """On which views of worlds it is tried out."""


def run(config: CompactConfig) -> None:
    """Makes the weights.

    Raises:
        SbmError: if settings make no sense, furniture is missing, or training breaks down.
    """
    import os

    # Threads that spin at barriers cost seven times the work on a machine that does other things too. Read by torch's
    # OpenMP when torch is imported.
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")
    import torch

    from experiments.pretraining.augmentation import PretrainAugmentConfig
    from experiments.pretraining.loop import PretrainConfig, PretrainTask
    from labeling.detectors.data.annotated_pictures import read_pictures
    from labeling.detectors.networks.mask_rcnn import build_from_imagenet
    from labeling.detectors.networks.spec import NetworkSpec
    from labeling.training.loop import train
    from sbm_gym.photographs.album import AlbumSettings, make_album
    from sbm_gym.photographs.models import CATEGORIES

    check_ranges(config)
    training = PretrainConfig(
        iterations=config.steps,
        minutes=config.minutes,
        batch_size=config.batch_size,
        learning_rate=config.learning_rate,
        seed=config.seed,
    )
    training.check()
    pictures = {}
    for split, count in (("train", config.count), ("val", config.val_count)):
        folder = config.photographs / split
        make_album(folder, AlbumSettings(split, config.seed, config.size, False), count, config.workers)
        pictures[split] = read_pictures(folder)
    torch.manual_seed(config.seed)
    network = build_from_imagenet(NetworkSpec("compact", CATEGORIES))
    task = PretrainTask(network, pictures["train"], pictures["val"], training, PretrainAugmentConfig())
    train(task, config.out, say)
    _finish(config, task.candidate, pictures["val"])


def _finish(config: CompactConfig, network: Any, val: list) -> None:
    """Calibrates, measures, and writes weights and figures."""
    import json
    from dataclasses import asdict, replace

    from experiments.pretraining.world_views import figures, summary, world_views
    from labeling.core.masks import MASK_THRESHOLD
    from labeling.detectors.networks.calibration import fit_calibration, outcomes
    from labeling.detectors.networks.network_detector import NetworkDetector
    from labeling.detectors.networks.weights import load_network, save_network
    from labeling.detectors.scoring import detect_all
    from labeling.formats.atomic import write_json
    from labeling.training.config import HISTORY_FILE

    # As labels are made of what it finds: confidences are calibrated for these masks.
    raw = NetworkDetector(network, "compact", mask_threshold=MASK_THRESHOLD)
    splits: tuple[Literal["train", "val"], ...] = ("train", "val")
    parts = {f"{world}_{split}": world_views(config.views, world, split) for world in WORLDS for split in splits}
    truths, found = detect_all(raw, val)
    scores, right = outcomes(found, truths)
    if config.calibrate == "worlds":
        scores, right = [], []
        for world in WORLDS:
            there, seen = detect_all(raw, parts[f"{world}_train"])
            more = outcomes(seen, there)
            scores, right = scores + more[0], right + more[1]
    spec = network.spec
    if config.calibrate != "none":
        spec = replace(spec, calibration=fit_calibration(scores, right))
    history = json.loads((config.out / HISTORY_FILE).read_text(encoding="utf-8"))
    about = {
        "trained_on": f"{config.count} rendered photographs, seed {config.seed}",
        "steps": history[-1]["step"],
        "minutes": history[-1]["minutes"],
        "calibrated_on": config.calibrate,
    }
    save_network(config.weights, network, replace(spec, about=about))
    if config.weights.stat().st_size > MAX_BYTES:
        raise UsageError(f"{config.weights} has more than {MAX_BYTES} bytes; the network is too large to ship")
    # Measured as shipped: in half precision and calibrated.
    shipped = NetworkDetector(load_network(config.weights), "compact", mask_threshold=MASK_THRESHOLD)
    content = {
        "bytes": config.weights.stat().st_size,
        "config": json.loads(json.dumps(asdict(config), default=str)),
        "calibration": asdict(spec.calibration),
        **about,
        "held_out_photographs": figures(shipped, val),
        "before_calibration": {
            "held_out_photographs": summary(truths, found),
            "worlds": {name: figures(raw, pictures) for name, pictures in parts.items()},
        },
        "worlds": {name: figures(shipped, pictures) for name, pictures in parts.items()},
    }
    write_json(config.results, content)
    for name, row in {"photographs": content["held_out_photographs"], **content["worlds"]}.items():
        print(f"{name}: AP50 {row['ap50']}, confident precision {row['confident_precision']}")
    print(config.weights)
    print(config.results)


HELP = CommandHelp(
    examples=(
        ("", "all of it; a rerun goes on where it stopped"),
        ("--minutes 10", "as far as ten minutes go"),
    ),
)
main = make_main("experiments.pretrain_compact", CompactConfig, run, about=HELP)

if __name__ == "__main__":
    sys.exit(main())
