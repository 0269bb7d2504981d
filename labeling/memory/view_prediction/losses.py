"""Losses of predicted pictures, and of features that top-down and bottom-up ways should agree on."""

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn import functional

from labeling.memory.settings.train_config import PixelLoss


def pixel_loss(
    logits: Float[Tensor, "*n 3 h w"], rgb: Float[Tensor, "*n 3 h w"], kind: PixelLoss = "l1"
) -> Float[Tensor, ""]:
    """How far predicted colours are from true ones, in [0, 1].

    Args:
        logits: of colours.
        rgb: true colours in [0, 1].
        kind: mean absolute difference; or cross entropy, each channel the probability of light. Source: thesis 2.1.1.
    """
    if kind == "cross_entropy":
        return functional.binary_cross_entropy_with_logits(logits, rgb)
    return (logits.sigmoid() - rgb).abs().mean()


def margin_loss(
    top_down: Float[Tensor, "n e"],
    bottom_up: Float[Tensor, "n e"],
    margin: float,
    hard: int,
) -> Float[Tensor, ""]:
    """Pairs that belong together should be nearer than the margin, all others further away.

    ``mean max(d+ - margin, 0) + mean max(margin - d-, 0)`` with Euclidean distances of features of length 1.
    Source: Harley et al. 2020, equations 2 and 3; thesis 2.3.2.

    Args:
        top_down: features of pixels (or voxels) from memory.
        bottom_up: of the same ones from the view itself; each is a negative of all others.
        margin: distance.
        hard: how many negatives of each pair count: the nearest.
    """
    together = (top_down - bottom_up).square().sum(dim=1).clamp(min=1e-8).sqrt()
    apart = hardest(top_down, bottom_up, hard)
    return functional.relu(together - margin).mean() + functional.relu(margin - apart).mean()


def hardest(top_down: Float[Tensor, "n e"], bottom_up: Float[Tensor, "n e"], hard: int) -> Float[Tensor, "n k"]:
    """Distances to the nearest features that do not belong to each."""
    distances = _distances(top_down, bottom_up)
    own = torch.eye(len(top_down), device=top_down.device, dtype=torch.bool)
    count = max(1, min(hard, len(top_down) - 1))
    return distances.masked_fill(own, torch.inf).topk(count, dim=1, largest=False).values


def _distances(one: Tensor, other: Tensor) -> Tensor:
    """Euclidean, of features of length 1: (n, e), (m, e) -> (n, m)."""
    return (2 - 2 * one @ other.T).clamp(min=1e-6).sqrt()


def info_nce(top_down: Float[Tensor, "n e"], bottom_up: Float[Tensor, "n e"], temperature: float) -> Float[Tensor, ""]:
    """Cross entropy of finding the feature that belongs to each among all. Source: van den Oord et al. 2018.

    All are of the same batch. Features of earlier batches are no negatives: they come from weights that have changed
    since, so that what has changed tells them apart, and nothing else need be learnt (docs/neural-mapping.md).

    Args:
        top_down: features of pixels from memory, of length 1.
        bottom_up: of the same ones from the view itself.
        temperature: of the softmax over cosines.
    """
    logits = top_down @ bottom_up.T / temperature
    return functional.cross_entropy(logits, torch.arange(len(top_down), device=top_down.device))


def pick_places(allowed: Bool[Tensor, "n"], count: int, generator: torch.Generator) -> Tensor:
    """Indices of at most ``count`` places at random, of those that are allowed: (k,)."""
    places = allowed.nonzero()[:, 0]
    order = torch.randperm(len(places), generator=generator)[:count].to(places.device)
    return places[order]
