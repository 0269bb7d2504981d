"""Convolutional gated recurrent units in 2-D and 3-D: GRNN's update of its memory.

Source: Cho et al. 2014, convolutional as in Ballas et al. 2016; Tung et al. 2019, "Recurrent map update"; thesis 2.1.1.
"""

from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor, nn

from labeling.memory.networks.blocks import Conv3d


class ConvGru(nn.Module):
    """One cell.

    Args of the constructor: channels of input and state, 2 or 3 dimensions, and the width of the kernels.
    """

    def __init__(self, inputs: int, state: int, dimensions: Literal[2, 3], kernel: int = 3) -> None:
        super().__init__()
        convolution = Conv3d if dimensions == 3 else nn.Conv2d
        self.gates = convolution(inputs + state, 2 * state, kernel, padding=kernel // 2)
        self.candidate = convolution(inputs + state, state, kernel, padding=kernel // 2)

    def forward(self, new: Float[Tensor, "b c *grid"], state: Float[Tensor, "b s *grid"]) -> Float[Tensor, "b s *grid"]:
        """The state after one more input: between the state before and a candidate, as far as the gate lets it."""
        update, reset = self.gates(torch.cat([new, state], dim=1)).sigmoid().chunk(2, dim=1)
        candidate = torch.tanh(self.candidate(torch.cat([new, reset * state], dim=1)))
        return (1 - update) * state + update * candidate
