"""1x1 convolutions against torch's own and against matrix products."""

import copy

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import nn

from labeling.detectors.networks.mask_rcnn import build_network, fused
from labeling.detectors.networks.pointwise import PointwiseConv2d, use_pointwise
from labeling.detectors.networks.spec import NetworkSpec


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 10**6),
    pictures=st.sampled_from([0, 1, 2, 17]),
    inputs=st.integers(1, 40),
    outputs=st.integers(1, 40),
    side=st.sampled_from([1, 5, 32]),
    stride=st.integers(1, 2),
    around=st.integers(0, 1),
    with_bias=st.booleans(),
    layout=st.sampled_from([torch.contiguous_format, torch.channels_last]),
)
def test_results_and_gradients_are_those_of_a_matrix_product(
    seed, pictures, inputs, outputs, side, stride, around, with_bias, layout
):
    torch.manual_seed(seed)
    layer = PointwiseConv2d(inputs, outputs, 1, stride, around, bias=with_bias)
    x = torch.randn(pictures, inputs, side, side).contiguous(memory_format=layout).requires_grad_()
    found = layer(x)
    padded = nn.functional.pad(x, (around,) * 4)[:, :, ::stride, ::stride]
    wanted = torch.einsum("bihw,oi->bohw", padded, layer.weight[:, :, 0, 0])
    if layer.bias is not None:
        wanted = wanted + layer.bias[:, None, None]
    torch.testing.assert_close(found, wanted, rtol=1e-4, atol=1e-4)
    parts, upstream = [x, *layer.parameters()], torch.randn_like(wanted)
    for ours, theirs in zip(
        torch.autograd.grad(found, parts, upstream), torch.autograd.grad(wanted, parts, upstream), strict=True
    ):
        torch.testing.assert_close(ours, theirs, rtol=1e-3, atol=1e-2)


@pytest.mark.parametrize("architecture", ["compact", "maskrcnn_resnet50_fpn"])
def test_networks_have_no_other_1x1_convolutions_not_even_as_copies_for_inference(architecture):
    network = build_network(NetworkSpec(architecture, ("ball",), short_side_px=(32, 320)))
    for one in (network, copy.deepcopy(network), fused(network)):
        kinds = {type(part) for part in one.modules() if isinstance(part, nn.Conv2d) and part.kernel_size == (1, 1)}
        assert kinds == {PointwiseConv2d}


def test_only_1x1_convolutions_are_taken_and_parameters_stay():
    layers = nn.Sequential(
        nn.Conv2d(2, 3, 1), nn.Conv2d(3, 3, 3), nn.Conv2d(3, 3, 1, padding=1, padding_mode="circular")
    )
    before = layers.state_dict()
    use_pointwise(layers)
    assert [type(one) for one in layers] == [PointwiseConv2d, nn.Conv2d, nn.Conv2d]
    after = layers.state_dict()
    assert list(after) == list(before)
    assert all(torch.equal(after[name], before[name]) for name in before)


def test_one_thread_computes_them_with_onednn():
    """What it is for: else nothing but time would tell that PyTorch's choice has changed."""
    layer, x = PointwiseConv2d(4, 4, 1), torch.randn(8, 4, 16, 16)
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with torch.profiler.profile(activities=[torch.profiler.ProfilerActivity.CPU]) as profile:
            layer(x)
    finally:
        torch.set_num_threads(before)
    name = "aten::mkldnn_convolution" if torch.backends.mkldnn.is_available() else "aten::_slow_conv2d_forward"
    assert name in {event.key for event in profile.key_averages()}
