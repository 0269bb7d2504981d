"""Pictures of shops: what stands in their windows, by trade, the boards over them, their awnings."""

import functools
import tomllib
import zlib
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from sbm_gym.assets.models.surfaces import periodic_noise
from sbm_gym.worlds.towns.materials import Colour

Canvas = Float[np.ndarray, "h w 3"]
_TABLES = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
SHOPS: dict[str, dict[str, Any]] = _TABLES["shops"]
"""What is written over shops, and how they look."""
HEIGHT_PX, WIDTH_PX = 192, 768
WINDOW_M = 9.0
"""Width of the room that a picture of a shop shows; its panes show one part after the other."""


def _rng(name: str) -> np.random.Generator:
    return np.random.default_rng((8, zlib.crc32(name.encode())))


@functools.cache
def shop_window(trade: str) -> UInt8[np.ndarray, "h w 3"]:
    """A shop seen through its windows, with the street's reflection in them.

    Args:
        trade: one of ``SHOPS``.
    """
    rng = _rng(trade)
    shop, lamps = SHOPS[trade], SHOPS[trade]["lamps"]
    picture = np.full((HEIGHT_PX, WIDTH_PX, 3), shop["wall"], np.float64)
    y = np.linspace(0.0, 1.0, HEIGHT_PX)[:, None, None]
    picture *= 1.15 - 0.55 * y
    picture[int(0.86 * HEIGHT_PX) :] = np.array((74.0, 66.0, 58.0))
    WINDOWS[shop["window"]](picture, rng)
    across = np.arange(WIDTH_PX)[None] / WIDTH_PX
    for lamp in (np.arange(lamps) + 0.5) / max(lamps, 1):
        glow = np.exp(-(((across - lamp) / 0.018) ** 2 + ((y[..., 0] - 0.07) / 0.06) ** 2))
        picture += glow[..., None] * np.array([170.0, 150.0, 110.0])
    mirror = np.clip(1.2 * periodic_noise(rng, picture.shape[:2], (40, 12)), 0, 1.5)[..., None]
    picture = picture * 0.88 + np.array([120.0, 134.0, 150.0]) * (0.06 + 0.09 * mirror)
    return np.clip(np.rint(picture), 0, 255).astype(np.uint8)


def _box(picture: Canvas, x: float, y: float, wide: float, tall: float, colour) -> None:
    """A rectangle from its upper left corner, clipped to the picture."""
    left, top = max(int(x), 0), max(int(y), 0)
    picture[top : max(int(y + tall), 0), left : max(int(x + wide), 0)] = np.asarray(colour, float)


def _disc(picture: Canvas, x: float, y: float, rx: float, ry: float, colour) -> None:
    shade = tuple(float(c) for c in np.asarray(colour, float))
    cv2.ellipse(picture, ((float(x), float(y)), (2.0 * rx, 2.0 * ry), 0.0), shade, -1)
    light = tuple(min(1.25 * c, 255.0) for c in shade)
    cv2.ellipse(picture, ((x - 0.2 * rx, y - 0.3 * ry), (0.9 * rx, 0.7 * ry), 0.0), light, -1)


def _thing(picture: Canvas, x: float, name: str) -> None:
    """A thing of ``shops.toml``."""
    for part in _TABLES["things"][name]:
        draw, (right, down, wide, tall) = (_box, part["box"]) if "box" in part else (_disc, part["disc"])
        draw(picture, x + right, down, wide, tall, part["rgb"])


def _shelves(picture: Canvas, levels: tuple[float, ...], colour: Colour = (104, 88, 70)) -> list[int]:
    """Boards across the picture; returns the rows on which things stand."""
    rows = [int(level * HEIGHT_PX) for level in levels]
    for row in rows:
        _box(picture, 0, row, WIDTH_PX, 5, colour)
        picture[row + 5 : row + 9] *= 0.7
    return rows


