"""Seeds of a segment: what a detection says about the voxels of its view, foreground, background or nothing."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Int32

from labeling.core.types import Detection
from labeling.generator.cloud.outliers import far_from_mean
from labeling.generator.cloud.voxel_cloud import Cloud
from labeling.generator.objects.voxel_votes import split_voxels
from labeling.generator.settings.label_config import LabelConfig


@dataclass(frozen=True)
class DetectionSeeds:
    """One detection, moved into the cloud."""

    detection: Detection
    foreground: Int32[np.ndarray, "f"]
    """Voxels whose pixels lie mostly in the eroded mask, rising."""
    background: Int32[np.ndarray, "b"]
    """Voxels whose pixels lie mostly outside the dilated mask, rising."""
    hard_negatives: Int32[np.ndarray, "r"]
    """Voxels of any pixel in the part of the background nearest to the mask, rising."""


def mask_trimap(
    mask: Bool[np.ndarray, "h w"], erode: float, dilate: float
) -> tuple[Bool[np.ndarray, "h w"], Bool[np.ndarray, "h w"], Bool[np.ndarray, "h w"]]:
    """The trimap of a mask: safe foreground, safe background, unknown between; and the background next to the unknown.

    Args:
        mask: a detection.
        erode: width of the unknown inside the mask, as a share of the square root of its pixels, at least 1 px.
        dilate: width of the unknown outside the mask, likewise, at least 2 px.

    Returns:
        ``(foreground, background, hard_negatives)``, the last a part of the second. Where erosion leaves nothing, the
        mask itself is the foreground. Outside the picture nothing is known, so a mask that touches the
        border is not eroded there.

    Source: thesis 4.3 (safe object mask and safe background mask).
    """
    import cv2

    size_px = float(np.sqrt(np.count_nonzero(mask)))
    inner, outer = max(1.0, erode * size_px), max(2.0, dilate * size_px)
    hard_px = outer + 0.25 * size_px + 2
    # Greater distances decide nothing, so they are measured around the mask only.
    window = _around(mask, int(hard_px) + 2)
    pixels = mask[window].astype(np.uint8)
    framed = np.pad(pixels, 1, mode="edge")
    to_edge = cv2.distanceTransform(framed, cv2.DIST_L2, 5)[1:-1, 1:-1]
    to_mask = cv2.distanceTransform(1 - pixels, cv2.DIST_L2, 5) if not pixels.all() else np.zeros(pixels.shape)
    foreground, background = np.zeros(mask.shape, bool), np.ones(mask.shape, bool)
    hard_negatives = np.zeros(mask.shape, bool)
    foreground[window] = mask[window] & (to_edge > inner)
    background[window] = to_mask > outer
    hard_negatives[window] = background[window] & (to_mask <= hard_px)
    return (foreground if foreground.any() else mask), background, hard_negatives


def _around(mask: Bool[np.ndarray, "h w"], margin_px: int) -> tuple[slice, slice]:
    """The window that holds a mask and a margin around it; the whole picture for an empty mask."""
    sides = []
    for axis in (1, 0):
        filled = np.flatnonzero(mask.any(axis=axis))
        first, last = (filled[0], filled[-1]) if len(filled) else (0, mask.shape[1 - axis])
        sides.append(slice(max(0, int(first) - margin_px), int(last) + 1 + margin_px))
    return sides[0], sides[1]


def trimap_widths(confidence: float, config: LabelConfig) -> tuple[float, float]:
    """Shares of a mask's size that are unknown inside and outside of it: the less confident, the wider."""
    return (
        config.erode + config.erode_doubt * (1.0 - confidence),
        config.dilate + config.dilate_doubt * (1.0 - confidence),
    )


def detection_seeds(cloud: Cloud, detection: Detection, config: LabelConfig) -> DetectionSeeds:
    """Moves a detection into the cloud, without the outliers in space that a mask over an object's edge picks up."""
    visible, ranks = cloud.voxels_of_view(detection.view_index)
    foreground, background, hard = mask_trimap(detection.mask, *trimap_widths(detection.confidence, config))
    if config.erosions is not None:
        foreground = eroded(detection.mask, config.erosions)
    if config.dilations is not None:
        background = ~dilated(detection.mask, config.dilations)
        hard = hard & background
    if detection.exact:
        foreground = detection.mask
    inside, outside, near = (
        visible[chosen] for chosen in split_voxels(ranks, foreground, background, hard, len(visible))
    )
    return DetectionSeeds(detection, inside[~_seed_outliers(cloud.points[inside], config)], outside, near)


def _seed_outliers(points: Float32[np.ndarray, "n 3"], config: LabelConfig) -> Bool[np.ndarray, "n"]:
    """Points that are no seeds, by the rule of ``config.seed_outliers``."""
    if config.seed_outliers == "off":
        return np.zeros(len(points), bool)
    return (far_from_median if config.seed_outliers == "median" else far_from_mean)(points, config.outlier_spread)


def far_from_median(points: Float32[np.ndarray, "n 3"], spread: float = 3.0) -> Bool[np.ndarray, "n"]:
    """Points further from the median than ``spread`` robust standard deviations.

    The published code used mean and standard deviation; the median and the median distance do the same without being
    moved by the outliers themselves (for a normal distribution in 3-D the median distance is 1.54 sigma).
    """
    if len(points) < 4:
        return np.zeros(len(points), bool)
    distance = np.linalg.norm(points - np.median(points, axis=0), axis=1)
    return distance > spread * np.median(distance) / 1.54 * np.sqrt(3.0)


def eroded(mask: Bool[np.ndarray, "h w"], times: int) -> Bool[np.ndarray, "h w"]:
    """The mask eroded by 3x3 pixels so many times; the mask itself where nothing would be left."""
    import cv2

    inner = cv2.erode(mask.astype(np.uint8), np.ones((3, 3), np.uint8), iterations=times) > 0 if times else mask
    return inner if inner.any() else mask


def dilated(mask: Bool[np.ndarray, "h w"], times: int) -> Bool[np.ndarray, "h w"]:
    """The mask dilated by 3x3 pixels so many times."""
    import cv2

    return cv2.dilate(mask.astype(np.uint8), np.ones((3, 3), np.uint8), iterations=times) > 0 if times else mask
