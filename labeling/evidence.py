"""What each detection says about the voxels its view sees: safe foreground, safe background, or nothing."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Int32

from labeling.instances import Detection
from labeling.label_config import LabelConfig
from labeling.pointcloud import Cloud


@dataclass(frozen=True)
class Evidence:
    """One detection, moved into the cloud."""

    detection: Detection
    foreground: Int32[np.ndarray, "f"]
    """Voxels whose pixels lie mostly in the eroded mask, rising."""
    background: Int32[np.ndarray, "b"]
    """Voxels whose pixels lie mostly outside the dilated mask, rising."""
    rim: Int32[np.ndarray, "r"]
    """The part of the background nearest to the mask, from which hard examples are drawn."""


def split_mask(
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
    pixels = mask.astype(np.uint8)
    to_edge = cv2.distanceTransform(np.pad(pixels, 1, mode="edge"), cv2.DIST_L2, 5)[1:-1, 1:-1]
    to_mask = cv2.distanceTransform(1 - pixels, cv2.DIST_L2, 5) if not mask.all() else np.zeros(mask.shape)
    foreground = mask & (to_edge > inner)
    background = to_mask > outer
    return (foreground if foreground.any() else mask), background, background & (to_mask <= outer + 0.25 * size_px + 2)


def gather_evidence(cloud: Cloud, detection: Detection, config: LabelConfig) -> Evidence:
    """Moves a detection into the cloud, without the outliers in space that a mask over an object's edge picks up."""
    voxels = cloud.voxel_of_pixel[detection.view_index]
    foreground, background, rim = split_mask(detection.mask, config.erode, config.dilate)
    if detection.exact:
        foreground = detection.mask
    seen = voxels >= 0
    inside = np.bincount(voxels[foreground & seen], minlength=1)
    outside = np.bincount(voxels[background & seen], minlength=1)
    total = np.bincount(voxels[seen], minlength=1)
    front = _majority(inside, total)
    return Evidence(
        detection=detection,
        foreground=front[~outliers(cloud.points[front])].astype(np.int32),
        background=_majority(outside, total).astype(np.int32),
        rim=np.unique(voxels[rim & seen]).astype(np.int32),
    )


def _majority(votes, total) -> np.ndarray:
    return np.flatnonzero(2 * votes > total[: len(votes)])


def outliers(points: Float32[np.ndarray, "n 3"], spread: float = 3.0) -> Bool[np.ndarray, "n"]:
    """Points further from the median than ``spread`` robust standard deviations.

    The published code used mean and standard deviation; the median and the median distance do the same without being
    moved by the outliers themselves (for a normal distribution in 3-D the median distance is 1.54 sigma).
    """
    if len(points) < 4:
        return np.zeros(len(points), bool)
    distance = np.linalg.norm(points - np.median(points, axis=0), axis=1)
    return distance > spread * np.median(distance) / 1.54 * np.sqrt(3.0)
