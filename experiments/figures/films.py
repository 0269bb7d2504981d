"""What films of episodes show: the view of the robot's camera with what the detector says about it."""

from collections.abc import Sequence
from typing import Any

import cv2
import gymnasium as gym
import numpy as np
from jaxtyping import UInt8

from labeling.core.types import CONFIDENT, Detection
from labeling.inspection.titles import write_title

SHOWN = 0.5
"""Detections below this confidence are left out: networks offer many."""
SURE, UNSURE = (60, 200, 80), (240, 190, 60)
"""Colours of outlines: of confident detections, and of others."""
TITLE_SIZE = 0.36


class DetectionsDrawn(gym.Wrapper):
    """Draws the detections of the last view into what ``render`` returns, in mode "rgb_array"."""

    def __init__(self, env: gym.Env) -> None:
        super().__init__(env)
        self._detections: Sequence[Detection] = ()

    def reset(self, **options: Any) -> tuple[Any, dict[str, Any]]:
        """See ``gymnasium.Env``."""
        observation, info = self.env.reset(**options)
        self._detections = info["detections"]
        return observation, info

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """See ``gymnasium.Env``."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        self._detections = info["detections"]
        return observation, reward, terminated, truncated, info

    def render(self) -> Any:
        """The view, with outlines and titles."""
        picture = self.env.render()
        assert isinstance(picture, np.ndarray)
        return with_detections(picture, self._detections)


def with_detections(rgb: UInt8[np.ndarray, "h w 3"], detections: Sequence[Detection]) -> UInt8[np.ndarray, "h w 3"]:
    """A picture with outlines and titles of the detections of its view, whose masks may be of another size."""
    picture = np.ascontiguousarray(rgb).copy()
    shown = sorted((one for one in detections if one.confidence >= SHOWN), key=lambda one: one.confidence)
    masks = [
        cv2.resize(one.mask.astype(np.uint8), picture.shape[1::-1], interpolation=cv2.INTER_NEAREST) for one in shown
    ]
    for one, mask in zip(shown, masks, strict=True):
        outlines, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        cv2.drawContours(picture, outlines, -1, SURE if one.confidence >= CONFIDENT else UNSURE, 2, cv2.LINE_AA)
    for one, mask in zip(shown, masks, strict=True):  # titles last, so that no outline crosses them
        rows, columns = np.nonzero(mask)
        if len(rows):
            write_title(
                picture,
                f"{one.category} {one.confidence:.2f}",
                (float(columns.mean()), float(rows.min() - 6)),
                TITLE_SIZE,
            )
    return picture
