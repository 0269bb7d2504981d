"""What exporters put out, encoded here from known boxes, comes back as these boxes."""

import json
from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper

from labeling.core.detector import DetectorError
from labeling.detectors.adapters.onnx_config import FAMILIES, OnnxConfig
from labeling.detectors.adapters.onnx_layouts import read_candidates
from labeling.detectors.data.coco_names import COCO_80, COCO_90
from labeling.detectors.networks.coco_weights import coco_spec
from labeling.detectors.registry import load_detector

SIZE = (64, 96)
"""Of the input."""
NAMES = ("ball", "box", "cone")
BOXES = np.array([[8, 4, 40, 20], [30, 10, 90, 60], [50, 2, 62, 30]], np.float32)
SCORES = np.array([0.9, 0.6, 0.3], np.float32)
LABELS = np.array([2, 0, 1])


def centres(boxes=BOXES) -> np.ndarray:
    return np.concatenate([(boxes[:, :2] + boxes[:, 2:]) / 2, boxes[:, 2:] - boxes[:, :2]], axis=1)


def per_class(columns: int = 3) -> np.ndarray:
    scores = np.full((3, columns), 0.01, np.float32)
    scores[np.arange(3), LABELS] = SCORES
    return scores


def logit(p: np.ndarray) -> np.ndarray:
    return np.log(p / (1 - p)).astype(np.float32)


def unit(boxes: np.ndarray) -> np.ndarray:
    return boxes / np.array([SIZE[1], SIZE[0]] * 2, np.float32)


