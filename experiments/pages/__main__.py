"""Pages of docs written from committed results: ``python -m experiments.pages [NAME ...]``."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, get_args

import tyro

from labeling.runtime.cli import make_main
from labeling.runtime.help import CommandHelp

Page = Literal["results", "policies", "benchmarks", "robustness", "detector_labels", "readme"]
PAGES: tuple[Page, ...] = get_args(Page)
MODULES = {"policies": "policies.results"}
"""Where a page has several modules, the one that composes it."""


@dataclass(frozen=True)
class PagesConfig:
    """Writes results.md, policies-results.md, benchmarks.md, robustness.md, detector-labels.md, and README's table."""

    names: tyro.conf.Positional[tuple[Page, ...]] = PAGES
    """Which pages to write."""
    results: Path = Path("experiments/results")
    """Folder with the results of experiments."""
    docs: Path = Path("docs")
    """Folder for the pages; their pictures go to DOCS/pictures, and README lies beside DOCS."""


def _run(config: PagesConfig) -> None:
    from experiments.pages.markdown import write_page
    from experiments.pages.readme import write_readme

    for name in config.names:
        if name == "readme":
            write_readme(readme := config.docs.parent / "README.md", config.results)
            print(readme)
            continue
        print(*write_page(MODULES.get(name, name), config.results, config.docs), sep="\n")


HELP = CommandHelp(
    examples=(
        ("", "write all pages"),
        ("results", "write one of them"),
    ),
)
main = make_main("experiments.pages", PagesConfig, _run, resumes=False, about=HELP)

if __name__ == "__main__":
    sys.exit(main())
