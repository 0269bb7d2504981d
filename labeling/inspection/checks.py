"""What can be wrong with a label set, one sentence per problem; unlike reading, inspection goes on after the first."""

from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from labeling.core.box_overlap import box_iou_3d
from labeling.core.errors import EpisodeFormatError, LabelFormatError
from labeling.core.masks import box_xywh
from labeling.core.rle import decode_mask, encode_mask
from labeling.core.types import Box3d
from labeling.formats.checked_json import Json, read_json
from labeling.io.coco import read_mask, read_size, read_valid_box_3d
from labeling.io.episodes import find_episodes
from labeling.io.file_names import AMODAL_FILE, BOXES_FILE, MODAL_FILE, SUMMARY_FILE, cloud_file
from labeling.io.label_set import calibration_note, recording_config, stated_dataset

BOX_TOLERANCE_PX = 1.0
SAME_CATEGORY_OVERLAP, ANY_CATEGORY_OVERLAP = 0.5, 0.8
"""3-D IoU from which on two objects are taken for one."""


@dataclass
class _Known:
    """What the files of a label set agree on, gathered as they are read."""

    episodes: dict[int, str]
    """Image id -> episode."""
    objects: dict[int, str]
    """Instance id -> episode, from boxes_3d.json."""
    sources: Counter[str]
    """How many confident detections, or outlines, the objects of an episode were made of."""
    used: set[str]
    """Categories that some label or object has."""


def inspect_label_set(folder: Path, notes: list[str] | None = None) -> list[str]:
    """Checks a label set.

    Args:
        folder: what ``labeling.generate`` wrote, or any other tool in its format.
        notes: gains what is worth knowing but no fault, such as categories without a label.

    Returns:
        One sentence per problem, beginning with file and field; none if all is well.

    Raises:
        LabelFormatError: if it cannot be read at all: a file is missing, is not JSON or has another structure.
    """
    if not folder.is_dir():
        raise LabelFormatError(f"{folder}: no such folder; give the --out folder of labeling.generate")
    try:
        modal = read_json(folder / MODAL_FILE)
        files = [modal, *(read_json(folder / name) for name in (AMODAL_FILE,) if (folder / name).is_file())]
        boxes = read_json(folder / BOXES_FILE)
        summary = read_json(folder / SUMMARY_FILE)
        return list(_problems(folder, files, boxes, summary, [] if notes is None else notes))
    except EpisodeFormatError as error:
        raise LabelFormatError(str(error)) from None


def _problems(folder: Path, files: list[Json], boxes: Json, summary: Json, notes: list[str]) -> Iterator[str]:
    known = _Known({}, {}, Counter(), set())
    names: dict[int, str] = {}
    for file in files:
        yield from _repeated(file, "categories")
        names.update({one.integer("id"): one.text("name") for one in file.list_of("categories")})
    yield from _check_boxes(boxes, names, known)
    masks: dict[str, dict[int, dict[str, Any]]] = {}
    for file in files:
        masks[file.file.name] = {}
        yield from _check_instances(file, names, known, masks[file.file.name])
    yield from _check_pairs(masks)
    unused = sorted(set(names.values()) - known.used)
    if unused:
        notes.append(f"no label has the categories {', '.join(unused)}")
    unmeasured = calibration_note(summary.mapping())
    notes += [unmeasured] if unmeasured else []
    yield from _check_sources(summary, known, notes)
    yield from _check_episodes(folder, summary, known)
    yield from _check_poses(summary, notes)
    yield from _check_registration(folder, summary)


def _check_sources(summary: Json, known: _Known, notes: list[str]) -> Iterator[str]:
    """Outlines and confident detections against the objects that were made of them."""
    for episode in summary.list_of("episodes"):
        unused = episode.integer("unused_sources") if episode.has("unused_sources") else 0
        if not unused:
            continue
        name = episode.text("name")
        given = known.sources[name] + unused
        if episode.has("sources") and episode.text("sources").startswith("weak: "):
            yield f"{episode.where()}: {unused} of {given} outlines of {name} gave no object; its notes name them"
        else:
            notes.append(f"{unused} of {given} confident detections of {name} are of no object")


def _repeated(file: Json, name: str) -> Iterator[str]:
    seen: set[int] = set()
    for record in file.list_of(name):
        number = record.integer("id")
        if number in seen:
            yield f"{record.where('id')}: {number} is given twice"
        seen.add(number)


