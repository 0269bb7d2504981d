"""Average precision over scenes that are drawn again with replacement: how much it hangs on which scenes there are.

Views of one scene show the same objects, so scenes are drawn, not views. Source: Efron and Tibshirani 1993, ch. 6.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from labeling.metrics.average_precision import check_ranking, interpolated_area, mean_of
from labeling.metrics.mask_ap import RankedMatches, ranked_matches
from labeling.metrics.matching import Kind, MaskInstance

RESAMPLES, MIN_SCENES = 200, 4
"""Fewer scenes say nothing about how much scenes differ."""


def resampled_ap(
    predictions: Sequence[MaskInstance],
    ground_truth: Sequence[MaskInstance],
    scenes: Mapping[Any, str],
    iou_thresholds: Sequence[float] = (0.5,),
    kind: Kind = "mask",
    resamples: int = RESAMPLES,
    seed: int = 0,
) -> dict[float, Float[np.ndarray, "resamples"]]:
    """Mean AP over categories of as many draws of scenes; NaN where a draw has nothing to find.

    Args:
        predictions: as ``average_precision`` takes them.
        ground_truth: likewise.
        scenes: as ``resample_matches`` takes them.
        iou_thresholds: each in (0, 1].
        kind: what to compare.
        resamples: how many draws.
        seed: of the draws.

    Raises:
        ValueError: if a threshold lies outside (0, 1], a confidence is not finite, or a picture has no scene.
    """
    thresholds = check_ranking(iou_thresholds, [item.confidence for item in predictions])
    return resample_matches(
        ranked_matches(predictions, ground_truth, thresholds, kind), scenes, thresholds, resamples, seed
    )


def resample_matches(
    of_category: Sequence[RankedMatches],
    scenes: Mapping[Any, str],
    iou_thresholds: Sequence[float],
    resamples: int = RESAMPLES,
    seed: int = 0,
) -> dict[float, Float[np.ndarray, "resamples"]]:
    """The same of matches that were made already, of masks or of 3-D boxes.

    The draws depend on the names of the scenes and on the seed alone: figures of two detectors on the same pictures are
    paired, draw by draw.

    Args:
        of_category: matches at the thresholds, in their order.
        scenes: of each picture, by what the matches call it; pictures without any instance may be among them.
        iou_thresholds: of the matches.
        resamples: how many draws.
        seed: of the draws.

    Raises:
        ValueError: if a picture has no scene.
    """
    without = {image for one in of_category for image in (*one.images, *one.truths)} - set(scenes)
    if without:
        raise ValueError(f"picture {min(map(str, without))!r} has no scene")
    names = sorted(set(scenes.values()))
    number = {name: index for index, name in enumerate(names)}
    result = {float(threshold): np.full(resamples, np.nan) for threshold in iou_thresholds}
    places = [_places(one, scenes, number) for one in of_category]
    for draw, times in enumerate(scene_draws(len(names), resamples, seed)):
        for row, threshold in enumerate(result):
            areas = [_area(one, *place, times, row) for one, place in zip(of_category, places, strict=True)]
            mean = mean_of(areas)
            result[threshold][draw] = np.nan if mean is None else mean
    return result


def scene_draws(num_scenes: int, resamples: int = RESAMPLES, seed: int = 0) -> Int[np.ndarray, "resamples scenes"]:
    """How many times each scene is drawn; as many in all as there are."""
    if num_scenes == 0:
        return np.zeros((resamples, 0), np.int64)
    shares = np.full(num_scenes, 1 / num_scenes)
    return np.random.default_rng(seed).multinomial(num_scenes, shares, size=resamples)


def _places(
    matches: RankedMatches, scenes: Mapping[Any, str], number: Mapping[str, int]
) -> tuple[np.ndarray, np.ndarray]:
    """The scene of each prediction, and how many instances each scene has."""
    truths = np.zeros(len(number), np.int64)
    for image, count in matches.truths.items():
        truths[number[scenes[image]]] += count
    return np.array([number[scenes[image]] for image in matches.images], np.int64), truths


def _area(matches: RankedMatches, scene: np.ndarray, truths: np.ndarray, times: np.ndarray, row: int) -> float | None:
    num_truths = int((truths * times).sum())
    if num_truths == 0:
        return None
    counts = matches.counts[row]
    return interpolated_area(np.repeat(matches.right[row][counts], times[scene[counts]]), num_truths)
