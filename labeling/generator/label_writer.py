"""A label set on disk: COCO JSON, 3-D boxes, segmented clouds, and where every label comes from.

Each finished episode is kept as one small record under ``episodes/``; the COCO files are put together from these
records, so that a rerun only labels what is new or has changed.
"""

import os
from collections.abc import Sequence
from dataclasses import asdict, replace
from itertools import accumulate
from pathlib import Path
from typing import Any

from labeling.formats.atomic import write_json, write_records
from labeling.generator.label_jobs import LIBRARIES, EpisodeResult
from labeling.generator.settings.label_config import LabelConfig
from labeling.io.file_names import AMODAL_FILE, BOXES_FILE, MODAL_FILE, SUMMARY_FILE
from labeling.io.label_records import SCHEMA_VERSION, EpisodeRecord, as_json
from labeling.runtime.provenance import package_versions


def write_label_set(
    out: Path,
    dataset: Path,
    config: LabelConfig,
    results: Sequence[EpisodeResult],
    inputs: dict[str, Any] | None = None,
) -> None:
    """Puts the records of all episodes together and writes the label set; ``label_set.json`` comes last.

    Args:
        out: folder of the label set.
        dataset: what was labelled.
        config: settings of label generation.
        results: how it went with each episode.
        inputs: more entries of ``label_set.json``: how the recordings were read, and where the masks came from.
    """
    done = [(result, result.record) for result in results if result.record is not None]
    names = dict.fromkeys(name for _, record in done for name in record.categories)
    category_id = {name: number for number, name in enumerate(names, start=1)}
    first_images = dict(
        zip((one.name for one, _ in done), accumulate((len(r.file_names) for _, r in done), initial=1), strict=False)
    )
    images, boxes, moving = [], [], []
    annotations: dict[str, list[dict[str, Any]]] = {"modal": [], "amodal": []}
    first_instance, label_id = 0, 0
    for result, record in done:
        first_image = first_images[result.name]
        images.extend(_images(result, record, first_image))
        for label in record.labels:
            label_id += 1
            shared = {
                "id": label_id,
                "image_id": first_image + label.view,
                "category_id": category_id[label.category],
                "iscrowd": 0,
                "score": label.score,
                "instance_id": first_instance + label.instance_id,
                "source_image_id": first_images[label.source_episode or result.name] + label.source_view,
                "source_score": label.source_score,
            }
            for kind, mask in (("modal", label.modal), ("amodal", label.amodal)):
                if mask is not None:
                    annotations[kind].append({**shared, **as_json(mask)})
        for region in record.ignored:
            label_id += 1
            annotations["modal"].append(
                {
                    "id": label_id,
                    "image_id": first_image + region.view,
                    "category_id": category_id[region.category],
                    "iscrowd": 1,
                    "ignore": 1,
                    "score": region.score,
                    **({} if region.instance_id is None else {"instance_id": first_instance + region.instance_id}),
                    **as_json(region.modal),
                }
            )
        for one in record.objects:
            numbered = as_json(replace(one, instance_id=first_instance + one.instance_id))
            entry = {"episode": result.name, **numbered, "category_id": category_id[one.category]}
            (moving if one.box_3d is None else boxes).append(entry)
        first_instance += max((one.instance_id for one in record.objects), default=0)
    about = {"description": "Pseudo-labels by Seeing by Moving", "version": str(SCHEMA_VERSION)}
    categories = [{"id": number, "name": name} for name, number in category_id.items()]
    for kind, kept in annotations.items():
        info = {**about, "masks": kind}
        content = {"info": info, "images": images, "categories": categories, "annotations": kept}
        write_records(out / {"modal": MODAL_FILE, "amodal": AMODAL_FILE}[kind], content)
    write_records(out / BOXES_FILE, {"info": about, "boxes": boxes, **({"moving": moving} if moving else {})})
    write_json(out / SUMMARY_FILE, {**_summary(out, dataset, config, results), **(inputs or {})})


def uncalibrated_detectors(results: Sequence[EpisodeResult]) -> list[str]:
    """The detectors, each once, whose detections count without a calibration of their own."""
    named = {one.record.uncalibrated for one in results if one.record is not None}
    return sorted(name for name in named if name is not None)


def _images(result: EpisodeResult, record: EpisodeRecord, first_image: int) -> list[dict[str, Any]]:
    prefix = "" if result.folder == "." else f"{result.folder}/"
    return [
        {
            "id": first_image + view,
            "file_name": prefix + file_name,
            "width": record.width,
            "height": record.height,
            "episode": result.name,
            "view": view,
        }
        for view, file_name in enumerate(record.file_names)
    ]


def _summary(out: Path, dataset: Path, config: LabelConfig, results: Sequence[EpisodeResult]) -> dict[str, Any]:
    return {
        "schema_version": SCHEMA_VERSION,
        "dataset": Path(os.path.relpath(dataset.resolve(), out.resolve())).as_posix(),
        "dataset_as_given": str(dataset),
        "config": asdict(config),
        "versions": package_versions(LIBRARIES),
        "uncalibrated_detectors": uncalibrated_detectors(results),
        "episodes": [
            {
                "name": one.name,
                "folder": one.folder,
                "status": "failed" if one.record is None else "labelled",
                "error": one.error,
                "sources": one.record and one.record.sources,
                "notes": list(one.notes),
                **({"poses": one.record.poses.summary()} if one.record and one.record.poses else {}),
                "unused_sources": one.record.unused_sources if one.record else 0,
                "fingerprint": one.record and one.record.fingerprint,
                "objects": len(one.record.objects) if one.record else 0,
                "labels": len(one.record.labels) if one.record else 0,
            }
            for one in results
        ],
    }
