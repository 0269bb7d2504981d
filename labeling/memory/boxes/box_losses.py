"""Losses of heat maps, of what stands at their peaks, and of filled voxels."""

import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from labeling.memory.boxes.box_net import BoxOutput
from labeling.memory.boxes.box_targets import NEARLY_SQUARE, OFFSET, SIDES, YAW, BoxTargets, other_name

FOCUS, NEAR_PEAKS = 2, 4
"""Exponents of the focal loss: of what is told apart already, and of places near a peak. Source: Zhou et al. 2019."""


def heat_loss(
    logits: Float[Tensor, "b k y x"],
    heat: Float[Tensor, "b k y x"],
    known: Float[Tensor, "b k y x"],
    weight: Float[Tensor, "b 1 y x"],
) -> Float[Tensor, ""]:
    """Focal loss of heat maps, over the number of peaks (as heavy as they are).

    Source: Law and Deng 2018, equation 1, as in Zhou et al. 2019.
    """
    peak = (heat == 1).to(heat.dtype)
    found = logits.sigmoid()
    right = -functional.logsigmoid(logits) * (1 - found) ** FOCUS * peak * weight
    wrong = -functional.logsigmoid(-logits) * found**FOCUS * (1 - heat) ** NEAR_PEAKS * (1 - peak) * known
    return (right.sum() + wrong.sum()) / (peak * weight).sum().clamp(min=1)


def number_losses(numbers: Float[Tensor, "b 8 y x"], targets: BoxTargets) -> dict[str, Tensor]:
    """L1 of the numbers of boxes, in columns that answer for one; means over boxes, weighted.

    Sides and yaw of nearly square boxes are compared with the target under whichever of its two names is nearer.

    Returns:
        ``place`` (offsets and height), ``sides`` and ``yaw``.
    """
    weight = targets.weight[:, 0].flatten()
    chosen = weight > 0
    said, true = (maps.movedim(1, -1).flatten(0, 2)[chosen] for maps in (numbers, targets.numbers))
    weight = weight[chosen]
    sides_and_yaw = _apart(said, true)
    square = (true[:, 3] - true[:, 4]).abs() < torch.log(true.new_tensor(NEARLY_SQUARE))
    renamed = _apart(said, other_name(true))
    nearer = square & (renamed.sum(dim=1) < sides_and_yaw.sum(dim=1))
    sides_and_yaw = torch.where(nearer[:, None], renamed, sides_and_yaw)
    place = (said[:, OFFSET] - true[:, OFFSET]).abs().sum(dim=1) + (said[:, 2] - true[:, 2]).abs()
    total = weight.sum().clamp(min=1e-6)
    return {
        "place": (place * weight).sum() / total,
        "sides": (sides_and_yaw[:, 0] * weight).sum() / total,
        "yaw": (sides_and_yaw[:, 1] * weight).sum() / total,
    }


def _apart(said: Float[Tensor, "n 8"], true: Float[Tensor, "n 8"]) -> Float[Tensor, "n 2"]:
    """L1 of sides, and of yaw."""
    sides, yaw = ((said[:, part] - true[:, part]).abs().sum(dim=1) for part in (SIDES, YAW))
    return torch.stack([sides, yaw], dim=1)


def filled_loss(logits: Float[Tensor, "b 1 z y x"], filled: Float[Tensor, "b 1 z y x"]) -> Float[Tensor, ""]:
    """Cross entropy of voxels; those that are filled weigh as much as all that are not."""
    each = functional.binary_cross_entropy_with_logits(logits, filled, reduction="none")
    means = [(each * part).sum() / part.sum().clamp(min=1) for part in (filled, 1 - filled)]
    return 0.5 * (means[0] + means[1])


def box_losses(output: BoxOutput, targets: BoxTargets) -> dict[str, Tensor]:
    """All terms: ``heat``, ``place``, ``sides``, ``yaw``, ``filled``."""
    return {
        "heat": heat_loss(output.heat, targets.heat, targets.known, targets.weight),
        **number_losses(output.numbers, targets),
        "filled": filled_loss(output.filled, targets.filled),
    }
