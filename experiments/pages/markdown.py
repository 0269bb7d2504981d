"""Pages of docs as Jinja2 templates: how they are rendered and written, and how numbers stand on them."""

from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from agents.evaluation.statistics import significant_sign

SCALES = {
    "smoke": "a handful of episodes, to see that it runs: no figure here means anything",
    "quick": "a few episodes, to see whether anything has changed",
    "standard": "enough episodes and training to decide by",
    "full": "the full number of episodes",
}
"""What the scales of experiments mean, for readers."""
Pictures = dict[str, Callable[[Path], None]]
"""By file name, what draws a picture into a file."""
TEMPLATES, PICTURES = Path(__file__).with_name("templates"), "pictures"


def render(template: str, **values: Any) -> str:
    """The text of a page.

    Args:
        template: file name in ``TEMPLATES``. Several empty lines in what it gives become one.
        **values: what the template names; a name that is missing is an error.
    """
    import re

    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader(TEMPLATES),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        autoescape=False,  # Markdown, not HTML
    )
    environment.filters |= {"rows": table_rows, "sentence": lambda text: text[0].upper() + text[1:]}
    environment.globals |= {"table": table, "plural": plural, "scales": SCALES, "pictures": PICTURES}
    return re.sub(r"\n{3,}", "\n\n", environment.get_template(template).render(values)).strip() + "\n"


def write_page(name: str, results: Path, docs: Path) -> list[Path]:
    """Writes a page of docs, and the pictures on it into the folder beside it.

    Args:
        name: module of ``experiments.pages``: ``PAGE`` is its file name, and ``compose(results)`` gives its text and,
            by file name, what draws each picture into a file. ``OF_LABELS``, where it has that, names the files of
            results whose figures depend on labels: the page ends with where they come from.
        results: folder with the results of experiments.
        docs: folder for the page.

    Returns:
        The files written, the page first.

    Raises:
        SbmError: if there are no results for the page.
    """
    from experiments.pages.origin import section_of_origins
    from labeling.formats.atomic import atomic_file

    module = import_module(f"experiments.pages.{name}")
    text, pictures = module.compose(results)
    if of_labels := getattr(module, "OF_LABELS", ()):
        contents = {file.name: read_result(file) or {} for file in sorted(results.glob("*.json"))}
        text += "\n" + section_of_origins(contents, of_labels)
    for picture, draw in pictures.items():
        with atomic_file(docs / PICTURES / picture) as temporary:
            draw(temporary)
    with atomic_file(docs / module.PAGE) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return [docs / module.PAGE, *(docs / PICTURES / picture for picture in pictures)]


def read_result(file: Path) -> dict[str, Any] | None:
    """The content of a file of results; None if there is no such file.

    Raises:
        SbmError: if it is damaged.
    """
    from labeling.formats.checked_json import read_json

    return dict(read_json(file).mapping()) if file.is_file() else None


# Tables and numbers --------------------------------------------------------------------------------------------------


def table(headings: Sequence[str], rows: Sequence[Sequence[str]], numbers: str = "---") -> str:
    """A Markdown table.

    Args:
        headings: of the columns.
        rows: cells of each row.
        numbers: how all columns but the first are aligned: "---" (left) or "---:" (right).
    """
    head = "|".join(f" {heading} " if heading else " " for heading in headings)
    aligned = "|".join(["---", *[numbers] * (len(headings) - 1)])
    return "\n".join([f"|{head}|", f"|{aligned}|", table_rows(rows)])


def table_rows(rows: Sequence[Sequence[str]]) -> str:
    """The lines of a Markdown table below its headings."""
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def plural(count: float, word: str) -> str:
    """A count and its word: "1 episode", "2 episodes"."""
    return f"{count:.0f} {word if round(count) == 1 else word + 's'}"


def points(value: float | None) -> str:
    """A share as points of a hundred."""
    return "-" if value is None else f"{100 * value:.1f}"


def mean_std(values: Sequence[float]) -> str:
    """Mean and, of several values, their standard deviation."""
    if not values:
        return "-"
    return f"{np.mean(values):.1f}" + (f" ± {np.std(values, ddof=1):.1f}" if len(values) > 1 else "")


def interval(difference: Mapping[str, Any] | None) -> str:
    """A difference in points with its interval, bold where that excludes zero."""
    if difference is None:
        return "-"
    text = f"{100 * difference['mean']:+.1f}"
    if difference["low"] is not None:
        text += f" [{100 * difference['low']:+.1f}, {100 * difference['high']:+.1f}]"
    return f"**{text}**" if significant_sign(dict(difference)) else text
