"""What rooms are furnished from: a library that offers models for a use and loads them."""

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from labeling.core.errors import MissingAssetsError
from sbm_gym.assets.catalog.catalog import CatalogEntry, Library, find_libraries, read_library
from sbm_gym.assets.catalog.home3d import CachedModel
from sbm_gym.assets.models.classes import THINNED, USES
from sbm_gym.assets.models.model import FurnitureModel


@dataclass(frozen=True)
class ModelCard:
    """What is known about a model without loading it."""

    model_id: str
    use: str
    """What it is for, such as ``dining_chair``."""
    category: str | None
    """Its class, None for furnishings without one."""
    size_m: tuple[float, float, float]
    """Width, depth and height, as it stands with its front towards -Y."""
    top_m: float | None
    """Height of the top that other things can stand on; None where nothing can."""
    name: str
    creator: str
    licence: str
    library: str


class FurnitureLibrary(Protocol):
    """A source of furniture models."""

    def models(self, use: str) -> tuple[ModelCard, ...]:
        """Models for a use, in a fixed order; empty if there are none."""
        ...

    def load(self, card: ModelCard) -> FurnitureModel:
        """The model of a card that ``models`` gave."""
        ...

    def triangles(self, card: ModelCard) -> int:
        """How many triangles the model of a card has; cheaper than loading it where that can be."""
        ...


class Home3dLibrary:
    """The mapped models of Sweet Home 3D furniture libraries."""

    def __init__(self, locations: Sequence[Path] | None = None, cache: Path | None = None):
        """Reads the catalogues.

        Args:
            locations: library files or folders; by default ``SBM_FURNITURE``, else the system's folder.
            cache: folder of converted models; by default the user's.

        Raises:
            MissingAssetsError: if there is no library, or none of them has a model of the class map.
            ArchiveError: if a library is damaged.
        """
        self.libraries: tuple[Library, ...] = tuple(read_library(path) for path in find_libraries(locations))
        thin_to = {model_id: count for use, count in THINNED.items() for model_id in USES[use].models}
        self._models = {
            entry.model_id: CachedModel(entry, library.content_hash, cache, thin_to.get(entry.model_id))
            for library in self.libraries
            for entry in library.entries
        }
        self._cards = {
            use: tuple(_card(self._models[model].entry, use) for model in described.models if model in self._models)
            for use, described in USES.items()
        }
        if not any(self._cards.values()):
            found = ", ".join(library.name for library in self.libraries)
            raise MissingAssetsError(
                f"the furniture libraries found ({found}) hold none of the models rooms are made of: "
                "run `sudo apt-get install sweethome3d-furniture`"
            )
        # More than a scene has: loading one anew takes milliseconds, and keeps half a megabyte.
        self._load = functools.lru_cache(maxsize=128)(lambda model_id: self._models[model_id].load())
        self._triangles = functools.cache(lambda model_id: self._models[model_id].num_triangles())

    def models(self, use: str) -> tuple[ModelCard, ...]:
        """Models for a use, in the class map's order; empty if there are none."""
        return self._cards.get(use, ())

    def cards(self) -> tuple[ModelCard, ...]:
        """All mapped models that are there."""
        return tuple(card for cards in self._cards.values() for card in cards)

    def load(self, card: ModelCard) -> FurnitureModel:
        """The model of a card, from memory, from the cache, or converted now."""
        return self._load(card.model_id)

    def triangles(self, card: ModelCard) -> int:
        """How many triangles the model of a card has, from the cache's notes."""
        return self._triangles(card.model_id)

    def install(self, report: Callable[[ModelCard], None]) -> None:
        """Makes sure the cache holds every mapped model; calls ``report`` after each."""
        for card in self.cards():
            self._models[card.model_id].load()
            report(card)


def _card(entry: CatalogEntry, use: str) -> ModelCard:
    known = {
        key: getattr(entry, key) for key in ("model_id", "size_m", "top_m", "name", "creator", "licence", "library")
    }
    return ModelCard(use=use, category=USES[use].category, **known)


@functools.cache
def default_library() -> Home3dLibrary:
    """The library of this process: catalogues are read once, and the models used last stay in memory."""
    return Home3dLibrary()
