"""Detectors by name, from networks to exported graphs."""

import json
import warnings
from pathlib import Path
from urllib.error import URLError

import numpy as np
import pytest
import torch

from labeling.core.box_masks import mask_in_box
from labeling.core.detector import DetectorError
from labeling.core.errors import UsageError
from labeling.core.masks import mask_iou
from labeling.detectors import registry
from labeling.detectors.adapters.onnx import OnnxDetector
from labeling.detectors.networks.coco_weights import category_names_of_coco
from labeling.detectors.networks.mask_rcnn import build_network
from labeling.detectors.networks.spec import NetworkSpec
from labeling.detectors.networks.weights import save_network
from labeling.detectors.registry import check_name, detector_by_name, load_detector, load_named_network
from labeling.training.config import WEIGHTS_FILE

from ..synthetic_room import make_episode
from .toy_pictures import draw


@pytest.fixture
def run_folder(tmp_path) -> Path:
    torch.manual_seed(0)
    save_network(tmp_path / "run" / WEIGHTS_FILE, build_network(NetworkSpec("compact", ("ball", "box"))))
    return tmp_path / "run"


# Names ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["yolo", ":f", "m:", "", "compakt"])
def test_unknown_names_are_told_what_is_known(name):
    with pytest.raises(UsageError, match=r"unknown detector '.*known: compact, maskrcnn_resnet50_fpn, onnx:FILE"):
        check_name(name)


def test_a_folder_without_a_network_is_said_to_be_one(tmp_path):
    with pytest.raises(UsageError, match=r"holds no detector\.safetensors"):
        load_detector(str(tmp_path))


def test_predicted_masks_have_pixels_that_those_of_recordings_and_labels_have_not(run_folder, monkeypatch):
    box = torch.tensor([[4.0, 4.0, 20.0, 24.0]])
    output = {"boxes": box, "labels": torch.tensor([1]), "scores": torch.tensor([0.9])}
    pictures = np.zeros((1, 128, 128, 3), np.uint8)
    for make, pixels in ((load_detector, 16 * 20), (detector_by_name, 0)):
        detector = make(str(run_folder))
        monkeypatch.setattr(detector, "network", lambda *_: [{**output, "masks": torch.full((1, 1, 28, 28), 0.45)}])
        assert detector.detect(pictures)[0].masks.sum() == pixels


@pytest.mark.parametrize("threshold", [-0.1, 1.5, float("nan")])
def test_a_mask_threshold_is_a_probability(threshold):
    with pytest.raises(UsageError, match="mask_threshold is a probability, from 0 to 1, not"):
        load_detector("compact", mask_threshold=threshold)


@pytest.mark.slow
def test_a_run_is_a_detector_by_its_folder_and_by_its_file(run_folder):
    picture = draw(0)[0][None]
    first, second = load_detector(str(run_folder)), load_detector(str(run_folder / WEIGHTS_FILE), batch_size=1)
    assert first.categories == ("ball", "box")
    assert first.digest == second.digest
    np.testing.assert_array_equal(first.detect(picture)[0].masks, second.detect(picture)[0].masks)
    (run_folder / WEIGHTS_FILE).write_bytes(b"x" * 100)
    with pytest.raises(DetectorError, match="is damaged"):
        load_detector(str(run_folder))


def test_missing_weights_of_compact_name_the_command_that_makes_them(tmp_path, monkeypatch):
    monkeypatch.setattr(registry, "COMPACT_FILE", tmp_path / "compact.safetensors")
    with pytest.raises(DetectorError, match=r"python -m experiments\.pretrain_compact"):
        load_detector("compact")


def test_settings_that_make_no_sense_are_refused(run_folder):
    with pytest.raises(UsageError, match="--batch-size"):
        load_detector(str(run_folder), batch_size=0)
    with pytest.raises(UsageError, match="--device abacus: cannot be used"):
        load_detector(str(run_folder), device="abacus")
    with pytest.raises(UsageError, match="json:dumps cannot be trained here"):
        load_named_network("json:dumps")


def test_coco_weights_that_cannot_be_had_are_one_clear_sentence(monkeypatch):
    from labeling.detectors.networks.torchvision_operators import torchvision

    weights = torchvision.models.detection.MaskRCNN_ResNet50_FPN_Weights
    monkeypatch.setattr(weights, "get_state_dict", lambda *_, **__: (_ for _ in ()).throw(URLError("no network")))
    with pytest.raises(DetectorError, match=r"cannot be downloaded .*no network.* or put https://.* there"):
        load_detector("maskrcnn_resnet50_fpn")


def test_coco_names_become_ours_and_keep_their_places():
    from labeling.detectors.networks.coco_weights import coco_spec

    spec = coco_spec()
    assert len(spec.categories) == 90
    assert [spec.categories[i - 1] for i in (1, 3, 62, 63, 64, 65, 67, 70, 72, 82)] == [
        "person", "car", "chair", "couch", "plant", "bed", "table", "toilet", "tv", "fridge",
    ]  # fmt: skip
    assert spec.categories[11] == ""
    assert "" not in spec.names
    spec.check()
    assert category_names_of_coco(["__background__", "N/A", "dining table"]) == ("", "table")


