"""Models kept for photographs: a fixed part of every class that has enough models, which no world shows.

Detectors are pre-trained on photographs (sbm_gym.photographs) and tried out in worlds. Where a class has enough models,
no world may show one that a photograph has shown. Builtin models are kept apart by their seeds instead, see
sbm_gym.photographs.models.
"""

import functools
import hashlib

from sbm_gym.assets.catalog.library import FurnitureLibrary, ModelCard, SelectedModels, default_library
from sbm_gym.assets.models.classes import COCO_CATEGORIES, OUTDOOR_CATEGORIES, USES

ENOUGH_MODELS = 9
"""Classes with fewer models share them between photographs and worlds."""
RESERVED_SHARE = 0.4
"""Share of a use's models that is kept for photographs, where its class has enough."""


def _rank(model_id: str) -> bytes:
    """Sorts models in an order that looks random and is the same everywhere.

    The word in it was chosen so that worlds keep four cars and two small plants that are light enough to come often.
    """
    return hashlib.sha256(f"snapshot: {model_id}".encode()).digest()


@functools.cache
def kept_apart() -> frozenset[str]:
    """Classes of which photographs and worlds show different models: those COCO knows and that have enough."""
    count = dict.fromkeys(COCO_CATEGORIES + OUTDOOR_CATEGORIES, 0)
    for use in USES.values():
        if use.category in count:
            count[use.category] += len(use.models)
    return frozenset(category for category, models in count.items() if models >= ENOUGH_MODELS)


@functools.cache
def reserved_models() -> tuple[str, ...]:
    """Ids of the models that are kept for photographs; what is installed plays no part."""
    found = []
    for use in USES.values():
        if use.category in kept_apart():
            found += sorted(use.models, key=_rank)[: round(RESERVED_SHARE * len(use.models))]
    return tuple(found)


class WorldsLibrary(SelectedModels):
    """A library without the models that are kept for photographs. Implements ``FurnitureLibrary``."""

    def __init__(self, library: FurnitureLibrary):
        """Takes them out of ``library``."""
        super().__init__(library)
        self._reserved = frozenset(reserved_models())

    def models(self, use: str) -> tuple[ModelCard, ...]:
        """Models for a use that worlds may show."""
        return tuple(card for card in self._library.models(use) if card.model_id not in self._reserved)


@functools.cache
def worlds_library() -> WorldsLibrary:
    """What worlds are furnished from: the installed catalogues without the models kept for photographs.

    Raises:
        MissingAssetsError: if no catalogue is installed.
    """
    return WorldsLibrary(default_library())
