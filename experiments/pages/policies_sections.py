"""The sections of the page about policies: figures as text and tables, nothing that is not computed from them."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from experiments.pages.label_report import SCALES
from labeling.metrics.bootstrap import beyond_chance

SPLITS = {"train": "training", "val": "validation", "test": "test"}
POINTS = 100
"""AP is told in points of a hundred."""
EARNED = {
    "return": ("return", 1),
    "discovery": ("discovery", 1),
    "diversity": ("diversity", 1),
    "objects": ("objects", 1),
    "sectors": ("sectors seen", 1),
    "collisions": ("collisions", 1),
    "path_m": ("path (m)", 1),
}
"""Heading and factor by figure."""
LABELLED = {
    "pooled_ap50": ("AP50 pooled", POINTS),
    "ap50": ("AP50 an episode", POINTS),
    "right": ("right labels", 1),
    "objects": ("objects labelled right", 1),
}
EARLY = {"right": ("right labels", 1), "objects": ("objects labelled right", 1), "ap50": ("AP50 an episode", POINTS)}


# Comparison ----------------------------------------------------------------------------------------------------------


def evaluation(content: Mapping[str, Any], picture: str) -> list[str]:
    """What policies earn and what labels they bring home, world by world.

    Args:
        content: of ``policy_evaluation.json``.
        picture: its path, from the page.
    """
    base = content["compared_with"]
    some = next(iter(content["worlds"].values()))["settings"]
    seeds = len(some["seeds"])
    parts = [
        f"{SPLITS[some['split']].capitalize()} scenes, `{some['detector']}` in the loop, {some['episodes']} "
        f"{_plural('episode', some['episodes'])} x {seeds} {_plural('seed', seeds)} of starts in each world, the same "
        f"starts for all. Scale `{content['scale']}` "
        f"({SCALES[content['scale']]}). Mean{_spread_words(seeds, 'seeds')}. **Bold**: the paired 95 % interval of the "
        f"difference to `{base}`, over episodes, excludes 0. Pooled AP ranks all episodes of a seed as one data set "
        "and has no such interval.",
        f"![AP50 of the labels and right labels against views spent]({picture})",
    ]
    for name, world in content["worlds"].items():
        parts += [f"### {name.capitalize()}", *_world(world, base)]
    return parts


def _world(world: Mapping[str, Any], base: str) -> list[str]:
    policies = world["policies"]
    labelled = {policy: found for policy, found in policies.items() if found["labels"] is not None}
    last, count = max(labelled[base]["labels"], key=int), world["labelled"]["episodes"]
    parts = [
        _about_world(world),
        figures_table(EARNED, {policy: found["figures"] for policy, found in policies.items()}),
        f"Labels that the generator makes of all {last} views, in the first {count} {_plural('episode', count)} of "
        "each seed:",
        figures_table(LABELLED, {policy: found["labels"][last] for policy, found in labelled.items()}),
    ]
    early = labelled[base]["early"]
    if early is not None:
        parts += [
            f"Labels of the first {early['views']} views minus those of all {early['base_views']} of `{base}`, with "
            "95 % intervals:",
            _early_table(labelled),
        ]
    return parts


def _about_world(world: Mapping[str, Any]) -> str:
    scenes = world["settings"]["scenes"]
    sentences = [f"`{world['settings']['env']}`, {len(scenes)} {_plural('scene', len(scenes))}."]
    for policy, origin in world["trained"].items():
        sentences.append(
            f"`{policy}` was trained for {origin['steps']} steps, seed {origin['seed']}: `{origin['command']}`."
        )
    sentences += [f"`{policy}` is left out: {why}." for policy, why in world["left_out"].items()]
    return " ".join(sentences)


def figures_table(headings: Mapping[str, tuple[str, float]], rows: Mapping[str, Mapping[str, Any]]) -> str:
    """A table of figures with spread, one row for each policy; bold where the difference is beyond chance.

    Args:
        headings: by figure, its heading and what it is multiplied with.
        rows: by policy its figures, as ``agents.evaluation`` sums them up.
    """
    lines = [
        "| | " + " | ".join(heading for heading, _ in headings.values()) + " |",
        "|---" * (len(headings) + 1) + "|",
    ]
    for policy, figures in rows.items():
        cells = [cell(figures.get(name), factor) for name, (_, factor) in headings.items()]
        lines.append(f"| `{policy}` | {' | '.join(cells)} |")
    return "\n".join(lines)


def cell(figure: Mapping[str, Any] | None, factor: float = 1) -> str:
    """Mean and spread of a figure; bold where the interval of its difference excludes 0.

    Args:
        figure: as ``agents.evaluation`` sums it up.
        factor: to multiply it with.
    """
    if figure is None or figure["mean"] is None:
        return "-"
    digits = 1 if factor == POINTS else 2
    mean, std = f"{factor * figure['mean']:.{digits}f}", figure["std"]
    difference = figure.get("difference")
    if difference is not None and beyond_chance(difference):
        mean = f"**{mean}**"
    return mean if std is None else f"{mean} ± {factor * std:.{digits}f}"


def _early_table(policies: Mapping[str, Any]) -> str:
    lines = ["| | " + " | ".join(heading for heading, _ in EARLY.values()) + " |", "|---" * (len(EARLY) + 1) + "|"]
    for policy, found in policies.items():
        differences = found["early"]["difference"]
        cells = [interval(differences[name], factor) for name, (_, factor) in EARLY.items()]
        lines.append(f"| `{policy}` | {' | '.join(cells)} |")
    return "\n".join(lines)


def interval(difference: Mapping[str, Any] | None, factor: float = 1) -> str:
    """A difference with its interval; bold where this excludes 0."""
    if difference is None:
        return "-"
    digits = 1 if factor == POINTS else 2
    mean, low, high = (
        None if difference[name] is None else f"{factor * difference[name]:+.{digits}f}"
        for name in ("mean", "low", "high")
    )
    if low is None:
        return f"{mean}"
    return f"{f'**{mean}**' if beyond_chance(dict(difference)) else mean} [{low}, {high}]"


# What detectors learn ------------------------------------------------------------------------------------------------


def teaching(content: Mapping[str, Any]) -> list[str]:
    """What a detector learns from the labels of each policy.

    Args:
        content: of ``policies.json``.
    """
    seeds = len(content["seeds"])
    parts = [
        f"`{content['detector']}` fine-tuned on the labels of as many episodes of each policy in training scenes, and "
        "tried on validation scenes and on photographs held out. Scale "
        f"`{content['scale']}` ({SCALES[content['scale']]}). Mean{_spread_words(seeds, 'seeds')} of label generation "
        "and training. **Bold**: better, or worse, than after the labels of "
        f"`{content['compared_with']}` with every seed, of three or more. Labels are of each policy's own views, so "
        "their AP also tells how hard these are."
    ]
    for name, world in content["worlds"].items():
        learn = {policy: world["pools"][f"{policy}_learn"] for policy in _taught_by(world)}
        first = next(iter(learn.values()))
        about = f"{first['episodes']} {_plural('episode', first['episodes'])} of each policy to learn from."
        left_out = " ".join(f"`{policy}` is left out: {why}." for policy, why in world["left_out"].items())
        parts += [f"### {name.capitalize()}: detectors", f"{about} {left_out}".strip(), _teaching_table(content, world)]
    return parts


def _taught_by(world: Mapping[str, Any]) -> list[str]:
    return list(dict.fromkeys(one["policy"] for one in world["runs"]))


def _teaching_table(content: Mapping[str, Any], world: Mapping[str, Any]) -> str:
    """Rows: the detector before, and after the labels of each policy."""
    headings = ("labels AP50", "AP50", "AP30", "AP50 on photographs")
    before = world["before"]
    cells = [before["validation"]["mask_ap50"], before["validation"]["mask_ap30"], before["photographs"]["mask_ap50"]]
    lines = [
        f"| | {' | '.join(headings)} |",
        "|---" * (len(headings) + 1) + "|",
        f"| before | - | {' | '.join(f'{POINTS * one:.1f}' for one in cells)} |",
    ]
    columns = {policy: _teaching_figures(world, policy) for policy in _taught_by(world)}
    base = columns[content["compared_with"]]
    for policy, found in columns.items():
        row = [_over_seeds(ours, theirs) for ours, theirs in zip(found, base, strict=True)]
        lines.append(f"| after labels of `{policy}` | {' | '.join(row)} |")
    return "\n".join(lines)


def _teaching_figures(world: Mapping[str, Any], policy: str) -> list[list[float]]:
    """One list over seeds for each column, in points."""
    labels = [one["pseudo_labels"]["mask_ap50"] for one in world["labels"] if one["policy"] == policy]
    runs = [one for one in world["runs"] if one["policy"] == policy]
    parts = (("validation", "mask_ap50"), ("validation", "mask_ap30"), ("photographs", "mask_ap50"))
    columns = [labels, *([run[part][figure] for run in runs] for part, figure in parts)]
    return [[POINTS * value for value in column] for column in columns]


def _over_seeds(ours: Sequence[float], base: Sequence[float]) -> str:
    mean = f"{np.mean(ours):.1f}"
    if len(ours) >= 3 and abs(sum(np.sign(np.subtract(ours, base)))) == len(ours):
        mean = f"**{mean}**"
    return mean if len(ours) == 1 else f"{mean} ± {np.std(ours, ddof=1):.1f}"


# Pictures of episodes ------------------------------------------------------------------------------------------------


def ways(contents: Mapping[str, Mapping[str, Any]], folder: str) -> list[str]:
    """Episodes seen from above, and one as a film.

    Args:
        contents: of ``policy_pictures_*.json``, by env.
        folder: of the pictures, from the page.
    """
    parts = [
        "From above: where the robot can stand is white; objects are outlined; the way goes from dark to bright, with "
        "the direction of each look; around every object that was found, the sectors it was seen from are green."
    ]
    for env, content in contents.items():
        parts.append(f"### {env}")
        for episode in content["episodes"]:
            earned = ", ".join(
                f"`{policy}` {figures['return']:.1f} ({figures['objects']:.0f} {_plural('object', figures['objects'])} "
                f"from {figures['sectors']:.0f} sides)"
                for policy, figures in episode["figures"].items()
            )
            about = f"{episode['scene']}, seed {episode['seed']}, episode {episode['episode']}"
            parts += [f"![Ways of the policies in {about}]({folder}/{episode['picture']})", f"{about}: {earned}."]
        film = content["film"]
        parts += [
            f"![{film['policy']} in {film['scene']}, from above, and what its camera sees]({folder}/{film['file']})",
            f"`{film['policy']}` in {film['scene']}, seed {film['seed']}, episode {film['episode']}: "
            f"{film['frames']} pictures, from above and what its camera sees.",
        ]
    return parts


# Training ------------------------------------------------------------------------------------------------------------


def training(contents: Mapping[str, Mapping[str, Any]], picture: str) -> list[str]:
    """How the shipped policies were trained.

    Args:
        contents: of ``policy_training_*.json``, by env.
        picture: its path, from the page.
    """
    parts = [
        "Return on validation scenes during training, and of the rollouts on training scenes; dashed: hand-written "
        "policies on the same validation episodes, with the same detector.",
        f"![Return against steps]({picture})",
        "| | steps | validation return before | best, at step | shipped, at step | "
        + " | ".join(f"`{name}`" for name in _references(contents))
        + " | episodes | detector |",
        "|---" * (7 + len(_references(contents))) + "|",
    ]
    rows = [_training_row(env, content, _references(contents)) for env, content in contents.items()]
    table = "\n".join([*parts[2:], *rows])
    commands = "\n".join(f"- {env}: `{content['command']}`" for env, content in contents.items())
    return [*parts[:2], table, commands]


def _references(contents: Mapping[str, Mapping[str, Any]]) -> list[str]:
    return list(dict.fromkeys(name for content in contents.values() for name in content["references"]))


def _training_row(env: str, content: Mapping[str, Any], references: Sequence[str]) -> str:
    first, best, settings = content["validations"][0], content["best"], content["settings"]
    known = [content["references"].get(name) for name in references]
    cells = [
        f"{content['rollouts'][-1]['at']:.0f}",
        f"{first['return']:.2f}" if first["at"] == 0 else "-",
        f"{best['return']:.2f}, {best['at']:.0f}",
        f"{content['checkpoint']['steps']}",
        *("-" if figures is None else f"{figures['return']:.2f}" for figures in known),
        str(settings["eval_episodes"]),
        f"`{settings['detector']}`",
    ]
    return f"| {env} | {' | '.join(cells)} |"


# Ablation ------------------------------------------------------------------------------------------------------------


def ablation(content: Mapping[str, Any], picture: str) -> list[str]:
    """What a planner earns that values parts of the reward.

    Args:
        content: of ``reward_ablation.json``.
        picture: its path, from the page.
    """
    base = content["compared_with"]
    some = next(iter(content["worlds"].values()))["settings"]
    seeds = len(some["seeds"])
    parts = [
        f"The greedy planner, told what to value: both halves of the reward (`{base}`), the discovery of objects only, "
        "the diversity of views of known objects only, or neither, which leaves it walking to unseen floor. Measured "
        f"is the full reward. {SPLITS[some['split']].capitalize()} scenes, `{some['detector']}` detector, "
        f"{some['episodes']} {_plural('episode', some['episodes'])} x {seeds} {_plural('seed', seeds)} of starts in "
        f"each world, the same starts for all. Scale `{content['scale']}` ({SCALES[content['scale']]}). Mean"
        f"{_spread_words(seeds, 'seeds')}. **Bold**: the paired 95 % interval of the difference to `{base}`, over "
        "episodes, excludes 0.",
        f"![Return, discovery and diversity by what the planner values]({picture})",
    ]
    for name, world in content["worlds"].items():
        rows = {policy: found["figures"] for policy, found in world["policies"].items()}
        parts += [f"### {name.capitalize()}: parts of the reward", figures_table(EARNED, rows)]
    return parts


def _spread_words(seeds: int, over: str) -> str:
    return f" ± standard deviation over {over}" if seeds > 1 else ""


def _plural(word: str, count: float) -> str:
    return word if round(count) == 1 else word + "s"
