"""What exported detectors put out, read as boxes, scores and categories (docs/detectors.md lists the layouts).

Arrays come without the axis of the batch. Boxes leave in pixels of the input: left, top, right, bottom.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, Int

from labeling.core.detector import DetectorError
from labeling.detectors.adapters.onnx_config import OnnxConfig

ROLES: dict[str, tuple[str, ...]] = {
    "boxes": ("boxes", "detection_boxes", "bboxes", "dets", "pred_boxes"),
    "scores": ("scores", "detection_scores", "confidences", "logits", "pred_logits"),
    "labels": ("labels", "detection_classes", "classes", "class_ids"),
    "masks": ("masks", "detection_masks"),
    "anchors": ("anchors", "priors"),
}
"""What outputs are called that hold boxes, scores, categories and masks in lists."""
STRIDES = (8, 16, 32, 64)
"""Of the grids that detectors without anchors look at, in pixels of the input."""
DENSE_NMS_IOU = 0.5
"""Of layouts that hold every place the network looked at: overlapping boxes of one category are suppressed above it."""
SMALL = 0.1
"""Centres that all lie in this share of the input are not in its pixels."""


@dataclass(frozen=True)
class Candidates:
    """What a graph says, one row for each candidate."""

    boxes_xyxy: Float32[np.ndarray, "n 4"]
    scores: Float32[np.ndarray, "n"]
    labels: Int[np.ndarray, "n"]
    """Indices of categories."""
    dense: bool = False
    """Whether overlapping candidates are still there."""
    masks: Float32[np.ndarray, "n m k"] | None = None
    coefficients: Float32[np.ndarray, "n c"] | None = None
    """Of prototypes of masks."""
    prototypes: Float32[np.ndarray, "c hm wm"] | None = None


def read_candidates(found: Mapping[str, np.ndarray], config: OnnxConfig, size: tuple[int, int]) -> Candidates:
    """Reads the outputs of a graph, by their names where they have telling ones, else by their shapes.

    Args:
        found: outputs by name, as the graph gives them.
        config: settings.
        size: height and width of the input.

    Raises:
        DetectorError: with all names and shapes, if they fit no layout or hold what cannot be.
    """
    roles = roles_of(list(found), config)
    named = {role: found[name] for role, name in roles.items()}
    others = [_without_batch(found[name]) for name in found if name != roles.get("anchors")]
    count = len(config.categories)
    if "boxes" not in named and len(others) == 2 and all(one.ndim == 2 for one in others):
        boxes, scores = others if _last(others[0]) == 4 else others[::-1]
        if _last(boxes) == 4 and _last(scores) in (count, count + 1):
            named |= {"boxes": boxes, "scores": scores}
    if "boxes" in named and ("scores" in named or _last(named["boxes"]) == 5):
        candidates = _lists(named, config, size)
    else:
        candidates = _by_shape(others, config, count, size)
    if candidates is None:
        shapes = ", ".join(f"{name} {value.shape}" for name, value in found.items())
        raise DetectorError(
            f"for {count} categories the graph's outputs fit no layout that is known (docs/detectors.md lists them): "
            f"{shapes}"
        )
    return _checked(candidates, config)


def roles_of(names: list[str], config: OnnxConfig) -> dict[str, str]:
    """Which output holds boxes, scores, labels, masks and anchors."""
    given = dict(config.outputs)
    roles = {}
    for role, usual in ROLES.items():
        there = [name for name in ((given[role],) if role in given else usual) if name in names]
        if there:
            roles[role] = there[0]
    return roles


def _last(value: np.ndarray) -> int:
    return value.shape[-1] if value.ndim else 0


def _without_batch(value: np.ndarray, axes: int | None = None) -> np.ndarray:
    """Takes away leading axes of length 1, of more than so many axes, by default 2 (3 where three are longer)."""
    least = axes or (3 if value.ndim > 3 else 2)
    while value.ndim > least and value.shape[0] == 1:
        value = value[0]
    return value


def _lists(named: dict[str, np.ndarray], config: OnnxConfig, size: tuple[int, int]) -> Candidates | None:
    """Boxes beside scores and labels (torchvision, TensorFlow), or beside a score for each category (DETR, SSD)."""
    boxes = _without_batch(named["boxes"]).astype(np.float32)
    count = len(config.categories)
    if boxes.ndim != 2 or boxes.shape[1] not in (4, 5):
        return None
    n, labels = len(boxes), named.get("labels")
    scores = (named["scores"] if "scores" in named else boxes[:, 4]).astype(np.float32)
    boxes, given = boxes[:, :4], scores.size
    if labels is not None and given == n and labels.size == n:
        scores, labels = scores.reshape(n), labels.reshape(n).astype(int) - config.first_label
    elif labels is None and n and given in (n * count, n * (count + 1)):
        scores, labels = _best(_probabilities(scores.reshape(n, -1), count, "anchors" in named))
    elif given == 0 and n == 0:
        scores, labels = np.zeros(0, np.float32), np.zeros(0, int)
    else:
        return None
    if "anchors" in named:
        anchors = _without_batch(named["anchors"]).astype(np.float32)
        if anchors.shape != boxes.shape:
            return None
        boxes = _decoded(boxes, anchors, np.array(config.variances, np.float32))
    masks = named.get("masks")
    if masks is not None:
        masks = masks.astype(np.float32)
        masks = masks[0] if masks.ndim == 5 or (masks.ndim == 4 and masks.shape[1] == n and n != 1) else masks
        masks = masks[:, 0] if masks.ndim == 4 else masks
        if masks.ndim != 3 or len(masks) != n:
            return None
    return Candidates(_corners(boxes, config, size, "xyxy"), scores, labels, "anchors" in named, masks)


def _decoded(offsets: np.ndarray, anchors: np.ndarray, variances: np.ndarray) -> np.ndarray:
    """Corners of an SSD's boxes from offsets to its anchors, both centre and size, x and y in either order.

    Source: Liu et al. 2016, SSD.
    """
    centre = anchors[:, :2] + offsets[:, :2] * variances[:2] * anchors[:, 2:]
    half = 0.5 * anchors[:, 2:] * np.exp(np.minimum(offsets[:, 2:] * variances[2:], 10.0))
    return np.concatenate([centre - half, centre + half], axis=1)


def _by_shape(arrays: list[np.ndarray], config: OnnxConfig, count: int, size: tuple[int, int]) -> Candidates | None:
    tables = [one.astype(np.float32) for one in arrays if one.ndim == 2]
    prototypes = [one.astype(np.float32) for one in arrays if one.ndim == 3]
    if len(tables) == 1 and len(prototypes) == len(arrays) - 1 <= 1:
        extra = len(prototypes[0]) if prototypes else 0
        found = _rows(tables[0], config, count, extra, size)
        return found if found is None or not prototypes else Candidates(**{**vars(found), "prototypes": prototypes[0]})
    if len(tables) != len(arrays):
        return None
    return _distributions(tables, config, count, size)


def _rows(table: np.ndarray, config: OnnxConfig, count: int, extra: int, size: tuple[int, int]) -> Candidates | None:
    """One row (or column) for each candidate: YOLO in its many exports."""
    widths = (4 + count + extra, 5 + count + extra, 6 + extra, count + 32)
    if _last(table) not in widths and len(table) in widths[:2]:
        table = table.T
    width = table.shape[1]
    if width == 6 + extra and (width not in widths[:2] or _are_suppressed(table, count, size)):
        labels = table[:, 5].astype(int)  # corners, score, label from 0
        coefficients = np.ascontiguousarray(table[:, 6:]) if extra else None
        boxes = _corners(table[:, :4], config, size, "xyxy")
        return Candidates(boxes, table[:, 4], labels, coefficients=coefficients)
    if width in widths[:2]:
        has_objectness = width == widths[1]
        scores = _probabilities(table[:, 4 + has_objectness : width - extra], count)
        if has_objectness:
            scores = scores * _probabilities(table[:, 4:5], 1)
        coefficients = np.ascontiguousarray(table[:, width - extra :]) if extra else None
        boxes = _from_grid(table[:, :4], size)
        return Candidates(_corners(boxes, config, size, "cxcywh"), *_best(scores), True, coefficients=coefficients)
    if width == count + 32 and not extra:
        return _distributions([table[:, :count], table[:, count:]], config, count, size)
    return None


def _are_suppressed(table: np.ndarray, count: int, size: tuple[int, int]) -> bool:
    """Whether rows are corners, score and label of what a graph has suppressed already, where rows of one or two
    categories are as wide: there are not as many as cells of grids (of YOLOv5, three to a cell), and labels are whole.
    """
    is_dense = any(len(table) % each == 0 and _grid(len(table) // each, size) is not None for each in (1, 3))
    labels = table[:, 5]
    return not is_dense and bool(np.all((labels == np.rint(labels)) & (labels >= 0) & (labels < count)))


def _grid(count: int, size: tuple[int, int]) -> tuple[np.ndarray, np.ndarray] | None:
    """Column and row of the cells of all grids, one below the other, and their strides; None if so many do not fit."""
    cells, strides = np.zeros((0, 2), np.float32), np.zeros(0, np.float32)
    for stride in STRIDES:
        rows, columns = (-(-side // stride) for side in size)
        own = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).reshape(-1, 2)
        cells = np.concatenate([cells, own.astype(np.float32)])
        strides = np.concatenate([strides, np.full(len(own), stride, np.float32)])
        if len(cells) == count:
            return cells, strides
    return None


def _from_grid(boxes: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Centre and size in pixels, of a YOLOX whose export leaves them relative to the cells of its grids."""
    grid = _grid(len(boxes), size)
    if grid is None or boxes[:, 0].max() > SMALL * size[1]:
        return boxes
    cells, strides = grid
    sides = np.exp(np.minimum(boxes[:, 2:], 10.0))
    return np.concatenate([boxes[:, :2] + cells, sides], axis=1) * strides[:, None]


