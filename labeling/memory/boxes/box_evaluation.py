"""Average precision of boxes that are found in memories of a few views."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
import torch

from labeling.core.types import Box3d
from labeling.detectors3d.several_views import SceneDetection3d
from labeling.memory.boxes.box_decoding import find_boxes
from labeling.memory.boxes.box_net import BoxNet
from labeling.memory.boxes.labelled_scenes import LabelledScene
from labeling.memory.settings.grid_spec import GridSpec
from labeling.memory.view_prediction.scenes import SmallScene
from labeling.metrics.average_precision import AveragePrecision
from labeling.metrics.box_ap import BoxInstance, average_precision_3d


def spread_views(num_views: int, count: int) -> list[int]:
    """So many views, evenly over all of them, the first one first.

    >>> spread_views(10, 4), spread_views(2, 4)
    ([0, 3, 5, 8], [0, 1])
    """
    count = min(count, num_views)
    return [int(np.ceil(number * num_views / count)) for number in range(count)]


def detect_in(
    network: BoxNet, scene: SmallScene, chosen: Sequence[int], device: torch.device | str = "cpu"
) -> list[SceneDetection3d]:
    """Boxes in a memory of some views of a scene, in the world.

    Args:
        network: left in evaluation mode.
        scene: with small pictures as the network takes them.
        chosen: which of its views go into the memory; the first says which way the grid stands.
        device: where to run.
    """
    network.eval()
    with torch.inference_mode():
        output = network(scene.views(chosen, chosen[0]).to(device))
    heat, numbers = output.heat[0].sigmoid().cpu(), output.numbers[0].cpu()
    found = find_boxes(heat, numbers, network.spec.memory.grid, scene.grid_to_world(chosen[0]))
    views = tuple(scene.view_index[view] for view in chosen)
    names = network.spec.categories
    return [SceneDetection3d(views, names[category], score, box) for category, score, box in found]


def inside_grid(box: Box3d, scene: SmallScene, first: int, grid: GridSpec) -> bool:
    """Whether the middle of a box lies in the grid that view ``first`` gives."""
    place = scene.grid_to_world(first)[:3, :3].T @ (box.centre_m - scene.centre_m)
    return bool(np.all(np.abs(place) < 0.5 * np.array(grid.extent_m)))


def instances_to_find(
    labelled: LabelledScene,
    chosen: Sequence[int],
    categories: Sequence[str],
    grid: GridSpec,
    shown_by: Sequence[int] | Literal["any"] = "any",
) -> list[BoxInstance]:
    """What there is to find from some views of a scene.

    Args:
        labelled: the scene.
        chosen: views that are given.
        categories: that are known; others are left out.
        grid: of the memory; objects outside of it are to be ignored.
        shown_by: objects that none of these views shows are to be ignored; "any": that no view of the scene shows.

    Returns:
        Boxes; their ``image`` is the name of the episode, which others of another dataset may have, too.
    """
    found = []
    for one in labelled.objects:
        if one.category in categories:
            shown = one.shown_by.any() if shown_by == "any" else one.shown_by[list(shown_by)].any()
            ignore = one.ignore or not shown or not inside_grid(one.box, labelled.scene, chosen[0], grid)
            found.append(BoxInstance(labelled.scene.name, one.category, one.box, ignore=ignore))
    return found


def average_precision_of_scenes(
    found: Sequence[Sequence[SceneDetection3d]], truths: Sequence[Sequence[BoxInstance]]
) -> AveragePrecision:
    """AP of boxes of scenes, at an IoU of .25 and .5.

    Args:
        found: of each scene, the boxes that were found in it.
        truths: of each scene, in the same order, what there is to find. Scenes are told apart by their place in it.
    """
    predictions = [
        BoxInstance(scene, one.category, one.box, one.confidence) for scene, boxes in enumerate(found) for one in boxes
    ]
    return average_precision_3d(
        predictions, [replace(one, image=scene) for scene, boxes in enumerate(truths) for one in boxes]
    )


def evaluate(
    network: BoxNet, scenes: Sequence[LabelledScene], views: int, device: torch.device | str = "cpu"
) -> dict[str, float]:
    """Scores of a network on labelled scenes, from so many views that are spread evenly.

    Returns:
        ``ap25`` and ``ap50``, means over the categories that there are; ``ap``, the mean of both; ``objects``, how
        many there are to find. Objects that no given view shows are to be ignored.
    """
    was_training, grid = network.training, network.spec.memory.grid
    found, truths = [], []
    for one in scenes:
        chosen = spread_views(one.scene.num_views, views)
        found.append(detect_in(network, one.scene, chosen, device))
        truths.append(instances_to_find(one, chosen, network.spec.categories, grid, chosen))
    network.train(was_training)
    ap = average_precision_of_scenes(found, truths).mean
    ap25, ap50 = (ap[threshold] or 0.0 for threshold in (0.25, 0.5))
    objects = float(sum(not one.ignore for of_scene in truths for one in of_scene))
    return {"ap25": ap25, "ap50": ap50, "ap": 0.5 * (ap25 + ap50), "objects": objects}
