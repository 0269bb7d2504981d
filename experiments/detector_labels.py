"""What labels make of other detectors: ``python -m experiments.detector_labels DETECTOR ... --episodes FOLDER ...``."""

import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

from labeling.core.errors import UsageError
from labeling.runtime.cli import make_main
from labeling.runtime.help import CommandHelp


@dataclass(frozen=True)
class DetectorLabelsConfig:
    """Lets detectors look at recorded episodes with ground truth, labels the views from what they find, and scores the
    detections and the labels on the same views.

    The episodes themselves stay as they are: copies in the cache are looked at.
    """

    detectors: tyro.conf.Positional[tuple[Annotated[str, tyro.conf.arg(metavar="DETECTOR")], ...]]
    """Which detectors, under the names that labeling.detect takes."""
    episodes: tuple[Path, ...] = ()
    """Folders of episodes, each a row of the table for each detector."""
    cache: Path = Path("out/experiments")
    """Folder for the copies, detections and labels; what is there already is not done again."""
    results: Path = Path("experiments/results/detector_labels.json")
    """File for the figures."""


def run(config: DetectorLabelsConfig) -> None:
    """Detects, labels and scores, and writes the figures.

    Raises:
        SbmError: if there is no such detector, or episodes cannot be read or have no ground truth.
    """
    from labeling.detectors.registry import check_name
    from labeling.formats.atomic import write_json
    from labeling.runtime.provenance import experiment_provenance

    if not config.detectors or not config.episodes:
        raise UsageError("give at least one DETECTOR, and --episodes with at least one folder of episodes")
    for name in config.detectors:
        check_name(name)
    records = [_scores(name, dataset, config.cache) for dataset in config.episodes for name in config.detectors]
    write_json(config.results, {"detectors": records, **experiment_provenance()})
    print(f"figures: {config.results}")


def _scores(name: str, dataset: Path, cache: Path) -> dict[str, Any]:
    """What one detector finds in the episodes of a dataset, and what labels made of it are worth."""
    from experiments.cache.episode_pool import link_dataset
    from experiments.cache.stages import RunContext, digest, folder_digest
    from labeling.detect import DetectCommand
    from labeling.detect import run as detect
    from labeling.detectors.registry import detector_digest
    from labeling.evaluation.compare import evaluate_label_set
    from labeling.generate import GenerateConfig
    from labeling.generate import run as generate
    from labeling.io.episodes import find_episodes
    from labeling.runtime.code_digest import code_digest
    from labeling.runtime.provenance import experiment_versions

    weights = detector_digest(name)
    folders = {folder.name: folder for folder in find_episodes(dataset)}
    episodes = [folder_digest(folder) for folder in folders.values()]
    code = [code_digest(detect), experiment_versions()]
    own = f"detector-labels-{digest(str(dataset.resolve()), weights, episodes, *code)}"
    linked = link_dataset(own, folders, RunContext(scale="quick", seeds=(0,), workers=1, cache=cache))
    detect(DetectCommand(dataset=linked[0].parent, detector=name, replace=True))
    labelled: dict[str, dict[str, float | None]] = {}
    for kind, shared in {"alone": False, "shared": True}.items():
        out = cache / "label_sets" / f"{own}-{kind}"
        generate(GenerateConfig(dataset=linked[0].parent, out=out, share_scenes=shared))
        metrics = evaluate_label_set(out).metrics
        labelled["detections"] = _figures(metrics["detector"])
        labelled[kind] = _figures(metrics["pseudo_labels"])
        print(f"{_public(name)}, {dataset.name}, {kind}:", labelled[kind], "detections:", labelled["detections"])
    return {
        "detector": _public(name),
        "digest": weights,
        "dataset": dataset.name,
        **_about(folders),
        **labelled,
    }


def _about(folders: Mapping[str, Path]) -> dict[str, Any]:
    """The world and the scenes of episodes, as far as they say."""
    from labeling.formats.checked_json import read_json

    abouts = [read_json(folder / "episode.json").mapping() for folder in folders.values()]
    return {
        "episodes": len(folders),
        "worlds": sorted({str(about["world"]) for about in abouts if "world" in about}),
        "scenes": sorted({str(about["scene"]) for about in abouts if "scene" in about}),
    }


def _figures(metrics: Mapping[str, Any]) -> dict[str, float | None]:
    """None where the detector has no name for anything that is there."""
    from labeling.evaluation.compare import FIGURES

    return {name: None if metrics[name] is None else round(float(metrics[name]), 4) for name in FIGURES}


def _public(name: str) -> str:
    """The name of a detector without the folders of its file."""
    kind, colon, path = name.rpartition(":")
    return f"{kind}{colon}{Path(path).name}"


HELP = CommandHelp(
    examples=(
        (
            "onnx:yolox:yolox_nano.onnx compact --episodes ROOMS STREETS",
            "what an exported detector and the default one find in two folders of episodes",
        ),
    ),
)
main = make_main("experiments.detector_labels", DetectorLabelsConfig, run, about=HELP)

if __name__ == "__main__":
    sys.exit(main())
