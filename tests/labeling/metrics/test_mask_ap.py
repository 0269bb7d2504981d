"""Average precision against pycocotools and an own loop, matching against trying all assignments."""

import contextlib
import io
import itertools
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labeling.core.masks import mask_iou
from labeling.core.rle import decode_mask, encode_mask
from labeling.io.episodes import read_episode
from labeling.metrics.average_precision import all_point_area
from labeling.metrics.mask_ap import COCO_IOU_THRESHOLDS, MAX_DETECTIONS, average_precision
from labeling.metrics.matching import MaskInstance, assign, match, mean_iou, pairwise_iou

SIZE = (8, 10)
THRESHOLDS = (0.3, 0.5, 0.75)


def rectangle(top: int, left: int, height: int, width: int) -> dict:
    mask = np.zeros(SIZE, bool)
    mask[top : top + height, left : left + width] = True
    return encode_mask(mask)


own_boxes = st.tuples(st.floats(0, 6), st.floats(0, 8), st.floats(0.5, 7), st.floats(0.5, 6))


@st.composite
def instances(draw, truth: bool, most: int = 9):
    """Rectangles in three pictures and three categories; confidences coarse enough to tie; some truths ignored."""
    return [
        MaskInstance(
            image=draw(st.integers(1, 3)),
            category=draw(st.sampled_from(["chair", "plant", "tv"])),
            rle=rectangle(
                draw(st.integers(0, 6)), draw(st.integers(0, 8)), draw(st.integers(1, 6)), draw(st.integers(1, 7))
            ),
            confidence=1.0 if truth else draw(st.integers(0, 5)) / 5,
            ignore=truth and draw(st.integers(0, 4)) == 0,
            box_xywh=None if truth else draw(st.none() | own_boxes),
        )
        for _ in range(draw(st.integers(0, most)))
    ]


predictions_strategy, truths_strategy = instances(truth=False), instances(truth=True)


def precision_by_pycocotools(predictions, truths, thresholds, kind):
    """pycocotools' table (threshold, recall, category) for the same instances, and its category names."""
    from pycocotools import mask as coco_mask
    from pycocotools.coco import COCO
    from pycocotools.cocoeval import COCOeval

    names = sorted({item.category for item in [*predictions, *truths]})

    def records(items):
        return [
            {
                "id": number,
                "image_id": item.image,
                "category_id": names.index(item.category) + 1,
                "segmentation": item.rle,
                "bbox": list((kind == "own_box" and item.box_xywh) or coco_mask.toBbox(item.rle).tolist()),
                "area": int(coco_mask.area(item.rle)),
                "iscrowd": int(item.ignore),
                "score": item.confidence,
            }
            for number, item in enumerate(items, start=1)
        ]

    def dataset(items):
        coco = COCO()
        coco.dataset = {
            "images": [{"id": number, "height": SIZE[0], "width": SIZE[1]} for number in (1, 2, 3)],
            "categories": [{"id": number, "name": name} for number, name in enumerate(names, start=1)],
            "annotations": records(items),
        }
        coco.createIndex()
        return coco

    with contextlib.redirect_stdout(io.StringIO()):
        evaluation = COCOeval(dataset(truths), dataset(predictions), "segm" if kind == "mask" else "bbox")
        evaluation.params.iouThrs = np.array(thresholds)
        evaluation.params.areaRng, evaluation.params.areaRngLbl = [[0, 1e10]], ["all"]
        evaluation.params.maxDets = [MAX_DETECTIONS]
        evaluation.evaluate()
        evaluation.accumulate()
    return evaluation.eval["precision"][:, :, :, 0, 0], names


@pytest.mark.slow
@settings(max_examples=150)
@given(predictions_strategy, truths_strategy, st.sampled_from(["mask", "box", "own_box"]))
def test_average_precision_agrees_with_pycocotools(predictions, truths, kind):
    result = average_precision(predictions, truths, THRESHOLDS, kind)
    table, names = precision_by_pycocotools(predictions, truths, THRESHOLDS, kind)
    assert list(result.per_class) == names
    for row, threshold in enumerate(THRESHOLDS):
        for column, name in enumerate(names):
            expected = table[row, :, column].mean()
            found = result.per_class[name][threshold]
            assert found is None if expected < 0 else found == pytest.approx(expected, abs=1e-5)
        defined = table[row][table[row] > -1]
        mean = result.mean[threshold]
        assert mean is None if defined.size == 0 else mean == pytest.approx(defined.mean(), abs=1e-5)


