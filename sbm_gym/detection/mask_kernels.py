"""Compiled loops over the pixels of masks: what ``mask_noise`` does to them.

Arguments that the kernels share: ``mask`` and ``drawn``, (h, w) bool; ``depth_m``, (h, w) z-depth in metres, 0 = no
return, both of the whole view; ``top`` and ``left``, where the window that is worked on begins, pixels; ``field``,
(window height, window width) float32, smooth noise that is as large as the window.
"""

import numpy as np
from numba import njit


@njit(cache=True, nogil=True, error_model="numpy")
def window_of(mask, margin_share, margin_px):
    """The part of a picture around a mask.

    Args:
        mask: see the module.
        margin_share: how far around the mask's bounds it goes, as a share of the square root of the mask's area.
        margin_px: that much farther.

    Returns:
        Area of the mask, and the window's top, left, bottom and right, the latter two just outside. All zero for an
        empty mask.
    """
    height_px, width_px = mask.shape
    area, top, left, bottom, right = 0, height_px, width_px, 0, 0
    for row in range(height_px):
        for column in range(width_px):
            if mask[row, column]:
                area += 1
                top, bottom = min(top, row), row + 1
                left, right = min(left, column), max(right, column + 1)
    if area == 0:
        return 0, 0, 0, 0, 0
    margin = int(np.ceil(margin_px + margin_share * np.sqrt(area)))
    return (
        area,
        max(0, top - margin),
        max(0, left - margin),
        min(height_px, bottom + margin),
        min(width_px, right + margin),
    )


