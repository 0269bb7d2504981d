"""Compiled kernels of irradiance interpolation: light of a point is taken from pixels around it on the same surface.

Irradiance changes slowly along a surface, except at the edges of shadows. In a picture it is computed for every other
pixel, like the black squares of a chessboard; a white one between four that agree gets their mean. (A shadow one pixel
wide differs from two of the four.) Sub-rays of an edge pixel take the light of what they hit from the pixels around
them, where the edges of shadows have been softened. Colours of surfaces are never interpolated.

Arguments that the kernels share: ``start`` and ``stop``, the range of rows to work on; ``width`` and ``height`` of the
picture in pixels, whose n rows go line by line; ``across`` and ``below``, (n,) bool, whether a pixel's right and lower
neighbour see the same surface; ``light``, (n, 6) float32, linear red, green and blue irradiance, then the same as
gloss; ``lit``, (n,) uint64, one bit for each lamp that shines there; ``is_open``, (n,) bool, rows whose light must
still be computed. Source: after Ward et al., A Ray Tracing Solution for Diffuse Interreflection, 1988.
"""

from numba import njit

from sbm_gym.rendering.rays.surface_table import SurfaceTable

SAME_SURFACE_COSINE = 0.9
"""Neighbouring hits whose normals differ by less may belong to one surface."""
STEP_M = 0.01
STEP_PER_M = 0.01
"""So do hits that lie no farther off each other's tangential plane than this, at depth zero and more for each metre."""

CLOSE = 0.01
"""Light that differs by less than this share of the sum counts as the same: about two of 255 levels."""


@njit(cache=True, nogil=True, error_model="numpy")
def same_surface(start, stop, width, height, seen: SurfaceTable, across, below):
    """Whether pixels see the same smooth surface as their right and as their lower neighbour; see the module.

    Args:
        start: first pixel.
        stop: behind the last one.
        width: of the picture.
        height: of the picture.
        seen: what the pixels see.
        across: written.
        below: written.
    """
    rays, t, triangle, geom, normal = seen
    last_row, x = (height - 1) * width, start % width - 1
    for i in range(start, stop):
        x = x + 1 if x < width - 1 else 0
        across[i] = below[i] = False
        nx, ny, nz = normal[i, 0], normal[i, 1], normal[i, 2]
        for step in range(2):
            j = i + 1 if step == 0 else i + width
            is_inside = x < width - 1 if step == 0 else i < last_row
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
def interpolate_light(start, stop, width, height, geom, across, below, light, lit, is_open):
    """Gives white pixels the mean light of the four black ones around; marks those where these do not agree.

    Args:
        start: first pixel.
        stop: behind the last one.
        width: of the picture.
        height: of the picture.
        geom: (n,) int32, the geom that each pixel sees, -1 for nothing.
        across: see the module.
        below: see the module.
        light: of black pixels it is known, of white ones it is written.
        lit: likewise.
        is_open: white pixels that are left; written.
    """
    x, y = start % width - 1, start // width
    for i in range(start, stop):
        x, y = (x + 1, y) if x < width - 1 else (0, y + 1)
        is_open[i] = False
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
        geom: (n,) int32, the geom that each pixel sees, -1 for nothing.
        across: see the module.
        below: see the module.
        light: see the module.
        lit: see the module.
        softened: (n, 6) float32, the new light; written.
    """
    x, y = start % width - 1, start // width
    for i in range(start, stop):
        x, y = (x + 1, y) if x < width - 1 else (0, y + 1)
        for channel in range(6):
            softened[i, channel] = light[i, channel]
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
def interpolate_samples(
    start, stop, pixels, samples, width, height, seen: SurfaceTable, around: SurfaceTable, around_light, light, is_open
):
    """Gives sub-rays the light of their own pixel, else of those beside it; marks those where none fits.

    Args:
        start: first sub-ray.
        stop: behind the last one.
        pixels: (k,) int64, the pixel of every ``samples`` sub-rays.
        samples: sub-rays of a pixel.
        width: of the picture.
        height: of the picture.
        seen: what the k * samples sub-rays hit.
        around: what the pixels see.
        around_light: (n, 6) float32, light there.
        light: of the sub-rays; written.
        is_open: sub-rays that are left; written.
    """
    rays, t, triangle, geom, normal = seen
    of_rays, of_t, of_triangle, of_geom, of_normal = around
    for i in range(start, stop):
        is_open[i] = False
        if geom[i] < 0:
            continue
        pixel = pixels[i // samples]
        x = pixel % width
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
                j = pixel - width if pixel >= width else -1
            else:
                j = pixel + width if pixel < (height - 1) * width else -1
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
                light[i, channel] = before + (around_light[j, channel] - before) / found
            if step == 0:
                break
        is_open[i] = found == 0.0