def all_point_by_loops(predictions, truths, threshold):
    """Greedy matching and the area under the monotone curve, written down once more, for masks without ignored ones."""
    found = {}
    for name in {item.category for item in truths}:
        wanted = [item for item in truths if item.category == name]
        ranked = sorted(
            (item for item in predictions if item.category == name), key=lambda item: (-item.confidence, item.image)
        )
        taken, right = set(), []
        for item in ranked:
            best, best_iou = None, threshold
            for index, truth in enumerate(wanted):
                iou = mask_iou(decode_mask(item.rle), decode_mask(truth.rle))
                # COCO gives a prediction to the last of equally good ones.
                if truth.image == item.image and index not in taken and iou >= best_iou:
                    best, best_iou = index, iou
            right.append(best is not None)
            taken.add(best)
        area, best_precision = 0.0, 0.0
        for rank in range(len(right), 0, -1):
            best_precision = max(best_precision, sum(right[:rank]) / rank)
            area += best_precision / len(wanted) if right[rank - 1] else 0.0
        found[name] = area
    return found


@pytest.mark.slow
@settings(max_examples=100)
@given(predictions_strategy, truths_strategy)
def test_all_point_interpolation_agrees_with_loops(predictions, truths):
    truths = [replace(item, ignore=False) for item in truths]
    result = average_precision(predictions, truths, THRESHOLDS, interpolation="all-point")
    for threshold in THRESHOLDS:
        expected = all_point_by_loops(predictions, truths, threshold)
        for name, per_threshold in result.per_class.items():
            value = per_threshold[threshold]
            assert value is None if name not in expected else value == pytest.approx(expected[name], abs=1e-9)


@settings(max_examples=60)
@given(predictions_strategy, truths_strategy)
def test_the_two_interpolations_never_differ_by_more_than_a_recall_step(predictions, truths):
    """Both average one monotone curve, so they differ by at most one truth and one of the 101 points."""
    points = average_precision(predictions, truths, THRESHOLDS).per_class
    area = average_precision(predictions, truths, THRESHOLDS, interpolation="all-point").per_class
    for name, per_threshold in points.items():
        for threshold, value in per_threshold.items():
            other = area[name][threshold]
            assert (value is None) == (other is None)
            if value is not None and other is not None:
                assert abs(value - other) <= 0.011


def test_all_point_area_of_a_worked_example():
    # Right, wrong, right, wrong; 3 truths: precision 1 up to recall 1/3, 2/3 up to 2/3, nothing beyond.
    assert all_point_area(np.array([True, False, True, False]), 3) == pytest.approx((1 + 2 / 3) / 3)


def test_perfect_predictions_have_ap_one_and_confidence_order_matters():
    truths = [MaskInstance(1, "chair", rectangle(0, 0, 3, 3)), MaskInstance(2, "chair", rectangle(0, 0, 3, 3))]
    assert average_precision(truths, truths).mean == {0.5: pytest.approx(1), 0.3: pytest.approx(1)}
    wrong = MaskInstance(1, "chair", rectangle(5, 5, 2, 2), confidence=0.5)
    below = average_precision([replace(item, confidence=0.9) for item in truths] + [wrong], truths).mean[0.5]
    above = average_precision([replace(item, confidence=0.1) for item in truths] + [wrong], truths).mean[0.5]
    assert below == pytest.approx(1)
    assert above == pytest.approx(2 / 3)


def test_categories_without_truth_stay_out_of_the_mean():
    truths = [MaskInstance(1, "chair", rectangle(0, 0, 3, 3))]
    result = average_precision([*truths, MaskInstance(1, "tv", rectangle(4, 4, 3, 3))], truths)
    assert result.per_class["tv"] == {0.5: None, 0.3: None}
    assert result.mean[0.5] == pytest.approx(1)


