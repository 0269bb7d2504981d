"""GRNN, C-N3D, the 2-D baseline and their parts."""

import json
from dataclasses import asdict, replace

import numpy as np
import pytest
import torch

from labeling.core.detector import DetectorError
from labeling.core.errors import EpisodeFormatError, UsageError
from labeling.memory.networks.blocks import Conv3d
from labeling.memory.networks.cn3d import Cn3d
from labeling.memory.networks.conv_gru import ConvGru
from labeling.memory.networks.grnn import Grnn
from labeling.memory.networks.view_batch import Views
from labeling.memory.networks.weights import MEMORY_FILE, build_memory, load_memory, save_memory
from labeling.memory.settings.grid_spec import GridSpec
from labeling.memory.settings.memory_spec import MODELS, MemorySpec
from labeling.memory.view_prediction.scenes import SmallScene, concatenated, small_scene
from labeling.training.weights import save_weights

from .orbits import orbit_episode, ring

TINY = MemorySpec("grnn", GridSpec((8, 16, 16), 0.32), channels=8, planes=8, width=8, embedding=8, size=(32, 32))


def scene(seed: int, views: int = 6) -> SmallScene:
    return small_scene(f"toys_{seed}", orbit_episode(seed, ring(seed, views)), TINY)


def built(model: str, seed: int = 0):
    torch.manual_seed(seed)
    return build_memory(replace(TINY, model=model)).eval()


# Parts ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("dimensions", [2, 3])
def test_a_gru_of_kernels_of_one_pixel_is_the_formula_at_every_pixel(dimensions):
    torch.manual_seed(0)
    cell, grid = ConvGru(3, 2, dimensions, kernel=1), (4, 5, 6)[:dimensions]
    new, state = torch.randn(2, 3, *grid), torch.randn(2, 2, *grid)
    found = cell(new, state).detach().flatten(2)
    assert cell.gates.bias is not None
    assert cell.candidate.bias is not None
    gates, candidate = cell.gates.weight.detach().flatten(1), cell.candidate.weight.detach().flatten(1)
    for b in range(2):
        for place in range(found.shape[2]):
            x, h = new[b].flatten(1)[:, place], state[b].flatten(1)[:, place]
            z, r = torch.sigmoid(gates @ torch.cat([x, h]) + cell.gates.bias.detach()).chunk(2)
            c = torch.tanh(candidate @ torch.cat([x, r * h]) + cell.candidate.bias.detach())
            assert torch.allclose(found[b, :, place], (1 - z) * h + z * c, atol=1e-5)


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("batch", [1, 3])
@pytest.mark.parametrize("stride", [1, 2])
def test_volumes_are_convolved_as_by_pytorch(batch, stride, threads, monkeypatch):
    """However many there are, and with one thread or several: outputs and gradients."""
    monkeypatch.setattr(torch, "get_num_threads", lambda: threads)
    torch.manual_seed(0)
    theirs, ours = torch.nn.Conv3d(4, 5, 3, stride, 1), Conv3d(4, 5, 3, stride, 1)
    ours.load_state_dict(theirs.state_dict())
    volume, found = torch.randn(batch, 4, 5, 6, 7), []
    for network in (theirs, ours):
        given = volume.clone().requires_grad_()
        output = network(given)
        output.square().sum().backward()
        found.append([output, given.grad, *(one.grad for one in network.parameters())])
    for one, other in zip(*found, strict=True):
        assert one.shape == other.shape
        assert torch.allclose(one, other, rtol=1e-4, atol=1e-4)


# Networks ------------------------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("model", MODELS)
def test_every_weight_learns_and_scenes_of_a_batch_know_nothing_of_each_other(model):
    network = built(model)
    one, two, other = scene(1), scene(2), scene(3)
    given_views = concatenated([one.views([0, 2], 0), two.views([0, 2], 0)])
    cameras = concatenated([one.views([1, 3, 4], 0), two.views([1, 3, 4], 0)])
    found = network(given_views, cameras)
    side = 16 if model == "cn3d" else 32
    assert found.shape == (2, 3, 8 if model == "cn3d" else 3, side, side)
    beside_another = network(
        concatenated([one.views([0, 2], 0), other.views([0, 2], 0)]),
        concatenated([one.views([1, 3, 4], 0), other.views([1, 3, 4], 0)]),
    )
    assert torch.allclose(found[0], beside_another[0], atol=1e-4)
    assert not torch.allclose(found[1], beside_another[1], atol=1e-3)
    loss = found.square().sum() if model != "cn3d" else found[..., :8].pow(3).sum()
    if isinstance(network, Cn3d):
        memory, seen = network.remember(given_views), network.mapper(cameras)
        top, bottom = network.voxel_features(memory, seen)
        loss = loss + (top.pow(3)).sum() + bottom.pow(3).sum() + network.look(cameras.rgb).pow(3).sum()
    loss.backward()
    silent = [
        name for name, value in network.named_parameters() if value.grad is None or not value.grad.abs().sum() > 0
    ]
    assert not silent


