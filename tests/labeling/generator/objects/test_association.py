from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labeling.core.types import Detection
from labeling.generator.objects.association import (
    Candidate,
    assign_weak_detections,
    associate_detections,
    group_segments,
    group_unsure,
    overlap,
    overlap_of_detection,
    same_object,
)
from labeling.generator.objects.seeds import DetectionSeeds

NUM_VOXELS = 1000


def seeds(view: int, category: str, confidence: float, inside: range, seen: range) -> DetectionSeeds:
    foreground = np.array([v for v in inside if v in seen], np.int32)
    background = np.array([v for v in seen if v not in inside], np.int32)
    return DetectionSeeds(
        Detection(view, category, confidence, np.ones((1, 1), bool)), foreground, background, background
    )


def categories(candidates) -> list[tuple[str, list[int]]]:
    return [(c.category, sorted(s.detection.view_index for s in c.sources)) for c in candidates]


def test_views_of_one_object_become_one_object() -> None:
    seen = range(0, 500)
    found = associate_detections(
        [seeds(v, "chair", 0.9, range(100 + 5 * v, 200), seen) for v in range(4)], NUM_VOXELS, 0.5
    )
    assert categories(found) == [("chair", [0, 1, 2, 3])]


def test_front_and_back_are_joined_through_the_views_between() -> None:
    """Views 0 and 3 share no voxel, but 1 and 2 link them."""
    views = [seeds(v, "chair", 0.9 + 0.01 * v, range(100, 300), range(50 + 50 * v, 180 + 50 * v)) for v in (0, 3, 1, 2)]
    assert categories(associate_detections(views, NUM_VOXELS, 0.5)) == [("chair", [0, 1, 2, 3])]


def test_neighbours_stay_apart() -> None:
    seen = range(0, 500)
    found = associate_detections(
        [seeds(0, "chair", 0.9, range(100, 200), seen), seeds(1, "chair", 0.95, range(195, 300), seen)],
        NUM_VOXELS,
        0.5,
    )
    assert categories(found) == [("chair", [1]), ("chair", [0])]


def test_a_cushion_is_not_its_couch_but_a_misnamed_couch_is() -> None:
    seen = range(0, 500)
    couch = seeds(0, "couch", 0.99, range(100, 300), seen)
    cushion = seeds(1, "cushion", 0.95, range(120, 150), seen)
    misnamed = seeds(2, "bed", 0.91, range(105, 300), seen)
    found = associate_detections([couch, cushion, misnamed], NUM_VOXELS, 0.5)
    assert categories(found) == [("couch", [0, 2]), ("cushion", [1])]


def test_the_name_is_voted_with_confidences() -> None:
    seen = range(0, 500)
    views = [seeds(0, "bed", 0.99, range(100, 200), seen)]
    views += [seeds(v, "couch", 0.9, range(100, 200), seen) for v in (1, 2)]
    assert categories(associate_detections(views, NUM_VOXELS, 0.5)) == [("couch", [0, 1, 2])]


def test_what_a_view_cannot_see_does_not_count_against_overlap() -> None:
    whole = Candidate.of(seeds(0, "chair", 0.9, range(100, 200), range(0, 500)), NUM_VOXELS)
    part = Candidate.of(seeds(1, "chair", 0.9, range(100, 200), range(150, 500)), NUM_VOXELS)
    assert overlap(whole, part) == (1.0, 1.0)


@settings(max_examples=60)
@given(st.integers(0, 10_000), st.sampled_from([0.0, 0.05, 0.4, 0.9]), st.sampled_from([0.0, 0.05, 0.5, 1.0]))
def test_a_detection_overlaps_as_the_object_it_would_be(seed: int, share: float, confidence: float) -> None:
    rng = np.random.default_rng(seed)

    def some(view: int, likely: float, confidence: float) -> DetectionSeeds:
        side = rng.choice(3, 60, p=[1 - likely, likely / 2, likely / 2])
        inside, outside = (np.flatnonzero(side == which).astype(np.int32) for which in (1, 2))
        return DetectionSeeds(Detection(view, "chair", confidence, np.ones((1, 1), bool)), inside, outside, outside)

    one = Candidate.of(some(0, 0.8, 0.9), 60).with_sources([some(1, 0.5, 0.95)])
    other = some(2, share, confidence)
    assert overlap_of_detection(one, other) == overlap(one, Candidate.of(other, 60))


def test_views_that_share_too_little_decide_nothing() -> None:
    a = Candidate.of(seeds(0, "chair", 0.9, range(100, 200), range(0, 200)), NUM_VOXELS)
    b = Candidate.of(seeds(1, "chair", 0.9, range(195, 300), range(195, 500)), NUM_VOXELS)
    assert overlap(a, b) == (0.0, 0.0)


@pytest.mark.parametrize(("shared", "decides"), [(9, False), (10, True)])
def test_a_tenth_of_the_smaller_foreground_must_be_seen_by_both(shared: int, decides: bool) -> None:
    """All that both have seen is in both foregrounds: only how little that is tells against their being one."""
    small = seeds(0, "chair", 0.9, range(100, 200), range(100, 200))
    large = seeds(1, "chair", 0.9, range(200 - shared, 500), range(200 - shared, 500))
    for one, other in ((small, large), (large, small)):
        a, b = Candidate.of(one, NUM_VOXELS), Candidate.of(other, NUM_VOXELS)
        assert (overlap(a, b) != (0.0, 0.0)) == decides
        assert (overlap_of_detection(a, other) != (0.0, 0.0)) == decides
        assert same_object(a, b, 0.5) == decides


