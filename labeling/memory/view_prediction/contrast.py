"""What C-N3D learns from: features of the memory of some views, and features of other views by themselves.

Source: Harley et al. 2020, "Learning from Unlabelled Videos Using Contrastive Predictive Neural 3D Mapping", section
3.2; thesis 2.3.2. There a view by itself is looked at without its viewpoint. So that nothing can be found again by
where it stands in a grid or in a picture, which zeros around volumes and pictures would tell, a view by itself has a
grid of its own, turned and shifted, and shows a part of its picture.
"""

import math
from dataclasses import replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn import functional

from labeling.memory.lifting.stabilisation import warp
from labeling.memory.lifting.unprojection import occupancy
from labeling.memory.lifting.voxel_grid import invert
from labeling.memory.networks.cn3d import Cn3d
from labeling.memory.networks.scene_memory import SceneMemory
from labeling.memory.networks.view_batch import Views
from labeling.memory.settings.grid_spec import GridSpec
from labeling.memory.settings.train_config import TrainMemoryConfig
from labeling.memory.view_prediction.losses import info_nce, margin_loss, pick_places
from labeling.memory.view_prediction.samples import Sample

SHIFT = 0.2
"""How far the grid of a view by itself is shifted along x and y at most, of the grid's length."""
CROP = 0.625
"""Side of the part of a picture that is shown, of the picture's."""
SIDES = 8
"""What divides sides of pictures."""
INSIDE = 0.999
"""Weight of a trilinear sample that lies wholly inside of a grid."""
Pairs = tuple[Float[Tensor, "n e"], Float[Tensor, "n e"]]
"""Features of the same pixels or voxels: top-down, bottom-up."""


def contrast_losses(
    network: Cn3d, batch: Sample, config: TrainMemoryConfig, generator: torch.Generator
) -> dict[str, Tensor]:
    """Terms of the loss of a batch.

    Args:
        network: with the features of ``batch.inputs`` in its memory, and of ``batch.targets`` by themselves.
        batch: views of several scenes, and others of the same.
        config: how they are compared.
        generator: of the pixels and voxels that are, and of where views by themselves have their grids.

    Returns:
        ``contrast_2d`` of pixels; ``contrast_3d`` of voxels, only if some surface was seen inside of both grids.
    """
    memory = network.remember(batch.inputs)
    found = {"contrast_2d": _contrast(pixel_pairs(network, memory, batch.targets, config.pairs, generator), config)}
    voxels = voxel_pairs(network, memory, batch.targets, config.pairs, generator)
    if len(voxels[0]) > 1:  # a view may see no surface inside of the grid
        found["contrast_3d"] = _contrast(voxels, config)
    return found


def pixel_pairs(network: Cn3d, memory: SceneMemory, views: Views, count: int, generator: torch.Generator) -> Pairs:
    """Features of ``count`` pixels: as the memory has them, and as a part of each view's picture tells them."""
    rgb, top = cropped(views.rgb, network.imagine(memory, views), generator)
    top, bottom = (maps.movedim(2, -1).flatten(0, -2) for maps in (top, network.look(rgb)))
    pixels = pick_places(torch.ones(len(top), dtype=torch.bool), count, generator).to(top.device)
    return top[pixels], bottom[pixels]


