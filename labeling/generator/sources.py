"""Finds the masks that an episode is labelled from: detections of a file or a detector, or a person's masks."""

import hashlib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from labeling.core.detector import run_detector
from labeling.core.episode import Episode
from labeling.core.errors import EpisodeFormatError, UsageError
from labeling.core.types import Detection
from labeling.detectors.registry import detector_by_name
from labeling.formats.atomic import write_json
from labeling.formats.checked_json import read_json
from labeling.formats.regular_file import regular
from labeling.generator.calibration.detector_calibration import is_calibrated
from labeling.generator.detection_pooling import pool_detections
from labeling.generator.objects.weak_supervision import one_view_per_object
from labeling.generator.settings.label_config import LabelConfig
from labeling.generator.settings.source_config import SourceConfig
from labeling.io.coco import CategoryTable, read_detections, read_shared_file
from labeling.io.episodes import NAMING_FILES, detection_record
from labeling.runtime.progress import view_counter

DETECTIONS_FOLDER = "detections"


@dataclass(frozen=True)
class Sources:
    """The masks that an episode is labelled from."""

    detections: tuple[Detection, ...]
    origin: str
    """Where they come from, for the records."""
    notes: tuple[str, ...] = ()
    detector: str | None = None
    """What made the detections, if that is known."""

    @property
    def uncalibrated(self) -> str | None:
        """The detector, if it has no calibration of its own; empty if nothing names it, None for a person's masks."""
        needed = any(not one.exact for one in self.detections) and not is_calibrated(self.detector)
        return self.detector or "" if needed else None


def find_sources(
    folder: Path, episode: Episode, place: str, config: SourceConfig, label: LabelConfig, cache: Path
) -> Sources:
    """Finds the masks that an episode is labelled from.

    Args:
        folder: of the episode.
        episode: the views.
        place: folder of the episode relative to its dataset, ``.`` if it is the dataset.
        config: where to look.
        label: settings of label generation; their seed chooses the views of weak supervision from ground truth.
        cache: file that keeps the detections, where they are not the episode's own; read back if it still fits.

    Raises:
        SbmError: if there are none, or their file or detector is at fault.
    """
    if config.annotations is not None:
        found, notes = read_shared_file(read_json(config.annotations), episode, place, scored=False)
        return Sources(found, f"weak: {config.annotations}", notes)
    if config.is_weak:
        if episode.ground_truth is None:
            raise EpisodeFormatError(
                f"{episode.name}: has no ground_truth.json to take one view per object from; give your annotations "
                "with --annotations FILE"
            )
        chosen = one_view_per_object(episode.ground_truth, episode.depth_m, label.min_mask_px, label.seed, episode.name)
        return Sources(chosen, f"weak: one random view per object of ground_truth.json, seed {label.seed}")
    if config.detector is not None:
        found = _detect(episode, config.detector, cache)
        return _with_recorded(found, episode) if config.with_recorded else found
    if config.detections is not None:
        found, notes = _read_detections(config.detections, folder, episode, place)
        write_json(cache, detections_record(episode, found, {"origin": str(config.detections)}))
        return Sources(found, str(config.detections), notes)
    if episode.detections is None:
        raise EpisodeFormatError(
            f"{episode.name}: has no detections.json; run a detector on the views first, or give --detections FILE, "
            "--detector NAME (such as compact), or your own masks with --annotations FILE"
        )
    made_by = episode.metadata.get("detector")
    return Sources(episode.detections, "detections.json", detector=made_by if isinstance(made_by, str) else None)


def source_fingerprint(config: SourceConfig) -> list[Any]:
    """Changes whenever the sources might: the settings, and the files and the code they name."""
    known: list[Any] = [config.weak, config.detector, config.with_recorded]
    for path in (config.detections, config.annotations):
        known.append(path and hashlib.sha256(regular(path).read_bytes()).hexdigest())
    if config.detector is not None:
        known.append(detector_by_name(config.detector).digest)
    return known


