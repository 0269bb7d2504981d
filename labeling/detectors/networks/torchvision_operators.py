"""The one place that imports torchvision: ``from labeling.detectors.networks.torchvision_operators import
torchvision``.

torchvision's compiled operators do not load beside every build of torch (the wheel of PyPI wants CUDA libraries, which
a CPU-only torch lacks), and without them torchvision cannot even be imported. Where that is so, the two operators that
detectors need, ``nms`` and ``roi_align``, are defined here before the import. Where they load, they are used.

torchvision also imports torch's compiler, which takes as long as torch itself, for one question that detectors do not
ask; here it is imported when somebody asks.
"""

import importlib
import importlib.util
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any

import numba
import numpy as np
import torch
from torch.nn.functional import embedding_bag

_SCHEMAS = (
    "nms(Tensor dets, Tensor scores, float iou_threshold) -> Tensor",
    "roi_align(Tensor input, Tensor rois, float spatial_scale, int pooled_height, int pooled_width, "
    "int sampling_ratio, bool aligned) -> Tensor",
    # torchvision describes this one to the tracer on import, whether or not it can be called.
    "qnms(Tensor dets, Tensor scores, float iou_threshold) -> Tensor",
)


def compiled_operators_load() -> bool:
    """Whether torchvision's own operators work with this torch."""
    found = importlib.util.find_spec("torchvision")
    if found is None or found.origin is None:
        raise ModuleNotFoundError("torchvision is not installed")
    library = Path(found.origin).with_name("_C.so")
    try:
        torch.ops.load_library(library)
    except OSError:
        return False
    return True


def nms(dets: torch.Tensor, scores: torch.Tensor, iou_threshold: float) -> torch.Tensor:
    """Non-maximum suppression: the best box stays, and those that overlap it by more than the threshold go; again.

    Args:
        dets: boxes (n, 4), xyxy.
        scores: (n,).
        iou_threshold: in [0, 1].

    Returns:
        Indices of the boxes that stay, the best first. Source: torchvision's ``nms_kernel.cpp``.
    """
    order = scores.argsort(descending=True, stable=True)
    kept = _suppress(dets.detach()[order].float().cpu().numpy(), float(iou_threshold))
    return order[torch.from_numpy(kept).to(order.device)]


@numba.njit(cache=True)
def _suppress(boxes: np.ndarray, iou_threshold: float) -> np.ndarray:
    n = len(boxes)
    gone = np.zeros(n, np.bool_)
    area = (boxes[:, 2] - boxes[:, 0]) * (boxes[:, 3] - boxes[:, 1])
    kept = np.empty(n, np.int64)
    count = 0
    for i in range(n):
        if gone[i]:
            continue
        kept[count] = i
        count += 1
        for j in range(i + 1, n):
            if gone[j]:
                continue
            width = min(boxes[i, 2], boxes[j, 2]) - max(boxes[i, 0], boxes[j, 0])
            height = min(boxes[i, 3], boxes[j, 3]) - max(boxes[i, 1], boxes[j, 1])
            shared = max(width, np.float32(0)) * max(height, np.float32(0))
            gone[j] = shared / (area[i] + area[j] - shared) > iou_threshold
    return kept[:count]


def roi_align(
    input: torch.Tensor,
    rois: torch.Tensor,
    spatial_scale: float,
    pooled_height: int,
    pooled_width: int,
    sampling_ratio: int,
    aligned: bool,
) -> torch.Tensor:
    """Averages of bilinear samples in the cells of a grid laid over each box. Source: Mask R-CNN, He et al. 2017.

    Every sample is a weighted sum of four rows of the feature table (pixels, channels), so that a cell is one bag of an
    ``embedding_bag``: on a CPU this is some 20 times as fast as ``grid_sample``, and some five times with gradients.

    Args:
        input: features (b, c, h, w).
        rois: (k, 5): picture, and box xyxy in units of ``1 / spatial_scale`` pixels.
        spatial_scale: of the features.
        pooled_height: cells from top to bottom.
        pooled_width: cells from left to right.
        sampling_ratio: samples per cell and axis; 0 or less: one for every pixel of the cell.
        aligned: whether pixel centres lie at half-integer coordinates.

    Returns:
        (k, c, pooled_height, pooled_width).
    """
    channels = input.shape[1]
    if len(rois) == 0:
        return input.new_zeros(0, channels, pooled_height, pooled_width) + 0 * input.sum()  # stays in the graph
    table = input.permute(0, 2, 3, 1).reshape(-1, channels)
    boxes = rois.detach().to(torch.promote_types(input.dtype, torch.float32))
    offset = 0.5 if aligned else 0.0
    start = boxes[:, 1:3] * spatial_scale - offset
    size = boxes[:, 3:5] * spatial_scale - offset - start
    if not aligned:
        size = size.clamp(min=1.0)
    cells = size.new_tensor([pooled_width, pooled_height])
    per_cell = torch.full_like(size, sampling_ratio) if sampling_ratio > 0 else torch.ceil(size / cells).clamp(min=1)
    out = input.new_empty(len(rois), pooled_height, pooled_width, channels)
    for group in torch.unique(per_cell, dim=0):
        chosen = (per_cell == group).all(dim=1).nonzero()[:, 0]
        x, y = int(group[0]), int(group[1])
        index, weight = _bags(
            boxes[chosen, 0].long(),
            start[chosen],
            size[chosen],
            (input.shape[2], input.shape[3]),
            (pooled_height, pooled_width),
            (y, x),
        )
        pooled = embedding_bag(index, table, per_sample_weights=weight.to(table.dtype), mode="sum")
        out = out.index_copy(0, chosen, pooled.view(len(chosen), pooled_height, pooled_width, channels))
    return out.permute(0, 3, 1, 2)


