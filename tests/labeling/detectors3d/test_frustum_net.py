import copy
import json
from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import nn

from labeling.core.box_overlap import box_iou_3d
from labeling.core.detector import DetectorError
from labeling.core.errors import SbmError, UsageError
from labeling.core.types import Box3d
from labeling.detectors3d.config import NO_AUGMENTATION_3D, Train3dConfig
from labeling.detectors3d.frustum_dataset import collate, unaugmented
from labeling.detectors3d.frustum_detector import SPEC_KEY, FrustumDetector, load_network, save_network
from labeling.detectors3d.frustum_losses import FrustumBatch, corners, frustum_losses
from labeling.detectors3d.frustum_pointnet import (
    HEADINGS,
    OBJECT_POINTS,
    FrustumNet,
    FrustumSpec,
    SharedMlp,
    bin_to_heading,
    heading_to_bin,
    object_points,
)
from labeling.detectors3d.frustum_samples import median_sizes
from labeling.detectors3d.frustum_training import FrustumTask, evaluate
from labeling.detectors3d.frustums import rotation_about_z
from labeling.detectors3d.upright_boxes import decode_box
from labeling.training.loop import train
from labeling.training.weights import save_weights

from .boxed_rooms import SIDES, boxed_room, found_in, frustum_samples_of

SMALL = FrustumSpec(("crate", "locker"), tuple(SIDES.values()), width=0.25, num_points=256)


def fresh(spec: FrustumSpec = SMALL, seed: int = 0) -> FrustumNet:
    torch.manual_seed(seed)
    return FrustumNet(spec).eval()


@settings(max_examples=50)
@given(heading=st.floats(0, 3.14159))
def test_headings_go_into_bins_and_back(heading):
    number, residual = heading_to_bin(torch.tensor([heading]))
    assert 0 <= int(number) < HEADINGS
    assert abs(float(residual)) <= 1 + 1e-5
    assert np.sin(float(bin_to_heading(number, residual)) - heading) == pytest.approx(0, abs=1e-5)


@settings(max_examples=30)
@given(seed=st.integers(0, 1000))
def test_corners_are_those_of_the_box(seed):
    rng = np.random.default_rng(seed)
    numbers = np.array([*rng.uniform(-3, 3, 3), *rng.uniform(0.2, 3, 3), rng.uniform(0, np.pi)])
    row = torch.from_numpy(numbers)[None]
    np.testing.assert_allclose(corners(row[:, :3], row[:, 3:6], row[:, 6])[0], decode_box(numbers).corners(), atol=1e-9)


def test_object_points_are_the_objects():
    points = torch.rand(3, 100, 3)
    logits = torch.full((3, 100), -5.0)
    logits[0, 10:30] = 2.0  # fewer than wanted: every one of them, repeated
    logits[2] = 1.0  # all
    chosen = object_points(points, logits)
    assert chosen.shape == (3, OBJECT_POINTS, 3)
    assert {tuple(p) for p in chosen[0].tolist()} == {tuple(p) for p in points[0, 10:30].tolist()}
    assert len({tuple(p) for p in chosen[1].tolist()}) >= 1  # none: the likeliest
    assert {tuple(p) for p in chosen[2].tolist()} == {tuple(p) for p in points[2].tolist()}


def perfect_output(network: FrustumNet, batch: FrustumBatch):
    with torch.no_grad():
        output = network(batch.points, batch.category)
    rows = torch.arange(len(batch.boxes))
    number, residual = heading_to_bin(batch.boxes[:, 6])
    headings, residuals = torch.full_like(output.heading_scores, -50.0), torch.zeros_like(output.heading_residuals)
    headings[rows, number], residuals[rows, number] = 50.0, residual
    sizes, size_residuals = torch.full_like(output.size_scores, -50.0), torch.zeros_like(output.size_residuals)
    sizes[rows, batch.category] = 50.0
    size_residuals[rows, batch.category] = batch.boxes[:, 3:6] / network.sizes_m[batch.category] - 1
    return replace(
        output,
        logits=100 * (batch.foreground - 0.5),
        first_centre=batch.boxes[:, :3],
        centre=batch.boxes[:, :3],
        heading_scores=headings,
        heading_residuals=residuals,
        size_scores=sizes,
        size_residuals=size_residuals,
    )


def test_the_truth_costs_nothing_and_is_what_the_boxes_say():
    network = fresh()
    batch = collate([unaugmented(one, SMALL.categories, 256) for one in frustum_samples_of(1, 2)])
    output = perfect_output(network, batch)
    assert float(sum(frustum_losses(network, output, batch).values())) == pytest.approx(0.0, abs=1e-3)
    for found, true in zip(network.boxes(output).numpy(), batch.boxes.numpy(), strict=True):
        assert box_iou_3d(decode_box(found), decode_box(true)) == pytest.approx(1.0, abs=1e-3)


