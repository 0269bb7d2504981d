"""Pictures of a report: small JPEGs of the views, and outlines of masks as SVG paths with tags."""

import base64
import functools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from jaxtyping import Bool, UInt8

if TYPE_CHECKING:
    from jinja2 import Template
    from markupsafe import Markup

THUMBNAIL_AREA_PX = 320 * 240
THUMBNAIL_WIDTH_PX = 480
JPEG_QUALITY = 82

PALETTE = (
    "#e6194b", "#0072b2", "#f58231", "#2a9d3a", "#911eb4", "#b8860b", "#00a2a2", "#d81b9c",
    "#5b5bd6", "#8c4a2f", "#6a9a00", "#c2185b", "#007a5e", "#4a6fa5", "#a0522d", "#7a4fbf",
)  # fmt: skip
"""Colours of objects: told apart on photographs, dark enough to carry white text."""

UNMATCHED = "#3c4043"
"""Colour of predictions that overlap no object of their category."""

TAG_FONT_PX = 9.5
TAG_HEIGHT_PX = 13.0
MAX_TAG_LETTERS = 22


@dataclass(frozen=True)
class Overlay:
    """One mask to draw over a view."""

    mask: Bool[np.ndarray, "h w"]
    colour: str
    tag: str
    tooltip: str
    dashed: bool = False
    """For what does not count: predictions without a partner, ignored ground truth."""
    category: str = ""
    """The reader can ask for one alone, as for what follows."""
    kind: str = "truth"
    """Of predictions their kind (``labeling.evaluation.report.errors.KINDS``), of ground truth "truth" or "missed"."""
    confidence: float = 1.0


@functools.cache
def template(name: str) -> "Template":
    """A Jinja2 template of the folder ``templates``; what is put into it is escaped unless it is markup."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    loader = FileSystemLoader(Path(__file__).with_name("templates"))
    return Environment(loader=loader, autoescape=True, undefined=StrictUndefined).get_template(name)


def thumbnail_size(height_px: int, width_px: int) -> tuple[int, int]:
    """Height and width of a view's thumbnail; never larger than the view."""
    scale = min(1.0, (THUMBNAIL_AREA_PX / (height_px * width_px)) ** 0.5, THUMBNAIL_WIDTH_PX / width_px)
    return max(1, round(height_px * scale)), max(1, round(width_px * scale))


def thumbnail(image_id: str, rgb: UInt8[np.ndarray, "h w 3"]) -> dict[str, Any]:
    """A small picture of a view, to stand in an SVG element of this id: its size, and a JPEG as a ``data:`` address."""
    height_px, width_px = thumbnail_size(*rgb.shape[:2])
    small = cv2.resize(rgb, (width_px, height_px), interpolation=cv2.INTER_AREA)
    _, jpeg = cv2.imencode(".jpg", cv2.cvtColor(small, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    data_uri = "data:image/jpeg;base64," + base64.b64encode(jpeg.tobytes()).decode("ascii")
    return {"image_id": image_id, "height_px": height_px, "width_px": width_px, "data_uri": data_uri}


def mask_path(mask: Bool[np.ndarray, "h w"], scale: float) -> str:
    """Outline of a mask, holes included, as SVG path data in thumbnail pixels.

    Outlines are simplified to half a thumbnail pixel; specks below two thumbnail pixels are left out, unless the mask
    has nothing larger.
    """
    contours, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_SIMPLE)
    smallest = 2.0 / scale**2
    large = [contour for contour in contours if cv2.contourArea(contour) >= smallest]
    parts = []
    for contour in large or sorted(contours, key=len)[-1:]:
        points = (cv2.approxPolyDP(contour, 0.5 / scale, True).reshape(-1, 2) + 0.5) * scale
        parts.append("M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in points.tolist()) + "Z")
    return "".join(parts)


def panel(image_id: str, size: tuple[int, int], overlays: Sequence[Overlay], name: str) -> "Markup":
    """One view with masks over it, as an SVG element.

    Args:
        image_id: id of the element that holds the view's thumbnail.
        size: the view's height and width in pixels.
        overlays: what to draw.
        name: says what the panel shows, for readers who do not see it.
    """
    from markupsafe import Markup

    height_px, width_px = thumbnail_size(*size)
    scale = width_px / size[1]
    # Large masks first, so that a small object on a large one stays visible and its tooltip within reach.
    drawn = [overlay for overlay in overlays if overlay.mask.any()]
    drawn.sort(key=lambda overlay: -np.count_nonzero(overlay.mask))
    return Markup(
        template("panel.svg.jinja").render(
            image_id=image_id,
            name=name,
            height_px=height_px,
            width_px=width_px,
            scale=scale,
            outline=mask_path,
            overlays=drawn,
            tags=_tags(drawn, scale, height_px, width_px),
        )
    )


@dataclass(frozen=True)
class _Tag:
    """A name tag; lengths in thumbnail pixels."""

    x: float
    y: float
    width: float
    colour: str
    text: str
    overlay: Overlay
    height: str = f"{TAG_HEIGHT_PX:g}"
    font_px: str = f"{TAG_FONT_PX:g}"


def _tags(overlays: Sequence[Overlay], scale: float, height_px: int, width_px: int) -> list[_Tag]:
    """Name tags above the masks' upper left corners, moved where they would cover another tag."""
    tags: list[_Tag] = []
    for overlay in sorted(overlays, key=lambda item: int(np.argmax(item.mask.any(axis=1)))):
        text = shorten(overlay.tag, MAX_TAG_LETTERS)
        width = min(width_px - 2.0, len(text) * TAG_FONT_PX * 0.6 + 6.0)
        x = min(max(1.0, float(np.argmax(overlay.mask.any(axis=0))) * scale), width_px - width - 1.0)
        above = float(np.argmax(overlay.mask.any(axis=1))) * scale - TAG_HEIGHT_PX - 1.0
        y = min(max(1.0, above), height_px - TAG_HEIGHT_PX - 1.0)
        tags.append(_Tag(x, _free_height(x, y, width, tags, height_px), width, overlay.colour, text, overlay))
    return tags


def _free_height(x: float, y: float, width: float, placed: Sequence[_Tag], height_px: int) -> float:
    """The first height from y down, then from y up, at which a tag covers no other; y if there is none."""
    step = TAG_HEIGHT_PX + 1.0
    count = int(height_px // step)
    for offset in [*range(count), *(-up for up in range(1, count))]:
        tried = y + offset * step
        if not 0 <= tried <= height_px - TAG_HEIGHT_PX:
            continue
        if all(
            abs(tried - other.y) >= TAG_HEIGHT_PX or x >= other.x + other.width or other.x >= x + width
            for other in placed
        ):
            return tried
    return y


def shorten(text: str, most: int) -> str:
    """The text, with its middle left out where it is longer than ``most`` letters."""
    if len(text) <= most:
        return text
    tail = (most - 1) // 2
    return text[: most - 1 - tail] + "…" + text[len(text) - tail :]
