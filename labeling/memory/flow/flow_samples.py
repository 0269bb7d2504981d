"""Pairs of views to learn flow from: functions of a seed and the sample's number."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
import torch
from torch.utils.data import Dataset

from labeling.memory.flow.moved_pieces import FlowTruth, with_moved_pieces
from labeling.memory.networks.view_batch import Views
from labeling.memory.settings.flow_settings import TrainFlowConfig
from labeling.memory.settings.grid_spec import GridSpec
from labeling.memory.view_prediction.scenes import SmallScene, concatenated

REAL_SHARE = 0.25
"""Of samples that are of recordings in which things move, where there are any."""


@dataclass(frozen=True)
class FlowSample:
    """Two times, and flow between them where it is known."""

    before: Views
    after: Views
    truth: FlowTruth


@runtime_checkable
class KnownPair(Protocol):
    """A pair of views whose motion is known, and need not be made up."""

    @property
    def name(self) -> str:
        """Of the episode."""
        ...

    @property
    def digest(self) -> str:
        """Of the views as they were recorded."""
        ...

    def sample(self, backwards: bool = False) -> FlowSample:
        """As it is learnt from, begun from either of the views."""
        ...


Pair = SmallScene | KnownPair


def untouched(pair: SmallScene, grid: GridSpec) -> FlowSample:
    """A pair as it was recorded, of which no flow is known."""
    nothing = [torch.zeros(1, channels, *grid.shape) for channels in (3, 1, 1)]
    return FlowSample(pair.views([0], 0), pair.views([1], 0), FlowTruth(*nothing))


def made_up(pair: SmallScene, grid: GridSpec, config: TrainFlowConfig, rng: np.random.Generator) -> FlowSample:
    """A pair in which pieces have been moved."""
    moved, truth = with_moved_pieces(pair, grid, config, rng)
    return FlowSample(moved.views([0], 0), moved.views([1], 0), truth)


def with_motion(
    pair: Pair, backwards: bool, grid: GridSpec, config: TrainFlowConfig, rng: np.random.Generator
) -> FlowSample:
    """A pair with the motion that it is known to have, or with one that is made up."""
    if not isinstance(pair, SmallScene):
        return pair.sample(backwards)
    return made_up(pair.chosen((1, 0)) if backwards else pair, grid, config, rng)


class FlowSamples(Dataset):
    """Samples to learn from: number -> ``FlowSample``."""

    def __init__(
        self,
        learn: Sequence[Pair],
        moving: Sequence[SmallScene],
        grid: GridSpec,
        config: TrainFlowConfig,
    ) -> None:
        """Draws nothing yet.

        Args:
            learn: pairs of views of recordings in which nothing moves, pieces of which are moved; or pairs whose motion
                is known.
            moving: pairs of views of others, of which no motion is known; may be empty.
            grid: of the memory.
            config: how pieces are moved, and the seed.
        """
        self.learn, self.moving, self.grid, self.config = list(learn), list(moving), grid, config

    def __getitem__(self, number: int) -> FlowSample:
        """One pair, begun from either of its views."""
        rng = np.random.default_rng([self.config.seed, number])
        if self.moving and rng.random() < REAL_SHARE:
            pair = self.moving[int(rng.integers(len(self.moving)))]
            return untouched(pair.chosen((1, 0)) if rng.random() < 0.5 else pair, self.grid)
        pair = self.learn[int(rng.integers(len(self.learn)))]
        return with_motion(pair, bool(rng.random() < 0.5), self.grid, self.config, rng)


def collate(samples: Sequence[FlowSample]) -> FlowSample:
    """A batch."""
    truths = [one.truth for one in samples]
    return FlowSample(
        concatenated([one.before for one in samples]),
        concatenated([one.after for one in samples]),
        FlowTruth(
            torch.cat([one.flow_m for one in truths]),
            torch.cat([one.moves for one in truths]),
            torch.cat([one.known for one in truths]),
        ),
    )
