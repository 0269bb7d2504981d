"""Settings that all trainings share, and the names of the files in their folders."""

from dataclasses import dataclass

from labeling.runtime.ranges import Positive, Seed, Settings

WEIGHTS_FILE = "detector.safetensors"
"""The best network, with its spec in the header."""
CHECKPOINT_FILE = "checkpoint.pt"
"""What a killed run goes on from."""
HISTORY_FILE = "history.json"
"""Losses and validation figures, one record for each validation."""
CONFIG_FILE = "train.json"
"""Settings, data and versions."""
RESULTS_FILE = "results.json"
"""Figures before and after."""


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
    seed: Seed = 0
