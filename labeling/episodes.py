"""Episodes on disk: posed RGB-D views of one scene, with detections and ground truth where known.

An episode is a folder any RGB-D tool can open (docs/data-formats.md)::

    transforms.json      nerfstudio convention: fl_x fl_y cx cy w h, depth_unit_scale_factor, and per frame file_path,
                         depth_file_path and transform_matrix (camera to world, OpenGL camera axes)
    rgb/NNN.png          colour, 8 bit
    depth/NNN.png        z-depth, 16 bit, in units of depth_unit_scale_factor metres (default 0.001), 0 = no return
    detections.json      optional: COCO results (list) with RLE masks and scores
    ground_truth.json    optional: COCO instances, modal and amodal masks, 3-D boxes
    episode.json         optional: where it came from (world, seed, policy, versions, actions, reward terms, categories)
"""

import struct
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float, Float32, UInt8

from labeling.episode_json import Json, read_json
from labeling.errors import EpisodeFormatError
from labeling.files import atomic_folder, write_json
from labeling.geometry import flip_camera_axes, is_rigid
from labeling.instances import Box3d, Detection, GroundTruth, box_xywh, encode_mask

DEPTH_UNIT_M = 0.001
MAX_DEPTH_UNIT_M = 1000.0
MAX_FRAME_PX = 64_000_000


@dataclass(frozen=True)
class Episode:
    """The views of one episode as arrays, in the order they were taken."""

    name: str
    """Name of the episode's folder; empty for an episode that never was on disk."""
    rgb: UInt8[np.ndarray, "views h w 3"]
    depth_m: Float32[np.ndarray, "views h w"]
    """z-depth, 0 = no return."""
    intrinsics: Float[np.ndarray, "views 3 3"]
    camera_to_world: Float[np.ndarray, "views 4 4"]
    """OpenCV camera axes."""
    file_names: tuple[str, ...]
    """Colour files, relative to the episode's folder."""
    detections: tuple[Detection, ...] | None = None
    """None if no detector has looked."""
    ground_truth: tuple[GroundTruth, ...] | None = None
    """None if unknown."""
    categories: tuple[str, ...] = ()
    """Names of the categories that detector and ground truth speak of."""
    metadata: dict[str, Any] = field(default_factory=dict)
    """Content of episode.json."""

    @property
    def num_views(self) -> int:
        """How many views there are."""
        return len(self.rgb)

    @property
    def size(self) -> tuple[int, int]:
        """Picture height and width in pixels."""
        return self.rgb.shape[1], self.rgb.shape[2]


def find_episodes(dataset: Path) -> list[Path]:
    """Folders of the episodes of a dataset, sorted by name.

    Args:
        dataset: one episode, or a folder of episodes. Folders whose name starts with a dot are passed over.

    Raises:
        EpisodeFormatError: if the folder does not exist or holds no episode.
    """
    if not dataset.is_dir():
        raise EpisodeFormatError(f"{dataset}: no such folder; give an episode or a folder of episodes")
    if (dataset / "transforms.json").is_file():
        return [dataset]
    found = sorted(path.parent for path in dataset.glob("*/transforms.json") if not path.parent.name.startswith("."))
    if not found:
        raise EpisodeFormatError(
            f"{dataset}: no episode here; expected transforms.json in it or in the folders directly below it"
        )
    return found


def read_episode(folder: Path) -> Episode:
    """Reads and validates one episode.

    Raises:
        EpisodeFormatError: naming file and field, if anything is missing or malformed.
    """
    transforms = read_json(folder / "transforms.json")
    frames = transforms.list_of("frames")
    if not frames:
        raise frames_error(transforms, "frames", "has no frames; an episode needs at least one view")
    depth_unit_m = transforms.number("depth_unit_scale_factor", DEPTH_UNIT_M, above=0.0)
    if depth_unit_m > MAX_DEPTH_UNIT_M:
        problem = f"is metres per unit of depth; {depth_unit_m:g} is more than the {MAX_DEPTH_UNIT_M:g} accepted"
        raise frames_error(transforms, "depth_unit_scale_factor", problem)
    rgb, depth, intrinsics, poses, names = [], [], [], [], []
    for frame in frames:
        rgb_path = _inside(folder, frame, "file_path")
        depth_path = _inside(folder, frame, "depth_file_path")
        rgb.append(_read_rgb(rgb_path))
        if rgb[-1].shape != rgb[0].shape:
            raise EpisodeFormatError(
                f"{rgb_path}: is {_size(rgb[-1])} pixels, but the first view is {_size(rgb[0])}; "
                "all views of an episode have one size"
            )
        depth.append(_read_depth(depth_path, rgb[-1].shape[:2], depth_unit_m))
        intrinsics.append(_intrinsics(transforms, frame, rgb[-1]))
        poses.append(_camera_to_world(frame))
        names.append(frame.text("file_path"))
    episode = Episode(
        name=folder.resolve().name,
        rgb=np.stack(rgb),
        depth_m=np.stack(depth),
        intrinsics=np.stack(intrinsics),
        camera_to_world=np.stack(poses),
        file_names=tuple(names),
    )
    return _with_annotations(folder, episode)


