"""Segmented clouds and 3-D boxes as binary glTF 2.0, which browsers, Blender and slides show."""

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, UInt8

from labeling.core.types import BOX_EDGES
from labeling.formats.atomic import atomic_file
from labeling.inspection.scene import LabelledScene

POINTS, LINES = 0, 1
_FLOAT, _BYTE, _ARRAY_BUFFER = 5126, 5121, 34962


def write_gltf(path: Path, scene: LabelledScene) -> None:
    """Writes a cloud as points and each box as lines, one node each, named as the viewer names them; atomically.

    glTF's +Y is up: the root node turns the world's +Z to it. Coordinates are 32-bit floats from the middle of the
    cloud, which the root node's ``extras`` give as ``origin_m``.

    Args:
        path: a .glb file.
        scene: what to write.
    """
    origin = scene.points.mean(axis=0) if len(scene.points) else np.zeros(3)
    parts: list[tuple[str, int, np.ndarray, np.ndarray]] = []
    if len(scene.points):
        parts.append(("cloud", POINTS, scene.points - origin, scene.colours))
    for one in scene.objects:
        corners = one.box.corners()[np.array(BOX_EDGES).ravel()] - origin
        colour = np.rint(255 * np.asarray(one.colour)).astype(np.uint8)
        parts.append((one.title, LINES, corners, np.tile(colour, (len(corners), 1))))
    content, buffer = _document(parts, origin)
    text = json.dumps(content).encode("utf-8")
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(buffer), 0x004E4942) + buffer
    with atomic_file(path) as temporary:
        temporary.write_bytes(struct.pack("<III", 0x46546C67, 2, 12 + len(chunks)) + chunks)


def _document(
    parts: list[tuple[str, int, np.ndarray, np.ndarray]], origin: Float[np.ndarray, "3"]
) -> tuple[dict[str, Any], bytes]:
    """The JSON of a file and the bytes that it speaks of."""
    buffer, views, accessors, meshes, nodes = b"", [], [], [], []
    turn = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]
    children = list(range(1, len(parts) + 1))
    nodes.append({"name": "world", "matrix": turn, "extras": {"origin_m": origin.tolist()}})
    if children:
        nodes[0]["children"] = children
    for name, mode, points, colours in parts:
        places = np.ascontiguousarray(points, "<f4")
        with_alpha: UInt8[np.ndarray, "n 4"] = np.full((len(places), 4), 255, np.uint8)
        with_alpha[:, :3] = colours
        for data in (places, with_alpha):
            size = {"buffer": 0, "byteOffset": len(buffer), "byteLength": data.nbytes, "target": _ARRAY_BUFFER}
            views.append(size)
            buffer += data.tobytes()
        bounds = {"min": places.min(axis=0).tolist(), "max": places.max(axis=0).tolist()}
        count = len(places)
        accessors += [
            {"bufferView": len(views) - 2, "componentType": _FLOAT, "count": count, "type": "VEC3", **bounds},
            {"bufferView": len(views) - 1, "componentType": _BYTE, "normalized": True, "count": count, "type": "VEC4"},
        ]
        attributes = {"POSITION": len(accessors) - 2, "COLOR_0": len(accessors) - 1}
        meshes.append({"name": name, "primitives": [{"attributes": attributes, "mode": mode}]})
        nodes.append({"name": name, "mesh": len(meshes) - 1})
    content: dict[str, Any] = {
        "asset": {"version": "2.0", "generator": "Seeing by Moving"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": nodes,
    }
    if parts:
        lists = {"meshes": meshes, "accessors": accessors, "bufferViews": views}
        content |= {**lists, "buffers": [{"byteLength": len(buffer)}]}
    return content, buffer