def _bags(
    picture: torch.Tensor,
    start: torch.Tensor,
    size: torch.Tensor,
    shape: tuple[int, int],
    cells: tuple[int, int],
    per_cell: tuple[int, int],
) -> tuple[torch.Tensor, torch.Tensor]:
    """Rows of the feature table that each cell draws on, and their weights; (k * cells, samples * 4)."""
    k = len(picture)
    column, column_weight = _line(start[:, :1], size[:, :1], shape[1], cells[1] * per_cell[1])
    row, row_weight = _line(start[:, 1:], size[:, 1:], shape[0], cells[0] * per_cell[0])
    across, down = (k, 1, cells[1], 1, 2 * per_cell[1]), (k, cells[0], 1, 2 * per_cell[0], 1)
    index = (picture.view(-1, 1, 1, 1, 1) * shape[0] + row.view(down)) * shape[1] + column.view(across)
    weight = row_weight.view(down) * column_weight.view(across) / (per_cell[0] * per_cell[1])
    entries = 4 * per_cell[0] * per_cell[1]
    return index.reshape(-1, entries), weight.reshape(-1, entries)


def _line(start: torch.Tensor, size: torch.Tensor, pixels: int, samples: int) -> tuple[torch.Tensor, torch.Tensor]:
    """Along one axis: the two pixels beside each sample and their weights, (k, samples, 2); outside, the rim counts."""
    steps = (torch.arange(samples, dtype=start.dtype, device=start.device) + 0.5) / samples
    position = (start + steps * size).clamp(0, pixels - 1)
    low = position.floor().clamp(max=max(pixels - 2, 0))
    share = position - low
    high = (low + 1).clamp(max=pixels - 1)
    return torch.stack([low, high], dim=-1).long(), torch.stack([1 - share, share], dim=-1)


def _define() -> torch.library.Library:
    """Registers the operators under torchvision's names, and makes torchvision believe that they are compiled."""
    fragment = torch.library.Library("torchvision", "FRAGMENT")
    for schema in _SCHEMAS:
        fragment.define(schema)
    fragment.impl("nms", nms, "CPU")
    # Made of differentiable operators, which give it its gradient.
    fragment.impl("roi_align", roi_align, "CompositeImplicitAutograd")
    importlib.import_module("torchvision.ops")
    for module in ("torchvision.extension", "torchvision.ops.roi_align"):
        sys.modules[module]._has_ops = lambda: True  # type: ignore[attr-defined]
    return fragment


def is_compile_supported(device_type: Any) -> bool:
    """What torch's compiler says of it; imports the compiler."""
    return importlib.import_module("torch._dynamo.utils").is_compile_supported(device_type)


@contextmanager
def compiler_on_demand() -> Iterator[None]:
    """Lets ``torchvision.ops.roi_align`` import ``is_compile_supported`` without the compiler that it is of."""
    name = "torch._dynamo.utils"
    if name in sys.modules:
        yield
        return
    stand_in = ModuleType(name)
    stand_in.is_compile_supported = is_compile_supported  # type: ignore[attr-defined]
    sys.modules[name] = stand_in
    try:
        yield
    finally:
        del sys.modules[name]


with compiler_on_demand():
    # Kept: operators vanish with the library that defines them.
    _LIBRARY = None if compiled_operators_load() else _define()
    import torchvision

__all__ = ["torchvision"]