def _distributions(
    tables: list[np.ndarray], config: OnnxConfig, count: int, size: tuple[int, int]
) -> Candidates | None:
    """Scores and distributions of the distances to the four sides, grid by grid: NanoDet, PicoDet.

    Source: Li et al. 2020, Generalized Focal Loss.
    """
    sides = [one for one in tables if _last(one) != count and _last(one) % 4 == 0]
    scores = [one for one in tables if _last(one) == count]
    if not sides or sorted(map(len, scores)) != sorted(map(len, sides)) or len({_last(one) for one in sides}) != 1:
        return None
    ordered = [np.concatenate(sorted(group, key=len, reverse=True)) for group in (scores, sides)]
    n, bins = len(ordered[0]), _last(ordered[1]) // 4
    grid = _grid(n, size)
    if grid is None or bins < 2:
        return None
    cells, strides = grid
    weights = _softmax(ordered[1].reshape(n, 4, bins))
    reach = (weights @ np.arange(bins, dtype=np.float32)) * strides[:, None]
    centre = (cells + 0.5) * strides[:, None]
    boxes = np.concatenate([centre - reach[:, :2], centre + reach[:, 2:]], axis=1)
    return Candidates(boxes.astype(np.float32), *_best(_probabilities(ordered[0], count)), True)


