"""The page of results of policies: ``python -m experiments.policies_page``."""

import sys
from dataclasses import dataclass
from functools import partial

from experiments.pages.markdown import PageConfig, run_page
from labeling.runtime.cli import make_main


@dataclass(frozen=True)
class PoliciesPageConfig(PageConfig):
    """Writes docs/policies-results.md and its pictures from the results that are there."""


main = make_main("experiments.policies_page", PoliciesPageConfig, partial(run_page, "policies"))

if __name__ == "__main__":
    sys.exit(main())
