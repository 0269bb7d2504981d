"""Small pictures of an episode's views with the masks of its labels, for the cameras of the viewer."""

from collections.abc import Mapping
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import UInt8

from labeling.inspection.colouring import Rgb
from labeling.io.labelled_views import LabelledView, labelled_views

WIDTH_PX = 320
OPACITY = 0.5
"""Of a mask over its picture."""
_UNKNOWN: Rgb = (0.6, 0.6, 0.6)

Thumbnail = UInt8[np.ndarray, "h w 3"]


def thumbnails(labels: Path, episode: str, colours: Mapping[int, Rgb]) -> dict[int, tuple[Thumbnail, Thumbnail]]:
    """By view the picture, and the picture under the masks of its labels; at most ``WIDTH_PX`` wide.

    Args:
        labels: folder of the label set.
        episode: which of its episodes.
        colours: of objects, by instance id; others are grey.

    Raises:
        SbmError: if the label set or the recording cannot be read.
    """
    found = {}
    for view in labelled_views(labels, only=episode):
        found[view.index] = tuple(_small(picture) for picture in (view.rgb, _masked(view, colours)))
    return found


def _masked(view: LabelledView, colours: Mapping[int, Rgb]) -> UInt8[np.ndarray, "h w 3"]:
    shown = view.rgb.astype(float)
    for label in view.labels:
        colour = 255 * np.array(colours.get(label.instance_id, _UNKNOWN))
        shown[label.mask] = (1 - OPACITY) * view.rgb[label.mask] + OPACITY * colour
    return np.rint(shown).astype(np.uint8)


def _small(picture: UInt8[np.ndarray, "h w 3"]) -> Thumbnail:
    height_px, width_px = picture.shape[:2]
    if width_px <= WIDTH_PX:
        return picture
    size = (WIDTH_PX, max(1, round(height_px * WIDTH_PX / width_px)))
    return cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
