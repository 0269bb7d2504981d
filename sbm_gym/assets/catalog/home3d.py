"""Furniture of Sweet Home 3D libraries, converted once into a cache of arrays and pictures."""

import posixpath
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, UInt8

from labeling.formats.atomic import atomic_folder
from sbm_gym.assets.catalog.archive import ArchiveError, FurnitureArchive, resolve
from sbm_gym.assets.catalog.catalog import CatalogEntry
from sbm_gym.assets.catalog.foliage import thin_foliage
from sbm_gym.assets.catalog.wavefront import ModelFormatError, ObjMaterial, ObjMesh, parse_mtl, parse_obj
from sbm_gym.assets.models.model import (
    FurnitureModel,
    Surface,
    footprint_rectangles,
    load_model,
    save_model,
    saved_triangles,
)
from sbm_gym.store.cache_folder import cache_folder

CONVERTER_VERSION = 4
"""Goes up whenever conversion gives other results, so that older caches are left behind."""
CLEAR_M = 2.3
"""Thinned trees are pruned up to this height, so that people can walk below."""
MAX_TEXTURE_PX = 512
MAX_PICTURE_PX = 64_000_000
"""Pictures with more pixels than this are refused before they are decoded."""
HOME3D_TO_WORLD = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""Sweet Home 3D: x right, y up, z to the front. World: x right, y to the back, z up."""


@dataclass(frozen=True)
class CachedModel:
    """A catalogue entry's model in the cache of converted furniture.

    Both methods raise ``ArchiveError`` or ``ModelFormatError`` if the library or the model is damaged.
    """

    entry: CatalogEntry
    library_hash: str
    """Identifies the content of the entry's library."""
    cache: Path | None = None
    """Folder of converted models; by default the user's."""
    thin_to: int | None = None
    """For trees: about how many triangles they may have."""

    @property
    def folder(self) -> Path:
        """Where the cache keeps the model."""
        safe = "".join(letter if letter.isalnum() or letter in "-_" else "_" for letter in self.entry.model_id)[:80]
        thinned = "" if self.thin_to is None else f"-thin{self.thin_to}"
        version = f"v{CONVERTER_VERSION}"
        return (self.cache or cache_folder()) / "furniture" / version / self.library_hash / (safe + thinned)

    def load(self) -> FurnitureModel:
        """The model: from the cache, or converted and put there."""
        if self.folder.is_dir():
            try:
                return load_model(self.folder)
            except (OSError, ValueError, KeyError, TypeError):
                pass  # damaged: made again below
        model = convert(self.entry)
        if self.thin_to is not None:
            model = thin_foliage(model, self.thin_to, CLEAR_M)
        try:
            with atomic_folder(self.folder) as temporary:
                save_model(temporary, model)
        except OSError:
            if not self.folder.is_dir():
                raise
            # Another process put the same model there in the meantime.
        return model

    def num_triangles(self) -> int:
        """How many triangles it has; reads no mesh that the cache holds."""
        try:
            return saved_triangles(self.folder)
        except (OSError, ValueError, KeyError, TypeError):
            return self.load().num_triangles


def convert(entry: CatalogEntry) -> FurnitureModel:
    """Reads a model from its library and brings it to size, axes and origin.

    Args:
        entry: which model.

    Raises:
        ArchiveError, ModelFormatError: if the library or the model is damaged.
    """
    with FurnitureArchive(entry.archive, entry.archive.name) as outer:
        archive, obj_path = _open_model(outer, entry)
        mesh = parse_obj(archive.read(obj_path), f"{entry.archive.name}: {obj_path}")
        folder = posixpath.dirname(obj_path)
        materials: dict[str, ObjMaterial] = {}
        for file in mesh.material_files:
            path = resolve(file, archive.name, folder)
            if archive.has(path):
                materials.update(parse_mtl(archive.read(path)))
        textures: dict[str, np.ndarray] = {}
        for material in materials.values():
            if material.texture is not None and material.texture not in textures:
                path = _find_picture(material.texture, archive, folder)
                if path is not None:
                    textures[material.texture] = _picture(archive.read(path), f"{archive.name}: {path}")
    corners, normals = _to_world(mesh, entry)
    surfaces = []
    for look, indices in _group_by_look(mesh, materials, textures).items():
        picked = np.flatnonzero(np.isin(mesh.material, indices))
        surface = _surface(corners[picked], normals[picked], mesh.texcoords[picked], look, textures)
        if surface is not None:
            surfaces.append(surface)
    if not surfaces:
        raise ModelFormatError(f"{entry.archive.name}: the model {entry.model_id!r} has no triangle with an area")
    footprint_m = footprint_rectangles(_samples(corners), entry.size_m)
    return FurnitureModel(entry.model_id, entry.size_m, tuple(surfaces), footprint_m)


