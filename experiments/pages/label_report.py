"""The page about the label generator's defaults, written from the figures of ``label_ablation`` and ``label_modes``."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from experiments.benchmarks.rows import Row, ratio_text, row_of, time_text
from labeling.core.errors import SbmError
from labeling.io.formats.atomic import atomic_file
from labeling.metrics.bootstrap import beyond_chance

PAGE, PICTURE = "label-generator.md", "pictures/label_ablation.png"
SPEED = "bench/labels.json"
"""Written by ``python -m experiments.bench labels --out experiments/results/bench``."""
POOLS = {"rooms_train": "rooms", "rooms_val": "rooms, val", "streets_train": "streets", "streets_val": "streets, val"}
SCALES = {
    "smoke": "a handful of episodes, to see that it runs: no figure here means anything",
    "quick": "a few episodes, to see whether anything has changed",
    "full": "the full number of episodes",
}
CHOSEN_ON = "rooms_train"
TABLE_FIGURES = {"mean_iou": "mean IoU", "mask_ap50": "AP50"}


def write_page(results: Path, docs: Path) -> list[Path]:
    """Writes the page, and the picture in it.

    Args:
        results: folder with ``label_ablation.json`` and, if they have run, ``label_modes.json`` and
            ``bench/labels.json``.
        docs: folder for the page.

    Returns:
        The files written.

    Raises:
        SbmError: if neither experiment has run yet.
    """
    ablation, modes = _read(results / "label_ablation.json"), _read(results / "label_modes.json")
    if ablation is None and modes is None:
        raise SbmError(f"{results}: no label_ablation.json and no label_modes.json; run these experiments first")
    written, parts = [], [INTRODUCTION]
    if ablation is not None:
        from experiments.figures.ablation_picture import draw_ablation

        with atomic_file(docs / PICTURE) as temporary:
            draw_ablation(ablation, CHOSEN_ON, temporary)
        written.append(docs / PICTURE)
        parts += ablation_sections(ablation)
    if modes is not None:
        parts += modes_sections(modes)
    speed = _read(results / SPEED)
    if speed is not None:
        from experiments.benchmarks.labels import PICTURE as VIEWS_PICTURE
        from experiments.benchmarks.labels import draw

        rows = [row_of(content) for content in speed["rows"]]
        draw(rows, docs / "pictures")
        written.append(docs / "pictures" / VIEWS_PICTURE)
        parts += speed_section(rows, speed["machine"], f"pictures/{VIEWS_PICTURE}")
    with atomic_file(docs / PAGE) as temporary:
        temporary.write_text("\n\n".join(parts) + "\n", encoding="utf-8")
    return [docs / PAGE, *written]


INTRODUCTION = """# The label generator's settings

