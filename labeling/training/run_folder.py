"""What all training runs keep in their folders: a checkpoint to go on from after a kill, and curves."""

import json
import pickle
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import torch

from labeling.core.errors import SbmError, UsageError
from labeling.io.formats.atomic import atomic_file, write_json
from labeling.training.run_files import CHECKPOINT_FILE, HISTORY_FILE


@dataclass
class Progress:
    """How far training has come; what a checkpoint holds beside tensors."""

    iteration: int = 0
    best: float = -1.0
    best_iteration: int = 0
    history: list[dict[str, Any]] = field(default_factory=list)

    def is_flat(self, patience: int, every: int) -> bool:
        """Whether so many validations, one every so many batches, have passed without a better one; 0 is never."""
        return patience > 0 and self.iteration - self.best_iteration >= patience * every


def save_checkpoint(out: Path, identity: str, state: Progress, content: Mapping[str, Any]) -> None:
    """Writes a checkpoint, and the history beside it.

    Args:
        out: folder of the run.
        identity: what a run must agree on to go on from it.
        state: how far training has come.
        content: tensors, and what ``torch.load`` reads with ``weights_only``.
    """
    with atomic_file(out / CHECKPOINT_FILE) as temporary:
        torch.save({**content, "identity": identity, "progress": json.dumps(asdict(state))}, temporary)
    write_json(out / HISTORY_FILE, state.history)


def load_checkpoint(
    out: Path, identity: str, device: str | torch.device, restore: Callable[[dict[str, Any]], None]
) -> Progress:
    """Goes on from a checkpoint, if there is one.

    Args:
        out: folder of the run.
        identity: of this run.
        device: where its tensors go.
        restore: takes the content.

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
        return Progress(**json.loads(content["progress"]))
    except (OSError, KeyError, ValueError, TypeError, RuntimeError, EOFError, pickle.UnpicklingError) as error:
        if isinstance(error, UsageError):
            raise
        raise SbmError(f"{path}: is damaged ({type(error).__name__}); remove it to start anew") from None


def tensorboard(out: Path, iteration: int, say: Callable[[str], None]) -> Any:
    """Writes curves for TensorBoard, where it is installed; else None, and a note.

    Args:
        out: folder of the run.
        iteration: from which on curves are written.
        say: where the note goes.
    """
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError:
        say("note: no curves for TensorBoard; pip install 'seeing-by-moving[train]' brings them")
        return None
    return SummaryWriter(str(out / "tensorboard"), purge_step=iteration + 1)
