"""The page of the thesis' tables in our worlds: ``python -m experiments.results_page``."""

import sys
from dataclasses import dataclass
from pathlib import Path

from experiments.pages.results import write_page
from labeling.runtime.cli import run_command


@dataclass(frozen=True)
class PageConfig:
    """Writes docs/results.md and its pictures anew, from the figures that are there."""

    results: Path = Path("experiments/results")
    """Folder with the figures."""
    docs: Path = Path("docs")
    """Folder for the page."""


def run(config: PageConfig) -> None:
    """Writes the page.

    Raises:
        SbmError: if there are no figures at all.
    """
    for path in write_page(config.results, config.docs):
        print(path)


def main(arguments: list[str] | None = None) -> int:
    """Runs the command line; returns its exit code."""
    return run_command(PageConfig, run, "python -m experiments.results_page", arguments)


if __name__ == "__main__":
    sys.exit(main())
