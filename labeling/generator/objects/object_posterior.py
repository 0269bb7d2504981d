"""The posterior of an object's category, or of there being no object, given the detections of all views.

Every view that shows the place of an object is an observation of it, also one in which the detector finds nothing
there. Observations from almost the same viewpoint are correlated, so they share the weight of one. The probabilities
are those of a conditional logit over background and the categories that detections name, fitted to ground truth of
training episodes for each detector (``python -m experiments.calibrate_labels``).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int64
from numba import njit

from labeling.core.types import Detection
from labeling.generator.cloud.voxel_cloud import Cloud

FEATURES = ("best", "support", "contradiction", "views", "size")
"""best: log-odds of the highest confidence in the category. support and contradiction: weighted mean over views of the
confidence in the category, and of the highest confidence in any other one; 0 where nothing is found. views: log2 of 1 +
the number of views with a detection in the category. size: log2 of ``side`` in the view that shows most of it."""
SAME_ANGLE_RAD, SAME_RANGE = float(np.radians(30)), 0.25
"""Standard deviations, of viewing direction and of the logarithm of distance, within which views are correlated."""
MIN_SIDE = 1 / 32
"""Views without a detection count as observations only if their ``side`` is greater than this."""


@dataclass(frozen=True)
class PlaceObservations:
    """What v views show and find at the place of one candidate object."""

    confidence: Mapping[str, Float[np.ndarray, "v"]]
    """Highest confidence of a detection there in each view, by category; 0 where there is none."""
    side: Float[np.ndarray, "v"]
    """Square root of the share of each view's pixels that show the place."""
    from_object_m: Float[np.ndarray, "v 3"]
    """Camera positions relative to the mean of the object's points, metres, world axes."""

    @property
    def features(self) -> Float[np.ndarray, "c f"]:
        """``FEATURES`` of each category, in the order of ``confidence``."""
        return _features(np.array([*self.confidence.values()]), self.side, self.from_object_m)


@njit(cache=True, nogil=True)
def _features(confidence, side, from_object_m):  # pragma: no cover - compiled
    """``PlaceObservations.features``.

    Args:
        confidence: (c, v) float64.
        side: (v,) float64.
        from_object_m: (v, 3) float64.

    Returns:
        (c, f) float64.
    """
    count, views = confidence.shape
    looked = np.empty(views, np.int64)
    num_looked = 0
    largest = 0.0
    for view in range(views):
        if side[view] > MIN_SIDE or confidence[:, view].max() > 0:
            looked[num_looked] = view
            num_looked += 1
        largest = max(largest, side[view])
    voice = np.empty(num_looked)
    for one in range(num_looked):
        voice[one] = 0.0
        for other in range(num_looked):
            voice[one] += alikeness(from_object_m[looked[one]], from_object_m[looked[other]])
        voice[one] = 1 / voice[one]
    voice /= voice.sum()
    rows = np.zeros((count, 5))
    for row in range(count):
        best, found = 0.0, 0
        for place in range(num_looked):
            others = 0.0
            for other in range(count):
                if other != row:
                    others = max(others, confidence[other, looked[place]])
            own = confidence[row, looked[place]]
            best, found = max(best, own), found + (own != 0)
            rows[row, 1] += voice[place] * own
            rows[row, 2] += voice[place] * others
        held = min(max(best, 0.02), 0.98)
        rows[row, 0] = np.log(held / (1 - held))
        rows[row, 3] = np.log2(1 + found)
        rows[row, 4] = np.log2(min(max(largest, 1 / 64), 1))
    return rows


@njit(cache=True, nogil=True)
def alikeness(one_m, other_m):  # pragma: no cover - compiled
    """How much two looks resemble each other, 1 for the same.

    Args:
        one_m: (3,) float64, where the one was taken from, from the middle of the object.
        other_m: (3,) float64, the other.
    """
    dot = square = other_square = 0.0
    for axis in range(3):
        dot += one_m[axis] * other_m[axis]
        square += one_m[axis] * one_m[axis]
        other_square += other_m[axis] * other_m[axis]
    square, other_square = max(square, 1e-12), max(other_square, 1e-12)
    angle_rad = np.arccos(min(1.0, max(-1.0, dot / np.sqrt(square * other_square))))
    further = 0.5 * np.log(square / other_square)
    return np.exp(-0.5 * ((angle_rad / SAME_ANGLE_RAD) ** 2 + (further / SAME_RANGE) ** 2))


@dataclass(frozen=True)
class ObjectModel:
    """Probabilities of categories: a conditional logit of standardised features, with a bias for each category."""

    mean: Float[np.ndarray, "f"]
    scale: Float[np.ndarray, "f"]
    weight: Float[np.ndarray, "f"]
    intercept: float
    category_bias: Mapping[str, float]
    """0 for categories that are not in it."""

    def posterior(self, seen: PlaceObservations) -> dict[str, float]:
        """Probability of each category; the rest to 1 is the probability that there is no object."""
        bias = np.array([self.intercept + self.category_bias.get(name, 0.0) for name in seen.confidence])
        odds = np.exp(np.clip((seen.features - self.mean) / self.scale @ self.weight + bias, -30, 30))
        return dict(zip(seen.confidence, (odds / (1 + odds.sum())).tolist(), strict=True))


def observe_places(
    cloud: Cloud,
    eyes_m: Float[np.ndarray, "v 3"],
    objects: Sequence[tuple[Sequence[Detection], Int64[np.ndarray, "f"]]],
) -> list[PlaceObservations]:
    """Collects what all views show and find at the places of candidate objects.

    Args:
        cloud: the points of all views.
        eyes_m: camera positions, metres, world.
        objects: for each its detections (at least one) and indices of its voxels (at least one).
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
        PlaceObservations(_confidences(detections, len(eyes_m)), side, eyes_m - cloud.points[voxels].mean(axis=0))
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
        which: (m,) int32, indices of objects, voxel after voxel.
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
    samples: Sequence[tuple[PlaceObservations, str | None]], ridge: float = 2e-3, category_ridge: float = 0.02
) -> ObjectModel:
    """Fits the model by maximum likelihood.

    Args:
        samples: observations of places and the true category of each, None where there is no object.
        ridge: weight of the squared weights of features, beside the mean log-likelihood.
        category_ridge: weight of the squared biases of categories.

    Source: McFadden, "Conditional logit analysis of qualitative choice behavior" (1974).
    """
    from scipy.optimize import minimize

    rows = np.concatenate([seen.features for seen, _ in samples])
    names = [name for seen, _ in samples for name in seen.confidence]
    sample = np.repeat(np.arange(len(samples)), [len(seen.confidence) for seen, _ in samples])
    true = np.array([name == truth for seen, truth in samples for name in seen.confidence], float)
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


def log_odds(probability):
    """Log-odds of probabilities (a number or an array), clipped to [.02, .98]."""
    clipped = np.clip(probability, 0.02, 0.98)
    return np.log(clipped / (1 - clipped))
