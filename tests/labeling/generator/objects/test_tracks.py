"""Tracks: which places are of one object."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from labeling.core.types import Detection
from labeling.generator.cloud.voxel_cloud import Cloud
from labeling.generator.objects.association import Candidate
from labeling.generator.objects.object_posterior import PlaceObservations
from labeling.generator.objects.seeds import DetectionSeeds
from labeling.generator.objects.tracks import MAX_GAP, track_observations, with_tracks

VOXEL_M = 0.1
EACH = 36
"""Voxels of a place: what a view shows of a thing of 0.6 m."""
NONE = np.zeros(0, np.int32)


def cloud_of(centres_m) -> Cloud:
    offsets = VOXEL_M * np.stack([*np.meshgrid(np.arange(6), np.arange(6), [0])], -1).reshape(-1, 3)
    points = np.concatenate([np.asarray(centre) + offsets for centre in centres_m]).astype(np.float32)
    count = len(points)
    return Cloud(points, points, np.ones(count, np.int32), np.zeros((1, 1, 1), np.int32), VOXEL_M)


def places(centres_m, views, names=None) -> tuple[Cloud, list[Candidate]]:
    cloud, found = cloud_of(centres_m), []
    for k, view in enumerate(views):
        detection = Detection(view, "car" if names is None else names[k], 0.9, np.ones((1, 1), bool))
        voxels = np.arange(EACH * k, EACH * (k + 1), dtype=np.int32)
        found.append(Candidate.of(DetectionSeeds(detection, voxels, NONE, NONE), cloud.num_points))
    return cloud, found


def tracks_of(centres_m, views, names=None, moved=None):
    cloud, found = places(centres_m, views, names)
    moved = np.ones(cloud.num_points, bool) if moved is None else np.repeat(moved, EACH)
    return [one.track for one in with_tracks(cloud, found, moved)]


def test_two_things_that_pass_each_other_are_two_tracks():
    views = [0, 1, 2, 3, 0, 1, 2, 3]
    centres = [(0.5 * view, 0.0, 0.0) for view in range(4)] + [(1.5 - 0.5 * view, 3.0, 0.0) for view in range(4)]
    tracks = tracks_of(centres, views)
    assert len(set(tracks[:4])) == len(set(tracks[4:])) == 1
    assert tracks[0] != tracks[4]


def test_what_stands_still_has_no_track_and_neither_joins_one():
    assert tracks_of([(0, 0, 0), (0.3, 0, 0)], [0, 1], moved=[True, False])[1] is None


def test_other_names_far_places_and_long_gaps_are_other_things():
    assert len(set(tracks_of([(0, 0, 0), (0.3, 0, 0)], [0, 1], names=["car", "bus"]))) == 2
    assert len(set(tracks_of([(0, 0, 0), (9.0, 0, 0)], [0, 1]))) == 2
    assert len(set(tracks_of([(0, 0, 0), (0.3, 0, 0)], [0, MAX_GAP + 1]))) == 2
    assert len(set(tracks_of([(0, 0, 0), (0.3, 0, 0)], [0, MAX_GAP]))) == 1


@settings(max_examples=60)
@given(st.lists(st.tuples(st.integers(0, 8), st.floats(-2, 2), st.floats(-2, 2)), min_size=1, max_size=12))
def test_no_track_is_in_two_places_in_one_view(found):
    tracks = tracks_of([(x, y, 0.0) for _, x, y in found], [view for view, *_ in found])
    for track in set(tracks):
        views = [found[k][0] for k, own in enumerate(tracks) if own == track]
        assert len(views) == len(set(views))


def test_observations_of_a_track_are_those_of_the_place_each_view_shows():
    rng = np.random.default_rng(0)
    seen = [
        PlaceObservations({"car": np.array([0.9, 0, 0.0])}, np.array([0.2, 0, 0]), rng.normal(size=(3, 3))),
        PlaceObservations({"bus": np.array([0, 0.4, 0.0])}, np.array([0, 0.3, 0.1]), rng.normal(size=(3, 3))),
        PlaceObservations({"car": np.array([0.7, 0, 0.0])}, np.array([0.2, 0, 0]), rng.normal(size=(3, 3))),
    ]
    first, second, third = track_observations(seen, [4, 4, None])
    assert third is seen[2]
    assert second is first
    assert {name: row.tolist() for name, row in first.confidence.items()} == {"bus": [0, 0.4, 0], "car": [0.9, 0, 0]}
    assert first.side.tolist() == [0.2, 0.3, 0.1]
    assert np.array_equal(first.from_object_m, [seen[0].from_object_m[0], *seen[1].from_object_m[1:]])