def cropped(
    rgb: Float[Tensor, "b t 3 h w"], maps: Float[Tensor, "b t e h2 w2"], generator: torch.Generator
) -> tuple[Float[Tensor, "b t 3 k l"], Float[Tensor, "b t e k2 l2"]]:
    """The same part, drawn for each view, of pictures and of maps of half their size."""
    size = rgb.shape[-2:]
    height, width = (max(2 * SIDES, SIDES * round(CROP * side / SIDES)) for side in size)
    parts = []
    for picture, features in zip(rgb.flatten(0, 1), maps.flatten(0, 1), strict=True):
        y, x = (
            int(torch.randint((whole - part) // 2 + 1, (), generator=generator))
            for whole, part in zip(size, (height, width), strict=True)
        )
        shown = picture[:, 2 * y : 2 * y + height, 2 * x : 2 * x + width]
        parts.append((shown, features[:, y : y + height // 2, x : x + width // 2]))
    pictures, features_of_parts = (torch.stack(some).unflatten(0, rgb.shape[:2]) for some in zip(*parts, strict=True))
    return pictures, features_of_parts


def voxel_pairs(network: Cn3d, memory: SceneMemory, views: Views, count: int, generator: torch.Generator) -> Pairs:
    """Features of at most ``count`` voxels in which views see a surface: as the memory has them, and as one of the
    views by itself has them, in a grid of its own. As many are drawn of each height, since most surface is floor; none
    twice.
    """
    grid, shape = network.spec.grid, views.camera_to_grid.shape[:2]
    memory_to_own = invert(drawn_frames(shape, grid, generator)).to(views.camera_to_grid)
    seen = network.mapper(replace(views, camera_to_grid=memory_to_own @ views.camera_to_grid))
    top, alone = network.voxel_features(memory, seen)
    to_own = memory_to_own.flatten(0, 1)
    bottom = functional.normalize(warp(alone.flatten(0, 1), to_own, grid), dim=1).unflatten(0, shape)
    both = warp(alone.new_ones(len(to_own), 1, *grid.shape), to_own, grid) > INSIDE
    depth_m, intrinsics, poses = (
        one.flatten(0, 1) for one in (views.depth_m, views.depth_intrinsics, views.camera_to_grid)
    )
    shown = (both & (occupancy(depth_m, intrinsics, poses, grid) > 0)).unflatten(0, shape)[:, :, 0].cpu()
    scenes, voxels, by = (one.to(top.device) for one in drawn_voxels(shown, count, generator))
    return top.flatten(2)[scenes, :, voxels], bottom.flatten(3)[scenes, by, :, voxels]


def drawn_frames(shape: tuple[int, ...], grid: GridSpec, generator: torch.Generator) -> Float[Tensor, "b t 4 4"]:
    """Frames of other upright grids, of which the floor is the same: ``own_to_memory``."""
    yaw = 2 * math.pi * torch.rand(shape, generator=generator)
    frames = torch.eye(4).repeat(*shape, 1, 1)
    frames[..., 0, 0] = frames[..., 1, 1] = yaw.cos()
    frames[..., 1, 0], frames[..., 0, 1] = yaw.sin(), -yaw.sin()
    frames[..., :2, 3] = (2 * torch.rand(*shape, 2, generator=generator) - 1) * SHIFT * torch.tensor(grid.extent_m[:2])
    return frames


def drawn_voxels(
    shown: Bool[Tensor, "b t z y x"], count: int, generator: torch.Generator
) -> tuple[Tensor, Tensor, Tensor]:
    """Which voxels are compared, and by which view that shows each.

    Returns:
        Indices of scenes, of voxels (flat) and of views: (n,) each.
    """
    by = torch.rand(shown.shape, generator=generator).masked_fill(~shown, -1).argmax(dim=1)
    any_view = shown.any(dim=1)
    of_level = any_view.sum(dim=(0, 2, 3), keepdim=True).clamp(min=1)
    weights = (any_view / of_level).flatten()
    number = min(count, int(any_view.sum()))
    if number == 0:
        nothing = torch.zeros(0, dtype=torch.long)
        return nothing, nothing, nothing
    picked = torch.multinomial(weights, number, generator=generator)
    scenes, voxels = picked // any_view[0].numel(), picked % any_view[0].numel()
    return scenes, voxels, by.flatten()[picked]


def _contrast(pairs: Pairs, config: TrainMemoryConfig) -> Tensor:
    top_down, bottom_up = pairs
    if config.contrast == "info_nce":
        return info_nce(top_down, bottom_up, config.temperature)
    return margin_loss(top_down, bottom_up, config.margin, config.hard_negatives)
