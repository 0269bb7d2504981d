"""Any exported detector, through ONNX Runtime: ``onnx:FILE``, with a small JSON beside it (``FILE`` with ``.json``).

docs/detectors.md says what the network must give and what the JSON may hold. Candidates that overlap are taken to be
suppressed already, unless ``nms_iou`` is given.
"""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import Bool, Float32, UInt8

from labeling.core.box_masks import mask_in_box
from labeling.core.detector import DetectorError, PictureDetections
from labeling.core.errors import EpisodeFormatError
from labeling.core.masks import MASK_THRESHOLD, paste_mask
from labeling.detectors.adapters.function import first_line
from labeling.detectors.data.augment import resize_picture
from labeling.formats.checked_json import Json, read_json

OUTPUTS = ("boxes", "scores", "labels", "masks")
PAD_VALUE = 114
MAX_CANDIDATES = 100


@dataclass(frozen=True)
class OnnxConfig:
    """What the JSON says."""

    categories: tuple[str, ...]
    first_label: int = 1
    size: tuple[int, int] | None = None
    multiple_of: int = 1
    resize: str = "stretch"
    colour: str = "rgb"
    divide_by: float = 255.0
    mean: tuple[float, ...] = (0.0, 0.0, 0.0)
    std: tuple[float, ...] = (1.0, 1.0, 1.0)
    boxes: str = "pixels"
    masks: str = "box"
    min_score: float = 0.05
    nms_iou: float | None = None
    outputs: tuple[tuple[str, str], ...] = tuple((name, name) for name in OUTPUTS)


_CHOICES = {
    "resize": ("stretch", "pad"),
    "colour": ("rgb", "bgr"),
    "boxes": ("pixels", "unit"),
    "masks": ("box", "picture"),
}
_READERS: dict[str, Callable[[Json, str], Any]] = {
    **dict.fromkeys(("first_label", "multiple_of"), Json.integer),
    **dict.fromkeys(("divide_by", "min_score", "nms_iou"), Json.number),
    **dict.fromkeys(("mean", "std"), lambda file, name: tuple(file.array(name, (3,)).tolist())),
    "size": lambda file, name: tuple(int(side) for side in file.array(name, (2,))),
}


def _config(file: Json) -> OnnxConfig:
    known = set(OnnxConfig.__dataclass_fields__)
    unknown = sorted(set(file.mapping()) - known)
    if unknown:
        raise file.error(f"unknown field; known: {', '.join(sorted(known))}", unknown[0])
    names = [item.value for item in file.list_of("categories")]
    if not names or not all(isinstance(name, str) for name in names):
        raise file.error("must be a list of names", "categories")
    values: dict[str, Any] = {"categories": tuple(names)}
    for name, choices in _CHOICES.items():
        if file.has(name):
            values[name] = file.text(name)
            if values[name] not in choices:
                raise file.error(f"must be one of {', '.join(choices)}, not {values[name]!r}", name)
    for name, read in _READERS.items():
        if file.has(name) and file.get(name).value is not None:
            values[name] = read(file, name)
    if file.has("outputs"):
        given = file.get("outputs").mapping()
        values["outputs"] = tuple((name, str(given.get(name, name))) for name in OUTPUTS)
    config = OnnxConfig(**values)
    if config.multiple_of < 1 or config.divide_by == 0 or 0 in config.std or (config.size and min(config.size) < 1):
        raise file.error("multiple_of and size must be above 0, divide_by and std other than 0")
    return config


