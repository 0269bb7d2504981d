"""Seeds of a segment: what a detection says about the voxels of its view, foreground, background or nothing."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Int32, UInt8

from labeling.core.types import Detection
from labeling.core.views import Camera
from labeling.generator.cloud.ground import Ground, seeds_above_ground
from labeling.generator.cloud.moved import shows_moved
from labeling.generator.cloud.outliers import far_from_mean
from labeling.generator.cloud.voxel_cloud import Cloud, voxels_of_blind_view
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


@dataclass(frozen=True)
class Trimap:
    """What a mask says about the pixels in and around it; all others are background."""

    window: tuple[slice, slice]
    """Rows and columns."""
    side: UInt8[np.ndarray, "wh ww"]
    """A sum of 1 for safe foreground, 2 for safe background, 4 for the background next to the unknown."""

    def over(
        self, size: tuple[int, int]
    ) -> tuple[Bool[np.ndarray, "h w"], Bool[np.ndarray, "h w"], Bool[np.ndarray, "h w"]]:
        """Foreground, background and hard negatives over a picture of this height and width."""
        side = np.full(size, 2, np.uint8)
        side[self.window] = self.side
        return side & 1 > 0, side & 2 > 0, side & 4 > 0


def mask_trimap(mask: Bool[np.ndarray, "h w"], erode: float, dilate: float) -> Trimap:
    """The trimap of a mask: safe foreground, safe background, unknown between.

    Args:
        mask: a detection.
        erode: width of the unknown inside the mask, as a share of the square root of its pixels, at least 1 px.
        dilate: width of the unknown outside the mask, likewise, at least 2 px.

    Returns:
        It. Where erosion leaves nothing, the mask itself is the foreground. Outside the picture nothing is known, so a
        mask that touches the border is not eroded there.

    Source: thesis 4.3 (safe object mask and safe background mask).
    """
    import cv2

    size_px = float(np.sqrt(np.count_nonzero(mask)))
    inner, outer = max(1.0, erode * size_px), max(2.0, dilate * size_px)
    hard_px = outer + 0.25 * size_px + 2
    # Greater distances decide nothing, so they are measured around the mask only.
    window, near = _around(mask, int(hard_px) + 2), _around(mask, 1)
    pixels = mask[window].astype(np.uint8)
    within = tuple(slice(n.start - w.start, n.stop - w.start) for n, w in zip(near, window, strict=True))
    framed = cv2.copyMakeBorder(pixels[within], 1, 1, 1, 1, cv2.BORDER_REPLICATE)
    to_edge = cv2.distanceTransform(framed, cv2.DIST_L2, 5)[1:-1, 1:-1]
    side = np.zeros(pixels.shape, np.uint8)
    side[within] = to_edge > inner
    if not side.any():
        side[:] = pixels
    if not pixels.all():
        to_mask = cv2.distanceTransform(1 - pixels, cv2.DIST_L2, 5)
        side[to_mask > outer] = 2
        side[(to_mask > outer) & (to_mask <= hard_px)] = 6
    return Trimap(window, side)


def _around(mask: Bool[np.ndarray, "h w"], margin_px: int) -> tuple[slice, slice]:
    """The window that holds a mask and a margin around it; the whole picture for an empty mask."""
    import cv2

    left, top, width, height = cv2.boundingRect(np.ascontiguousarray(mask).view(np.uint8))
    if width == 0:
        return slice(0, mask.shape[0]), slice(0, mask.shape[1])
    return (
        slice(max(0, top - margin_px), min(mask.shape[0], top + height + margin_px)),
        slice(max(0, left - margin_px), min(mask.shape[1], left + width + margin_px)),
    )


def trimap_widths(confidence: float, config: LabelConfig) -> tuple[float, float]:
    """Shares of a mask's size that are unknown inside and outside of it: the less confident, the wider."""
    return (
        config.erode + config.erode_doubt * (1.0 - confidence),
        config.dilate + config.dilate_doubt * (1.0 - confidence),
    )


