"""Compiled kernels that take the light of a point from pixels around it that see the same surface in the same light.

Light on a surface changes slowly, except at the edges of shadows. In a picture it is worked out for every other pixel,
like the black squares of a chessboard; a white one between four that agree lies between them in brightness too. (A
shadow one pixel wide differs from two of the four.) Sub-rays of an edge pixel take the light of what they hit from the
pixels around them, where the edges of shadows have been softened. What a surface looks like is always its own.
"""

from numba import njit

SAME_SURFACE_COSINE = 0.9
"""Neighbouring hits whose normals differ by less may belong to one surface."""
STEP_M = 0.01
STEP_PER_M = 0.01
"""So do hits that lie no farther off each other's tangential plane than this, at depth zero and more for each metre."""

CLOSE = 0.01
"""Light that differs by less than this share of the sum counts as the same: about two of 255 levels."""


@njit(cache=True, nogil=True, error_model="numpy")
def relate(start, stop, width, height, rays, t, triangle, geom, normal, across, below):
    """Whether pixels of a picture see the same smooth surface as their right and as their lower neighbour."""
    for i in range(start, stop):
        across[i] = below[i] = False
        nx, ny, nz = normal[i, 0], normal[i, 1], normal[i, 2]
        for step in range(2):
            j = i + 1 if step == 0 else i + width
            is_inside = i % width < width - 1 if step == 0 else i // width < height - 1
            if not is_inside or geom[i] != geom[j]:
                continue
            same = triangle[i] == triangle[j]
            if not same:
                cosine = nx * normal[j, 0] + ny * normal[j, 1] + nz * normal[j, 2]
                off = nx * (t[j] * rays[j, 3] - t[i] * rays[i, 3])
                off += ny * (t[j] * rays[j, 4] - t[i] * rays[i, 4])
                off += nz * (t[j] * rays[j, 5] - t[i] * rays[i, 5])
                same = cosine >= SAME_SURFACE_COSINE and abs(off) <= STEP_M + STEP_PER_M * t[i]
            if step == 0:
                across[i] = same
            else:
                below[i] = same


@njit(cache=True, nogil=True, error_model="numpy")
def light_white_pixels(start, stop, width, height, geom, across, below, light, lit, is_open):
    """Takes light of white pixels from the four black ones around; marks those where they do not agree.

    Args:
        start: first pixel.
        stop: behind the last one.
        width: of the picture.
        height: of the picture.
        geom: what pixels see.
        across: whether their right neighbours see the same surface.
        below: whether the lower ones do.
        light: light there; of black pixels it is known, of white ones it is written.
        lit: the lamps that shine there; likewise.
        is_open: white pixels that are left to be worked out; written.
    """
    for i in range(start, stop):
        is_open[i] = False
        x, y = i % width, i // width
        if (x + y) % 2 == 0 or geom[i] < 0:
            continue
        is_open[i] = True
        if x == 0 or y == 0 or not (across[i] and across[i - 1] and below[i] and below[i - width]):
            continue
        left, right, above, under = i - 1, i + 1, i - width, i + width
        same_lamps = lit[left] == lit[right] and lit[left] == lit[above] and lit[left] == lit[under]
        agree = True
        for channel in range(3):
            a, b = light[left, channel], light[right, channel]
            c, d = light[above, channel], light[under, channel]
            e, f = light[left, 3 + channel], light[right, 3 + channel]
            g, h = light[above, 3 + channel], light[under, 3 + channel]
            if same_lamps:
                # Where light changes evenly both pairs have the same mean.
                apart = abs(a + b - c - d) + abs(e + f - g - h)
            else:
                apart = max(max(a, b), max(c, d)) - min(min(a, b), min(c, d))
                apart += max(max(e, f), max(g, h)) - min(min(e, f), min(g, h))
            agree &= apart <= CLOSE * (a + b + c + d)
        if not agree:
            continue
        is_open[i] = False
        lit[i] = lit[left]
        for channel in range(6):
            together = light[left, channel] + light[right, channel] + light[above, channel] + light[under, channel]
            light[i, channel] = 0.25 * together


