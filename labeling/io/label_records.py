"""One labelled episode as a label set keeps it under ``episodes/``: typed in memory, JSON at the border.

The fields of a record are those of its JSON, in this order; a field that is None by default is left out. msgspec reads
records back.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np
from jaxtyping import Bool

from labeling.core.episode_labels import LabelledObject, Source
from labeling.core.pose_check import PoseCheck
from labeling.core.rle import encode_mask, rle_area, rle_box_xywh
from labeling.core.types import Box3d, PseudoLabel
from labeling.formats.regular_file import regular

if TYPE_CHECKING:
    from labeling.core.episode import Episode
    from labeling.core.episode_labels import EpisodeLabels

SCHEMA_VERSION = 2


@dataclass(frozen=True)
class MaskRecord:
    """A mask with at least one pixel, as COCO wants it."""

    segmentation: dict[str, Any]
    bbox: tuple[float, ...]
    """Left, top, width, height in pixels."""
    area: int

    @classmethod
    def of(cls, mask: Bool[np.ndarray, "h w"]) -> "MaskRecord | None":
        """The record of a mask; None for an empty one."""
        rle = encode_mask(mask)
        area = rle_area(rle)
        return cls(rle, tuple(rle_box_xywh(rle)), area) if area else None


@dataclass(frozen=True)
class LabelRecord:
    """A pseudo-label."""

    view: int
    instance_id: int
    category: str
    score: float
    modal: MaskRecord | None
    amodal: MaskRecord | None
    source_view: int
    source_score: float
    source_episode: str | None = None
    """The episode that found the object, if it is another one of the scene."""

    @classmethod
    def of(cls, label: PseudoLabel, source_episode: str | None = None) -> "LabelRecord":
        """The record of a label."""
        named = label.view_index, label.instance_id, label.category, round(label.confidence, 6)
        masks = MaskRecord.of(label.modal), MaskRecord.of(label.amodal)
        return cls(*named, *masks, label.source_view_index, label.source_confidence, source_episode)


@dataclass(frozen=True)
class IgnoredRecord:
    """A region to ignore."""

    view: int
    instance_id: int | None
    category: str
    score: float
    modal: MaskRecord | None


@dataclass(frozen=True)
class ObjectRecord:
    """An object with its 3-D box, if it stands still: centre and extent in metres, rows of the rotation."""

    instance_id: int
    category: str
    score: float
    centre: list[float] | None = None
    extent: list[float] | None = None
    rotation: list[list[float]] | None = None
    sources: tuple[Source, ...] = ()
    shared_from: dict[str, Any] | None = None
    """Episode and instance id of the same object, if another episode of the scene found it."""
    only_here: bool | None = None
    """True if it is not where it is in other episodes of its scene."""

    @classmethod
    def of(cls, one: LabelledObject, shared_from: dict[str, Any] | None = None) -> "ObjectRecord":
        """The record of an object."""
        named = one.instance_id, one.category, round(one.confidence, 6)
        if one.box_3d is None:
            return cls(*named, sources=one.sources, shared_from=shared_from)
        centre, extent, rotation = one.box_3d.centre_m, one.box_3d.extent_m, one.box_3d.rotation
        box = centre.tolist(), extent.tolist(), rotation.tolist()
        return cls(*named, *box, one.sources, shared_from, True if one.only_here else None)

    @property
    def box_3d(self) -> Box3d | None:
        """The box; None if the object moves."""
        if self.centre is None:
            return None
        return Box3d(*(np.asarray(value, float) for value in (self.centre, self.extent, self.rotation)))


@dataclass(frozen=True)
class EpisodeRecord:
    """One labelled episode; image and instance numbers count from 0 and 1 within it."""

    schema_version: int
    fingerprint: str
    """Of everything that its labels depend on."""
    name: str
    sources: str
    """Where the masks came from that it was labelled from."""
    notes: tuple[str, ...]
    """What a user should know about it."""
    width: int
    height: int
    file_names: tuple[str, ...]
    categories: tuple[str, ...]
    objects: tuple[ObjectRecord, ...]
    labels: tuple[LabelRecord, ...]
    ignored: tuple[IgnoredRecord, ...]
    poses: PoseCheck | None = None
    unused_sources: int = 0
    """Confident detections, or outlines, that no object was made of."""
    uncalibrated: str | None = None
    """The detector, where its detections count without a calibration of its own; empty if nothing names it."""


def episode_record(
    episode: "Episode",
    labels: "EpisodeLabels",
    fingerprint: str,
    sources: str = "",
    notes: Sequence[str] = (),
    unused_sources: int = 0,
    uncalibrated: str | None = None,
) -> EpisodeRecord:
    """The record of a labelled episode.

    Args:
        episode: its views.
        labels: what was found in them.
        fingerprint: of everything that the labels depend on.
        sources: where the masks came from that it was labelled from.
        notes: what a user should know about it.
        unused_sources: how many confident detections, or outlines, no object was made of.
        uncalibrated: the detector, where its detections count without a calibration of its own.
    """
    named = (*labels.objects, *labels.ignored)
    return EpisodeRecord(
        schema_version=SCHEMA_VERSION,
        fingerprint=fingerprint,
        name=episode.name,
        sources=sources,
        notes=tuple(notes),
        width=episode.size[1],
        height=episode.size[0],
        file_names=episode.file_names,
        categories=tuple(dict.fromkeys([*episode.categories, *(one.category for one in named)])),
        objects=tuple(ObjectRecord.of(one) for one in labels.objects),
        labels=tuple(LabelRecord.of(one) for one in labels.labels),
        ignored=tuple(
            IgnoredRecord(
                one.view_index, one.instance_id, one.category, round(one.confidence, 6), MaskRecord.of(one.mask)
            )
            for one in labels.ignored
        ),
        poses=labels.poses,
        unused_sources=unused_sources,
        uncalibrated=uncalibrated,
    )


def as_json(record: Any) -> Any:
    """A record, or any part of one, as JSON values."""
    kind = type(record)
    if kind in _PLAIN:
        return record
    if isinstance(record, list | tuple):
        return [one if type(one) in _PLAIN else as_json(one) for one in record]
    names = _field_names(kind)
    if names is None:
        return record
    found = {}
    for name, optional in names:
        value = getattr(record, name)
        if not (optional and value is None):
            found[name] = value if type(value) in _PLAIN else as_json(value)
    return found


_PLAIN = frozenset((str, int, float, bool, type(None)))
"""Types of values that are JSON as they are; most are, so that they are told by a look-up."""


@cache
def _field_names(kind: type) -> tuple[tuple[str, bool], ...] | None:
    """The fields of a dataclass and whether they are None by default; None for other types."""
    return tuple((one.name, one.default is None) for one in fields(kind)) if is_dataclass(kind) else None


def read_record(path: Path, fingerprint: str) -> EpisodeRecord | None:
    """The record of a finished episode, if there is one that can be read and has this fingerprint."""
    try:
        record = msgspec.json.decode(regular(path).read_bytes(), type=EpisodeRecord)
    except (OSError, msgspec.MsgspecError, RecursionError):
        return None  # labelled again
    return record if record.fingerprint == fingerprint else None
