"""What a detector in pre-training sees of photographs: views cut, turned and recoloured, alone or four at once."""

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from labeling.detectors.data.annotated_pictures import AnnotatedPicture
from labeling.detectors.data.augment import AugmentConfig, Sample, recolour
from labeling.detectors.finetuning.dataset import Batch, collate, load_sample

MIN_SHARE_LEFT = 0.25
"""Objects of which less than this is in a view are ignored: nobody could tell what they are."""
MIN_PIXELS = 20
"""So are objects of fewer pixels."""


@dataclass(frozen=True)
class PretrainAugmentConfig:
    """How strongly photographs are changed."""

    zoom: tuple[float, float] = (0.7, 1.7)
    """Shorter side of a photograph, in sides of its view: below 1 a photograph leaves a rim, above 1 it is cut."""
    aspect: float = 0.15
    """Width against height changes by up to this share."""
    turn_rad: float = 0.07
    """Standard deviation of a turn about the line of sight."""
    mosaic: float = 0.4
    """Share of views that are made of four photographs."""
    jpeg: float = 0.3
    """Share of views that were compressed, at qualities of 30 to 90."""
    grey: float = 0.04
    """Share of views without colour."""
    recolour: AugmentConfig = field(default_factory=lambda: AugmentConfig(colour=0.35, blur=0.25, noise=0.4))


def stream(
    pictures: Sequence[AnnotatedPicture],
    categories: tuple[str, ...],
    config: PretrainAugmentConfig,
    batch_size: int,
    seed: int,
    first: int,
    side_px: Callable[[int], int],
) -> Iterator[Batch]:
    """Batches from number ``first`` on, without end; each is a function of its number, seed and side.

    Args:
        pictures: photographs.
        categories: the network's.
        config: how views are drawn.
        batch_size: views in a batch.
        seed: of everything random.
        first: number of the first batch.
        side_px: side of the square views of a batch.
    """
    for step in itertools.count(first):
        rng = np.random.default_rng((seed, 3, step))
        side = side_px(step)
        yield collate([random_view(pictures, categories, config, side, rng) for _ in range(batch_size)])


def random_view(
    pictures: Sequence[AnnotatedPicture],
    categories: tuple[str, ...],
    config: PretrainAugmentConfig,
    side_px: int,
    rng: np.random.Generator,
) -> Sample:
    """A square view of random photographs."""

    def photograph(size: tuple[int, int]) -> Sample:
        sample = load_sample(pictures[int(rng.integers(len(pictures)))], categories)
        return warp_sample(sample, size, random_affine(sample.rgb.shape[:2], size, config, rng), rng)

    if rng.random() >= config.mosaic:
        sample = photograph((side_px, side_px))
    else:
        cut = [int(side_px * rng.uniform(0.38, 0.62)) for _ in range(2)]
        rows, columns = ((0, cut[0]), (cut[0], side_px)), ((0, cut[1]), (cut[1], side_px))
        sample = mosaic(
            [((top, left), photograph((low - top, right - left))) for top, low in rows for left, right in columns],
            side_px,
        )
    rgb = recolour(sample.rgb, config.recolour, rng)
    if rng.random() < config.grey:
        rgb = cv2.cvtColor(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY), cv2.COLOR_GRAY2RGB)
    if rng.random() < config.jpeg:
        rgb = compress_jpeg(rgb, int(rng.integers(30, 91)))
    return replace(sample, rgb=rgb)


