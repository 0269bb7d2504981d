"""Flow from above: what a pair of views has measured, where it is said to move to, and the boxes of what moves."""

from collections.abc import Sequence

import cv2
import numpy as np
from jaxtyping import Float, Float64, Int, UInt8

from labeling.core.episode import Episode
from labeling.core.geometry import invert_rigid, transform_points
from labeling.core.types import Box3d
from labeling.memory.flow.flow_detector import MovingDetector, points_of
from labeling.memory.flow.flow_evaluation import moving_truths
from labeling.memory.flow.moving_objects import MovingObject, moving_voxels
from labeling.memory.settings.grid_spec import GridSpec
from labeling.memory.view_prediction.pictures import draw_rows
from labeling.memory.view_prediction.scenes import SmallScene

FOUND, TRUE, ARROW, PAPER = (230, 110, 20), (20, 150, 70), (30, 60, 200), 255
"""Colours: boxes that were found, true ones, arrows of flow, and where nothing was measured."""
FADED = 0.55
"""How far the colours of what was measured are mixed with white, so that lines stand out."""
HIGHEST_M = 2.0
"""Above the bottom of the grid: what is higher (ceilings, lamps) is left out."""
FINE = 2
"""Lines are drawn at this multiple of the size, then reduced."""
SHIFT = 4
"""Bits of a pixel's fractions that lines are drawn with."""
HEIGHT_PX = 256
PairPictures = tuple[UInt8[np.ndarray, "_ _ 3"], UInt8[np.ndarray, "_ _ 3"], UInt8[np.ndarray, "_ _ 3"]]
"""The two views of a pair, and its flow from above."""


def pair_pictures(
    detector: MovingDetector, episode: Episode, pair: SmallScene
) -> tuple[PairPictures, list[MovingObject]]:
    """The views of a pair as they were recorded, and its flow from above.

    Args:
        detector: tells the flow.
        episode: that the pair is of; with ground truth of motion, what there is to find is drawn, too.
        pair: of two of its views.

    Returns:
        The pictures, and what the detector finds to move.
    """
    grid = detector.spec.memory.grid
    output, before = detector.flow(pair)
    found = detector.objects(pair, output, before)
    flow_m, moves, occupied = (
        one[0].cpu().double().numpy() for one in (output.flow_m, output.moves.sigmoid(), before.occupied)
    )
    true = [one.box for one in moving_truths(episode, pair, grid) if not one.ignore]
    first, second = pair.view_index
    above = draw_from_above(pair, flow_m, moves[0], occupied[0], grid, found, true)
    return (episode.rgb[first], episode.rgb[second], above), found


def draw_pairs(pairs: Sequence[PairPictures], title: str) -> UInt8[np.ndarray, "height width 3"]:
    """Pairs beside each other, the views above their flow.

    Args:
        pairs: at least one.
        title: of the first views.
    """
    titles = title, "next view", "from above: flow (blue), found (orange), true (green)"
    high = [[_of_height(one) for one in pictures] for pictures in zip(*pairs, strict=True)]
    widest = max(one.shape[1] for row in high for one in row)
    rows = [(title, np.stack([_of_width(one, widest) for one in row])) for title, row in zip(titles, high, strict=True)]
    return draw_rows(rows, HEIGHT_PX)


def _of_height(picture: UInt8[np.ndarray, "h w 3"]) -> UInt8[np.ndarray, "height w2 3"]:
    width = max(1, round(HEIGHT_PX * picture.shape[1] / picture.shape[0]))
    return cv2.resize(picture, (width, HEIGHT_PX), interpolation=cv2.INTER_NEAREST)


def _of_width(picture: UInt8[np.ndarray, "h w 3"], width: int) -> UInt8[np.ndarray, "h width 3"]:
    """In the middle of white."""
    left = (width - picture.shape[1]) // 2
    sides = (0, 0), (left, width - picture.shape[1] - left), (0, 0)
    return np.pad(picture, sides, constant_values=PAPER)