@njit(cache=True, nogil=True, error_model="numpy")
def soften_shadows(start, stop, width, height, geom, across, below, light, lit, softened):
    """Copies the light of a picture; at the edges of shadows the mean of 3 x 3 pixels of the surface, near ones more.

    Args:
        start: first pixel.
        stop: behind the last one.
        width: of the picture.
        height: of the picture.
        geom: what pixels see.
        across: whether their right neighbours see the same surface.
        below: whether the lower ones do.
        light: light there.
        lit: the lamps that shine there.
        softened: the new light; written.
    """
    for i in range(start, stop):
        for channel in range(6):
            softened[i, channel] = light[i, channel]
        x, y = i % width, i // width
        if geom[i] < 0 or x == 0 or y == 0 or x == width - 1 or y == height - 1:
            continue
        left, right, above, under = i - 1, i + 1, i - width, i + width
        one = lit[i]
        is_edge = (across[left] and one != lit[left]) or (across[i] and one != lit[right])
        if not (is_edge or (below[above] and one != lit[above]) or (below[i] and one != lit[under])):
            continue
        total = 4.0
        for channel in range(6):
            softened[i, channel] *= 4.0
        for row in range(-1, 2):
            for column in range(-1, 2):
                j = i + row * width + column
                # The surface may go on directly, or around either corner.
                side = across[i] if column > 0 else across[left]
                end = below[i] if row > 0 else below[above]
                if row == 0:
                    same = side and column != 0
                elif column == 0:
                    same = end
                else:
                    onward = below[i + column] if row > 0 else below[above + column]
                    aside = across[i + row * width] if column > 0 else across[left + row * width]
                    same = (side and onward) or (end and aside)
                if not same:
                    continue
                weight = 2.0 if row == 0 or column == 0 else 1.0
                total += weight
                for channel in range(6):
                    softened[i, channel] += weight * light[j, channel]
        for channel in range(6):
            softened[i, channel] /= total


@njit(cache=True, nogil=True, error_model="numpy")
def light_samples(
    start,
    stop,
    pixels,
    samples,
    width,
    height,
    rays,
    t,
    triangle,
    geom,
    normal,
    of_rays,
    of_t,
    of_triangle,
    of_geom,
    of_normal,
    of_light,
    light,
    is_open,
):
    """Takes light of sub-rays from their own pixel, else from those beside it; marks those where none fits.

    Args:
        start: first sub-ray.
        stop: behind the last one.
        pixels: the pixel of every ``samples`` sub-rays.
        samples: sub-rays of a pixel.
        width: of the picture.
        height: of the picture.
        rays: the sub-rays.
        t: where they hit.
        triangle: what.
        geom: what.
        normal: there.
        of_rays: the rays of the picture's pixels.
        of_t: where they hit.
        of_triangle: what.
        of_geom: what.
        of_normal: there.
        of_light: light there.
        light: light where the sub-rays hit; written.
        is_open: sub-rays whose light must be worked out; written.
    """
    for i in range(start, stop):
        is_open[i] = False
        if geom[i] < 0:
            continue
        pixel = pixels[i // samples]
        x, y = pixel % width, pixel // width
        nx, ny, nz = normal[i, 0], normal[i, 1], normal[i, 2]
        px, py, pz = t[i] * rays[i, 3], t[i] * rays[i, 4], t[i] * rays[i, 5]
        found = 0.0
        for step in range(5):
            if step == 0:
                j = pixel
            elif step == 1:
                j = pixel - 1 if x > 0 else -1
            elif step == 2:
                j = pixel + 1 if x < width - 1 else -1
            elif step == 3:
                j = pixel - width if y > 0 else -1
            else:
                j = pixel + width if y < height - 1 else -1
            if j < 0 or geom[i] != of_geom[j]:
                continue
            if triangle[i] != of_triangle[j]:
                cosine = nx * of_normal[j, 0] + ny * of_normal[j, 1] + nz * of_normal[j, 2]
                off = nx * (of_t[j] * of_rays[j, 3] - px)
                off += ny * (of_t[j] * of_rays[j, 4] - py) + nz * (of_t[j] * of_rays[j, 5] - pz)
                if cosine < SAME_SURFACE_COSINE or abs(off) > STEP_M + STEP_PER_M * t[i]:
                    continue
            # The mean of those found so far.
            found += 1.0
            for channel in range(6):
                before = light[i, channel] if found > 1.0 else 0.0
                light[i, channel] = before + (of_light[j, channel] - before) / found
            if step == 0:
                break
        is_open[i] = found == 0.0
