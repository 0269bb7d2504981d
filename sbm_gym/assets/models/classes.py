"""Which catalogue entries show which class of object, read from ``furniture.toml`` beside this module."""

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

COCO_CATEGORIES = ("chair", "couch", "plant", "tv", "fridge", "bed", "table", "toilet")
"""The eight classes shared by COCO and Replica. Source: thesis section 5.1."""
OUTDOOR_CATEGORIES = ("car", "truck", "bus", "motorcycle", "bicycle")
"""The vehicle classes of COCO that move on roads. Source: thesis section 5.1.2."""
NOVEL_CATEGORIES = ("cushion", "nightstand", "shelf", "beanbag")
"""Classes that COCO does not have. Source: thesis section A.6."""
MAX_TRIANGLES = 46_000
"""Models with more triangles are left out for now; nothing is thinned, so legs, slats and leaves stay as drawn.

Trees have more: they are thinned leaf by leaf (sbm_gym.assets.catalog.foliage)."""
THINNED = {"street_tree": 8_000, "park_tree": 8_000}
"""Uses whose models are thinned when they are converted, and to how many triangles."""


@dataclass(frozen=True)
class Use:
    """What a list of models is for."""

    category: str | None
    """The class of its objects, None for furnishings without one."""
    models: tuple[str, ...]
    """Their ids: the library's name, ``#`` and the model's."""


def _ids(entry: Mapping[str, str]) -> tuple[str, ...]:
    """Ids of the models that an entry of the file lists by library."""
    libraries = {name: models for name, models in entry.items() if name not in ("category", "reason")}
    return tuple(f"{library}#{model}" for library, models in libraries.items() for model in models.split())


_LISTS = tomllib.loads(Path(__file__).with_name("furniture.toml").read_text(encoding="utf-8"))
USES = {use: Use(entry.get("category"), _ids(entry)) for use, entry in _LISTS["uses"].items()}
"""Every use with its models."""
VEHICLE_PAINT = {model: (red, green, blue) for model, (red, green, blue) in _LISTS["vehicle_paint"].items()}
"""Display colour of a vehicle model's paint, where it has a plain one: such parts are painted anew for each vehicle."""
EXCLUDED = {model: entry["reason"] for entry in _LISTS["left_out"] for model in _ids(entry)}
"""Models that would fit a use but are left out, with the reason."""
FROM_SEEDS: dict[str, int] = _LISTS["from_seeds"]
"""How many builtin models join the catalogues' in rooms, by use."""
FROM_SEEDS_IN_STREETS: dict[str, int] = _LISTS["from_seeds_in_streets"]
"""How many builtin models stand in for the catalogues' in towns, by use."""


def categories() -> tuple[str, ...]:
    """All classes that the libraries can show."""
    return COCO_CATEGORIES + NOVEL_CATEGORIES + OUTDOOR_CATEGORIES
