"""Settings of an exported detector: from the JSON file beside its graph, or from the family of exporters."""

import ast
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from labeling.core.detector import DetectorError
from labeling.detectors.data.coco_names import COCO_80, COCO_90, RENAMED
from labeling.formats.checked_json import Json


@dataclass(frozen=True)
class OnnxConfig:
    """How pictures are prepared for a graph and how its outputs are read; docs/detectors.md describes each field."""

    categories: tuple[str, ...] = ()
    first_label: int = 1
    size: tuple[int, int] | None = None
    multiple_of: int = 1
    resize: str = "stretch"
    colour: str = "rgb"
    divide_by: float = 255.0
    mean: tuple[float, ...] = (0.0, 0.0, 0.0)
    std: tuple[float, ...] = (1.0, 1.0, 1.0)
    boxes: str = "auto"
    order: str = "auto"
    masks: str = "box"
    min_score: float = 0.05
    nms_iou: float | None = None
    outputs: tuple[tuple[str, str], ...] = ()
    anchors: str | None = None
    variances: tuple[float, ...] = (0.1, 0.1, 0.2, 0.2)


_COCO_FROM_0 = OnnxConfig(COCO_80, 0, min_score=0.1)
_IMAGENET = replace(_COCO_FROM_0, mean=(0.485, 0.456, 0.406), std=(0.229, 0.224, 0.225))
FAMILIES: dict[str, OnnxConfig] = {
    "ultralytics": replace(_COCO_FROM_0, multiple_of=32, resize="pad"),
    "yolox": replace(_COCO_FROM_0, multiple_of=32, resize="pad", colour="bgr", divide_by=1.0),
    "nanodet": replace(
        _COCO_FROM_0, colour="bgr", divide_by=1.0, mean=(103.53, 116.28, 123.675), std=(57.375, 57.12, 58.395)
    ),
    "picodet": _IMAGENET,
    "rtdetr": _COCO_FROM_0,
    "detr": replace(_IMAGENET, categories=("", *COCO_90), boxes="unit", order="cxcywh"),
    "torchvision": OnnxConfig(COCO_90),
    "tensorflow": OnnxConfig(COCO_90, boxes="unit", order="yxyx"),
}
"""Settings of common exporters, with COCO's categories; category names in the graph and the JSON take precedence."""

_CHOICES = {
    "resize": ("stretch", "pad"),
    "colour": ("rgb", "bgr"),
    "boxes": ("auto", "pixels", "unit"),
    "order": ("auto", "xyxy", "yxyx", "cxcywh"),
    "masks": ("box", "picture"),
}
_READERS: dict[str, Callable[[Json, str], Any]] = {
    **dict.fromkeys(("first_label", "multiple_of"), Json.integer),
    **dict.fromkeys(("divide_by", "min_score", "nms_iou"), Json.number),
    **dict.fromkeys(("mean", "std"), lambda file, name: tuple(file.array(name, (3,)).tolist())),
    "variances": lambda file, name: tuple(file.array(name, (4,)).tolist()),
    "anchors": Json.text,
    "size": lambda file, name: tuple(int(side) for side in file.array(name, (2,))),
}


def read_config(file: Json | None, family: str | None, metadata: dict[str, str]) -> OnnxConfig:
    """The settings of a graph.

    Args:
        file: the JSON beside it, if there is one.
        family: where it comes from, one of ``FAMILIES``, if that was said; the JSON may say it, too.
        metadata: what the graph says about itself; Ultralytics' names of categories are taken from it.

    Raises:
        EpisodeFormatError: naming file and field, if the JSON is malformed.
        DetectorError: if the family is unknown.
    """
    if file is not None and file.has("family"):
        family = file.text("family")
    names = _names_of(metadata)
    family = family or ("ultralytics" if names else None)
    if family is not None and family not in FAMILIES:
        raise DetectorError(f"{family} is no family of detectors; known: {', '.join(FAMILIES)}")
    config = OnnxConfig() if family is None else FAMILIES[family]
    config = replace(config, categories=names) if names else config
    return config if file is None else _with_json(config, file)


def _names_of(metadata: dict[str, str]) -> tuple[str, ...]:
    try:
        names: dict[int, str] = ast.literal_eval(metadata["names"])
        return tuple(RENAMED.get(names[number], str(names[number])) for number in range(len(names)))
    except (KeyError, TypeError, ValueError, SyntaxError):
        return ()


def _with_json(config: OnnxConfig, file: Json) -> OnnxConfig:
    known = {*OnnxConfig.__dataclass_fields__, "family"}
    unknown = sorted(set(file.mapping()) - known)
    if unknown:
        raise file.error(f"unknown field; known: {', '.join(sorted(known))}", unknown[0])
    values: dict[str, Any] = {}
    if file.has("categories"):
        names = [item.value for item in file.list_of("categories")]
        if not names or not all(isinstance(name, str) for name in names):
            raise file.error("must be a list of names", "categories")
        values["categories"] = tuple(names)
    for name, choices in _CHOICES.items():
        if file.has(name):
            values[name] = file.text(name)
            if values[name] not in choices:
                raise file.error(f"must be one of {', '.join(choices)}, not {values[name]!r}", name)
    for name, read in _READERS.items():
        if file.has(name) and file.get(name).value is not None:
            values[name] = read(file, name)
    if file.has("outputs"):
        values["outputs"] = tuple((name, str(given)) for name, given in file.get("outputs").mapping().items())
    config = replace(config, **values)
    if config.multiple_of < 1 or config.divide_by == 0 or 0 in config.std or (config.size and min(config.size) < 1):
        raise file.error("multiple_of and size must be above 0, divide_by and std other than 0")
    return config
