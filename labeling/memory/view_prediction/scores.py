"""How good predicted views are: L1, PSNR, SSIM, and retrieval."""

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn import functional

SSIM_WINDOW, SSIM_SIGMA = 11, 1.5
SSIM_C1, SSIM_C2 = 0.01**2, 0.03**2


def l1(predicted: Float[Tensor, "n 3 h w"], rgb: Float[Tensor, "n 3 h w"]) -> Float[Tensor, "n"]:
    """Mean absolute difference of each picture, colours in [0, 1]."""
    return (predicted - rgb).abs().flatten(1).mean(dim=1)


def psnr(predicted: Float[Tensor, "n 3 h w"], rgb: Float[Tensor, "n 3 h w"]) -> Float[Tensor, "n"]:
    """Peak signal-to-noise ratio of each picture, decibels; at most 100."""
    error = (predicted - rgb).square().flatten(1).mean(dim=1)
    return -10 * torch.log10(error.clamp(min=1e-10))


def ssim(predicted: Float[Tensor, "n 3 h w"], rgb: Float[Tensor, "n 3 h w"]) -> Float[Tensor, "n"]:
    """Structural similarity of each picture, mean over channels and over pixels with a whole window.

    Source: Wang et al. 2004; a Gaussian window of 11 pixels with a standard deviation of 1.5.
    """
    offsets = torch.arange(SSIM_WINDOW, dtype=predicted.dtype, device=predicted.device) - SSIM_WINDOW // 2
    line = torch.exp(-0.5 * (offsets / SSIM_SIGMA) ** 2)
    line = line / line.sum()
    kernel = torch.outer(line, line)[None, None]

    def blurred(maps: Tensor) -> Tensor:
        return functional.conv2d(maps.flatten(0, 1)[:, None], kernel)

    mean_a, mean_b = blurred(predicted), blurred(rgb)
    var_a, var_b = blurred(predicted**2) - mean_a**2, blurred(rgb**2) - mean_b**2
    covariance = blurred(predicted * rgb) - mean_a * mean_b
    top = (2 * mean_a * mean_b + SSIM_C1) * (2 * covariance + SSIM_C2)
    below = (mean_a**2 + mean_b**2 + SSIM_C1) * (var_a + var_b + SSIM_C2)
    return (top / below).reshape(len(predicted), -1).mean(dim=1)


def picture_distances(predicted: Float[Tensor, "n c h w"], true: Float[Tensor, "m c h w"]) -> Float[np.ndarray, "n m"]:
    """Mean absolute difference of every predicted picture (or map of features) and every true one."""
    return torch.stack([(one[None] - true).abs().flatten(1).mean(dim=1) for one in predicted]).cpu().numpy()


def retrieved(distances: Float[np.ndarray, "n m"]) -> Bool[np.ndarray, "n"]:
    """Whether the nearest of all true ones is the right one: row i belongs to column i. Chance is 1 in m."""
    return distances.argmin(axis=1) == np.arange(len(distances))