def _softmax(values: np.ndarray) -> np.ndarray:
    powers = np.exp(values - values.max(axis=-1, keepdims=True))
    return powers / powers.sum(axis=-1, keepdims=True)


def _probabilities(values: np.ndarray, count: int, background_first: bool = False) -> np.ndarray:
    """Scores of the categories in [0, 1], from such or from logits; one more column than categories is background."""
    more = values.shape[1] - count
    if values.size and (values.min() < 0 or values.max() > 1):
        values = _softmax(values) if more else 1 / (1 + np.exp(-values.clip(-50, 50)))
    if more:
        values = values[:, 1:] if background_first else values[:, :-1]
    return values


def _best(scores: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    labels = scores.argmax(axis=1)
    return scores[np.arange(len(scores)), labels].astype(np.float32), labels


def _corners(boxes: np.ndarray, config: OnnxConfig, size: tuple[int, int], usual: str) -> np.ndarray:
    """Left, top, right, bottom in pixels of the input."""
    order = usual if config.order == "auto" else config.order
    if order == "cxcywh":
        boxes = np.concatenate([boxes[:, :2] - 0.5 * boxes[:, 2:], boxes[:, :2] + 0.5 * boxes[:, 2:]], axis=1)
    elif order == "yxyx":
        boxes = boxes[:, [1, 0, 3, 2]]
    unit = config.boxes == "unit" or (config.boxes == "auto" and len(boxes) > 0 and 0 < boxes.max() <= 2)
    return (boxes * np.array([size[1], size[0]] * 2) if unit else boxes).astype(np.float32)


def _checked(found: Candidates, config: OnnxConfig) -> Candidates:
    boxes, scores, labels, names = found.boxes_xyxy, found.scores, found.labels, len(config.categories)
    if len(scores) and not (np.isfinite(boxes).all() and scores.min() >= 0 and scores.max() <= 1):
        raise DetectorError("boxes must be finite and scores in [0, 1]; does the graph end before the sigmoid?")
    kept = labels[scores >= config.min_score]
    if len(kept) and not (kept.min() >= 0 and kept.max() < names):
        first = config.first_label
        raise DetectorError(
            f"labels are {kept.min() + first} to {kept.max() + first}, but there are {names} categories, counted from "
            f"first_label {first}"
        )
    return found
