"""Pictures of building materials made from noise: planks, carpet, tiles, plaster, wallpaper, views, paintings.

All pictures of materials tile without a seam. Each comes with the length of wall or floor that it covers.
"""

import functools
import tomllib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, UInt8
from numba import njit


@dataclass(frozen=True)
class Material:
    """A tiling picture of a building material."""

    texture: UInt8[np.ndarray, "h w 3"]
    size_m: tuple[float, float]
    """Width and height that one picture covers."""
    specular: float = 0.0
    shininess: float = 0.3


def periodic_noise(
    rng: np.random.Generator, shape: tuple[int, int], scale: tuple[float, float]
) -> Float[np.ndarray, "h w"]:
    """Smooth noise that tiles: white noise blurred by a Gaussian around the torus.

    Args:
        rng: source of randomness.
        shape: height and width, pixels.
        scale: standard deviations of the Gaussian down and across, pixels.

    Returns:
        Noise of mean 0 and standard deviation 1.
    """
    import cv2

    noise = _white_noise(rng, shape)
    # In one array: fresh ones would cost as much as what is worked out in them.
    cv2.dft(noise, dst=noise)
    noise *= _blur(shape, scale)
    cv2.idft(noise, dst=noise, flags=cv2.DFT_SCALE)
    noise /= max(cv2.norm(noise) / np.sqrt(noise.size), 1e-12)
    return noise


@njit(cache=True, nogil=True)
def _white_noise(rng, shape):
    """The numbers that ``rng.standard_normal(shape)`` gives; compiled they take a third of the time."""
    return rng.standard_normal(shape)


