"""When results were made, by which label generator, so that pages can tell which of them are of an earlier one, and
where their networks were trained.
"""

from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from labeling.cluster.cluster_config import ClusterConfig
from labeling.runtime.code_digest import code_digest
from labeling.runtime.provenance import experiment_provenance
from sbm_gym.assets.catalog.same_libraries import library_digests

MADE_ON, GENERATOR, MACHINES = "made_on", "label_generator", "machines"
"""What results call the time (UTC, ISO 8601, to the minute; earlier results have the day only), the digest, and what
networks were trained on (earlier results do not say it of detectors).
"""
MACHINE = "machine"
"""What rows of memories call what their network was trained on; earlier rows have none."""
MASKS_FROM = "mask_threshold"
"""What their settings call the probability from which on a pixel is part of a predicted mask; earlier ones, which cut
at .5, do not say it."""
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
    return sorted({machine_of(folder) for folder in runs})


def machine_of(run: str) -> str:
    """On which device, with which PyTorch, a run was trained; the last part of it, if it went on elsewhere.

    Args:
        run: its folder.
    """
    from labeling.formats.checked_json import read_json
    from labeling.training.config import CONFIG_FILE

    found = read_json(Path(run) / CONFIG_FILE).get("machine")
    return _machine(found.text("device"), found.text("torch"))


def training_machine(where: ClusterConfig) -> str:
    """What new runs are trained on, as ``machine_of`` says it; in keys, so that those of other machines are not taken.

    Args:
        where: runs are trained. Of a cluster only its name is known beforehand.
    """
    if not where.is_local:
        return where.cluster
    import torch

    from labeling.detectors.registry import choose_device
    from labeling.training.loop import device_name

    return _machine(device_name(torch.device(choose_device())), torch.__version__)


def _machine(device: str, torch_version: str) -> str:
    return f"{device} (PyTorch {torch_version})"