def detections_record(episode: Episode, detections: tuple[Detection, ...], info: dict[str, Any]) -> dict[str, Any]:
    """Detections as one COCO file, which ``--detections`` takes as well."""
    height_px, width_px = episode.size
    names = dict.fromkeys([*episode.categories, *(one.category for one in detections)])
    ids = {name: number for number, name in enumerate(names, start=1)}
    return {
        "info": info,
        "images": [
            {"id": view, "file_name": name, "width": width_px, "height": height_px}
            for view, name in enumerate(episode.file_names)
        ],
        "categories": [{"id": number, "name": name} for name, number in ids.items()],
        "annotations": [{"id": k, **detection_record(one, ids)} for k, one in enumerate(detections, start=1)],
    }


def with_source_detections(episode: Episode, labels: Path, provenance: dict[str, Any]) -> Episode:
    """The episode with the detections that its labels were made from, where the label set keeps these.

    Args:
        episode: as it lies on disk.
        labels: folder of the label set.
        provenance: content of its ``label_set.json``.
    """
    stated = provenance.get("sources")
    sources = stated if isinstance(stated, dict) else {}
    kept = labels / DETECTIONS_FOLDER / f"{episode.name}.json"
    if not (sources.get("detections") or sources.get("detector")) or not kept.is_file():
        return episode
    file = read_json(kept)
    used = replace(episode, detections=read_shared_file(file, episode, ".", scored=True)[0])
    if not sources.get("detector"):
        return used
    # What the episode says about its own detector is not true of this one.
    info = file.get("info").mapping() if file.has("info") else {}
    metadata = {key: value for key, value in episode.metadata.items() if key != "detector_categories"}
    known = info.get("detector_categories")
    if sources.get("with_recorded"):
        used = replace(used, detections=pool_detections(used.detections or (), episode.detections or ()))
        recorded = episode.metadata.get("detector_categories")
        known = None if known is None or recorded is None else [*dict.fromkeys([*known, *recorded])]
    return replace(used, metadata=metadata if known is None else {**metadata, "detector_categories": known})


def _detect(episode: Episode, name: str, cache: Path) -> Sources:
    detector = detector_by_name(name)
    digest = hashlib.sha256(f"{name}\0{detector.digest}".encode())
    digest.update(episode.rgb.tobytes())
    digest.update(episode.depth_m.tobytes())
    mark = digest.hexdigest()
    if cache.is_file():
        try:
            file = read_json(cache)
            if file.get("info").mapping().get("fingerprint") == mark:
                return Sources(read_shared_file(file, episode, ".", scored=True)[0], f"detector {name}", detector=name)
        except EpisodeFormatError:
            pass  # damaged: made again below
    found = run_detector(detector, episode, view_counter("detecting in", episode.num_views))
    known = None if detector.categories is None else list(detector.categories)
    write_json(
        cache,
        detections_record(episode, found, {"origin": name, "fingerprint": mark, "detector_categories": known}),
    )
    return Sources(found, f"detector {name}", detector=name)


def _with_recorded(found: Sources, episode: Episode) -> Sources:
    if episode.detections is None:
        raise EpisodeFormatError(
            f"{episode.name}: has no detections.json to take beside what the detector finds; leave out --with-recorded"
        )
    return replace(
        found,
        detections=pool_detections(found.detections, episode.detections),
        origin=f"{found.origin} and detections.json",
    )


def _read_detections(
    path: Path, folder: Path, episode: Episode, place: str
) -> tuple[tuple[Detection, ...], tuple[str, ...]]:
    file = read_json(path)
    if not isinstance(file.value, list):
        return read_shared_file(file, episode, place, scored=True)
    if place != ".":
        raise UsageError(
            f"--detections {path}: a bare list of results does not tell which episode it speaks of; label one "
            "episode at a time, or add images (with file_name), categories and annotations"
        )
    # Its ids mean what they would mean in the episode's own detections.json.
    naming = {name: read_json(folder / name) for name in NAMING_FILES if (folder / name).is_file()}
    table = CategoryTable.from_files(list(naming.values()))
    return read_detections(file, table, episode, naming.get("ground_truth.json")), ()
