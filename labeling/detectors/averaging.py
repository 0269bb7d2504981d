"""The mean of several networks."""

from collections.abc import Sequence
from dataclasses import replace

import torch

from labeling.detectors.network import Network


def mean_network(networks: Sequence[Network]) -> Network:
    """The network whose weights are the means of those of others.

    Networks that were fine-tuned from the same one err differently and mostly lie in one basin of the loss, so that
    their mean is often better than any of them, and costs no more to run. Source: Wortsman et al., Model soups, 2022.

    Args:
        networks: at least one, alike in everything but their weights and where these come from. The first becomes the
            mean.

    Returns:
        The first network.

    Raises:
        ValueError: if there are none, or they differ in more than their weights.
    """
    if not networks:
        raise ValueError("no networks to average; give at least one")
    first, *others = networks
    if any(replace(one.spec, about=first.spec.about) != first.spec for one in others):
        raise ValueError("networks of different architectures, categories, input sizes or calibrations have no mean")
    states = [one.state_dict() for one in networks]
    first.load_state_dict(
        {
            name: torch.stack([state[name] for state in states]).mean(0) if value.is_floating_point() else value
            for name, value in states[0].items()
        }
    )
    return first
