"""Curves for TensorBoard, where it is installed."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from stable_baselines3.common.logger import KVWriter, Logger


class TensorBoardWriter(KVWriter):
    """Writes scalars from a step on: what lies after it, from before a kill, is dropped.

    Stable-Baselines3's own ``TensorBoardOutputFormat`` would show both.
    """

    def __init__(self, folder: Path, steps: int) -> None:
        """Opens the folder.

        Raises:
            ImportError: if TensorBoard is not installed.
        """
        from torch.utils.tensorboard import SummaryWriter

        self._writer = SummaryWriter(str(folder), purge_step=steps + 1)

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
    try:
        return Logger(None, [TensorBoardWriter(folder, steps)])
    except ImportError:
        say("note: no curves for TensorBoard; pip install 'seeing-by-moving[train]' brings them")
        return Logger(None, [])