@pytest.mark.slow
def test_the_network_of_the_thesis_takes_torchvisions_weights(monkeypatch):
    from labeling.detectors.networks import coco_weights as coco_network
    from labeling.detectors.networks.torchvision_operators import torchvision

    models = torchvision.models.detection
    torch.manual_seed(0)
    theirs = models.maskrcnn_resnet50_fpn(weights=None, weights_backbone=None).eval()
    for module in theirs.modules():
        if isinstance(module, torch.nn.BatchNorm2d):
            module.eps = 0.0
    state = {name: value for name, value in theirs.state_dict().items() if "num_batches" not in name}
    monkeypatch.setattr(models.MaskRCNN_ResNet50_FPN_Weights, "get_state_dict", lambda *_, **__: state)
    ours = coco_network.load_coco_network().eval()
    x = torch.rand(1, 3, 64, 64, dtype=torch.float64)  # in which sums do not hang on which library makes them
    features = [network.double().backbone(x) for network in (ours, theirs)]
    for name in features[0]:
        torch.testing.assert_close(features[0][name], features[1][name])


# Exported graphs -----------------------------------------------------------------------------------------------------


class Candidates(torch.nn.Module):
    """Turns a picture into two candidates whose values show what the picture was."""

    def __init__(self, masks: str | None = None, classes: int = 0) -> None:
        super().__init__()
        self.masks, self.classes = masks, classes

    def forward(self, x):
        mean = x.mean(dim=(2, 3))[0]
        boxes = torch.stack([torch.stack([mean[0], mean[1], mean[0] + 20, mean[1] + 10]), torch.arange(4.0) * 8])
        scores = torch.sigmoid(torch.stack([mean[2], mean[2] - 1]))
        if self.classes:
            return boxes, torch.stack([scores, 0.5 * scores], dim=1)
        labels = torch.tensor([2, 1]) + 0 * scores.long()
        if self.masks is None:
            return boxes, scores, labels
        ramp = torch.linspace(0, 1, 28) + 0 * mean[0]
        return boxes, scores, labels, ramp[None, None, None].expand(2, 1, 28, 28)


def exported(folder: Path, config: dict, size=(32, 48), **settings) -> Path:
    names = ["boxes", "scores"] + ([] if settings.get("classes") else ["labels"])
    names += ["masks"] if settings.get("masks") else []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the exporter announces its successor
        torch.onnx.export(
            Candidates(**settings), (torch.rand(1, 3, *size),), str(folder / "d.onnx"), input_names=["x"],
            output_names=names, dynamo=False,
        )  # fmt: skip
    (folder / "d.json").write_text(json.dumps({"categories": ["ball", "box"], **config}))
    return folder / "d.onnx"


def test_an_exported_detector_finds_what_the_network_found(tmp_path):
    path = exported(tmp_path, {"divide_by": 51}, masks="box")
    detector = load_detector(f"onnx:{path}")
    picture = np.full((32, 48, 3), (102, 255, 51), np.uint8)
    (found,) = detector.detect(picture[None])
    assert detector.categories == ("ball", "box")
    assert found.categories == ("box", "ball")
    np.testing.assert_allclose(found.boxes_xyxy, [[2, 5, 22, 15], [0, 8, 16, 24]], atol=1e-4)
    np.testing.assert_allclose(found.scores, 1 / (1 + np.exp([-1, 0])), atol=1e-5)
    expected = np.zeros((32, 48), bool)
    expected[5:15, 12:22] = True
    np.testing.assert_array_equal(found.masks[0], expected)


def test_boxes_come_back_in_the_pictures_own_pixels(tmp_path):
    path = exported(tmp_path, {"divide_by": 51}, masks="box")
    picture = np.full((64, 96, 3), (102, 255, 51), np.uint8)
    (found,) = OnnxDetector(path, "d").detect(picture[None])
    np.testing.assert_allclose(found.boxes_xyxy[0], [4, 10, 44, 30], atol=1e-4)
    (tmp_path / "d.json").write_text(json.dumps({"categories": ["ball", "box"], "divide_by": 51, "resize": "pad"}))
    tall = np.full((64, 48, 3), (102, 255, 51), np.uint8)
    (found,) = OnnxDetector(path, "d").detect(tall[None])
    # Padded on the right with grey: half of the input, at half its size.
    mean = (np.array([102, 255, 51]) + 114) / 2 / 51
    np.testing.assert_allclose(found.boxes_xyxy[0, :2], 2 * mean[:2], atol=1e-3)