class OnnxDetector:
    """Runs an exported detector."""

    batch_size = 1

    def __init__(self, path: Path, name: str) -> None:
        self.name = name
        if not path.is_file():
            raise DetectorError(f"{name}: no such file")
        beside = path.with_suffix(".json")
        if not beside.is_file():
            raise DetectorError(
                f"{name}: needs {beside} with the names of its categories (docs/detectors.md: what else it may hold)"
            )
        try:
            self.config = _config(read_json(beside))
        except EpisodeFormatError as error:
            raise DetectorError(str(error)) from None
        self.categories = tuple(dict.fromkeys(name for name in self.config.categories if name))
        self.digest = hashlib.sha256(path.read_bytes() + beside.read_bytes()).hexdigest()
        self._session = _session(path, name)
        self._outputs = dict(self.config.outputs)
        there = [one.name for one in self._session.get_outputs()]
        missing = [self._outputs[one] for one in ("boxes", "scores") if self._outputs[one] not in there]
        if missing:
            raise DetectorError(
                f"{name}: has no output {missing[0]!r}, only {', '.join(there)}; name them as outputs in {beside.name}"
            )
        self._present = {one: self._outputs[one] for one in OUTPUTS if self._outputs[one] in there}
        shape = self._session.get_inputs()[0].shape
        fixed = shape[2:] if len(shape) == 4 and all(isinstance(side, int) for side in shape[2:]) else None
        self._size = self.config.size or (tuple(fixed) if fixed else None)

    def detect(
        self, rgb: UInt8[np.ndarray, "b h w 3"], depth_m: Float32[np.ndarray, "b h w"] | None = None
    ) -> list[PictureDetections]:
        """See ``labeling.core.detector.Detector``."""
        return [self._detect_one(one, None if depth_m is None else depth_m[i]) for i, one in enumerate(rgb)]

    def _detect_one(
        self, picture: UInt8[np.ndarray, "h w 3"], depth_m: Float32[np.ndarray, "h w"] | None
    ) -> PictureDetections:
        x, scale = self._prepare(picture)
        entry = self._session.get_inputs()[0].name
        try:
            values = self._session.run(list(self._present.values()), {entry: x})
        except Exception as error:  # its exceptions have no common root
            raise DetectorError(f"ONNX Runtime: {first_line(error)}") from error
        found = {name: np.asarray(value) for name, value in zip(self._present, values, strict=True)}
        boxes, scores, labels, masks = self._candidates(found, (x.shape[2], x.shape[3]))
        size = (int(picture.shape[0]), int(picture.shape[1]))
        in_picture = (boxes / np.tile(scale, 2)).astype(np.float32)
        in_picture[:, 0::2] = in_picture[:, 0::2].clip(0, size[1])
        in_picture[:, 1::2] = in_picture[:, 1::2].clip(0, size[0])
        drawn = [
            mask_in_box(picture, box, depth_m) if masks is None else self._mask(masks[i], boxes[i], box, scale, size)
            for i, box in enumerate(in_picture)
        ]
        kept = [i for i, mask in enumerate(drawn) if mask.any()]
        return PictureDetections(
            categories=tuple(self.config.categories[labels[i]] for i in kept),
            scores=scores[kept],
            boxes_xyxy=in_picture[kept],
            masks=np.stack([drawn[i] for i in kept]) if kept else np.zeros((0, *size), bool),
            made_here=tuple(range(len(kept))) if masks is None else (),
        )

    def _prepare(self, picture: UInt8[np.ndarray, "h w 3"]) -> tuple[Float32[np.ndarray, "1 3 tall wide"], np.ndarray]:
        """The network's input, and how many of its pixels a pixel of the picture is, across and down."""
        height, width = picture.shape[:2]
        step = self.config.multiple_of
        tall, wide = self._size or (-(-height // step) * step, -(-width // step) * step)
        if self.config.resize == "pad":
            factor = min(tall / height, wide / width)
            inner = max(1, round(height * factor)), max(1, round(width * factor))
        else:
            inner = tall, wide
        small = resize_picture(picture, inner)
        room = np.full((tall, wide, 3), PAD_VALUE, np.uint8)
        room[: inner[0], : inner[1]] = small
        if self.config.colour == "bgr":
            room = room[:, :, ::-1]
        mean, std = np.array([self.config.mean, self.config.std], np.float32)
        x = (room.astype(np.float32) / self.config.divide_by - mean) / std
        scale = np.array([inner[1] / width, inner[0] / height], np.float32)
        return np.ascontiguousarray(x.transpose(2, 0, 1)[None].astype(np.float32)), scale

    def _candidates(
        self, found: dict[str, np.ndarray], input_size: tuple[int, int]
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray | None]:
        """Boxes in pixels of the input, scores, indices of categories, and masks; the most confident first."""
        boxes = _without_batch(found["boxes"], 2, "boxes").astype(np.float32)
        n, names = len(boxes), len(self.config.categories)
        if boxes.shape != (n, 4):
            raise DetectorError(f"boxes must be (n, 4), not {boxes.shape}")
        scores = found["scores"].astype(np.float32)
        if scores.size == n * names and "labels" not in found:
            scores = scores.reshape(n, names)
            labels, scores = scores.argmax(axis=1) if n else np.zeros(0, int), scores.max(axis=1, initial=0.0)
        elif scores.size == n and found.get("labels", np.zeros(0)).size == n:
            scores, labels = scores.reshape(n), found["labels"].reshape(n).astype(int) - self.config.first_label
        else:
            shapes = {name: value.shape for name, value in found.items()}
            raise DetectorError(
                f"for {n} boxes and {names} categories, scores must be ({n},) beside labels ({n},), or ({n}, {names}); "
                f"given: {shapes}"
            )
        if n and not (np.isfinite(boxes).all() and scores.min() >= 0 and scores.max() <= 1):
            raise DetectorError("boxes must be finite and scores in [0, 1]; does the graph end before the sigmoid?")
        if len(labels) and not (labels.min() >= 0 and labels.max() < names):
            raise DetectorError(
                f"labels are {labels.min() + self.config.first_label} to {labels.max() + self.config.first_label}, but "
                f"there are {names} categories, counted from first_label {self.config.first_label}"
            )
        if self.config.boxes == "unit":
            boxes = boxes * np.array([input_size[1], input_size[0]] * 2, np.float32)
        kept = np.flatnonzero(scores >= self.config.min_score)
        kept = kept[np.argsort(-scores[kept], kind="stable")]
        if self.config.nms_iou is not None:
            xywh = np.concatenate([boxes[kept, :2], boxes[kept, 2:] - boxes[kept, :2]], axis=1).tolist()
            best = cv2.dnn.NMSBoxesBatched(
                xywh, scores[kept].tolist(), labels[kept].tolist(), -1.0, self.config.nms_iou
            )
            kept = kept[np.array(best, int)]
        kept = np.array([i for i in kept if self.config.categories[labels[i]]], int)[:MAX_CANDIDATES]
        has_masks = "masks" in found
        masks = _without_batch(found["masks"], 3, "masks", n)[kept].astype(np.float32) if has_masks else None
        return boxes[kept], scores[kept], labels[kept], masks

    def _mask(
        self, mask: np.ndarray, box: np.ndarray, box_in_picture: np.ndarray, scale: np.ndarray, size: tuple[int, int]
    ) -> Bool[np.ndarray, "h w"]:
        if self.config.masks == "box":
            return paste_mask(np.ascontiguousarray(mask), (box / np.tile(scale, 2)).astype(np.float32), size)
        tall, wide = max(1, round(size[0] * float(scale[1]))), max(1, round(size[1] * float(scale[0])))
        inner = np.ascontiguousarray(mask[:tall, :wide])
        return cv2.resize(inner, size[::-1], interpolation=cv2.INTER_LINEAR) > MASK_THRESHOLD


def _session(path: Path, name: str) -> Any:
    try:
        import onnxruntime
    except ImportError:
        raise DetectorError(f"{name}: needs ONNX Runtime; pip install 'seeing-by-moving[onnx]' installs it") from None
    available = onnxruntime.get_available_providers()
    chosen = [one for one in ("CUDAExecutionProvider", "CPUExecutionProvider") if one in available]
    try:
        return onnxruntime.InferenceSession(str(path), providers=chosen)
    except Exception as error:  # its exceptions have no common root
        raise DetectorError(f"{name}: cannot be loaded ({first_line(error)})") from None


def _without_batch(value: np.ndarray, axes: int, what: str, n: int | None = None) -> np.ndarray:
    """Takes away axes of length 1: that of the batch, and that of the channels of masks."""
    if value.ndim > axes and value.shape[0] == 1 and (n is None or n == 1 or value.shape[0] != n):
        value = value[0]
    if value.ndim == axes + 1 and axes == 3 and value.shape[1] == 1:
        value = value[:, 0]
    if value.ndim != axes or (n is not None and len(value) != n):
        raise DetectorError(f"{what} have shape {value.shape}; expected {axes} axes, beside one for a batch of 1")
    return value
