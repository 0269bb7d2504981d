"""Somebody's Python function as a detector: ``package.module:function``."""

import hashlib
import importlib
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float32, UInt8

from labeling.core.detector import DetectorError, PictureDetections, stack_detections
from labeling.core.errors import SbmError, UsageError


class FunctionDetector:
    """Calls a function that takes a picture (h, w, 3; uint8; RGB) and returns a list of (category, confidence in
    [0, 1], mask of h x w).
    """

    categories = None
    batch_size = 1

    def __init__(self, name: str) -> None:
        self.name = name
        self._function = load_function(name)

    @property
    def digest(self) -> str:
        """Changes with the file that the function is written in (not with the files it imports)."""
        file = getattr(sys.modules[self.name.partition(":")[0]], "__file__", None)
        return hashlib.sha256(Path(file).read_bytes()).hexdigest() if file else ""

    def detect(
        self, rgb: UInt8[np.ndarray, "b h w 3"], depth_m: Float32[np.ndarray, "b h w"] | None = None
    ) -> list[PictureDetections]:
        """See ``labeling.core.detector.Detector``; depth is not passed on."""
        return [self._detect_one(picture) for picture in rgb]

    def _detect_one(self, picture: UInt8[np.ndarray, "h w 3"]) -> PictureDetections:
        try:
            # A copy: what the function does to its picture stays its own affair.
            found = self._function(picture.copy())
            found = list(found) if isinstance(found, Iterable) else found
        except SbmError:
            raise
        except Exception as error:
            raise DetectorError(f"{type(error).__name__}: {first_line(error)}") from error
        if not isinstance(found, list):
            raise DetectorError(f"must return a list of (category, confidence, mask), not {type(found).__name__}")
        size = (int(picture.shape[0]), int(picture.shape[1]))
        return stack_detections([_checked(item, size) for item in found], size)


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


def _checked(item: Any, size: tuple[int, int]) -> tuple[str, float, np.ndarray]:
    if not isinstance(item, tuple | list) or len(item) != 3:
        raise DetectorError(f"each detection is (category, confidence, mask), not {type(item).__name__}")
    category, confidence, mask = item
    if not isinstance(category, str) or not category:
        raise DetectorError(f"a category is a name, not {category!r}")
    try:
        score, pixels = float(confidence), np.asarray(mask)
    except (TypeError, ValueError):
        raise DetectorError(f"confidence and mask of {category!r} must be a number and an array") from None
    if not 0.0 <= score <= 1.0:
        raise DetectorError(f"the confidence of {category!r} is {score:g}, not in [0, 1]")
    if pixels.shape != size or pixels.dtype.kind not in "bui":
        raise DetectorError(f"the mask of {category!r} is {pixels.dtype} {pixels.shape}; expected bool {size}")
    return category, score, pixels.astype(bool)


def first_line(error: BaseException) -> str:
    """What an error says, in one line."""
    return (str(error).strip().splitlines() or ["no message"])[0]