@pytest.mark.parametrize("interpolation", ["101-point", "all-point"])
@pytest.mark.parametrize("kind", ["mask", "box"])
def test_empty_cases(kind, interpolation):
    one = [MaskInstance(1, "chair", rectangle(0, 0, 3, 3))]
    ignored = [replace(one[0], ignore=True)]
    assert average_precision([], [], kind=kind, interpolation=interpolation).mean == {0.5: None, 0.3: None}
    assert average_precision([], one, kind=kind, interpolation=interpolation).mean == {0.5: 0.0, 0.3: 0.0}
    assert average_precision(one, [], kind=kind, interpolation=interpolation).mean == {0.5: None, 0.3: None}
    assert average_precision(one, ignored, kind=kind, interpolation=interpolation).mean == {0.5: None, 0.3: None}


def test_only_the_most_confident_hundred_of_a_picture_count():
    truth = [MaskInstance(1, "chair", rectangle(0, 0, 3, 3))]
    crowd = [MaskInstance(1, "chair", rectangle(5, 5, 2, 2), confidence=0.9)] * MAX_DETECTIONS
    late = MaskInstance(1, "chair", rectangle(0, 0, 3, 3), confidence=0.1)
    assert average_precision([*crowd, late], truth).mean[0.5] == 0
    assert average_precision([*crowd[1:], late], truth).mean[0.5] == pytest.approx(0.01)


@pytest.mark.parametrize("thresholds", [[], [0.0], [1.5], [0.5, -0.1], [float("nan")]])
def test_senseless_thresholds_are_refused(thresholds):
    with pytest.raises(ValueError, match="IoU thresholds"):
        average_precision([], [], thresholds)


def test_senseless_instances_are_refused():
    sound = MaskInstance(1, "chair", rectangle(0, 0, 3, 3))
    with pytest.raises(ValueError, match="finite"):
        average_precision([replace(sound, confidence=float("nan"))], [sound])
    with pytest.raises(ValueError, match="differ in size"):
        average_precision([replace(sound, rle={"size": [2, 2], "counts": "04"})], [sound])


# Matching ------------------------------------------------------------------------------------------------------------


@pytest.mark.slow
@given(predictions_strategy, truths_strategy)
def test_pairwise_iou_agrees_with_counting(predictions, truths):
    predictions = [item for item in predictions if item.image == 1]
    truths = [item for item in truths if item.image == 1]
    masks = pairwise_iou(predictions, truths)
    boxes = pairwise_iou(predictions, truths, "box")
    assert masks.shape == boxes.shape == (len(predictions), len(truths))
    for p, prediction in enumerate(predictions):
        for g, truth in enumerate(truths):
            expected = mask_iou(decode_mask(prediction.rle), decode_mask(truth.rle))
            assert masks[p, g] == pytest.approx(expected)
            assert boxes[p, g] == pytest.approx(expected)  # the masks are rectangles


def test_boxes_are_those_around_the_masks():
    ring, square = np.ones((5, 5), bool), np.ones((5, 5), bool)
    ring[1:4, 1:4] = False
    a, b = MaskInstance(1, "chair", encode_mask(ring)), MaskInstance(1, "chair", encode_mask(square))
    assert pairwise_iou([a], [b], "box").item() == 1
    assert pairwise_iou([a], [b], "mask").item() == pytest.approx(16 / 25)
    wider = replace(a, box_xywh=(0.0, 0.0, 10.0, 5.0))
    assert pairwise_iou([wider], [b], "own_box").item() == pytest.approx(1 / 2)
    assert pairwise_iou([wider], [b], "box").item() == pairwise_iou([a], [b], "own_box").item() == 1


@given(st.integers(0, 4), st.integers(0, 4), st.integers(0, 2**32 - 1))
def test_assign_finds_the_greatest_sum(num_predictions, num_truths, seed):
    rng = np.random.default_rng(seed)
    iou = np.where(rng.random((num_predictions, num_truths)) < 0.3, 0, rng.random((num_predictions, num_truths)))
    pairs = assign(iou)
    assert len({p for p, _ in pairs}) == len({g for _, g in pairs}) == len(pairs)
    assert all(iou[p, g] > 0 for p, g in pairs)
    wide = iou if num_predictions <= num_truths else iou.T
    best = max(
        (sum(wide[row, column] for row, column in enumerate(columns)))
        for columns in itertools.permutations(range(wide.shape[1]), wide.shape[0])
    )
    assert sum(iou[p, g] for p, g in pairs) == pytest.approx(best)


