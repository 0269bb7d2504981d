"""What an object is: the chances of its names, and that it is none, from all looks at it, sure or not.

Every view that shows the place of an object is a look at it, also one in which the detector finds nothing there. Looks
from almost the same place say almost the same, so they share one voice. The chances are those of a conditional logit
over the names that detections give and background, fitted to ground truth of training episodes for each detector
(``python -m experiments.calibrate_labels``).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int64
from numba import njit

from labeling.core.types import Detection
from labeling.generator.cloud.voxel_cloud import Cloud

FEATURES = ("best", "support", "contradiction", "views", "size")
"""best: highest confidence under the name, log-odds. support and contradiction: mean over the looks, each with its
share of a voice, of the confidence under the name, and of the highest under another one; 0 where nothing is found.
views: log2 of 1 + how many views found it. size: log2 of the side it is seen at, as a share of the picture's, where it
is seen largest."""
SAME_ANGLE_RAD, SAME_RANGE = float(np.radians(30)), 0.25
"""Standard deviations, of direction and of the logarithm of distance, within which looks resemble each other."""
MIN_SIDE = 1 / 32
"""Views that show less of a place than this share of the picture's side miss what is there without telling anything."""


@dataclass(frozen=True)
class Looks:
    """What all views say of one place."""

    confidence: Mapping[str, Float[np.ndarray, "v"]]
    """Of the surest detection of it in each view, by category; 0 where there is none."""
    side: Float[np.ndarray, "v"]
    """Square root of the share of each picture that shows it."""
    from_object_m: Float[np.ndarray, "v 3"]
    """Where each view was taken from, from the middle of the object."""

    @property
    def features(self) -> Float[np.ndarray, "c f"]:
        """``FEATURES`` of each category, in the order of ``confidence``."""
        confidence = np.array([*self.confidence.values()])
        found = confidence.max(axis=0) > 0
        looked = np.flatnonzero(found | (self.side > MIN_SIDE))
        confidence, found = confidence[:, looked], found[looked]
        range_m = np.maximum(np.linalg.norm(self.from_object_m[looked], axis=1), 1e-6)
        direction = self.from_object_m[looked] / range_m[:, None]
        angle_rad = np.arccos(np.clip(direction @ direction.T, -1, 1))
        further = np.log(range_m[:, None] / range_m)
        alike = np.exp(-0.5 * ((angle_rad / SAME_ANGLE_RAD) ** 2 + (further / SAME_RANGE) ** 2))
        voice = 1 / alike.sum(axis=1)
        voice /= voice.sum()
        rows = np.zeros((len(confidence), len(FEATURES)))
        for row, own, k in zip(rows, confidence, range(len(confidence)), strict=True):
            others = np.delete(confidence, k, axis=0).max(axis=0, initial=0)
            row[:] = (
                log_odds(own.max()),
                voice @ own,
                voice @ others,
                np.log2(1 + np.count_nonzero(own)),
                np.log2(np.clip(self.side.max(), 1 / 64, 1)),
            )
        return rows


@dataclass(frozen=True)
class ObjectModel:
    """Chances of what an object is: a conditional logit of standardised features, with a bias for each category."""

    mean: Float[np.ndarray, "f"]
    scale: Float[np.ndarray, "f"]
    weight: Float[np.ndarray, "f"]
    intercept: float
    category_bias: Mapping[str, float]
    """0 for categories that are not in it."""

    def posterior(self, looks: Looks) -> dict[str, float]:
        """The chance of each category; what they leave of 1 is the chance that there is no object."""
        bias = np.array([self.intercept + self.category_bias.get(name, 0.0) for name in looks.confidence])
        odds = np.exp(np.clip((looks.features - self.mean) / self.scale @ self.weight + bias, -30, 30))
        return dict(zip(looks.confidence, (odds / (1 + odds.sum())).tolist(), strict=True))


