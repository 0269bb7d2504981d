"""Episodes on disk: posed RGB-D views of one scene, with detections and ground truth where known.

An episode is a folder that any RGB-D tool can open; docs/data-formats.md tells of its files.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float, Float32

from labeling.core.episode import Episode
from labeling.core.errors import EpisodeFormatError
from labeling.core.geometry import flip_camera_axes
from labeling.core.masks import box_xywh, box_xyxy
from labeling.core.rle import encode_mask
from labeling.core.types import Box3d, Detection
from labeling.formats.atomic import atomic_folder, write_json, write_png
from labeling.formats.checked_json import read_json
from labeling.io.file_names import ABOUT_FILE, DETECTIONS_FILE, MOTION_FILE, TRANSFORMS_FILE, TRUTH_FILE
from labeling.io.motion_file import motion_record, read_motion
from labeling.io.recordings.recording_config import RecordingConfig
from labeling.runtime.progress import view_counter

if TYPE_CHECKING:
    from labeling.core.views import RgbdViews
    from labeling.io.recordings.pictures import Undistortion

DEPTH_UNIT_M = 0.001
OPTIONAL_FILES = (ABOUT_FILE, TRUTH_FILE, DETECTIONS_FILE)
NAMING_FILES = (TRUTH_FILE, ABOUT_FILE)
"""Files that name the categories of the results in ``detections.json``."""


def find_episodes(dataset: Path, config: RecordingConfig | None = None) -> list[Path]:
    """Folders of the episodes (or other recordings) of a dataset, sorted by name.

    Args:
        dataset: one episode, or a folder of episodes. Folders whose name starts with a dot are passed over.
        config: the layout to look for; by default any.

    Raises:
        EpisodeFormatError: if the folder does not exist or holds no episode, or links lead to two of the same name.

    Example:
        >>> import tempfile
        >>> from labeling import RecordingConfig
        >>> with tempfile.TemporaryDirectory() as dataset:
        ...     (Path(dataset) / "kitchen").mkdir()
        ...     (Path(dataset) / "kitchen" / "transforms.json").touch()
        ...     print([folder.name for folder in find_episodes(Path(dataset), RecordingConfig(layout="nerfstudio"))])
        ['kitchen']
    """
    from labeling.io.recordings.layouts import expected_files, layout_of

    config = config or RecordingConfig()
    if not dataset.is_dir():
        raise EpisodeFormatError(f"{dataset}: no such folder; give an episode or a folder of episodes")
    if layout_of(dataset, config):
        return [dataset]
    below = sorted(path for path in dataset.iterdir() if path.is_dir() and not path.name.startswith("."))
    found = [path for path in below if layout_of(path, config)]
    called: dict[str, Path] = {}
    for path in found:
        other = called.setdefault(path.resolve().name, path)
        if other != path:
            raise EpisodeFormatError(
                f"{other} and {path} lead to two folders of the name {path.resolve().name}, which names their labels; "
                "rename one of these"
            )
    if not found:
        raise EpisodeFormatError(
            f"{dataset}: no episode here; looked, in it and in the {len(below)} folders directly below it, for "
            f"{expected_files(dataset, config)}"
        )
    return found


def read_episode(
    folder: Path,
    config: RecordingConfig | None = None,
    undistort: bool = False,
    ground_truth: bool = True,
    detections: bool = True,
) -> Episode:
    """Reads and validates one episode, or any other recording whose layout is known (labeling.io.recordings).

    Args:
        folder: the recording.
        config: its layout and which of its frames to take.
        undistort: remove lens distortion from pictures and masks; without it distorted pictures are refused.
        ground_truth: take ``ground_truth.json`` (whose masks are most of what is to be read) and ``motion.json`` too,
            where they are there.
        detections: take ``detections.json``, too.

    Raises:
        EpisodeFormatError: naming file and field, if anything is missing or malformed.

    Example:
        >>> from labeling import SbmError
        >>> try:
        ...     read_episode(Path("no/such/recording"))
        ... except SbmError as error:
        ...     print("refused")
        refused
    """
    from labeling.io.recordings.frames import load
    from labeling.io.recordings.layouts import frames_of
    from labeling.io.recordings.registration import offset_note

    found = frames_of(folder, config or RecordingConfig())
    views, undistortions, notes = load(found.frames, undistort)
    _check_focal_lengths(folder, views)
    names = tuple(frame.name for frame in found.frames)
    episode = Episode(
        **vars(views),
        name=folder.resolve().name,
        file_names=names,
        frame_names=() if names == found.names else found.names,
        notes=(*found.notes, *notes),
    )
    episode = _undistorted_masks(_with_annotations(folder, episode, ground_truth, detections), undistortions)
    if "world" in episode.metadata:  # a simulator's depth lies where its colour lies
        return episode
    beside = offset_note(views)
    return episode if beside is None else replace(episode, notes=(*episode.notes, beside))


def write_episode(folder: Path, episode: Episode) -> None:
    """Writes an episode; it appears under ``folder`` whole or not at all, and replaces what stood there.

    Depth is rounded to millimetres; returns of 65.535 m and beyond are written as 0 (no return).

    Example:
        >>> import tempfile
        >>> episode = Episode(
        ...     rgb=np.zeros((1, 48, 64, 3), np.uint8),
        ...     depth_m=np.full((1, 48, 64), 2.0, np.float32),
        ...     intrinsics=np.array([[60.0, 0, 31.5], [0, 60.0, 23.5], [0, 0, 1]])[None],
        ...     camera_to_world=np.eye(4)[None],
        ...     name="kitchen",
        ...     file_names=("rgb/000.png",),
        ... )
        >>> with tempfile.TemporaryDirectory() as dataset:
        ...     write_episode(Path(dataset) / "kitchen", episode)
        ...     print(read_episode(Path(dataset) / "kitchen").depth_m.max())
        2.0
    """
    with atomic_folder(folder) as temporary:
        written = view_counter("writing", episode.num_views)
        frames, cameras_differ = [], bool(np.any(episode.intrinsics != episode.intrinsics[0]))
        for view in range(episode.num_views):
            rgb_name, depth_name = f"rgb/{view:03d}.png", f"depth/{view:03d}.png"
            write_png(temporary / rgb_name, episode.rgb[view])
            write_png(temporary / depth_name, _depth_to_units(episode.depth_m[view]))
            frames.append(
                {
                    "file_path": rgb_name,
                    "depth_file_path": depth_name,
                    "transform_matrix": flip_camera_axes(episode.camera_to_world[view]).tolist(),
                    **(_intrinsics_record(episode.intrinsics[view]) if cameras_differ else {}),
                }
            )
            written(1)
        transforms = {
            "camera_model": "PINHOLE",
            "w": episode.size[1],
            "h": episode.size[0],
            **_intrinsics_record(episode.intrinsics[0]),
            "depth_unit_scale_factor": DEPTH_UNIT_M,
            "frames": frames,
        }
        write_json(temporary / TRANSFORMS_FILE, transforms)
        # The declared categories, then any others that occur.
        named = [
            *episode.categories,
            *(one.category for one in (*(episode.detections or ()), *(episode.ground_truth or ()))),
        ]
        ids = {name: number for number, name in enumerate(dict.fromkeys(named), start=1)}
        if episode.detections is not None:
            write_json(temporary / DETECTIONS_FILE, [detection_record(d, ids) for d in episode.detections])
        if episode.ground_truth is not None:
            write_json(temporary / TRUTH_FILE, _ground_truth_record(episode, ids))
        if episode.motion is not None:
            write_json(temporary / MOTION_FILE, motion_record(episode))
        categories = [{"id": index, "name": name} for name, index in ids.items()]
        write_json(temporary / ABOUT_FILE, {**episode.metadata, "categories": categories})


# Reading -------------------------------------------------------------------------------------------------------------


FOCAL_LENGTHS = (0.01, 100.0)
"""Least and largest focal length that is believed, as shares of a picture's longer side: 179 and 0.6 degrees."""


