"""Labels that are too doubtful to be learnt from."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from labeling.detectors.data.annotated_pictures import AnnotatedPicture

LEAST_CONFIDENCE = 0.3
"""Of labels that are expected to have a lower IoU with an object hardly any turns out to be right: they are what the
detector takes for something again and again, which is what a detector that learns has to see as background."""


def without_doubtful(
    pictures: "Sequence[AnnotatedPicture]", least_confidence: float = LEAST_CONFIDENCE
) -> "list[AnnotatedPicture]":
    """Leaves out labels of little confidence, so that what they show is background.

    Args:
        pictures: with the confidence of a label as its weight.
        least_confidence: labels below are left out, in [0, 1]. Regions to ignore stay.
    """
    from labeling.detectors.data.annotated_pictures import with_annotations

    return with_annotations(pictures, lambda one: one if one.ignore or one.weight >= least_confidence else None)
