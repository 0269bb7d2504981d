"""Curves of a training run for TensorBoard."""

from collections.abc import Callable
from pathlib import Path
from typing import Any


def open_tensorboard(folder: Path, step: int, say: Callable[[str], None]) -> Any:
    """A TensorBoard ``SummaryWriter`` from a step on: what lies after it, from before a kill, is dropped.

    Args:
        folder: to write to.
        step: where the run goes on.
        say: told if TensorBoard is missing.

    Returns:
        The writer, None where TensorBoard is not installed.
    """
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError:
        say("note: no curves for TensorBoard; pip install 'seeing-by-moving[train]' brings them")
        return None
    return SummaryWriter(str(folder), purge_step=step + 1)
