"""The page about the label generator's settings, of ``label_ablation`` and ``label_modes``."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import Any

from agents.evaluation.statistics import significant_sign
from experiments.figures.result_values import widened
from experiments.pages.markdown import Pictures, points, read_result, render, table
from labeling.core.errors import SbmError
from labeling.generator.settings.label_config import LabelConfig

PAGE, PICTURE = "label-generator.md", "label_ablation.png"
OF_LABELS = ("label_ablation.json", "label_modes.json")
"""Files of results whose figures depend on labels."""
POOLS = {"rooms_train": "rooms", "rooms_val": "rooms, val", "streets_train": "streets", "streets_val": "streets, val"}
CHOSEN_ON = "rooms_train"
DIFFERENCES = {"mean_iou": "mean IoU", "mask_ap50": "AP50"}
LEVELS = {"mask_ap50": "AP50", "mask_ap30": "AP30", "mean_iou": "mean IoU", "mean_iou_matched": "matched"}
"""Figures of whole pools, and what they are called."""


def compose(results: Path) -> tuple[str, Pictures]:
    """The page and its picture, from those of ``label_ablation`` and ``label_modes`` that are there."""
    from experiments.figures.label_generator import draw_label_ablation

    ablation, modes = (read_result(results / name) for name in ("label_ablation.json", "label_modes.json"))
    if ablation is None and modes is None:
        raise SbmError(f"{results}: no label_ablation.json and no label_modes.json; run these experiments first")
    pictures: Pictures = {}
    if ablation is not None:
        pictures[PICTURE] = partial(draw_label_ablation, ablation, CHOSEN_ON)
    return page(ablation, modes), pictures


def page(ablation: Mapping[str, Any] | None, modes: Mapping[str, Any] | None) -> str:
    """The text of the page, with a section for each content that is there."""
    return render("label-generator.md.jinja", ablation=ablation and _ablation(ablation), modes=modes and _modes(modes))


# Ablation ------------------------------------------------------------------------------------------------------------


def _ablation(content: Mapping[str, Any]) -> dict[str, Any]:
    results, default, current = content["results"], content["default"], asdict(LabelConfig())
    factors = []
    for factor in content["factors"]:
        known = {name: name in current for name in factor["settings"] if name in default}
        variants = factor["variants"]
        factors.append(
            {
                **factor,
                "defaults": [_default(name, default[name], current[name]) for name, kept in known.items() if kept],
                "deleted": [f"`{name}`" for name, kept in known.items() if not kept],
                "table": _differences(variants, content["pools"], results["default"]) if variants else "",
                "verdict": verdict(factor, _num_scenes(content["pools"], CHOSEN_ON)) if variants else "",
            }
        )
    levels = _levels({name: results[name] for name in ("detector", "default")}, content["pools"], tuple(DIFFERENCES))
    return {**content, "pools": _pools(content), "levels": levels, "factors": factors, "picture": PICTURE}


def _default(name: str, measured: Any, current: Any) -> str:
    """A default as it was when the ablation was run, and what has become of it since."""
    since = "" if measured == current else f" (now `{_setting(current)}`)"
    return f"`{name} = {_setting(measured)}`{since}"


def _num_scenes(pools: Mapping[str, Any], pool: str) -> int:
    return len(set(pools[pool]["scenes"]))


def verdict(factor: Mapping[str, Any], scenes: int, pool: str = CHOSEN_ON, figure: str = "mean_iou") -> str:
    """One sentence: whether a variant is significantly better than the default, on the scenes to choose on."""
    differences = {
        one["name"]: widened(one["results"][pool]["difference"][figure], scenes) for one in factor["variants"]
    }
    known = {name: difference for name, difference in differences.items() if difference is not None}
    if not known:
        return "No figure is defined yet."
    best, worst = (pick(known, key=lambda name: known[name]["mean"]) for pick in (max, min))
    gain = _difference(known[best])
    if significant_sign(known[best]) > 0:
        said = f"In training rooms “{best}” is better ({gain} points of mean IoU)"
    elif known[best]["mean"] > 0:
        said = f"No variant is significantly better (highest: “{best}”, {gain})"
    else:
        said = f"None is better (nearest: “{best}”, {gain})"
    return said + (f"; lowest: “{worst}” ({_difference(known[worst])})." if worst != best else ".")


def _differences(variants: Sequence[Mapping[str, Any]], pools: Mapping[str, Any], base: Mapping[str, Any]) -> str:
    """A row of differences from the base for each variant, the first column with its interval."""
    scenes, first = {pool: _num_scenes(pools, pool) for pool in pools}, next(iter(pools))
    columns = [(figure, pool) for figure in DIFFERENCES for pool in pools]
    rows = []
    for one in variants:
        found = [widened(one["results"][pool]["difference"][figure], scenes[pool]) for figure, pool in columns]
        cells = [_cell(difference, with_interval=place == 0) for place, difference in enumerate(found)]
        ours, usual = one["results"][first]["cpu_s"], base[first]["cpu_s"]
        rows.append([one["name"], *cells, f"{ours / usual:.1f}x" if usual else "-"])
    headings = [f"{DIFFERENCES[figure]}, {POOLS[pool]}" for figure, pool in columns]
    return table(["", *headings, "time"], rows, "---:")


def _cell(difference: Mapping[str, Any] | None, with_interval: bool) -> str:
    if difference is None:
        return "-"
    text = _difference(difference, with_interval)
    return f"**{text}**" if significant_sign(dict(difference)) else text


def _difference(difference: Mapping[str, Any], with_interval: bool = True) -> str:
    text = f"{100 * difference['mean']:+.1f}"
    if with_interval and difference["low"] is not None:
        text += f" [{100 * difference['low']:+.1f}, {100 * difference['high']:+.1f}]"
    return text


def _setting(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


# Presets -------------------------------------------------------------------------------------------------------------


def _modes(content: Mapping[str, Any]) -> dict[str, Any]:
    pools, results = content["pools"], content["results"]
    defects = [{"name": name, "results": results[name]} for name in results if name.startswith("paper, ")]
    if defects:
        defects = [{"name": "released", "results": results["released"]}, *defects]
    return {
        **content,
        "pools": _pools(content),
        "table": _levels(results, list(pools), tuple(LEVELS), "settings"),
        "defects": _differences(defects, pools, results["paper"]) if defects else "",
    }


def _pools(content: Mapping[str, Any]) -> dict[str, Any]:
    return {name: {**pool, "world": POOLS[name]} for name, pool in content["pools"].items()}


def _levels(results: Mapping[str, Any], pools: Sequence[str], figures: Sequence[str], corner: str = "") -> str:
    """Figures of each pool, all its episodes ranked together."""
    figures = [figure for figure in LEVELS if figure in figures]
    headings = [
        f"{POOLS[pool]}: {LEVELS[one]}" if one == figures[0] else LEVELS[one] for pool in pools for one in figures
    ]
    rows = [
        [name, *(points(found[pool]["pooled"][figure]) for pool in pools for figure in figures)]
        for name, found in results.items()
    ]
    return table([corner, *headings], rows, "---:")