def _books(picture: Canvas, rng: np.random.Generator) -> None:
    for row in _shelves(picture, (0.3, 0.5, 0.7, 0.9)):
        at = 3.0
        while at < WIDTH_PX:
            wide, tall = rng.uniform(3, 9), rng.uniform(20, 31)
            tone = rng.uniform(40, 190, 3)
            _box(picture, at, row - tall, wide, tall, tone)
            _box(picture, at, row - 0.75 * tall, wide, 3, tone * 0.5 + 110)
            at += wide + (rng.uniform(8, 26) if rng.random() < 0.06 else 1.0)


def _bread(picture: Canvas, rng: np.random.Generator) -> None:
    for row in _shelves(picture, (0.42, 0.66, 0.9), (150, 118, 80)):
        at = 12.0
        while at < WIDTH_PX:
            rx = rng.uniform(9, 19)
            tone = np.array([198.0, 142.0, 76.0]) * rng.uniform(0.75, 1.15)
            for _ in range(int(rng.integers(2, 6))):
                _disc(picture, at, row - 7, rx, 8, tone)
                at += 1.7 * rx
            at += rng.uniform(8, 30)


def _tables(picture: Canvas, rng: np.random.Generator) -> None:
    for at in np.arange(30, WIDTH_PX, 96) + rng.uniform(-10, 10, 8):
        _thing(picture, at, "cafe_table")
    for at in rng.uniform(0, WIDTH_PX, 5):
        _box(picture, at, 66, rng.uniform(30, 60), 34, rng.uniform(70, 150, 3))


def _boxes(picture: Canvas, rng: np.random.Generator) -> None:
    for row in _shelves(picture, (0.28, 0.46, 0.64, 0.82), (206, 210, 208)):
        at = 2.0
        while at < WIDTH_PX - 6:
            wide, tall = rng.uniform(8, 16), rng.uniform(12, 24)
            tone = np.array([226.0, 230.0, 230.0]) * rng.uniform(0.85, 1.0)
            for _ in range(int(rng.integers(2, 5))):
                _box(picture, at, row - tall, wide, tall, tone)
                _box(picture, at, row - 0.6 * tall, wide, 4, _vivid(rng) if rng.random() < 0.4 else (70, 150, 120))
                at += wide + 1
            at += rng.uniform(2, 12)
    for at in (190, 570):
        _thing(picture, at, "cross")


def _vivid(rng: np.random.Generator) -> np.ndarray:
    tones = ((214, 60, 70), (236, 170, 50), (230, 110, 160), (150, 90, 190), (244, 236, 220), (240, 120, 60))
    return np.array(tones[int(rng.integers(len(tones)))], float)


def _bouquets(picture: Canvas, rng: np.random.Generator) -> None:
    for depth, row in enumerate((96, 136, 176)):
        for at in np.arange(10 + 12 * depth, WIDTH_PX, 36) + rng.uniform(
            -6, 6, len(np.arange(10 + 12 * depth, 768, 36))
        ):
            _box(picture, at - 10, row - 14, 20, 26, np.array([120.0, 116.0, 110.0]) * rng.uniform(0.6, 1.2))
            tone = _vivid(rng)
            for _ in range(16):
                x, y = at + rng.normal(0, 9), row - 26 + rng.normal(0, 8)
                _disc(picture, x, y, 4.0, 4.0, (56, 104, 50) if rng.random() < 0.45 else tone * rng.uniform(0.8, 1.1))


def _crates(picture: Canvas, rng: np.random.Generator) -> None:
    fruit = ((204, 50, 40), (236, 150, 40), (90, 150, 50), (226, 200, 70), (120, 60, 110), (176, 110, 60))
    for depth, row in enumerate((92, 134, 176)):
        for at in range(-20 + 14 * depth, WIDTH_PX, 62):
            tone = np.array(fruit[int(rng.integers(len(fruit)))], float)
            for _ in range(46):
                x, y = at + rng.uniform(4, 54), row - 8 - rng.uniform(0, 16)
                _disc(picture, x, y, 4.2, 4.2, tone * rng.uniform(0.8, 1.1))
            _box(picture, at, row - 8, 58, 18, (158, 122, 78))
            _box(picture, at, row, 58, 2, (110, 82, 52))


