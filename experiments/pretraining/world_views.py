"""Views in worlds, to see how well a detector does there: episodes of the ring policy, recorded once and kept."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from labeling.core.detector import Detector
from labeling.detectors.data.annotated_pictures import AnnotatedPicture, read_pictures
from labeling.metrics.matching import MaskInstance

WORLDS = {"indoor": "sbm_gym/Indoor-v0", "outdoor": "sbm_gym/Outdoor-v0"}
CONFIDENT = 0.9


@dataclass(frozen=True)
class WorldViewsConfig:
    """How many views a detector is tried on."""

    folder: Path = Path("out/pretrain_worlds")
    """Where episodes are kept."""
    episodes: int = 15
    """Episodes of the training scenes of each kind of world, of 25 views."""
    val_episodes: int = 6
    """Likewise of the validation scenes."""
    seed: int = 77
    """Of scenes, starts and paths."""


def world_views(config: WorldViewsConfig, world: str, split: Literal["train", "val"]) -> list[AnnotatedPicture]:
    """Views with ground truth; see ``record_views``."""
    return read_pictures(record_views(config, world, split))


def record_views(config: WorldViewsConfig, world: str, split: Literal["train", "val"]) -> Path:
    """Records the episodes that are not there yet, and returns their folder.

    Args:
        config: settings.
        world: a key of ``WORLDS``.
        split: "train" or "val"; test scenes are for final results only.
    """
    from agents.rollouts.collect_config import CollectConfig
    from agents.rollouts.recorder import collect_episodes
    from experiments.cache.stages import digest
    from labeling.runtime.code_digest import code_digest
    from labeling.runtime.provenance import experiment_versions
    from sbm_gym.assets.catalog.same_libraries import library_digests

    episodes = config.episodes if split == "train" else config.val_episodes
    # Another name whenever worlds, their pictures or furniture are others.
    made_by = digest(code_digest(collect_episodes), experiment_versions(), library_digests())
    out = config.folder / f"{world}_{split}-{made_by}"
    collect_episodes(CollectConfig(out=out, env=WORLDS[world], episodes=episodes, seed=config.seed, split=split))
    return out


def figures(detector: Detector, pictures: Sequence[AnnotatedPicture]) -> dict[str, Any]:
    """AP at IoU .5 and .3 per class and in the mean, and how often confident detections are right; see ``summary``."""
    from labeling.detectors.scoring import detect_all

    return summary(*detect_all(detector, pictures))


def summary(truths: Sequence[MaskInstance], found: Sequence[MaskInstance]) -> dict[str, Any]:
    """Figures of detections.

    Args:
        truths: what there is to find, of the classes that the detector knows.
        found: detections.
    """
    from labeling.detectors.networks.calibration import outcomes
    from labeling.metrics.mask_ap import average_precision

    masks = average_precision(found, truths, (0.5, 0.3))
    scores, right = outcomes(found, truths)
    confident = [ok for score, ok in zip(scores, right, strict=True) if score >= CONFIDENT]
    return {
        "ap50": _percent(masks.mean[0.5]),
        "ap30": _percent(masks.mean[0.3]),
        "ap50_per_class": {name: _percent(ap[0.5]) for name, ap in masks.per_class.items() if ap[0.5] is not None},
        "confident_detections": len(confident),
        "confident_precision": _percent(sum(confident) / len(confident)) if confident else None,
        "confident_recall": _percent(sum(confident) / max(sum(not truth.ignore for truth in truths), 1)),
        "objects": sum(not truth.ignore for truth in truths),
    }


def _percent(value: float | None) -> float | None:
    return None if value is None else round(100 * value, 2)
