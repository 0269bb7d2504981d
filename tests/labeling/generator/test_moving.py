"""Labels where things move: in every view where they are, one object each, and no ghosts; else as ever."""

import json
from dataclasses import replace

import numpy as np
import pytest

from labeling.core.episode_labels import EpisodeLabels, LabelledObject, Source
from labeling.core.types import Detection, GroundTruth
from labeling.evaluate import main as evaluate
from labeling.generate import main as generate
from labeling.generator.cloud.moved import moved_detections, moved_voxels
from labeling.generator.cloud.voxel_cloud import build_cloud
from labeling.generator.draw.gone_objects import gone_objects
from labeling.generator.propagate import propagate
from labeling.generator.settings.label_config import LabelConfig
from labeling.generator.sharing.joined_episodes import join_episodes, split_labels
from labeling.inspection.checks import inspect_label_set
from labeling.io.episodes import write_episode

from ..synthetic_room import make_episode, pick

ROOM = {"num_views": 10, "size": (72, 96), "num_objects": 5, "confident_share": 0.9, "wrong_class": 0.0}
VOXEL_M = 0.05
SPEED_M = (0.14, -0.1)
SHIFT_M = (2.2, -4.2)


def truths(episode) -> tuple[GroundTruth, ...]:
    assert episode.ground_truth is not None
    return episode.ground_truth


def runner(episode) -> int:
    """The instance of which still rooms have most views."""
    ids = [one.instance_id for one in truths(episode) if one.modal.sum() > 200]
    return max(set(ids), key=ids.count)


@pytest.fixture(scope="module", params=[4, pytest.param(6, marks=pytest.mark.nightly)])
def rooms(request):
    """The same room twice: with everything still, and with one thing in motion."""
    still = make_episode(request.param, **ROOM)
    number = runner(still)
    return still, make_episode(request.param, **ROOM, motion={number: SPEED_M}), number


def found(labels: EpisodeLabels, episode, number) -> tuple[dict[int, float], set[int]]:
    """IoU of the best label of an instance in each view that shows it well, and the objects these labels are of."""
    iou, objects = {}, set()
    for truth in truths(episode):
        if truth.instance_id != number or truth.modal.sum() < 200:
            continue
        here = [one for one in labels.labels if one.view_index == truth.view_index and one.category == truth.category]
        both = [np.sum(one.modal & truth.modal) / np.sum(one.modal | truth.modal) for one in here]
        iou[truth.view_index] = max(both, default=0.0)
        if both and max(both) > 0.5:
            objects.add(here[int(np.argmax(both))].instance_id)
    return iou, objects


def test_nothing_has_moved_in_a_still_room(rooms):
    still, *_ = rooms
    cloud = build_cloud(still, VOXEL_M)
    assert moved_detections(cloud, still, still.detections or ()) == {}
    labels, held = propagate(still, still.detections), propagate(still, still.detections, LabelConfig(moving=False))
    told = [[(one.instance_id, one.category, one.confidence, one.sources) for one in x.objects] for x in (labels, held)]
    assert told[0] == told[1]
    assert all(one.box_3d is not None for one in labels.objects)
    for one, other in zip(labels.labels, held.labels, strict=True):
        assert (one.view_index, one.instance_id, one.category, one.confidence) == (
            other.view_index,
            other.instance_id,
            other.category,
            other.confidence,
        )
        assert np.array_equal(one.modal, other.modal)
        assert np.array_equal(one.amodal, other.amodal)
    assert np.array_equal(labels.cloud.instance_id, held.cloud.instance_id)


def test_voxels_that_have_moved_are_those_of_what_moves(rooms):
    _, moving, number = rooms
    cloud = build_cloud(moving, VOXEL_M)
    moved = moved_voxels(cloud, moving)
    own = np.zeros(cloud.num_points, bool)
    others = np.zeros(cloud.num_points, bool)
    for truth in truths(moving):
        shown = cloud.voxel_of_pixel[truth.view_index][truth.modal]
        (own if truth.instance_id == number else others)[shown[shown >= 0]] = True
    assert np.mean(moved[own]) > 0.4
    assert np.mean(moved[others & ~own]) < 0.03