def _check_focal_lengths(folder: Path, views: "RgbdViews") -> None:
    """Refuses intrinsics that no camera has: other units than pixels, or nonsense.

    Raises:
        EpisodeFormatError: naming the view.
    """
    focal_px, longest = views.intrinsics[:, [0, 1], [0, 1]], max(views.size)
    low, high = (share * longest for share in FOCAL_LENGTHS)
    bad = np.flatnonzero(((focal_px < low) | (focal_px > high)).any(axis=1))
    if len(bad):
        fx, fy = focal_px[bad[0]].tolist()
        raise EpisodeFormatError(
            f"{folder}: view {bad[0]}: focal lengths of {fx:g} and {fy:g} pixels in pictures of "
            f"{views.size[1]}x{views.size[0]}; expected {low:g} to {high:g}: check their unit, which is pixels"
        )


def _with_annotations(folder: Path, episode: Episode, ground_truth: bool, detections: bool) -> Episode:
    from labeling.io.coco import CategoryTable, read_detections, read_ground_truth

    wanted = (name for name in OPTIONAL_FILES if detections or name != DETECTIONS_FILE)
    found = {name: read_json(folder / name) for name in wanted if (folder / name).is_file()}
    table = CategoryTable.from_files([found[name] for name in NAMING_FILES if name in found])
    if ABOUT_FILE in found:
        metadata = {key: value for key, value in found[ABOUT_FILE].finite_mapping().items() if key != "categories"}
        episode = replace(episode, metadata=metadata)
    if TRUTH_FILE in found and ground_truth:
        episode = replace(episode, ground_truth=read_ground_truth(found[TRUTH_FILE], table, episode))
    if ground_truth and (folder / MOTION_FILE).is_file():
        episode = replace(episode, motion=read_motion(read_json(folder / MOTION_FILE), episode))
    if DETECTIONS_FILE in found:
        images = found.get(TRUTH_FILE)
        episode = replace(episode, detections=read_detections(found[DETECTIONS_FILE], table, episode, images))
        if note := _not_looked_at(episode):
            episode = replace(episode, notes=(*episode.notes, note))
    return replace(episode, categories=table.names)


