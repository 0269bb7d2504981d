"""What each detection says about the voxels its view sees: safe foreground, safe background, or nothing."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Int32

from labeling.core.types import Detection
from labeling.generator.cloud.outliers import far_from_mean
from labeling.generator.cloud.voxel_cloud import Cloud
from labeling.generator.objects.mask_morphology import dilated, eroded
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
    rim: Int32[np.ndarray, "r"]
    """The part of the background nearest to the mask, from which hard examples are drawn."""


def mask_trimap(
    mask: Bool[np.ndarray, "h w"], erode: float, dilate: float
) -> tuple[Bool[np.ndarray, "h w"], Bool[np.ndarray, "h w"], Bool[np.ndarray, "h w"]]:
    """Safe foreground, safe background and the hard rim of the background of a mask.

    Args:
        mask: a detection.
        erode: width of the uncertain rim inside the mask, as a share of the square root of its pixels, at least 1 px.
        dilate: width of the uncertain rim outside the mask, likewise.

    Returns:
        ``(foreground, background, rim)``. Where erosion leaves nothing, the mask itself is the foreground. Outside the
        picture nothing is known, so a mask that touches the border is not eroded there.

    Source: thesis 4.3 (safe object mask and safe background mask).
    """
    import cv2

    size_px = float(np.sqrt(np.count_nonzero(mask)))
    inner, outer = max(1.0, erode * size_px), max(2.0, dilate * size_px)
    rim_px = outer + 0.25 * size_px + 2
    # Distances further out than the rim decide nothing, so they are measured around the mask only.
    window = _around(mask, int(rim_px) + 2)
    pixels = mask[window].astype(np.uint8)
    framed = np.pad(pixels, 1, mode="edge")
    to_edge = cv2.distanceTransform(framed, cv2.DIST_L2, 5)[1:-1, 1:-1]
    to_mask = cv2.distanceTransform(1 - pixels, cv2.DIST_L2, 5) if not pixels.all() else np.zeros(pixels.shape)
    foreground, background = np.zeros(mask.shape, bool), np.ones(mask.shape, bool)
    rim = np.zeros(mask.shape, bool)
    foreground[window] = mask[window] & (to_edge > inner)
    background[window] = to_mask > outer
    rim[window] = background[window] & (to_mask <= rim_px)
    return (foreground if foreground.any() else mask), background, rim


def _around(mask: Bool[np.ndarray, "h w"], margin_px: int) -> tuple[slice, slice]:
    """The window that holds a mask and a margin around it; the whole picture for an empty mask."""
    sides = []
    for axis in (1, 0):
        filled = np.flatnonzero(mask.any(axis=axis))
        first, last = (filled[0], filled[-1]) if len(filled) else (0, mask.shape[1 - axis])
        sides.append(slice(max(0, int(first) - margin_px), int(last) + 1 + margin_px))
    return sides[0], sides[1]


def trimap_widths(confidence: float, config: LabelConfig) -> tuple[float, float]:
    """Shares of a mask's size that its uncertain rim takes inside and outside: the less sure, the wider."""
    doubt = 1.0 - confidence
    return config.erode + config.erode_doubt * doubt, config.dilate + config.dilate_doubt * doubt


def detection_seeds(cloud: Cloud, detection: Detection, config: LabelConfig) -> DetectionSeeds:
    """Moves a detection into the cloud, without the outliers in space that a mask over an object's edge picks up."""
    seen, ranks = cloud.seen_in(detection.view_index)
    foreground, background, rim = mask_trimap(detection.mask, *trimap_widths(detection.confidence, config))
    if config.erosions is not None:
        foreground = eroded(detection.mask, config.erosions)
    if config.dilations is not None:
        background = ~dilated(detection.mask, config.dilations)
        rim = rim & background
    if detection.exact:
        foreground = detection.mask
    front, back, near = (seen[chosen] for chosen in split_voxels(ranks, foreground, background, rim, len(seen)))
    return DetectionSeeds(
        detection=detection,
        foreground=front[~_seed_outliers(cloud.points[front], config)],
        background=back,
        rim=near,
    )


def _seed_outliers(points: Float32[np.ndarray, "n 3"], config: LabelConfig) -> Bool[np.ndarray, "n"]:
    if config.seed_outliers == "off":
        return np.zeros(len(points), bool)
    return (outliers if config.seed_outliers == "median" else far_from_mean)(points, config.outlier_spread)


def outliers(points: Float32[np.ndarray, "n 3"], spread: float = 3.0) -> Bool[np.ndarray, "n"]:
    """Points further from the median than ``spread`` robust standard deviations.

    The published code used mean and standard deviation; the median and the median distance do the same without being
    moved by the outliers themselves (for a normal distribution in 3-D the median distance is 1.54 sigma).
    """
    if len(points) < 4:
        return np.zeros(len(points), bool)
    distance = np.linalg.norm(points - np.median(points, axis=0), axis=1)
    return distance > spread * np.median(distance) / 1.54 * np.sqrt(3.0)