def _check_boxes(boxes: Json, names: dict[int, str], known: _Known) -> Iterator[str]:
    found: defaultdict[str, list[tuple[Json, str, Box3d]]] = defaultdict(list)  # by episode
    moving = boxes.list_of("moving") if boxes.has("moving") else []
    records = [(record, True) for record in boxes.list_of("boxes")] + [(record, False) for record in moving]
    for record, has_box in records:
        number, episode = record.integer("instance_id"), record.text("episode")
        if number in known.objects:
            yield f"{record.where('instance_id')}: {number} is given twice"
        known.objects[number] = episode
        known.sources[episode] += len(record.list_of("sources")) if record.has("sources") else 0
        category_id = record.integer("category_id")
        if category_id not in names:
            yield f"{record.where('category_id')}: there is no category {category_id}"
        known.used.add(names.get(category_id, ""))
        yield from _check_score(record, "score")
        if not has_box:
            continue
        try:
            box = read_valid_box_3d(record)
        except EpisodeFormatError as error:
            yield str(error)
            continue
        for other, category, other_box in found[episode]:
            same = category == names.get(category_id)
            overlap = box_iou_3d(box, other_box)
            if overlap >= (SAME_CATEGORY_OVERLAP if same else ANY_CATEGORY_OVERLAP):
                yield (
                    f"{record.where()}: object {number} ({names.get(category_id)}) and object "
                    f"{other.integer('instance_id')} ({category}) of {episode} share {overlap:.0%} of their space; "
                    "are they one?"
                )
        found[episode].append((record, names.get(category_id, ""), box))


def _check_instances(
    file: Json, names: dict[int, str], known: _Known, masks: dict[int, dict[str, Any]]
) -> Iterator[str]:
    yield from _repeated(file, "images")
    yield from _repeated(file, "annotations")
    sizes = {}
    for image in file.list_of("images"):
        known.episodes[image.integer("id")] = image.text("episode")
        sizes[image.integer("id")] = read_size(image)
    seen: set[tuple[int, int]] = set()
    for record in file.list_of("annotations"):
        image_id, category_id = record.integer("image_id"), record.integer("category_id")
        ignored = record.flag("iscrowd")
        if record.has("ignore") and record.flag("ignore") != ignored:
            yield f"{record.where('ignore')}: is {int(not ignored)}, but iscrowd is {int(ignored)}"
        for name in ("image_id", "source_image_id"):
            if record.has(name) and record.integer(name) not in sizes:
                yield f"{record.where(name)}: there is no image {record.integer(name)}"
        if category_id not in names:
            yield f"{record.where('category_id')}: there is no category {category_id}"
        known.used.add(names.get(category_id, ""))
        # A region to be ignored need not be of any object.
        if not ignored or record.has("instance_id"):
            yield from _check_object(record, known, seen)
        for name in ("score", "source_score"):
            if record.has(name) or name == "score":
                yield from _check_score(record, name)
        if image_id in sizes:
            yield from _check_mask(record, sizes[image_id], masks)


def _check_object(record: Json, known: _Known, seen: set[tuple[int, int]]) -> Iterator[str]:
    image_id, number = record.integer("image_id"), record.integer("instance_id")
    if number not in known.objects:
        yield f"{record.where('instance_id')}: there is no object {number} in {BOXES_FILE}"
    elif known.objects[number] != known.episodes.get(image_id, known.objects[number]):
        yield f"{record.where('instance_id')}: object {number} belongs to episode {known.objects[number]}"
    if (image_id, number) in seen:
        yield f"{record.where()}: object {number} has a second label in image {image_id}"
    seen.add((image_id, number))


def _check_score(record: Json, name: str) -> Iterator[str]:
    value = record.get(name).value
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 <= value <= 1.0:
        yield f"{record.where(name)}: a score lies in [0, 1], not {value}"


