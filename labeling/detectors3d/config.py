"""Settings of training a frustum PointNet."""

from dataclasses import dataclass
from typing import Annotated

from labeling.runtime.ranges import NonNegative, Positive, Range, Settings, Share
from labeling.training.config import TrainingConfig


@dataclass(frozen=True)
class Train3dConfig(TrainingConfig):
    """How a frustum PointNet is trained."""

    iterations: Positive[int] = 10_000
    """Batches at most; training stops earlier when validation is flat."""
    batch_size: Annotated[int, Range("be 2 or more, as batches are normalised", lambda size: size >= 2)] = 32
    """Source: thesis 5.2.2."""
    learning_rate: Positive[float] = 1e-3
    """Of Adam; falls to a hundredth along a cosine. Source: thesis 5.2.2."""
    num_points: Positive[int] = 1024
    """Points of a frustum. Source: field notes."""
    width: Positive[float] = 1.0
    """Channels of every layer relative to the paper's; .5 makes a network for CPUs."""
    validate_every: Positive[int] = 250
    """Batches between validations."""
    patience: NonNegative[int] = 8
    """Validations without a better mean IoU after which training stops; 0: never."""
    least_confidence: Share[float] = 0.5
    """Labels below are not learnt from; a score is the IoU that a label is expected to have."""
    trust_scores: bool = True
    """Weight the labels that are left by their scores."""
    workers: NonNegative[int] = 0
    """Processes that prepare batches."""


@dataclass(frozen=True)
class Augment3dConfig(Settings):
    """How strongly frustums are changed while training; all zeros leave them as they are."""

    flip: Share[float] = 0.5
    """Probability of mirroring left and right."""
    box_shift: Share[float] = 0.1
    """The middle of the 2-D box moves by up to this share of its sides. Source: Qi et al. 2018, appendix."""
    box_scale: Share[float] = 0.1
    """Its sides change by up to this share. Source: the same."""
    range_shift: Share[float] = 0.1
    """The frustum moves along its axis by up to this share of its distance. Source: the same (there metres)."""
    noise_m: NonNegative[float] = 0.0
    """Standard deviation of Gaussian noise on every point."""


NO_AUGMENTATION_3D = Augment3dConfig(flip=0.0, box_shift=0.0, box_scale=0.0, range_shift=0.0)
