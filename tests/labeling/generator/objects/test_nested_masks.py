"""What stands on, in or before something large keeps its points, whoever drew it."""

import json
from dataclasses import replace

import numpy as np
import pytest

from labeling.core.episode import Episode
from labeling.core.geometry import intrinsics_from_fov, look_at
from labeling.core.masks import mask_iou
from labeling.core.rle import encode_mask
from labeling.core.types import Detection, GroundTruth
from labeling.generate import main as generate
from labeling.generator.objects.nested_masks import without_nested
from labeling.generator.objects.seeds import DetectionSeeds
from labeling.generator.propagate import propagate
from labeling.generator.settings.label_config import LabelConfig
from labeling.inspect import main as inspect
from labeling.io.episodes import write_episode

from ...synthetic_room import Part, render

WOOD, WHITE, BLUE, GREY = (0.6, 0.4, 0.25), (0.9, 0.9, 0.92), (0.2, 0.3, 0.6), (0.2, 0.2, 0.22)
TABLE = [
    Part((0, 0, 0.725), (0.6, 0.4, 0.025), WOOD, instance=1),
    *(Part((x, y, 0.35), (0.03, 0.03, 0.35), WOOD, instance=1) for x in (-0.55, 0.55) for y in (-0.35, 0.35)),
]
SCENES = {
    "cups on a table": (
        ["table", "cup", "bowl"],
        [
            *TABLE,
            Part((0.2, 0.1, 0.8), (0.045, 0.045, 0.055), WHITE, instance=2),
            Part((-0.2, -0.1, 0.79), (0.09, 0.09, 0.045), BLUE, round=True, instance=3),
        ],
    ),
    "cushions on a couch": (
        ["couch", "cushion"],
        [
            Part((0, 0, 0.22), (0.8, 0.4, 0.22), GREY, instance=1),
            Part((0, 0.32, 0.6), (0.8, 0.1, 0.2), GREY, instance=1),
            Part((0.35, 0.1, 0.58), (0.2, 0.09, 0.14), BLUE, instance=2),
        ],
    ),
    "a monitor on a desk": (
        ["desk", "monitor"],
        [
            *TABLE,
            Part((0, 0.2, 0.78), (0.03, 0.03, 0.03), GREY, instance=2),
            Part((0, 0.2, 0.97), (0.28, 0.02, 0.17), GREY, instance=2),
        ],
    ),
}


def draw(scene: str, num_views: int = 8) -> Episode:
    """Views from a circle around a scene, with true masks."""
    names, parts = SCENES[scene]
    height_px, width_px = 120, 160
    intrinsics = intrinsics_from_fov(width_px, height_px, np.deg2rad(58))
    poses = [
        look_at(np.array([1.9 * np.cos(a), 1.9 * np.sin(a), 1.55]), np.array([0, 0, 0.55]))
        for a in -np.pi / 2 + 2 * np.pi * np.arange(num_views) / num_views
    ]
    rgb, depth_m, instance = zip(*(render(parts, pose, intrinsics, height_px, width_px) for pose in poses), strict=True)
    truths = tuple(
        GroundTruth(view, number, name, instance[view] == number)
        for view in range(num_views)
        for number, name in enumerate(names, start=1)
        if np.count_nonzero(instance[view] == number) >= 32
    )
    return Episode(
        name="scene",
        rgb=np.stack(rgb),
        depth_m=np.stack(depth_m),
        intrinsics=np.repeat(intrinsics[None], num_views, axis=0),
        camera_to_world=np.stack(poses),
        file_names=tuple(f"rgb/{view:03d}.png" for view in range(num_views)),
        ground_truth=truths,
    )


def outlines(episode: Episode, inside: bool) -> list[Detection]:
    """What a person draws in the first view; ``inside``: the large object with all that stands on it."""
    own = [truth for truth in episode.ground_truth or () if truth.view_index == 0]
    everything = np.any([truth.modal for truth in own], axis=0)
    masks = [everything if inside and truth.instance_id == 1 else truth.modal for truth in own]
    return [Detection(0, truth.category, 1.0, mask, True) for truth, mask in zip(own, masks, strict=True)]


