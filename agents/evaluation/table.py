"""The tables of an evaluation in the terminal."""

from typing import Any

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


def _figures_table(content: dict[str, Any]) -> Any:
    settings = content["settings"]
    table = _table(
        f"{settings['env']}, {settings['split']}, {settings['detector']} detector: {settings['episodes']} episodes x "
        f"{len(settings['seeds'])} seeds",
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
    table = _table(f"difference to {base} on the same episodes, 95 % interval", ["policy", *headings])
    for policy, found in content["policies"].items():
        if policy == base:
            continue
        cells = [found["figures"][name]["difference"] for name in COMPARED]
        if last is not None:
            cells += [found["labels"][last][name]["difference"] for name in COMPARED_LABELS]
        table.add_row(policy, *map(_interval, cells))
    return table


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
    spread = "" if value["std"] is None else f" ±{value['std']:.2f}"
    return f"{value['mean']:.2f}{spread}"


def _interval(difference: dict[str, Any] | None) -> str:
    if difference is None:
        return "-"
    if difference["low"] is None:
        return f"{difference['mean']:+.2f}"
    return f"{difference['mean']:+.2f}\n[{difference['low']:+.2f}, {difference['high']:+.2f}]"
