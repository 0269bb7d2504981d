import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from labeling.core.box_overlap import box_iou_3d, intersection_volume
from labeling.core.rle import encode_mask
from labeling.core.types import Box3d
from labeling.metrics.box_ap import BoxInstance, average_precision_3d, average_precision_by_range
from labeling.metrics.mask_ap import average_precision
from labeling.metrics.matching import MaskInstance


def box(x: float, y: float, wide: float = 4.0, deep: float = 4.0) -> Box3d:
    return Box3d(np.array([x + wide / 2, y + deep / 2, 0.5]), np.array([wide, deep, 1.0], float), np.eye(3))


def scene(seed: int) -> tuple[list[BoxInstance], list[BoxInstance], list[MaskInstance], list[MaskInstance]]:
    """The same rectangles as boxes of unit height and as masks: their overlaps are the same."""
    rng = np.random.default_rng(seed)
    boxes: dict[bool, list[BoxInstance]] = {False: [], True: []}
    masks: dict[bool, list[MaskInstance]] = {False: [], True: []}
    scores = rng.permutation(1000) / 1000  # no ties
    for number in range(rng.integers(4, 24)):
        predicted = bool(rng.random() < 0.6)
        image, category = int(rng.integers(3)), str(rng.choice(["car", "van"]))
        x, y, wide, deep = (int(v) for v in (*rng.integers(0, 6, 2), *rng.integers(2, 8, 2)))
        mask = np.zeros((16, 16), bool)
        mask[y : y + deep, x : x + wide] = True
        ignore = not predicted and bool(rng.random() < 0.2)
        score = float(scores[number])
        boxes[predicted].append(BoxInstance(image, category, box(x, y, wide, deep), score, ignore=ignore))
        masks[predicted].append(MaskInstance(image, category, encode_mask(mask), score, ignore))
    return boxes[True], boxes[False], masks[True], masks[False]


def overlaps_tie(one: BoxInstance, truths: list[BoxInstance]) -> bool:
    """Whether two objects overlap a prediction alike: which of them it finds is then a matter of rounding."""
    rivals = [truth for truth in truths if (truth.image, truth.category) == (one.image, one.category)]
    overlaps = np.sort([box_iou_3d(one.box, truth.box) for truth in rivals])
    return bool(np.any((np.diff(overlaps) < 1e-6) & (overlaps[1:] > 0.2)))


@pytest.mark.slow
@settings(max_examples=120)
@given(seed=st.integers(0, 100_000))
def test_flat_boxes_score_as_the_coco_protocol_scores_their_masks(seed):
    predictions, truths, mask_predictions, mask_truths = scene(seed)
    assume(not any(overlaps_tie(one, truths) for one in predictions))
    ours = average_precision_3d(predictions, truths, (0.25, 0.5))
    theirs = average_precision(mask_predictions, mask_truths, (0.25, 0.5))
    assert ours.per_class.keys() == theirs.per_class.keys()
    for category, aps in theirs.per_class.items():
        for threshold, ap in aps.items():
            assert ours.per_class[category][threshold] == (None if ap is None else pytest.approx(ap, abs=1e-9))


def test_a_second_box_on_one_object_is_wrong():
    truths = [BoxInstance(0, "car", box(0, 0)), BoxInstance(0, "car", box(9, 9))]
    found = [
        BoxInstance(0, "car", box(0, 0), 0.9),
        BoxInstance(0, "car", box(0, 0.1), 0.8),
        BoxInstance(0, "car", box(9, 9), 0.7),
    ]
    ap = average_precision_3d(found, truths, (0.5,)).per_class["car"][0.5]
    assert ap == pytest.approx((51 * 1.0 + 50 * 2 / 3) / 101)


def test_boxes_of_other_views_and_categories_do_not_count():
    truths = [BoxInstance(0, "car", box(0, 0))]
    found = [BoxInstance(1, "car", box(0, 0), 0.9), BoxInstance(0, "van", box(0, 0), 0.9)]
    assert average_precision_3d(found, truths, (0.5,)).per_class["car"][0.5] == 0.0


def test_height_does_not_matter_from_above():
    low = Box3d(np.array([0, 0, 0.5]), np.array([2.0, 1, 1]), np.eye(3))
    high = Box3d(np.array([0, 0, 5.5]), np.array([2.0, 1, 3]), np.eye(3))
    truths, found = [BoxInstance(0, "car", low)], [BoxInstance(0, "car", high, 0.5)]
    assert average_precision_3d(found, truths, (0.5,), "3d").mean[0.5] == 0.0
    assert average_precision_3d(found, truths, (0.5,), "bev").mean[0.5] == pytest.approx(1.0)


