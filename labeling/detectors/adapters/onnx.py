"""Any exported detector, through ONNX Runtime: ``onnx:FILE`` or ``onnx:FAMILY:FILE``, with a small JSON beside it
(``FILE`` with ``.json``) where that does not say enough.

docs/detectors.md says what the network may give and what the JSON may hold.
"""

import contextlib
import hashlib
import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import Bool, Float32, Int, UInt8

from labeling.core.box_masks import mask_in_box
from labeling.core.detector import DetectorError, PictureDetections
from labeling.core.errors import EpisodeFormatError
from labeling.core.masks import MASK_THRESHOLD, paste_mask
from labeling.detectors.adapters.function import first_line
from labeling.detectors.adapters.onnx_config import FAMILIES, OnnxConfig, read_config
from labeling.detectors.adapters.onnx_layouts import DENSE_NMS_IOU, Candidates, read_candidates
from labeling.detectors.data.augment import resize_picture
from labeling.formats.checked_json import read_json
from labeling.formats.pixel_limit import too_large
from labeling.formats.regular_file import regular
from labeling.runtime.extras import how_to_install

_TYPES: dict[str, Any] = {"tensor(float)": np.float32, "tensor(float16)": np.float16, "tensor(uint8)": np.uint8}
PAD_VALUE = 114
MAX_CANDIDATES = 100
MAX_DENSE = 1000
"""Candidates of dense layouts that are compared with each other at most, the most confident."""
MAX_NAME = 4096
"""Bytes of the longest name of a file of weights."""
SIZES_INPUT = "orig_target_sizes"
"""Input of exported RT-DETRs that says for which picture, width and height, boxes are to be."""


