"""Settings of training and augmentation."""

from dataclasses import dataclass
from typing import Literal

from labeling.core.errors import UsageError


@dataclass(frozen=True)
class TrainConfig:
    """How a network is trained."""

    iterations: int = 4000
    """Batches at most."""
    batch_size: int = 2
    """Pictures a batch. Source: thesis 5.1.3."""
    learning_rate: float = 1e-3
    """Source: thesis 5.1.3."""
    new_rate: float = 10.0
    """Learning rate of the last layers of the heads, relative to that of all others, while they learn categories that
    they had no output for."""
    optimizer: Literal["sgd", "adamw"] = "sgd"
    """SGD with momentum .9, as Mask R-CNN is trained; AdamW suits training from the start."""
    weight_decay: float = 1e-4
    schedule: Literal["constant", "cosine"] = "constant"
    """Learning rate after the warm-up; cosine falls to a hundredth of it."""
    warmup: int = 200
    """Batches over which the learning rate rises."""
    clip: float = 10.0
    """Largest norm of the gradient."""
    frozen_statistics: bool = True
    """Keep the statistics of batch normalisation; small batches want it."""
    frozen_stages: int = 0
    """So many parts of the trunk, from the pictures on, keep their weights; cheaper, and less is forgotten."""
    average: float = 0.0
    """Decay per batch of a running average of the weights, which is what is validated and kept (.998 averages over 500
    batches); 0 keeps the weights themselves."""
    validate_every: int = 500
    """Batches between validations."""
    patience: int = 5
    """Validations without a better AP50 after which training stops; 0: never."""
    replay_share: float = 0.5
    """Share of the samples that are replayed source pictures, if there are any."""
    workers: int = 0
    """Processes that read and augment pictures."""
    seed: int = 0

    def check(self) -> None:
        """Refuses settings that make no sense.

        Raises:
            UsageError: naming the setting.
        """
        for name in ("iterations", "batch_size", "learning_rate", "new_rate", "clip", "validate_every"):
            if not 0 < getattr(self, name) < float("inf"):
                raise UsageError(f"--{name.replace('_', '-')} must be above 0, not {getattr(self, name)}")
        for name in ("weight_decay", "warmup", "patience", "workers", "frozen_stages", "seed"):
            if not 0 <= getattr(self, name) < float("inf"):
                raise UsageError(f"--{name.replace('_', '-')} must be 0 or more, not {getattr(self, name)}")
        for name in ("replay_share", "average"):
            if not 0 <= getattr(self, name) < 1:
                raise UsageError(
                    f"--{name.replace('_', '-')} must be at least 0 and below 1, not {getattr(self, name)}"
                )
