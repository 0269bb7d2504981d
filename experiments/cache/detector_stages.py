"""Stages of experiments that teach detectors: label episodes, fine-tune, score. Each is kept and not done twice."""

import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

from experiments.cache.stages import Workplace, digest, run_tasks
from labeling.detectors.data.annotated_pictures import AnnotatedPicture
from labeling.detectors.data.augment_config import AugmentConfig
from labeling.detectors.finetuning.train_config import TrainConfig
from labeling.generator.settings.label_config import LabelConfig
from labeling.generator.settings.source_config import SourceConfig
from labeling.runtime.code_digest import code_digest

LABEL_CODE = ("labeling.generate",)
TRAIN_CODE = (
    "labeling.detectors.finetuning.training_run",
    "labeling.detectors.networks.mask_rcnn",
    "labeling.detectors.data.annotated_pictures",
)
SCORE_CODE = (
    "labeling.detectors.finetuning.epochs",
    "labeling.detectors.networks.network_detector",
    "labeling.detectors.data.annotated_pictures",
)
Task = TypeVar("Task")


def label(
    episodes: Sequence[Path],
    seed: int,
    workplace: Workplace,
    settings: LabelConfig | None = None,
    sources: SourceConfig | None = None,
    share_scenes: bool = False,
    growing: bool = False,
) -> Path:
    """Labels episodes.

    Args:
        episodes: all folders of one dataset.
        seed: of the label generator.
        workplace: where to keep the label set.
        settings: of label generation; None takes the defaults. Their seed is replaced.
        sources: where the masks come from that labels are made of; by default the detections of the episodes.
        share_scenes: label what one episode has found in the others of its scene, too.
        growing: the dataset will have more episodes next time: its label set is brought up to date in place.

    Returns:
        The folder of the label set.
    """
    from labeling import generate
    from labeling.generator.sources import identity

    config = replace(settings or LabelConfig(), seed=seed)
    sources = sources or SourceConfig()
    dataset = episodes[0].parent
    inputs = [dataset.name, "growing" if growing else len(episodes), asdict(config), identity(sources), share_scenes]
    out = workplace.cache / "labels" / digest(*inputs, code_digest(*LABEL_CODE))
    generate.run(
        generate.GenerateConfig(dataset=dataset, out=out, label=config, sources=sources, share_scenes=share_scenes)
    )
    return out


def label_scores(labels: Path) -> dict[str, Any]:
    """AP of a label set beside that of the detector whose confident detections it was made from, on the same views."""
    from labeling.evaluation.compare import evaluate_label_set

    metrics = evaluate_label_set(labels).metrics
    kept = ("mask_ap50", "mask_ap30")
    return {who: {name: metrics[who][name] for name in kept} for who in ("detector", "pseudo_labels")}


@dataclass(frozen=True)
class Course:
    """What a detector is to learn, and how."""

    detector: str
    """Where to start."""
    learn: Sequence[AnnotatedPicture]
    choose: Sequence[AnnotatedPicture]
    """The network that does best on these is kept."""
    replay: Sequence[AnnotatedPicture]
    """Source pictures to mix in."""
    train: TrainConfig
    """Its seed is replaced."""
    augment: AugmentConfig
    seed: int
    """Of training."""
    title: str
    """What is learnt from, for the records."""
    new_categories: tuple[str, ...] = ()
    """To learn beside those it knows."""


def taught(courses: Sequence[Course], workplace: Workplace) -> list[str]:
    """Fine-tunes detectors, as ``labeling.finetune`` does, side by side.

    Args:
        courses: one for each detector.
        workplace: where to keep the runs.

    Returns:
        Names of the detectors, in order: the folders of their runs.
    """
    from labeling.detectors.registry import load_named_network

    weights = {name: load_named_network(name)[1] for name in {course.detector for course in courses}}
    code, outs = code_digest(*TRAIN_CODE), []
    missing: dict[str, tuple[Course, Workplace, str]] = {}
    for course in courses:
        inputs = [weights[course.detector], _content(course.learn), _content(course.choose), len(course.replay)]
        inputs += [asdict(replace(course.train, seed=course.seed)), asdict(course.augment)]
        key = digest(*inputs, list(course.new_categories), code)
        outs.append(str(workplace.cache / "detectors" / key))
        if not workplace.store.has("taught", key):
            missing[key] = (course, workplace, key)
    side_by_side(_teach, list(missing.values()), workplace, "training detectors")
    return outs


