"""Sweet Home 3D furniture libraries: where they are, and what their catalogues say."""

import itertools
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from labeling.core.errors import MissingAssetsError
from sbm_gym.assets.catalog.archive import ArchiveError, FurnitureArchive, resolve
from sbm_gym.assets.catalog.properties import parse_properties

SYSTEM_FOLDER = Path("/usr/share/sweethome3d/furniture")
"""Where Debian and Ubuntu put the libraries of the package ``sweethome3d-furniture``."""
FURNITURE_VARIABLE = "SBM_FURNITURE"
"""Environment variable that names library files or folders to read instead, separated like PATH."""
CATALOGUE = "PluginFurnitureCatalog.properties"
MAX_SIZE_M = 50.0
"""Larger pieces are a mistake in the catalogue; the largest of the Debian libraries is an escalator of 9 m."""


@dataclass(frozen=True)
class CatalogEntry:
    """One piece of furniture as its library's catalogue describes it."""

    model_id: str
    """Unique among libraries, such as ``Scopia#bed1``."""
    name: str
    library: str
    archive: Path
    model_path: str
    """OBJ file, or zip archive with one, within the library."""
    size_m: tuple[float, float, float]
    """Width, depth and height."""
    top_m: float | None
    """Height of the top that other things can stand on; None where nothing can."""
    model_rotation: tuple[float, ...]
    """Nine numbers, row by row: turns the OBJ file's axes into x right, y up, z front."""
    creator: str
    licence: str


@dataclass(frozen=True)
class Library:
    """One furniture library: its catalogue and the licence that comes with it."""

    path: Path
    name: str
    licence: str
    """One line from the catalogue."""
    licence_text: str
    content_hash: str
    entries: tuple[CatalogEntry, ...]


def find_libraries(locations: Sequence[Path] | None = None) -> list[Path]:
    """Library files, in a fixed order.

    Args:
        locations: files or folders to look in; by default those of ``SBM_FURNITURE``, else the system's folder.

    Raises:
        MissingAssetsError: if there are none; the message says how to get them.
    """
    if locations is None:
        variable = os.environ.get(FURNITURE_VARIABLE, "")
        locations = [Path(part) for part in variable.split(os.pathsep) if part] or [SYSTEM_FOLDER]
    found: list[Path] = []
    for location in locations:
        found += sorted(location.glob("*.sh3f")) if location.is_dir() else [location] if location.is_file() else []
    if not found:
        where = ", ".join(str(location) for location in locations)
        raise MissingAssetsError(
            f"no furniture libraries (*.sh3f) in {where}: run `sudo apt-get install sweethome3d-furniture`, "
            f"or set {FURNITURE_VARIABLE} to library files or folders of them"
        )
    return found


def read_library(path: Path) -> Library:
    """Reads the catalogue of a library.

    Args:
        path: the ``.sh3f`` file.

    Raises:
        ArchiveError: if the file is damaged, or its catalogue malformed or pointing out of the archive.
    """
    with FurnitureArchive(path, path.name) as archive:
        properties = parse_properties(archive.read(CATALOGUE))
        text = next(
            (name for name in archive.names() if re.fullmatch(r"licen[sc]e(\.txt)?", name, re.IGNORECASE)), None
        )
        licence_text = archive.read(text).decode("iso-8859-1") if text else ""
        content_hash = archive.content_hash()
    name = properties.get("name", path.stem)
    licence = " ".join(properties.get("license", "unknown licence").split())
    listed = itertools.takewhile(lambda number: f"name#{number}" in properties, itertools.count(1))
    entries = (_entry(properties, number, path, name, licence) for number in listed)
    return Library(path, name, licence, licence_text, content_hash, tuple(e for e in entries if e is not None))


def _entry(properties: dict[str, str], number: int, path: Path, library: str, licence: str) -> CatalogEntry | None:
    """One catalogue entry; None for a model in a format that is not read (only OBJ is, bare or zipped)."""

    def text(key: str, default: str = "") -> str:
        return properties.get(f"{key}#{number}", default)

    def length_m(key: str, default: str = "") -> float:
        try:
            value = float(text(key, default)) / 100.0
        except ValueError:
            value = np.nan
        if not np.isfinite(value) or abs(value) > MAX_SIZE_M:
            raise ArchiveError(f"{path.name}: {key}#{number} must be a length in cm, not {text(key)!r}")
        return value

    model_path = resolve(text("model"), path.name)
    if Path(model_path).suffix.lower() not in (".obj", ".zip"):
        return None
    size_m = (length_m("width"), length_m("depth"), length_m("height"))
    if min(size_m) <= 0:
        raise ArchiveError(f"{path.name}: the size of entry {number} must be positive, not {size_m} m")
    top_m = length_m("dropOnTopElevation", text("height"))
    return CatalogEntry(
        model_id=text("id", f"{library}#{number}"),
        name=text("name"),
        library=library,
        archive=path,
        model_path=model_path,
        size_m=size_m,
        top_m=top_m if top_m > 0 else None,  # catalogues give -1 where nothing can stand on a piece
        model_rotation=tuple(_rotation(text("modelRotation"), path, number).ravel().tolist()),
        creator=text("creator", "unknown"),
        licence=text("license", licence),
    )


def _rotation(text: str, path: Path, number: int) -> Float[np.ndarray, "3 3"]:
    if not text:
        return np.eye(3)
    try:
        matrix = np.array([float(part) for part in text.split()]).reshape(3, 3)
    except ValueError:
        matrix = np.full((3, 3), np.nan)
    if not (np.all(np.isfinite(matrix)) and np.allclose(matrix @ matrix.T, np.eye(3), atol=0.01)):
        raise ArchiveError(f"{path.name}: modelRotation#{number} must be a rotation of nine numbers, not {text!r}")
    return matrix