@functools.lru_cache(maxsize=64)
def _blur(shape: tuple[int, int], scale: tuple[float, float]) -> Float[np.ndarray, "h w"]:
    """Which share of each number of a spectrum a Gaussian keeps, none of the mean. The same few are asked for often.

    Source: OpenCV, ``dft``: real spectra are packed, with a row and a column for real and imaginary parts each, but
    for the columns of the least and (where their number is even) the greatest frequency, whose rows are paired.
    """
    height, width = shape
    row, column = np.arange(height), np.arange(width)
    paired = (column == 0) | ((column == width - 1) & (width % 2 == 0))
    frequency_y = np.where(paired, (row[:, None] + 1) // 2, np.minimum(row, height - row)[:, None]) / height
    frequency_x = (column + 1) // 2 / width
    # Fourier transform of a Gaussian of standard deviation s: exp(-2 (pi s f)^2).
    keep = np.exp(-2 * np.pi**2 * ((scale[0] * frequency_y) ** 2 + (scale[1] * frequency_x) ** 2))
    keep[0, 0] = 0.0
    keep.setflags(write=False)
    return keep


def layered_noise(
    rng: np.random.Generator,
    shape: tuple[int, int],
    *layers: tuple[float, float, float],
    base: float | Float[np.ndarray, "h w"] = 0.0,
) -> Float[np.ndarray, "h w"]:
    """A sum of ``periodic_noise``.

    Args:
        rng: source of randomness.
        shape: height and width, pixels.
        layers: for each layer its scale down and across, pixels, and its strength.
        base: what the layers are added to.
    """
    total = np.zeros(shape) + base
    for down, across, strength in layers:
        noise = periodic_noise(rng, shape, (down, across))
        noise *= strength
        total += noise
    return total


def as_picture(
    colour: Float[np.ndarray, "h w 3"] | Float[np.ndarray, "3"], shade: Float[np.ndarray, "h w"] | None = None
) -> UInt8[np.ndarray, "h w 3"]:
    """Colours from 0 to 255 as bytes.

    Args:
        colour: of every pixel; one for all of them will do if they have a shade.
        shade: what each pixel's colour is multiplied by; nothing if None.
    """
    import cv2

    if shade is None:
        return cv2.add(colour, 0.0, dtype=cv2.CV_8U)  # type: ignore[call-overload]
    if colour.ndim == 1:
        planes = [cv2.multiply(shade, part, dtype=cv2.CV_8U) for part in colour.tolist()]
        return cv2.merge(planes)
    return cv2.multiply(colour, cv2.merge([shade] * 3), dtype=cv2.CV_8U)


_PALETTES = tomllib.loads(Path(__file__).with_name("palettes.toml").read_text(encoding="utf-8"))


def _pick(rng: np.random.Generator, name: str) -> Float[np.ndarray, "3"]:
    """A tone near one of a palette."""
    palette = _PALETTES[name]
    return np.array(palette[rng.integers(len(palette))], float) + rng.normal(0, 4, 3)


def wood_planks(rng: np.random.Generator) -> Material:
    """A floor of planks, ten rows of 12 cm, each row with two joints."""
    rows, side = 10, 500
    row_px = side // rows
    base = _pick(rng, "wood")
    tone = np.zeros((side, side))
    seam = np.zeros((side, side), bool)
    for row in range(rows):
        at = slice(row * row_px, (row + 1) * row_px)
        start = int(rng.integers(side))
        cut = start + int(side * rng.uniform(0.4, 0.6))
        column = (np.arange(side) - start) % side < (cut - start)
        tones = rng.normal(0, 0.09, 2)
        tone[at] += np.where(column, tones[0], tones[1])
        seam[at, start % side] = seam[at, cut % side] = True
        seam[row * row_px] = True
    # Grain belongs to its plank, so each row gets its own stretch of noise.
    grain = layered_noise(rng, (side, side), (1.0, 30.0, 0.045), (3.0, 60.0, 0.04))
    for row in range(rows):
        at = slice(row * row_px, (row + 1) * row_px)
        grain[at] = np.roll(grain[at], int(rng.integers(side)), axis=1)
    shade = 1 + tone + grain
    shade[seam] *= 0.62
    return Material(as_picture(base, shade), (1.2, 1.2), specular=0.15, shininess=0.4)


def parquet(rng: np.random.Generator) -> Material:
    """Basket-weave parquet: squares of five short staves, turned in turn."""
    squares, staves, stave_px = 4, 5, 25
    square_px = staves * stave_px
    side = squares * square_px
    base = _pick(rng, "wood")
    shade = np.ones((side, side))
    along = periodic_noise(rng, (side, side), (1.2, 25.0)) * 0.05
    for i in range(squares):
        for j in range(squares):
            block = np.repeat(1 + rng.normal(0, 0.08, staves), stave_px)[:, None] * np.ones(square_px)
            block += np.roll(along, int(rng.integers(side)), axis=1)[:square_px, :square_px]
            block[::stave_px] *= 0.68
            block[:, 0] *= 0.68
            shade[i * square_px : (i + 1) * square_px, j * square_px : (j + 1) * square_px] = (
                block if (i + j) % 2 else block.T
            )
    return Material(as_picture(base, shade), (1.2, 1.2), specular=0.15, shininess=0.4)


def carpet(rng: np.random.Generator) -> Material:
    """Wall-to-wall carpet: fine pile with slow changes of tone."""
    side = 384
    pile = layered_noise(rng, (side, side), (0.7, 0.7, 0.06), (12, 12, 0.025))
    return Material(as_picture(_pick(rng, "carpet"), 1 + pile), (1.0, 1.0))


def tiles(rng: np.random.Generator) -> Material:
    """Square floor tiles with grout."""
    count, tile_px = 4, 110
    side = count * tile_px
    base = _pick(rng, "floor_tile")
    shade = np.repeat(np.repeat(1 + rng.normal(0, 0.035, (count, count)), tile_px, axis=0), tile_px, axis=1)
    shade = shade + layered_noise(rng, (side, side), (10, 10, 0.02), (2, 2, 0.012))
    inside = np.minimum(np.arange(side) % tile_px, (tile_px - 1) - np.arange(side) % tile_px)
    picture, grout = as_picture(base, shade), as_picture(base * 0.62 + 10, np.ones((1, 1)))
    picture[(inside[:, None] < 2) | (inside[None] < 2)] = grout[0, 0]
    size = count * float(rng.choice([0.3, 0.33, 0.45]))
    return Material(picture, (size, size), specular=0.3, shininess=0.6)


def plaster(rng: np.random.Generator) -> Material:
    """Painted plaster."""
    side = 384
    rough = layered_noise(rng, (side, side), (1.5, 1.5, 0.010), (20, 20, 0.010))
    return Material(as_picture(_pick(rng, "wall"), 1 + rough), (1.5, 1.5))


def wallpaper(rng: np.random.Generator) -> Material:
    """Wallpaper with stripes, dots or leaves in a tone near its ground."""
    side = 400
    ground = _pick(rng, "wall")
    y, x = np.mgrid[0:side, 0:side] / side
    kind = int(rng.integers(3))
    if kind == 0:
        bands = int(rng.integers(4, 9))
        figure = (np.sin(2 * np.pi * bands * x) > rng.uniform(-0.3, 0.6)).astype(float)
    else:
        count = int(rng.integers(4, 8))
        u = (x * count + 0.5 * (np.floor(y * count).astype(int) % 2 if count % 2 == 0 else 0)) % 1 - 0.5
        v = (y * count) % 1 - 0.5
        if kind == 1:
            figure = (np.hypot(u, v) < rng.uniform(0.1, 0.22)).astype(float)
        else:
            angle, radius = np.arctan2(v, u), np.hypot(u, v)
            figure = (radius < 0.36 * np.abs(np.cos(rng.integers(2, 4) * angle))).astype(float)
    tint = 1 + rng.choice([-1, 1]) * rng.uniform(0.04, 0.10)
    fibre = 1 + periodic_noise(rng, (side, side), (1, 1)) * 0.008
    return Material(as_picture(ground * np.where(figure[..., None] > 0, tint, 1.0), fibre), (1.0, 1.0))


def wall_tiles(rng: np.random.Generator) -> Material:
    """Glazed wall tiles, white or a light tone, with grout."""
    count, tile_px = 4, 80
    side = count * tile_px
    base = _pick(rng, "wall_tile")
    shade = np.repeat(np.repeat(1 + rng.normal(0, 0.012, (count, count)), tile_px, axis=0), tile_px, axis=1)
    shade += periodic_noise(rng, (side, side), (8, 8)) * 0.006
    inside = np.minimum(np.arange(side) % tile_px, (tile_px - 1) - np.arange(side) % tile_px)
    shade[(inside[:, None] < 1) | (inside[None] < 1)] = 0.78
    size = count * float(rng.choice([0.15, 0.2, 0.3]))
    wide = 2.0 if rng.random() < 0.4 else 1.0
    return Material(as_picture(base, shade), (wide * size, size), specular=0.3, shininess=0.7)


def curtain(rng: np.random.Generator) -> UInt8[np.ndarray, "h w 3"]:
    """Curtain cloth: one tone with a fine weave, sometimes with stripes."""
    side = 128
    colour = np.broadcast_to(_pick(rng, "curtain"), (side, side, 3)).copy()
    if rng.random() < 0.35:
        colour[:, (np.arange(side) // int(rng.integers(8, 24))) % 2 == 0] *= rng.uniform(0.82, 0.94)
    return as_picture(colour, 1 + periodic_noise(rng, (side, side), (0.7, 0.7)) * 0.03)


def ceiling(rng: np.random.Generator) -> Material:
    """White paint on a slightly rough ceiling."""
    side = 256
    rough = periodic_noise(rng, (side, side), (1.2, 1.2)) * 0.008
    return Material(as_picture(np.array([238.0, 237.0, 233.0]), 1 + rough), (1.5, 1.5))


def rug(rng: np.random.Generator) -> UInt8[np.ndarray, "h w 3"]:
    """A woven rug: borders around a field of lozenges, stripes or plain pile. Does not tile."""
    height, width = 256, 384
    palette = [_pick(rng, "rug") for _ in range(3)]
    y, x = np.mgrid[0:height, 0:width]
    edge = np.minimum(np.minimum(y, height - 1 - y), np.minimum(x, width - 1 - x))
    colour = np.broadcast_to(palette[0], (height, width, 3)).copy()
    kind = int(rng.integers(3))
    if kind == 0:
        step = int(rng.integers(24, 48))
        lozenge = (np.abs((x % step) - step / 2) + np.abs((y % step) - step / 2)) < 0.3 * step
        colour[lozenge] = palette[1]
    elif kind == 1:
        stripes = (x // int(rng.integers(12, 30))) % 3
        colour = np.stack(palette)[stripes]
    border = int(rng.integers(10, 26))
    colour[edge < border] = palette[2]
    colour[edge < border // 3] = palette[0] * 0.8
    pile = periodic_noise(rng, (height, width), (0.8, 0.8)) * 0.06
    return as_picture(colour, 1 + pile)


def landscape(rng: np.random.Generator) -> UInt8[np.ndarray, "h w 3"]:
    """What a window shows: sky, clouds, far hills, trees. Does not tile at its top and bottom."""
    import cv2

    height, width = 256, 384
    y = np.linspace(0, 1, height)[:, None]
    cloud = np.clip(periodic_noise(rng, (height, width), (10, 34)), 0, 2) * 0.25
    veil, white = 1 - cloud, 250 * cloud
    planes = [
        ((1 - y) * zenith + y * horizon) * veil + white for zenith, horizon in ((120, 226), (165, 234), (215, 240))
    ]
    for level, tone, rough in ((0.52, (150, 170, 180), 40), (0.62, (110, 138, 110), 18), (0.74, (74, 104, 62), 5)):
        line = level + 0.05 * periodic_noise(rng, (1, width), (1, rough))[0]
        texture = 1 + 0.10 * periodic_noise(rng, (height, width), (2, 3))
        below = y >= line[None]
        for plane, part in zip(planes, tone, strict=True):
            np.multiply(texture, part, out=plane, where=below)
    return as_picture(cv2.merge(planes))


def painting(rng: np.random.Generator) -> UInt8[np.ndarray, "h w 3"]:
    """A picture for a wall: a landscape, colour fields or soft shapes."""
    kind = int(rng.integers(3))
    if kind == 0:
        return landscape(rng)
    height, width = 192, 192
    y, x = np.mgrid[0:height, 0:width] / height
    colour = np.broadcast_to(rng.uniform(150, 240, 3), (height, width, 3)).copy()
    for _ in range(int(rng.integers(3, 8))):
        tone = rng.uniform(20, 235, 3)
        cx, cy, sx, sy = *rng.uniform(0.1, 0.9, 2), *rng.uniform(0.08, 0.4, 2)
        if kind == 1:
            inside = (np.abs(x - cx) < sx) & (np.abs(y - cy) < sy)
        else:
            inside = ((x - cx) / sx) ** 2 + ((y - cy) / sy) ** 2 < 1
        colour[inside] = tone
    brush = 1 + periodic_noise(rng, (height, width), (1, 4)) * 0.04
    return as_picture(colour, brush)