def _not_looked_at(episode: Episode) -> str | None:
    """What to say of an episode with more views than ``labeling.detect`` has looked at; None of others."""
    run = episode.metadata.get("detector_run")
    looked_at = run.get("views") if isinstance(run, dict) else None
    if not isinstance(looked_at, int) or looked_at >= episode.num_views:
        return None
    return (
        f"the detector has looked at {looked_at} of these {episode.num_views} views, and the others count as ones in "
        "which it found nothing; give --every and --max-views as they were given to labeling.detect"
    )


def _undistorted_masks(episode: Episode, undistortions: "Sequence[Undistortion | None]") -> Episode:
    """Moves masks that were drawn on distorted pictures onto the undistorted ones; detections of which nothing is left
    there are left out.
    """
    if not any(undistortions):
        return episode

    def moved(view_index: int, mask: Any) -> Any:
        undistortion = undistortions[view_index]
        return mask if undistortion is None or mask is None else undistortion.mask(mask)

    def moved_detection(one: Detection) -> Detection:
        mask = moved(one.view_index, one.mask)
        return replace(one, mask=mask, box_xyxy=None if one.box_xyxy is None else box_xyxy(mask))

    detections, truths = episode.detections, episode.ground_truth
    return replace(
        episode,
        detections=detections and tuple(one for one in map(moved_detection, detections) if one.mask.any()),
        ground_truth=truths
        and tuple(replace(t, modal=moved(t.view_index, t.modal), amodal=moved(t.view_index, t.amodal)) for t in truths),
        notes=(*episode.notes, f"lens distortion was removed from {sum(map(bool, undistortions))} views"),
    )


# Writing -------------------------------------------------------------------------------------------------------------


def _depth_to_units(depth_m: Float32[np.ndarray, "h w"]) -> np.ndarray:
    units = np.rint(depth_m.astype(np.float64) / DEPTH_UNIT_M)
    return np.where((units > 0) & (units < np.iinfo(np.uint16).max), units, 0).astype(np.uint16)


def _intrinsics_record(intrinsics: Float[np.ndarray, "3 3"]) -> dict:
    k = intrinsics.tolist()
    return {"fl_x": k[0][0], "fl_y": k[1][1], "cx": k[0][2], "cy": k[1][2]}


def detection_record(detection: Detection, ids: dict[str, int]) -> dict[str, Any]:
    """A detection as a COCO result; ``ids`` are those of the categories."""
    record = {
        "image_id": detection.view_index,
        "category_id": ids[detection.category],
        "segmentation": encode_mask(detection.mask),
        "bbox": list(box_xywh(detection.mask)),
        "score": detection.confidence,
    }
    if detection.box_xyxy is not None:
        left, top, right, bottom = detection.box_xyxy
        record |= {"bbox": [left, top, right - left, bottom - top], "mask_from_box": True}
    return record


def _ground_truth_record(episode: Episode, ids: dict[str, int]) -> dict:
    height_px, width_px = episode.size
    annotations = []
    for number, label in enumerate(episode.ground_truth or ()):
        record: dict[str, Any] = {
            "id": number + 1,
            "image_id": label.view_index,
            "category_id": ids[label.category],
            "instance_id": label.instance_id,
            "segmentation": encode_mask(label.modal),
            "bbox": list(box_xywh(label.modal)),
            "area": int(np.count_nonzero(label.modal)),
            "iscrowd": int(label.ignore),
        }
        if label.amodal is not None:
            record["amodal_segmentation"] = encode_mask(label.amodal)
        if label.box_3d is not None:
            record["box_3d"] = box_3d_record(label.box_3d)
        annotations.append(record)
    images = [
        {"id": view, "file_name": f"rgb/{view:03d}.png", "width": width_px, "height": height_px}
        for view in range(episode.num_views)
    ]
    categories = [{"id": index, "name": name} for name, index in ids.items()]
    return {"images": images, "annotations": annotations, "categories": categories}


def box_3d_record(box: Box3d) -> dict:
    """A 3-D box as JSON: centre and extent in metres, rotation as rows."""
    return {"centre": box.centre_m.tolist(), "extent": box.extent_m.tolist(), "rotation": box.rotation.tolist()}
