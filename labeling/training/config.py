"""Settings that all trainings share."""

from dataclasses import dataclass

from labeling.runtime.ranges import NonNegative, Positive, check_ranges


@dataclass(frozen=True)
class TrainingConfig:
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

    def check(self) -> None:
        """Refuses settings that make no sense.

        Raises:
            UsageError: naming the setting.
        """
        check_ranges(self)