def _check_mask(record: Json, size: tuple[int, int], masks: dict[int, dict[str, Any]]) -> Iterator[str]:
    height_px, width_px = size
    left, top, width, height = record.array("bbox", (4,)).tolist()
    if left < 0 or top < 0 or left + width > width_px or top + height > height_px:
        yield f"{record.where('bbox')}: {[left, top, width, height]} leaves the picture of {width_px}x{height_px}"
    try:
        mask = read_mask(record, "segmentation", size)
    except EpisodeFormatError as error:
        yield str(error)
        return
    masks[record.integer("id")] = encode_mask(mask)
    area = int(np.count_nonzero(mask))
    if area == 0:
        yield f"{record.where('segmentation')}: the mask is empty"
        return
    expected = box_xywh(mask)
    if np.abs(np.array(expected) - [left, top, width, height]).max() > BOX_TOLERANCE_PX:
        yield f"{record.where('bbox')}: is {[left, top, width, height]}, but the mask fills {list(expected)}"
    if record.has("area") and abs(record.number("area") - area) > max(1.0, 0.01 * area):
        yield f"{record.where('area')}: is {record.number('area'):g}, but the mask has {area} pixels"


def _check_pairs(masks: dict[str, dict[int, dict[str, Any]]]) -> Iterator[str]:
    """The visible part of an object belongs to the whole of it."""
    for number, visible in masks.get(MODAL_FILE, {}).items():
        whole = masks.get(AMODAL_FILE, {}).get(number)
        if whole is None or whole["size"] != visible["size"]:
            continue
        if np.any(decode_mask(visible) & ~decode_mask(whole)):
            yield f"{AMODAL_FILE}: the whole-object mask of label {number} lacks pixels of its visible part"


def _check_poses(summary: Json, notes: list[str]) -> Iterator[str]:
    """Poses that do not fit the depths; where better ones were found, that is a note."""
    for episode in summary.list_of("episodes"):
        if not episode.has("poses"):
            continue
        poses = episode.get("poses")
        if poses.has("warning"):
            told = f"{episode.text('name')}: {poses.text('warning')}"
            if poses.flag("refined"):
                notes.append(told)
            else:
                yield f"{poses.where()}: {told}"


def _check_episodes(folder: Path, summary: Json, known: _Known) -> Iterator[str]:
    from labeling.formats.ply import read_ply

    objects_of = Counter(known.objects.values())
    for episode in summary.list_of("episodes"):
        name = episode.text("name")
        if episode.text("status") != "labelled":
            error: Any = episode.value.get("error")
            yield f"{episode.where()}: {name} was not labelled ({error})"
            continue
        file = cloud_file(folder, name)
        try:
            cloud = read_ply(file)
            labels = set(np.unique(cloud["label"]).tolist()) - {0}
            lost = int(np.count_nonzero(~np.isfinite([cloud[axis] for axis in "xyz"]).all(axis=0)))
        except FileNotFoundError:
            yield f"{file}: the segmented cloud is missing"
            continue
        except (OSError, ValueError) as error:
            yield f"{file}: cannot be read ({error})"
            continue
        if lost:
            yield f"{file}: {lost} points have no finite place"
        objects = objects_of[name]
        if labels - set(range(1, objects + 1)):
            yield f"{file}: has points of object {max(labels)}, but the episode has {objects} objects"
    stated = {episode.text("name") for episode in summary.list_of("episodes")}
    for name in sorted(set(known.episodes.values()) - stated):
        yield f"{summary.where('episodes')}: does not tell of episode {name}, which has images"
    dataset = stated_dataset(folder, summary)
    if dataset is not None and dataset.is_dir():  # a label set may be looked at without its dataset
        for image in read_json(folder / MODAL_FILE).list_of("images"):
            if not (dataset / image.text("file_name")).is_file():
                yield f"{image.where('file_name')}: {image.text('file_name')!r} is not in {dataset}"


def _check_registration(folder: Path, summary: Json) -> Iterator[str]:
    """Depth that lies beside colour in the recordings that were labelled, as far as they are still there."""
    from labeling.io.recordings.registration import registration_problem

    dataset = stated_dataset(folder, summary)
    labelled = {one.text("name") for one in summary.list_of("episodes") if one.text("status") == "labelled"}
    config = recording_config(summary.mapping())
    try:
        paths = [] if dataset is None or not dataset.is_dir() else find_episodes(dataset, config)
        for path in paths:
            if path.resolve().name in labelled and (problem := registration_problem(path, config)) is not None:
                yield f"{path}: {problem}"
    except EpisodeFormatError as error:
        yield str(error)
