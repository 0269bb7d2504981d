"""Curves of a training run for TensorBoard."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any


def tensorboard_curves(
    out: Path, iteration: int, say: Callable[[str], None]
) -> Callable[[str, Mapping[str, Any], int], None]:
    """Opens ``tensorboard/`` in a run's folder.

    Args:
        out: folder of the run.
        iteration: steps after it are drawn anew.
        say: told if TensorBoard is not installed; then nothing is drawn.

    Returns:
        Draws those of some figures that are fractional numbers, at a step, as ``group/name``: (group, figures, step).
    """
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError:
        say("note: no curves for TensorBoard; pip install 'seeing-by-moving[train]' brings them")
        return lambda group, figures, step: None
    writer = SummaryWriter(str(out / "tensorboard"), purge_step=iteration + 1)

    def draw(group: str, figures: Mapping[str, Any], step: int) -> None:
        for name, value in figures.items():
            if isinstance(value, float):
                writer.add_scalar(f"{group}/{name}", value, step)
        if group == "val":
            writer.flush()

    return draw
