"""Reading annotated pictures, changing them, and the stream of samples."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from labeling.core.errors import EpisodeFormatError, UsageError
from labeling.core.rle import decode_mask, encode_mask
from labeling.detectors.data.annotated_pictures import (
    AnnotatedPicture,
    Annotation,
    category_names,
    read_pictures,
    train_val_split,
    with_annotations,
)
from labeling.detectors.data.augment import Sample, augment
from labeling.detectors.data.augment_config import AugmentConfig
from labeling.detectors.finetuning.config import FinetuneConfig
from labeling.detectors.finetuning.dataset import ReplayDataset, collate, load_sample, repeats_of, to_target
from labeling.io.coco import SLIVER_AREA_SHARE
from labeling.io.recordings.pictures import read_colour
from labeling.training.checkpoint import Progress
from labeling.training.loop import TrainingTask

from ..toy_pictures import CATEGORIES, NO_AUGMENTATION, draw, write_coco_folder

# Reading -------------------------------------------------------------------------------------------------------------


def test_a_coco_folder_holds_what_was_drawn(tmp_path):
    pictures = read_pictures(write_coco_folder(tmp_path / "photos", 3))
    assert category_names(pictures) == CATEGORIES
    for seed, picture in enumerate(pictures):
        rgb, found = draw(seed)
        np.testing.assert_array_equal(picture.rgb(), rgb)
        assert [one.category for one in picture.annotations] == [category for category, _ in found]
        for one, (_, mask) in zip(picture.annotations, found, strict=True):
            np.testing.assert_array_equal(decode_mask(one.rle), mask)
            assert (one.weight, one.ignore) == (1.0, False)


@pytest.mark.parametrize("orientation", [3, 6])
def test_pictures_are_taken_as_they_are_stored_whatever_exif_says(tmp_path, orientation):
    rgb = np.zeros((32, 48, 3), np.uint8)
    rgb[:16] = 255
    exif = Image.Exif()
    exif[0x0112] = orientation
    Image.fromarray(rgb).save(tmp_path / "1.jpg", quality=100, exif=exif)
    picture = AnnotatedPicture(tmp_path / "1.jpg", (32, 48), ())
    np.testing.assert_array_equal(picture.rgb(), read_colour(tmp_path / "1.jpg"))
    assert picture.rgb()[:16].min() > 200


def test_a_split_folder_gives_the_part_asked_for(tmp_path):
    write_coco_folder(tmp_path / "train", 3)
    write_coco_folder(tmp_path / "val", 2)
    assert len(read_pictures(tmp_path)) == 3
    assert len(read_pictures(tmp_path, "val")) == 2
    assert len(read_pictures(tmp_path / "train" / "annotations.json")) == 3


def test_a_label_set_gives_labels_weighed_by_their_scores(scene):
    scene.add_episode("one")
    scene.write_labels(lambda truth: (truth.category, 0.4 if truth.category == "chair" else 0.8, truth.modal))
    pictures = read_pictures(scene.labels)
    assert len(pictures) == 2
    assert {one.category: one.weight for one in pictures[0].annotations} == {"chair": 0.4, "plant": 0.8}
    np.testing.assert_array_equal(pictures[1].rgb(), scene.episodes["one"].rgb[1])


def test_labels_that_show_too_little_are_regions_to_ignore_and_ground_truth_is_taken_as_it_is(scene):
    scene.add_episode("one")
    height, width = scene.episodes["one"].rgb.shape[1:3]
    least = int(np.ceil(SLIVER_AREA_SHARE * height * width))

    def first(pixels):
        mask = np.zeros(height * width, bool)
        mask[:pixels] = True
        return mask.reshape(height, width)

    for pixels, ignored in ((least - 1, True), (least, False)):
        scene.write_labels(lambda truth, some=pixels: (truth.category, 0.8, first(some)))
        found = [one for picture in read_pictures(scene.labels) for one in picture.annotations]
        assert found
        assert {one.ignore for one in found} == {ignored}
    small = replace(scene.episodes["one"].ground_truth[0], modal=first(1), amodal=first(1))
    scene.add_episode("one", ground_truth=(small,))
    assert [one.ignore for picture in read_pictures(scene.dataset) for one in picture.annotations] == [False]


def test_episodes_give_their_ground_truth(scene):
    for name in ("one", "two"):
        scene.add_episode(name)
    truth = scene.episodes["one"].ground_truth
    scene.add_episode("three", ground_truth=(replace(truth[0], ignore=True), truth[1]))
    everything = read_pictures(scene.dataset)
    assert len(everything) == 6
    assert len(read_pictures(scene.dataset / "two")) == 2
    about = scene.dataset / "two" / "episode.json"
    about.write_text(json.dumps({**json.loads(about.read_text()), "scene": "my kitchen"}))
    assert {one.scene for one in read_pictures(scene.dataset / "two")} == {"my kitchen"}
    about.unlink()
    assert {one.scene for one in read_pictures(scene.dataset / "two")} == {"two"}
    flags = {(p.file.parent.parent.name, one.ignore) for p in everything for one in p.annotations}
    assert flags == {("one", False), ("two", False), ("three", True), ("three", False)}


def broken(tmp_path, change):
    folder = write_coco_folder(tmp_path / "photos", 2)
    content = json.loads((folder / "annotations.json").read_text())
    change(content)
    (folder / "annotations.json").write_text(json.dumps(content))
    return folder


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda c: c["annotations"][0].update(image_id=99), "unknown image id 99; there are 2 images"),
        (lambda c: c["annotations"][0].update(category_id=9), "unknown category id 9; known: 1 ball, 2 box"),
        (lambda c: c["annotations"][0].update(score=1.5), "a score lies in"),
        (lambda c: c["annotations"][0]["segmentation"].update(size=[3, 3]), "must be the picture's .64, 64."),
        (lambda c: c["annotations"][0]["segmentation"].update(counts="~~"), "RLE counts"),
        (lambda c: c["annotations"][0].update(segmentation=[[1, 2]]), "a polygon needs x and y"),
        (lambda c: c["images"][1].update(id=7), "id 7 is used twice"),
        (lambda c: c["images"][1].update(width=0), r"images\[1\].width: must be above 0"),
        (lambda c: c.pop("images"), "images: is missing"),
    ],
)
def test_malformed_annotations_are_refused(tmp_path, change, message):
    with pytest.raises(EpisodeFormatError, match=message):
        read_pictures(broken(tmp_path, change))


def test_polygons_crowds_and_ignored_regions_are_read(tmp_path):
    def change(content):
        first, second, third, *_ = content["annotations"]
        first["segmentation"] = [[2, 3, 7, 3, 7, 9, 2, 9]]
        second["iscrowd"], third["ignore"] = 1, True

    found = [one for picture in read_pictures(broken(tmp_path, change)) for one in picture.annotations]
    assert decode_mask(found[0].rle).sum() == 30
    assert [one.ignore for one in found] == [False, True, True, False]


def test_pictures_that_cannot_be_read_are_named(tmp_path):
    folder = write_coco_folder(tmp_path / "photos", 3)
    first, second, third = read_pictures(folder)
    first.file.unlink()
    second.file.write_bytes(b"")
    with pytest.raises(EpisodeFormatError, match=r"0\.png: cannot be read"):
        first.rgb()
    with pytest.raises(EpisodeFormatError, match=r"1\.png: not a picture"):
        second.rgb()
    with pytest.raises(EpisodeFormatError, match=r"is \(64, 64\) pixels"):
        replace(third, size=(64, 32)).rgb()


def test_what_cannot_be_learnt_from_is_told_what_was_looked_for(tmp_path):
    with pytest.raises(UsageError, match="no such folder"):
        read_pictures(tmp_path / "nowhere")
    with pytest.raises(UsageError, match=r"instances_modal\.json .* annotations\.json .* ground_truth\.json"):
        read_pictures(tmp_path)


def test_every_tenth_picture_is_held_out():
    pictures = [AnnotatedPicture(path, (4, 4), ()) for path in [*map(Path, map(str, range(25)))]]
    kept, held = train_val_split(pictures)
    assert [one.file.name for one in held] == ["9", "19"]
    assert len(kept) == 23


# Augmentation --------------------------------------------------------------------------------------------------------


def sample_of(seed: int, side: int = 64) -> Sample:
    """Objects are red and all else is not, so that a picture shows where its masks must be."""
    _, found = draw(seed, side)
    masks = np.stack([mask for _, mask in found])
    rgb = np.zeros((side, side, 3), np.uint8)
    rgb[masks.any(axis=0)] = (255, 0, 0)
    return Sample(rgb, masks, np.array([1, 2]), np.ones(2, np.float32), np.zeros(2, bool))


@settings(max_examples=60)
@given(seed=st.integers(0, 10**6))
def test_masks_move_with_the_picture(seed):
    config = AugmentConfig(short_side_px=(32, 128), colour=0.0, blur=0.0, noise=0.0, crop=0.7)
    changed = augment(sample_of(seed % 7), config, np.random.default_rng(seed))
    red = changed.rgb[:, :, 0] > 127
    shown = changed.masks.any(axis=0)
    assert shown.shape == red.shape
    assert (shown ^ red).sum() <= 0.06 * red.size
    assert len(changed.masks) == len(changed.labels) == len(changed.weights) == len(changed.ignore)
    assert 32 <= min(red.shape) <= 128


@settings(max_examples=25)
@given(seed=st.integers(0, 10**6))
def test_augmentation_is_a_function_of_its_generator(seed):
    a, b = (augment(sample_of(1), AugmentConfig(), np.random.default_rng(seed)) for _ in range(2))
    np.testing.assert_array_equal(a.rgb, b.rgb)
    np.testing.assert_array_equal(a.masks, b.masks)


def test_without_augmentation_nothing_changes():
    before = sample_of(3)
    after = augment(before, replace(NO_AUGMENTATION, short_side_px=(1, 999)), np.random.default_rng(0))
    np.testing.assert_array_equal(after.rgb, before.rgb)
    np.testing.assert_array_equal(after.masks, before.masks)
    assert not after.ignore.any()


@settings(max_examples=60)
@given(seed=st.integers(0, 10**6), side=st.integers(8, 80), ignored=st.booleans())
def test_a_window_is_a_part_of_the_picture_that_shows_something_to_learn(seed, side, ignored):
    whole = sample_of(seed % 7)
    rows, columns = np.mgrid[:64, :64].astype(np.uint8)
    whole = replace(whole, rgb=np.stack([rows, columns, rows], axis=2), ignore=np.array([ignored, False]))
    config = replace(NO_AUGMENTATION, short_side_px=(1, 999), window_px=side)
    part = augment(whole, config, np.random.default_rng(seed))
    assert part.rgb.shape[:2] == (min(side, 64),) * 2
    top, left = (int(value) for value in part.rgb[0, 0, :2])
    window = (slice(top, top + side), slice(left, left + side))
    np.testing.assert_array_equal(part.rgb, whole.rgb[window])
    np.testing.assert_array_equal(part.masks.any(axis=0), np.logical_or.reduce(whole.masks)[window])
    assert set(part.labels) & set(whole.labels[~whole.ignore])


def test_pictures_without_objects_have_windows_anywhere():
    empty = replace(sample_of(0), masks=np.zeros((2, 64, 64), bool))
    config = replace(NO_AUGMENTATION, short_side_px=(1, 999), window_px=16)
    parts = [augment(empty, config, np.random.default_rng(seed)) for seed in range(5)]
    assert {part.rgb.shape for part in parts} == {(16, 16, 3)}
    assert {len(part.masks) for part in parts} == {0}


def test_slivers_are_ignored():
    sample = sample_of(3)
    sample.masks[1] = False
    sample.masks[1, 0, :5] = True
    after = augment(sample, replace(NO_AUGMENTATION, short_side_px=(1, 999)), np.random.default_rng(0))
    assert after.ignore.tolist() == [False, True]


@pytest.mark.parametrize(
    "change", [{"flip": 2.0}, {"scale": (2.0, 1.0)}, {"short_side_px": (0, 5)}, {"noise": -1.0}, {"window_px": -1}]
)
def test_settings_of_augmentation_that_make_no_sense_are_refused(change):
    with pytest.raises(UsageError, match=f"--{next(iter(change)).replace('_', '-')}"):
        AugmentConfig(**change).check()


# Samples -------------------------------------------------------------------------------------------------------------


def test_only_known_categories_are_learnt_and_ignored_ones_become_regions(tmp_path):
    picture = read_pictures(write_coco_folder(tmp_path / "photos", 1))[0]
    crowd = Annotation("anything", encode_mask(np.eye(64, dtype=bool)), ignore=True)
    nothing = Annotation("ball", encode_mask(np.zeros((64, 64), bool)))
    strange = Annotation("vase", encode_mask(np.ones((64, 64), bool)))
    picture = replace(picture, annotations=(*picture.annotations, crowd, nothing, strange))
    target = to_target(load_sample(picture, ("box", "ball")))
    assert target["labels"].tolist() == [{"box": 1, "ball": 2}[one.category] for one in picture.annotations[:2]]
    assert target["ignored"].tolist() == [[0.0, 0.0, 64.0, 64.0]]
    for box, mask in zip(target["boxes"], target["masks"], strict=True):
        rows, columns = mask.nonzero(as_tuple=True)
        assert box.tolist() == [columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]


def test_labels_are_there_for_sure_unless_scores_are_trusted(tmp_path):
    photos = read_pictures(write_coco_folder(tmp_path / "photos", 2))
    doubtful = with_annotations(photos, lambda one: replace(one, weight=0.4))
    for trusting, presence in ((False, 1.0), (True, 0.4)):
        dataset = ReplayDataset(doubtful, CATEGORIES, NO_AUGMENTATION, 3, trust_scores=trusting)
        target = to_target(dataset[0])
        assert target["weights"].tolist() == pytest.approx([0.4] * len(target["labels"]))
        assert target["presence"].tolist() == pytest.approx([presence] * len(target["labels"]))
        assert len(target["labels"])


def test_a_picture_without_labels_is_a_sample_like_any_other(tmp_path):
    picture = with_annotations(read_pictures(write_coco_folder(tmp_path / "photos", 1)), lambda one: None)[0]
    target = to_target(load_sample(picture, CATEGORIES))
    assert target["boxes"].shape == target["ignored"].shape == (0, 4)
    assert target["masks"].shape == (0, 64, 64)


def test_batches_hold_pictures_of_different_sizes():
    small, large = sample_of(0, 40), sample_of(1, 64)
    pictures, sizes, targets = collate([small, large])
    assert pictures.shape == (2, 3, 64, 64)
    assert sizes == [(40, 40), (64, 64)]
    np.testing.assert_array_equal(pictures[0, :, :40, :40].permute(1, 2, 0).numpy(), small.rgb)
    assert pictures[0, :, 40:].sum() == pictures[0, :, :, 40:].sum() == 0
    assert targets[0]["masks"].shape == (2, 64, 64)


@settings(max_examples=40)
@given(
    own=st.integers(1, 9), replayed=st.integers(1, 9), share=st.floats(0, 0.99), seed=st.integers(0, 99),
)  # fmt: skip
def test_replay_has_its_share_and_every_picture_its_turn(own, replayed, share, seed):
    nothing = AnnotatedPicture(Path("x"), (4, 4), ())
    dataset = ReplayDataset([nothing] * own, CATEGORIES, NO_AUGMENTATION, seed, [nothing] * replayed, share)
    drawn = [dataset.source(number) for number in range(200)]
    assert abs(sum(is_replay for is_replay, _ in drawn) - 200 * share) <= 1
    for kind, size in ((False, own), (True, replayed)):
        turns = [index for is_replay, index in drawn if is_replay is kind]
        for start in range(0, len(turns) - size + 1, size):
            assert sorted(turns[start : start + size]) == list(range(size))


def picture_of(*annotations: tuple[str, float] | None) -> AnnotatedPicture:
    """With labels of these categories and weights; None is a region to ignore."""
    found = [
        Annotation("ball", {}, ignore=True) if one is None else Annotation(one[0], {}, one[1]) for one in annotations
    ]
    return AnnotatedPicture(Path("x"), (4, 4), tuple(found))


def test_pictures_of_rare_categories_come_again():
    """Repeat factors as the paper has them: sqrt(t / f) of the rarest category of a picture."""
    pictures = [picture_of(("box", 1.0))] * 95 + [picture_of(("box", 1.0), ("ball", 1.0))] * 4 + [picture_of(None)]
    repeats = repeats_of(pictures, ("", "box", "ball"), 0.16)
    assert repeats[:95].tolist() == [1.0] * 95  # in more than 16 % of the pictures
    assert repeats[95:99].tolist() == pytest.approx([2.0] * 4)  # in 4 %
    assert repeats[99] == 1.0
    dataset = ReplayDataset(pictures, ("", "box", "ball"), NO_AUGMENTATION, 0, repeat_threshold=0.16)
    drawn = [dataset.source(number)[1] for number in range(104)]
    assert sorted(drawn) == sorted([*range(100), 95, 96, 97, 98])


@given(
    labels=st.lists(st.lists(st.tuples(st.sampled_from("abc"), st.floats(0, 1)), max_size=3), min_size=1, max_size=12),
    threshold=st.floats(0, 0.99),
)
def test_hardly_believed_labels_hardly_repeat_their_pictures(labels, threshold):
    pictures = [picture_of(*some) for some in labels]
    repeats = repeats_of(pictures, ("a", "b"), threshold)
    assert (repeats >= 1).all()
    for picture, repeat in zip(pictures, repeats, strict=True):
        expected = 1.0
        for one in picture.annotations:
            if one.category in ("a", "b"):
                weights = [
                    max((x.weight for x in p.annotations if x.category == one.category), default=0) for p in pictures
                ]
                share = max(sum(weights) / len(pictures), 1e-9)
                expected = max(expected, 1 + one.weight * (max(1, (threshold / share) ** 0.5) - 1))
        assert repeat == pytest.approx(expected)


def test_batches_do_not_depend_on_where_the_stream_is_taken_up(tmp_path):
    dataset = ReplayDataset(read_pictures(write_coco_folder(tmp_path / "photos", 3)), CATEGORIES, AugmentConfig(), 4)
    config = FinetuneConfig(batch_size=2, iterations=4)
    task: Any = SimpleNamespace(dataset=dataset, collate=collate, config=config, workers=0)
    whole, rest = (list(TrainingTask.batches(task, Progress(iteration=first))) for first in (0, 2))
    for (a, sizes_a, targets_a), (b, sizes_b, targets_b) in zip(whole[2:], rest, strict=True):
        assert torch.equal(a, b)
        assert sizes_a == sizes_b
        assert all(torch.equal(x["masks"], y["masks"]) for x, y in zip(targets_a, targets_b, strict=True))


def test_only_replayed_pictures_lack_names_for_new_categories(tmp_path):
    """And only where no replayed picture has the name: one that names some says where there are none."""
    photos = read_pictures(write_coco_folder(tmp_path / "photos", 3))
    taught = photos[0].annotations[0].category
    names = (*CATEGORIES, "beanbag")
    dataset = ReplayDataset(photos, names, AugmentConfig(crop=1.0), 4, photos, 0.5, ("beanbag", taught))
    for number in range(12):
        is_replay, _ = dataset.source(number)
        expected = [len(names)] if is_replay else []
        assert to_target(dataset[number])["unannotated"].tolist() == expected
    plain = ReplayDataset(photos, names, AugmentConfig(), 4, photos, 0.5)
    assert not any(plain[number].unannotated for number in range(6))


def test_nothing_to_train_on_is_refused():
    with pytest.raises(UsageError, match="no picture to train on"):
        ReplayDataset([], CATEGORIES, NO_AUGMENTATION, 0)
