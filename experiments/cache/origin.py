"""When results were made and by which label generator, so that pages can tell which of them are of an earlier one."""

from datetime import UTC, datetime
from typing import Any

from labeling.runtime.code_digest import code_digest
from labeling.runtime.provenance import experiment_provenance

MADE_ON, GENERATOR = "made_on", "label_generator"
"""What results call the time (UTC, ISO 8601, to the minute; earlier results have the day only) and the digest."""
DIGITS = 16
ENTRANCES = ("labeling.generator.propagate", "labeling.generator.sharing.joined_episodes")
DECIDES = ("labeling/generator/", "labeling/core/")
"""Folders of what counts, of all that the entrances import."""


def label_generator_digest() -> str:
    """Changes with the code that decides labels, and with what that has been calibrated to.

    How programs are run and files are written (``labeling.runtime``, ``labeling.formats``, ``labeling.io``) does not
    count.
    """
    return code_digest(*ENTRANCES, within=DECIDES)[:DIGITS]


def origin() -> dict[str, Any]:
    """What every file of results says of where it comes from."""
    return {
        MADE_ON: datetime.now(UTC).strftime("%Y-%m-%dT%H:%M"),
        GENERATOR: label_generator_digest(),
        **experiment_provenance(),
    }