Written by `python -m experiments.run label_ablation --report` from `experiments/results/`; do not edit by hand. How the
generator works is told in [how it works](how-it-works.md)."""


def ablation_sections(content: dict[str, Any]) -> list[str]:
    """The part about the defaults, one section per question."""
    results, pools = content["results"], content["pools"]
    lead = (
        "## Why these defaults\n\n"
        "One setting at a time is changed and everything else left at its default. Every figure is a difference from "
        "the default on the same episodes, averaged over them, in points (hundredths). **Bold**: its 95 % bootstrap "
        "interval over episodes excludes zero (all intervals are in the JSON). Settings are chosen on training scenes; "
        "validation scenes report."
        f"\n\n{_setup(content)}"
    )
    parts = [lead, _levels(results, pools), f"![Differences from the default]({PICTURE})"]
    for factor in content["factors"]:
        defaults = ", ".join(
            f"`{name} = {_value(content['default'][name])}`"
            for name in factor["settings"]
            if name in content["default"]
        )
        text = f"### {factor['title']}\n\n{factor['why']} Defaults: {defaults}."
        if factor["variants"]:
            text += f" {verdict(factor)}\n\n{_difference_table(factor['variants'], list(pools), results['default'])}"
        parts.append(text)
    reasons = "\n".join(f"- `{name}`: {why}" for name, why in content["not_studied"].items())
    return [*parts, f"### Not varied\n\n{reasons}"]


def verdict(factor: dict[str, Any], pool: str = CHOSEN_ON, figure: str = "mean_iou") -> str:
    """One sentence: whether anything tried is better than the default beyond chance, on the scenes to choose on."""
    known = [
        (one["name"], one["results"][pool]["difference"][figure])
        for one in factor["variants"]
        if one["results"][pool]["difference"][figure] is not None
    ]
    if not known:
        return "No figure is defined yet."
    name, best = max(known, key=lambda item: item[1]["mean"])
    worst_name, worst = min(known, key=lambda item: item[1]["mean"])
    if beyond_chance(best) > 0:
        said = f"In training rooms “{name}” is better ({_points(best)} points of mean IoU)"
    elif best["mean"] > 0:
        said = f"Nothing tried is better beyond chance (at best “{name}”, {_points(best)})"
    else:
        said = f"Nothing tried is better (nearest “{name}”, {_points(best)})"
    if worst_name != name:
        said += f"; most is lost with “{worst_name}” ({_points(worst)})"
    return f"{said}."


def speed_section(rows: Sequence[Row], machine: dict[str, Any], picture: str) -> list[str]:
    """The part about speed: rivals, limits, stages, numbers of views and workers."""
    lines = ["| | ours | beside | theirs | ratio | asked | |", "|---|---:|---|---:|---:|---|---|"]
    for row in rows:
        theirs = "" if row.rival_seconds is None else time_text(row.rival_seconds)
        verdict = {True: "holds", False: "**missed**", None: ""}[row.holds]
        said = "; ".join(part for part in (verdict, row.note) if part)
        cells = (row.what, time_text(row.seconds), row.rival, theirs, ratio_text(row), row.wanted, said)
        lines.append(f"| {' | '.join(cells)} |")
    lead = (
        "## How fast\n\n"
        f"`python -m experiments.bench labels` on {machine['cpus']} cores, ours and the rivals in one run. Seconds are "
        "this machine's, ratios mean more. Stages stand beside their floor: what the machine needs to move the "
        "bytes, or to do the arithmetic, that the stage cannot do without."
    )
    return [lead, "\n".join(lines), f"![Time for each view over the number of views]({picture})"]


def modes_sections(content: dict[str, Any]) -> list[str]:
    """The part about the presets."""
    pools = list(content["pools"])
    lines = ["| settings | " + " | ".join(f"{POOLS[pool]}: AP50 | AP30 | mean IoU | matched" for pool in pools) + " |"]
    lines.append("|---|" + "---:|" * 4 * len(pools))
    for name, found in content["results"].items():
        cells = [_share(found[pool]["pooled"][key]) for pool in pools for key in FOUR]
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    text = (
        "## Presets\n\n"
        "`--preset paper` is the thesis as written, `--preset released` the code published with it, with its defects "
        "(`labeling.generator.settings.presets` says what each sets and what no source tells). All episodes ranked "
        "together, in "
        "points; labels only, no detector is trained.\n\n"
        f"{_setup(content)}\n\n" + "\n".join(lines)
    )
    alone = [name for name in content["results"] if name.startswith("paper, ")]
    if alone:
        rows = [{"name": name, "results": content["results"][name]} for name in ["released", *alone]]
        text += "\n\nEach defect alone, as a difference from `paper`:\n\n"
        text += _difference_table(rows, pools, content["results"]["paper"])
    return [text]


FOUR = ("mask_ap50", "mask_ap30", "mean_iou", "mean_iou_matched")


def _levels(results: dict[str, Any], pools: dict[str, Any]) -> str:
    """How good detector and default are, all episodes of a pool ranked together."""
    lines = ["| | " + " | ".join(f"{POOLS[pool]}: AP50 | mean IoU" for pool in pools) + " |"]
    lines.append("|---|" + "---:|" * 2 * len(pools))
    for name in ("detector", "default"):
        cells = [_share(results[name][pool]["pooled"][key]) for pool in pools for key in ("mask_ap50", "mean_iou")]
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _difference_table(variants: list[dict[str, Any]], pools: list[str], base: dict[str, Any]) -> str:
    columns = [f"{label}, {POOLS[pool]}" for label in TABLE_FIGURES.values() for pool in pools]
    lines = ["| | " + " | ".join(columns) + " | time |", "|---|" + "---:|" * (len(columns) + 1)]
    for one in variants:
        cells = [
            _cell(one["results"][pool]["difference"][figure], with_interval=(figure, pool) == ("mean_iou", pools[0]))
            for figure in TABLE_FIGURES
            for pool in pools
        ]
        ours, usual = one["results"][pools[0]]["cpu_s"], base[pools[0]]["cpu_s"]
        time = f"{ours / usual:.1f}x" if usual else "-"
        lines.append(f"| {one['name']} | " + " | ".join(cells) + f" | {time} |")
    return "\n".join(lines)


def _setup(content: dict[str, Any]) -> str:
    counts = ", ".join(
        f"{pool['episodes']} episodes of {pool['views_per_episode']} views in {POOLS[name]} "
        f"({len(set(pool['scenes']))} scenes)"
        for name, pool in content["pools"].items()
    )
    return (
        f"Measured on {counts}; {len(content['seeds'])} seed(s) of the generator's sampling; policy `ring`, simulated "
        f"detector. Scale `{content['scale']}`: {SCALES[content['scale']]}."
    )


def _cell(difference: dict[str, Any] | None, with_interval: bool) -> str:
    if difference is None:
        return "-"
    text = _points(difference, with_interval)
    return f"**{text}**" if beyond_chance(difference) else text


def _points(difference: dict[str, Any], with_interval: bool = True) -> str:
    text = f"{100 * difference['mean']:+.1f}"
    if with_interval and difference["low"] is not None:
        text += f" [{100 * difference['low']:+.1f}, {100 * difference['high']:+.1f}]"
    return text


def _share(value: float | None) -> str:
    return "-" if value is None else f"{100 * value:.1f}"


def _value(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def _read(path: Path) -> dict[str, Any] | None:
    if not path.is_file():
        return None
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise SbmError(f"{path}: cannot be read ({error})") from None
    return content
