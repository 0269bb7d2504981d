"""Curves for TensorBoard, where it is installed."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from stable_baselines3.common.logger import Logger, TensorBoardOutputFormat

from labeling.training.curves import open_tensorboard


class _Curves(TensorBoardOutputFormat):
    """Draws from a step on; the constructor of Stable-Baselines3 would keep what lies after it."""

    def __init__(self, writer: Any) -> None:
        self.writer, self._is_closed = writer, False


def make_logger(folder: Path, steps: int, say: Callable[[str], None]) -> Logger:
    """Where Stable-Baselines3 and the callback log to.

    Args:
        folder: for TensorBoard.
        steps: from where on.
        say: told if there will be no curves.
    """
    writer = open_tensorboard(folder, steps, say)
    return Logger(None, [] if writer is None else [_Curves(writer)])
