"""Batches of a dataset whose samples are functions of their number, so that training can go on where it stopped."""

from collections.abc import Callable, Sequence
from typing import Any

import torch
from torch.utils.data import DataLoader, Dataset


def numbered_batches(
    dataset: Dataset, collate: Callable[[Sequence[Any]], Any], size: int, first: int, count: int, workers: int = 0
) -> DataLoader:
    """Batches ``first`` to ``first + count`` of an endless dataset; batch i holds samples ``size * i`` and following.

    Args:
        dataset: maps every number from 0 to a sample.
        collate: makes a batch of samples.
        size: samples in a batch.
        first: number of the first batch.
        count: how many batches.
        workers: processes that prepare samples; 0 prepares them here.
    """
    return DataLoader(
        dataset,
        batch_sampler=[list(range(size * batch, size * (batch + 1))) for batch in range(first, first + count)],
        collate_fn=collate,
        num_workers=workers,
        multiprocessing_context="spawn" if workers else None,
        pin_memory=workers > 0 and torch.cuda.is_available(),
    )