def test_what_moves_is_one_object_labelled_where_it_is(rooms):
    still, moving, number = rooms
    labels = propagate(moving, moving.detections)
    iou, objects = found(labels, moving, number)
    assert len(iou) >= 3
    assert np.mean([value > 0.5 for value in iou.values()]) > 0.7
    assert len(objects) == 1
    mover = next(one for one in labels.objects if one.instance_id in objects)
    assert mover.box_3d is None
    assert not np.any(labels.cloud.instance_id == mover.instance_id)
    # Nowhere is it said to be behind something: where it is not seen it has gone.
    assert all(one.modal.any() for one in labels.labels if one.instance_id == mover.instance_id)
    for number_of_other in {t.instance_id for t in truths(still)} - {number}:
        before, after = (
            found(propagate(still, still.detections), still, number_of_other),
            found(labels, moving, number_of_other),
        )
        if len(before[0]) >= 4:
            assert np.mean([*after[0].values()]) > np.mean([*before[0].values()]) - 0.15


def test_what_stands_elsewhere_in_another_episode_has_its_box_in_each():
    first = make_episode(4, **ROOM)
    number = runner(first)
    visits = [first, make_episode(4, **ROOM, shifted={number: SHIFT_M})]
    views, detections = join_episodes(visits, [one.detections or () for one in visits])
    parts = split_labels(propagate(views, detections), [one.num_views for one in visits])
    centres = []
    for visit, part in zip(visits, parts, strict=True):
        iou, objects = found(part.labels, visit, number)
        assert np.mean([value > 0.5 for value in iou.values()]) > 0.7
        (guest,) = (one for one in part.labels.objects if one.instance_id in objects)
        assert guest.only_here
        assert guest.places == ()
        assert guest.box_3d is not None
        centres.append(guest.box_3d.centre_m[:2])
        stays = [one for one in part.labels.objects if one.instance_id not in objects]
        assert any(one.box_3d is not None for one in stays)
        assert not any(one.only_here for one in stays)
    np.testing.assert_allclose(centres[1] - centres[0], SHIFT_M, atol=0.15)


def test_no_view_has_a_label_where_the_thing_was_in_others(rooms):
    _, moving, number = rooms
    labels = propagate(moving, moving.detections)
    for one in labels.labels:
        name = {t.category for t in truths(moving) if t.instance_id == number}
        if one.category not in name or one.modal.sum() < 100 or one.confidence < 0.3:
            continue
        right = np.zeros(moving.size, bool)
        for truth in truths(moving):
            if truth.view_index == one.view_index and truth.category == one.category:
                right |= truth.modal
        assert np.mean(right[one.modal]) > 0.6


def test_a_view_without_depth_is_filled_with_what_stands_still_alone(rooms):
    still, moving, number = rooms
    last = still.num_views

    def blind_at_the_end(episode):
        more = pick(episode, [*range(last), 0])  # what it shows of the first view's masks is view 0's
        depth_m = more.depth_m.copy()
        depth_m[last] = 0
        return replace(more, depth_m=depth_m)

    stands, moves = (blind_at_the_end(one) for one in (still, moving))
    labelled = [
        {one.category for one in propagate(room, room.detections).labels if one.view_index == last and one.modal.any()}
        for room in (stands, moves)
    ]
    (name,) = {t.category for t in truths(moving) if t.instance_id == number}
    assert name in labelled[0]
    assert labelled[1] == labelled[0] - {name}


def test_something_that_runs_through_one_view_is_labelled_there_only(rooms):
    still, *_ = rooms
    depth_m = still.depth_m.copy()
    mask = np.zeros(still.size, bool)
    mask[20:75, 45:75] = True
    depth_m[0][mask] = 0.45 * depth_m[0][mask]
    person = Detection(0, "person", 0.97, mask)
    config = LabelConfig(calibrate=False)
    labels = [one for one in propagate(replace(still, depth_m=depth_m), (person,), config).labels if one.modal.any()]
    assert {one.view_index for one in labels} == {0}
    assert np.sum(labels[0].modal & mask) > 0.8 * np.sum(labels[0].modal | mask)


