"""Compiled loops over COCO run-length encodings."""

import numpy as np
from numba import njit


@njit(cache=True, nogil=True)
def sum_runs(text):  # pragma: no cover - compiled
    """Sum of the runs that ``text`` (t,) uint8 encodes; then 0, or the character that is not of the code, or -1 if the
    last run does not end.

    Source: the COCO API's maskApi, ``rleFrString``: a run is groups of 5 bits, the lowest first and the highest
    sign-extended, each with a sixth bit that says whether more follow, written as characters from ``0`` on; every run
    from the fourth on is its difference from the run two before.
    """
    total, last, before, runs, run, shift = 0, 0, 0, 0, 0, 0
    for character in text:
        group = np.int64(character) - 48
        if group > 63:
            return 0, np.int64(character)
        # Higher bits than there are lie beyond any picture.
        run |= (group & 31) << shift if shift < 60 else 0
        shift += 5
        if group & 32 == 0:
            if group & 16 != 0 and shift < 60:
                run |= -1 << shift
            run += before if runs > 2 else 0
            total += run
            before, last, runs, run, shift = last, run, runs + 1, 0, 0
    return total, -1 if shift > 0 else 0
