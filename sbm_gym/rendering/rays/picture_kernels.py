"""Compiled kernels that make a picture of surfaces and light: colours and bytes."""

import math

from numba import njit

from sbm_gym.rendering.rays.surface_table import SurfaceTable
from sbm_gym.rendering.tables.light_tables import AmbientTable
from sbm_gym.rendering.tables.scene_tables import GeomTable
from sbm_gym.rendering.tables.textures import LINEAR_STEPS, LINEAR_TO_BYTE

SHOULDER = 0.6
"""Linear light above this is compressed softly towards white instead of being cut off."""


@njit(cache=True, nogil=True, error_model="numpy")
def combine(start, stop, seen: SurfaceTable, geoms: GeomTable, ambient: AmbientTable, albedo, light, colour):
    """Linear light that comes back along each ray: off the surface, as gloss, by its own glow, through haze.

    Args:
        start: first ray.
        stop: behind the last one.
        seen: what the n rays hit.
        geoms: of the scene.
        ambient: of the scene.
        albedo: (n, 3) float32, linear colour of the surface; the sky's light where nothing was hit.
        light: (n, 6) float32, irradiance and gloss.
        colour: (n, 3) float32; written.
    """
    rays, t, _, geom, _ = seen
    emission, horizon, haze_per_m = geoms.emission, ambient.sky[1], ambient.haze_per_m
    for i in range(start, stop):
        if geom[i] < 0:
            colour[i, 0], colour[i, 1], colour[i, 2] = albedo[i, 0], albedo[i, 1], albedo[i, 2]
            continue
        glow = emission[geom[i]]
        for channel in range(3):
            colour[i, channel] = albedo[i, channel] * (light[i, channel] + glow) + light[i, 3 + channel]
        if haze_per_m > 0.0:
            away = t[i] * math.sqrt(rays[i, 3] ** 2 + rays[i, 4] ** 2 + rays[i, 5] ** 2)
            through = math.exp(-haze_per_m * away)
            for channel in range(3):
                colour[i, channel] = horizon[channel] + through * (colour[i, channel] - horizon[channel])


@njit(cache=True, nogil=True, error_model="numpy", forceinline=True)
def _tone(linear):
    """Identity up to the shoulder, then a curve with the same slope that reaches white only at infinity."""
    if linear <= SHOULDER:
        return max(linear, 0.0)
    return SHOULDER + (1.0 - SHOULDER) * (1.0 - math.exp((SHOULDER - linear) / (1.0 - SHOULDER)))


@njit(cache=True, nogil=True, error_model="numpy")
def encode(start, stop, colour, exposure, rgb):
    """Pixels as sRGB bytes.

    Args:
        start: first pixel.
        stop: behind the last one.
        colour: (n, 3) float32, linear light.
        exposure: what it is multiplied by.
        rgb: (n, 3) uint8; written.
    """
    for i in range(start, stop):
        for channel in range(3):
            rgb[i, channel] = LINEAR_TO_BYTE[int(_tone(exposure * colour[i, channel]) * LINEAR_STEPS + 0.5)]


@njit(cache=True, nogil=True, error_model="numpy")
def encode_samples(start, stop, pixels, samples, colour, of_colour, exposure, rgb):
    """Some pixels as sRGB bytes: the mean of their own tone-mapped colour and that of their sub-rays.

    Args:
        start: first of these pixels.
        stop: behind the last one.
        pixels: (k,) int64, their numbers in the picture.
        samples: sub-rays of a pixel.
        colour: (k * samples, 3) float32, linear light of the sub-rays.
        of_colour: (n, 3) float32, linear light of all pixels.
        exposure: what it is multiplied by.
        rgb: (n, 3) uint8; written.
    """
    for k in range(start, stop):
        for channel in range(3):
            total = _tone(exposure * of_colour[pixels[k], channel])
            for sample in range(samples):
                total += _tone(exposure * colour[k * samples + sample, channel])
            rgb[pixels[k], channel] = LINEAR_TO_BYTE[int(total / (samples + 1) * LINEAR_STEPS + 0.5)]
