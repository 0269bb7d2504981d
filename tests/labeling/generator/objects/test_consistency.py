"""The consistency filter of thesis A.5: four confident views, one name."""

from dataclasses import replace

import numpy as np
import pytest

from labeling.core.types import Detection
from labeling.generator.objects.association import Candidate, is_consistent
from labeling.generator.objects.seeds import DetectionSeeds
from labeling.generator.propagate import propagate
from labeling.generator.settings.label_config import LabelConfig

from ...synthetic_room import make_episode

NOTHING = np.zeros(0, np.int32)


def candidate(*sources: tuple[int, str, float]) -> Candidate:
    """An object with sources (view, category, confidence)."""
    mask = np.ones((1, 1), bool)
    seeds = [
        DetectionSeeds(Detection(view, name, score, mask), NOTHING, NOTHING, NOTHING) for view, name, score in sources
    ]
    return Candidate(tuple(seeds), np.zeros(0, np.float32), np.zeros(0, np.float32))


FOUR = [(view, "chair", 0.95) for view in range(4)]


@pytest.mark.parametrize(
    ("sources", "kept"),
    [
        (FOUR, True),
        (FOUR[:3], False),
        ([*FOUR[:3], (2, "chair", 0.99)], False),
        ([*FOUR, (9, "couch", 0.91)], False),
        ([*FOUR, (9, "couch", 0.5)], True),
        ([*FOUR[:3], (9, "chair", 0.89)], False),
        ([*FOUR[:3], (9, "chair", 0.9)], True),
    ],
    ids=["four views", "three views", "one view twice", "two names", "unsure other name", "unsure fourth", "just sure"],
)
def test_four_confident_views_and_one_name(sources, kept):
    assert is_consistent(candidate(*sources), 0.9) is kept


def test_the_option_leaves_out_what_is_inconsistent_and_changes_nothing_else():
    room = make_episode(3, num_views=8, size=(60, 80), num_objects=3)
    truths = room.ground_truth or ()
    by_object = {n: [t for t in truths if t.instance_id == n and t.modal.sum() > 60] for n in (1, 2, 3)}
    steady, fickle = sorted((n for n in by_object if len(by_object[n]) >= 4), key=lambda n: -len(by_object[n]))[:2]
    detections = [Detection(t.view_index, t.category, 0.95, t.modal) for t in by_object[steady]]
    detections += [Detection(t.view_index, t.category, 0.95, t.modal) for t in by_object[fickle][:3]]

    def label(config):
        return propagate(room, detections, config)

    plain, filtered = label(LabelConfig()), label(LabelConfig(consistency=True))
    assert len(plain.objects) == 2
    assert [one.category for one in filtered.objects] == [by_object[steady][0].category]
    kept = [one for one in plain.labels if one.category == filtered.objects[0].category]
    assert len(kept) == len(filtered.labels)
    for a, b in zip(kept, filtered.labels, strict=True):
        assert np.array_equal(a.modal, replace(b).modal)
