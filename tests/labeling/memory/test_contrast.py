"""What C-N3D learns from: every weight takes part, and nothing is kept from batch to batch."""

from dataclasses import replace

import pytest
import torch
from torch import Tensor, nn
from torch.nn import functional

from labeling.memory.lifting.unprojection import occupancy
from labeling.memory.lifting.voxel_grid import invert, transform, voxel_centres
from labeling.memory.networks.cn3d import Cn3d
from labeling.memory.networks.mapper import MappedViews
from labeling.memory.networks.scene_memory import SceneMemory
from labeling.memory.networks.view_batch import Views
from labeling.memory.settings.train_config import TrainMemoryConfig
from labeling.memory.view_prediction import contrast as module
from labeling.memory.view_prediction.contrast import contrast_losses, cropped, drawn_voxels, voxel_pairs
from labeling.memory.view_prediction.samples import ViewSamples, collate

from .test_networks import TINY, built, scene

QUICK = TrainMemoryConfig(inputs=3, targets=2, pairs=32, hard_negatives=4)


@pytest.mark.slow
@pytest.mark.parametrize("contrast", ["info_nce", "margin"])
def test_every_kind_of_contrast_reaches_all_weights(contrast):
    network = built("cn3d").train()
    assert isinstance(network, Cn3d)
    data = ViewSamples([scene(1), scene(2)], 3, 2, 2, seed=0)
    config = replace(QUICK, contrast=contrast, margin=1.0)
    for step in range(3):
        batch = collate([data[2 * step], data[2 * step + 1]])
        losses = contrast_losses(network, batch, config, torch.Generator().manual_seed(step))
        assert set(losses) == {"contrast_2d", "contrast_3d"}
        torch.stack([*losses.values()]).sum().backward()
    silent = [name for name, value in network.named_parameters() if value.grad is None or not value.grad.any()]
    assert not silent


def test_contrast_depends_on_the_batch_and_the_generator_alone():
    """Nothing is kept from earlier batches, which a network would learn to tell by the weights that they come from."""
    network = built("cn3d").train()
    assert isinstance(network, Cn3d)
    data = ViewSamples([scene(1), scene(2)], 3, 2, 2, seed=0)
    first, other = (collate([data[number], data[number + 1]]) for number in (0, 2))
    before, _, after = (
        contrast_losses(network, batch, QUICK, torch.Generator().manual_seed(4)) for batch in (first, other, first)
    )
    assert {name: one.item() for name, one in before.items()} == {name: one.item() for name, one in after.items()}


class Remembers(nn.Module):
    """Maps nothing, and remembers where cameras were said to be."""

    def forward(self, views: Views) -> MappedViews:
        self.given = views.camera_to_grid
        empty = torch.zeros(*views.camera_to_grid.shape[:2], 1, *TINY.grid.shape)
        return MappedViews(empty, empty, empty)


class KnowsPoints(Cn3d):
    """Features of voxels are the points of the memory's frame where they lie, whatever grid they are of."""

    def __init__(self, own_to_memory: Tensor) -> None:
        super().__init__(replace(TINY, model="cn3d"))
        self.own_to_memory, self.mapper = own_to_memory, Remembers()

    def points(self, frame: Tensor) -> Tensor:
        """(b, 4, z, y, x)"""
        centres = voxel_centres(TINY.grid)
        found = transform(frame, centres.expand(len(frame), *centres.shape)).movedim(-1, 1)
        return torch.cat([found, torch.ones_like(found[:, :1])], dim=1)

    def voxel_features(self, memory: SceneMemory, seen: MappedViews) -> tuple[Tensor, Tensor]:
        batch = self.own_to_memory.shape[:2]
        top = functional.normalize(self.points(torch.eye(4).expand(batch[0], 4, 4)), dim=1)
        return top, self.points(self.own_to_memory.flatten(0, 1)).unflatten(0, batch)


