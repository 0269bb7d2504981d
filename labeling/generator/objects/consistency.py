"""The thesis' consistency filter: labels only of objects that several views detect confidently, under one name."""

from labeling.generator.objects.association import Candidate

OTHER_VIEWS = 3
"""How many views besides the source must be confident of an object. Source: thesis A.5, criterion 1."""


def is_consistent(candidate: Candidate, confident: float, other_views: int = OTHER_VIEWS) -> bool:
    """Whether enough views are confident of an object and all of them call it by one name.

    Args:
        candidate: the object.
        confident: detections at least this confident count; those below neither help nor harm.
        other_views: how many views there must be besides the one a label stems from.

    Source: thesis A.5: at least three other views with confident detections of the object, and a single class among
    them. There it improved some classes and thinned out others, and was left off.
    """
    confident_ones = [one.detection for one in candidate.sources if one.detection.confidence >= confident]
    views = {detection.view_index for detection in confident_ones}
    return len(views) > other_views and len({detection.category for detection in confident_ones}) == 1