@njit(cache=True, nogil=True, error_model="numpy")
def median_depth(mask, depth_m):
    """The median of the depth that a mask, which is not empty, lies over."""
    values_m = np.empty(mask.size, depth_m.dtype)
    count = 0
    for row in range(mask.shape[0]):
        for column in range(mask.shape[1]):
            if mask[row, column]:
                values_m[count] = depth_m[row, column]
                count += 1
    middle_m = _nth(values_m[:count], count // 2)
    if count % 2:
        return middle_m
    return (_nth(values_m[:count], count // 2 - 1) + middle_m) * np.float32(0.5)


@njit(cache=True, nogil=True, error_model="numpy")
def _nth(values, n):
    """The n-th smallest of some numbers, from 0 (quickselect, Hoare 1961; NumPy's takes seconds to compile)."""
    low, high = 0, len(values) - 1
    while low < high:
        pivot, i, j = values[(low + high) // 2], low, high
        while i <= j:
            while values[i] < pivot:
                i += 1
            while pivot < values[j]:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i, j = i + 1, j - 1
        if n <= j:
            high = j
        elif n >= i:
            low = i
        else:
            break
    return values[n]


@njit(cache=True, nogil=True, error_model="numpy")
def move_boundary(mask, depth_m, top, left, inside_px, outside_px, field, wobble, bias_px, foreign_px, middle_m, drawn):
    """Draws a mask anew with its boundary shifted.

    Args:
        mask: see the module.
        depth_m: see the module.
        top: see the module.
        left: see the module.
        inside_px: as large as the window, float32, distance of pixels of the mask from the nearest other pixel.
        outside_px: likewise, of the other pixels from the mask.
        field: see the module.
        wobble: float32, how far one unit of the field shifts the boundary outwards, pixels.
        bias_px: float32, how far all of it is shifted.
        foreign_px: float32, it goes so far (negative: outwards) where depth is that of something else.
        middle_m: depth of the mask.
        drawn: see the module; written.

    Returns:
        Number of pixels drawn.
    """
    half_px, foreign_m = np.float32(0.5), np.float32(0.75)
    count = 0
    for i in range(field.shape[0]):
        for j in range(field.shape[1]):
            own = mask[top + i, left + j]
            signed_px = inside_px[i, j] - half_px if own else half_px - outside_px[i, j]
            if not signed_px + field[i, j] * wobble + bias_px > 0.0:
                continue
            if own or signed_px > foreign_px or not abs(depth_m[top + i, left + j] - middle_m) > foreign_m:
                drawn[top + i, left + j] = True
                count += 1
    return count


@njit(cache=True, nogil=True, error_model="numpy")
def cut(drawn, top, left, field, cos, sin, share):
    """Takes away what lies farthest in a direction.

    Args:
        drawn: see the module; written.
        top: see the module.
        left: see the module.
        field: see the module.
        cos: of the direction, from the X axis of the picture towards its Y axis.
        sin: of the direction.
        share: of the mask, which is not empty, to take away.
    """
    along = np.empty(field.size)
    low, high, count = np.inf, -np.inf, 0
    for i in range(field.shape[0]):
        for j in range(field.shape[1]):
            if drawn[top + i, left + j]:
                along[count] = j * cos + i * sin
                low, high = min(low, along[count]), max(high, along[count])
                count += 1
    swing = 0.1 * (high - low)
    count = 0
    for i in range(field.shape[0]):
        for j in range(field.shape[1]):
            if drawn[top + i, left + j]:
                along[count] += swing * field[i, j]
                count += 1
    limit = _quantile(along[:count].copy(), 1.0 - share)
    count = 0
    for i in range(field.shape[0]):
        for j in range(field.shape[1]):
            if drawn[top + i, left + j]:
                drawn[top + i, left + j] = not along[count] > limit
                count += 1


@njit(cache=True, nogil=True, error_model="numpy")
def _quantile(values, share):
    """The quantile of numbers, linear between the two nearest ones; changes their order."""
    position = (len(values) - 1) * share
    before = int(np.floor(position))
    low = _nth(values, before)
    if before + 1 >= len(values):
        return low
    high, part = _nth(values, before + 1), position - before
    difference = high - low
    return high - difference * (1.0 - part) if part >= 0.5 else low + difference * part


@njit(cache=True, nogil=True, error_model="numpy")
def is_inner(mask, row, column):
    """Whether all neighbours of a pixel that lie in the picture are in a mask, as is the pixel itself.

    Args:
        mask: (h, w) bool.
        row: of the pixel.
        column: of the pixel.
    """
    height_px, width_px = mask.shape
    for i in range(max(row - 1, 0), min(row + 2, height_px)):
        for j in range(max(column - 1, 0), min(column + 2, width_px)):
            if not mask[i, j]:
                return False
    return True


@njit(cache=True, nogil=True, error_model="numpy")
def boundary_pixels(mask):
    """Numbers of the pixels of a mask that touch, even by a corner, one that is not of it; (n,) int64, line by line."""
    height_px, width_px = mask.shape
    pixels = np.empty(mask.size, np.int64)
    count = 0
    for row in range(height_px):
        for column in range(width_px):
            if mask[row, column] and not is_inner(mask, row, column):
                pixels[count] = row * width_px + column
                count += 1
    return pixels[:count]


@njit(cache=True, nogil=True, error_model="numpy")
def spill(drawn, depth_m, top, left, field, row, column, radius_px):
    """Adds what lies around a pixel at about the same depth.

    Args:
        drawn: see the module; written.
        depth_m: see the module.
        top: see the module.
        left: see the module.
        field: see the module.
        row: of the pixel, in the picture.
        column: likewise.
        radius_px: float32, how far to go.
    """
    middle_m, reach_m = depth_m[row, column], np.float32(0.25)
    one, waviness = np.float32(1.0), np.float32(0.3)
    for i in range(field.shape[0]):
        for j in range(field.shape[1]):
            seen_m = depth_m[top + i, left + j]
            if seen_m > 0.0 and abs(seen_m - middle_m) < reach_m:
                dy, dx = top + i - row, left + j - column
                if np.sqrt(float(dy * dy + dx * dx)) < radius_px * (one + waviness * field[i, j]):
                    drawn[top + i, left + j] = True


@njit(cache=True, nogil=True, error_model="numpy")
def blob(depth_m, field, row, column, radius_y_px, radius_x_px):
    """An ellipse with a wavy boundary, as far as depth is about that of its middle.

    Args:
        depth_m: see the module.
        field: see the module; the window is the whole view.
        row: of the middle.
        column: of the middle.
        radius_y_px: half its height.
        radius_x_px: half its width.

    Returns:
        (h, w) bool.
    """
    found = np.zeros(depth_m.shape, np.bool_)
    middle_m, reach_m = depth_m[row, column], np.float32(0.4)
    one, waviness = np.float32(1.0), np.float32(0.25)
    for i in range(depth_m.shape[0]):
        for j in range(depth_m.shape[1]):
            if depth_m[i, j] > 0.0 and abs(depth_m[i, j] - middle_m) < reach_m:
                distance = np.hypot((i - row) / radius_y_px, (j - column) / radius_x_px)
                found[i, j] = distance < one + waviness * field[i, j]
    return found