def test_what_shows_through_something_that_passes_is_no_part_of_it(rooms):
    """A bicycle is less of its own mask than the ground that it stands on is."""
    still, *_ = rooms
    depth_m = still.depth_m.copy()
    mask, bars = np.zeros(still.size, bool), np.zeros(still.size, bool)
    mask[12:60, 20:75] = True
    bars[12:60, 20:75] = np.arange(55) % 7 < 3
    depth_m[0][bars] = 0.6 * depth_m[0][bars]
    bicycle = Detection(0, "bicycle", 0.97, mask)
    labels = propagate(replace(still, depth_m=depth_m), (bicycle,), LabelConfig(calibrate=False))
    assert len(labels.objects) == 1
    shown = {one.view_index: one.modal for one in labels.labels}
    own = shown.pop(0)
    assert np.sum(own & bars) > 0.9 * np.sum(own | bars)
    assert all(np.mean(one) < 0.01 for one in shown.values())


@pytest.mark.slow
def test_a_label_set_tells_what_moves_and_is_in_order(rooms, tmp_path, capsys):
    _, moving, number = rooms
    write_episode(tmp_path / "episodes" / "one", moving)
    assert generate([str(tmp_path / "episodes"), "--out", str(tmp_path / "labels")]) == 0
    boxes = json.loads((tmp_path / "labels" / "boxes_3d.json").read_text())
    (mover,) = boxes["moving"]
    assert not {"centre", "extent", "rotation"} & set(mover)
    assert mover["instance_id"] not in [one["instance_id"] for one in boxes["boxes"]]
    modal = json.loads((tmp_path / "labels" / "instances_modal.json").read_text())
    names = {one["id"]: one["name"] for one in modal["categories"]}
    name = next(one.category for one in truths(moving) if one.instance_id == number)
    assert names[mover["category_id"]] == name
    assert sum(one.get("instance_id") == mover["instance_id"] for one in modal["annotations"]) >= 3
    assert inspect_label_set(tmp_path / "labels") == []
    assert evaluate([str(tmp_path / "labels")]) == 0
    assert "AP50" in capsys.readouterr().out
    assert generate([str(tmp_path / "episodes"), "--out", str(tmp_path / "held"), "--no-moving"]) == 0
    assert "moving" not in json.loads((tmp_path / "held" / "boxes_3d.json").read_text())


def test_a_view_that_looks_through_most_of_a_thing_has_no_label_of_the_rest(rooms):
    """It stands for too long to be told from what stands still; what is left of it where it has gone is its foot."""
    still, _, number = rooms
    shown = {one.view_index: one for one in truths(still) if one.instance_id == number and one.modal.sum() > 200}
    last = max(shown)
    mask, depth_m = shown[last].modal, still.depth_m.copy()
    foot = mask & (np.cumsum(mask, axis=0) > 0.8 * mask.sum(axis=0))
    depth_m[last][mask & ~foot] *= 2.5
    detections = [one for one in still.detections or () if one.view_index != last]
    labels = propagate(replace(still, depth_m=depth_m), detections)
    found_in = found(labels, still, number)[0]
    assert np.mean([iou > 0.5 for view, iou in found_in.items() if view != last]) > 0.7
    here = [one for one in labels.labels if one.view_index == last and one.category == shown[last].category]
    assert not any(np.any(one.modal & foot) for one in here)


def test_a_thing_is_gone_from_views_that_look_through_it_unless_it_is_labelled_from_them(rooms):
    still, _, number = rooms
    shown = {one.view_index: one.modal for one in truths(still) if one.instance_id == number and one.modal.sum() > 200}
    last, depth_m = max(shown), still.depth_m.copy()
    depth_m[last][shown[last]] *= 2.5
    views = replace(still, depth_m=depth_m)
    cloud = build_cloud(views, VOXEL_M)
    owner = np.full(cloud.num_points, -1, np.int32)
    for view in shown.keys() - {last}:
        voxels = cloud.voxel_of_pixel[view][shown[view]]
        owner[voxels[voxels >= 0]] = 0
    thing = LabelledObject(instance_id=1, category="thing", confidence=1.0, box_3d=None, sources=())
    for sources, gone in (((), {last}), ((Source(last, 0.9, "thing"),), set())):
        (found,) = gone_objects(cloud, views, owner, [replace(thing, sources=sources)]).T
        assert set(np.flatnonzero(found)) == gone