def test_a_heading_turned_by_half_costs_no_corners():
    network = fresh()
    batch = collate([unaugmented(one, SMALL.categories, 256) for one in frustum_samples_of(1)])
    output = perfect_output(network, batch)
    turned = replace(batch, boxes=batch.boxes + torch.tensor([0.0] * 6 + [torch.pi]))
    again = frustum_losses(network, perfect_output(network, turned), batch)
    assert float(again["corners"]) == pytest.approx(0.0, abs=1e-3)
    assert float(frustum_losses(network, output, batch)["corners"]) == pytest.approx(0.0, abs=1e-3)


def test_weightless_samples_teach_nothing():
    network = fresh()
    batch = collate([unaugmented(one, SMALL.categories, 256) for one in frustum_samples_of(1, 2)])
    wrong = replace(
        batch,
        boxes=torch.cat([batch.boxes[:1] * 3, batch.boxes[1:]]),
        weights=torch.tensor([0.0] + [1.0] * (len(batch.boxes) - 1)),
    )
    with torch.no_grad():
        output = network(batch.points, batch.category)
    ours = frustum_losses(network, output, wrong)
    rest = FrustumBatch(**{name: value[1:] for name, value in vars(batch).items()})
    others = replace(output, **{name: value[1:] for name, value in vars(output).items()})
    for name, value in frustum_losses(network, others, rest).items():
        assert float(ours[name]) == pytest.approx(float(value), rel=1e-4, abs=1e-5)


def test_segmentation_is_that_of_the_paper_written_out():
    """The first layer of the head in two parts is one layer on features of point and whole, put together."""
    part = fresh().segmentation
    points, category = torch.rand(2, 40, 3), torch.eye(2)
    local = part.local(points)
    whole = torch.cat([part.whole(local).amax(dim=1), category], dim=1)
    both = torch.cat([local, whole[:, None].expand(-1, 40, -1)], dim=2)
    weight = torch.cat([part.from_local.weight, part.from_whole.weight], dim=1)
    expected = part.head(part.together((both @ weight.T).flatten(0, 1))).reshape(2, 40)
    torch.testing.assert_close(part(points, category), expected)


@given(st.integers(0, 10_000), st.booleans())
@settings(max_examples=25)
def test_the_largest_of_all_points_is_that_of_all_outputs(seed, is_training):
    torch.manual_seed(seed)
    ours = SharedMlp(3, 6, 8).double().train(is_training)
    for norm in (part for part in ours.modules() if isinstance(part, nn.BatchNorm1d)):
        nn.init.normal_(norm.weight)  # of either sign
        nn.init.normal_(norm.bias)
    plain, points = copy.deepcopy(ours), torch.randn(4, 10, 3, dtype=torch.float64)
    points[:, 7:] = points[:, :3]  # as where an object has too few
    direction = torch.randn(4, 8, dtype=torch.float64)
    found, expected = ours.largest(points), plain(points).amax(dim=1)
    found.backward(direction)
    expected.backward(direction)
    assert torch.allclose(found, expected, rtol=0, atol=1e-10)
    for one, other in zip(ours.parameters(), plain.parameters(), strict=True):
        torch.testing.assert_close(one.grad, other.grad, rtol=0, atol=1e-8)
    for one, other in zip(ours.buffers(), plain.buffers(), strict=True):
        assert torch.allclose(one, other, rtol=0, atol=1e-10)


def test_the_paper_s_size():
    spec = FrustumSpec(("a", "b", "c"), ((1.0, 1.0, 1.0),) * 3)
    network = FrustumNet(spec)
    shapes = [tuple(one.weight.shape) for one in network.segmentation.modules() if isinstance(one, torch.nn.Linear)]
    assert shapes == [
        (64, 3), (64, 64), (64, 64), (128, 64), (1024, 128), (512, 64), (512, 1027), (256, 512), (128, 256), (128, 128),
        (1, 128),
    ]  # fmt: skip
    assert network.box_net.last.out_features == 3 + 2 * HEADINGS + 4 * 3


def test_doubtful_labels_are_not_learnt_from():
    some = frustum_samples_of(1, 2)
    doubted = [replace(one, weight=0.3 if one.category == some[0].category else 0.5) for one in some]
    task = FrustumTask(doubted, doubted, Train3dConfig(num_points=64, width=0.25), NO_AUGMENTATION_3D)
    assert some[0].category not in task.network.spec.categories
    assert {one.weight for one in (*task.dataset.samples, *task.validation)} == {0.5}
    sure = FrustumTask(doubted, [], Train3dConfig(num_points=64, width=0.25, least_confidence=0.3), NO_AUGMENTATION_3D)
    assert len(sure.dataset.samples) == len(some)
    with pytest.raises(UsageError, match=r"score of 0\.6 or more.*lower --least-confidence"):
        FrustumTask(doubted, [], Train3dConfig(least_confidence=0.6), NO_AUGMENTATION_3D)


@pytest.mark.nightly
def test_it_learns_a_few_objects_by_heart(tmp_path):
    some = frustum_samples_of(1, 2)[::2]
    config = Train3dConfig(
        iterations=160, batch_size=len(some), learning_rate=5e-3, num_points=128, width=0.25, validate_every=160
    )
    train(FrustumTask(some, [], config, NO_AUGMENTATION_3D), tmp_path / "run", say=lambda line: None)
    found = evaluate(load_network(tmp_path / "run" / "detector.safetensors"), some)
    assert found.right_at_50 > 0.85
    assert found.mean_iou > 0.65
    assert found.points_iou > 0.8