def test_by_distance_each_object_counts_once():
    truths = [BoxInstance(0, "car", box(0, 0), range_m=3.0), BoxInstance(0, "car", box(20, 0), range_m=20.0)]
    found = [
        BoxInstance(0, "car", box(0, 0), 0.9, range_m=3.1),
        BoxInstance(0, "car", box(40, 0), 0.8, range_m=40.0),  # finds nothing
    ]
    bins = average_precision_by_range(found, truths, (0.0, 10.0, 30.0, 50.0), (0.5,))
    assert bins[0, 10].mean[0.5] == pytest.approx(1.0)
    assert bins[10, 30].mean[0.5] == 0.0
    assert bins[30, 50].mean[0.5] is None


def test_each_threshold_has_its_own_idle_boxes_of_other_distances():
    """A box that finds something at .25 and nothing at .5 is idle at .5, and no mistake of nearer distances."""
    truths = [BoxInstance(0, "car", box(0, 0), range_m=1.0), BoxInstance(0, "car", box(20, 0), range_m=3.0)]
    found = [BoxInstance(0, "car", box(0, 0), 0.8, range_m=1.0), BoxInstance(0, "car", box(22, 0), 0.9, range_m=3.0)]
    both = average_precision_by_range(found, truths, (0.0, 2.0, 4.0))
    assert both[0, 2].mean == {0.25: pytest.approx(1.0), 0.5: pytest.approx(1.0)}
    assert both[2, 4].mean == {0.25: pytest.approx(1.0), 0.5: 0.0}


def test_each_box_is_compared_with_those_of_its_view_only():
    truths = [BoxInstance(view, "car", box(0, 0), range_m=3.0) for view in range(20)]
    asked = 0

    class View(int):
        def __eq__(self, other):
            nonlocal asked
            asked += 1
            return int(self) == int(other)

        __hash__ = int.__hash__

    found = [BoxInstance(View(view), "car", box(20, 0), 0.9, range_m=3.0) for view in range(20)]
    average_precision_by_range(found, truths, (0.0, 1.0, 2.0, 3.0, 4.0), (0.5,))
    assert asked < 20 * 20, "predictions are compared with the ground truth of other views"


def by_brute_force(found, truths, low, high, threshold):
    """AP of the one category "car", each rule spelled out for each box."""
    ranked = sorted(found, key=lambda one: -one.confidence)
    inside = [low <= truth.range_m < high and not truth.ignore for truth in truths]
    taken, right = set(), []
    for one in ranked:
        same = [k for k, truth in enumerate(truths) if truth.image == one.image]
        overlaps = {k: box_iou_3d(one.box, truths[k].box) for k in same}
        free = [k for k in same if inside[k] and k not in taken and overlaps[k] >= threshold]
        if free:
            taken.add(max(free, key=overlaps.__getitem__))
            right.append(True)
            continue
        volume = float(np.prod(one.box.extent_m))
        on_ignored = any(
            not inside[k] and intersection_volume(one.box, truths[k].box) / volume >= threshold for k in same
        )
        far_and_idle = not low <= one.range_m < high and not any(value >= threshold for value in overlaps.values())
        if not on_ignored and not far_and_idle:
            right.append(False)
    if not any(inside):
        return None
    precision = [sum(right[: k + 1]) / (k + 1) for k in range(len(right))]
    recall = [sum(right[: k + 1]) / sum(inside) for k in range(len(right))]
    return float(
        np.mean(
            [
                max((p for p, r in zip(precision, recall, strict=True) if r >= wanted - 1e-9), default=0.0)
                for wanted in np.linspace(0, 1, 101)
            ]
        )
    )


@pytest.mark.slow
@settings(max_examples=100)
@given(seed=st.integers(0, 100_000), threshold=st.sampled_from([0.253, 0.507]))
def test_by_distance_it_is_what_brute_force_finds(seed, threshold):
    rng = np.random.default_rng(seed)

    def some(count: int) -> list[BoxInstance]:
        return [
            BoxInstance(
                int(rng.integers(2)),
                "car",
                box(*rng.uniform(0, 4, 2), *rng.uniform(2, 5, 2)),
                float(rng.random()),
                range_m=float(rng.uniform(0, 30)),
                ignore=bool(rng.random() < 0.15),
            )
            for _ in range(count)
        ]

    found, truths = some(int(rng.integers(1, 12))), some(int(rng.integers(1, 8)))
    bins = average_precision_by_range(found, truths, (0.0, 10.0, 20.0, 30.0), (threshold,))
    for (low, high), ap in bins.items():
        expected = by_brute_force(found, truths, low, high, threshold)
        assert ap.per_class["car"][threshold] == (None if expected is None else pytest.approx(expected, abs=1e-9))


@pytest.mark.parametrize(("thresholds", "score"), [((0.0,), 0.5), ((1.2,), 0.5), ((), 0.5), ((0.5,), float("nan"))])
def test_bad_settings_are_refused(thresholds, score):
    found = [BoxInstance(0, "car", box(0, 0), score)]
    with pytest.raises(ValueError):
        average_precision_3d(found, found, thresholds)