def write_episode(folder: Path, episode: Episode) -> None:
    """Writes an episode; it appears under ``folder`` whole or not at all, and replaces what stood there.

    Depth is rounded to millimetres; returns beyond 65.535 m are written as 0 (no return).
    """
    with atomic_folder(folder) as temporary:
        (temporary / "rgb").mkdir()
        (temporary / "depth").mkdir()
        frames = []
        for view in range(episode.num_views):
            rgb_name, depth_name = f"rgb/{view:03d}.png", f"depth/{view:03d}.png"
            _write_png(temporary / rgb_name, cv2.cvtColor(episode.rgb[view], cv2.COLOR_RGB2BGR))
            _write_png(temporary / depth_name, _depth_to_units(episode.depth_m[view]))
            frames.append(
                {
                    "file_path": rgb_name,
                    "depth_file_path": depth_name,
                    "transform_matrix": flip_camera_axes(episode.camera_to_world[view]).tolist(),
                }
            )
        write_json(temporary / "transforms.json", _transforms(episode, frames))
        ids = {name: index + 1 for index, name in enumerate(_all_categories(episode))}
        if episode.detections is not None:
            write_json(temporary / "detections.json", [_detection_record(d, ids) for d in episode.detections])
        if episode.ground_truth is not None:
            write_json(temporary / "ground_truth.json", _ground_truth_record(episode, ids))
        categories = [{"id": index, "name": name} for name, index in ids.items()]
        write_json(temporary / "episode.json", {**episode.metadata, "categories": categories})


def frames_error(at: Json, name: str, problem: str) -> EpisodeFormatError:
    """An error about one field of one file."""
    return EpisodeFormatError(f"{at.where(name)}: {problem}")


# Reading -------------------------------------------------------------------------------------------------------------


def _inside(folder: Path, frame: Json, name: str) -> Path:
    """The file a frame refers to; refuses paths that lead out of the episode and files that are not there."""
    relative = frame.text(name)
    path = folder / relative
    try:
        leads_out, exists = not path.resolve().is_relative_to(folder.resolve()), path.is_file()
    except (OSError, UnicodeError, RuntimeError):  # too long, not writable as a file name, links in a circle
        raise frames_error(frame, name, f"{relative!r} cannot be a file name") from None
    if leads_out:
        raise frames_error(frame, name, f"{relative!r} leads out of the episode's folder")
    if not exists:
        raise frames_error(frame, name, f"{relative!r} does not exist")
    return path


def _read_png(path: Path) -> np.ndarray:
    """Reads a picture as it is stored; a truncated file is an error, not a picture with a grey half."""
    try:
        content = path.read_bytes()
    except OSError as error:
        raise EpisodeFormatError(f"{path}: cannot be read ({error})") from None
    if content[:8] == b"\x89PNG\r\n\x1a\n":
        if b"IEND" not in content[-16:]:
            raise EpisodeFormatError(f"{path}: the PNG is truncated ({len(content)} bytes); copy or export it again")
        # Checked before anything is decoded, so that a forged size cannot claim memory.
        width_px, height_px = struct.unpack(">II", content[16:24])
        if width_px * height_px > MAX_FRAME_PX:
            raise EpisodeFormatError(f"{path}: {width_px}x{height_px} pixels are more than the {MAX_FRAME_PX} accepted")
    try:
        image = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED) if content else None
    except cv2.error:
        image = None
    if image is None:
        raise EpisodeFormatError(f"{path}: not a picture that can be read ({len(content)} bytes); expected PNG or JPEG")
    if image.shape[0] * image.shape[1] > MAX_FRAME_PX:
        raise EpisodeFormatError(f"{path}: {_size(image)} pixels are more than the {MAX_FRAME_PX} accepted")
    return image


def _read_rgb(path: Path) -> UInt8[np.ndarray, "h w 3"]:
    image = _read_png(path)
    if image.dtype != np.uint8:
        raise EpisodeFormatError(f"{path}: colour must have 8 bits a channel, not {image.dtype}")
    if image.ndim == 2:
        return cv2.cvtColor(image, cv2.COLOR_GRAY2RGB)
    code = cv2.COLOR_BGRA2RGB if image.shape[2] == 4 else cv2.COLOR_BGR2RGB
    return cv2.cvtColor(image, code)


