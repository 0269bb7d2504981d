"""What a frustum PointNet is trained by. Source: Qi et al. 2018, equation 2 and appendix; weights as published."""

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from labeling.detectors3d.frustum_pointnet import FrustumNet, FrustumOutput, bin_to_heading, heading_to_bin
from labeling.detectors3d.upright_boxes import HALF_TURN

RESIDUALS, CORNERS = 20.0, 10.0
"""Weights of residuals and of the corner loss. Source: the paper's published code."""


@dataclass(frozen=True)
class FrustumBatch:
    """Frustums and what is true of them."""

    points: Tensor
    """(b, n, 3)"""
    category: Tensor
    """(b,)"""
    foreground: Tensor
    """(b, n): 1 for points of the object."""
    boxes: Tensor
    """(b, 7): as ``labeling.detectors3d.upright_boxes`` writes them."""
    weights: Tensor
    """(b,): of each sample in the loss, in [0, 1]."""


def frustum_losses(network: FrustumNet, output: FrustumOutput, batch: FrustumBatch) -> dict[str, Tensor]:
    """The terms, weighted; their sum is the loss.

    Args:
        network: that made the output.
        output: of the batch's points.
        batch: what is true.
    """
    centre, sides, heading = batch.boxes[:, :3], batch.boxes[:, 3:6], batch.boxes[:, 6]
    rows = torch.arange(len(centre), device=centre.device)
    template = network.sizes_m[batch.category]
    heading_bin, heading_residual = heading_to_bin(heading)
    size_target = sides / template - 1
    size_found = output.size_residuals[rows, batch.category]
    heading_found = output.heading_residuals[rows, heading_bin]
    found = corners(output.centre, template * (1 + size_found), bin_to_heading(heading_bin, heading_found))
    apart = [(found - corners(centre, sides, heading + turn)).norm(dim=2).mean(dim=1) for turn in (0.0, HALF_TURN)]
    points = functional.binary_cross_entropy_with_logits(output.logits, batch.foreground, reduction="none")
    terms = {
        "points": points.mean(dim=1),
        "first_centre": _huber((output.first_centre - centre).norm(dim=1), 1.0),
        "centre": _huber((output.centre - centre).norm(dim=1), 2.0),
        "heading": functional.cross_entropy(output.heading_scores, heading_bin, reduction="none"),
        "size": functional.cross_entropy(output.size_scores, batch.category, reduction="none"),
        "heading_residual": RESIDUALS * _huber(heading_found - heading_residual, 1.0),
        "size_residual": RESIDUALS * _huber((size_found - size_target).norm(dim=1), 1.0),
        "corners": CORNERS * _huber(torch.minimum(*apart), 1.0),
    }
    total = batch.weights.sum().clamp(min=1e-6)
    return {name: (term * batch.weights).sum() / total for name, term in terms.items()}


def corners(centre: Tensor, sides: Tensor, heading: Tensor) -> Tensor:
    """Corners of upright boxes: (b, 8, 3), in the order of ``Box3d.corners``."""
    half = torch.tensor([-0.5, 0.5], dtype=centre.dtype, device=centre.device)
    signs = torch.cartesian_prod(half, half, half)
    local = signs[None] * sides[:, None]
    c, s = torch.cos(heading)[:, None], torch.sin(heading)[:, None]
    x, y, z = local.unbind(dim=2)
    return torch.stack([c * x - s * y, s * x + c * y, z], dim=2) + centre[:, None]


def _huber(error: Tensor, delta: float) -> Tensor:
    return functional.huber_loss(error, torch.zeros_like(error), reduction="none", delta=delta)
