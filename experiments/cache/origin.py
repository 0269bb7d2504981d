"""When results were made, by which label generator, so that pages can tell which of them are of an earlier one, and
where their networks were trained.
"""

from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from labeling.runtime.code_digest import code_digest
from labeling.runtime.provenance import experiment_provenance
from sbm_gym.assets.catalog.same_libraries import library_digests

MADE_ON, GENERATOR, MACHINES = "made_on", "label_generator", "machines"
"""What results call the time (UTC, ISO 8601, to the minute; earlier results have the day only), the digest, and what
networks were trained on (earlier results do not say it of detectors).
"""
FURNITURE = "furniture"
"""What they call the digests of the installed furniture libraries, by file name."""
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
        FURNITURE: library_digests(),
        **experiment_provenance(),
    }


def machines(runs: Iterable[str]) -> list[str]:
    """On which devices, with which PyTorch, runs were trained; each once.

    Args:
        runs: their folders.
    """
    from labeling.formats.checked_json import read_json
    from labeling.training.config import CONFIG_FILE

    found = (read_json(Path(folder) / CONFIG_FILE).get("machine") for folder in runs)
    return sorted({f"{one.text('device')} (PyTorch {one.text('torch')})" for one in found})
