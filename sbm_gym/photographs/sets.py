"""A set: a few objects before a backdrop, of which several photographs are taken."""

import colorsys
from dataclasses import dataclass, replace

import mujoco
import numpy as np

from sbm_gym.assets.catalog.library import FurnitureLibrary
from sbm_gym.assets.models.classes import VEHICLE_PAINT
from sbm_gym.assets.models.surfaces import Material, as_picture
from sbm_gym.photographs.models import CATEGORIES
from sbm_gym.worlds.geometry.placing import Box, Placement
from sbm_gym.worlds.scene_builder import SceneBuilder, instance_of
from sbm_gym.worlds.world import ObjectInstance


class SetBuilder:
    """Puts pieces into a set and keeps account of its objects."""

    def __init__(self, spec: mujoco.MjSpec, library: FurnitureLibrary, rng: np.random.Generator):
        """Builds into ``spec``."""
        self.scene = SceneBuilder(spec)
        self.library, self.rng = library, rng
        self.objects: list[ObjectInstance] = []
        """Those that have a class; all else has no name."""
        self.subjects: list[ObjectInstance] = []
        """Objects that pictures may be about."""
        self.solids: list[Box] = []
        """Where no camera can be."""

    def stand(self, piece: Placement, subject: bool = True) -> None:
        """Stands a model in the set; it is an object if photographs name its class."""
        card = piece.card
        name = f"{card.use}_{len(self.solids):03d}"
        body = self.scene.place(name, piece)
        paint = VEHICLE_PAINT.get(card.model_id)
        colour = None if paint is None else {paint: (*draw_paint(self.rng), 1.0)}
        self.scene.furniture(body, self.library.load(card), colour)
        self.solids.append(piece.box)
        if card.category in CATEGORIES:
            instance = instance_of(piece, len(self.objects) + 1, name)
            self.objects.append(instance)
            if subject:
                self.subjects.append(instance)


@dataclass(frozen=True)
class PhotoScene:
    """Objects before a backdrop, and where a photographer can stand."""

    name: str
    pieces: SetBuilder
    """What stands in it."""
    floor_m: tuple[float, float, float, float]
    """Where the photographer can stand: min x, min y, max x, max y."""
    ceiling_m: float
    """Cameras stay below."""
    eye_m: tuple[float, float]
    """Least and greatest height of cameras."""
    fov_deg: tuple[float, float]
    """Least and greatest horizontal field of view."""


def draw_paint(rng: np.random.Generator) -> tuple[float, float, float]:
    """Colour of a vehicle: mostly white, grey or black, else any."""
    if rng.random() < 0.5:
        grey = float(rng.choice([0.05, 0.1, 0.35, 0.55, 0.7, 0.85]))
        return grey, grey, grey
    return colorsys.hsv_to_rgb(rng.random(), rng.uniform(0.4, 0.95), rng.uniform(0.2, 0.9))


def retinted(material: Material, rng: np.random.Generator, strength: float = 0.5) -> Material:
    """A building material in another tone, lighter or darker.

    Args:
        material: as it was.
        rng: draws the tone.
        strength: how far from white the tint may be, in [0, 1].
    """
    tint = 1.0 - strength * rng.random() * rng.random(3)
    tint *= rng.uniform(0.6, 1.15)
    return replace(material, texture=as_picture(material.texture * tint))
