"""Compiled decoding of stored views: differences along rows, and masks from COCO RLE."""

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def sum_along_rows(low, high, unit, numbers):
    """Adds up differences along rows, modulo 65,536.

    Args:
        low: (h, w) uint8, the differences' low bytes.
        high: (h, w) uint8, their high bytes.
        unit: a difference of 1 in units of the result, of its type.
        numbers: (h, w) float32 or int32, the sums times the unit; written.
    """
    for row in range(low.shape[0]):
        total = np.uint16(0)
        for column in range(low.shape[1]):
            total = np.uint16(total + low[row, column] + (np.uint16(high[row, column]) << 8))
            numbers[row, column] = total * unit


@njit(cache=True, nogil=True)
def draw_masks(text, ends, masks):
    """Draws masks from their compressed COCO RLE.

    Source: the COCO API's maskApi, ``rleFrString``: a run is groups of 5 bits, the lowest first and the highest
    sign-extended, each with a sixth bit that says whether more follow, written as characters from ``0`` on; every run
    from the fourth on is its difference from the run two before. Runs go down the columns, outside first.

    Args:
        text: (t,) uint8, the codes of all masks.
        ends: (n + 1,) int64, where each begins, and where the last one ends.
        masks: (n, h, w) bool, all False; written.

    Returns:
        Whether the runs of every mask fill its picture exactly.
    """
    height, width = masks.shape[1:]
    for mask in range(len(masks)):
        pixel, last, before, runs, at = 0, 0, 0, 0, ends[mask]
        while at < ends[mask + 1]:
            run, shift, more = 0, 0, True
            while more:
                if at == ends[mask + 1] or shift > 50:
                    return False
                group = int(text[at]) - 48
                at += 1
                if not 0 <= group < 64:
                    return False
                run |= (group & 31) << shift
                shift += 5
                more = group & 32 != 0
                if not more and group & 16 != 0:
                    run |= -1 << shift
            run += before if runs > 2 else 0
            if run < 0 or pixel + run > height * width:
                return False
            if runs % 2 == 1:
                row, column = pixel % height, pixel // height
                for _ in range(run):
                    masks[mask, row, column] = True
                    row += 1
                    if row == height:
                        row, column = 0, column + 1
            pixel, before, last, runs = pixel + run, last, run, runs + 1
        if pixel != height * width:
            return False
    return True
