"""The memory of a scene, and arithmetic with it."""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor


@dataclass(frozen=True)
class SceneMemory:
    """What is known of a batch of scenes."""

    features: Float[Tensor, "b c z y x"]
    occupied: Float[Tensor, "b 1 z y x"]
    """1 where a surface was seen."""
    seen: Float[Tensor, "b 1 z y x"]
    """1 where any view knows whether there is something. Elsewhere features are imagined."""

    def plus(self, other: "SceneMemory") -> "SceneMemory":
        """Voxel by voxel, as scene arithmetic has it (thesis 2.6)."""
        occupied, seen = self.occupied + other.occupied, torch.maximum(self.seen, other.seen)
        return SceneMemory(self.features + other.features, occupied.clamp(0, 1), seen)

    def minus(self, other: "SceneMemory") -> "SceneMemory":
        """Likewise without another scene."""
        occupied, seen = self.occupied - other.occupied, torch.maximum(self.seen, other.seen)
        return SceneMemory(self.features - other.features, occupied.clamp(0, 1), seen)
