"""Catalogue furniture, and builtin models of what catalogues lack."""

import functools

from sbm_gym.assets.builtin import BUILTIN, BuiltinLibrary
from sbm_gym.assets.library import FurnitureLibrary, ModelCard
from sbm_gym.assets.model import FurnitureModel
from sbm_gym.assets.reserved import worlds_library

FROM_SEEDS = {"cushion": 16, "leaning_cushion": 24, "beanbag": 7, "nightstand": 6, "rug": 12, "bathtub": 6}
"""How many builtin models join the catalogues' for these uses, of which catalogues have none or two at most."""


class MixedLibrary:
    """A library's models, and builtin ones for the uses in ``FROM_SEEDS``."""

    def __init__(self, library: FurnitureLibrary):
        """Adds to ``library``."""
        self._library = library
        self._builtin = BuiltinLibrary(seed=0, variants=max(FROM_SEEDS.values()))

    def models(self, use: str) -> tuple[ModelCard, ...]:
        """Models for a use, the library's first."""
        count = FROM_SEEDS.get(use, 0)
        return self._library.models(use) + (self._builtin.models(use)[:count] if count else ())

    def load(self, card: ModelCard) -> FurnitureModel:
        """The model of a card that ``models`` gave."""
        return (self._builtin if card.library == BUILTIN else self._library).load(card)


@functools.cache
def indoor_library() -> MixedLibrary:
    """What interiors are furnished from: the installed catalogues with builtin models of what they lack.

    Raises:
        MissingAssetsError: if no catalogue is installed.
    """
    return MixedLibrary(worlds_library())
