"""The pictures of the page about policies."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

from experiments.figures.style import BLUE, GREEN, GREY, INK, save, seed_dots, tidy

COLOURS = {
    "ring": BLUE,
    "ppo": "#c2410c",
    "ppo_evidence": "#7c2d12",
    "next_best_view": GREEN,
    "random": GREY,
    "spin": "#9467bd",
    "frontier": "#17becf",
}
LABEL_PANELS = {"pooled_ap50": ("AP50 of the labels, per cent", 100), "right": ("correct labels an episode", 1)}
"""Title and factor by figure."""
LEARNING_COLUMNS = 2
ABLATION_PANELS = ("return", "discovery", "diversity")
ABLATION_COLOURS = {"both": "#c2410c", "discovery": "#e39a6f", "diversity": GREEN, "neither": GREY}


def draw_learning(groups: Mapping[str, Sequence[Mapping[str, Any]]], path: Path) -> None:
    """Draws validation return and that of rollouts against steps, a panel for each training; references are dashed.

    Args:
        groups: of each training its runs from several seeds, contents of ``policy_training_*.json``.
        path: PNG to write.
    """
    rows, columns = -(-len(groups) // LEARNING_COLUMNS), min(len(groups), LEARNING_COLUMNS)
    figure, panels = plt.subplots(rows, columns, figsize=(5.2 * columns, 3.0 * rows), dpi=100, squeeze=False)
    for axes in panels.flat[len(groups) :]:
        axes.set_visible(False)
    for axes, (name, runs) in zip(panels.flat, groups.items(), strict=False):
        for content in runs:
            rollouts, validations = content["rollouts"], content["validations"]
            axes.plot(*_curve(rollouts), color="#e8b394", lw=0.7, label="rollouts (training scenes, draws actions)")
            axes.plot(*_curve(validations), "o-", color=COLOURS["ppo"], lw=1.6, ms=4, zorder=3, label="validation")
            if content.get("shipped", True):
                axes.axvline(content["checkpoint"]["steps"], color=INK, ls=":", lw=1.1, label="shipped")
        for reference, figures in runs[0]["references"].items():
            colour, label = COLOURS.get(reference, INK), f"{reference} (validation)"
            axes.axhline(figures["return"], color=colour, ls="--", lw=1.3, label=label)
        axes.set_title(f"{name}, {len(runs)} seeds" if len(runs) > 1 else name, fontsize=10)
        axes.set_xlabel("steps", fontsize=9)
        axes.set_xlim(left=0)
        _small(axes)
    for axes in panels[:, 0]:
        axes.set_ylabel("return of an episode", fontsize=9)
    found = [axes.get_legend_handles_labels() for axes in panels.flat]
    handles = {label: handle for some, labels in found for handle, label in zip(some, labels, strict=True)}
    figure.legend(handles.values(), handles.keys(), frameon=False, fontsize=8, ncols=4, loc="upper center")
    figure.tight_layout(rect=(0.0, 0.0, 1.0, 1.0 - 0.3 / (3.0 * rows) - 0.05 / rows))
    save(figure, path)


def _curve(points: list[dict[str, float]]) -> tuple[list[float], list[float]]:
    return [point["at"] for point in points], [point["return"] for point in points]


def draw_labels_by_views(worlds: Mapping[str, Mapping[str, Any]], path: Path) -> None:
    """Draws how good labels are against views spent, a row for each world; bands are one standard deviation over seeds.

    Args:
        worlds: of ``policy_evaluation.json``.
        path: PNG to write.
    """
    columns = len(LABEL_PANELS)
    figure, panels = plt.subplots(
        len(worlds), columns, figsize=(4.6 * columns, 3.1 * len(worlds)), dpi=100, squeeze=False
    )
    for row, (world, content) in zip(panels, worlds.items(), strict=True):
        for axes, (name, (title, factor)) in zip(row, LABEL_PANELS.items(), strict=True):
            for policy, found in _trainings_together(content["policies"]).items():
                if found["labels"] is not None:
                    _band(axes, found["labels"], name, factor, policy)
            axes.set_title(f"{world}: {title}", fontsize=9.5)
            axes.set_xlabel("views spent", fontsize=9)
            axes.set_xlim(left=0)
            axes.set_ylim(bottom=0)
            _small(axes)
    # A world may lack a policy, so the legend has those of all.
    found = {
        name: handle for axes in panels.flat for handle, name in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    figure.tight_layout(rect=(0, 0.06 if len(worlds) > 1 else 0.1, 1, 1))
    figure.legend(list(found.values()), list(found), loc="lower center", ncols=len(found), frameon=False, fontsize=9)
    save(figure, path)


def _trainings_together(policies: Mapping[str, Any]) -> dict[str, Any]:
    """Without the single trainings of policies that have several."""
    several = {name.partition(" of ")[0] for name in policies if " of " in name}
    return {name: one for name, one in policies.items() if name.partition("_seed_")[0] not in several}


def _band(axes: Axes, labels: Mapping[str, Any], name: str, factor: float, policy: str) -> None:
    counts = sorted(labels, key=int)
    views = [int(count) for count in counts]
    cells = [labels[count][name] for count in counts]
    means = np.array([np.nan if cell["mean"] is None else factor * cell["mean"] for cell in cells])
    colour = COLOURS.get(policy.partition(" of ")[0], INK)
    axes.plot(views, means, "o-", color=colour, lw=1.6, ms=4, label=policy)
    if all(cell["std"] is not None for cell in cells):
        spread = factor * np.array([cell["std"] for cell in cells])
        axes.fill_between(views, means - spread, means + spread, color=colour, alpha=0.16, lw=0)


def draw_reward_ablation(content: Mapping[str, Any], path: Path) -> None:
    """Draws figures by what a planner values, a row for each world: bars for means, dots for seeds; others are dashed.

    Args:
        content: of ``reward_ablation.json``.
        path: PNG to write.
    """
    base, worlds = content["compared_with"], content["worlds"]
    columns = len(ABLATION_PANELS)
    figure, panels = plt.subplots(
        len(worlds), columns, figsize=(3.9 * columns, 2.7 * len(worlds)), dpi=100, squeeze=False
    )
    for row, (world, found) in zip(panels, worlds.items(), strict=True):
        for axes, name in zip(row, ABLATION_PANELS, strict=True):
            ticks = []
            for policy, figures in ((policy, one["figures"][name]) for policy, one in found["policies"].items()):
                kind, _, goal = policy.partition(":")
                if kind != base:
                    axes.axhline(figures["mean"], color=COLOURS.get(policy, INK), ls="--", lw=1.2, label=policy)
                    continue
                goal = goal or "both"
                axes.bar(len(ticks), figures["mean"], 0.72, color=ABLATION_COLOURS[goal])
                seed_dots(axes, len(ticks), figures["per_seed"])
                ticks.append(goal)
            axes.set_xticks(range(len(ticks)), ticks, fontsize=8)
            axes.set_title(f"{world}: {name}", fontsize=9.5)
            _small(axes)
    figure.tight_layout(rect=(0, 0.05, 1, 1))
    handles, names = panels[0][0].get_legend_handles_labels()
    figure.legend(handles, names, loc="lower center", ncols=max(1, len(names)), frameon=False, fontsize=8)
    save(figure, path)


def _small(axes: Axes) -> None:
    tidy(axes)
    axes.tick_params(labelsize=8)
