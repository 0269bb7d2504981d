"""The page of the thesis' tables: ``python -m experiments.results_page``."""

import sys
from dataclasses import dataclass
from functools import partial

from experiments.pages.markdown import PageConfig, run_page
from labeling.runtime.cli import make_main


@dataclass(frozen=True)
class ResultsPageConfig(PageConfig):
    """Writes docs/results.md and its pictures from the results that are there."""


main = make_main("experiments.results_page", ResultsPageConfig, partial(run_page, "results"))

if __name__ == "__main__":
    sys.exit(main())
