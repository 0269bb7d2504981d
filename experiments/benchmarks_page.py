"""The page of benchmarks: ``python -m experiments.benchmarks_page``."""

import sys
from dataclasses import dataclass
from functools import partial

from experiments.pages.markdown import PageConfig, run_page
from labeling.runtime.cli import make_main


@dataclass(frozen=True)
class BenchmarksPageConfig(PageConfig):
    """Writes docs/benchmarks.md and its picture from the results of benches that are there."""


main = make_main("experiments.benchmarks_page", BenchmarksPageConfig, partial(run_page, "benchmarks"))

if __name__ == "__main__":
    sys.exit(main())