def _open_model(archive: FurnitureArchive, entry: CatalogEntry) -> tuple[FurnitureArchive, str]:
    """The archive that holds the OBJ file, and its path: the library itself, or a zip within it."""
    if not entry.model_path.lower().endswith(".zip"):
        return archive, entry.model_path
    inner = FurnitureArchive(archive.read(entry.model_path), f"{archive.name}: {entry.model_path}")
    for name in inner.names():
        if name.lower().endswith(".obj"):
            return inner, name
    raise ArchiveError(f"{inner.name}: holds no OBJ file")


def _find_picture(texture: str, archive: FurnitureArchive, folder: str) -> str | None:
    """The member that an MTL file means; None if it is not there.

    MTL files often give a path on their author's disk, and Sweet Home 3D takes what follows the last blank or slash.
    """
    for candidate in (texture, posixpath.basename(texture), posixpath.basename(texture.split()[-1])):
        path = resolve(candidate, archive.name, folder)
        if archive.has(path):
            return path
    return None


def _to_world(mesh: ObjMesh, entry: CatalogEntry) -> tuple[Float[np.ndarray, "t 3 3"], Float[np.ndarray, "t 3 3"]]:
    """Corners and normals in world axes, stretched to the catalogue's size along each axis."""
    rotation = HOME3D_TO_WORLD @ np.array(entry.model_rotation).reshape(3, 3)
    corners = mesh.corners @ rotation.T
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    extent = high - low
    scale = np.where(extent > 1e-9, np.array(entry.size_m) / np.maximum(extent, 1e-9), 1.0)
    corners = (corners - np.array([0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1]), low[2]])) * scale
    normals = mesh.normals @ rotation.T / scale
    length = np.linalg.norm(normals, axis=-1, keepdims=True)
    # Made from slivers of triangles, normals can be of any length; only where there is none at all, up will do.
    return corners, np.where(length > 0, normals / np.where(length > 0, length, 1.0), [0.0, 0.0, 1.0])


_Look = tuple[tuple[float, float, float, float], float, float, str | None]
"""rgba, specular, shininess, texture."""


def _group_by_look(
    mesh: ObjMesh, materials: dict[str, ObjMaterial], textures: dict[str, np.ndarray]
) -> dict[_Look, list[int]]:
    """Material indices that look the same: catalogues often name one material many times."""
    textured = np.zeros(len(mesh.material_names), bool)
    np.logical_or.at(textured, mesh.material, ~np.isnan(mesh.texcoords[:, 0, 0]))
    groups: dict[_Look, list[int]] = {}
    for index, name in enumerate(mesh.material_names):
        material = materials.get(name, ObjMaterial())
        texture = material.texture if material.texture in textures else None
        colour = material.diffuse
        if texture is not None:
            # The picture holds the final colours; Kd beside it is what the exporting program happened to have.
            mean = textures[texture][..., :3].reshape(-1, 3).mean(axis=0) / 255.0
            colour = (1.0, 1.0, 1.0) if textured[index] else (float(mean[0]), float(mean[1]), float(mean[2]))
            texture = texture if textured[index] else None
        shiny = material.illumination >= 2 and material.shininess > 0
        specular = round(float(np.mean(material.specular)), 2) if shiny else 0.0
        shininess = round(min(material.shininess / 128.0, 1.0), 2) if shiny else 0.0
        rgba = (round(colour[0], 3), round(colour[1], 3), round(colour[2], 3), round(material.alpha, 3))
        groups.setdefault((rgba, specular, shininess, texture), []).append(index)
    return groups