def looks_at(
    cloud: Cloud,
    eyes_m: Float[np.ndarray, "v 3"],
    objects: Sequence[tuple[Sequence[Detection], Int64[np.ndarray, "f"]]],
) -> list[Looks]:
    """The looks at objects.

    Args:
        cloud: the points of all views.
        eyes_m: where each view was taken from, world.
        objects: of each the detections that speak of it, at least one, and its voxels, at least one.
    """
    pixels = np.zeros((len(eyes_m), len(objects)), np.int32)
    lengths = [len(voxels) for _, voxels in objects]
    voxel, which = np.concatenate([voxels for _, voxels in objects]), np.repeat(np.arange(len(objects)), lengths)
    order = np.argsort(voxel, kind="stable")
    first = np.zeros(cloud.num_points + 1, np.int32)
    np.cumsum(np.bincount(voxel, minlength=cloud.num_points), out=first[1:])
    _count_pixels(cloud.voxel_of_pixel, first, which[order].astype(np.int32), pixels)
    sides = np.sqrt(pixels / cloud.voxel_of_pixel[0].size)
    return [
        Looks(_confidences(detections, len(eyes_m)), side, eyes_m - cloud.points[voxels].mean(axis=0))
        for (detections, voxels), side in zip(objects, sides.T, strict=True)
    ]


def _confidences(detections: Sequence[Detection], num_views: int) -> dict[str, Float[np.ndarray, "v"]]:
    """The highest confidence in each view, by category in the order of the alphabet."""
    found = {name: np.zeros(num_views) for name in sorted({one.category for one in detections})}
    for one in detections:
        row = found[one.category]
        row[one.view_index] = max(row[one.view_index], one.confidence)
    return found


@njit(cache=True, nogil=True)
def _count_pixels(voxel_of_pixel, first, which, pixels):  # pragma: no cover - compiled
    """Counts the pixels of every view that show each object.

    Args:
        voxel_of_pixel: (v, h, w) int32, -1 for none.
        first: (n + 1,) int32, where the objects of each voxel begin in ``which``.
        which: int32, objects of the voxels.
        pixels: (v, o) int32, increased in place.
    """
    views, height, width = voxel_of_pixel.shape
    for view in range(views):
        for y in range(height):
            for x in range(width):
                voxel = voxel_of_pixel[view, y, x]
                if voxel >= 0:
                    for place in range(first[voxel], first[voxel + 1]):
                        pixels[view, which[place]] += 1


def fit_object_model(
    samples: Sequence[tuple[Looks, str | None]], ridge: float = 2e-3, category_ridge: float = 0.02
) -> ObjectModel:
    """Fits the model by maximum likelihood.

    Args:
        samples: looks at objects and what each is, None for none.
        ridge: weight of the squared weights of features, beside the mean log-likelihood.
        category_ridge: of the squared biases of categories.

    Source: McFadden, "Conditional logit analysis of qualitative choice behavior" (1974).
    """
    from scipy.optimize import minimize

    rows = np.concatenate([looks.features for looks, _ in samples])
    names = [name for looks, _ in samples for name in looks.confidence]
    sample = np.repeat(np.arange(len(samples)), [len(looks.confidence) for looks, _ in samples])
    true = np.array([name == truth for looks, truth in samples for name in looks.confidence], float)
    mean, scale = rows.mean(axis=0), rows.std(axis=0)
    scale = np.where(scale > 1e-9, scale, 1.0)
    categories = sorted(set(names))
    design = np.concatenate(
        [(rows - mean) / scale, np.ones((len(rows), 1)), np.array(names)[:, None] == categories], axis=1
    )
    penalty = np.repeat([ridge, 0.0, category_ridge], [len(FEATURES), 1, len(categories)])

    def loss(weight):
        utility = design @ weight
        odds = np.exp(np.clip(utility, -30, 30))
        total = 1 + np.bincount(sample, odds)
        likelihood = true @ utility - np.log(total).sum()
        slope = design.T @ (odds / total[sample] - true) / len(samples) + penalty * weight
        return 0.5 * penalty @ weight**2 - likelihood / len(samples), slope

    fitted = minimize(loss, np.zeros(design.shape[1]), jac=True, method="L-BFGS-B").x
    weight, intercept, bias = np.split(fitted, [len(FEATURES), len(FEATURES) + 1])
    return ObjectModel(mean, scale, weight, float(intercept[0]), dict(zip(categories, bias.tolist(), strict=True)))


def log_odds(chance: float) -> float:
    """Log-odds of a probability held in [.02, .98]."""
    held = min(max(float(chance), 0.02), 0.98)
    return float(np.log(held / (1 - held)))
