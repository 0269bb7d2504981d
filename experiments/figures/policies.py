"""The pictures of the page about policies."""

import contextlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.patches import Patch

from experiments.figures.style import BLUE, GREEN, GREY, GRID, INK, save, seed_dots, tidy

if TYPE_CHECKING:
    from agents.planning.unmapped import Unmapped
    from sbm_gym.worlds.geometry.navigable import NavigableMap

COLOURS = {
    "ring": BLUE,
    "ppo": "#c2410c",
    "ppo_evidence": "#7c2d12",
    "next_best_view": GREEN,
    "random": GREY,
    "spin": "#9467bd",
    "frontier": "#17becf",
}
SEEN_FLOOR, HOPED_FOR, IN_THE_WAY = "#8fce9f", "#f3c66b", "#c2410c"
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


def draw_without_a_map(path: Path) -> None:
    """Draws what ``ppo_unmapped`` goes by in the course of an episode in a home, over what is there.

    Args:
        path: PNG to write.

    Raises:
        SbmError: if the furniture of homes is not installed.
    """
    from agents.planning.unmapped import Unmapped
    from agents.policies.registry import make_policy
    from agents.rollouts.environments import inner_env
    from agents.rollouts.rollout import rollout
    from sbm_gym.named_env import make_env

    env_id, views = "sbm_gym/Indoor-v0", (1, 4, 12, 25)
    figure, panels = plt.subplots(1, len(views), figsize=(2.6 * len(views), 3.4), dpi=100)
    with contextlib.closing(make_env(env_id, "val", "simulated:compact")) as env:
        observation, info = env.reset(seed=0)
        robot, way_m = Unmapped(inner_env(env).knowledge, info), [info["agent"]["position_m"]]
        steps = rollout(env, make_policy("ppo_unmapped", env_id), observation, info, np.random.default_rng(0))
        for view, step in enumerate(steps, 2):
            if view - 1 in views:
                _draw_known(panels[views.index(view - 1)], inner_env(env).knowledge.navigable, robot, np.array(way_m))
            robot.note_action(step.action, info)
            info = step.info
            robot.update(info)
            way_m.append(info["agent"]["position_m"])

    for axes, view in zip(panels, views, strict=True):
        axes.set_title(f"after {view} view{'s' if view > 1 else ''}", fontsize=9)
    colours = {"seen floor": SEEN_FLOOR, "hoped for": HOPED_FOR, "in the way, as far as it knows": IN_THE_WAY}
    handles = [Patch(facecolor=colour, label=name) for name, colour in {**colours, "furniture and walls": GRID}.items()]
    figure.legend(handles=handles, loc="lower center", ncols=len(handles), frameon=False, fontsize=8.5)
    figure.tight_layout(rect=(0, 0.08, 1, 0.98))
    save(figure, path)


def _draw_known(axes: Axes, navigable: "NavigableMap", robot: "Unmapped", way_m: Float[np.ndarray, "n 2"]) -> None:
    """What a robot without a map goes by, over a map of what is there.

    Args:
        axes: to draw in.
        navigable: what is there.
        robot: what it knows.
        way_m: where it has stood.
    """
    floor, known = robot.seen_floor, robot.navigable
    layers = (
        (np.equal(navigable.free, False), navigable.origin_m, navigable.cell_m, GRID),
        (floor.is_floor & ~floor.unseen(), floor.origin_m, floor.cell_m, SEEN_FLOOR),
        (floor.unseen(), floor.origin_m, floor.cell_m, HOPED_FOR),
        (np.equal(known.free, False), known.origin_m, known.cell_m, IN_THE_WAY),
    )
    for cells, (left, low), cell_m, colour in layers:
        picture = np.zeros((*cells.shape, 4))
        picture[cells] = to_rgba(colour, 0.75)
        extent = left, left + cells.shape[1] * cell_m, low, low + cells.shape[0] * cell_m
        axes.imshow(picture, origin="lower", extent=extent, interpolation="nearest")
    axes.plot(*way_m.T, ".-", color=INK, lw=0.8, ms=3)
    axes.plot(*way_m[-1], "o", color=INK, ms=5)
    axes.set(xticks=[], yticks=[])
    axes.spines[:].set_visible(False)


def _small(axes: Axes) -> None:
    tidy(axes)
    axes.tick_params(labelsize=8)
