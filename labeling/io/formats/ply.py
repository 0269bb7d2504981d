"""Binary PLY of a segmented cloud, as viewers such as MeshLab, CloudCompare and Open3D read it."""

from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from labeling.io.formats.atomic import atomic_file

_VERTEX = np.dtype(
    [
        ("x", "<f4"),
        ("y", "<f4"),
        ("z", "<f4"),
        ("red", "u1"),
        ("green", "u1"),
        ("blue", "u1"),
        ("label", "<i4"),
        ("probability", "<f4"),
    ]
)
_PLY_TYPE = {"f4": "float", "u1": "uchar", "i4": "int"}


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
        points: world points, metres.
        colours: true colour in [0, 1].
        labels: object of each point (property ``label``), 0 for none.
        probability: of that label (property ``probability``).
        tint: share of the object's hue in the colour.
    """
    vertices = np.empty(len(points), _VERTEX)
    vertices["x"], vertices["y"], vertices["z"] = np.asarray(points, np.float32).T
    shown = np.where((labels > 0)[:, None], (1 - tint) * colours + tint * hues(labels), colours)
    red, green, blue = np.rint(255 * np.clip(shown, 0, 1)).astype(np.uint8).T
    vertices["red"], vertices["green"], vertices["blue"] = red, green, blue
    vertices["label"], vertices["probability"] = labels, probability
    properties = [f"property {_PLY_TYPE[_VERTEX[name].str[1:]]} {name}" for name in _VERTEX.names or ()]
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(points)}", *properties, "end_header"]
    with atomic_file(path) as temporary:
        temporary.write_bytes(("\n".join(header) + "\n").encode("ascii") + vertices.tobytes())


def read_ply(path: Path) -> np.ndarray:
    """Reads back a file of ``write_ply`` as a structured array, one field per property.

    Raises:
        ValueError: if the file is not one that ``write_ply`` wrote.
    """
    content = path.read_bytes()
    end = content.find(b"end_header\n")
    if not content.startswith(b"ply\nformat binary_little_endian 1.0\n") or end < 0:
        raise ValueError(f"{path}: not a binary PLY of this project")
    body = content[end + len(b"end_header\n") :]
    if len(body) % _VERTEX.itemsize:
        raise ValueError(f"{path}: the PLY is truncated")
    return np.frombuffer(body, _VERTEX)


def hues(labels: Int[np.ndarray, "n"]) -> Float[np.ndarray, "n 3"]:
    """A saturated colour for each label; neighbouring numbers get hues a golden ratio of the circle apart."""
    hue = np.mod(np.asarray(labels) * 0.61803398875, 1.0)
    return np.clip(np.abs(np.mod(hue[:, None] * 6 + np.array([0.0, 4.0, 2.0]), 6) - 3) - 1, 0, 1)
