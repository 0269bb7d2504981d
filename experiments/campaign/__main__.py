"""A hostile campaign against the project's commands: ``python -m experiments.campaign``.

Seeded and resumable: what has been tried stands in OUT, one line a trial, and is not tried again.
"""

import sys

from experiments.campaign.campaign_config import CampaignConfig
from labeling.runtime.cli import make_main
from labeling.runtime.help import CommandHelp


def _run(config: CampaignConfig) -> None:
    from experiments.campaign.campaign import run_campaign, table

    summary = run_campaign(config)
    print(table(summary))
    print(f"results: {config.out / 'campaign.json'}; spoilt inputs that were not survived: {config.out / 'failing'}")


HELP = CommandHelp(
    examples=(
        ("corruptions kills", "two parts of it"),
        ("--minutes 60", "all of it, an hour each"),
    ),
)
main = make_main("experiments.campaign", CampaignConfig, _run, about=HELP)

if __name__ == "__main__":
    sys.exit(main())