def test_the_memory_of_cn3d_and_of_the_tower_does_not_depend_on_the_order_of_views():
    one = scene(4)
    with torch.inference_mode():
        for model in ("cn3d", "tower"):
            network = built(model)
            forwards, backwards = (network(one.views(order, 0), one.views([4], 0)) for order in ([0, 1, 2], [2, 0, 1]))
            assert torch.allclose(forwards, backwards, atol=1e-4)


def test_a_world_turned_and_moved_is_remembered_alike():
    """The grid follows the first view's heading and the fixated point, so that networks see the same numbers."""
    episode = orbit_episode(5, ring(5, 6))
    turn = np.eye(4)
    turn[:2, :2] = [[np.cos(1.1), -np.sin(1.1)], [np.sin(1.1), np.cos(1.1)]]
    turn[:3, 3] = [7.0, -3.0, 0.4]
    moved = replace(episode, camera_to_world=turn @ episode.camera_to_world)
    here, there = (small_scene("toys", one, TINY).views([0, 3], 0) for one in (episode, moved))
    assert torch.allclose(here.camera_to_grid, there.camera_to_grid, atol=1e-3)


def test_scene_arithmetic_on_memories_is_voxel_by_voxel():
    network = built("grnn")
    assert isinstance(network, Grnn)
    one, two = scene(1), scene(2)
    with torch.inference_mode():
        a, b = network.remember(one.views([0, 1], 0)), network.remember(two.views([0, 1], 0))
        back = a.plus(b).minus(b)
        assert torch.allclose(back.features, a.features, atol=1e-5)
        assert torch.all(back.occupied <= a.occupied)


# Scenes --------------------------------------------------------------------------------------------------------------


def test_small_views_see_what_large_ones_do():
    """Depth points of the small scene lie on the large picture's surface; colours are means of what they cover."""
    episode = orbit_episode(6, ring(6, 4), (96, 160))
    small = small_scene("toys", episode, replace(TINY, size=(24, 40)))
    assert small.rgb.shape == (4, 24, 40, 3)
    assert np.allclose(small.rgb[0], episode.rgb[0].reshape(24, 4, 40, 4, 3).mean(axis=(1, 3)), atol=1.0)
    assert small.depth_m.shape == (4, 48, 80)
    y, x = np.mgrid[:48, :80]
    k, large = small.depth_intrinsics[0], episode.intrinsics[0]
    for small_at, large_at, axis in ((x, 2 * x + 1, 0), (y, 2 * y + 1, 1)):
        ray = (small_at - k[axis, 2]) / k[axis, axis]
        assert np.allclose(ray, (large_at - large[axis, 2]) / large[axis, axis], atol=1e-6)
    assert np.array_equal(small.depth_m[0], episode.depth_m[0][1::2, 1::2])


def test_episodes_that_cannot_be_remembered_are_refused_in_one_sentence():
    episode = orbit_episode(7, ring(7, 2))
    with pytest.raises(
        EpisodeFormatError, match="toys: 2 of its 2 views look at the middle of the grid, fewer than the 3"
    ):
        small_scene("toys", episode, TINY)
    blind = replace(episode, depth_m=np.zeros_like(episode.depth_m))
    with pytest.raises(EpisodeFormatError, match="toys: no view has any depth"):
        small_scene("toys", blind, TINY)


# On disk -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("model", MODELS)
def test_what_is_read_is_what_was_written(tmp_path, model):
    network = built(model)
    save_memory(tmp_path / MEMORY_FILE, network, {"from": "a test"})
    again, one = load_memory(tmp_path), scene(1)
    assert again.spec == network.spec
    with torch.inference_mode():
        cameras: Views = one.views([3], 0)
        assert torch.equal(again(one.views([0, 1], 0), cameras), network(one.views([0, 1], 0), cameras))


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"channels": 7}, "is damaged"),
        ({"model": "dream"}, "is damaged"),
        ({"size": [32, 33]}, "is damaged"),
        ({"grid": {"shape": [8, 8, 1], "voxel_m": 1.0}}, "is damaged"),
        ({"channels": 12}, "tensors are not those of a memory of kind grnn"),
    ],
)
def test_files_that_are_no_memories_are_refused(tmp_path, change, why):
    content = {**asdict(TINY), **change}
    save_weights(tmp_path / MEMORY_FILE, built("grnn"), {"memory": json.dumps(content)})
    with pytest.raises(DetectorError, match=why):
        load_memory(tmp_path)
    with pytest.raises(DetectorError, match=r"no such file; give the folder of a labeling.train_memory run"):
        load_memory(tmp_path / "nowhere")


def test_specs_that_make_no_sense_are_refused():
    for change in ({"channels": 5}, {"planes": 0}, {"size": (20, 32)}):
        with pytest.raises(UsageError):
            replace(TINY, **change)
