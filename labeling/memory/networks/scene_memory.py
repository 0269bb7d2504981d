"""The memory of a scene, and arithmetic with it."""

from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor


@dataclass(frozen=True)
class SceneMemory:
    """What is known of a batch of scenes."""

    features: Float[Tensor, "b c z y x"]
    occupied: Float[Tensor, "b 1 z y x"]
    """1 where a surface was seen."""

    def plus(self, other: "SceneMemory") -> "SceneMemory":
        """Voxel by voxel, as scene arithmetic has it (thesis 2.6)."""
        return SceneMemory(self.features + other.features, (self.occupied + other.occupied).clamp(0, 1))

    def minus(self, other: "SceneMemory") -> "SceneMemory":
        """Likewise without another scene."""
        return SceneMemory(self.features - other.features, (self.occupied - other.occupied).clamp(0, 1))
