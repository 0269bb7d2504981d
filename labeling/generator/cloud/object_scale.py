"""Lengths that the settings are multiplied with: how large the objects are and how finely the views sample them."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float32

from labeling.core.episode_labels import Scale
from labeling.core.types import Detection
from labeling.core.views import RgbdViews
from labeling.generator.settings.label_config import LabelConfig


def measure_scale(detections: Sequence[Detection], views: RgbdViews, max_range_m: float = np.inf) -> Scale | None:
    """Measures object size and pixel footprint; None if no detection covers a pixel with usable depth.

    Args:
        detections: of these views.
        views: the views.
        max_range_m: depth beyond this counts as no return.
    """
    sizes, footprints = [], []
    for detection in detections:
        view = detection.view_index
        depth_m = np.where(views.depth_m[view] <= max_range_m, views.depth_m[view], 0)
        median_m = median_depth_m(detection.mask, depth_m)
        if median_m > 0:
            footprint = median_m / np.sqrt(views.intrinsics[view, 0, 0] * views.intrinsics[view, 1, 1])
            footprints.append(footprint)
            sizes.append(np.sqrt(np.count_nonzero(detection.mask)) * footprint)
    if not sizes:
        return None
    return Scale(float(np.median(sizes)), float(np.median(footprints)))


def median_depth_m(mask: Bool[np.ndarray, "h w"], depth_m: Float32[np.ndarray, "h w"]) -> float:
    """Median depth of the pixels of a mask that have a return; 0 if none has."""
    depths = depth_m[mask & (depth_m > 0)]
    return float(np.median(depths)) if len(depths) else 0.0


def voxel_edge_m(scale: Scale, config: LabelConfig) -> float:
    """Edge of a voxel: a share of the object size, but not finer than the views sample."""
    return config.voxel_m or max(config.voxel_share * scale.object_m, 1.5 * scale.pixel_m)
