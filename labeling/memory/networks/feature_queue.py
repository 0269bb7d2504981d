"""Features of earlier batches, to contrast with: a ring that is part of a network's state.

Source: He et al. 2020, "Momentum Contrast"; without the slow encoder, as batches here are a second apart.
"""

import torch
from jaxtyping import Float
from torch import Tensor, nn


class FeatureQueue(nn.Module):
    """The last ``size`` features that were pushed."""

    features: Float[Tensor, "q e"]
    pushed: Tensor
    """How many there ever were."""

    def __init__(self, size: int, embedding: int) -> None:
        super().__init__()
        self.register_buffer("features", torch.zeros(size, embedding))
        self.register_buffer("pushed", torch.zeros((), dtype=torch.long))

    def held(self) -> Float[Tensor, "n e"]:
        """All that is there, in no particular order; no gradients reach it."""
        return self.features[: min(int(self.pushed), len(self.features))].clone()

    @torch.no_grad()
    def push(self, new: Float[Tensor, "n e"]) -> None:
        """Takes features in; the oldest leave."""
        size = len(self.features)
        new = new[-size:]
        places = (int(self.pushed) + torch.arange(len(new), device=new.device)) % size
        self.features[places] = new
        self.pushed += len(new)
