"""A furniture model as arrays: what conversion makes, the cache keeps and worlds build from."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Float32, Int32, UInt8


@dataclass(frozen=True)
class Surface:
    """All triangles of a model that share one material."""

    vertices_m: Float32[np.ndarray, "v 3"]
    normals: Float32[np.ndarray, "v 3"]
    """Unit length, one for each vertex."""
    texcoords: Float32[np.ndarray, "v 2"] | None
    """(u, v) with v downwards from the top row of the picture; None where there is no texture."""
    faces: Int32[np.ndarray, "t 3"]
    rgba: tuple[float, float, float, float]
    """Display colour, each in [0, 1]; white where there is a texture."""
    specular: float
    """Strength of highlights, in [0, 1]."""
    shininess: float
    """Sharpness of highlights, in [0, 1]."""
    texture: UInt8[np.ndarray, "h w c"] | None
    """RGB, or RGBA where the picture has holes; None for a plain colour."""


@dataclass(frozen=True)
class FurnitureModel:
    """A piece of furniture: metres, +Z up, front towards -Y, origin on the floor in the middle of its footprint."""

    model_id: str
    size_m: tuple[float, float, float]
    """Width (x), depth (y) and height (z)."""
    surfaces: tuple[Surface, ...]
    footprint_m: Float[np.ndarray, "boxes 4"]
    """Rectangles (min x, min y, max x, max y) that together cover what stands on or hangs over the floor."""

    @property
    def num_triangles(self) -> int:
        """Triangles of all surfaces together."""
        return sum(len(surface.faces) for surface in self.surfaces)


def footprint_rectangles(
    points: Float[np.ndarray, "n 3"], size_m: tuple[float, float, float], min_share: float = 0.12
) -> Float[np.ndarray, "boxes 4"]:
    """Covers a model's footprint with one rectangle, or two where a corner is empty (an L-shaped couch).

    Args:
        points: surface points of the model, dense enough for cells of 5 cm.
        size_m: the model's width, depth and height.
        min_share: smallest share of the whole rectangle worth cutting out.

    Returns:
        Rectangles (min x, min y, max x, max y), metres.
    """
    half = 0.5 * np.array(size_m[:2])
    whole = np.array([[-half[0], -half[1], half[0], half[1]]])
    cells = np.maximum(np.ceil(2 * half / 0.05).astype(int), 1)
    index = np.clip(((points[:, :2] + half) / (2 * half) * cells).astype(int), 0, cells - 1)
    taken = np.zeros(cells, bool)
    taken[index[:, 0], index[:, 1]] = True
    best_area, best = 0, None
    for flip_x in (False, True):
        for flip_y in (False, True):
            grid = taken[:: -1 if flip_x else 1, :: -1 if flip_y else 1]
            # After this, blocked[i, j] says whether anything stands in cells (0..i, 0..j).
            blocked = np.logical_or.accumulate(np.logical_or.accumulate(grid, axis=0), axis=1)
            columns = np.where(blocked.all(axis=1), 0, (~blocked).sum(axis=1))
            areas = columns * np.arange(1, cells[0] + 1)
            row = int(np.argmax(areas))
            if areas[row] > best_area:
                best_area, best = int(areas[row]), (flip_x, flip_y, row + 1, int(columns[row]))
    if best is None or best_area < min_share * cells[0] * cells[1]:
        return whole
    flip_x, flip_y, cut_x, cut_y = best
    cut = np.array([cut_x, cut_y]) / cells * 2 * half
    left = [-half[0], -half[1] + cut[1], -half[0] + cut[0], half[1]]
    right = [-half[0] + cut[0], -half[1], half[0], half[1]]
    boxes = np.array([left, right])
    if flip_x:
        boxes = boxes[:, [2, 1, 0, 3]] * [-1, 1, -1, 1]
    if flip_y:
        boxes = boxes[:, [0, 3, 2, 1]] * [1, -1, 1, -1]
    return boxes[(boxes[:, 2] - boxes[:, 0] > 1e-6) & (boxes[:, 3] - boxes[:, 1] > 1e-6)]


def save_model(folder: Path, model: FurnitureModel) -> None:
    """Writes a model as ``model.npz``, ``model.json`` and one PNG for each texture, into an existing folder."""
    import cv2

    arrays: dict[str, np.ndarray] = {"footprint_m": model.footprint_m}
    surfaces = []
    pictures: dict[bytes, str] = {}
    for number, surface in enumerate(model.surfaces):
        arrays[f"vertices_{number}"] = surface.vertices_m
        arrays[f"normals_{number}"] = surface.normals
        arrays[f"faces_{number}"] = surface.faces
        if surface.texcoords is not None:
            arrays[f"texcoords_{number}"] = surface.texcoords
        picture = None
        if surface.texture is not None:
            key = surface.texture.tobytes()
            picture = pictures.setdefault(key, f"texture_{len(pictures)}.png")
            cv2.imwrite(str(folder / picture), surface.texture[..., [2, 1, 0, 3][: surface.texture.shape[2]]])
        surfaces.append(
            {"rgba": surface.rgba, "specular": surface.specular, "shininess": surface.shininess, "texture": picture}
        )
    np.savez(folder / "model.npz", allow_pickle=False, **arrays)
    known = {"model_id": model.model_id, "size_m": model.size_m, "triangles": model.num_triangles}
    record = {**known, "surfaces": surfaces}
    (folder / "model.json").write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")


def load_model(folder: Path) -> FurnitureModel:
    """Reads what ``save_model`` wrote.

    Raises:
        OSError, ValueError, KeyError: if the folder is not a whole, well-formed model.
    """
    record = json.loads((folder / "model.json").read_text(encoding="utf-8"))
    picture = _picture_reader(folder)
    with np.load(folder / "model.npz", allow_pickle=False) as arrays:
        surfaces = tuple(
            Surface(
                vertices_m=arrays[f"vertices_{number}"],
                normals=arrays[f"normals_{number}"],
                texcoords=arrays.get(f"texcoords_{number}"),
                faces=arrays[f"faces_{number}"],
                rgba=tuple(surface["rgba"]),
                specular=surface["specular"],
                shininess=surface["shininess"],
                texture=None if surface["texture"] is None else picture(surface["texture"]),
            )
            for number, surface in enumerate(record["surfaces"])
        )
        footprint_m = arrays["footprint_m"]
    return FurnitureModel(record["model_id"], tuple(record["size_m"]), surfaces, footprint_m)


def saved_triangles(folder: Path) -> int:
    """How many triangles a model that ``save_model`` wrote has, without reading them.

    Raises:
        OSError, ValueError, KeyError: if the folder is not a whole, well-formed model.
    """
    return int(json.loads((folder / "model.json").read_text(encoding="utf-8"))["triangles"])


def _picture_reader(folder: Path) -> Callable[[str], UInt8[np.ndarray, "h w c"]]:
    """Reads each picture once, so that surfaces that share one also share its array."""
    import cv2

    pictures: dict[str, np.ndarray] = {}

    def read(name: str) -> np.ndarray:
        if name not in pictures:
            picture = cv2.imread(str(folder / Path(name).name), cv2.IMREAD_UNCHANGED)
            if picture is None or picture.ndim != 3:
                raise ValueError(f"{folder / name} is not a readable picture")
            pictures[name] = cv2.cvtColor(picture, cv2.COLOR_BGR2RGB if picture.shape[2] == 3 else cv2.COLOR_BGRA2RGBA)
        return pictures[name]

    return read
