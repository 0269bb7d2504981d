"""Kind and size of a memory: as a network, and as commands take it."""

from dataclasses import dataclass, field
from typing import Literal, Protocol, runtime_checkable

from labeling.core.errors import UsageError
from labeling.memory.settings.grid_spec import GridSpec

Model = Literal["grnn", "cn3d", "tower"]
MODELS: tuple[Model, ...] = ("grnn", "cn3d", "tower")


@dataclass(frozen=True)
class MemorySpec:
    """Kind and size of a network; written into its weights.

    Raises:
        UsageError: on construction, if a size makes no sense.
    """

    model: Model = "grnn"
    grid: GridSpec = field(default_factory=GridSpec)
    channels: int = 16
    """Of the memory."""
    planes: int = 24
    """Of depth, along which the memory is projected into views."""
    width: int = 48
    """Channels of the decoder."""
    embedding: int = 32
    """Numbers of a feature that C-N3D compares."""
    size: tuple[int, int] = (64, 64)
    """Height and width of pictures."""

    def __post_init__(self) -> None:
        counts = (self.channels, self.planes, self.width, self.embedding)
        if self.model not in MODELS or not all(4 <= one <= 1024 and one % 4 == 0 for one in counts):
            raise UsageError(
                f"a memory is one of {', '.join(MODELS)}, with multiples of 4 up to 1024 for channels, planes, width "
                f"and embedding, not {self}"
            )
        if not all(16 <= one <= 1024 and one % 8 == 0 for one in self.size):
            raise UsageError(f"pictures must have sides of 16 to 1024 pixels that 8 divides, not {self.size}")


@runtime_checkable
class SceneSize(Protocol):
    """What views are made to fit: all that scenes need to know of a memory, whatever its kind."""

    @property
    def grid(self) -> GridSpec:
        """Of the memory."""
        ...

    @property
    def size(self) -> tuple[int, int]:
        """Height and width of pictures."""
        ...


@dataclass(frozen=True)
class MemorySize:
    """Size of a memory and of what it is shown; a ``SceneSize``."""

    voxels: tuple[int, int, int] = (32, 32, 16)
    """Of the grid, along x, y, z. 64 64 32 wants a GPU."""
    voxel_m: float = 0.16
    """Edge of a voxel; the grid is voxels times as long."""
    channels: int = 16
    """Numbers that a voxel holds."""
    planes: int = 24
    """Of depth, along which views are read from the memory."""
    width: int = 48
    """Channels of the decoder."""
    picture: tuple[int, int] = (64, 64)
    """Height and width that pictures are made."""

    def spec(self, model: Model) -> MemorySpec:
        """Of a network of this size.

        Raises:
            UsageError: if it makes no sense.
        """
        return MemorySpec(model, self.grid, self.channels, self.planes, self.width, size=self.picture)

    @property
    def grid(self) -> GridSpec:
        """The grid.

        Raises:
            UsageError: if it makes no sense.
        """
        x, y, z = self.voxels
        return GridSpec((z, y, x), self.voxel_m)

    @property
    def size(self) -> tuple[int, int]:
        """Height and width of pictures."""
        return self.picture
