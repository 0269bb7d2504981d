"""The page of the thesis' tables: ``python -m experiments.results_page``."""

import sys
from dataclasses import dataclass

from experiments.pages.markdown import PageConfig
from labeling.runtime.cli import make_main


@dataclass(frozen=True)
class ResultsPageConfig(PageConfig):
    """Writes docs/results.md and its pictures from the results that are there."""


def run(config: PageConfig) -> None:
    """Writes the page.

    Raises:
        SbmError: if there are no results at all.
    """
    from experiments.pages.results import write_page

    print(*write_page(config.results, config.docs), sep="\n")


main = make_main("experiments.results_page", ResultsPageConfig, run)

if __name__ == "__main__":
    sys.exit(main())
