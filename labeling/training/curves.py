"""Curves of a training run for TensorBoard."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any


class Curves:
    """Draws figures over steps into ``tensorboard/`` of a run's folder; nothing where TensorBoard is not installed."""

    def __init__(self, out: Path, iteration: int, say: Callable[[str], None]) -> None:
        """Opens the folder.

        Args:
            out: folder of the run.
            iteration: steps after it are drawn anew.
            say: told if TensorBoard is missing.
        """
        try:
            from torch.utils.tensorboard import SummaryWriter
        except ImportError:
            say("note: no curves for TensorBoard; pip install 'seeing-by-moving[train]' brings them")
            self._writer = None
        else:
            self._writer = SummaryWriter(str(out / "tensorboard"), purge_step=iteration + 1)

    def draw(self, group: str, figures: Mapping[str, Any], step: int) -> None:
        """Draws those of the figures that are fractional numbers, as ``group/name``."""
        for name, value in figures.items():
            if self._writer is not None and isinstance(value, float):
                self._writer.add_scalar(f"{group}/{name}", value, step)

    def close(self) -> None:
        """Writes what is left."""
        if self._writer is not None:
            self._writer.close()
