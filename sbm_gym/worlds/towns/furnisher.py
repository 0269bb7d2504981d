"""Puts things into towns and keeps account of the floor they take."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from sbm_gym.assets.catalog.library import FurnitureLibrary, ModelCard
from sbm_gym.assets.models.model import FurnitureModel
from sbm_gym.worlds.geometry.placing import Box, Placement, overlap, rotation, yaw_quaternion
from sbm_gym.worlds.scene_builder import SceneBuilder
from sbm_gym.worlds.static_meshes import StaticMeshes, prism
from sbm_gym.worlds.towns.plan import KERB_M

MAX_TREES = 10
"""A crown is as heavy as three cars."""
STEM_HEIGHT_M = 1.3
"""What a tree or lamp has below this height is in the agent's way."""
MAX_STEM_M = 0.45
STEEL = (0.30, 0.31, 0.33, 1.0)


@dataclass
class Furnisher:
    """Puts things into a town and keeps account of the floor they take."""

    builder: SceneBuilder
    meshes: StaticMeshes
    library: FurnitureLibrary
    rng: np.random.Generator
    reserved: list[Box]
    """Floor that must stay empty: where vehicles stand."""
    obstacles: list[Box] = field(default_factory=list)
    """What the agent has to walk around."""
    _chosen: dict[str, ModelCard | None] = field(default_factory=dict)
    _counts: dict[str, int] = field(default_factory=dict)
    """Things of each use."""
    trees: int = 0
    """Trees planted so far."""

    def fits(self, box: Box, margin_m: float = 0.05) -> bool:
        """Whether nothing stands there yet."""
        return not any(overlap(box, other, margin_m) for other in (*self.reserved, *self.obstacles))

    def block(self, box: Box, height_m: float = 2.0) -> None:
        """Makes the agent walk around a box."""
        self.obstacles.append(box)
        position_m, turn = [box.x_m, box.y_m, 0.0], yaw_quaternion(box.yaw_rad)
        name = f"solid_{len(self.obstacles)}"
        body = self.builder.spec.worldbody.add_body(name=name, pos=position_m, quat=turn)
        half = np.array([box.half_x_m, box.half_y_m])
        self.builder.touched_box(body, np.concatenate([-half, half]), (0.0, height_m))

    def pick(self, use: str) -> ModelCard | None:
        """A random model for a use, None if the library has none."""
        cards = self.library.models(use)
        return cards[int(self.rng.integers(len(cards)))] if cards else None

    def town_own(self, use: str) -> ModelCard | None:
        """The model that the whole town has for a use, as towns do with benches and bins."""
        if use not in self._chosen:
            self._chosen[use] = self.pick(use)
        return self._chosen[use]

    def stand(self, card: ModelCard | None, xy: Float[np.ndarray, "2"], yaw_rad: float, z_m: float = KERB_M) -> bool:
        """Stands a thing of the library on the ground, unless something is in the way."""
        if card is None:
            return False
        model = self.library.load(card)
        rectangle = np.array([*(-0.5 * np.array(model.size_m[:2])), *(0.5 * np.array(model.size_m[:2]))])
        if model.size_m[2] > 2.2:
            rectangle = stem_rectangle(model)
        centre = xy + rotation(yaw_rad) @ (0.5 * (rectangle[:2] + rectangle[2:]))
        half = 0.5 * (rectangle[2:] - rectangle[:2])
        box = Box(float(centre[0]), float(centre[1]), float(half[0]), float(half[1]), yaw_rad)
        if not self.fits(box):
            return False
        number = self._counts.get(card.use, 0)
        self._counts[card.use] = number + 1
        body = self.builder.place(f"{card.use}_{number}", Placement(card, float(xy[0]), float(xy[1]), yaw_rad, z_m))
        self.builder.furniture(body, model)
        self.block(box, max(min(model.size_m[2], 2.2), 0.3) + z_m)
        return True

    def tree(self, card: ModelCard | None, xy: Float[np.ndarray, "2"]) -> bool:
        """Plants a tree, unless the town has enough of them."""
        if self.trees >= MAX_TREES or not self.stand(card, xy, float(self.rng.uniform(-np.pi, np.pi))):
            return False
        self.trees += 1
        return True

    def post(self, xy: Float[np.ndarray, "2"], radius_m: float, height_m: float, rgba=STEEL) -> bool:
        """An upright round post, unless something is in the way."""
        box = Box(float(xy[0]), float(xy[1]), radius_m, radius_m, 0.0)
        if not self.fits(box):
            return False
        self.meshes.plain(prism(xy, radius_m, KERB_M, KERB_M + height_m), rgba, specular=0.2)
        self.block(box)
        return True


def stem_rectangle(model: FurnitureModel) -> Float[np.ndarray, "4"]:
    """Rectangle (min x, min y, max x, max y) around what a tall model has near the ground."""
    points = np.concatenate([surface.vertices_m for surface in model.surfaces])
    low = points[points[:, 2] < max(STEM_HEIGHT_M, points[:, 2].min() + 0.2), :2]
    middle = np.median(low, axis=0)
    reach = np.clip(np.quantile(np.abs(low - middle), 0.95, axis=0), 0.08, MAX_STEM_M)
    return np.concatenate([middle - reach, middle + reach])