@pytest.mark.slow
@pytest.mark.parametrize("inside", [False, True])
@pytest.mark.parametrize("scene", SCENES)
def test_outlines_of_one_view_label_small_things_on_large_ones_in_all(scene: str, inside: bool) -> None:
    episode = draw(scene)
    labels = propagate(episode, outlines(episode, inside))
    assert sorted(one.category for one in labels.objects) == sorted(SCENES[scene][0])
    for name in SCENES[scene][0]:
        ious = [
            max(
                (
                    mask_iou(one.modal, truth.modal)
                    for one in labels.labels
                    if (one.view_index, one.category) == (truth.view_index, name)
                ),
                default=0.0,
            )
            for truth in episode.ground_truth or ()
            if truth.category == name
        ]
        assert np.mean(ious) > 0.7, (name, ious)


def seeds(view: int, category: str, inside: range, seen: range, confidence: float = 0.95) -> DetectionSeeds:
    foreground = np.array([v for v in seen if v in inside], np.int32)
    background = np.array([v for v in seen if v not in inside], np.int32)
    return DetectionSeeds(
        Detection(view, category, confidence, np.ones((1, 1), bool)), foreground, background, background
    )


def test_only_sure_smaller_detections_of_other_objects_in_the_same_view_take_points() -> None:
    seen = range(200)
    table, cup = seeds(0, "table", range(100), seen), seeds(0, "cup", range(40, 50), seen)
    taken, kept = without_nested([table, cup], 200, 0.9, 0.5)
    assert set(taken.foreground) == set(range(100)) - set(range(40, 50))
    assert set(range(40, 50)) <= set(taken.background) & set(taken.hard_negatives)
    assert kept is cup
    others = [
        seeds(1, "cup", range(40, 50), seen),
        seeds(0, "table", range(40, 50), seen),
        seeds(0, "cup", range(40, 50), seen, confidence=0.5),
        seeds(0, "desk", range(10, 90), seen),
        seeds(0, "chair", range(95, 120), seen),
    ]
    for other in others:
        assert without_nested([table, other], 200, 0.9, 0.5)[0] is table


def test_what_a_person_drew_twice_in_one_view_are_two_objects() -> None:
    episode = draw("cups on a table")
    table = next(truth for truth in episode.ground_truth or () if truth.category == "table")
    halves = [table.modal.copy(), table.modal.copy()]
    halves[1][:, : int(np.median(np.nonzero(table.modal)[1]))] = False
    drawn = [Detection(0, "table", 1.0, half, True) for half in halves]
    assert len(propagate(episode, drawn).objects) == 2
    assert len(propagate(episode, [replace(one, exact=False) for one in drawn]).objects) == 1


def test_an_outline_that_gives_no_object_is_named_and_inspection_counts_it(tmp_path, capsys) -> None:
    episode = draw("cups on a table")
    write_episode(tmp_path / "scene", episode)
    speck = np.zeros(episode.size, bool)
    speck[0, :5] = True
    drawn = [*outlines(episode, True), Detection(0, "speck", 1.0, speck, True)]
    content = {
        "images": [{"id": 1, "file_name": episode.file_names[0]}],
        "categories": [{"id": k, "name": one.category} for k, one in enumerate(drawn, start=1)],
        "annotations": [
            {"id": k, "image_id": 1, "category_id": k, "segmentation": encode_mask(one.mask)}
            for k, one in enumerate(drawn, start=1)
        ],
    }
    (tmp_path / "outlines.json").write_text(json.dumps(content))
    out = str(tmp_path / "labels")
    assert generate([str(tmp_path / "scene"), "--out", out, "--annotations", str(tmp_path / "outlines.json")]) == 0
    told = capsys.readouterr().err
    assert "the outline of speck in rgb/000.png gave no object: it has 5 pixels" in told
    assert inspect([out]) == 1
    assert "1 of 4 outlines of scene gave no object; its notes name them" in capsys.readouterr().out


def test_an_outline_where_its_view_is_blind_takes_the_points_of_others() -> None:
    episode = draw("cups on a table")
    cup = next(truth for truth in episode.ground_truth or () if truth.category == "cup")
    depth_m = episode.depth_m.copy()
    depth_m[0][cup.modal] = 0
    labels = propagate(replace(episode, depth_m=depth_m), outlines(episode, inside=True))
    found = {one.view_index: one.modal for one in labels.labels if one.category == "cup"}
    truths = [truth for truth in episode.ground_truth or () if truth.category == "cup"]
    assert np.mean([mask_iou(found[truth.view_index], truth.modal) for truth in truths]) > 0.5


def test_presets_of_the_thesis_leave_nested_masks_as_they_are() -> None:
    from labeling.generator.settings.presets import PRESETS

    assert LabelConfig().nested_masks
    assert not PRESETS["paper"].nested_masks
    assert not PRESETS["released"].nested_masks
