"""Contact sheets: many small pictures on one, each with a caption."""

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import UInt8

from labeling.formats.atomic import write_png

_MARGIN_PX, _CAPTION_PX = 4, 16
PAPER, _INK = 245, (40, 40, 40)


def contact_sheet(
    tiles: Sequence[tuple[UInt8[np.ndarray, "h w 3"], str]], columns: int
) -> UInt8[np.ndarray, "sheet_h sheet_w 3"]:
    """Pictures of one height in rows on light paper, each with a caption below it.

    Args:
        tiles: pictures and captions; at least one. Columns are as wide as their widest picture.
        columns: pictures in a row.
    """
    height = tiles[0][0].shape[0]
    cell_h = height + _CAPTION_PX + _MARGIN_PX
    rows = -(-len(tiles) // columns)
    widths = [max(picture.shape[1] for picture, _ in tiles[column::columns]) for column in range(len(tiles[:columns]))]
    lefts = _MARGIN_PX + np.concatenate([[0], np.cumsum(np.add(widths, _MARGIN_PX))])
    sheet = np.full((rows * cell_h + _MARGIN_PX, int(lefts[-1]), 3), PAPER, np.uint8)
    for index, (picture, caption) in enumerate(tiles):
        top, left = _MARGIN_PX + index // columns * cell_h, int(lefts[index % columns])
        width = picture.shape[1]
        sheet[top : top + height, left : left + width] = picture
        # Captions too long for their picture lose their beginnings, which are the same for all.
        letters = max(width // 6, 4)
        words = caption if len(caption) <= letters else ".." + caption[2 - letters :]
        base = (left + 1, top + height + _CAPTION_PX - 4)
        cv2.putText(sheet, words, base, cv2.FONT_HERSHEY_SIMPLEX, 0.34, _INK, 1, cv2.LINE_AA)
    return sheet


def write_sheet(path: Path, tiles: Sequence[tuple[UInt8[np.ndarray, "h w 3"], str]], columns: int) -> Path:
    """Writes ``contact_sheet`` as a PNG; returns its path."""
    write_png(path, contact_sheet(tiles, columns))
    return path