def grid() -> tuple[np.ndarray, np.ndarray]:
    """Cells of strides 8, 16 and 32, and these, written out."""
    cells = [
        (column, row, stride) for stride in (8, 16, 32) for row in range(64 // stride) for column in range(96 // stride)
    ]
    table = np.array(cells, np.float32)
    return table[:, :2], table[:, 2]


PLACES = np.array([14, 111, 18])
"""Cells that find the three objects."""


def dense(rows: np.ndarray, quiet: float) -> np.ndarray:
    """Rows at their places among all cells, which are quiet otherwise."""
    table = np.full((len(grid()[0]), rows.shape[1]), quiet, np.float32)
    table[PLACES] = rows
    return table


def on_grid() -> np.ndarray:
    """Boxes relative to the cells, as YOLOX leaves them."""
    cells, strides = (one[PLACES] for one in grid())
    return np.concatenate([centres()[:, :2] / strides[:, None] - cells, np.log(centres()[:, 2:] / strides[:, None])], 1)


def distributions(bins: int = 20) -> np.ndarray:
    """Logits of distances to the sides: two neighbouring bins share the probability."""
    cells, strides = (one[PLACES] for one in grid())
    centre = (cells + 0.5) * strides[:, None]
    reach = np.concatenate([centre - BOXES[:, :2], BOXES[:, 2:] - centre], axis=1) / strides[:, None]
    bins_of = np.arange(bins)
    share = np.maximum(1 - np.abs(bins_of - reach[..., None]), 1e-9)
    return np.log(share).reshape(3, -1).astype(np.float32)


def anchored() -> tuple[np.ndarray, np.ndarray]:
    """Offsets of an SSD and its anchors, y before x, as shares of the picture."""
    anchors = unit(centres() + np.array([3, -2, 4, 6], np.float32))[:, [1, 0, 3, 2]]
    wanted = unit(centres())[:, [1, 0, 3, 2]]
    offsets = np.concatenate(
        [(wanted[:, :2] - anchors[:, :2]) / anchors[:, 2:] / 0.1, np.log(wanted[:, 2:] / anchors[:, 2:]) / 0.2], axis=1
    )
    return offsets.astype(np.float32), anchors.astype(np.float32)


def with_background(first: bool) -> np.ndarray:
    """Logits of the categories and of background, which is what the scores leave."""
    rows = np.log(np.column_stack([per_class(), 1 - per_class().sum(axis=1)])).astype(np.float32)
    return np.roll(rows, 1, axis=1) if first else rows


OBJECTNESS = np.array([[1.0], [1.0], [1.0]], np.float32)
RAW_SCORES = logit(per_class())
EMPTY = np.zeros((5, 4), np.float32)
LAYOUTS = {
    "lists": ({"boxes": BOXES[None], "scores": SCORES[None], "labels": LABELS[None] + 1}, {}),
    "scores for each category": ({"boxes": BOXES, "scores": per_class()}, {}),
    "by shape": ({"a": per_class()[None], "b": BOXES[None]}, {}),
    "unit": ({"boxes": unit(BOXES), "scores": SCORES, "labels": LABELS + 1}, {}),
    "tensorflow": (
        {
            "detection_boxes": unit(BOXES)[None][:, :, [1, 0, 3, 2]],
            "detection_classes": (LABELS[None] + 1).astype(np.float32),
            "detection_scores": SCORES[None],
            "num_detections": np.array([3.0], np.float32),
        },
        {"boxes": "unit", "order": "yxyx"},
    ),
    "mmdetection": ({"dets": np.column_stack([BOXES, SCORES])[None], "labels": LABELS[None]}, {"first_label": 0}),
    "detr": (
        {"logits": with_background(first=False)[None], "pred_boxes": unit(centres())[None]},
        {"boxes": "unit", "order": "cxcywh"},
    ),
    "yolov8": ({"output0": np.column_stack([centres(), per_class()]).T[None]}, {}),
    "yolov5": ({"output": np.column_stack([centres(), OBJECTNESS, per_class()])[None]}, {}),
    "rt-detr of ultralytics": ({"output0": np.column_stack([unit(centres()), per_class()])[None]}, {}),
    "suppressed in the graph": ({"output0": np.column_stack([BOXES, SCORES, LABELS])[None]}, {}),
    "yolox, decoded": ({"output": np.column_stack([centres(), OBJECTNESS, per_class()])[None]}, {}),
    "yolox": ({"output": dense(np.column_stack([on_grid(), OBJECTNESS, per_class()]), 0.0)[None]}, {}),
    "nanodet plus": ({"output": dense(np.column_stack([per_class(), distributions(8)]), 0.0)[None]}, {}),
    "ssd": (
        {"loc": anchored()[0][None], "conf": with_background(first=True)[None], "anchors": anchored()[1]},
        {"boxes": "unit", "order": "yxyx"},
    ),
}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_layout_is_read(layout):
    outputs, settings = LAYOUTS[layout]
    outputs = {name: value.astype(np.float32) for name, value in outputs.items()}
    found = read_candidates(outputs, OnnxConfig(NAMES, **settings), SIZE)
    kept = np.flatnonzero(found.scores > 0.2)
    kept = kept[np.argsort(-found.scores[kept])]
    np.testing.assert_array_equal(found.labels[kept], LABELS)
    np.testing.assert_allclose(found.scores[kept], SCORES, atol=1e-5)
    np.testing.assert_allclose(found.boxes_xyxy[kept], BOXES, atol=1e-2)


@pytest.mark.parametrize("names", [("ball",), ("ball", "box"), NAMES], ids=len)
@pytest.mark.parametrize("masks", [0, 32])
def test_what_the_graph_has_suppressed_is_read_whatever_the_number_of_categories(names, masks):
    """Rows of corners, score and label are as wide as rows of one or two categories."""
    labels = LABELS % len(names)
    rows = np.zeros((300, 6 + masks), np.float32)
    rows[:3, :6] = np.column_stack([BOXES, SCORES, labels])
    rows[:3, 6:] = 0.5
    outputs = {"output0": rows[None]} | ({"output1": np.zeros((1, masks, 16, 24), np.float32)} if masks else {})
    found = read_candidates(outputs, OnnxConfig(names), SIZE)
    assert not found.dense
    np.testing.assert_allclose(found.scores[:3], SCORES)
    np.testing.assert_array_equal(found.labels[:3], labels)
    np.testing.assert_allclose(found.boxes_xyxy[:3], BOXES)
    assert (found.coefficients is not None) == (masks > 0)


@pytest.mark.parametrize("names", [("ball",), ("ball", "box")], ids=len)
def test_rows_as_wide_of_few_categories_that_cover_the_grid_are_dense(names):
    scores = np.zeros((3, len(names)), np.float32)
    scores[np.arange(3), LABELS % len(names)] = SCORES
    objectness = np.ones((3, 1)) if len(names) == 1 else np.zeros((3, 0))
    table = dense(np.column_stack([centres(), objectness, scores]).astype(np.float32), 0.0)
    assert table.shape[1] == 6
    found = read_candidates({"output0": table[None]}, OnnxConfig(names), SIZE)
    assert found.dense
    np.testing.assert_allclose(found.scores[PLACES], SCORES, atol=1e-5)
    np.testing.assert_allclose(found.boxes_xyxy[PLACES], BOXES, atol=1e-2)


@pytest.mark.parametrize("reverse", [False, True])
def test_distributions_of_distances_are_read_grid_by_grid_in_any_order(reverse):
    scores, sides = dense(per_class(), 0.0), dense(distributions(), 0.0)
    ends = np.cumsum([96, 24])
    parts = {f"scores{i}": one for i, one in enumerate(np.split(scores, ends))}
    parts |= {f"boxes{i}": one for i, one in enumerate(np.split(sides, ends))}
    names = sorted(parts, reverse=reverse)
    found = read_candidates({name: parts[name][None] for name in names}, OnnxConfig(NAMES), SIZE)
    kept = np.flatnonzero(found.scores > 0.2)
    kept = kept[np.argsort(-found.scores[kept])]
    np.testing.assert_array_equal(kept, PLACES)
    np.testing.assert_allclose(found.boxes_xyxy[kept], BOXES, atol=1e-2)
    assert found.dense


def test_logits_become_probabilities():
    table = np.column_stack([centres(), logit(np.full((3, 1), 0.999)), RAW_SCORES])
    found = read_candidates({"output": table[None]}, OnnxConfig(NAMES), SIZE)
    np.testing.assert_allclose(found.scores, SCORES, atol=2e-3)


@pytest.mark.parametrize(
    "outputs",
    [
        {"boxes": np.zeros((3, 7)), "scores": np.zeros(3)},
        {"boxes": np.zeros((3, 4)), "scores": np.zeros(2), "labels": np.zeros(3)},
        {"output": np.zeros((1, 9, 50))},
        {"a": np.zeros((1, 3, 8, 8, 8))},
        {"a": np.zeros((7, 3)), "b": np.zeros((7, 32))},
        {"boxes": np.zeros((3, 4)), "scores": np.zeros((3, 4)), "anchors": np.zeros((2, 4))},
    ],
)
def test_what_fits_no_layout_is_told_with_all_names_and_shapes(outputs):
    with pytest.raises(DetectorError) as told:
        read_candidates(outputs, OnnxConfig(NAMES), SIZE)
    assert "for 3 categories the graph's outputs fit no layout that is known" in str(told.value)
    for name, value in outputs.items():
        assert f"{name} {value.shape}" in str(told.value)


def test_cocos_names_are_torchvisions():
    assert coco_spec().categories == COCO_90
    assert len(COCO_80) == 80
    assert COCO_80[56:60] == ("chair", "couch", "plant", "bed")
    assert all(config.categories for config in FAMILIES.values())


# Graphs --------------------------------------------------------------------------------------------------------------


def graph(
    path: Path, outputs: dict[str, np.ndarray], shape: tuple = (1, 3, *SIZE), kind: int = TensorProto.FLOAT,
    metadata: dict[str, str] | None = None, inputs: tuple = (), constants: dict[str, np.ndarray] | None = None,
) -> Path:  # fmt: skip
    """A detector that finds the same in every picture, ready for use with ``onnx:``."""
    nodes = [
        helper.make_node("Constant", [], [name], value=numpy_helper.from_array(value))
        for name, value in outputs.items()
    ]
    made = helper.make_graph(
        nodes,
        "constant",
        [helper.make_tensor_value_info("x", kind, shape), *inputs],
        [
            helper.make_tensor_value_info(name, helper.np_dtype_to_tensor_dtype(value.dtype), value.shape)
            for name, value in outputs.items()
        ],
        [numpy_helper.from_array(value, name) for name, value in (constants or {}).items()],
    )
    model = helper.make_model(made, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    helper.set_model_props(model, metadata or {})
    onnx.save(model, path)
    return path


PICTURE = np.zeros((1, *SIZE, 3), np.uint8)


def test_a_graph_that_names_its_categories_needs_no_file_beside_it(tmp_path):
    rows = np.column_stack([centres(), per_class()]).T[None]
    names = {"names": "{0: 'potted plant', 1: 'chair', 2: 'cup'}"}
    path = graph(tmp_path / "yolo.onnx", {"output0": rows.astype(np.float32)}, metadata=names)
    detector = load_detector(f"onnx:{path}")
    assert detector.categories == ("plant", "chair", "cup")
    (found,) = detector.detect(PICTURE)
    assert found.categories == ("cup", "plant", "chair")
    np.testing.assert_allclose(found.boxes_xyxy, BOXES, atol=1e-3)
    assert found.made_here == (0, 1, 2)
    (small,) = detector.detect(np.zeros((1, 32, 32, 3), np.uint8))  # doubled and padded on the right
    np.testing.assert_allclose(small.boxes_xyxy[0], BOXES[0] / 2, atol=1e-3)


def test_masks_of_prototypes_are_the_graphs_own(tmp_path):
    prototypes = np.full((2, 16, 24), -9, np.float32)
    prototypes[0, :, :12] = 9  # the left half
    prototypes[1] = 9
    rows = np.column_stack([centres(), per_class(), [[1, 0], [0, 1], [0, 1]]]).T[None].astype(np.float32)
    names = {"names": "{0: 'a', 1: 'b', 2: 'c'}"}
    path = graph(tmp_path / "seg.onnx", {"output0": rows, "output1": prototypes[None]}, metadata=names)
    (found,) = load_detector(f"onnx:{path}").detect(PICTURE)
    assert found.made_here == ()
    for box, mask in zip(BOXES.astype(int), found.masks, strict=True):
        expected = np.zeros(SIZE, bool)
        expected[box[1] : box[3], box[0] : box[2]] = True
        np.testing.assert_array_equal(mask, expected)


def test_channels_may_come_last_as_bytes(tmp_path):
    outputs, _ = LAYOUTS["tensorflow"]
    outputs = {name: value.astype(np.float32) for name, value in outputs.items()}
    path = graph(tmp_path / "ssd.onnx", outputs, (1, *SIZE, 3), TensorProto.UINT8)
    (found,) = load_detector(f"onnx:tensorflow:{path}").detect(PICTURE)
    assert found.categories == ("car", "person", "bicycle")
    np.testing.assert_allclose(found.boxes_xyxy, BOXES, atol=1e-3)


@pytest.mark.parametrize("constant", [True, False])
def test_anchors_are_a_constant_of_the_graph_or_a_file(tmp_path, constant):
    offsets, anchors = anchored()
    path = graph(
        tmp_path / "ssd.onnx",
        {"loc": offsets[None], "conf": with_background(first=True)[None]},
        constants={"priors": anchors} if constant else {},
    )
    np.save(tmp_path / "priors.npy", anchors)
    settings = {
        "categories": NAMES,
        "anchors": "priors" if constant else "priors.npy",
        "order": "yxyx",
        "boxes": "unit",
    }
    path.with_suffix(".json").write_text(json.dumps(settings))
    (found,) = load_detector(f"onnx:{path}").detect(PICTURE)
    assert found.categories == ("cone", "ball", "box")
    np.testing.assert_allclose(found.boxes_xyxy, BOXES, atol=1e-2)
    path.with_suffix(".json").write_text(json.dumps({**settings, "anchors": "lost"}))
    with pytest.raises(DetectorError, match="the graph has no constant 'lost'"):
        load_detector(f"onnx:{path}")


def test_files_beside_a_graph_count_for_its_digest(tmp_path):
    offsets, anchors = anchored()
    outputs = {"loc": offsets[None], "conf": with_background(first=True)[None]}
    path = graph(tmp_path / "ssd.onnx", outputs, constants={"w": np.zeros(1000, np.float32)})
    external = "weights/" + "w" * 200 + ".bin"
    (tmp_path / "weights").mkdir()
    onnx.save(
        onnx.load(path), path, save_as_external_data=True, location=external, size_threshold=100, convert_attribute=True
    )
    np.save(tmp_path / "priors.npy", anchors)
    settings = {"categories": NAMES, "anchors": "priors.npy", "order": "yxyx", "boxes": "unit"}
    path.with_suffix(".json").write_text(json.dumps(settings))
    before = load_detector(f"onnx:{path}").digest
    assert load_detector(f"onnx:{path}").digest == before
    np.save(tmp_path / "priors.npy", anchors + 0.01)
    moved = load_detector(f"onnx:{path}").digest
    (tmp_path / external).write_bytes((tmp_path / external).read_bytes()[:-4] + b"\x00\x00\x80\x3f")
    assert len({before, moved, load_detector(f"onnx:{path}").digest}) == 3


def test_a_graph_is_told_the_size_that_it_asks_for(tmp_path):
    sizes = helper.make_tensor_value_info("orig_target_sizes", TensorProto.INT64, (1, 2))
    outputs = {"labels": LABELS[None], "boxes": BOXES[None], "scores": SCORES[None]}
    path = graph(tmp_path / "rtdetr.onnx", outputs, inputs=(sizes,))
    (found,) = load_detector(f"onnx:rtdetr:{path}").detect(PICTURE)
    assert found.categories == ("car", "person", "bicycle")
    other = graph(
        tmp_path / "other.onnx", outputs, inputs=(helper.make_tensor_value_info("k", TensorProto.INT64, (1,)),)
    )
    with pytest.raises(DetectorError, match="wants k beside a picture"):
        load_detector(f"onnx:rtdetr:{other}")


@pytest.mark.parametrize(("shape", "kind"), [((1, 4, 8, 8), TensorProto.FLOAT), ((1, 3, 8, 8), TensorProto.INT64)])
def test_inputs_that_are_no_pictures_are_refused(tmp_path, shape, kind):
    path = graph(tmp_path / "odd.onnx", {"boxes": BOXES, "scores": SCORES, "labels": LABELS}, shape, kind)
    with pytest.raises(
        DetectorError, match=r"takes x \[1, ., 8, 8\] of tensor\(.*\); expected pictures \(1, 3, h, w\)"
    ):
        load_detector(f"onnx:torchvision:{path}")


def test_text_that_is_no_text_is_a_damaged_file(tmp_path):
    names = {"names": "{0: 'chair'}"}
    path = graph(tmp_path / "odd.onnx", {"boxes": BOXES, "scores": SCORES, "labels": LABELS}, metadata=names)
    path.write_bytes(path.read_bytes().replace(b"chair", b"ch\xb7ir"))
    with pytest.raises(DetectorError, match="is damaged"):
        load_detector(f"onnx:torchvision:{path}")


def test_a_graph_that_wants_huge_pictures_is_refused(tmp_path):
    shape = (1, 3, 60_000, 60_000)
    path = graph(tmp_path / "huge.onnx", {"boxes": BOXES, "scores": SCORES, "labels": LABELS}, shape)
    with pytest.raises(DetectorError, match="its pictures of 60000x60000 pixels are more than"):
        load_detector(f"onnx:torchvision:{path}")
