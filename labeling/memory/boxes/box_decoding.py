"""From maps to boxes: peaks of heat, the boxes that stand there, and no box twice."""

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn import functional

from labeling.core.types import Box3d
from labeling.detectors3d.several_views import suppress_3d
from labeling.detectors3d.upright_boxes import decode_box
from labeling.memory.boxes.box_targets import decode
from labeling.memory.settings.grid_spec import GridSpec

MOST_BOXES, LEAST_SCORE = 64, 0.02
"""Of a scene before any is left out as found twice; heat below which there is no box."""
LONGEST_M = 1000.0
"""Sides are cut off there, so that a network that knows nothing yet gives boxes with a volume, and finite ones."""


def peaks(heat: Float[Tensor, "k y x"], most: int = MOST_BOXES) -> tuple[Float[Tensor, "n"], Tensor]:
    """Columns whose heat is the highest of the nine around them.

    Args:
        heat: in [0, 1], of one scene.
        most: how many.

    Returns:
        Heat of each, falling, and (n, 3) its category, row y and column x.
    """
    highest = functional.max_pool2d(heat[None], 3, stride=1, padding=1)[0]
    places = torch.nonzero((heat == highest) & (heat >= LEAST_SCORE))
    scores = heat[tuple(places.T)]
    order = torch.argsort(scores, descending=True, stable=True)[:most]
    return scores[order], places[order]


def find_boxes(
    heat: Float[Tensor, "k y x"],
    numbers: Float[Tensor, "8 y x"],
    grid: GridSpec,
    grid_to_world: Float[np.ndarray, "4 4"],
) -> list[tuple[int, float, Box3d]]:
    """Boxes of one scene in the world, the surest first.

    Args:
        heat: in [0, 1].
        numbers: as ``box_targets`` has them.
        grid: of the memory.
        grid_to_world: where it stands; upright.

    Returns:
        Number of the category, score in [0, 1], box.
    """
    scores, places = peaks(heat.double())
    said = numbers.double()[:, places[:, 1], places[:, 2]].T
    found = decode(said, places[:, 1:].to(said.dtype), grid).cpu().numpy()
    found[:, 3:6] = np.clip(np.nan_to_num(found[:, 3:6], posinf=LONGEST_M), 1e-3, LONGEST_M)
    boxes = [in_world(decode_box(one), grid_to_world) for one in found]
    names = [str(number) for number in places[:, 0].tolist()]
    kept = suppress_3d(boxes, scores.tolist(), names)
    return [(int(places[number, 0]), float(scores[number]), boxes[number]) for number in kept]


def in_world(box: Box3d, grid_to_world: Float[np.ndarray, "4 4"]) -> Box3d:
    """A box in other axes."""
    turn = grid_to_world[:3, :3]
    return Box3d(turn @ box.centre_m + grid_to_world[:3, 3], box.extent_m, turn @ box.rotation)
