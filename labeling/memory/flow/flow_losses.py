"""Losses of flow: against made-up motion, and of features against those where their flow ends."""

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from labeling.memory.flow.flow_net import FlowOutput, Remembered
from labeling.memory.flow.moved_pieces import FlowTruth
from labeling.memory.flow.warping import warp_back
from labeling.memory.settings.grid_spec import GridSpec

MOVING_WEIGHT = 3.0
"""Of voxels that move in the cross entropy: they are few."""


def flow_losses(output: FlowOutput, truth: FlowTruth, grid: GridSpec) -> dict[str, Tensor]:
    """Of flow, in voxels: means over voxels that move and over those that stand, which weigh the same; and of what is
    said to move.

    Returns:
        ``flow`` and ``moves``; 0 where nothing is known.
    """
    error = (output.flow_m - truth.flow_m).abs().sum(dim=1, keepdim=True) / grid.voxel_m
    moving = truth.known * (truth.moves >= 0.5)
    parts = [(error * part).sum() / part.sum().clamp(min=1) for part in (moving, truth.known - moving)]
    weight = truth.known * (1 + (MOVING_WEIGHT - 1) * truth.moves)
    entropy = functional.binary_cross_entropy_with_logits(output.moves, truth.moves, reduction="none")
    return {"flow": parts[0] + parts[1], "moves": (entropy * weight).sum() / weight.sum().clamp(min=1)}


def matching_loss(
    before: Remembered, after: Remembered, flow_m: Float[Tensor, "b 3 z y x"], grid: GridSpec
) -> Float[Tensor, ""]:
    """How unlike surfaces are to what lies where their flow ends, as far as that has been seen.

    Likeness is the cosine of features, times how much of the place is occupied. Source: Harley et al. 2020, section
    3.3, "unsupervised temporal feature matching".
    """
    seen = after.occupied + after.free
    later = warp_back(torch.cat([after.features * after.occupied, after.occupied, seen], dim=1), flow_m, grid)
    features, occupied, seen = later[:, :-2], later[:, -2:-1], later[:, -1:]
    likeness = functional.cosine_similarity(before.features, features, dim=1)[:, None] * occupied
    weight = before.occupied * seen.detach()
    return ((1 - likeness) * weight).sum() / weight.sum().clamp(min=1)
