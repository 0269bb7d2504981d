"""Label quality on a recording with ground truth, over seeds: ``python -m experiments.capture FOLDER``."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from labeling.runtime.cli import make_main
from labeling.runtime.help import CommandHelp

FIGURES = ("mask_ap50", "mask_ap30", "mean_iou")


@dataclass(frozen=True)
class CaptureConfig:
    """Labels a recording from its detections and from one true view per object, and writes the figures of all seeds."""

    recording: tyro.conf.Positional[Annotated[Path, tyro.conf.arg(metavar="FOLDER")]]
    """An episode with detections.json and ground_truth.json."""
    out: Path = Path("experiments/results/capture.json")
    """File for the figures."""
    confident: float = 0.6
    """Detections at least this confident are sources."""
    seeds: int = 8
    """How many seeds."""


def run(config: CaptureConfig) -> None:
    """Labels, evaluates, and writes the figures.

    Raises:
        SbmError: if the recording cannot be read or has no ground truth.
    """
    import tempfile

    from tqdm import tqdm

    from labeling.core.errors import UsageError
    from labeling.evaluation.compare import evaluate_label_set
    from labeling.formats.atomic import write_json
    from labeling.generate import GenerateConfig
    from labeling.generate import run as generate
    from labeling.generator.settings.label_config import LabelConfig
    from labeling.generator.settings.source_config import SourceConfig

    if config.seeds < 1:
        raise UsageError(f"--seeds must be at least 1, not {config.seeds}")
    sources = {"detections": SourceConfig(), "weak_one_view": SourceConfig(weak="one-view")}
    versions: dict[str, str] = {}
    figures: dict[str, list[dict[str, float]]] = {name: [] for name in ("detector", *sources)}
    with (
        tempfile.TemporaryDirectory() as folder,
        tqdm(total=len(sources) * config.seeds, unit="run", file=sys.stderr) as bar,
    ):
        for seed in range(config.seeds):
            for name, source in sources.items():
                out = Path(folder) / f"{name}_{seed}"
                label = LabelConfig(confident=config.confident, seed=seed)
                generate(GenerateConfig(dataset=config.recording, out=out, sources=source, label=label))
                metrics = evaluate_label_set(out).metrics
                figures[name].append({key: metrics["pseudo_labels"][key] for key in FIGURES})
                if not figures["detector"]:
                    figures["detector"].append({key: metrics["detector"][key] for key in FIGURES})
                    versions = metrics["versions"]
                bar.update()
    content = {
        "recording": config.recording.resolve().name,
        "confident": config.confident,
        "seeds": config.seeds,
        "versions": versions,
        **{name: summary(rows) for name, rows in figures.items()},
    }
    write_json(config.out, content)
    for name in figures:
        print(name, {key: content[name]["mean"][key] for key in FIGURES})
    print(f"figures: {config.out}")


def summary(rows: list[dict[str, float]]) -> dict[str, Any]:
    """Every seed's figures, with their mean, least and greatest, rounded to three digits."""
    columns = {key: [row[key] for row in rows] for key in FIGURES}
    return {
        "mean": {key: round(sum(values) / len(values), 3) for key, values in columns.items()},
        "least": {key: round(min(values), 3) for key, values in columns.items()},
        "greatest": {key: round(max(values), 3) for key, values in columns.items()},
        "per_seed": {key: [round(value, 3) for value in values] for key, values in columns.items()},
    }


HELP = CommandHelp(
    examples=(("EPISODE", "label it over seeds, and score it"),),
)
main = make_main("experiments.capture", CaptureConfig, run, about=HELP)

if __name__ == "__main__":
    sys.exit(main())
