"""Wavefront OBJ and MTL text, read into triangles grouped by material."""

import posixpath
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from labeling.core.errors import SbmError
from sbm_gym.assets.catalog.triangulate import triangulate

MAX_COORDINATE = 1e9
"""Of a model, in its own units; beyond that triangles have no size in numbers of 32 bits."""


class ModelFormatError(SbmError, ValueError):
    """A 3-D model cannot be read; the message names it and what is wrong."""


@dataclass(frozen=True)
class ObjMaterial:
    """One ``newmtl`` of an MTL file."""

    diffuse: tuple[float, float, float] = (0.8, 0.8, 0.8)
    specular: tuple[float, float, float] = (0.0, 0.0, 0.0)
    shininess: float = 0.0
    """Specular exponent ``Ns``, 0 to 1000."""
    alpha: float = 1.0
    texture: str | None = None
    """Path of ``map_Kd`` as the MTL file gives it, relative to that file."""
    illumination: int = 2


@dataclass(frozen=True)
class ObjMesh:
    """Triangles of an OBJ file; every triangle has its own three corners (no sharing)."""

    corners: Float[np.ndarray, "t 3 3"]
    normals: Float[np.ndarray, "t 3 3"]
    texcoords: Float[np.ndarray, "t 3 2"]
    """(u, v) with v upwards; NaN where a triangle has none."""
    material: Int[np.ndarray, "t"]
    """Index into ``material_names``."""
    material_names: tuple[str, ...]
    material_files: tuple[str, ...]
    """The ``mtllib`` files named, relative to the OBJ file."""


def parse_obj(content: bytes, name: str) -> ObjMesh:
    """Reads an OBJ file: polygons of any size, negative indices, normals and texture coordinates where present.

    Missing normals are made from the triangles: flat, or averaged within a smoothing group.

    Args:
        content: the file.
        name: how errors call it.

    Returns:
        Its triangles, in the file's own units and axes.

    Raises:
        ModelFormatError: if there are no faces, or a number is malformed, not finite or out of range.
    """
    values: dict[str, list[str]] = {"v": [], "vt": [], "vn": []}
    counts = {"v": 0, "vt": 0, "vn": 0}
    # Numbers of the faces of one material, smoothing group, number of corners and corner layout.
    faces: dict[tuple[int, int, int, int], list[int]] = defaultdict(list)
    materials: dict[str, int] = {}
    files: list[str] = []
    material, smoothing = 0, 0
    width = {"v": 3, "vt": 2, "vn": 3}
    try:
        for line in content.decode("iso-8859-1").replace("\\\r\n", " ").replace("\\\n", " ").splitlines():
            parts = line.split()
            if not parts:
                continue
            keyword = parts[0]
            if keyword in width:
                numbers = parts[1 : 1 + width[keyword]]
                values[keyword] += numbers if len(numbers) == width[keyword] else _pad(numbers, width[keyword])
                counts[keyword] += 1
            elif keyword == "f" and len(parts) > 3:
                if not materials:
                    materials[""] = 0
                layout, numbers = _corner_numbers(parts[1:], counts)
                faces[(material, smoothing, len(parts) - 1, layout)] += numbers
            elif keyword == "usemtl":
                material = materials.setdefault(line.strip().partition(" ")[2].strip(), len(materials))
            elif keyword == "mtllib":
                files.append(line.strip().partition(" ")[2].strip())
            elif keyword == "s":
                smoothing = 0 if parts[1:2] in (["off"], ["0"], []) else int(parts[1])
        arrays = {key: np.array(values[key], np.float64).reshape(-1, width[key]) for key in values}
    except ValueError as error:
        raise ModelFormatError(f"{name}: not a readable OBJ file: {error}") from None
    if not faces:
        raise ModelFormatError(f"{name}: the OBJ file has no faces")
    if not all(np.all(np.isfinite(array)) for array in arrays.values()):
        raise ModelFormatError(f"{name}: the OBJ file has numbers that are not finite")
    if np.abs(arrays["v"]).max(initial=0.0) > MAX_COORDINATE:
        raise ModelFormatError(f"{name}: the OBJ file has vertices beyond {MAX_COORDINATE:g}")
    pieces = [_triangles(key, numbers, arrays, name) for key, numbers in faces.items()]
    corners, normals, texcoords, material_index = (np.concatenate(column) for column in zip(*pieces, strict=True))
    return ObjMesh(corners, normals, texcoords, material_index, tuple(materials), tuple(files))


