"""Titles in pictures: text on a plate, so that it can be read on whatever lies below."""

import cv2
from jaxtyping import UInt8
from numpy import clip, ndarray

FONT = cv2.FONT_HERSHEY_SIMPLEX
Colour = tuple[int, int, int]
PLATE: Colour = (30, 30, 30)
INK: Colour = (255, 255, 255)


def write_title(
    picture: UInt8[ndarray, "h w 3"],
    text: str,
    centre: tuple[float, float],
    size: float = 0.42,
    plate: Colour = PLATE,
    ink: Colour = INK,
) -> None:
    """Writes a title into a picture, which it never leaves.

    Args:
        picture: to write into.
        text: characters beyond ASCII, which OpenCV's fonts may not have, become question marks.
        centre: x and y of the middle of the text, pixels.
        size: of letters; 1 is about 22 pixels high.
        plate: colour below the text.
        ink: colour of the text.
    """
    text = text.encode("ascii", "replace").decode()
    (width, height), base = cv2.getTextSize(text, FONT, size, 1)
    left = int(clip(centre[0] - width / 2, 3, max(3, picture.shape[1] - width - 3)))
    low = int(clip(centre[1] + height / 2, height + 3, max(height + 3, picture.shape[0] - base - 2)))
    cv2.rectangle(picture, (left - 3, low - height - 3), (left + width + 2, low + base), plate, -1)
    cv2.putText(picture, text, (left, low), FONT, size, ink, 1, cv2.LINE_AA)
