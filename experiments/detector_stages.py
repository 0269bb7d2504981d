"""Stages of experiments that teach detectors: label episodes, fine-tune, score. Each is kept and not done twice."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from experiments.stages import Workplace, code_digest, digest
from labeling.detectors.pictures import AnnotatedPicture
from labeling.detectors.train_config import AugmentConfig, TrainConfig
from labeling.label_config import LabelConfig
from labeling.source_config import SourceConfig

LABEL_CODE = ("labeling.generate",)
TRAIN_CODE = ("labeling.detectors.training_run", "labeling.detectors.network", "labeling.detectors.pictures")
SCORE_CODE = ("labeling.detectors.training", "labeling.detectors.network_detector", "labeling.detectors.pictures")


def label(
    episodes: Sequence[Path],
    seed: int,
    workplace: Workplace,
    settings: LabelConfig | None = None,
    sources: SourceConfig | None = None,
) -> Path:
    """Labels episodes.

    Args:
        episodes: all folders of one dataset.
        seed: of the label generator.
        workplace: where to keep the label set.
        settings: of label generation; None takes the defaults. Their seed is replaced.
        sources: where the masks come from that labels are made of; by default the detections of the episodes.

    Returns:
        The folder of the label set.
    """
    from labeling import generate
    from labeling.label_sources import identity

    config = replace(settings or LabelConfig(), seed=seed)
    sources = sources or SourceConfig()
    dataset = episodes[0].parent
    inputs = [dataset.name, len(episodes), asdict(config), identity(sources)]
    out = workplace.cache / "labels" / digest(*inputs, code_digest(*LABEL_CODE))
    generate.run(generate.GenerateConfig(dataset=dataset, out=out, label=config, sources=sources))
    return out


def label_scores(labels: Path) -> dict[str, Any]:
    """AP of a label set beside that of the detector whose confident detections it was made from, on the same views."""
    from labeling.evaluation import evaluate_label_set

    metrics = evaluate_label_set(labels).metrics
    kept = ("mask_ap50", "mask_ap30")
    return {who: {name: metrics[who][name] for name in kept} for who in ("detector", "pseudo_labels")}


def taught(
    detector: str,
    learn: Sequence[AnnotatedPicture],
    choose: Sequence[AnnotatedPicture],
    replay: Sequence[AnnotatedPicture],
    train_config: TrainConfig,
    augmentation: AugmentConfig,
    seed: int,
    workplace: Workplace,
    title: str,
    new_categories: Sequence[str] = (),
) -> Path:
    """Fine-tunes a detector, as ``labeling.finetune`` does.

    Args:
        detector: where to start.
        learn: annotated pictures.
        choose: likewise; the network that does best on them is kept.
        replay: source pictures to mix in.
        train_config: settings; their seed is replaced.
        augmentation: settings.
        seed: of training.
        workplace: where to keep the run.
        title: what is learnt from, for the records.
        new_categories: that it is to learn beside those it knows.

    Returns:
        The folder of the run, which is a detector by that name.
    """
    import torch

    from labeling.detectors.network import with_categories
    from labeling.detectors.registry import choose_device, load_named_network
    from labeling.detectors.training_run import train

    config = replace(train_config, seed=seed)
    network, weights = load_named_network(detector)
    if new_categories:
        torch.manual_seed(seed)
        network = with_categories(network, (*network.spec.categories, *new_categories))
    inputs = [weights, _content(learn), _content(choose), len(replay), asdict(config), asdict(augmentation)]
    out = workplace.cache / "detectors" / digest(*inputs, list(new_categories), code_digest(*TRAIN_CODE))
    print(f"training on {title}, seed {seed}: {out}", flush=True)
    about = {"started_from": detector, "started_from_digest": weights, "labels": title}
    train(network, out, learn, choose, config, augmentation, replay, choose_device(), about)
    return out


def detector_scores(
    detector: str, sets: Mapping[str, Sequence[AnnotatedPicture]], workplace: Workplace
) -> dict[str, Any]:
    """AP of a detector on sets of annotated pictures, by the set's name.

    Args:
        detector: its name, or the folder of a run.
        sets: pictures.
        workplace: where figures are kept.
    """
    from labeling.detectors.registry import load_detector
    from labeling.detectors.training import evaluate

    loaded = load_detector(detector)
    found: dict[str, Any] = {}
    for name, pictures in sets.items():
        key = digest(loaded.digest, _content(pictures), code_digest(*SCORE_CODE))
        if not workplace.store.has("detector_scores", key):
            scores = asdict(evaluate(loaded, pictures))
            workplace.store.write("detector_scores", key, scores)
        found[name] = workplace.store.read("detector_scores", key)
    return found


def _content(pictures: Sequence[AnnotatedPicture]) -> str:
    """Changes with the names of pictures (folders of recorded episodes have names that change with what they hold)
    and with their annotations.
    """
    return digest([["/".join(one.file.parts[-4:]), [asdict(a) for a in one.annotations]] for one in pictures])
