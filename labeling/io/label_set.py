"""Reading a label set from disk, as ``labeling.generate`` wrote it or as any other tool might."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from labeling.core.errors import EpisodeFormatError, LabelFormatError, UsageError
from labeling.core.rle import rle_area
from labeling.formats.checked_json import Json, read_json
from labeling.io.coco import CategoryTable, image_of, is_ignored, read_rle, read_score, read_size
from labeling.io.file_names import AMODAL_FILE, MODAL_FILE, RECORDS_FOLDER, SUMMARY_FILE
from labeling.io.recordings.recording_config import RecordingConfig
from labeling.metrics.matching import MaskInstance

View = tuple[str, int]
"""Name of an episode, and index of a view in it."""


@dataclass(frozen=True)
class LabelSet:
    """The pseudo-labels of a dataset, as records without pictures.

    Example:
        >>> empty = LabelSet(Path("LABELS"), None, {("kitchen", 0): (48, 64)}, (), (), (), {})
        >>> [view for view, size in empty.sizes.items() if size == (48, 64)]
        [('kitchen', 0)]
    """

    folder: Path
    dataset: Path | None
    """The dataset the labels were made from, as the label set states it; None if it does not say."""
    sizes: dict[View, tuple[int, int]]
    """Height and width in pixels of every view that was labelled, including those without any label."""
    modal: tuple[MaskInstance, ...]
    """``image`` is a ``View``; labels without a visible pixel are left out."""
    amodal: tuple[MaskInstance, ...]
    ignored: tuple[MaskInstance, ...]
    """Regions to leave out of account (COCO's ``iscrowd``): neither surely an object nor surely background."""
    provenance: dict[str, Any]
    """Content of ``label_set.json``; empty if there is none."""

    def find_dataset(self, given: Path | None = None) -> Path:
        """The dataset: the one given, or where the label set says.

        Raises:
            UsageError: if neither is known.
        """
        dataset = given or self.dataset
        if dataset is None:
            raise UsageError(
                f"{self.folder}: {SUMMARY_FILE} does not say which dataset it was made from; give --dataset"
            )
        return dataset


def read_label_set(folder: Path) -> LabelSet:
    """Reads and validates a label set.

    Raises:
        LabelFormatError: naming file and field, if anything is missing or malformed.

    Example:
        >>> import json, tempfile
        >>> image = {"id": 1, "file_name": "rgb/000.png", "width": 64, "height": 48, "episode": "kitchen", "view": 0}
        >>> with tempfile.TemporaryDirectory() as labels:
        ...     content = {"images": [image], "annotations": [], "categories": []}
        ...     _ = (Path(labels) / "instances_modal.json").write_text(json.dumps(content))
        ...     print(read_label_set(Path(labels)).sizes)
        {('kitchen', 0): (48, 64)}
    """
    if not folder.is_dir():
        raise LabelFormatError(f"{folder}: no such folder; give the --out folder of labeling.generate")
    if (folder / RECORDS_FOLDER).is_dir() and not (folder / SUMMARY_FILE).is_file():
        raise LabelFormatError(f"{folder}: labeling.generate has not finished here; run it again, and it goes on")
    try:
        sizes, modal = _read_instances(folder / MODAL_FILE)
        amodal: list[MaskInstance] = []
        if (folder / AMODAL_FILE).is_file():
            amodal_sizes, amodal = _read_instances(folder / AMODAL_FILE)
            if amodal_sizes != sizes:
                raise LabelFormatError(f"{folder / AMODAL_FILE}: images are not those of {MODAL_FILE}")
        provenance = read_json(folder / SUMMARY_FILE) if (folder / SUMMARY_FILE).is_file() else None
        dataset = stated_dataset(folder, provenance) if provenance else None
        stated = provenance.finite_mapping() if provenance else {}
    except EpisodeFormatError as error:
        raise LabelFormatError(str(error)) from None
    return LabelSet(
        folder=folder,
        dataset=dataset,
        sizes=sizes,
        modal=tuple(item for item in modal if not item.ignore),
        amodal=tuple(item for item in amodal if not item.ignore),
        ignored=tuple(item for item in modal if item.ignore),
        provenance=stated,
    )


def recording_config(provenance: dict[str, Any]) -> RecordingConfig:
    """How the recordings were read that a label set was made from: which of their frames are its views.

    Raises:
        LabelFormatError: if what the label set says about it makes no sense.
    """
    stated = provenance.get("recording", {})
    try:
        config = RecordingConfig(**{**stated, "camera": stated.get("camera") and tuple(stated["camera"])})
        config.check()
    except (TypeError, ValueError, AttributeError) as error:
        raise LabelFormatError(f"{SUMMARY_FILE}: recording: {error}") from None
    return config


def pose_warnings(provenance: dict[str, Any]) -> list[str]:
    """What a label set says of episodes whose poses do not fit their depths, a sentence each."""
    episodes = provenance.get("episodes")
    named = [one for one in episodes if isinstance(one, dict)] if isinstance(episodes, list) else []
    found = [(one.get("name"), one.get("poses")) for one in named]
    return [f"{name}: {poses['warning']}" for name, poses in found if isinstance(poses, dict) and poses.get("warning")]


def calibration_note(provenance: dict[str, Any]) -> str | None:
    """One sentence, if a label set was made with detectors that are not calibrated; None if not."""
    stated = provenance.get("uncalibrated_detectors")
    names = [str(name) or "a detector without a name" for name in stated] if isinstance(stated, list) else []
    if not names:
        return None
    return (
        f"what detections of {' and '.join(names)} are worth has not been measured, so confidences of labels are "
        "guessed from those of compact; to measure it, take episodes with ground truth and its detections: "
        "python -m labeling.detect EPISODES --detector NAME, then python -m experiments.calibrate_labels EPISODES"
    )


def stated_dataset(folder: Path, summary: Json) -> Path | None:
    """Where a label set says that its dataset lies: beside the label set or, failing that, the working directory."""
    if not summary.has("dataset"):
        return None
    stated = Path(summary.text("dataset"))
    beside = folder.resolve() / stated
    return beside if not stated.is_absolute() and beside.is_dir() else stated


def _read_instances(path: Path) -> tuple[dict[View, tuple[int, int]], list[MaskInstance]]:
    file = read_json(path)
    table = CategoryTable.from_files([file])
    view_of_image: dict[int, View] = {}
    sizes: dict[View, tuple[int, int]] = {}
    for image in file.list_of("images"):
        view = (image.text("episode"), image.integer("view"))
        if view in sizes:
            raise image.error(f"view {view[1]} of episode {view[0]!r} is listed twice", "view")
        view_of_image[image.integer("id")] = view
        sizes[view] = read_size(image)
    instances = []
    for record in file.list_of("annotations"):
        view = image_of(record, view_of_image)
        score, rle = read_score(record), read_rle(record, "segmentation", sizes[view])
        instances.append(MaskInstance(view, table.name(record), rle, score, is_ignored(record)))
    return sizes, [item for item in instances if rle_area(item.rle)]
