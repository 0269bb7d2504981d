"""Binary PLY of a segmented cloud, as viewers such as MeshLab, CloudCompare and Open3D read it."""

import re
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from labeling.formats.atomic import atomic_file
from labeling.formats.regular_file import regular

MAX_HEADER = 65536
"""Bytes that are searched for the header's end."""
_COLOUR = [(channel, "u1") for channel in ("red", "green", "blue")]


def _vertex(position: str) -> np.dtype:
    """A point of a file, with coordinates of this type."""
    return np.dtype([*((axis, position) for axis in "xyz"), *_COLOUR, ("label", "<i4"), ("probability", "<f4")])


def write_ply(
    path: Path,
    points: Float[np.ndarray, "n 3"],
    colours: Float[np.ndarray, "n 3"],
    labels: Int[np.ndarray, "n"],
    probability: Float[np.ndarray, "n"],
    tint: float = 0.6,
) -> None:
    """Writes a cloud whose objects are tinted, one hue each, over their true colour.

    Args:
        path: file to write, atomically.
        points: world points, metres; written with 64 bits if they have as many, else with 32.
        colours: true colour in [0, 1].
        labels: object of each point (property ``label``), 0 for none.
        probability: of that label (property ``probability``).
        tint: share of the object's hue in the colour.
    """
    from plyfile import PlyData, PlyElement

    vertices = np.empty(len(points), _vertex("<f8" if points.dtype == np.float64 else "<f4"))
    vertices["x"], vertices["y"], vertices["z"] = points.T
    shown = np.where((labels > 0)[:, None], (1 - tint) * colours + tint * hues(labels), colours)
    vertices["red"], vertices["green"], vertices["blue"] = np.rint(255 * np.clip(shown, 0, 1)).astype(np.uint8).T
    vertices["label"], vertices["probability"] = labels, probability
    with atomic_file(path) as temporary:
        PlyData([PlyElement.describe(vertices, "vertex")], byte_order="<").write(str(temporary))


def read_ply(path: Path) -> np.ndarray:
    """Reads the points of a segmented cloud as a structured array, one field per property.

    Raises:
        ValueError: if the file is no PLY with the properties of ``write_ply``, or is truncated.
        OSError: if it is a pipe or a device, or cannot be read.
    """
    from plyfile import PlyData, PlyParseError

    _check_counts(path)
    try:
        vertices = PlyData.read(str(regular(path)))["vertex"].data
    except (PlyParseError, KeyError, UnicodeDecodeError) as error:
        problem = "truncated" if "end-of-file" in str(error) else "not a PLY of points"
        raise ValueError(f"{path}: {problem} ({error})") from None
    missing = [name for name in _vertex("<f4").names or () if name not in (vertices.dtype.names or ())]
    if missing:
        raise ValueError(
            f"{path}: its points have no {', '.join(missing)}; expected the segmented cloud of a label set"
        )
    return vertices


def _check_counts(path: Path) -> None:
    """Refuses, before memory is taken for them, more points than the file has bytes.

    Raises:
        ValueError: if the header states so many.
        OSError: if the file cannot be read.
    """
    with regular(path).open("rb") as file:
        header = file.read(MAX_HEADER).split(b"end_header")[0]
    size = path.stat().st_size
    for stated in re.findall(rb"^element\s+\S+\s+(\d+)", header, re.MULTILINE):
        if len(stated) > 18 or int(stated) > size:
            raise ValueError(f"{path}: truncated (its header states {stated[:20].decode()} points, in {size} bytes)")


def hues(labels: Int[np.ndarray, "n"]) -> Float[np.ndarray, "n 3"]:
    """A saturated colour for each label; neighbouring numbers get hues a golden ratio of the circle apart."""
    hue = np.mod(np.asarray(labels) * 0.61803398875, 1.0)
    return np.clip(np.abs(np.mod(hue[:, None] * 6 + np.array([0.0, 4.0, 2.0]), 6) - 3) - 1, 0, 1)
