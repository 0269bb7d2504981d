"""Curves of a training run for TensorBoard."""

from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

from labeling.runtime.extras import how_to_install


@contextmanager
def tensorboard_writer(folder: Path, step: int, say: Callable[[str], None]) -> Iterator[Any]:
    """Writes a run's curves from a step on: what lies after it, from before a kill, is dropped.

    However the run ends, what has been drawn is on the disk by then, and no thread writes there any longer.

    Args:
        folder: to write to.
        step: where the run goes on.
        say: told if TensorBoard is missing.

    Yields:
        A ``SummaryWriter``, None where TensorBoard is not installed.
    """
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError:
        say(f"note: no curves for TensorBoard; what brings them: {how_to_install('train')}")
        yield None
        return
    with closing(SummaryWriter(str(folder), purge_step=step + 1)) as writer:
        yield writer