@pytest.mark.slow
@settings(max_examples=100)
@given(predictions_strategy, truths_strategy)
def test_matches_stay_within_picture_and_category_and_are_one_to_one(predictions, truths):
    matches = match(predictions, truths)
    assert [m.truth for m in matches] == list(range(len(truths)))
    used = [m.prediction for m in matches if m.prediction is not None]
    assert len(set(used)) == len(used)
    for m in matches:
        truth = truths[m.truth]
        if m.prediction is None:
            assert m.iou == 0
            continue
        prediction = predictions[m.prediction]
        assert (prediction.image, prediction.category) == (truth.image, truth.category)
        assert m.iou == pytest.approx(mask_iou(decode_mask(prediction.rle), decode_mask(truth.rle)))
        assert m.iou > 0


@settings(max_examples=60)
@given(predictions_strategy, truths_strategy)
def test_ignored_instances_change_nothing_for_the_others(predictions, truths):
    counted = [item for item in truths if not item.ignore]
    with_ignored = mean_iou(truths, match(predictions, truths))
    assert with_ignored == mean_iou(counted, match(predictions, counted))


@pytest.mark.slow
@given(predictions_strategy, truths_strategy)
def test_mean_iou_does_not_look_at_confidence(predictions, truths):
    flat = [replace(item, confidence=0.5) for item in predictions]
    assert mean_iou(truths, match(predictions, truths)) == mean_iou(truths, match(flat, truths))


def test_mean_iou_of_a_worked_example():
    truths = [
        MaskInstance(1, "chair", rectangle(0, 0, 4, 4)),
        MaskInstance(1, "plant", rectangle(0, 0, 4, 4)),
        MaskInstance(1, "chair", rectangle(6, 6, 2, 2), ignore=True),
    ]
    predictions = [MaskInstance(1, "chair", rectangle(0, 0, 4, 2)), MaskInstance(2, "plant", rectangle(0, 0, 4, 4))]
    matches = match(predictions, truths)
    result = mean_iou(truths, matches)
    assert (result.mean_iou, result.mean_iou_matched) == (pytest.approx(0.25), pytest.approx(0.5))
    assert (result.num_truths, result.num_matched) == (2, 1)
    only_plants = mean_iou(truths, matches, np.array([False, True, False]))
    assert (only_plants.mean_iou, only_plants.mean_iou_matched) == (0, None)
    assert mean_iou([], []).mean_iou is None


def test_the_best_assignment_is_not_greedy():
    """The first prediction fits both, the second only the one that the first would rather have."""
    truths = [MaskInstance(1, "chair", rectangle(0, 0, 1, 8)), MaskInstance(1, "chair", rectangle(0, 4, 1, 6))]
    predictions = [
        MaskInstance(1, "chair", rectangle(0, 0, 1, 9), confidence=0.9),
        MaskInstance(1, "chair", rectangle(0, 0, 1, 6), confidence=0.8),
    ]
    matches = match(predictions, truths)
    assert [m.prediction for m in matches] == [1, 0]


# Real data -----------------------------------------------------------------------------------------------------------


def test_the_real_capture_has_the_figures_of_its_readme(apc_shelf):
    """AP .081 and AP50 .356 are pycocotools' figures, written down where the capture was published."""
    episode = read_episode(apc_shelf)
    detections = [
        MaskInstance(d.view_index, d.category, encode_mask(d.mask), d.confidence) for d in episode.detections or ()
    ]
    truths = [MaskInstance(t.view_index, t.category, encode_mask(t.modal)) for t in episode.ground_truth or ()]
    ap = average_precision(detections, truths, (0.3, *COCO_IOU_THRESHOLDS)).mean
    assert ap[0.5] == pytest.approx(0.356, abs=5e-4)
    assert ap[0.3] == pytest.approx(0.561, abs=5e-4)
    assert np.mean([ap[threshold] or 0.0 for threshold in COCO_IOU_THRESHOLDS]) == pytest.approx(0.081, abs=5e-4)
    assert mean_iou(truths, match(detections, truths)).mean_iou == pytest.approx(0.339, abs=5e-4)
