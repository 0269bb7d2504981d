"""Stages that train 2-D detectors: make labels, fine-tune, score. Each outcome is kept in the cache."""

import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from experiments.cache.stages import RunContext, cached, digest
from labeling.detectors.data.annotated_pictures import AnnotatedPicture
from labeling.detectors.data.augment_config import AugmentConfig
from labeling.detectors.finetuning.config import FinetuneConfig
from labeling.generator.settings.label_config import LabelConfig
from labeling.generator.settings.source_config import SourceConfig
from labeling.runtime.code_digest import code_digest


def make_labels(
    episodes: Sequence[Path],
    seed: int,
    context: RunContext,
    settings: LabelConfig | None = None,
    sources: SourceConfig | None = None,
    share_scenes: bool = False,
) -> Path:
    """Labels episodes.

    Args:
        episodes: all folders of one dataset.
        seed: of the label generator.
        context: where to keep the label set.
        settings: of label generation; None takes the defaults. Their seed is replaced.
        sources: where the masks come from that labels are made of; by default the detections of the episodes.
        share_scenes: label what one episode has found in the others of its scene, too.

    Returns:
        The folder of the label set.
    """
    from labeling.generate import GenerateConfig, run
    from labeling.generator.sources import source_fingerprint

    config = replace(settings or LabelConfig(), seed=seed)
    sources = sources or SourceConfig()
    dataset = episodes[0].parent
    inputs = [dataset.name, len(episodes), asdict(config), source_fingerprint(sources), share_scenes]
    out = context.cache / "labels" / digest(*inputs, code_digest(run))
    run(
        GenerateConfig(
            dataset=dataset,
            out=out,
            workers=1 if context.where.is_local else context.workers,  # here, threads share an episode
            where=context.where,
            label=config,
            sources=sources,
            share_scenes=share_scenes,
        )
    )
    return out


def score_labels(labels: Path) -> dict[str, Any]:
    """AP of a label set beside that of the detector whose confident detections it was made from, on the same views."""
    from labeling.evaluation.compare import evaluate_label_set

    metrics = evaluate_label_set(labels).metrics
    kept = ("mask_ap50", "mask_ap30")
    return {who: {name: metrics[who][name] for name in kept} for who in ("detector", "pseudo_labels")}


@dataclass(frozen=True)
class TrainJob:
    """A fine-tuning, of which the last network is kept."""

    detector: str
    """Whose network it starts from."""
    learn: Sequence[AnnotatedPicture]
    replay: Sequence[AnnotatedPicture]
    """Source photographs to mix in."""
    train: FinetuneConfig
    """Its seed is replaced."""
    augment: AugmentConfig
    seed: int
    """Of training."""
    title: str
    """What is learnt from, for the records."""
    new_categories: tuple[str, ...] = ()
    """To learn beside those that the network knows."""


def train_detectors(jobs: Sequence[TrainJob], context: RunContext) -> list[str]:
    """Fine-tunes detectors as ``labeling.finetune`` does, in parallel.

    Args:
        jobs: one for each detector.
        context: where to keep the runs.

    Returns:
        Names of the detectors, in order: the folders of their runs.
    """
    from labeling.detectors.registry import load_named_network

    weights = {name: load_named_network(name)[1] for name in {job.detector for job in jobs}}
    code, keyed = code_digest(_train), []
    for job in jobs:
        inputs = [weights[job.detector], _content(job.learn), _content(job.replay)]
        inputs += [asdict(replace(job.train, seed=job.seed)), asdict(job.augment)]
        key = digest(*inputs, list(job.new_categories), code)
        keyed.append((key, (job, context.cache / "detectors" / key)))

    def reads(task: tuple[TrainJob, Path]) -> list[Path]:
        job, out = task  # in which an earlier run may have left a checkpoint to go on from
        pictures = [one.file for part in (job.learn, job.replay) for one in part]
        return [*context.where.files_named(job.detector), *pictures, out]

    cached("detectors", _train, keyed, context, "training detectors", reads=reads, gpus=True)
    return [str(out) for _, (_, out) in keyed]


def _train(task: tuple[TrainJob, Path]) -> dict[str, Any]:
    import torch

    from labeling.detectors.finetuning.training import FinetuneTask
    from labeling.detectors.networks.mask_rcnn import with_categories
    from labeling.detectors.registry import choose_device, load_named_network
    from labeling.training.loop import train

    job, out = task
    network, weights = load_named_network(job.detector)
    if job.new_categories:
        torch.manual_seed(job.seed)
        network = with_categories(network, (*network.spec.categories, *job.new_categories))
    title = f"{job.title}, seed {job.seed}"
    finetuning = FinetuneTask(
        network,
        job.learn,
        [],
        replace(job.train, seed=job.seed),
        job.augment,
        job.replay,
        choose_device(),
        {"started_from": job.detector, "started_from_digest": weights, "labels": job.title},
        job.new_categories,
    )
    train(finetuning, out, lambda line: print(f"{title}: {line}", file=sys.stderr, flush=True))
    return {"title": title, "folder": str(out)}


def score_detectors(
    detectors: Sequence[str], sets: Mapping[str, Sequence[AnnotatedPicture]], context: RunContext
) -> list[dict[str, Any]]:
    """AP of detectors on sets of annotated pictures, by the sets' names.

    Args:
        detectors: names, or folders of runs.
        sets: pictures.
        context: where figures are kept.

    Returns:
        Figures for each detector, in order.
    """
    from labeling.detectors.registry import load_detector

    code, contents = code_digest(_score), {name: _content(pictures) for name, pictures in sets.items()}
    digests = {detector: load_detector(detector).digest for detector in detectors}
    jobs = [
        (digest(digests[detector], content, code), (detector, sets[name]))
        for detector in detectors
        for name, content in contents.items()
    ]

    def reads(task: tuple[str, Sequence[AnnotatedPicture]]) -> list[Path]:
        return [*context.where.files_named(task[0]), *(one.file for one in task[1])]

    scores = iter(cached("detector_scores", _score, jobs, context, "scoring detectors", reads=reads, gpus=True))
    return [{name: next(scores) for name in sets} for _ in detectors]


def _score(task: tuple[str, Sequence[AnnotatedPicture]]) -> dict[str, Any]:
    from labeling.detectors.registry import load_detector
    from labeling.detectors.scoring import evaluate

    detector, pictures = task
    return asdict(evaluate(load_detector(detector), pictures, resample=True))


def _content(pictures: Sequence[AnnotatedPicture]) -> str:
    """Changes with the names of pictures (folders of recorded episodes and of photographs have names that change with
    what they hold) and with their annotations.
    """
    return digest([["/".join(one.file.parts[-4:]), [asdict(a) for a in one.annotations]] for one in pictures])