def _clothes(picture: Canvas, rng: np.random.Generator) -> None:
    _box(picture, 0, 34, WIDTH_PX, 3, (150, 150, 152))
    for at in range(8, WIDTH_PX, 9):
        if rng.random() < 0.75:
            _box(picture, at, 37, 8, rng.uniform(46, 64), rng.uniform(40, 170) * np.array([1.0, 0.95, 0.92]))
    for at in np.arange(50, WIDTH_PX, 110) + rng.uniform(-12, 12, 7):
        tone = rng.uniform(40, 150, 3) + rng.uniform(0, 70)
        outline = np.array(
            [[-16, 62], [-8, 54], [8, 54], [16, 62], [13, 92], [11, 104], [19, 138], [-19, 138], [-11, 104]]
        )
        cv2.fillPoly(picture, [np.round(outline + np.array([at, 0.0])).astype(np.int32)], tuple(float(c) for c in tone))
        _thing(picture, at, "mannequin")


def _mirrors(picture: Canvas, rng: np.random.Generator) -> None:
    for at in range(24, WIDTH_PX, 92):
        _thing(picture, at, "mirror")
        for _ in range(5):
            _box(picture, at + rng.uniform(2, 40), 96, 4, 10, _vivid(rng))
        _thing(picture, at, "barber_chair")


def _blinds(picture: Canvas, rng: np.random.Generator) -> None:
    x = np.arange(WIDTH_PX)
    picture[: int(0.86 * HEIGHT_PX)] = (np.array([176.0, 178.0, 176.0])[None] * (0.8 + 0.2 * ((x % 12) > 2))[:, None])[
        None
    ]
    for at in np.arange(60, WIDTH_PX, 190) + rng.uniform(-20, 20, 4):
        _box(picture, at, 40, 62, 92, (236, 236, 232))
        _box(picture, at, 40, 62, 36, _vivid(rng) * 0.8)
        for row in range(88, 124, 9):
            _box(picture, at + 8, row, rng.uniform(26, 46), 3, (90, 90, 92))


def _glasses(picture: Canvas, rng: np.random.Generator) -> None:
    for row in _shelves(picture, (0.3, 0.48, 0.66, 0.84), (214, 214, 216)):
        for at in range(10, WIDTH_PX, 30):
            tone = tuple(float(c) for c in rng.uniform(20, 110, 3))
            for side in (0, 10):
                cv2.circle(picture, (at + side, row - 8), 5, tone, 2)


_DRAWN = (_bread, _books, _tables, _boxes, _bouquets, _crates, _clothes, _mirrors, _blinds, _glasses)
WINDOWS = {draw.__name__.removeprefix("_"): draw for draw in _DRAWN}
"""What draws each kind of shop window."""


@functools.cache
def fascia(text: str, ground: Colour, ink: Colour) -> UInt8[np.ndarray, "h w 3"]:
    """The board over a shop with its name."""
    picture = np.full((64, 448, 3), ground, np.uint8)
    picture[:4] = picture[-4:] = np.array(ground) * 0.7
    (wide, tall), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_DUPLEX, 1.3, 3)
    at = ((picture.shape[1] - wide) // 2, (picture.shape[0] + tall) // 2)
    cv2.putText(picture, text, at, cv2.FONT_HERSHEY_DUPLEX, 1.3, ink, 3, cv2.LINE_AA)
    return picture


@functools.cache
def awning(colour: Colour) -> UInt8[np.ndarray, "h w 3"]:
    """Striped cloth."""
    stripes = (np.arange(256) // 16) % 2 == 0
    row = np.where(stripes[:, None], np.array(colour), np.array([236, 232, 222]))
    return np.broadcast_to(row, (32, 256, 3)).astype(np.uint8).copy()
