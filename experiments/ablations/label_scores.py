"""Labels of one recorded episode under given settings, and how good they are."""

import hashlib
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments.cache.stages import RunContext, Store, digest, folder_digest, run_tasks
from labeling.generator.settings.label_config import LabelConfig
from labeling.runtime.code_digest import code_digest
from labeling.runtime.provenance import experiment_versions

if TYPE_CHECKING:
    from labeling.core.episode import Episode
    from labeling.metrics.matching import MaskInstance

FIGURES = ("mask_ap50", "mask_ap30", "mean_iou", "mean_iou_matched", "amodal_mean_iou")
"""As ``labeling.evaluate`` defines them."""
STAGE = "labels"
SCORING_CODE = (
    "labeling.generator.propagate",
    "labeling.io.episodes",
    "labeling.metrics.matching",
    "labeling.metrics.mask_ap",
)
CONFIGS_PER_TASK = 6
"""An episode is read once for so many settings; fewer make the progress bar smoother."""


@dataclass(frozen=True)
class Scored:
    """One episode under one setting."""

    figures: dict[str, float | None]
    cpu_s: float
    """Processor time of labelling, in one thread."""
    objects: int
    predictions: "tuple[MaskInstance, ...]"
    """Modal masks; their ``image`` is (episode, view)."""


_warm: list[bool] = []


@dataclass(frozen=True)
class _Task:
    folder: str
    store: Store
    wanted: tuple[tuple[str, LabelConfig | None], ...]
    """Keys of the outcomes, and settings; None stands for the detector's own masks."""


def score_all(
    folders: Sequence[Path], configs: Sequence[LabelConfig | None], context: RunContext, title: str
) -> list[list[Scored]]:
    """Labels and scores every episode under all settings, taking from the store what is there.

    Args:
        folders: the episodes.
        configs: the settings; None for the detector alone.
        context: store and processes.
        title: of the progress bar.

    Returns:
        For each setting the episodes in order.

    Raises:
        SbmError: if an episode cannot be read or labelled.
    """
    own = hashlib.sha256(Path(__file__).read_bytes()).hexdigest()
    common = [own, code_digest(*SCORING_CODE), experiment_versions()]
    keys = {
        (folder, number): digest(common, content, None if config is None else asdict(config))
        for folder in folders
        for content in [folder_digest(folder)]
        for number, config in enumerate(configs)
    }
    tasks = []
    for folder in folders:
        missing = {
            keys[folder, number]: config
            for number, config in enumerate(configs)
            if not context.store.has(STAGE, keys[folder, number])
        }
        wanted = list(missing.items())
        tasks += [
            _Task(str(folder), context.store, tuple(wanted[start : start + CONFIGS_PER_TASK]))
            for start in range(0, len(wanted), CONFIGS_PER_TASK)
        ]
    run_tasks(_work, tasks, context.workers, title, lambda task: len(task.wanted))
    return [
        [_scored(context.store.read(STAGE, keys[folder, number]), folder) for folder in folders]
        for number in range(len(configs))
    ]


def true_instances(folders: Sequence[Path]) -> "list[MaskInstance]":
    """What there is to find in all episodes."""
    from labeling.io.episodes import read_episode

    return [truth for folder in folders for truth in _truths(read_episode(folder), folder.name)]


def pooled_figures(truths: "Sequence[MaskInstance]", scored: Sequence[Scored]) -> dict[str, float | None]:
    """The figures of all episodes taken as one data set, ranked together."""
    return _figures([one for score in scored for one in score.predictions], truths)


def _work(task: _Task) -> None:
    from labeling.io.episodes import read_episode

    episode = read_episode(Path(task.folder))
    _warm_up(episode)
    for key, config in task.wanted:
        task.store.write(STAGE, key, _score(episode, config))


def _warm_up(episode: "Episode") -> None:
    """Labels one episode per process for nothing, so that loading compiled code is not counted as labelling."""
    if not _warm:
        _warm.append(True)
        _score(episode, LabelConfig())


def _score(episode: "Episode", config: LabelConfig | None) -> dict[str, Any]:
    from labeling.generator.propagate import propagate
    from labeling.metrics.matching import instances_of, match, mean_iou

    name, seconds, objects = episode.name, 0.0, 0
    whole: list[MaskInstance] = []
    if config is None:
        predictions = instances_of(name, episode.detections or ())
    else:
        with _cpu_seconds() as spent:
            labels = propagate(episode, episode.detections, config)
        seconds, objects = spent[0], len(labels.objects)
        predictions, whole = instances_of(name, labels.labels), instances_of(name, labels.labels, "amodal")
    figures = _figures(predictions, _truths(episode, name))
    amodal_truths = _truths(episode, name, amodal=True)
    figures["amodal_mean_iou"] = mean_iou(amodal_truths, match(whole, amodal_truths)).mean_iou if whole else None
    return {
        "figures": figures,
        "cpu_s": seconds,
        "objects": objects,
        "predictions": [
            [one.image[1], one.category, one.rle["size"], one.rle["counts"], one.confidence] for one in predictions
        ],
    }


def _scored(record: dict[str, Any], folder: Path) -> Scored:
    from labeling.metrics.matching import MaskInstance

    predictions = tuple(
        MaskInstance((folder.name, view), category, {"size": size, "counts": counts}, confidence)
        for view, category, size, counts, confidence in record["predictions"]
    )
    known = {one.name: record[one.name] for one in fields(Scored) if one.name != "predictions"}
    return Scored(**known, predictions=predictions)


def _truths(episode: "Episode", name: str, amodal: bool = False) -> "list[MaskInstance]":
    """Ground truth of the categories that the detector has a name for, as ``labeling.evaluate`` takes it."""
    from labeling.metrics.matching import instances_of

    known = episode.metadata.get("detector_categories")
    shared = [one for one in episode.ground_truth or () if known is None or one.category in known]
    return instances_of(name, shared, "amodal" if amodal else "modal")


def _figures(predictions: "Sequence[MaskInstance]", truths: "Sequence[MaskInstance]") -> dict[str, float | None]:
    from labeling.metrics.mask_ap import average_precision
    from labeling.metrics.matching import match, mean_iou

    ap = average_precision(predictions, truths, (0.5, 0.3)).mean
    iou = mean_iou(truths, match(predictions, truths))
    return {
        "mask_ap50": ap[0.5],
        "mask_ap30": ap[0.3],
        "mean_iou": iou.mean_iou,
        "mean_iou_matched": iou.mean_iou_matched,
    }


@contextmanager
def _cpu_seconds() -> Iterator[list[float]]:
    started, spent = time.process_time(), [0.0]
    try:
        yield spent
    finally:
        spent[0] = time.process_time() - started