def draw_from_above(
    pair: SmallScene,
    flow_m: Float[np.ndarray, "3 z y x"],
    moves: Float[np.ndarray, "z y x"],
    occupied: Float[np.ndarray, "z y x"],
    grid: GridSpec,
    found: Sequence[MovingObject] = (),
    true: Sequence[Box3d] = (),
    height_px: int = HEIGHT_PX,
) -> UInt8[np.ndarray, "height_px width_px 3"]:
    """Draws the grid of a pair from above: +X of the grid to the right, +Y up.

    Colours are those of both views, paler where only the second one has measured. A blue arrow leads from every column
    of voxels that is said to move to where it is said to go; it is what ``group_flow`` makes objects of.

    Args:
        pair: of two views.
        flow_m: to the time of the second view; x, y, z of the grid, metres.
        moves: probabilities.
        occupied: 1 where the first view has seen a surface.
        grid: of the voxels.
        found: objects, outlined in orange.
        true: boxes at the time of the first view, outlined in green.
        height_px: of the picture; the width follows from the grid.
    """
    scale = height_px / grid.extent_m[1]
    width_px = max(1, round(scale * grid.extent_m[0]))
    picture = np.full((height_px, width_px, 3), PAPER, np.uint8)
    for view, faded in ((1, 0.5 * (1 + FADED)), (0, FADED)):
        points, colours = _coloured_points(pair, view)
        low = -0.5 * grid.extent_m[2]
        inside = (points[:, 2] > low) & (points[:, 2] < low + HIGHEST_M)
        inside &= (np.abs(points[:, :2]) < 0.5 * np.array(grid.extent_m[:2])).all(axis=1)
        order = np.argsort(points[inside, 2], kind="stable")
        columns, rows = _pixels(points[inside][order, :2], grid, scale).round().astype(int).T
        side = max(1, round(0.03 * scale))
        mixed = (colours[inside][order] * (1 - faded) + 255 * faded).astype(np.uint8)
        for dy in range(-side // 2, side // 2 + 1):
            for dx in range(-side // 2, side // 2 + 1):
                place = np.clip(rows + dy, 0, height_px - 1), np.clip(columns + dx, 0, width_px - 1)
                picture[place] = mixed
    large = cv2.resize(picture, None, fx=FINE, fy=FINE, interpolation=cv2.INTER_NEAREST)
    fine = FINE * scale
    world_to_grid = invert_rigid(pair.grid_to_world(0))
    for boxes, colour in ((true, TRUE), ([one.box for one in found], FOUND)):
        for box in boxes:
            corners = transform_points(world_to_grid, box.corners())[:, :2]
            outline = cv2.convexHull(_pixels(corners, grid, fine).astype(np.float32))[:, 0]
            cv2.polylines(large, [_fixed(outline)], True, colour, 2 * FINE, cv2.LINE_AA, SHIFT)
    starts, steps = moving_columns(flow_m, moves, occupied, grid)
    ends = starts + steps
    for start, end in zip(_fixed(_pixels(starts, grid, fine)), _fixed(_pixels(ends, grid, fine)), strict=True):
        cv2.arrowedLine(large, tuple(start), tuple(end), ARROW, FINE, cv2.LINE_AA, SHIFT, 0.35)
    return cv2.resize(large, (width_px, height_px), interpolation=cv2.INTER_AREA)


def moving_columns(
    flow_m: Float[np.ndarray, "3 z y x"],
    moves: Float[np.ndarray, "z y x"],
    occupied: Float[np.ndarray, "z y x"],
    grid: GridSpec,
) -> tuple[Float64[np.ndarray, "n 2"], Float64[np.ndarray, "n 2"]]:
    """Columns of voxels that are said to move, and their mean flow.

    Args:
        flow_m: x, y, z, metres.
        moves: probabilities.
        occupied: 1 where there is a surface.
        grid: of the voxels.

    Returns:
        Middles of the columns in the frame of the grid, and steps; x, y, metres.
    """
    chosen = moving_voxels(flow_m, moves, occupied, grid)
    count = chosen.sum(axis=0)
    rows, columns = np.nonzero(count)
    total = (flow_m[:2] * chosen).sum(axis=1)[:, rows, columns]
    middles = np.stack([columns, rows], axis=1) + 0.5
    starts = middles * grid.voxel_m - 0.5 * np.array(grid.extent_m[:2])
    return starts, (total / count[rows, columns]).T.astype(np.float64)


def _coloured_points(pair: SmallScene, view: int) -> tuple[Float[np.ndarray, "n 3"], UInt8[np.ndarray, "n 3"]]:
    """What a view has measured, in the grid of the first one, with the colour of the pixel that saw it."""
    points, pixels = points_of(pair, view)
    size = pair.depth_m[view].shape[::-1]
    return points, cv2.resize(pair.rgb[view], size, interpolation=cv2.INTER_NEAREST).reshape(-1, 3)[pixels]


def _pixels(points: Float[np.ndarray, "n 2"], grid: GridSpec, scale: float) -> Float[np.ndarray, "n 2"]:
    """Column and row of points of the grid's frame, in a picture of so many pixels a metre."""
    x, y = 0.5 * np.array(grid.extent_m[:2])
    return np.stack([(points[:, 0] + x) * scale, (y - points[:, 1]) * scale], axis=1) - 0.5


def _fixed(points: Float[np.ndarray, "n 2"]) -> Int[np.ndarray, "n 2"]:
    """Pixels as whole numbers of ``SHIFT`` fractional bits."""
    return (points * 2**SHIFT).round().astype(np.int32)
