import numpy as np
import pytest

from labeling.core.rle import decode_mask
from labeling.core.types import Detection, GroundTruth, PseudoLabel
from labeling.metrics.matching import MaskInstance, instances_of

EMPTY, LEFT, ALL = np.zeros((2, 3), bool), np.eye(2, 3) > 0, np.ones((2, 3), bool)


def fields(one: MaskInstance) -> tuple:
    return (one.image, one.category, decode_mask(one.rle).tolist(), one.confidence, one.ignore)


@pytest.mark.parametrize("part", ["modal", "amodal"])
def test_instances_are_what_has_pixels(part):
    shown = (LEFT if part == "modal" else ALL).tolist()
    truths = [
        GroundTruth(0, 1, "chair", LEFT, ALL, ignore=True),
        GroundTruth(1, 2, "plant", EMPTY if part == "modal" else LEFT, None if part == "amodal" else ALL),
    ]
    labels = [PseudoLabel(4, 1, "bed", 0.5, LEFT, ALL, 0, 0.9), PseudoLabel(5, 1, "bed", 0.5, EMPTY, EMPTY, 0, 0.9)]
    assert [fields(one) for one in instances_of("a", truths, part)] == [(("a", 0), "chair", shown, 1.0, True)]
    assert [fields(one) for one in instances_of("a", labels, part)] == [(("a", 4), "bed", shown, 0.5, False)]
    detections = [Detection(2, "tv", 0.3, LEFT), Detection(2, "tv", 0.4, EMPTY)]
    assert [fields(one) for one in instances_of(7, detections, part)] == [((7, 2), "tv", LEFT.tolist(), 0.3, False)]
