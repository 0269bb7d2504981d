"""Writes recordings as episodes, and label sets for other tools: ``python -m labeling.convert FOLDER --out OUT``."""

import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from labeling.core.errors import UsageError
from labeling.io.recordings.recording_config import RecordingConfig
from labeling.runtime.cli import make_main, progress_bar, say_next, showing_stages
from labeling.runtime.help import CommandHelp
from labeling.runtime.ranges import Share
from labeling.runtime.run_folder import check_outside_recordings

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from labeling.io.labelled_views import LabelledView

Target = Literal[
    "episode", "yolo-detect", "yolo-segment", "fiftyone", "hugging-face", "openlabel", "masks", "kitti", "gltf"
]


@dataclass(frozen=True)
class ConvertConfig:
    """Writes a recording as an episode, or, with --to, a label set in the format of another tool.

    Episodes have undistorted PNG pictures, depth in millimetres and in colour's pixels.
    ``labeling.generate`` reads recordings as they are; converting is for those with lens distortion, for thinning out
    long ones for good, and for tools that know only one format. Masks that lie beside the recording come along.
    Label sets are COCO JSON with clouds as PLY already; regions to ignore have no place in other formats.
    """

    recording_folder: tyro.conf.Positional[Annotated[Path, tyro.conf.arg(metavar="FOLDER")]]
    """A nerfstudio, Record3D, Polycam, TUM RGB-D or ScanNet folder; with --to a label set."""
    out: Path
    """The folder to write; it must not exist yet."""
    to: Target = "episode"
    """What to write: an episode, or of a label set boxes or polygons for YOLO, a dataset for FiftyOne or Hugging Face
    datasets, boxes, polygons and cuboids as OpenLABEL, masks as PNG, 3-D boxes for KITTI, or clouds with boxes as
    glTF."""
    dataset: Path | None = None
    """Of a label set: where the episodes lie. By default where the label set says it was made from."""
    min_confidence: Share[float] = 0.0
    """Of a label set: labels less confident than this are left out."""
    undistort: bool = False
    """Remove lens distortion (k1 k2 p1 p2 k3) from colour, depth and masks."""
    recording: tyro.conf.OmitArgPrefixes[RecordingConfig] = field(default_factory=RecordingConfig)


def run(config: ConvertConfig) -> None:
    """Converts one recording.

    Raises:
        SbmError: if it is malformed or the target is in use. Nothing is written then.
    """
    config.recording.check()
    if config.out.exists():
        raise UsageError(f"--out {config.out}: exists already; give a new folder")
    check_outside_recordings(config.out)
    if config.to == "episode":
        _convert_recording(config)
    else:
        _export(config)


def _convert_recording(config: ConvertConfig) -> None:
    from labeling.io.episodes import read_episode, write_episode

    if config.dataset is not None or config.min_confidence > 0:
        raise UsageError("--dataset and --min-confidence are for label sets; say with --to what to write of one")
    with progress_bar(total=1, unit="recording", desc="converting") as bar, showing_stages(bar):
        episode = read_episode(config.recording_folder, config.recording, undistort=config.undistort)
        try:
            write_episode(config.out, episode)
        except OSError as error:
            raise UsageError(f"--out {config.out}: cannot be written ({error})") from None
    for note in episode.notes:
        print(f"note: {note}")
    height_px, width_px = episode.size
    print(f"{episode.num_views} views of {width_px}x{height_px} pixels: {config.out}")
    if episode.detections is None:
        say_next("find things in it", "labeling.detect", config.out, "--detector", "compact")
    else:
        say_next("label what was detected in it", "labeling.generate", config.out, "--out", "LABELS")


def _export(config: ConvertConfig) -> None:
    """Writes a label set in the format of another tool."""
    from labeling.exports.gltf import write_gltf
    from labeling.formats.atomic import atomic_folder
    from labeling.inspection.scene import read_scenes
    from labeling.io.labelled_views import categories_of, labelled_views

    if config.undistort or config.recording != RecordingConfig():
        raise UsageError("how its recordings are read, a label set says itself; with --to these options have no place")
    if not 0 <= config.min_confidence <= 1:
        raise UsageError(f"--min-confidence must lie between 0 and 1, not {config.min_confidence:g}")
    if config.to == "gltf" and (config.min_confidence > 0 or config.dataset is not None):
        raise UsageError("glTF is written of clouds and their boxes: --dataset and --min-confidence have no place")
    categories = categories_of(config.recording_folder)
    bar = progress_bar(None, "view", desc="exporting")
    with bar, atomic_folder(config.out) as temporary:
        if config.to == "gltf":
            scenes = read_scenes(config.recording_folder)
            for scene in scenes:
                write_gltf(temporary / f"{scene.name}.glb", scene)
            print(f"{len(scenes)} clouds with {sum(len(scene.objects) for scene in scenes)} boxes: {config.out}")
            return
        views = _counted(labelled_views(config.recording_folder, config.dataset, config.min_confidence), bar)
        count = _write(config.to, temporary, views, categories)
        print(f"{count} labels in {bar.n} views: {config.out}")


def _write(to: str, folder: Path, views: "Iterable[LabelledView]", categories: "Sequence[str]") -> int:
    """Writes views into an empty folder; returns how many labels."""
    if to == "fiftyone":
        from labeling.exports.fiftyone import write_fiftyone

        return write_fiftyone(folder, views, categories)
    if to == "hugging-face":
        from labeling.exports.hugging_face import write_hugging_face

        return write_hugging_face(folder, views, categories)
    if to == "openlabel":
        from labeling.exports.openlabel import write_openlabel

        return write_openlabel(folder, views)
    if to == "masks":
        from labeling.exports.pictures import write_masks

        return write_masks(folder, views, categories)
    if to == "kitti":
        from labeling.exports.kitti import write_kitti

        return write_kitti(folder, views)
    from labeling.exports.yolo import write_yolo

    return write_yolo(folder, views, categories, segment=to == "yolo-segment")


def _counted(views: "Iterable[LabelledView]", bar: Any) -> "Iterator[LabelledView]":
    for view in views:
        bar.update()
        yield view


HELP = CommandHelp(
    examples=(
        ("RECORDING --undistort --out EPISODE", "a recording with lens distortion"),
        ("RECORDING --every 10 --out EPISODE", "every tenth frame of a long one"),
        ("LABELS --to yolo-segment --min-confidence 0.5 --out YOLO", "train YOLO on sure labels"),
        ("LABELS --to fiftyone --out FIFTYONE", "browse them in FiftyOne"),
        ("LABELS --to gltf --out CLOUDS", "clouds and boxes to show around"),
    ),
)
main = make_main("labeling.convert", ConvertConfig, run, resumes=False, about=HELP)

if __name__ == "__main__":
    sys.exit(main())
