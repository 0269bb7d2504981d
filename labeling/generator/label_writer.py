"""A label set on disk: COCO JSON, 3-D boxes, segmented clouds, and where every label comes from.

Each finished episode is kept as one small record under ``episodes/``; the COCO files are put together from these
records, so that a rerun only labels what is new or has changed.
"""

import hashlib
import json
import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from labeling.core.rle import encode_mask, rle_area, rle_box_xywh
from labeling.generator.settings.label_config import LabelConfig
from labeling.io.file_names import AMODAL_FILE, BOXES_FILE, DETECTIONS_3D_FILE, MODAL_FILE, SUMMARY_FILE
from labeling.io.formats.atomic import write_json
from labeling.runtime.code_digest import code_digest
from labeling.runtime.provenance import package_versions

if TYPE_CHECKING:
    from labeling.core.episode import Episode
    from labeling.core.episode_labels import EpisodeLabels, LabelledObject
    from labeling.core.types import PseudoLabel

SCHEMA_VERSION = 2
_LIBRARIES = ("numpy", "numba", "opencv-python-headless", "scikit-learn")
"""What the labels depend on."""


@dataclass(frozen=True)
class EpisodeResult:
    """How it went with one episode."""

    name: str
    folder: str
    """Relative to the dataset; ``.`` if the dataset is the episode."""
    record: dict[str, Any] | None
    """What was labelled; None if the episode failed."""
    error: str | None = None


def fingerprint(folder: Path, config: LabelConfig, inputs: Any = None) -> str:
    """Changes whenever the labels of an episode might: with any input file, setting, library or generator module.

    Args:
        folder: the episode.
        config: settings of label generation.
        inputs: whatever else decides which views and masks are used, as JSON.
    """
    digest = hashlib.sha256()
    digest.update(
        json.dumps([SCHEMA_VERSION, asdict(config), package_versions(_LIBRARIES), inputs], sort_keys=True).encode()
    )
    digest.update(code_digest("labeling.generator.label_jobs").encode())
    for path in sorted(path for path in folder.rglob("*") if path.is_file()):
        relative = path.relative_to(folder)
        if not any(part.startswith(".") for part in relative.parts) and relative.name != DETECTIONS_3D_FILE:
            digest.update(str(relative).encode(errors="surrogateescape") + b"\0")
            digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()


def episode_record(
    episode: "Episode", labels: "EpisodeLabels", name: str, mark: str, origin: str = "", notes: Sequence[str] = ()
) -> dict[str, Any]:
    """One labelled episode as JSON; image and instance numbers count from 0 and 1 within it.

    Args:
        episode: its views.
        labels: what was found in them.
        name: of the episode.
        mark: its fingerprint.
        origin: where the masks came from that it was labelled from.
        notes: what a user should know about it.
    """
    height_px, width_px = episode.size
    named = (*labels.objects, *labels.ignored)
    return {
        "schema_version": SCHEMA_VERSION,
        "fingerprint": mark,
        "name": name,
        "sources": origin,
        "notes": list(notes),
        "width": width_px,
        "height": height_px,
        "file_names": list(episode.file_names),
        "categories": list(dict.fromkeys([*episode.categories, *(one.category for one in named)])),
        "objects": [object_record(one) for one in labels.objects],
        "labels": [label_record(one) for one in labels.labels],
        "ignored": [
            {
                "view": region.view_index,
                "instance_id": region.instance_id,
                "category": region.category,
                "score": round(region.confidence, 6),
                "modal": _mask_record(region.mask),
            }
            for region in labels.ignored
        ],
    }


def label_record(label: "PseudoLabel") -> dict[str, Any]:
    """A label as a record has it."""
    return {
        "view": label.view_index,
        "instance_id": label.instance_id,
        "category": label.category,
        "score": round(label.confidence, 6),
        "modal": _mask_record(label.modal),
        "amodal": _mask_record(label.amodal),
        "source_view": label.source_view_index,
        "source_score": label.source_confidence,
    }


def object_record(one: "LabelledObject") -> dict[str, Any]:
    """An object with a box as a record has it."""
    box = one.box_3d
    assert box is not None
    return {
        "instance_id": one.instance_id,
        "category": one.category,
        "score": round(one.confidence, 6),
        "centre": box.centre_m.tolist(),
        "extent": box.extent_m.tolist(),
        "rotation": box.rotation.tolist(),
        "sources": [asdict(source) for source in one.sources],
    }


def _mask_record(mask: np.ndarray) -> dict[str, Any] | None:
    """A mask as COCO wants it; None for an empty one."""
    rle = encode_mask(mask)
    area = rle_area(rle)
    return {"segmentation": rle, "bbox": rle_box_xywh(rle), "area": area} if area else None


