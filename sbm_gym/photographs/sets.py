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


@dataclass(frozen=True)
class PhotoSet:
    """Objects before a backdrop, and where a photographer can stand."""

    name: str
    spec: mujoco.MjSpec
    objects: tuple[ObjectInstance, ...]
    """Those that have a class; all else has no name."""
    subjects: tuple[ObjectInstance, ...]
    """Objects that pictures may be about."""
    solids: tuple[Box, ...]
    """Where no camera can be."""
    floor_m: tuple[float, float, float, float]
    """Where the photographer can stand: min x, min y, max x, max y."""
    ceiling_m: float
    """Cameras stay below."""
    eye_m: tuple[float, float]
    """Least and greatest height of cameras."""
    fov_rad: tuple[float, float]
    """Least and greatest horizontal field of view."""


class SetBuilder:
    """Puts pieces into a set and keeps account of its objects."""

    def __init__(self, spec: mujoco.MjSpec, library: FurnitureLibrary, rng: np.random.Generator):
        """Builds into ``spec``."""
        self.scene = SceneBuilder(spec)
        self.library, self.rng = library, rng
        self.objects: list[ObjectInstance] = []
        self.subjects: list[ObjectInstance] = []
        self.solids: list[Box] = []

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

    def photo_set(
        self,
        name: str,
        floor_m: tuple[float, float, float, float],
        ceiling_m: float,
        eye_m: tuple[float, float],
        fov_deg: tuple[float, float],
    ) -> PhotoSet:
        """The set with all that stands in it; arguments as the fields of ``PhotoSet``."""
        return PhotoSet(
            name=name,
            spec=self.scene.spec,
            objects=tuple(self.objects),
            subjects=tuple(self.subjects),
            solids=tuple(self.solids),
            floor_m=floor_m,
            ceiling_m=ceiling_m,
            eye_m=eye_m,
            fov_rad=(np.deg2rad(fov_deg[0]), np.deg2rad(fov_deg[1])),
        )


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