def outlined(one: DetectionSeeds) -> DetectionSeeds:
    return replace(one, detection=replace(one.detection, exact=True))


def test_only_what_a_person_drew_counts_as_an_outline() -> None:
    one = seeds(3, "chair", 0.9, range(100, 200), range(0, 500))
    drawn = outlined(seeds(5, "chair", 0.9, range(100, 200), range(0, 500)))
    assert Candidate.of(one, NUM_VOXELS).outlined_in == frozenset()
    assert Candidate.of(one, NUM_VOXELS).with_sources([drawn]).outlined_in == {5}


def test_two_outlines_of_one_view_are_two_objects_and_those_of_two_views_may_be_one() -> None:
    seen = range(0, 500)
    first, second = (outlined(seeds(0, "chair", 1.0, range(start, 200), seen)) for start in (100, 110))
    elsewhere = outlined(seeds(1, "chair", 1.0, range(105, 200), seen))
    detected = seeds(0, "chair", 1.0, range(110, 200), seen)
    assert categories(associate_detections([first, second], NUM_VOXELS, 0.5)) == [("chair", [0]), ("chair", [0])]
    assert categories(associate_detections([first, elsewhere], NUM_VOXELS, 0.5)) == [("chair", [0, 1])]
    assert categories(associate_detections([first, detected], NUM_VOXELS, 0.5)) == [("chair", [0, 0])]
    a, b = Candidate.of(first, NUM_VOXELS), Candidate.of(second, NUM_VOXELS)
    assert not same_object(a, b, 0.5)
    assert same_object(a, Candidate.of(elsewhere, NUM_VOXELS), 0.5)
    assert same_object(a, Candidate.of(detected, NUM_VOXELS), 0.5)


def test_segments_of_two_outlines_of_one_view_stay_apart() -> None:
    seen = range(0, 500)
    drawn = [outlined(seeds(view, "chair", 1.0, range(100, 200), seen)) for view in (0, 1, 0)]
    alike = np.repeat((np.arange(NUM_VOXELS) < 100)[:, None], 3, axis=1).astype(np.float32)
    objects = [Candidate.of(one, NUM_VOXELS) for one in drawn]
    assert group_segments(objects, alike, 0.5) == [[0, 1], [2]]
    assert group_segments([objects[1], objects[0], objects[2]], alike, 0.5) == [[0, 1], [2]], "of any member"


def test_weak_detections_join_the_object_in_their_place() -> None:
    seen = range(0, 500)
    found = associate_detections([seeds(0, "chair", 0.9, range(100, 200), seen)], NUM_VOXELS, 0.5)
    weak = [
        seeds(1, "chair", 0.4, range(110, 200), seen),
        seeds(2, "couch", 0.4, range(110, 200), seen),
        seeds(3, "chair", 0.4, range(300, 400), seen),
    ]
    found, unassigned = assign_weak_detections(found, weak, 0.5)
    assert [w.detection.view_index for w in found[0].weak] == [1, 2]
    assert [w.detection.view_index for w in unassigned] == [3]
    assert found[0].category == "chair"


def test_weak_detections_of_a_part_under_another_name_are_nobodys() -> None:
    seen = range(0, 500)
    found = associate_detections([seeds(0, "couch", 0.9, range(100, 200), seen)], NUM_VOXELS, 0.5)
    cushion = seeds(1, "cushion", 0.4, range(110, 130), seen)
    (couch,), unassigned = assign_weak_detections(found, [cushion], 0.5)
    assert unassigned == []
    assert couch.weak == ()


def test_unsure_detections_of_one_place_are_one_group() -> None:
    seen = range(0, 500)
    views = [seeds(v, "chair", 0.5 + 0.1 * v, range(100, 200), seen) for v in (1, 2)]
    elsewhere = seeds(1, "chair", 0.4, range(300, 400), seen)
    chair, other = group_unsure([*views, elsewhere], NUM_VOXELS, 0.5)
    assert chair.seeds == (views[1], views[0])
    assert chair.foreground_voxels.tolist() == list(range(100, 200))
    assert other.seeds == (elsewhere,)
    assert categories([chair.as_candidate(NUM_VOXELS)]) == [("chair", [1, 2])]
    assert group_unsure([], NUM_VOXELS, 0.5) == []


def test_segments_that_turn_out_to_be_one_object_are_merged() -> None:
    seen = range(0, 500)
    found = [Candidate.of(seeds(v, "chair", 0.9, range(100, 200), seen), NUM_VOXELS) for v in range(2)]
    found.append(Candidate.of(seeds(2, "tv", 0.9, range(100, 200), seen), NUM_VOXELS))
    probability = np.zeros((NUM_VOXELS, 3), np.float32)
    probability[100:200, 0] = probability[140:260, 1] = probability[190:210, 2] = 0.9
    assert group_segments(found, probability, 0.5) == [[0, 1], [2]]
    assert group_segments(found, probability, 0.9) == [[0], [1], [2]]


def test_nothing_that_is_given_is_changed() -> None:
    seen = range(0, 500)
    first, second = (Candidate.of(seeds(v, "chair", 0.9, range(100, 200), seen), NUM_VOXELS) for v in range(2))
    votes = first.votes_for.copy()
    merged = first.merged([second])
    assigned, _ = assign_weak_detections([first], [seeds(2, "chair", 0.4, range(100, 200), seen)], 0.5)
    assert len(merged.sources) == 2
    assert len(assigned[0].weak) == 1
    assert (len(first.sources), first.weak) == (1, ())
    np.testing.assert_array_equal(first.votes_for, votes)
    np.testing.assert_allclose(merged.votes_for, votes + second.votes_for)
