"""Contact sheets of photographs with their masks drawn in, to check them by eye."""

from pathlib import Path

import numpy as np
from jaxtyping import Bool, UInt8

from labeling.core.rle import decode_mask
from labeling.detectors.data.annotated_pictures import read_pictures
from sbm_gym.rendering.contact_sheet import write_sheet

COLUMNS = 8
_INK, _IGNORED, _PAPER = (70, 255, 70), (255, 140, 0), 245


def draw_sheet(folder: Path, count: int, path: Path) -> None:
    """Draws photographs of an album, spread evenly over it; masks outlined in green, ignored ones in orange.

    Args:
        folder: of the album, with its ``annotations.json``.
        count: how many photographs.
        path: PNG to write.
    """
    photographs = read_pictures(folder)
    chosen = [photographs[k] for k in np.unique(np.linspace(0, len(photographs) - 1, count).astype(int)).tolist()]
    side = max(max(one.size) for one in chosen)
    tiles = []
    for one in chosen:
        rgb = one.rgb()
        for annotation in one.annotations:
            outline(rgb, decode_mask(annotation.rle), _IGNORED if annotation.ignore else _INK)
        tile = np.full((side, side, 3), _PAPER, np.uint8)
        tile[: one.size[0], : one.size[1]] = rgb
        tiles.append((tile, " ".join(a.category for a in one.annotations if not a.ignore)))
    write_sheet(path, tiles, COLUMNS)


def outline(rgb: UInt8[np.ndarray, "h w 3"], mask: Bool[np.ndarray, "h w"], ink: tuple[int, int, int]) -> None:
    """Draws the rim of a mask into a picture."""
    import cv2

    inner = cv2.erode(mask.astype(np.uint8), np.ones((3, 3), np.uint8), borderType=cv2.BORDER_CONSTANT, borderValue=0)
    rgb[mask & (inner == 0)] = ink
