"""Labels of one recorded episode under given settings, and how good they are."""

import time
from collections.abc import Hashable, Sequence
from dataclasses import asdict, dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments.cache.stages import RunContext, cached, digest, folder_digest
from labeling.generator.settings.label_config import LabelConfig
from labeling.runtime.code_digest import code_digest
from labeling.runtime.provenance import experiment_versions
from sbm_gym.sensors.noise_config import SensorNoise

if TYPE_CHECKING:
    from labeling.core.episode import Episode
    from labeling.metrics.matching import MaskInstance

FIGURES = ("mask_ap50", "mask_ap30", "box_ap50", "mean_iou", "mean_iou_matched", "amodal_mean_iou")
"""As ``labeling.evaluate`` defines them; boxes are those around the masks."""
_WARM: list[bool] = []
"""Whether this process has labelled anything."""


@dataclass(frozen=True)
class Scored:
    """One episode under one setting."""

    figures: dict[str, float | None]
    cpu_s: float
    """Processor time of labelling, in one thread."""
    objects: int
    predictions: "tuple[MaskInstance, ...]"
    """Modal masks; their ``image`` is (episode, view)."""


@dataclass(frozen=True)
class Setting:
    """What is tried."""

    config: LabelConfig | None
    """Of the label generator; None for the detector alone."""
    noise: SensorNoise = field(default_factory=SensorNoise)
    """Of depth and poses, which is added to the episodes."""


def score_all(
    folders: Sequence[Path], settings: Sequence[Setting], context: RunContext, title: str
) -> list[list[Scored]]:
    """Labels and scores every episode under all settings, taking from the store what is there.

    Args:
        folders: the episodes.
        settings: what to try.
        context: store and processes.
        title: of the progress bar.

    Returns:
        For each setting the episodes in order.

    Raises:
        SbmError: if an episode cannot be read or labelled.
    """
    common = [code_digest(_score), experiment_versions()]
    jobs = [
        (digest(common, content, asdict(setting)), (folder, setting))
        for folder in folders  # one after the other, so that a process reads few of them
        for content in [folder_digest(folder)]
        for setting in settings
    ]
    scores = cached("labels", _score, jobs, context, title, always_spawn=True, reads=lambda job: [job[0]])
    found = iter(scores)
    by_folder = [[_scored(next(found), folder) for _ in settings] for folder in folders]
    return [list(of_setting) for of_setting in zip(*by_folder, strict=True)]


def true_instances(folders: Sequence[Path]) -> "list[MaskInstance]":
    """What there is to find in all episodes."""
    return [truth for folder in folders for truth in known_truths(_read(folder), folder.name)]


def pooled_figures(truths: "Sequence[MaskInstance]", scored: Sequence[Scored]) -> dict[str, float | None]:
    """The figures of all episodes taken as one data set, ranked together."""
    return _figures([one for score in scored for one in score.predictions], truths)


@lru_cache(1)
def _read(folder: Path) -> "Episode":
    from labeling.io.episodes import read_episode

    return read_episode(folder)


def _score(job: tuple[Path, Setting]) -> dict[str, Any]:
    from agents.rollouts.recorder import noise_seed
    from labeling.generator.calibration.detector_calibration import calibration_of
    from labeling.generator.propagate import propagate
    from labeling.metrics.matching import instances_of, match, mean_iou
    from sbm_gym.sensors.sensor_noise import add_noise

    (folder, setting), seconds, objects = job, 0.0, 0
    config, episode = setting.config, _read(folder)
    if setting.noise != SensorNoise():
        seed = 0 if config is None else config.seed
        episode = add_noise(episode, setting.noise, noise_seed(seed, episode.metadata["episode"]))
    name, predictions, whole = episode.name, instances_of(episode.name, episode.detections or ()), []
    if config is not None:
        calibration = calibration_of(episode.metadata.get("detector"))
        if not _WARM:  # an episode for nothing, so that loading compiled code is not counted as labelling
            _WARM.append(propagate(episode, episode.detections, LabelConfig()) is not None)
        started = time.process_time()
        labels = propagate(episode, episode.detections, config, calibration)
        seconds, objects = time.process_time() - started, len(labels.objects)
        predictions, whole = instances_of(name, labels.labels), instances_of(name, labels.labels, "amodal")
    figures = _figures(predictions, known_truths(episode, name))
    amodal_truths = known_truths(episode, name, amodal=True)
    figures["amodal_mean_iou"] = mean_iou(amodal_truths, match(whole, amodal_truths)).mean_iou if whole else None
    records = [[one.image[1], one.category, one.rle["size"], one.rle["counts"], one.confidence] for one in predictions]
    return {"figures": figures, "cpu_s": seconds, "objects": objects, "predictions": records}


def _scored(record: dict[str, Any], folder: Path) -> Scored:
    from labeling.metrics.matching import MaskInstance

    predictions = tuple(
        MaskInstance((folder.name, view), category, {"size": size, "counts": counts}, confidence)
        for view, category, size, counts, confidence in record["predictions"]
    )
    return Scored(**{**record, "predictions": predictions})


def known_truths(episode: "Episode", name: Hashable, amodal: bool = False) -> "list[MaskInstance]":
    """Ground truth of the categories that the detector has a name for, as ``labeling.evaluate`` takes it."""
    from labeling.metrics.matching import instances_of

    known = episode.metadata.get("detector_categories")
    shared = [one for one in episode.ground_truth or () if known is None or one.category in known]
    return instances_of(name, shared, "amodal" if amodal else "modal")


def _figures(predictions: "Sequence[MaskInstance]", truths: "Sequence[MaskInstance]") -> dict[str, float | None]:
    from labeling.metrics.mask_ap import average_precision
    from labeling.metrics.matching import match, mean_iou

    ap = average_precision(predictions, truths, (0.5, 0.3)).mean
    boxes = average_precision(predictions, truths, (0.5,), kind="box").mean
    iou = mean_iou(truths, match(predictions, truths))
    means = {"mean_iou": iou.mean_iou, "mean_iou_matched": iou.mean_iou_matched}
    return {"mask_ap50": ap[0.5], "mask_ap30": ap[0.3], "box_ap50": boxes[0.5], **means}
