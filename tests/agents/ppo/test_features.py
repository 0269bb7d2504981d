"""What the network makes of observations: shapes, and which part of them it depends on."""

import numpy as np
import pytest
import torch
from gymnasium import spaces

from agents.network.features import LookFeatures, nearness
from agents.network.policy_network import build_policy, channels_first, policy_arguments
from labeling.core.errors import UsageError
from sbm_gym.env.observations import encode_depth, observation_space
from sbm_gym.robot.object_memory import ViewBins

SIZES = [(84, 84), (64, 192)]
ACTIONS = spaces.Box(-1.0, 1.0, (4,), np.float32)


def batch(size, count=3):
    height_px, width_px = size
    space = channels_first(observation_space(height_px, width_px, ViewBins()))
    rng = torch.Generator().manual_seed(0)
    return space, {name: torch.rand((count, *(part.shape or ())), generator=rng) for name, part in space.spaces.items()}


@pytest.mark.parametrize("size", SIZES)
def test_features_come_out_as_many_as_asked_for(size):
    space, observations = batch(size)
    for features in (32, 128):
        extractor = LookFeatures(space, features)
        assert extractor(observations).shape == (3, features)
        assert extractor.features_dim == features


def test_features_of_an_observation_do_not_depend_on_the_rest_of_the_batch():
    space, observations = batch(SIZES[0])
    extractor = LookFeatures(space)
    whole = extractor(observations)
    for row in range(3):
        alone = extractor({name: part[row : row + 1] for name, part in observations.items()})
        torch.testing.assert_close(alone[0], whole[row], rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("name", ["rgb", "depth", "state"])
def test_every_part_of_the_observation_counts_and_can_be_learnt_from(name):
    space, observations = batch(SIZES[0])
    observations[name].requires_grad_()
    LookFeatures(space)(observations).square().sum().backward()
    gradient = observations[name].grad
    assert gradient is not None
    assert gradient.abs().sum() > 0


def test_pictures_can_be_left_out():
    space, observations = batch(SIZES[0])
    extractor = LookFeatures(space, pictures=())
    before = extractor(observations)
    observations["rgb"], observations["depth"] = observations["rgb"] * 0, observations["depth"] * 0
    assert torch.equal(extractor(observations), before)
    names = [name for name, _ in extractor.named_parameters()]
    assert not any(name.startswith("pictures") for name in names)


@pytest.mark.parametrize(("looks_at", "other"), [("rgb", "depth"), ("depth", "rgb")])
def test_one_picture_can_be_left_out(looks_at, other):
    space, observations = batch(SIZES[0])
    extractor = LookFeatures(space, pictures=(looks_at,))
    before = extractor(observations)
    assert torch.equal(extractor(observations | {other: observations[other] * 0}), before)
    assert not torch.equal(extractor(observations | {looks_at: observations[looks_at] * 0}), before)


def test_unknown_pictures_are_refused():
    with pytest.raises(ValueError, match="rgb and depth, not 'thermal'"):
        LookFeatures(batch(SIZES[0])[0], pictures=("thermal",))


def test_nearness_falls_with_distance_and_no_return_counts_as_far():
    depth_m = np.array([[0.04, 1.0, 5.0, 10.2, 50.0, 0.0]])
    levels = torch.from_numpy(encode_depth(depth_m)).permute(2, 0, 1)[None].float() / 255
    near = nearness(levels)[0, 0, 0].numpy()
    assert np.all(np.diff(near[:4]) < 0)
    assert near[0] > 0.99
    assert np.all(near[3:] == 0)


def test_a_shift_within_a_block_changes_nothing():
    space, observations = batch(SIZES[0], 1)
    extractor = LookFeatures(space)
    still = extractor(observations)
    patch = observations["rgb"][..., :4, :4]
    observations["rgb"] = observations["rgb"].clone()
    observations["rgb"][..., :4, :4] = patch.flip(-1)
    torch.testing.assert_close(extractor(observations), still, rtol=1e-4, atol=1e-5)


def test_the_network_sees_pictures_the_same_way_however_their_channels_lie():
    space = observation_space(84, 84, ViewBins())
    policy = build_policy(space, ACTIONS, "MultiInputPolicy", {})
    space.seed(0)
    observation = space.sample()
    turned = {name: part.transpose(2, 0, 1) if part.ndim == 3 else part for name, part in observation.items()}
    one, other = (policy.predict(given, deterministic=True)[0] for given in (observation, turned))
    assert np.array_equal(one, other)


@pytest.mark.parametrize(
    "change",
    [
        {"rgb": None},
        {"rgb": spaces.Box(0, 255, (1, 84, 84), np.uint8)},
        {"depth": spaces.Box(0, 10, (1, 84, 84), np.float32)},
        {"state": spaces.Box(-1, 1, (4, 4), np.float32)},
        {"extra": spaces.Box(-1, 1, (4,), np.float32)},
    ],
)
def test_other_observations_are_refused(change):
    space, _ = batch(SIZES[0])
    parts = {name: part for name, part in (space.spaces | change).items() if part is not None}
    with pytest.raises(ValueError, match="observations must be a Dict of rgb, depth, state"):
        LookFeatures(spaces.Dict(parts))


def test_too_small_pictures_and_unknown_arguments_are_named():
    space = observation_space(8, 8, ViewBins())
    with pytest.raises(UsageError, match="too small"):
        build_policy(space, ACTIONS, "MultiInputPolicy", {})
    with pytest.raises(UsageError, match=r"unknown argument 'lstm'.*net_arch"):
        policy_arguments({"lstm": True})
    with pytest.raises(UsageError, match=r"activation_fn must be one of .*Tanh.*, not 'Sine'"):
        policy_arguments({"activation_fn": "Sine"})
    with pytest.raises(UsageError, match="unknown policy 'CnnPolicy'"):
        build_policy(observation_space(84, 84, ViewBins()), ACTIONS, "CnnPolicy", {})
