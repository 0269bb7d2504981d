"""Pictures of predictions: rows of views, one above the other, and features as colours."""

from collections.abc import Sequence

import cv2
import numpy as np
import torch
from jaxtyping import Float, UInt8

GAP_PX, TITLE_PX = 4, 18
"""Between pictures, and height of the line above each row."""
INK, PAPER = (60, 60, 60), 255


def to_bytes(rgb: Float[torch.Tensor, "n 3 h w"]) -> UInt8[np.ndarray, "n h w 3"]:
    """Colours in [0, 1] as pictures."""
    return (rgb.clamp(0, 1) * 255).round().byte().permute(0, 2, 3, 1).cpu().numpy()


def draw_rows(
    rows: Sequence[tuple[str, UInt8[np.ndarray, "n _ _ 3"]]], height_px: int = 128
) -> UInt8[np.ndarray, "height width 3"]:
    """Rows of pictures, each below its title.

    Args:
        rows: title and pictures; all rows have equally many.
        height_px: that all pictures are enlarged to.
    """
    drawn = []
    for title, pictures in rows:
        width_px = round(height_px * pictures.shape[2] / pictures.shape[1])
        tiles = [cv2.resize(one, (width_px, height_px), interpolation=cv2.INTER_NEAREST) for one in pictures]
        gap = np.full((height_px, GAP_PX, 3), PAPER, np.uint8)
        line = np.concatenate([part for tile in tiles for part in (tile, gap)][:-1], axis=1)
        head = np.full((TITLE_PX, line.shape[1], 3), PAPER, np.uint8)
        cv2.putText(head, title, (2, TITLE_PX - 5), cv2.FONT_HERSHEY_SIMPLEX, 0.42, INK, 1, cv2.LINE_AA)
        drawn += [head, line]
    return np.concatenate(drawn, axis=0)


def feature_colours(
    *maps: Float[torch.Tensor, "n e h w"],
) -> list[UInt8[np.ndarray, "n h w 3"]]:
    """Maps of features as colours: their three principal components over all maps."""
    flat = torch.cat([one.movedim(1, -1).flatten(0, 2) for one in maps]).cpu().double()
    mean = flat.mean(dim=0)
    _, _, axes = torch.linalg.svd(flat - mean, full_matrices=False)
    values = (flat - mean) @ axes[:3].T
    low, high = values.quantile(0.02, dim=0), values.quantile(0.98, dim=0)
    found = []
    for one in maps:
        shares = ((one.movedim(1, -1).cpu().double() - mean) @ axes[:3].T - low) / (high - low).clamp(min=1e-9)
        found.append((shares.clamp(0, 1) * 255).round().byte().numpy())
    return found
