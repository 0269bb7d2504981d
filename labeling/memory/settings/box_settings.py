"""Settings of 3-D detection on a memory: as a network, as its training takes them, and as commands take them."""

from dataclasses import dataclass, field

from labeling.core.errors import UsageError
from labeling.memory.settings.grid_spec import Around
from labeling.memory.settings.memory_spec import MemorySize, MemorySpec, Model
from labeling.runtime.ranges import NonNegative, Positive, Settings
from labeling.training.config import TrainingConfig

BOX_MODELS: tuple[Model, ...] = ("grnn", "cn3d")
"""Memories that hold a volume."""


@dataclass(frozen=True)
class BoxSpec:
    """Kind and size of a network that finds boxes in a memory; written into its weights.

    Raises:
        UsageError: on construction, if it makes no sense.
    """

    categories: tuple[str, ...]
    memory: MemorySpec = field(default_factory=MemorySpec)
    views: int = 8
    """That went into a memory at most when it was trained."""
    around: Around = "fixated"
    """Where the grid stood."""

    def __post_init__(self) -> None:
        if self.memory.model not in BOX_MODELS:
            raise UsageError(
                f"boxes are found in the volume of a memory, which {self.memory.model} does not have; take "
                f"{' or '.join(BOX_MODELS)}"
            )
        if not self.categories or len(set(self.categories)) < len(self.categories):
            raise UsageError("a network must know at least one category, and each once")
        if not 1 <= self.views <= 1000:
            raise UsageError(f"1 to 1000 views go into a memory, not {self.views}")


@dataclass(frozen=True)
class TrainBoxesConfig(TrainingConfig):
    """How a network learns to find boxes in a memory."""

    iterations: Positive[int] = 4000
    """Batches at most; training stops earlier when validation is flat."""
    batch_size: Positive[int] = 2
    """Scenes in a batch."""
    learning_rate: Positive[float] = 1e-3
    """Of Adam; falls to a hundredth along a cosine."""
    validate_every: Positive[int] = 250
    """Batches between validations."""
    views: Positive[int] = 8
    """Views that go into a memory at most; each batch has from one to so many, or to as many as its scenes have."""
    around: Around = "fixated"
    """Where the grid stands."""
    patience: NonNegative[int] = 8
    """Validations without a better AP after which training stops; 0: never."""
    trust_scores: bool = True
    """Weight every label by its score."""
    workers: NonNegative[int] = 0
    """Processes that prepare batches."""


@dataclass(frozen=True)
class MemoryBoxOptions(Settings):
    """3-D detection on a memory, as ``labeling.train3d --memory`` takes it."""

    scenes: Positive[int] = 2
    """Episodes in a batch."""
    views: Positive[int] = 8
    """Views of an episode that go into the memory at most; each batch has from one to so many, or to as many as its
    episodes have that look at the grid."""
    around: Around | None = None
    """Where the grid stands: around what the cameras look at, or around the middle of what they have seen. By default
    the former; with a run as it stood there."""
    voxels: tuple[int, int, int] = MemorySize.voxels
    """Of the grid, along x, y, z; boxes whose middle lies outside are not found. Of --memory grnn or cn3d, as all that
    follow; a run has its own."""
    voxel_m: float = MemorySize.voxel_m
    """Edge of a voxel; the grid is voxels times as long."""
    channels: int = MemorySize.channels
    """Numbers that a voxel holds."""
    picture: tuple[int, int] = MemorySize.picture
    """Height and width that pictures are made."""

    def size(self) -> MemorySize:
        """Of a memory of random weights."""
        return MemorySize(self.voxels, self.voxel_m, self.channels, picture=self.picture)
