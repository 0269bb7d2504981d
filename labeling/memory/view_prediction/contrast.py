"""What C-N3D learns from: features of the memory of some views, and features of other views by themselves.

Source: Harley et al. 2020, "Learning from Unlabelled Videos Using Contrastive Predictive Neural 3D Mapping", section
3.2; thesis 2.3.2.
"""

import torch
from torch import Tensor

from labeling.memory.networks.cn3d import Cn3d
from labeling.memory.settings.train_config import TrainMemoryConfig
from labeling.memory.view_prediction.losses import info_nce, margin_loss, pick_places, same_place_nce
from labeling.memory.view_prediction.samples import Sample


def contrast_losses(
    network: Cn3d, batch: Sample, config: TrainMemoryConfig, generator: torch.Generator
) -> dict[str, Tensor]:
    """Terms of the loss of a batch.

    Args:
        network: with the features of ``batch.inputs`` in its memory, and of ``batch.targets`` by themselves.
        batch: views of several scenes, others of the same, and views of other scenes.
        config: how they are compared.
        generator: of the pixels and voxels that are.

    Returns:
        ``contrast_2d`` of pixels; ``contrast_3d`` and, with others, ``same_place_3d`` of voxels, these only if some
        surface was seen inside of the grid.
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
        if batch.others is not None:
            among_others = _same_place(network, top[voxels], bottom[voxels], voxels, batch, config)
            found["same_place_3d"] = config.same_place * among_others
    return found


def _same_place(
    network: Cn3d, top_down: Tensor, bottom_up: Tensor, voxels: Tensor, batch: Sample, config: TrainMemoryConfig
) -> Tensor:
    """Against what other scenes have there. They are seen by today's weights: features of earlier ones would be told
    apart by what has changed since.
    """
    assert batch.others is not None
    with torch.no_grad():
        away = network.mapper(batch.others)
        features = network.bottom_up_voxels(away).flatten(3)  # b o e p
    places = features.shape[-1]
    scene = voxels // (places * batch.targets.rgb.shape[1])
    others = features[scene, :, :, voxels % places]
    known = away.seen.flatten(2)[scene, :, voxels % places] > 0
    return same_place_nce(top_down, bottom_up, others, known, config.temperature)


def _contrast(top_down: Tensor, bottom_up: Tensor, config: TrainMemoryConfig) -> Tensor:
    if config.contrast == "info_nce":
        return info_nce(top_down, bottom_up, config.temperature)
    return margin_loss(top_down, bottom_up, config.margin, config.hard_negatives)
