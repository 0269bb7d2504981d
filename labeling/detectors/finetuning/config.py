"""Settings of fine-tuning."""

from dataclasses import dataclass
from typing import Literal

from labeling.runtime.ranges import NonNegative, Positive, PositiveShare, ShareBelowOne
from labeling.training.config import TrainingConfig


@dataclass(frozen=True)
class FinetuneConfig(TrainingConfig):
    """How a Mask R-CNN is fine-tuned; ``presets`` has the thesis' settings."""

    iterations: Positive[int] = 720
    """Batches at most. AP50 on the pictures to choose by, of ``compact`` with ground truth and photographs replayed,
    was 69.2 after 240, 74.7 after 480, 75.6 after 720 (one seed)."""
    batch_size: Positive[int] = 8
    """Pictures a batch."""
    learning_rate: Positive[float] = 3e-4
    """The highest of its schedule."""
    validate_every: Positive[int] = 240
    new_rate: Positive[float] = 10.0
    """Learning rate of the last layers of the heads, relative to that of all others, while they learn categories that
    they had no output for."""
    optimizer: Literal["sgd", "adamw"] = "adamw"
    """AdamW, as ``compact`` was pre-trained, or SGD with momentum .9, as Mask R-CNN was."""
    weight_decay: NonNegative[float] = 0.01
    schedule: Literal["constant", "cosine"] = "cosine"
    """Learning rate after the warm-up; cosine falls to a hundredth of it."""
    warmup: NonNegative[int] = 20
    """Batches over which the learning rate rises."""
    clip: Positive[float] = 10.0
    """Largest norm of the gradient."""
    frozen_statistics: bool = True
    """Keep the statistics of batch normalisation; small batches want it."""
    frozen_stages: NonNegative[int] = 4
    """So many parts of the trunk, from the pictures on, keep their weights; cheaper, and less is forgotten."""
    average: ShareBelowOne[float] = 0.97
    """Decay per batch of a running average of the weights, which is what is validated and kept (.97 averages over 33
    batches); 0 keeps the weights themselves."""
    interpolate: PositiveShare[float] = 0.7
    """Where the network that is validated and kept lies between the one that training starts from (0) and the one that
    it makes (1), in its weights: less is forgotten. Where new categories are learnt, it is the latter. Source: WiSE-FT,
    Wortsman et al., "Robust fine-tuning of zero-shot models" (2022)."""
    patience: NonNegative[int] = 5
    """Validations without a better AP50 after which training stops; 0: never."""
    replay_share: ShareBelowOne[float] = 0.5
    """Share of the samples that are replayed source pictures, if there are any."""
    repeat_threshold: ShareBelowOne[float] = 0.5
    """Pictures of categories that are in a smaller share of all pictures come more often, so that a rare category is
    learnt, too; 0: all pictures come as often. Source: repeat factor sampling, Gupta et al. 2019 (LVIS)."""
    trust_scores: bool = False
    """Learn that labels are there only as surely as their scores say: one of score s is to be found with a confidence
    of s. Otherwise those that are learnt from are there for sure. Their boxes and masks count by their scores, which
    are expected IoUs, in both cases."""
    workers: NonNegative[int] = 0
    """Processes that read and augment pictures."""