class OnnxDetector:
    """Runs an exported detector."""

    batch_size = 1

    def __init__(self, path: Path, name: str, family: str | None = None) -> None:
        self.name = name
        if not path.is_file():
            raise DetectorError(f"{name}: no such file")
        beside = path.with_suffix(".json")
        self._session = _session(path, name)
        metadata, inputs, self._outputs = _described(self._session, name)
        try:
            self.config = read_config(read_json(beside) if beside.is_file() else None, family, metadata)
        except EpisodeFormatError as error:
            raise DetectorError(str(error)) from None
        if not self.config.categories:
            raise DetectorError(
                f"{name}: needs {beside} with the names of its categories (docs/detectors.md: what else it may hold), "
                f"or its family, onnx:FAMILY:FILE, one of {', '.join(FAMILIES)}"
            )
        self.categories = tuple(dict.fromkeys(one for one in self.config.categories if one))
        extra = regular(beside).read_bytes() if beside.is_file() else (family or "").encode()
        content = regular(path).read_bytes()
        self.digest = _digest(content + extra, [path.parent / one for one in _named_files(content, self.config)])
        missing = [one for _, one in self.config.outputs if one not in self._outputs]
        if missing:
            raise DetectorError(
                f"{name}: has no output {missing[0]!r}, only {', '.join(self._outputs)}; name them as outputs in "
                f"{beside.name}"
            )
        if not inputs:
            raise DetectorError(f"{name}: takes no input; expected pictures (1, 3, h, w) or (1, h, w, 3)")
        (self._entry, self._type, shape), *more = inputs
        others = [one for one, _, _ in more]
        if len(shape) != 4 or 3 not in (shape[1], shape[3]) or self._type not in _TYPES:
            raise DetectorError(
                f"{name}: takes {self._entry} {shape} of {self._type}; expected pictures (1, 3, h, w) or (1, h, w, 3), "
                f"one of {', '.join(_TYPES)}"
            )
        self._channels_last = shape[1] != 3
        fixed = shape[1:3] if self._channels_last else shape[2:]
        whole = all(isinstance(side, int) for side in fixed)
        self._size = self.config.size or (tuple(fixed) if whole else None)
        why = too_large(*self._size) if self._size else None
        if why is not None:
            raise DetectorError(f"{name}: its pictures of {why}")
        self._sizes_input = SIZES_INPUT if others == [SIZES_INPUT] else None
        if others and self._sizes_input is None:
            raise DetectorError(f"{name}: wants {', '.join(others)} beside a picture, too")
        self._anchors = None if self.config.anchors is None else _anchors(path, self.config.anchors, name)

    def detect(
        self, rgb: UInt8[np.ndarray, "b h w 3"], depth_m: Float32[np.ndarray, "b h w"] | None = None
    ) -> list[PictureDetections]:
        """See ``labeling.core.detector.Detector``."""
        return [self._detect_one(one, None if depth_m is None else depth_m[i]) for i, one in enumerate(rgb)]

    def _detect_one(
        self, picture: UInt8[np.ndarray, "h w 3"], depth_m: Float32[np.ndarray, "h w"] | None
    ) -> PictureDetections:
        x, scale = self._prepare(picture)
        tall, wide = x.shape[1:3] if self._channels_last else x.shape[2:]
        feed = {self._entry: x}
        if self._sizes_input is not None:
            feed[self._sizes_input] = np.array([[wide, tall]], np.int64)
        try:
            values = self._session.run(self._outputs, feed)
        except Exception as error:  # its exceptions have no common root
            raise DetectorError(f"ONNX Runtime: {first_line(error)}") from error
        given = dict(zip(self._outputs, map(np.asarray, values), strict=True))
        if self._anchors is not None:
            given["anchors"] = self._anchors
        found = read_candidates(given, self.config, (tall, wide))
        kept = self._kept(found)
        size = (int(picture.shape[0]), int(picture.shape[1]))
        boxes = found.boxes_xyxy[kept]
        in_picture = (boxes / np.tile(scale, 2)).astype(np.float32)
        in_picture[:, 0::2] = in_picture[:, 0::2].clip(0, size[1])
        in_picture[:, 1::2] = in_picture[:, 1::2].clip(0, size[0])
        made_here = found.masks is None and found.prototypes is None
        drawn = [
            mask_in_box(picture, box, depth_m)
            if made_here
            else self._mask(found, i, boxes[rank] / np.tile(scale, 2), scale, size)
            for rank, (i, box) in enumerate(zip(kept.tolist(), in_picture, strict=True))
        ]
        full = [rank for rank, mask in enumerate(drawn) if mask.any()]
        return PictureDetections(
            categories=tuple(self.config.categories[found.labels[i]] for i in kept[full]),
            scores=found.scores[kept[full]],
            boxes_xyxy=in_picture[full],
            masks=np.stack([drawn[rank] for rank in full]) if full else np.zeros((0, *size), bool),
            made_here=tuple(range(len(full))) if made_here else (),
        )

    def _prepare(self, picture: UInt8[np.ndarray, "h w 3"]) -> tuple[np.ndarray, Float32[np.ndarray, "2"]]:
        """The network's input, and how many of its pixels a pixel of the picture is, across and down."""
        height, width = picture.shape[:2]
        tall, wide = self._input_size((height, width))
        if self.config.resize == "pad":
            factor = min(tall / height, wide / width)
            inner = max(1, round(height * factor)), max(1, round(width * factor))
        else:
            inner = tall, wide
        room = np.full((tall, wide, 3), PAD_VALUE, np.uint8)
        room[: inner[0], : inner[1]] = resize_picture(picture, inner)
        if self.config.colour == "bgr":
            room = room[:, :, ::-1]
        if self._type != "tensor(uint8)":
            mean, std = np.array([self.config.mean, self.config.std], np.float32)
            room = (room.astype(np.float32) / self.config.divide_by - mean) / std
        x = room if self._channels_last else room.transpose(2, 0, 1)
        scale = np.array([inner[1] / width, inner[0] / height], np.float32)
        return np.ascontiguousarray(x[None].astype(_TYPES[self._type])), scale

    def _input_size(self, size: tuple[int, int]) -> tuple[int, int]:
        step = self.config.multiple_of
        return self._size or (-(-size[0] // step) * step, -(-size[1] // step) * step)

    def _kept(self, found: Candidates) -> Int[np.ndarray, "k"]:
        """Which candidates are detections, the most confident first."""
        kept = np.flatnonzero(found.scores >= self.config.min_score)
        kept = kept[np.argsort(-found.scores[kept], kind="stable")]
        limit = self.config.nms_iou or (DENSE_NMS_IOU if found.dense else None)
        if limit is not None and len(kept):
            kept = kept[:MAX_DENSE]
            xyxy = found.boxes_xyxy[kept]
            xywh = np.concatenate([xyxy[:, :2], xyxy[:, 2:] - xyxy[:, :2]], axis=1).tolist()
            best = cv2.dnn.NMSBoxesBatched(xywh, found.scores[kept].tolist(), found.labels[kept].tolist(), -1.0, limit)
            kept = kept[np.array(best, int)]
        return np.array([i for i in kept if self.config.categories[found.labels[i]]], int)[:MAX_CANDIDATES]

    def _mask(
        self,
        found: Candidates,
        index: int,
        box: Float32[np.ndarray, "4"],
        scale: Float32[np.ndarray, "2"],
        size: tuple[int, int],
    ) -> Bool[np.ndarray, "h w"]:
        """The graph's own mask of a candidate."""
        if found.masks is not None and self.config.masks == "box":
            return paste_mask(np.ascontiguousarray(found.masks[index]), box, size)
        if found.masks is not None:
            tall, wide = max(1, round(size[0] * float(scale[1]))), max(1, round(size[1] * float(scale[0])))
            inner = np.ascontiguousarray(found.masks[index][:tall, :wide])
            return cv2.resize(inner, size[::-1], interpolation=cv2.INTER_LINEAR) > MASK_THRESHOLD
        assert found.prototypes is not None
        assert found.coefficients is not None
        logits = np.tensordot(found.coefficients[index], found.prototypes, 1)
        whole = np.array([0, 0, *self._input_size(size)[::-1]], np.float32) / np.tile(scale, 2)
        mask = paste_mask((1 / (1 + np.exp(-logits.clip(-50, 50)))).astype(np.float32), whole, size)
        left, top, right, bottom = np.clip(np.rint(box), 0, [size[1], size[0]] * 2).astype(int)
        mask[:top], mask[bottom:], mask[:, :left], mask[:, right:] = False, False, False, False
        return mask


def _session(path: Path, name: str) -> Any:
    try:
        import onnxruntime
    except ImportError:
        raise DetectorError(f"{name}: needs ONNX Runtime: {how_to_install('onnx')}") from None
    available = onnxruntime.get_available_providers()
    chosen = [one for one in ("CUDAExecutionProvider", "CPUExecutionProvider") if one in available]
    options = onnxruntime.SessionOptions()
    options.log_severity_level = 3  # errors: old exporters earn hundreds of warnings
    try:
        return onnxruntime.InferenceSession(str(path), options, providers=chosen)
    except Exception as error:  # its exceptions have no common root
        raise DetectorError(f"{name}: cannot be loaded ({first_line(error)})") from None


_EXTERNAL_DATA = re.compile(rb"\x0a\x08location\x12([\x80-\xff]*[\x00-\x7f])")
"""An entry of a tensor that says in which file its numbers are (``StringStringEntryProto`` of onnx.proto), up to the
length of the file's name. Found in the bytes: the package onnx, which reads graphs, need not be installed.
"""


def _named_files(graph: bytes, config: OnnxConfig) -> list[str]:
    """Files beside a graph that hold weights or anchors of it."""
    names = {config.anchors} if config.anchors is not None else set()
    for match in _EXTERNAL_DATA.finditer(graph):
        length = sum((digit & 0x7F) << 7 * place for place, digit in enumerate(match.group(1)))
        names.add(os.fsdecode(graph[match.end() : match.end() + min(length, MAX_NAME)]))
    return sorted(name for name in names if name and "\0" not in name)


def _digest(content: bytes, files: Sequence[Path]) -> str:
    """Changes with any of the contents; files that cannot be read do not count."""
    digest = hashlib.sha256(content)
    for file in files:
        with contextlib.suppress(OSError), regular(file).open("rb") as opened:
            digest.update(hashlib.file_digest(opened, "sha256").digest())
    return digest.hexdigest()


def _described(session: Any, name: str) -> tuple[dict[str, str], list[tuple[str, str, list[Any]]], list[str]]:
    """Metadata of a graph; name, type and shape of its inputs; names of its outputs."""
    try:
        return (
            dict(session.get_modelmeta().custom_metadata_map),
            [(one.name, one.type, list(one.shape)) for one in session.get_inputs()],
            [one.name for one in session.get_outputs()],
        )
    except Exception as error:  # such as names that are no text
        raise DetectorError(f"{name}: is damaged ({first_line(error)})") from None


def _anchors(path: Path, where: str, name: str) -> Float32[np.ndarray, "n 4"]:
    """Anchors from a file of numpy beside the graph, or from a constant of the graph."""
    beside = path.parent / where
    try:
        if beside.suffix == ".npy":
            return np.load(beside, allow_pickle=False).astype(np.float32)
        import onnx
        from onnx import numpy_helper

        graph = onnx.load(str(path)).graph
        constants = {one.name: one for one in graph.initializer}
        return numpy_helper.to_array(constants[where]).astype(np.float32)
    except ImportError:
        raise DetectorError(f"{name}: to read constants of a graph, {how_to_install('onnx')}") from None
    except KeyError:
        raise DetectorError(f"{name}: anchors: the graph has no constant {where!r}; or name a file .npy") from None
    except (OSError, ValueError) as error:
        raise DetectorError(f"{beside}: anchors cannot be read ({first_line(error)})") from None