def _surface(
    corners: Float[np.ndarray, "t 3 3"],
    normals: Float[np.ndarray, "t 3 3"],
    texcoords: Float[np.ndarray, "t 3 2"],
    look: _Look,
    textures: dict[str, np.ndarray],
) -> Surface | None:
    """One surface with shared vertices; None if none of its triangles has an area."""
    rgba, specular, shininess, texture = look
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    kept = area > 1e-10
    if not kept.any() or rgba[3] == 0.0:
        return None
    columns = [corners[kept].reshape(-1, 3), normals[kept].reshape(-1, 3)]
    if texture is not None:
        # Sweet Home 3D counts v from the bottom of the picture, MuJoCo from its first row, the top.
        flipped = np.nan_to_num(texcoords[kept].reshape(-1, 2)) * [1.0, -1.0] + [0.0, 1.0]
        columns.append(flipped)
    rows = np.concatenate(columns, axis=1).astype(np.float32)
    unique, inverse = _unique_rows(rows)
    return Surface(
        vertices_m=np.ascontiguousarray(unique[:, :3]),
        normals=np.ascontiguousarray(unique[:, 3:6]),
        texcoords=None if texture is None else np.ascontiguousarray(unique[:, 6:8]),
        faces=inverse.reshape(-1, 3).astype(np.int32),
        rgba=rgba,
        specular=specular,
        shininess=shininess,
        texture=None if texture is None else textures[texture],
    )


def _unique_rows(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Like ``np.unique(axis=0)`` but in order of first appearance and faster; compares bytes (so -0.0 becomes 0.0)."""
    rows = np.ascontiguousarray(rows + np.float32(0.0))
    keys = rows.view(np.dtype((np.void, rows.dtype.itemsize * rows.shape[1]))).ravel()
    _, first, inverse = np.unique(keys, return_index=True, return_inverse=True)
    order = np.argsort(first)
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return rows[first[order]], rank[inverse.ravel()]


def _samples(corners: Float[np.ndarray, "t 3 3"], step_m: float = 0.03) -> Float[np.ndarray, "n 3"]:
    """Points on triangles, at most about ``step_m`` apart, for finding out what a model covers."""
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    points = [corners.reshape(-1, 3), corners.mean(axis=1)]
    for index in np.flatnonzero(longest > step_m):
        steps = min(int(np.ceil(longest[index] / step_m)), 200)
        i, j = np.meshgrid(np.arange(steps + 1), np.arange(steps + 1), indexing="ij")
        inside = i + j <= steps
        a, b = i[inside] / steps, j[inside] / steps
        p, q, r = corners[index]
        points.append(p + a[:, None] * (q - p) + b[:, None] * (r - p))
    return np.concatenate(points)


def _picture(content: bytes, name: str) -> UInt8[np.ndarray, "h w c"]:
    """A picture as RGB, or RGBA where parts of it are transparent; no side longer than ``MAX_TEXTURE_PX``."""
    import cv2

    width, height = _picture_size(content, name)
    if width * height > MAX_PICTURE_PX:
        raise ArchiveError(f"{name}: a picture of {width}x{height} pixels is too large; refused")
    picture = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    if picture is None or picture.dtype != np.uint8:
        picture = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR)
    if picture is None:
        raise ArchiveError(f"{name}: not a readable picture")
    picture = np.repeat(picture.reshape(*picture.shape[:2], -1), 3, axis=2) if picture.ndim == 2 else picture
    if picture.shape[2] == 4 and picture[..., 3].min() >= 250:
        picture = picture[..., :3]
    largest = max(picture.shape[:2])
    if largest > MAX_TEXTURE_PX:
        shrink = MAX_TEXTURE_PX / largest
        size = (max(round(picture.shape[1] * shrink), 1), max(round(picture.shape[0] * shrink), 1))
        picture = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    return np.ascontiguousarray(picture[..., [2, 1, 0, 3][: picture.shape[2]]])


def _picture_size(content: bytes, name: str) -> tuple[int, int]:
    """Width and height from the header of a PNG or JPEG file, before anything is unpacked."""
    if content[:8] == b"\x89PNG\r\n\x1a\n" and len(content) >= 24:
        return int.from_bytes(content[16:20], "big"), int.from_bytes(content[20:24], "big")
    if content[:2] == b"\xff\xd8":
        at = 2
        while at + 9 < len(content):
            if content[at] != 0xFF:
                at += 1
                continue
            marker = content[at + 1]
            if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
                height, width = content[at + 5 : at + 7], content[at + 7 : at + 9]
                return int.from_bytes(width, "big"), int.from_bytes(height, "big")
            has_no_length = marker in (0x01, 0xFF) or 0xD0 <= marker <= 0xD9
            at += 1 if marker == 0xFF else 2 if has_no_length else 2 + int.from_bytes(content[at + 2 : at + 4], "big")
    raise ArchiveError(f"{name}: neither a PNG nor a JPEG picture")