def _pad(numbers: list[str], length: int) -> list[str]:
    if len(numbers) == 0:
        raise ValueError("a vertex line has no numbers")
    return numbers + ["0"] * (length - len(numbers))


def _corner_numbers(corners: list[str], counts: dict[str, int]) -> tuple[int, list[int]]:
    """Position, texture and normal index (from 0) of every corner, and which of them exist (bit 1: uv, bit 2: normal).

    An index that is absent becomes -1.
    """
    numbers, layout = [], 3
    for corner in corners:
        fields = [*corner.split("/"), "", ""][:3]
        for kind, text in zip(("v", "vt", "vn"), fields, strict=True):
            if text:
                index = int(text)
                numbers.append(index - 1 if index > 0 else counts[kind] + index)
            else:
                numbers.append(-1)
                layout &= {"v": -1, "vt": 2, "vn": 1}[kind]
    return layout, numbers


def _triangles(
    key: tuple[int, int, int, int], numbers: list[int], arrays: dict[str, np.ndarray], name: str
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    material, smoothing, polygon_size, layout = key
    index = np.array(numbers, np.int64).reshape(-1, polygon_size, 3)
    for column, kind, present in ((0, "v", True), (1, "vt", layout & 1), (2, "vn", layout & 2)):
        if present and (index[..., column].min() < 0 or index[..., column].max() >= len(arrays[kind])):
            raise ModelFormatError(f"{name}: a face refers to a {kind} that does not exist")
    picked = index.reshape(-1, 3)[triangulate(arrays["v"], index[..., 0])]
    corners = arrays["v"][picked[..., 0]]
    texcoords = arrays["vt"][picked[..., 1]] if layout & 1 else np.full((*picked.shape[:2], 2), np.nan)
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    if layout & 2:
        normals = arrays["vn"][picked[..., 2]]
        broken = np.einsum("tck,tck->tc", normals, normals) < 1e-12
        normals = np.where(broken[..., None], across[:, None], normals)
    elif smoothing:
        total = np.zeros_like(arrays["v"])
        np.add.at(total, picked[..., 0].ravel(), np.repeat(across, 3, axis=0))
        normals = total[picked[..., 0]]
    else:
        normals = np.repeat(across[:, None], 3, axis=1)
    return corners, normals, texcoords, np.full(len(corners), material)


def parse_mtl(content: bytes) -> dict[str, ObjMaterial]:
    """Reads an MTL file; lines it does not understand are passed over, as viewers do.

    Args:
        content: the file.

    Returns:
        Materials by name.
    """
    materials: dict[str, dict] = {}
    current: dict = {}
    readers: dict[str, Callable[[list[str]], dict]] = {
        "Kd": lambda p: {"diffuse": _colour(p)},
        "Ks": lambda p: {"specular": _colour(p)},
        "Ns": lambda p: {"shininess": float(p[0])},
        "d": lambda p: {"alpha": min(max(float(p[-1]), 0.0), 1.0)},
        "Tr": lambda p: {"alpha": min(max(1.0 - float(p[0]), 0.0), 1.0)},
        "illum": lambda p: {"illumination": int(float(p[0]))},
    }
    for line in content.decode("iso-8859-1").splitlines():
        parts = line.split()
        if not parts:
            continue
        if parts[0] == "newmtl":
            current = materials.setdefault(line.strip().partition(" ")[2].strip(), {})
        elif parts[0] == "map_Kd" and len(parts) > 1:
            current["texture"] = _texture_path(line.strip().split(None, 1)[1])
        elif parts[0] in readers:
            try:
                current.update(readers[parts[0]](parts[1:]))
            except (ValueError, IndexError):
                continue
    return {name: ObjMaterial(**fields) for name, fields in materials.items()}


def _colour(parts: list[str]) -> tuple[float, float, float]:
    red, green, blue = (min(max(float(part), 0.0), 1.0) for part in (parts * 3 if len(parts) == 1 else parts)[:3])
    return red, green, blue


def _texture_path(argument: str) -> str:
    """The file of a ``map_Kd`` line; options before it (``-s 1 1 1`` and the like) are dropped."""
    if argument.startswith("-"):
        argument = argument.split()[-1]
    return posixpath.normpath(argument.replace("\\", "/"))
