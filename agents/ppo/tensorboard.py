"""Curves for TensorBoard, where it is installed."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from stable_baselines3.common.logger import KVWriter, Logger

from labeling.training.curves import open_tensorboard


class TensorBoardWriter(KVWriter):
    """Writes scalars from a step on; Stable-Baselines3's own ``TensorBoardOutputFormat`` would keep what lies after."""

    def __init__(self, writer: Any) -> None:
        """Takes over a ``SummaryWriter``."""
        self._writer = writer

    def write(self, key_values: dict[str, Any], key_excluded: dict[str, tuple[str, ...]], step: int = 0) -> None:
        """Writes a row of scalars."""
        for name, value in key_values.items():
            if "tensorboard" not in (key_excluded.get(name) or ()):
                self._writer.add_scalar(name, value, step)
        self._writer.flush()

    def close(self) -> None:
        """Closes the file."""
        self._writer.close()


def make_logger(folder: Path, steps: int, say: Callable[[str], None]) -> Logger:
    """Where Stable-Baselines3 and the callback log to.

    Args:
        folder: for TensorBoard.
        steps: from where on.
        say: told if there will be no curves.
    """
    writer = open_tensorboard(folder, steps, say)
    return Logger(None, [] if writer is None else [TensorBoardWriter(writer)])
