"""Catalogue furniture, and builtin models of what catalogues lack."""

import functools
from collections.abc import Mapping

from sbm_gym.assets.catalog.library import FurnitureLibrary, ModelCard
from sbm_gym.assets.models.classes import FROM_SEEDS, FROM_SEEDS_IN_STREETS
from sbm_gym.assets.models.model import FurnitureModel
from sbm_gym.assets.parametric.builtin import BUILTIN, BuiltinLibrary
from sbm_gym.assets.reserved import worlds_library


class MixedLibrary:
    """A library's models, and builtin ones for some uses."""

    def __init__(
        self, library: FurnitureLibrary, added: Mapping[str, int] = FROM_SEEDS, instead: Mapping[str, int] | None = None
    ):
        """Mixes.

        Args:
            library: what builtin models join.
            added: uses with builtin models after the library's, and how many.
            instead: uses with builtin models only, and how many.
        """
        self._library, self._added, self._instead = library, added, instead or {}
        self._builtin = BuiltinLibrary(seed=0, variants=max([1, *added.values(), *self._instead.values()]))

    def models(self, use: str) -> tuple[ModelCard, ...]:
        """Models for a use, the library's first."""
        if use in self._instead:
            return self._builtin.models(use)[: self._instead[use]]
        count = self._added.get(use, 0)
        return self._library.models(use) + (self._builtin.models(use)[:count] if count else ())

    def load(self, card: ModelCard) -> FurnitureModel:
        """The model of a card that ``models`` gave."""
        return self._of(card).load(card)

    def triangles(self, card: ModelCard) -> int:
        """How many triangles the model of a card has."""
        return self._of(card).triangles(card)

    def _of(self, card: ModelCard) -> FurnitureLibrary:
        return self._builtin if card.library == BUILTIN else self._library


@functools.cache
def indoor_library() -> MixedLibrary:
    """What interiors are furnished from: the installed catalogues with builtin models of what they lack.

    Raises:
        MissingAssetsError: if no catalogue is installed.
    """
    return MixedLibrary(worlds_library())


@functools.cache
def town_library() -> MixedLibrary:
    """What towns are furnished from: the installed catalogues with builtin models for what is too heavy there.

    Raises:
        MissingAssetsError: if no catalogue is installed.
    """
    return MixedLibrary(worlds_library(), added={}, instead=FROM_SEEDS_IN_STREETS)