def test_colours_are_prepared_as_the_file_says(tmp_path):
    settings = {"colour": "bgr", "divide_by": 51, "mean": [1, 0, 0], "std": [0.5, 1, 1], "first_label": 1}
    (found,) = OnnxDetector(exported(tmp_path, settings, masks="box"), "d").detect(
        np.full((1, 32, 48, 3), (102, 255, 153), np.uint8)
    )
    np.testing.assert_allclose(found.boxes_xyxy[0, :2], [(153 / 51 - 1) / 0.5, 5], atol=1e-4)


def test_scores_per_category_give_the_best_one_and_overlap_is_suppressed(tmp_path):
    path = exported(tmp_path, {"divide_by": 51, "nms_iou": 0.01}, classes=2)
    (found,) = OnnxDetector(path, "d").detect(np.full((1, 32, 48, 3), (102, 255, 51), np.uint8))
    assert found.categories == ("ball",)


def test_detectors_without_masks_get_them_from_colour_and_where_colour_fails_from_depth():
    room = make_episode(3, num_views=3, size=(120, 160), num_objects=6)
    # Hardly any colour, and noise: what is left to tell objects from walls is depth.
    dim = np.random.default_rng(0).normal(110, 12, room.rgb.shape) + 0.15 * room.rgb
    dim = dim.clip(0, 255).astype(np.uint8)
    found = []
    for truth in room.ground_truth or ():
        if truth.modal.sum() < 150:
            continue
        rows, columns = np.nonzero(truth.modal)
        box = np.array([columns.min(), rows.min(), columns.max() + 1, rows.max() + 1], np.float32)
        plain = np.zeros_like(truth.modal)
        plain[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1] = True
        view = truth.view_index
        masks = [
            plain,
            mask_in_box(room.rgb[view], box, room.depth_m[view]),
            mask_in_box(dim[view], box, None),
            mask_in_box(dim[view], box, room.depth_m[view]),
        ]
        assert not any((mask & ~plain).any() for mask in masks)
        found.append([mask_iou(mask, truth.modal) for mask in masks])
    assert len(found) >= 5
    box_only, bright, dim_colour, dim_depth = np.mean(found, axis=0)
    assert bright > box_only + 0.2
    assert dim_depth > max(box_only, dim_colour) + 0.02


def test_masks_in_boxes_without_content_are_empty_or_the_box():
    grey = np.full((40, 40, 3), 100, np.uint8)
    for box in ([5, 5, 5, 20], [-9, -9, -2, -2], [50, 50, 60, 60]):
        assert not mask_in_box(grey, np.array(box, np.float32), None).any()
    mask = mask_in_box(grey, np.array([5, 6, 15, 20], np.float32), np.zeros((40, 40), np.float32))
    assert mask[6:20, 5:15].all()
    assert mask.sum() == 140


@pytest.mark.parametrize(
    ("config", "message"),
    [
        ({"categories": []}, "categories: must be a list of names"),
        ({"colour": "cmyk"}, "colour: must be one of rgb, bgr"),
        ({"nms": 1}, "nms: unknown field; known: "),
        ({"std": [1, 0, 1]}, "std other than 0"),
        ({"outputs": {"boxes": "dets"}}, "has no output 'dets', only boxes, scores, labels"),
    ],
)
def test_descriptions_that_do_not_fit_are_refused(tmp_path, config, message):
    path = exported(tmp_path, config)
    with pytest.raises(DetectorError, match=message):
        load_detector(f"onnx:{path}")


def test_outputs_that_do_not_fit_are_refused(tmp_path):
    picture = np.zeros((1, 32, 48, 3), np.uint8)
    with pytest.raises(DetectorError, match="labels are 1 to 2, but there are 1 categories"):
        OnnxDetector(exported(tmp_path, {"categories": ["ball"]}), "d").detect(picture)
    with pytest.raises(
        DetectorError, match=r"for 3 categories .* no layout that is known .*: boxes \(2, 4\), scores \(2, 2\)"
    ):
        OnnxDetector(exported(tmp_path, {"categories": ["a", "b", "c"]}, classes=2), "d").detect(picture)


def test_missing_and_damaged_graphs_are_refused(tmp_path):
    with pytest.raises(DetectorError, match="no such file"):
        load_detector(f"onnx:{tmp_path / 'd.onnx'}")
    exported(tmp_path, {})
    (tmp_path / "d.json").unlink()
    with pytest.raises(DetectorError, match=r"needs .*d\.json with the names of its categories"):
        load_detector(f"onnx:{tmp_path / 'd.onnx'}")
    with pytest.raises(DetectorError, match="yolo9000 is no family of detectors; known: ultralytics, yolox"):
        load_detector(f"onnx:yolo9000:{tmp_path / 'd.onnx'}")
    (tmp_path / "d.onnx").write_bytes(b"no graph")
    with pytest.raises(DetectorError, match="cannot be loaded"):
        load_detector(f"onnx:{tmp_path / 'd.onnx'}")