def detection_seeds(cloud: Cloud, detection: Detection, config: LabelConfig) -> DetectionSeeds:
    """Moves a detection into the cloud, without the outliers in space that a mask over an object's edge picks up."""
    trimap = detection_trimap(detection, config)
    return trimap_seeds(cloud, detection, trimap, config)


def detection_trimap(detection: Detection, config: LabelConfig) -> Trimap:
    """The trimap of a detection, by the settings."""
    trimap = mask_trimap(detection.mask, *trimap_widths(detection.confidence, config))
    if config.erosions is not None or config.dilations is not None:
        height_px, width_px = detection.mask.shape
        whole = slice(0, height_px), slice(0, width_px)
        foreground, background, hard = trimap.over((height_px, width_px))
        if config.erosions is not None:
            foreground = eroded(detection.mask, config.erosions)
        if config.dilations is not None:
            background = ~dilated(detection.mask, config.dilations)
        hard &= background
        trimap = Trimap(whole, foreground + 2 * background.view(np.uint8) + 4 * hard.view(np.uint8))
    if detection.exact:
        trimap.side[:] = (trimap.side & 6) | detection.mask[trimap.window]
    return trimap


def trimap_seeds(
    cloud: Cloud,
    detection: Detection,
    trimap: Trimap,
    config: LabelConfig,
    camera: Camera | None = None,
    moved: Bool[np.ndarray, "n"] | None = None,
    ground: Ground | None = None,
) -> DetectionSeeds:
    """Moves the trimap of a detection into the cloud.

    Args:
        cloud: of all views.
        detection: in one of them.
        trimap: its.
        config: settings.
        camera: of its view. Given it, what a person drew where the view has no depth takes the points of other views.
        moved: voxels that have moved, if any have. A detection of what has moved has no other foreground: between the
            spokes of a bicycle it shows the ground, often more of it than of the bicycle.
        ground: of the cloud. Given it, what shows mostly ground has its seeds above it.
    """
    view = detection.view_index
    if camera is not None and detection.exact and np.all(cloud.voxel_of_pixel[view][detection.mask] < 0):
        visible, ranks, pixels = voxels_of_blind_view(cloud, view, camera)
    else:
        visible, ranks, pixels = cloud.voxels_of_view(view)
    split = split_voxels(ranks[trimap.window], trimap.side, pixels)
    inside, outside, near = (visible[chosen] for chosen in split)
    if moved is not None and not detection.exact and shows_moved(cloud, detection, moved):
        inside = inside[moved[inside]]
    if ground is not None and not detection.exact:
        inside = seeds_above_ground(cloud, inside, ground)
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
    apart = points - _medians(points.T)
    distance = np.sqrt(np.einsum("ij,ij->i", apart, apart))
    return distance > spread * _medians(distance[None])[0] / 1.54 * np.sqrt(3.0)


def _medians(rows: Float32[np.ndarray, "d n"]) -> Float32[np.ndarray, "d"]:
    """What ``np.median`` tells of each row, sooner."""
    half, is_odd = divmod(rows.shape[1], 2)
    if is_odd:
        return np.partition(rows, half, axis=1)[:, half]
    ordered = np.partition(rows, [half - 1, half], axis=1)
    return ordered[:, half - 1 : half + 1].mean(axis=1)


def eroded(mask: Bool[np.ndarray, "h w"], times: int) -> Bool[np.ndarray, "h w"]:
    """The mask eroded by 3x3 pixels so many times; the mask itself where nothing would be left."""
    import cv2

    inner = cv2.erode(mask.astype(np.uint8), np.ones((3, 3), np.uint8), iterations=times) > 0 if times else mask
    return inner if inner.any() else mask


def dilated(mask: Bool[np.ndarray, "h w"], times: int) -> Bool[np.ndarray, "h w"]:
    """The mask dilated by 3x3 pixels so many times."""
    import cv2

    return cv2.dilate(mask.astype(np.uint8), np.ones((3, 3), np.uint8), iterations=times) > 0 if times else mask
