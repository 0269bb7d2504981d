"""Checkpoints from which a killed run goes on as if it had never stopped."""

import json
import pickle
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import torch

from labeling.core.errors import SbmError, UsageError
from labeling.formats.atomic import atomic_file, write_json
from labeling.training.config import CHECKPOINT_FILE, HISTORY_FILE


@dataclass
class Progress:
    """How far training has come; what a checkpoint holds beside tensors."""

    iteration: int = 0
    """Batches trained on."""
    minutes: float = 0.0
    """Spent on them, where training is bounded by time; else 0."""
    best: float = -1.0
    """Highest validation score so far."""
    best_iteration: int = 0
    """When it was reached."""
    history: list[dict[str, Any]] = field(default_factory=list)
    """A record for each validation."""
    sums: dict[str, float] = field(default_factory=dict)
    """Of each loss since the last validation."""
    summed: int = 0
    """Batches in these sums."""


def save_checkpoint(out: Path, identity: str, progress: Progress, state: Mapping[str, Any]) -> None:
    """Writes a checkpoint atomically, and the history beside it.

    Args:
        out: folder of the run.
        identity: data and settings that a run must share to go on from it.
        progress: how far training has come.
        state: tensors, and whatever else ``torch.load`` reads with ``weights_only``.
    """
    with atomic_file(out / CHECKPOINT_FILE) as temporary:
        torch.save({**state, "identity": identity, "progress": json.dumps(asdict(progress))}, temporary)
    write_json(out / HISTORY_FILE, progress.history)


def load_checkpoint(
    out: Path, identity: str, device: str | torch.device, restore: Callable[[Mapping[str, Any]], None]
) -> Progress:
    """Goes on from a checkpoint, if there is one. Nothing in it is executed.

    Args:
        out: folder of the run.
        identity: of this run.
        device: where its tensors go.
        restore: takes the state.

    Returns:
        How far training had come; the very start without a checkpoint.

    Raises:
        SbmError: if the checkpoint is damaged, or that of another run.
    """
    path = out / CHECKPOINT_FILE
    if not path.is_file():
        return Progress()
    try:
        content = torch.load(path, map_location=device, weights_only=True)
        if content["identity"] != identity:
            raise UsageError(
                f"{out}: holds a run with other data or settings; give another --out, or remove {CHECKPOINT_FILE} there"
            )
        restore(content)
        return _progress(content)
    except UsageError:
        raise
    except (OSError, KeyError, ValueError, TypeError, RuntimeError, EOFError, pickle.UnpicklingError) as error:
        raise SbmError(f"{path}: is damaged ({type(error).__name__}); remove it to start anew") from None


def _progress(content: Mapping[str, Any]) -> Progress:
    """Pre-training once had names of its own: "state" with a "step"."""
    saved = json.loads(content["progress"] if "progress" in content else content["state"])
    if "step" in saved:
        saved["iteration"] = saved.pop("step")
    return Progress(**saved)
