"""Augmentation: one picture with its masks in, a changed one out. Plain arrays and a generator; no torch."""

from dataclasses import dataclass, replace

import cv2
import numpy as np
from jaxtyping import Bool, Float32, Int64, UInt8

from labeling.detectors.data.augment_config import AugmentConfig


@dataclass(frozen=True)
class Sample:
    """One picture and the objects in it, as arrays."""

    rgb: UInt8[np.ndarray, "h w 3"]
    masks: Bool[np.ndarray, "n h w"]
    labels: Int64[np.ndarray, "n"]
    """Output of the classifier, from 1; whatever is ignored has 0."""
    weights: Float32[np.ndarray, "n"]
    """How well their masks are known, in [0, 1]."""
    ignore: Bool[np.ndarray, "n"]
    unannotated: tuple[int, ...] = ()
    """Outputs of categories that whoever annotated the picture had no name for."""
    trust_scores: bool = False
    """Objects are there as surely as their weights say, not for sure."""


_LUMA = np.array([0.299, 0.587, 0.114], np.float32)

MIN_SHARE_LEFT = 0.2
"""Objects of which less than this is left by a crop are ignored: nobody could tell what they are."""
MIN_PIXELS = 16
"""So are objects of fewer pixels."""


def augment(sample: Sample, config: AugmentConfig, rng: np.random.Generator) -> Sample:
    """Crops, resizes, mirrors and recolours."""
    sample = _window(sample, config, rng)
    sample = _crop(sample, config, rng)
    sample = _resize(sample, config, rng)
    if rng.random() < config.flip:
        sample = replace(sample, rgb=sample.rgb[:, ::-1], masks=sample.masks[:, :, ::-1])
    tiny = sample.masks.sum(axis=(1, 2)) < MIN_PIXELS
    return replace(sample, rgb=recolour(sample.rgb, config, rng), ignore=sample.ignore | tiny)


def _window(sample: Sample, config: AugmentConfig, rng: np.random.Generator) -> Sample:
    """A window of a large picture, around a pixel of an object that teaches something if there is one."""
    height, width = sample.rgb.shape[:2]
    tall, wide = min(height, config.window_px or height), min(width, config.window_px or width)
    if (tall, wide) == (height, width):
        return sample
    middle = np.array([rng.integers(height), rng.integers(width)])
    learnable = np.flatnonzero(~sample.ignore & sample.masks.any(axis=(1, 2)))
    if len(learnable):
        pixels = np.argwhere(sample.masks[rng.choice(learnable)])
        middle = pixels[rng.integers(len(pixels))]
    top = int(np.clip(middle[0] - rng.integers(tall), 0, height - tall))
    left = int(np.clip(middle[1] - rng.integers(wide), 0, width - wide))
    return _cut(sample, (slice(top, top + tall), slice(left, left + wide)))


def _crop(sample: Sample, config: AugmentConfig, rng: np.random.Generator) -> Sample:
    if rng.random() >= config.crop:
        return sample
    height, width = sample.rgb.shape[:2]
    tall, wide = (max(1, round(side * rng.uniform(config.crop_least, 1.0))) for side in (height, width))
    top, left = rng.integers(0, height - tall + 1), rng.integers(0, width - wide + 1)
    return _cut(sample, (slice(top, top + tall), slice(left, left + wide)))


def _cut(sample: Sample, window: tuple[slice, slice]) -> Sample:
    """What lies in a window; objects that lose nearly all of themselves are ignored."""
    masks = sample.masks[:, *window]
    before, after = sample.masks.sum(axis=(1, 2)), masks.sum(axis=(1, 2))
    lost, there = after < MIN_SHARE_LEFT * before, after > 0
    return replace(
        sample,
        rgb=sample.rgb[window],
        masks=masks[there],
        labels=sample.labels[there],
        weights=sample.weights[there],
        ignore=(sample.ignore | lost)[there],
    )


def _resize(sample: Sample, config: AugmentConfig, rng: np.random.Generator) -> Sample:
    height, width = sample.rgb.shape[:2]
    short = min(height, width)
    factor = np.exp(rng.uniform(np.log(config.scale[0]), np.log(config.scale[1])))
    scale = float(np.clip(short * factor, *(config.short_side_px or (1, np.inf)))) / short
    size = max(1, round(height * scale)), max(1, round(width * scale))
    if size == (height, width):
        return sample
    rgb = resize_picture(sample.rgb, size)
    masks = np.zeros((len(sample.masks), *size), bool)
    for index, mask in enumerate(sample.masks):
        masks[index] = cv2.resize(mask.astype(np.float32), size[::-1], interpolation=cv2.INTER_LINEAR) > 0.5
    return replace(sample, rgb=rgb, masks=masks)


def resize_picture(rgb: UInt8[np.ndarray, "h w 3"], size: tuple[int, int]) -> UInt8[np.ndarray, "h2 w2 3"]:
    """A picture at another height and width, without aliasing."""
    if size == rgb.shape[:2]:
        return rgb
    shrinks = size[0] < rgb.shape[0]
    return cv2.resize(rgb, size[::-1], interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR)


def recolour(
    rgb: UInt8[np.ndarray, "h w 3"], config: AugmentConfig, rng: np.random.Generator
) -> UInt8[np.ndarray, "h w 3"]:
    """Changes colours, sharpness and noise; nothing moves."""
    x = rgb.astype(np.float32) / np.float32(255)
    c = config.colour
    if c > 0:
        brightness, contrast, saturation = 1 + rng.uniform(-c, c, 3)
        hue = rng.uniform(-0.1, 0.1) * c
        if hue:
            x = _rotate_hue(x, 2 * np.pi * hue)
        grey = x @ _LUMA
        x = grey[:, :, None] + np.float32(saturation) * (x - grey[:, :, None])
        x = np.float32(grey.mean()) + np.float32(contrast) * (x - np.float32(grey.mean()))
        x = x * np.float32(brightness)
    if rng.random() < config.blur:
        x = cv2.GaussianBlur(x, (0, 0), rng.uniform(0.3, 1.2))
    if rng.random() < config.noise:
        x = x + rng.normal(0, rng.uniform(0, 0.04), x.shape).astype(np.float32)
    return np.clip(np.rint(x * 255), 0, 255).astype(np.uint8)


def _rotate_hue(x: Float32[np.ndarray, "h w 3"], angle_rad: float) -> Float32[np.ndarray, "h w 3"]:
    """Hue turned about the grey axis: a rotation of colour space."""
    axis = np.ones(3) / np.sqrt(3)
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    turn = np.eye(3) + np.sin(angle_rad) * cross + (1 - np.cos(angle_rad)) * cross @ cross
    return x @ turn.T.astype(np.float32)
