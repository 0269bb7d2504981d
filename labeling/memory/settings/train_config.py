"""Settings of training a memory."""

from dataclasses import dataclass
from typing import Literal

from labeling.memory.settings.grid_spec import Around
from labeling.runtime.ranges import Positive
from labeling.training.config import TrainingConfig

PixelLoss = Literal["l1", "cross_entropy"]
Contrast = Literal["info_nce", "margin"]


@dataclass(frozen=True)
class TrainMemoryConfig(TrainingConfig):
    """How a memory is trained."""

    iterations: Positive[int] = 4000
    """Batches."""
    batch_size: Positive[int] = 2
    """Scenes in a batch. On one CPU thread two take less time than one, as torch convolves single volumes slowly."""
    learning_rate: Positive[float] = 1e-3
    """Of Adam; falls to a hundredth along a cosine."""
    validate_every: Positive[int] = 200
    """Batches between validations."""
    inputs: Positive[int] = 4
    """Views that go into a memory at most; each batch has from one to so many, or to as many as its episodes have."""
    targets: Positive[int] = 2
    """Views that are predicted from it; fewer in a batch with an episode that has too few."""
    around: Around = "fixated"
    """Where the grid stands: around what the cameras look at, or around the middle of what they have seen."""
    pixel_loss: PixelLoss = "l1"
    """Of GRNN's pictures."""
    contrast: Contrast = "info_nce"
    """Of C-N3D's features: cross entropy over all negatives, or the paper's "margin", which learns more slowly."""
    margin: Positive[float] = 0.8
    """Distance of features of length 1 up to which they belong together."""
    temperature: Positive[float] = 0.07
    """Of ``info_nce``."""
    hard_negatives: Positive[int] = 32
    """Nearest negatives that count with "margin", of each pair."""
    pairs: Positive[int] = 1024
    """Pixels, and voxels, of a batch that are compared."""
