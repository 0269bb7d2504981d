"""A user's Python function as a detector: ``package.module:function``."""

import hashlib
import importlib
import inspect
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float32, UInt8

from labeling.core.box_masks import mask_in_box
from labeling.core.detector import DetectorError, PictureDetections, stack_detections
from labeling.core.errors import SbmError, UsageError

DEPTH = "depth_m"
"""Parameter by which a function asks for depth."""


class FunctionDetector:
    """Calls a function that takes a picture (h, w, 3; uint8; RGB) and returns a list of (category, confidence in
    [0, 1], what shows the object): its mask (h, w), or its box (left, top, right, bottom in pixels).

    A function with a parameter ``depth_m`` gets the z-depth, too (h, w; float32; metres; 0 = no return), None where
    pictures have none.
    """

    categories = None
    batch_size = 1

    def __init__(self, name: str) -> None:
        self.name = name
        self._function = load_function(name)
        self._wants_depth = _has_parameter(self._function, DEPTH)

    @property
    def digest(self) -> str:
        """Changes with the file that the function is written in (not with the files it imports)."""
        file = getattr(sys.modules[self.name.partition(":")[0]], "__file__", None)
        return hashlib.sha256(Path(file).read_bytes()).hexdigest() if file else ""

    def detect(
        self, rgb: UInt8[np.ndarray, "b h w 3"], depth_m: Float32[np.ndarray, "b h w"] | None = None
    ) -> list[PictureDetections]:
        """See ``labeling.core.detector.Detector``."""
        return [self._detect_one(one, None if depth_m is None else depth_m[i]) for i, one in enumerate(rgb)]

    def _detect_one(
        self, picture: UInt8[np.ndarray, "h w 3"], depth_m: Float32[np.ndarray, "h w"] | None
    ) -> PictureDetections:
        try:
            # Copies: what the function does to its picture stays its own affair.
            more = {DEPTH: None if depth_m is None else depth_m.copy()} if self._wants_depth else {}
            found = self._function(picture.copy(), **more)
            found = list(found) if isinstance(found, Iterable) else found
        except SbmError:
            raise
        except Exception as error:
            raise DetectorError(f"{type(error).__name__}: {first_line(error)}") from error
        if not isinstance(found, list):
            raise DetectorError(
                f"must return a list of (category, confidence, mask or box), not {type(found).__name__}"
            )
        size = (int(picture.shape[0]), int(picture.shape[1]))
        checked = [_checked(item, size) for item in found]
        boxes = {i: shown for i, (_, _, shown) in enumerate(checked) if shown.ndim == 1}
        masks = [mask_in_box(picture, shown, depth_m) if i in boxes else shown for i, (*_, shown) in enumerate(checked)]
        named = [(category, score, mask) for (category, score, _), mask in zip(checked, masks, strict=True)]
        return stack_detections(named, size, boxes)


def load_function(name: str) -> Callable[[UInt8[np.ndarray, "h w 3"]], Any]:
    """The function that ``package.module:function`` names; the working directory is searched too.

    Raises:
        UsageError: if it cannot be imported or called.
    """
    module_name, _, function_name = name.partition(":")
    if not module_name or not function_name:
        raise UsageError(f"--detector {name}: give package.module:function")
    here = str(Path.cwd())
    if here not in sys.path and "" not in sys.path:
        sys.path.append(here)
    try:
        target: Any = importlib.import_module(module_name)
        for part in function_name.split("."):
            target = getattr(target, part)
    except Exception as error:
        raise UsageError(
            f"--detector {name}: cannot be imported ({type(error).__name__}: {first_line(error)})"
        ) from error
    if not callable(target):
        raise UsageError(f"--detector {name}: is a {type(target).__name__}, which cannot be called")
    return target


def _has_parameter(function: Callable[..., Any], name: str) -> bool:
    try:
        return name in inspect.signature(function).parameters
    except (TypeError, ValueError):  # compiled code that does not tell
        return False


def _checked(item: Any, size: tuple[int, int]) -> tuple[str, float, np.ndarray]:
    """Category, score, and mask (h, w; bool) or box (4; float32)."""
    if not isinstance(item, tuple | list) or len(item) != 3:
        raise DetectorError(f"each detection is (category, confidence, mask or box), not {type(item).__name__}")
    category, confidence, shown = item
    if not isinstance(category, str) or not category:
        raise DetectorError(f"a category is a name, not {category!r}")
    try:
        score, pixels = float(confidence), np.asarray(shown)
    except (TypeError, ValueError):
        raise DetectorError(f"confidence and mask or box of {category!r} must be a number and an array") from None
    if not 0.0 <= score <= 1.0:
        raise DetectorError(f"the confidence of {category!r} is {score:g}, not in [0, 1]")
    if pixels.shape == (4,) and pixels.dtype.kind in "uif":
        if not (np.isfinite(pixels).all() and (pixels[2:] > pixels[:2]).all()):
            raise DetectorError(f"the box of {category!r} is {pixels.tolist()}, not left, top, right, bottom in pixels")
        return category, score, pixels.astype(np.float32)
    if pixels.shape != size or pixels.dtype.kind not in "bui":
        raise DetectorError(
            f"the mask of {category!r} is {pixels.dtype} {pixels.shape}; expected bool {size}, or a box: 4 numbers"
        )
    return category, score, pixels.astype(bool)


def first_line(error: BaseException) -> str:
    """What an error says, in one line."""
    return (str(error).strip().splitlines() or ["no message"])[0]
