"""How good the labels are that an episode's first views give, and how many.

Two questions, both asked after several numbers of views, because either alone is easy to please:

- *Of what the robot saw so far, how much is labelled right?* AP50 and AP30 of the modal masks against the ground truth
  of these very views. A policy that sees little is not punished, one that sees much of what it cannot label is.
- *What has it gained?* The number of right labels (matched one to one to a visible object of their category,
  IoU >= .5), per view spent, and the number of different objects with at least one right label. A policy that looks at
  nothing gains nothing.

The labels of the first k views are made from these views alone, as if the robot had come home then. Ground truth marked
ignored (slivers) counts neither way, and categories that the detector has no name for are left out, as in
``labeling.evaluate``.
"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from sbm_gym.env.recording import Capture, episode_of_captures
from sbm_gym.env.view_detectors import calibrated_as

if TYPE_CHECKING:
    from labeling.metrics.matching import MaskInstance

EARLY_VIEWS = 12
"""After so many, policies are compared with the first one at its end: who needs half the views?"""
RIGHT_IOU = 0.5
AP_THRESHOLDS = {"ap50": 0.5, "ap30": 0.3}


def label_record(
    captures: Sequence[Capture], categories: Sequence[str], view_counts: Sequence[int], detector: str | None = None
) -> dict[str, Any]:
    """Labels the first views of an episode, a few and more, and keeps what scoring needs, as JSON.

    Args:
        captures: full frames, in order.
        categories: that the detector has a name for.
        view_counts: labels are made of so many of the first views; more than there are give none.
        detector: whose calibration labels are made with; that which the environment judges by.
    """
    from labeling.core.rle import encode_mask
    from labeling.generator.calibration.detector_calibration import calibration_of
    from labeling.generator.propagate import propagate

    truths = [
        [truth.view_index, truth.category, _rle(encode_mask(truth.modal)), truth.instance_id, truth.ignore]
        for truth in episode_of_captures(captures, categories, {}).ground_truth or ()
        if truth.modal.any() and truth.category in categories
    ]
    calibration = calibration_of(None if detector is None else calibrated_as(detector))
    made: dict[str, list[Any]] = {}
    for count in [count for count in view_counts if count <= len(captures)]:
        seen = episode_of_captures(captures[:count], categories, {})
        labels = propagate(seen, seen.detections or (), calibration=calibration)
        made[str(count)] = [
            [one.view_index, one.category, _rle(encode_mask(one.modal)), float(one.confidence)]
            for one in labels.labels
            if one.modal.any()
        ]
    return {"truths": truths, "labels": made}


def episode_figures(record: Mapping[str, Any]) -> dict[str, dict[str, float | None]]:
    """Figures of one episode by number of views.

    Args:
        record: what ``label_record`` returned.

    Returns:
        View count -> ``ap50`` and ``ap30`` (None where nothing is to be seen), ``labels`` (made), ``right`` (labels
        that are right), ``right_per_view``, ``objects`` (different ones with a right label), ``visible`` (different
        ones that the views show).
    """
    from labeling.metrics.matching import match

    found: dict[str, dict[str, float | None]] = {}
    for count in record["labels"]:
        predictions, truths, instance_ids = instances(record, count, 0)
        matches = match(predictions, truths)
        right = [one.truth for one in matches if one.iou >= RIGHT_IOU and not truths[one.truth].ignore]
        counted = [number for number, truth in enumerate(truths) if not truth.ignore]
        found[count] = {
            **ap_figures(predictions, truths),
            "labels": float(len(predictions)),
            "right": float(len(right)),
            "right_per_view": len(right) / int(count),
            "objects": float(len({instance_ids[number] for number in right})),
            "visible": float(len({instance_ids[number] for number in counted})),
        }
    return found


def pooled_ap(records: Sequence[Mapping[str, Any]], count: str) -> dict[str, float | None]:
    """AP of the labels of several episodes, ranked together as one data set.

    Args:
        records: of the episodes.
        count: from how many views the labels are made.
    """
    predictions: list[MaskInstance] = []
    truths: list[MaskInstance] = []
    for number, record in enumerate(records):
        some, there, _ = instances(record, count, number)
        predictions += some
        truths += there
    return ap_figures(predictions, truths)


def ap_figures(predictions: "Sequence[MaskInstance]", truths: "Sequence[MaskInstance]") -> dict[str, float | None]:
    """AP50 and AP30 of masks, mean over categories; None without ground truth."""
    from labeling.metrics.mask_ap import average_precision

    means = average_precision(predictions, truths, tuple(AP_THRESHOLDS.values())).mean
    return {name: means[threshold] for name, threshold in AP_THRESHOLDS.items()}


def instances(
    record: Mapping[str, Any], count: str, episode: int
) -> "tuple[list[MaskInstance], list[MaskInstance], list[int]]":
    """Labels made from the first views, the ground truth of these views, and the object each of the latter is.

    Args:
        record: of the episode.
        count: number of views.
        episode: names the episode in ``MaskInstance.image``.
    """
    from labeling.metrics.matching import MaskInstance

    predictions = [
        MaskInstance((episode, view), category, _as_rle(rle), confidence)
        for view, category, rle, confidence in record["labels"][count]
    ]
    seen = [truth for truth in record["truths"] if truth[0] < int(count)]
    truths = [
        MaskInstance((episode, view), category, _as_rle(rle), ignore=ignore) for view, category, rle, _, ignore in seen
    ]
    return predictions, truths, [truth[3] for truth in seen]


def _rle(rle: dict[str, Any]) -> list[Any]:
    return [rle["size"], rle["counts"]]


def _as_rle(pair: Sequence[Any]) -> dict[str, Any]:
    return {"size": list(pair[0]), "counts": pair[1]}
