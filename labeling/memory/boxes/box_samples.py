"""Some views of a labelled scene and what is to be found in them: functions of a seed and the sample's number."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor
from torch.utils.data import Dataset

from labeling.core.geometry import invert_rigid, transform_points
from labeling.detectors3d.upright_boxes import encode_box
from labeling.memory.boxes.box_decoding import in_world
from labeling.memory.boxes.box_targets import BoxTargets, GridBox, box_targets, joined
from labeling.memory.boxes.labelled_scenes import LabelledScene
from labeling.memory.lifting.voxel_grid import voxel_of
from labeling.memory.networks.view_batch import Views
from labeling.memory.settings.grid_spec import GridSpec
from labeling.memory.view_prediction.samples import BatchDraws
from labeling.memory.view_prediction.scenes import concatenated


@dataclass(frozen=True)
class BoxSample:
    """Views that go into a memory, and what is to be found in it."""

    views: Views
    targets: BoxTargets


def filled_voxels(points: Float[Tensor, "n 3"], grid: GridSpec) -> Float[Tensor, "1 1 z y x"]:
    """1 in voxels in which points of the grid's frame lie, else 0."""
    index, inside = voxel_of(grid, points)
    flat = torch.zeros(grid.shape[0] * grid.shape[1] * grid.shape[2])
    flat[index[inside]] = 1.0
    return flat.reshape(1, 1, *grid.shape)


def scene_targets(
    labelled: LabelledScene,
    chosen: Sequence[int],
    categories: Sequence[str],
    grid: GridSpec,
    trust_scores: bool = True,
) -> BoxTargets:
    """What is to be found of a scene from some of its views, in the frame of the grid that the first of them gives.

    Args:
        labelled: the scene.
        chosen: its views that go into the memory; objects that none of them shows need not be found.
        categories: that are known; objects of others are not there.
        grid: of the memory.
        trust_scores: weight objects by the confidence of their labels.
    """
    world_to_grid = invert_rigid(labelled.scene.grid_to_world(chosen[0]))
    boxes = []
    for one in labelled.objects:
        if one.category in categories:
            numbers = torch.from_numpy(encode_box(in_world(one.box, world_to_grid)).astype(np.float32))
            shown = bool(one.shown_by[list(chosen)].any())
            weight = one.weight if trust_scores else 1.0
            boxes.append(GridBox(numbers, categories.index(one.category), weight, shown and not one.ignore))
    surface = torch.from_numpy(transform_points(world_to_grid, labelled.surface).astype(np.float32))
    return replace(box_targets(boxes, len(categories), grid), filled=filled_voxels(surface, grid))


class BoxSamples(Dataset):
    """Samples to learn from: number -> ``BoxSample``."""

    def __init__(
        self,
        scenes: Sequence[LabelledScene],
        categories: Sequence[str],
        grid: GridSpec,
        views: int,
        batch_size: int,
        seed: int,
        trust_scores: bool = True,
    ) -> None:
        """Draws nothing yet.

        Args:
            scenes: to learn from.
            categories: that are known.
            grid: of the memory.
            views: that go into a memory at most; fewer in a batch with a scene that has fewer.
            batch_size: scenes in a batch; all of them have equally many views.
            seed: of all that is drawn.
            trust_scores: weight objects by the confidence of their labels.
        """
        self.scenes, self.categories, self.grid = scenes, tuple(categories), grid
        self.views, self.trust_scores = views, trust_scores
        self.draws = BatchDraws([one.scene.num_views for one in scenes], batch_size, seed)

    def __getitem__(self, number: int) -> BoxSample:
        """Views of one scene in any order, and what is to be found in them."""
        count = self.draws.count(number, min(self.views, self.draws.fewest_views(number)))
        place, rng = self.draws.scene(number)
        labelled = self.scenes[place]
        chosen = rng.permutation(labelled.scene.num_views)[:count].tolist()
        targets = scene_targets(labelled, chosen, self.categories, self.grid, self.trust_scores)
        return BoxSample(labelled.scene.views(chosen, chosen[0]), targets)


def collate(samples: Sequence[BoxSample]) -> BoxSample:
    """A batch."""
    return BoxSample(concatenated([one.views for one in samples]), joined([one.targets for one in samples]))