def read_record(path: Path, mark: str) -> dict[str, Any] | None:
    """The record of a finished episode, if there is one that fits the fingerprint."""
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return None
    return record if isinstance(record, dict) and record.get("fingerprint") == mark else None


def write_label_set(
    out: Path,
    dataset: Path,
    config: LabelConfig,
    states: Sequence[EpisodeResult],
    inputs: dict[str, Any] | None = None,
) -> None:
    """Puts the records of all episodes together and writes the label set; ``label_set.json`` comes last.

    Args:
        out: folder of the label set.
        dataset: what was labelled.
        config: settings of label generation.
        states: how it went with each episode.
        inputs: more entries of ``label_set.json``: how the recordings were read, and where the masks came from.
    """
    images, boxes = [], []
    annotations: dict[str, list[dict[str, Any]]] = {"modal": [], "amodal": []}
    done = [state for state in states if state.record is not None]
    names = list(dict.fromkeys(name for state in done for name in (state.record or {})["categories"]))
    category_id = {name: number for number, name in enumerate(names, start=1)}
    counts = [len((state.record or {})["file_names"]) for state in done]
    first_images = {state.name: 1 + sum(counts[:place]) for place, state in enumerate(done)}
    instances, label_id = 0, 0
    for state in done:
        record, first_image = state.record or {}, first_images[state.name]
        images.extend(_images(state, record, first_image))
        for label in record["labels"]:
            label_id += 1
            shared = {
                "id": label_id,
                "image_id": first_image + label["view"],
                "category_id": category_id[label["category"]],
                "iscrowd": 0,
                "score": label["score"],
                "instance_id": instances + label["instance_id"],
                "source_image_id": first_images[label.get("source_episode", state.name)] + label["source_view"],
                "source_score": label["source_score"],
            }
            for kind, kept in annotations.items():
                if label[kind] is not None:
                    kept.append({**shared, **label[kind]})
        for region in record["ignored"]:
            label_id += 1
            annotations["modal"].append(
                {
                    "id": label_id,
                    "image_id": first_image + region["view"],
                    "category_id": category_id[region["category"]],
                    "iscrowd": 1,
                    "ignore": 1,
                    "score": region["score"],
                    **({} if region["instance_id"] is None else {"instance_id": instances + region["instance_id"]}),
                    **region["modal"],
                }
            )
        for one in record["objects"]:
            boxes.append(
                {
                    "episode": state.name,
                    **one,
                    "instance_id": instances + one["instance_id"],
                    "category_id": category_id[one["category"]],
                }
            )
        instances += max((one["instance_id"] for one in record["objects"]), default=0)
    about = {"description": "Pseudo-labels by Seeing by Moving", "version": str(SCHEMA_VERSION)}
    categories = [{"id": number, "name": name} for name, number in category_id.items()]
    for kind, kept in annotations.items():
        info = {**about, "masks": kind}
        content = {"info": info, "images": images, "categories": categories, "annotations": kept}
        write_json(out / {"modal": MODAL_FILE, "amodal": AMODAL_FILE}[kind], content)
    write_json(out / BOXES_FILE, {"info": about, "boxes": boxes})
    write_json(out / SUMMARY_FILE, {**_summary(out, dataset, config, states), **(inputs or {})})


def _images(state: EpisodeResult, record: dict[str, Any], first_image: int) -> list[dict[str, Any]]:
    prefix = "" if state.folder == "." else f"{state.folder}/"
    return [
        {
            "id": first_image + view,
            "file_name": prefix + file_name,
            "width": record["width"],
            "height": record["height"],
            "episode": state.name,
            "view": view,
        }
        for view, file_name in enumerate(record["file_names"])
    ]


def _summary(out: Path, dataset: Path, config: LabelConfig, states: Sequence[EpisodeResult]) -> dict[str, Any]:
    return {
        "schema_version": SCHEMA_VERSION,
        "dataset": Path(os.path.relpath(dataset.resolve(), out.resolve())).as_posix(),
        "dataset_as_given": str(dataset),
        "config": asdict(config),
        "versions": package_versions(_LIBRARIES),
        "episodes": [
            {
                "name": state.name,
                "folder": state.folder,
                "status": "failed" if state.record is None else "labelled",
                "error": state.error,
                "sources": None if state.record is None else state.record["sources"],
                "notes": [] if state.record is None else state.record["notes"],
                "fingerprint": None if state.record is None else state.record["fingerprint"],
                "objects": 0 if state.record is None else len(state.record["objects"]),
                "labels": 0 if state.record is None else len(state.record["labels"]),
            }
            for state in states
        ],
    }
