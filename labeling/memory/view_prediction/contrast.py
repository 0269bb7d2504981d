"""What C-N3D learns from: features of the memory of some views, and features of other views by themselves.

Source: Harley et al. 2020, "Learning from Unlabelled Videos Using Contrastive Predictive Neural 3D Mapping", section
3.2; thesis 2.3.2.
"""

import torch
from torch import Tensor

from labeling.memory.networks.cn3d import Cn3d
from labeling.memory.settings.train_config import TrainMemoryConfig
from labeling.memory.view_prediction.losses import info_nce, margin_loss, pick_places
from labeling.memory.view_prediction.samples import Sample


def contrast_losses(
    network: Cn3d, batch: Sample, config: TrainMemoryConfig, generator: torch.Generator
) -> dict[str, Tensor]:
    """Terms of the loss of a batch.

    Args:
        network: with the features of ``batch.inputs`` in its memory, and of ``batch.targets`` by themselves.
        batch: views of several scenes, and others of the same.
        config: how they are compared.
        generator: of the pixels and voxels that are.

    Returns:
        ``contrast_2d`` of pixels; ``contrast_3d`` of voxels, only if some surface was seen inside of the grid.
    """
    memory, seen = network.remember(batch.inputs), network.mapper(batch.targets)
    top, bottom = network.imagine(memory, batch.targets), network.look(batch.targets.rgb)
    top, bottom = (maps.movedim(2, -1).flatten(0, -2) for maps in (top, bottom))
    pixels = pick_places(torch.ones(len(top), dtype=torch.bool), config.pairs, generator).to(top.device)
    found = {"contrast_2d": _contrast(top[pixels], bottom[pixels], config)}
    top, bottom = network.voxel_features(memory, seen)
    top = top[:, None].expand_as(bottom).movedim(2, -1).flatten(0, -2)
    bottom = bottom.movedim(2, -1).flatten(0, -2)
    voxels = pick_places(seen.occupied.flatten() > 0, config.pairs, generator)
    if len(voxels) > 1:  # a view may see no surface inside of the grid
        found["contrast_3d"] = _contrast(top[voxels], bottom[voxels], config)
    return found


def _contrast(top_down: Tensor, bottom_up: Tensor, config: TrainMemoryConfig) -> Tensor:
    if config.contrast == "info_nce":
        return info_nce(top_down, bottom_up, config.temperature)
    return margin_loss(top_down, bottom_up, config.margin, config.hard_negatives)