def test_voxels_of_a_view_in_a_grid_of_its_own_are_those_of_the_memory(monkeypatch):
    data = ViewSamples([scene(1), scene(2)], 3, 2, 2, seed=0)
    views = collate([data[0], data[1]]).targets
    frames = module.drawn_frames((2, 2), TINY.grid, torch.Generator().manual_seed(3))
    monkeypatch.setattr(module, "drawn_frames", lambda *_: frames)
    network, nothing = KnowsPoints(frames), torch.zeros(2, 1, *TINY.grid.shape)
    top, bottom = voxel_pairs(network, SceneMemory(nothing, nothing, nothing), views, 400, torch.Generator())
    assert torch.allclose(network.mapper.given, invert(frames) @ views.camera_to_grid, atol=1e-6)
    assert len(top) > 50
    assert torch.allclose(top, bottom, atol=1e-4)
    assert len(torch.unique(top, dim=0)) > 0.4 * len(top)  # of two scenes; none twice in one
    # They lie where some view of the scene has measured a surface.
    depth_m, intrinsics, poses = (
        one.flatten(0, 1) for one in (views.depth_m, views.depth_intrinsics, views.camera_to_grid)
    )
    surface = (occupancy(depth_m, intrinsics, poses, TINY.grid) > 0).unflatten(0, (2, 2)).any(dim=1)[:, 0]
    known = functional.normalize(network.points(torch.eye(4)[None]), dim=1)[0, :, surface.any(dim=0)].T
    assert torch.cdist(top, known).amin(dim=1).max() < 1e-2


def test_frames_of_views_are_upright_rigid_and_all_different():
    frames = module.drawn_frames((3, 2), TINY.grid, torch.Generator().manual_seed(0)).flatten(0, 1)
    assert torch.allclose(frames @ invert(frames), torch.eye(4).expand(6, 4, 4), atol=1e-6)
    assert torch.equal(frames[:, 2], torch.tensor([0.0, 0, 1, 0]).expand(6, 4))
    assert len(torch.unique(frames[:, 0, 0])) == 6
    assert (frames[:, :2, 3].abs() <= module.SHIFT * torch.tensor(TINY.grid.extent_m[:2])).all()


def test_a_part_of_a_picture_is_that_of_its_features():
    rgb = torch.arange(2 * 2 * 3 * 40 * 48, dtype=torch.float).reshape(2, 2, 3, 40, 48)
    maps = rgb[..., ::2, ::2]
    starts = set()
    for seed in range(6):
        pictures, features = cropped(rgb, maps, torch.Generator().manual_seed(seed))
        assert pictures.shape == (2, 2, 3, 24, 32)
        assert torch.equal(pictures[..., ::2, ::2], features)
        starts |= {int(one[0, 0, 0]) % (40 * 48) for one in pictures.flatten(0, 1)}
    assert len(starts) > 12


def test_each_voxel_is_drawn_once_from_a_view_that_shows_it_and_every_height_as_often():
    shown = torch.zeros(2, 3, 2, 10, 10, dtype=torch.bool)
    shown[0, 1, 0] = True  # a floor of 100 voxels, and 5 above
    shown[0, 2, 0, :, :5] = True
    shown[1, 0, 1, 0, :5] = True
    counts = torch.zeros(2)
    for seed in range(200):
        scenes, voxels, views = drawn_voxels(shown, 4, torch.Generator().manual_seed(seed))
        assert len({(int(s), int(v)) for s, v in zip(scenes, voxels, strict=True)}) == 4
        assert shown.flatten(2)[scenes, views, voxels].all()
        counts += torch.bincount(voxels // 100, minlength=2)
    assert 0.4 < counts[1] / counts.sum() < 0.6
    assert len(drawn_voxels(shown, 1000, torch.Generator())[0]) == 105
    assert len(drawn_voxels(torch.zeros_like(shown), 9, torch.Generator())[0]) == 0
