"""Runs somebody's Python function as the detector: ``package.module:function``."""

import hashlib
import importlib
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import UInt8

from labeling.episodes import Episode
from labeling.errors import SbmError, UsageError
from labeling.instances import Detection


class DetectorError(SbmError):
    """A detector given by name failed, or returned something else than masks."""


def run_detector(name: str, episode: Episode) -> tuple[Detection, ...]:
    """Calls a detector on every view.

    Args:
        name: ``package.module:function``. The function takes a picture (h, w, 3; uint8; RGB) and returns a list of
            (category, confidence in [0, 1], mask of h x w).
        episode: the views.

    Raises:
        UsageError: if there is no such function.
        DetectorError: naming the view, if it fails or returns something else.
    """
    function = load_function(name)
    detections = []
    for view, rgb in enumerate(episode.rgb):
        where = f"detector {name} on {episode.file_names[view]} of {episode.name}"
        try:
            # A copy: what the function does to its picture stays its own affair.
            found = function(rgb.copy())
            found = list(found) if isinstance(found, Iterable) else found
        except SbmError:
            raise
        except Exception as error:
            raise DetectorError(f"{where}: {type(error).__name__}: {_first_line(error)}") from error
        if not isinstance(found, list):
            raise DetectorError(
                f"{where}: must return a list of (category, confidence, mask), not {type(found).__name__}"
            )
        detections.extend(_detection(item, view, rgb, where) for item in found)
    return tuple(detections)


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
            f"--detector {name}: cannot be imported ({type(error).__name__}: {_first_line(error)})"
        ) from error
    if not callable(target):
        raise UsageError(f"--detector {name}: is a {type(target).__name__}, which cannot be called")
    return target


def code_digest(name: str) -> str:
    """Changes with the file that the detector is written in (not with the files it imports)."""
    load_function(name)
    file = getattr(sys.modules[name.partition(":")[0]], "__file__", None)
    return hashlib.sha256(Path(file).read_bytes()).hexdigest() if file else ""


def _detection(item: Any, view: int, rgb: UInt8[np.ndarray, "h w 3"], where: str) -> Detection:
    if not isinstance(item, tuple | list) or len(item) != 3:
        raise DetectorError(f"{where}: each detection is (category, confidence, mask), not {type(item).__name__}")
    category, confidence, mask = item
    if not isinstance(category, str) or not category:
        raise DetectorError(f"{where}: a category is a name, not {category!r}")
    try:
        score, pixels = float(confidence), np.asarray(mask)
    except (TypeError, ValueError):
        raise DetectorError(f"{where}: confidence and mask of {category!r} must be a number and an array") from None
    if not 0.0 <= score <= 1.0:
        raise DetectorError(f"{where}: the confidence of {category!r} is {score:g}, not in [0, 1]")
    if pixels.shape != rgb.shape[:2] or pixels.dtype.kind not in "bui":
        raise DetectorError(
            f"{where}: the mask of {category!r} is {pixels.dtype} {pixels.shape}; expected bool {rgb.shape[:2]}"
        )
    return Detection(view, category, score, pixels.astype(bool))


def _first_line(error: BaseException) -> str:
    return (str(error).strip().splitlines() or ["no message"])[0]