def test_turning_the_scene_turns_the_boxes():
    network = fresh()
    episode = boxed_room(5)
    turn = np.eye(4)
    turn[:3, :3], turn[:3, 3] = rotation_about_z(1.1), [4.0, -2.0, 0.3]
    moved = replace(episode, camera_to_world=turn @ episode.camera_to_world)
    detector = FrustumDetector(network, "fresh")
    here, there = detector.lift(episode, found_in(episode)), detector.lift(moved, found_in(episode))
    assert len(here) == len(there) == len(found_in(episode))
    for one, other in zip(here, there, strict=True):
        expected = Box3d(
            turn[:3, :3] @ one.box.centre_m + turn[:3, 3], one.box.extent_m, turn[:3, :3] @ one.box.rotation
        )
        assert box_iou_3d(expected, other.box) > 0.999
        assert one.confidence == pytest.approx(other.confidence, abs=1e-4)


def test_detections_that_cannot_be_lifted_are_passed_over():
    episode = boxed_room(5)
    detector = FrustumDetector(fresh(), "fresh")
    unknown = replace(found_in(episode)[0], category="cloud")
    empty = replace(found_in(episode)[0], mask=np.zeros_like(found_in(episode)[0].mask))
    dark = replace(episode, depth_m=np.zeros_like(episode.depth_m))
    assert detector.lift(episode, [unknown, empty]) == []
    assert detector.lift(dark, found_in(episode)) == []


@pytest.mark.slow
def test_a_killed_run_goes_on_and_ends_the_same(tmp_path):
    some = frustum_samples_of(1, 2)
    config = Train3dConfig(iterations=6, batch_size=4, num_points=64, width=0.25, validate_every=2)
    train(FrustumTask(some, some, config, NO_AUGMENTATION_3D), tmp_path / "whole", say=lambda line: None)

    def killed(line: str) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train(FrustumTask(some, some, config, NO_AUGMENTATION_3D), tmp_path / "cut", say=killed)
    said: list[str] = []
    train(FrustumTask(some, some, config, NO_AUGMENTATION_3D), tmp_path / "cut", say=said.append)
    assert said[0] == "going on from step 2"
    whole, cut = (load_network(tmp_path / name / "detector.safetensors").state_dict() for name in ("whole", "cut"))
    for name, value in whole.items():
        torch.testing.assert_close(cut[name], value, rtol=0, atol=0)
    with pytest.raises(SbmError, match="other data or settings"):
        train(FrustumTask(some, some, replace(config, seed=1), NO_AUGMENTATION_3D), tmp_path / "cut", say=said.append)


def test_weights_come_back_and_damaged_ones_are_refused(tmp_path):
    network, path = fresh(), tmp_path / "detector.safetensors"
    save_network(path, network, {})
    again = load_network(path)
    assert again.spec == network.spec
    points, category = torch.rand(2, 256, 3), torch.tensor([0, 1])
    with torch.inference_mode():
        torch.testing.assert_close(again(points, category).centre, network(points, category).centre)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(DetectorError, match="damaged"):
        load_network(path)
    with pytest.raises(DetectorError, match="no such file"):
        load_network(tmp_path / "nowhere.safetensors")
    with torch.no_grad():
        network.centre_net.last.bias[0] = float("nan")
    save_network(path, network, {})
    with pytest.raises(DetectorError, match="NaN"):
        load_network(path)


@pytest.mark.parametrize(
    ("spec", "why"),
    [
        ("{", "the description of its network is damaged"),
        ({"sizes_m": [[1, 1, 1]]}, "a size above 0 m of each"),
        ({"sizes_m": [[1, 1, 1], [1, 0, 1]]}, "a size above 0 m of each"),
        ({"categories": [], "sizes_m": []}, "knows categories"),
        ({"width": 0}, "a width above 0 and up to 8"),
        ({"num_points": 10**9}, "one to a million points"),
        ({"width": 0.5}, "its tensors are not those of a frustum PointNet for crate, locker"),
    ],
)
def test_networks_that_cannot_be_are_refused_in_one_sentence(tmp_path, spec, why):
    network, path = fresh(), tmp_path / "detector.safetensors"
    described = {"categories": ["crate", "locker"], "sizes_m": [[1, 1, 1], [1, 1, 1]], "width": network.spec.width}
    text = spec if isinstance(spec, str) else json.dumps({**described, **spec})
    save_weights(path, network, {SPEC_KEY: text})
    with pytest.raises(DetectorError, match=why):
        load_network(path)


def test_templates_are_the_median_sizes():
    some = frustum_samples_of(1, 2, 3, 4)
    for found, name in zip(median_sizes(some, ("crate", "locker")), ("crate", "locker"), strict=True):
        np.testing.assert_allclose(found, SIDES[name], atol=1e-6)
