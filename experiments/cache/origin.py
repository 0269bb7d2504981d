"""When results were made and by which label generator, so that pages can tell which of them are of an earlier one."""

from datetime import UTC, datetime
from typing import Any

from labeling.runtime.code_digest import code_digest
from labeling.runtime.provenance import experiment_provenance

MADE_ON, GENERATOR = "made_on", "label_generator"
"""What results call the day and the digest."""
DIGITS = 16


def label_generator_digest() -> str:
    """Changes with the code of the label generator, and with what it has been calibrated to."""
    from labeling.generator.propagate import propagate
    from labeling.generator.sharing.joined_episodes import join_episodes

    return code_digest(propagate, join_episodes)[:DIGITS]


def origin() -> dict[str, Any]:
    """What every file of results says of where it comes from."""
    return {
        MADE_ON: datetime.now(UTC).date().isoformat(),
        GENERATOR: label_generator_digest(),
        **experiment_provenance(),
    }