def _read_depth(path: Path, size: tuple[int, int], depth_unit_m: float) -> Float32[np.ndarray, "h w"]:
    image = _read_png(path)
    if image.ndim != 2 or image.dtype != np.uint16:
        raise EpisodeFormatError(f"{path}: depth must be a single-channel 16-bit PNG, not {image.dtype} {image.shape}")
    if image.shape != size:
        raise EpisodeFormatError(
            f"{path}: depth is {_size(image)} pixels but its colour picture is {size[1]}x{size[0]}; "
            "align depth to colour first"
        )
    # In double precision, so that writing what was read gives the same millimetres and reading them the same metres.
    return (image * np.float64(depth_unit_m)).astype(np.float32)


def _size(image: np.ndarray) -> str:
    return f"{image.shape[1]}x{image.shape[0]}"


def _intrinsics(transforms: Json, frame: Json, image: np.ndarray) -> Float[np.ndarray, "3 3"]:
    """K of a frame: the frame's own values where it has them, those of the whole episode elsewhere."""

    def value(name: str, above: float | None = None) -> float:
        return (frame if frame.has(name) else transforms).number(name, above=above)

    for name, side in (("w", image.shape[1]), ("h", image.shape[0])):
        holder = frame if frame.has(name) else transforms
        if holder.has(name) and value(name) != side:
            raise frames_error(holder, name, f"says {value(name):g} pixels, but {frame.text('file_path')} has {side}")
    return np.array([[value("fl_x", 0.0), 0.0, value("cx")], [0.0, value("fl_y", 0.0), value("cy")], [0.0, 0.0, 1.0]])


def _camera_to_world(frame: Json) -> Float[np.ndarray, "4 4"]:
    matrix = frame.array("transform_matrix", (4, 4))
    if not is_rigid(matrix):
        raise frames_error(
            frame, "transform_matrix", "is not a rigid transform (a rotation, a translation and a last row 0 0 0 1)"
        )
    return flip_camera_axes(matrix)


def _with_annotations(folder: Path, episode: Episode) -> Episode:
    """Adds what the optional files know."""
    from labeling.coco_records import CategoryTable, read_detections, read_ground_truth

    optional = {name: folder / name for name in ("episode.json", "ground_truth.json", "detections.json")}
    found = {name: read_json(path) for name, path in optional.items() if path.is_file()}
    table = CategoryTable.from_files([found[name] for name in ("ground_truth.json", "episode.json") if name in found])
    if "episode.json" in found:
        metadata = {key: value for key, value in found["episode.json"].mapping().items() if key != "categories"}
        episode = replace(episode, metadata=metadata)
    if "ground_truth.json" in found:
        episode = replace(episode, ground_truth=read_ground_truth(found["ground_truth.json"], table, episode))
    if "detections.json" in found:
        images = found.get("ground_truth.json")
        episode = replace(episode, detections=read_detections(found["detections.json"], table, episode, images))
    return replace(episode, categories=table.names)


# Writing -------------------------------------------------------------------------------------------------------------


def _write_png(path: Path, image: np.ndarray) -> None:
    ok, encoded = cv2.imencode(".png", image)
    assert ok
    path.write_bytes(encoded.tobytes())


def _depth_to_units(depth_m: Float32[np.ndarray, "h w"]) -> np.ndarray:
    units = np.rint(depth_m.astype(np.float64) / DEPTH_UNIT_M)
    return np.where((units > 0) & (units <= np.iinfo(np.uint16).max), units, 0).astype(np.uint16)


def _transforms(episode: Episode, frames: list[dict]) -> dict:
    height_px, width_px = episode.size
    shared = np.all(episode.intrinsics == episode.intrinsics[0])
    if not shared:
        for frame, intrinsics in zip(frames, episode.intrinsics, strict=True):
            frame.update(_intrinsics_record(intrinsics))
    return {
        "camera_model": "PINHOLE",
        "w": width_px,
        "h": height_px,
        **_intrinsics_record(episode.intrinsics[0]),
        "depth_unit_scale_factor": DEPTH_UNIT_M,
        "frames": frames,
    }


def _intrinsics_record(intrinsics: Float[np.ndarray, "3 3"]) -> dict:
    k = intrinsics.tolist()
    return {"fl_x": k[0][0], "fl_y": k[1][1], "cx": k[0][2], "cy": k[1][2]}


def _all_categories(episode: Episode) -> list[str]:
    """The declared categories, then any others that occur, in order of first appearance."""
    labels = [*(episode.detections or ()), *(episode.ground_truth or ())]
    return list(dict.fromkeys([*episode.categories, *(label.category for label in labels)]))


def _detection_record(detection: Detection, ids: dict[str, int]) -> dict:
    return {
        "image_id": detection.view_index,
        "category_id": ids[detection.category],
        "segmentation": encode_mask(detection.mask),
        "bbox": list(box_xywh(detection.mask)),
        "score": detection.confidence,
    }


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
