"""Settings of fine-tuning."""

from dataclasses import dataclass
from typing import Literal

from labeling.runtime.ranges import NonNegative, Positive, ShareBelowOne
from labeling.training.config import TrainingConfig


@dataclass(frozen=True)
class FinetuneConfig(TrainingConfig):
    """How a Mask R-CNN is fine-tuned."""

    iterations: Positive[int] = 4000
    batch_size: Positive[int] = 2
    """Pictures a batch. Source: thesis 5.1.3."""
    learning_rate: Positive[float] = 1e-3
    """Source: thesis 5.1.3."""
    new_rate: Positive[float] = 10.0
    """Learning rate of the last layers of the heads, relative to that of all others, while they learn categories that
    they had no output for."""
    optimizer: Literal["sgd", "adamw"] = "sgd"
    """SGD with momentum .9, as Mask R-CNN is trained; AdamW suits training from the start."""
    weight_decay: NonNegative[float] = 1e-4
    schedule: Literal["constant", "cosine"] = "constant"
    """Learning rate after the warm-up; cosine falls to a hundredth of it."""
    warmup: NonNegative[int] = 200
    """Batches over which the learning rate rises."""
    clip: Positive[float] = 10.0
    """Largest norm of the gradient."""
    frozen_statistics: bool = True
    """Keep the statistics of batch normalisation; small batches want it."""
    frozen_stages: NonNegative[int] = 0
    """So many parts of the trunk, from the pictures on, keep their weights; cheaper, and less is forgotten."""
    average: ShareBelowOne[float] = 0.0
    """Decay per batch of a running average of the weights, which is what is validated and kept (.998 averages over 500
    batches); 0 keeps the weights themselves."""
    patience: NonNegative[int] = 5
    """Validations without a better AP50 after which training stops; 0: never."""
    replay_share: ShareBelowOne[float] = 0.5
    """Share of the samples that are replayed source pictures, if there are any."""
    repeat_threshold: ShareBelowOne[float] = 0.0
    """Pictures of categories that are in a smaller share of all pictures come more often, so that a rare category is
    learnt, too; 0: all pictures come as often. Source: repeat factor sampling, Gupta et al. 2019 (LVIS)."""
    workers: NonNegative[int] = 0
    """Processes that read and augment pictures."""
