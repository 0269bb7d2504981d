"""What C-N3D learns from: every weight takes part, and nothing is kept from batch to batch."""

from dataclasses import replace

import pytest
import torch

from labeling.memory.networks.cn3d import Cn3d
from labeling.memory.settings.train_config import TrainMemoryConfig
from labeling.memory.view_prediction.contrast import contrast_losses
from labeling.memory.view_prediction.samples import ViewSamples, collate

from .test_networks import built, scene

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
