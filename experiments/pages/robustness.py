"""The page about what commands survive: the result of ``python -m experiments.campaign``."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from experiments.campaign.campaign import KINDS
from experiments.pages.markdown import Pictures, read_result, render, table
from labeling.core.errors import SbmError

PAGE = "robustness.md"


def compose(results: Path) -> tuple[str, Pictures]:
    """The page; it has no pictures.

    Raises:
        SbmError: if there is no result.
    """
    content = read_result(results / "campaign.json")
    if content is None:
        raise SbmError(
            f"{results}: no campaign.json; run python -m experiments.campaign and copy its campaign.json here"
        )
    return page(content), {}


def page(content: Mapping[str, Any]) -> str:
    """The text of the page."""
    return render(
        "robustness.md.jinja",
        content=content,
        kinds=KINDS,
        tables={kind: _table(content[kind]) for kind in KINDS if kind in content},
    )


def _table(found: Mapping[str, Any]) -> str:
    names = sorted({outcome for outcomes in found["outcomes"].values() for outcome in outcomes})
    rows = [
        [subject, str(sum(outcomes.values())), *(str(outcomes.get(name, 0)) for name in names)]
        for subject, outcomes in found["outcomes"].items()
    ]
    return table(["command", "trials", *names], rows, "---:")
