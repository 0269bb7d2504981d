"""The tables of an evaluation in the terminal."""

from typing import Any

from agents.evaluation.statistics import MIN_SCENES, MIN_STARTS, shown_sign, starts_to_resolve

COLUMNS = {
    "return": "return",
    "discovery": "discovery",
    "diversity": "diversity",
    "objects": "objects",
    "target_sectors": "sectors\nof target",
    "sectors": "sectors\nin all",
    "collisions": "collisions",
    "path_m": "path\n(m)",
}
LABEL_COLUMNS = {
    "pooled_ap50": "AP50\npooled",
    "pooled_ap30": "AP30\npooled",
    "ap50": "AP50\nepisode",
    "right": "right\nlabels",
    "right_per_view": "right\nper view",
    "objects": "objects\nlabelled",
}
COMPARED = ("return", "objects", "sectors")
COMPARED_LABELS = ("ap50", "right", "objects")
FINE = 0.05
"""As a share of the first policy's return: a difference that many would like to know of."""


def print_tables(content: dict[str, Any]) -> None:
    """Prints what the policies earned, what labels they brought home, and how they differ from the first one.

    Args:
        content: of ``evaluation.json``.
    """
    from rich.console import Console

    console = Console()
    if not console.is_terminal:
        console = Console(width=120)
    console.print(_figures_table(content))
    if any(found["labels"] for found in content["policies"].values()):
        console.print(_labels_table(content))
    if len(content["policies"]) > 1:
        console.print(_differences_table(content))
        console.print(resolution(content), highlight=False)


def _figures_table(content: dict[str, Any]) -> Any:
    settings = content["settings"]
    table = _table(
        f"{settings['env']}, {settings['split']}, {settings['detector']} detector: "
        f"{settings['episodes'] * len(settings['seeds'])} starts in {len(settings['scenes'])} scenes; ± half of the "
        "95 % interval over both",
        ["policy", *COLUMNS.values()],
    )
    for policy, found in content["policies"].items():
        table.add_row(policy, *(_with_spread(found["figures"].get(name)) for name in COLUMNS))
    return table


def _labels_table(content: dict[str, Any]) -> Any:
    table = _table("labels made from the first views", ["views", "policy", *LABEL_COLUMNS.values()])
    counts = list(next(iter(content["policies"].values()))["labels"])
    for count in counts:
        for policy, found in content["policies"].items():
            row = found["labels"][count]
            table.add_row(count, policy, *(_with_spread(row.get(name)) for name in LABEL_COLUMNS))
        table.add_section()
    return table


def _differences_table(content: dict[str, Any]) -> Any:
    base = content["compared_with"]
    labels = content["policies"][base]["labels"]
    last = max(labels, key=int) if labels else None
    headings = [COLUMNS[name] for name in COMPARED]
    if last is not None:
        headings += [f"{LABEL_COLUMNS[name]}\n@{last}" for name in COMPARED_LABELS]
    table = _table(
        f"difference to {base} from the same starts, 95 % interval over starts and scenes; bold where it is shown",
        ["policy", *headings, "return\nresolved"],
    )
    for policy, found in content["policies"].items():
        if policy == base:
            continue
        cells = [found["figures"][name]["difference"] for name in COMPARED]
        if last is not None:
            cells += [found["labels"][last][name]["difference"] for name in COMPARED_LABELS]
        resolved = found["figures"]["return"]["difference"]["resolves"]
        table.add_row(policy, *map(_interval, cells), "-" if resolved is None else f"{resolved:.2f}")
    return table


def resolution(content: dict[str, Any]) -> str:
    """What differences of the return so many starts resolve, how many it would take for fine ones, and what is bold.

    Args:
        content: of ``evaluation.json``.
    """
    base = content["compared_with"]
    differences = [
        found["figures"]["return"]["difference"] for name, found in content["policies"].items() if name != base
    ]
    lines = []
    worst = max(differences, key=lambda one: one["resolves"] or 0.0)
    if worst["resolves"] is not None:
        starts, scenes, std = worst["episodes"], worst["scenes"], worst["std"]
        lines.append(
            f"{starts} starts in {scenes} scenes resolve differences of return of {worst['resolves']:.2f} at 95 % (one "
            f"as large is shown 4 times out of 5); paired differences have a standard deviation of {std:.2f}."
        )
        fine = FINE * content["policies"][base]["figures"]["return"]["mean"]
        needed = starts_to_resolve(worst, fine)
        if needed is not None and needed > starts:
            lines.append(f"{FINE:.0%} of {base}'s return ({fine:.2f}) would take about {_round(needed)} starts.")
        if scenes < MIN_SCENES:
            lines.append(f"In fewer than {MIN_SCENES} scenes intervals are over starts, and of these scenes only.")
    if any(one["episodes"] < MIN_STARTS or one["scenes"] < MIN_SCENES for one in differences):
        lines.append(f"Nothing is bold: that takes {MIN_STARTS} starts in {MIN_SCENES} scenes or more.")
    return "\n".join(lines)


def _round(count: int) -> int:
    """To two digits that count."""
    return int(float(f"{count:.1e}"))


def _table(title: str, headings: list[str]) -> Any:
    from rich.table import Table

    table = Table(title=title, title_justify="left", title_style="bold")
    for heading in headings:
        words = heading in ("policy", "views")
        table.add_column(heading, justify="left" if words else "right", no_wrap=not words, overflow="fold")
    return table


def _with_spread(value: dict[str, Any] | None) -> str:
    if value is None or value["mean"] is None:
        return "-"
    low, high = value.get("low"), value.get("high")
    spread = "" if low is None or high is None else f" ±{(high - low) / 2:.2f}"
    return f"{value['mean']:.2f}{spread}"


def _interval(difference: dict[str, Any] | None) -> str:
    if difference is None:
        return "-"
    if difference["low"] is None:
        return f"{difference['mean']:+.2f}"
    text = f"{difference['mean']:+.2f}\n\\[{difference['low']:+.2f}, {difference['high']:+.2f}]"
    return f"[bold]{text}[/bold]" if shown_sign(difference) else text
