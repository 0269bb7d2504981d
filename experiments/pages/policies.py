"""The page about what policies earn, from the figures that are there."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from labeling.core.errors import SbmError

PAGE, PICTURES = "policies-results.md", "pictures"


EVALUATION, ABLATION = "policy_evaluation.json", "reward_ablation.json"


TEACHING = "policies.json"


TRAINING, WAYS = "policy_training_*.json", "policy_pictures_*.json"


LEARNING_PICTURE, LABELS_PICTURE = "policies_learning.png", "policies_labels.png"


ABLATION_PICTURE = "policies_rewards.png"


def write_page(results: Path, docs: Path) -> list[Path]:
    """Writes the page and the pictures that are drawn from figures.

    Args:
        results: folder with some of ``policy_evaluation.json``, ``policies.json``, ``reward_ablation.json``,
            ``policy_training_*.json`` and ``policy_pictures_*.json``.
        docs: folder for the page.

    Returns:
        The files written.

    Raises:
        SbmError: if there are no figures at all.
    """
    from experiments.figures import policies_drawing
    from labeling.io.formats.atomic import atomic_file

    figures = read_figures(results)
    text = page(figures)
    pictures: list[tuple[str, Callable[[Path], None]]] = []
    if figures.training:
        pictures.append((LEARNING_PICTURE, lambda path: policies_drawing.draw_learning(figures.training, path)))
    if figures.evaluation is not None:
        worlds = figures.evaluation["worlds"]
        pictures.append((LABELS_PICTURE, lambda path: policies_drawing.draw_labels(worlds, path)))
    if figures.ablation is not None:
        ablation = figures.ablation
        pictures.append((ABLATION_PICTURE, lambda path: policies_drawing.draw_ablation(ablation, path)))
    written = [docs / PAGE]
    for name, draw in pictures:
        written.append(docs / PICTURES / name)
        with atomic_file(written[-1]) as temporary:
            draw(temporary)
    with atomic_file(docs / PAGE) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return written


@dataclass(frozen=True)
class Figures:
    """Contents of the files of figures; None or empty where there is none."""

    evaluation: dict[str, Any] | None
    teaching: dict[str, Any] | None
    ablation: dict[str, Any] | None
    training: dict[str, dict[str, Any]]
    """By env without namespace."""
    ways: dict[str, dict[str, Any]]
    """By env without namespace."""


def read_figures(results: Path) -> Figures:
    """What is there.

    Raises:
        SbmError: if it is nothing, or a file is damaged.
    """
    from labeling.io.formats.checked_json import read_json

    def one(name: str) -> dict[str, Any] | None:
        return dict(read_json(results / name).mapping()) if (results / name).is_file() else None

    def several(pattern: str) -> dict[str, dict[str, Any]]:
        first = len(pattern.partition("*")[0])
        return {path.stem[first:]: dict(read_json(path).mapping()) for path in sorted(results.glob(pattern))}

    found = Figures(one(EVALUATION), one(TEACHING), one(ABLATION), several(TRAINING), several(WAYS))
    if found == Figures(None, None, None, {}, {}):
        raise SbmError(
            f"{results}: no {EVALUATION}, {TEACHING}, {ABLATION} or {TRAINING}; python -m experiments.run "
            "policy_evaluation makes the first"
        )
    return found


def page(figures: Figures) -> str:
    """The text of the page."""
    from experiments.pages import policies_sections as sections

    parts = [
        "# What policies earn",
        "Written by `python -m experiments.policies_page` from `experiments/results/`; do not edit by hand. What the "
        "policies do, how to train and to compare them: [policies](policies.md).",
        "## Against each other",
    ]
    if figures.evaluation is None:
        parts.append(_missing("No comparison", "python -m experiments.run policy_evaluation"))
    else:
        parts += sections.evaluation(figures.evaluation, f"{PICTURES}/{LABELS_PICTURE}")
    parts.append("## What detectors learn from their labels")
    if figures.teaching is None:
        parts.append(_missing("No detector", "python -m experiments.run policies", "has been taught"))
    else:
        parts += sections.teaching(figures.teaching)
    parts.append("## How they look around")
    if figures.ways:
        parts += sections.ways(figures.ways, PICTURES)
    else:
        parts.append(_missing("No episode", "python -m experiments.policy_pictures", "has been drawn"))
    parts.append("## Learning")
    if figures.training:
        parts += sections.training(figures.training, f"{PICTURES}/{LEARNING_PICTURE}")
    else:
        parts.append(_missing("No trained policy", "python -m experiments.ship_policy RUN", "has been shipped"))
    parts.append("## What each half of the reward is worth")
    if figures.ablation is None:
        parts.append(_missing("No ablation of the reward", "python -m experiments.run reward_ablation"))
    else:
        parts += sections.ablation(figures.ablation, f"{PICTURES}/{ABLATION_PICTURE}")
    return "\n\n".join(parts) + "\n"


def _missing(what: str, command: str, happened: str = "has been made") -> str:
    return f"{what} {happened} yet; `{command}` does it."