def _teach(task: tuple[Course, Workplace, str]) -> None:
    """Trains one detector."""
    import torch

    from labeling.detectors.finetuning.training_run import train
    from labeling.detectors.networks.mask_rcnn import with_categories
    from labeling.detectors.registry import choose_device, load_named_network

    course, workplace, key = task
    network, weights = load_named_network(course.detector)
    if course.new_categories:
        torch.manual_seed(course.seed)
        network = with_categories(network, (*network.spec.categories, *course.new_categories))
    about = {"started_from": course.detector, "started_from_digest": weights, "labels": course.title}
    title, out = f"{course.title}, seed {course.seed}", workplace.cache / "detectors" / key
    train(
        network,
        out,
        course.learn,
        course.choose,
        replace(course.train, seed=course.seed),
        course.augment,
        course.replay,
        choose_device(),
        about,
        lambda line: print(f"{title}: {line}", file=sys.stderr, flush=True),
        new_categories=course.new_categories,
    )
    workplace.store.write("taught", key, {"title": title, "folder": str(out)})


def detector_scores(
    detectors: Sequence[str], sets: Mapping[str, Sequence[AnnotatedPicture]], workplace: Workplace
) -> list[dict[str, Any]]:
    """AP of detectors on sets of annotated pictures, by the sets' names.

    Args:
        detectors: names, or folders of runs.
        sets: pictures.
        workplace: where figures are kept.

    Returns:
        Figures for each detector, in order.
    """
    from labeling.detectors.registry import load_detector

    code, contents = code_digest(*SCORE_CODE), {name: _content(pictures) for name, pictures in sets.items()}
    digests = {detector: load_detector(detector).digest for detector in detectors}
    keys = {
        (detector, name): digest(weights, content, code)
        for detector, weights in digests.items()
        for name, content in contents.items()
    }
    missing = {
        key: (detector, sets[name], workplace, key)
        for (detector, name), key in keys.items()
        if not workplace.store.has("detector_scores", key)
    }
    side_by_side(_score, list(missing.values()), workplace, "trying detectors")
    return [
        {name: workplace.store.read("detector_scores", keys[detector, name]) for name in sets} for detector in detectors
    ]


def _score(task: tuple[str, Sequence[AnnotatedPicture], Workplace, str]) -> None:
    """Tries one detector on one set."""
    from labeling.detectors.finetuning.epochs import evaluate
    from labeling.detectors.registry import load_detector

    detector, pictures, workplace, key = task
    workplace.store.write("detector_scores", key, asdict(evaluate(load_detector(detector), pictures)))


def side_by_side(work: Callable[[Task], object], tasks: Sequence[Task], workplace: Workplace, title: str) -> None:
    """Works through tasks in processes of one thread each, which takes two thirds of the time of one after the other
    in as many threads; but one after the other, here, with a GPU or a single worker.

    Args:
        work: a function of a module, which keeps its outcome itself.
        tasks: what to give it; picklable.
        workplace: says how many processes.
        title: of the progress bar.
    """
    from tqdm import tqdm

    from labeling.detectors.registry import choose_device

    if workplace.workers > 1 and choose_device() == "cpu":
        run_tasks(work, tasks, workplace.workers, title)
        return
    for task in tqdm(tasks, desc=title, unit="run", file=sys.stderr):
        work(task)


def _content(pictures: Sequence[AnnotatedPicture]) -> str:
    """Changes with the names of pictures (folders of recorded episodes have names that change with what they hold)
    and with their annotations.
    """
    return digest([["/".join(one.file.parts[-4:]), [asdict(a) for a in one.annotations]] for one in pictures])