def random_affine(
    of: tuple[int, int], size: tuple[int, int], config: PretrainAugmentConfig, rng: np.random.Generator
) -> Float[np.ndarray, "2 3"]:
    """Draws where the pixels of a photograph go.

    Args:
        of: height and width of the photograph.
        size: height and width of the view.
        config: settings.
        rng: source of randomness.

    Returns:
        Turns pixel coordinates (x, y, 1) of the photograph into those of the view.
    """
    zoom = float(np.exp(rng.uniform(*np.log(config.zoom)))) * min(size) / min(of)
    stretch = np.exp(rng.uniform(-1.0, 1.0) * config.aspect / 2)
    angle = float(np.clip(rng.normal(0.0, config.turn_rad), -3 * config.turn_rad, 3 * config.turn_rad))
    mirror = -1.0 if rng.random() < 0.5 else 1.0
    cos, sin = np.cos(angle), np.sin(angle)
    linear = np.array([[cos, -sin], [sin, cos]]) @ np.diag([zoom * stretch * mirror, zoom / stretch])
    spread = np.array([of[1] * zoom * stretch - size[1], of[0] * zoom / stretch - size[0]]) / 2
    # Within a view that is smaller than the photograph there is no rim; a smaller photograph lies anywhere in the view.
    shift = rng.uniform(-1.0, 1.0, 2) * np.abs(spread)
    middle = np.array([of[1] - 1, of[0] - 1]) / 2
    goal = np.array([size[1] - 1, size[0] - 1]) / 2 + shift
    return np.concatenate([linear, (goal - linear @ middle)[:, None]], axis=1)


def warp_sample(
    sample: Sample, size: tuple[int, int], warp: Float[np.ndarray, "2 3"], rng: np.random.Generator
) -> Sample:
    """A photograph moved into a view; outside of it the view has one random colour.

    Args:
        sample: the photograph.
        size: height and width of the view.
        warp: as ``random_affine`` gives it.
        rng: draws the colour.
    """
    scale = float(np.sqrt(abs(np.linalg.det(warp[:, :2]))))
    rgb, to_small = sample.rgb, np.eye(3)
    if scale < 0.7:
        # Shrunk by areas first: interpolation alone would skip pixels.
        height, width = (max(round(side * scale), 1) for side in rgb.shape[:2])
        to_small = np.diag([width / rgb.shape[1], height / rgb.shape[0], 1.0])
        to_small[:2, 2] = 0.5 * np.diag(to_small)[:2] - 0.5
        rgb = cv2.resize(rgb, (width, height), interpolation=cv2.INTER_AREA)
    from_small = (np.vstack([warp, [0.0, 0.0, 1.0]]) @ np.linalg.inv(to_small))[:2]
    around = tuple(int(c) for c in rng.integers(0, 256, 3))
    out = cv2.warpAffine(
        np.ascontiguousarray(rgb), from_small, size[::-1], borderMode=cv2.BORDER_CONSTANT, borderValue=around
    )
    masks = np.zeros((len(sample.masks), *size), bool)
    for index, mask in enumerate(sample.masks):
        masks[index] = cv2.warpAffine(mask.astype(np.uint8), warp, size[::-1], flags=cv2.INTER_NEAREST) > 0
    before, after = sample.masks.sum(axis=(1, 2)) * scale**2, masks.sum(axis=(1, 2))
    too_little_left = (after < MIN_SHARE_LEFT * before) | (after < MIN_PIXELS)
    there = after > 0
    ignore = (sample.ignore | too_little_left)[there]
    return Sample(out, masks[there], sample.labels[there], sample.weights[there], ignore)


def mosaic(parts: Sequence[tuple[tuple[int, int], Sample]], side_px: int) -> Sample:
    """Views side by side in one.

    Args:
        parts: rows and columns of their upper left corners, and the views; together they fill the square.
        side_px: its side.
    """
    rgb = np.zeros((side_px, side_px, 3), np.uint8)
    masks = []
    for (top, left), part in parts:
        height, width = part.rgb.shape[:2]
        rgb[top : top + height, left : left + width] = part.rgb
        placed = np.zeros((len(part.masks), side_px, side_px), bool)
        placed[:, top : top + height, left : left + width] = part.masks
        masks.append(placed)
    labels, weights, ignore = (
        np.concatenate([getattr(part, name) for _, part in parts]) for name in ("labels", "weights", "ignore")
    )
    return Sample(rgb, np.concatenate(masks), labels, weights, ignore)


def compress_jpeg(rgb: UInt8[np.ndarray, "h w 3"], quality: int) -> UInt8[np.ndarray, "h w 3"]:
    """A picture as JPEG leaves it."""
    _, encoded = cv2.imencode(".jpg", rgb[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])
    decoded = cv2.imdecode(encoded, cv2.IMREAD_COLOR)
    assert decoded is not None
    return np.ascontiguousarray(decoded[..., ::-1])
