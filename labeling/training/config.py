"""Settings that all trainings share."""

from dataclasses import dataclass

from labeling.runtime.ranges import NonNegative, Positive, Settings


@dataclass(frozen=True)
class TrainingConfig(Settings):
    """How long and how fast a network learns."""

    iterations: Positive[int] = 1000
    """Batches at most."""
    batch_size: Positive[int] = 2
    """Samples in a batch."""
    learning_rate: Positive[float] = 1e-3
    """The highest of its schedule."""
    validate_every: Positive[int] = 500
    """Batches between validations."""
    seed: NonNegative[int] = 0
