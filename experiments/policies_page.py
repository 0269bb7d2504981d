"""The page of results of policies: ``python -m experiments.policies_page``."""

import sys
from dataclasses import dataclass

from experiments.pages.markdown import PageConfig
from labeling.runtime.cli import make_main


@dataclass(frozen=True)
class PoliciesPageConfig(PageConfig):
    """Writes docs/policies-results.md and its pictures from the results that are there."""


def run(config: PageConfig) -> None:
    """Writes the page.

    Raises:
        SbmError: if there are no results at all.
    """
    from experiments.pages.policies import write_page

    print(*write_page(config.results, config.docs), sep="\n")


main = make_main("experiments.policies_page", PoliciesPageConfig, run)

if __name__ == "__main__":
    sys.exit(main())
