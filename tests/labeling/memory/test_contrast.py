"""What C-N3D learns from: losses against brute force and their laws, and that every weight takes part."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from labeling.memory.networks.cn3d import Cn3d
from labeling.memory.settings.train_config import TrainMemoryConfig
from labeling.memory.view_prediction.contrast import contrast_losses
from labeling.memory.view_prediction.losses import info_nce, same_place_nce
from labeling.memory.view_prediction.samples import ViewSamples, collate

from .test_networks import built, scene

QUICK = TrainMemoryConfig(inputs=3, targets=2, pairs=32, hard_negatives=4)


def unit(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.nn.functional.normalize(torch.randn(*shape, generator=torch.Generator().manual_seed(seed)), dim=-1)


def test_same_place_nce_is_the_log_of_a_share_by_brute_force():
    top, bottom, others = unit(4, 6, seed=0), unit(4, 6, seed=1), unit(4, 3, 6, seed=2)
    counts = torch.tensor([[True, True, True], [True, False, True], [False, False, False], [False, False, True]])
    costs = []
    for i in (0, 1, 3):
        shares = torch.stack([torch.exp(top[i] @ one / 0.2) for one in (bottom[i], *others[i][counts[i]])])
        costs.append(-float((shares[0] / shares.sum()).log()))
    assert same_place_nce(top, bottom, others, counts, 0.2).item() == pytest.approx(np.mean(costs), abs=1e-4)


def test_without_any_other_there_is_nothing_to_learn_and_gradients_are_zero():
    top = unit(4, 6).requires_grad_()
    loss = same_place_nce(top, unit(4, 6, seed=1), unit(4, 3, 6, seed=2), torch.zeros(4, 3, dtype=torch.bool), 0.2)
    loss.backward()
    assert loss.item() == 0
    assert top.grad is not None
    assert not top.grad.any()


def test_features_that_only_say_where_a_voxel_is_help_among_all_places_and_not_at_the_same():
    place = torch.eye(8)  # a feature for each of eight places, whatever scene is there
    assert info_nce(place, place, 0.07).item() < 1e-4
    others, counts = place[:, None].expand(8, 5, 8), torch.ones(8, 5, dtype=torch.bool)
    assert same_place_nce(place, place, others, counts, 0.07).item() == pytest.approx(np.log(6))


@pytest.mark.parametrize("contrast", ["info_nce", "margin"])
def test_every_kind_of_contrast_reaches_all_weights(contrast):
    network = built("cn3d").train()
    assert isinstance(network, Cn3d)
    data = ViewSamples([scene(1), scene(2)], 3, 2, 2, seed=0, others=3)
    config = replace(QUICK, contrast=contrast, margin=1.0)
    for step in range(3):
        batch = collate([data[2 * step], data[2 * step + 1]])
        losses = contrast_losses(network, batch, config, torch.Generator().manual_seed(step))
        assert set(losses) == {"contrast_2d", "contrast_3d", "same_place_3d"}
        torch.stack([*losses.values()]).sum().backward()
    silent = [name for name, value in network.named_parameters() if value.grad is None or not value.grad.any()]
    assert not silent


def test_contrast_depends_on_the_batch_and_the_generator_alone():
    """Nothing is kept from earlier batches, from which a network would learn to tell weights, not places, apart."""
    network = built("cn3d").train()
    assert isinstance(network, Cn3d)
    data = ViewSamples([scene(1), scene(2)], 3, 2, 2, seed=0, others=3)
    first, other = (collate([data[number], data[number + 1]]) for number in (0, 2))
    before, _, after = (
        contrast_losses(network, batch, QUICK, torch.Generator().manual_seed(4)) for batch in (first, other, first)
    )
    assert {name: value.item() for name, value in before.items()} == {name: v.item() for name, v in after.items()}


def test_others_are_views_of_other_scenes_and_views_to_learn_from_stay_without_them():
    scenes = [scene(1), scene(2), scene(3)]
    with_others, without = (ViewSamples(scenes, 2, 1, 2, seed=5, others=count) for count in (4, 0))
    pictures = [torch.from_numpy(one.rgb).permute(0, 3, 1, 2) / 255 for one in scenes]

    def scene_of(rgb: torch.Tensor) -> int:
        return int(np.argmin([float((one - rgb).abs().flatten(1).sum(dim=1).min()) for one in pictures]))

    met = set()
    for number in range(12):
        sample, plain = with_others[number], without[number]
        assert torch.equal(sample.inputs.rgb, plain.inputs.rgb)
        assert torch.equal(sample.targets.rgb, plain.targets.rgb)
        assert plain.others is None
        assert sample.others is not None
        elsewhere = [scene_of(rgb) for rgb in sample.others.rgb[0]]
        assert len(elsewhere) == 4
        assert scene_of(sample.inputs.rgb[0, 0]) not in elsewhere
        met |= set(elsewhere)
    assert met == {0, 1, 2}
    batch = collate([with_others[0], with_others[1]])
    assert batch.others is not None
    assert batch.others.rgb.shape[:2] == (2, 4)
    assert ViewSamples(scenes[:1], 2, 1, 2, seed=5, others=4)[0].others is None
