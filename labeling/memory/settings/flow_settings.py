"""Settings of flow on memories: as a network, as its training takes them, and of finding what moves."""

from dataclasses import dataclass, field

from labeling.core.errors import UsageError
from labeling.memory.settings.box_settings import BOX_MODELS
from labeling.memory.settings.memory_spec import MemorySpec
from labeling.runtime.ranges import NonNegative, Positive
from labeling.training.config import TrainingConfig


@dataclass(frozen=True)
class FlowSpec:
    """Kind and size of a network that tells flow on a memory; written into its weights.

    Raises:
        UsageError: on construction, if it makes no sense.
    """

    memory: MemorySpec = field(default_factory=lambda: MemorySpec("cn3d"))
    width: int = 16
    """Channels of its layers."""

    def __post_init__(self) -> None:
        if self.memory.model not in BOX_MODELS:
            raise UsageError(
                f"flow is told of the volume of a memory, which {self.memory.model} does not have; take "
                f"{' or '.join(BOX_MODELS)}"
            )
        if not (4 <= self.width <= 1024 and self.width % 4 == 0):
            raise UsageError(f"the width of a flow network is a multiple of 4 up to 1024, not {self.width}")


@dataclass(frozen=True)
class TrainFlowConfig(TrainingConfig):
    """How a network learns flow on a memory."""

    iterations: Positive[int] = 3000
    """Batches."""
    batch_size: Positive[int] = 2
    """Pairs of views in a batch."""
    learning_rate: Positive[float] = 1e-3
    """Of Adam; falls to a hundredth along a cosine."""
    validate_every: Positive[int] = 250
    """Batches between validations."""
    width: Positive[int] = 16
    """Channels of the network's layers. Of 16 and 32 torch makes more on a CPU than of numbers between them."""
    pieces: Positive[int] = 3
    """Pieces of a scene that are moved at most."""
    furthest_m: Positive[float] = 0.45
    """How far a piece is moved at most; at least 3 cm, and by little as often as by much."""
    furthest_turn_deg: NonNegative[float] = 12.0
    """How far it is turned about the vertical at most."""
    matching: NonNegative[float] = 0.1
    """Weight of the loss that compares features with those where their flow ends."""
