"""The evaluation command from end to end: figures that can be worked out by hand, and what it says of bad input."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from labeling.core.types import Detection, GroundTruth
from labeling.evaluate import main, print_table
from labeling.evaluation.compare import FIGURES, categories_by_presence, evaluate_label_set

ROOT = Path(__file__).resolve().parents[2]


def metrics_of(scene, *arguments: str) -> dict:
    assert main([str(scene.labels), *arguments]) == 0
    return json.loads((scene.labels / "metrics.json").read_text())


def test_perfect_labels_score_one_and_half_outlined_detections_half(scene):
    scene.add_episode("one")
    scene.write_labels()
    metrics = metrics_of(scene)
    assert {key: metrics["pseudo_labels"][key] for key in FIGURES} == dict.fromkeys(FIGURES, pytest.approx(1))
    assert {key: metrics["detector"][key] for key in FIGURES} == {
        "mask_ap50": pytest.approx(1),  # every half reaches .5 exactly, and the false chair ranks last
        "mask_ap30": pytest.approx(1),
        "box_ap50": pytest.approx(1),
        "box_ap30": pytest.approx(1),
        "mean_iou": pytest.approx(0.5),
    }
    assert metrics["counts"] == {
        "episodes": 1,
        "views": 2,
        "ground_truth_instances": 4,
        "ignored_instances": 0,
        "detections": 6,
        "pseudo_labels": 4,
    }
    assert metrics["notes"] == []
    assert metrics["views"][1] == {
        "episode": "one",
        "view": 1,
        "ground_truth_instances": 2,
        "detector_mean_iou": 0.5,
        "pseudo_label_mean_iou": 1.0,
    }


def test_per_class_figures_are_those_of_each_class_alone(scene):
    scene.add_episode("one")
    scene.write_labels(lambda truth: ("chair", 0.9, truth.modal) if truth.category == "chair" else None)
    per_class = metrics_of(scene)["pseudo_labels"]["per_class"]
    assert list(per_class) == ["chair", "plant"]
    assert (per_class["chair"]["mask_ap50"], per_class["plant"]["mask_ap50"]) == (pytest.approx(1), 0)
    assert (per_class["chair"]["mean_iou"], per_class["plant"]["mean_iou"]) == (1, 0)
    assert per_class["plant"]["mean_iou_matched"] is None
    assert (per_class["plant"]["ground_truth_instances"], per_class["plant"]["predictions"]) == (2, 0)


def test_a_class_without_truth_is_listed_without_figures(scene):
    scene.add_episode("one")
    scene.write_labels(lambda truth: ("ghost", 0.9, truth.modal) if truth.category == "plant" else None)
    pseudo_labels = metrics_of(scene)["pseudo_labels"]
    assert pseudo_labels["per_class"]["ghost"]["mask_ap50"] is None
    assert pseudo_labels["per_class"]["ghost"]["predictions"] == 2
    assert pseudo_labels["mask_ap50"] == 0  # chair and plant, both 0


def test_tables_leave_out_classes_that_no_view_shows_and_say_so(scene, capsys):
    scene.add_episode("one")
    scene.write_labels(lambda truth: ("ghost", 0.9, truth.modal) if truth.category == "plant" else None)
    metrics = metrics_of(scene)
    capsys.readouterr()
    assert categories_by_presence(metrics) == (["chair", "plant"], ["ghost"])
    print_table(metrics)
    told = capsys.readouterr().out
    assert "views show none: ghost" in told
    assert told.count("ghost") == 1


def test_ignored_truths_do_not_count(scene):
    episode = scene.add_episode("one")
    scene.add_episode("one", ground_truth=tuple(replace(t, ignore=t.category == "plant") for t in episode.ground_truth))
    scene.write_labels(lambda truth: ("chair", 0.9, truth.modal) if truth.category == "chair" else None)
    metrics = metrics_of(scene)
    assert metrics["pseudo_labels"]["mask_ap50"] == pytest.approx(1)
    assert metrics["pseudo_labels"]["mean_iou"] == 1
    assert metrics["pseudo_labels"]["per_class"]["plant"]["mask_ap50"] is None
    assert (metrics["counts"]["ground_truth_instances"], metrics["counts"]["ignored_instances"]) == (2, 2)


def test_masks_without_a_pixel_do_not_count(scene):
    episode = scene.add_episode("one")
    hidden = np.zeros_like(episode.ground_truth[0].modal)
    scene.add_episode(
        "one",
        ground_truth=(*episode.ground_truth, GroundTruth(0, 3, "chair", hidden)),
        detections=(*episode.detections, Detection(0, "chair", 1.0, hidden)),
    )
    scene.write_labels()
    metrics = metrics_of(scene)
    assert metrics["counts"]["ground_truth_instances"] == 4
    assert metrics["detector"]["predictions"] == 6
    assert metrics["detector"]["mask_ap50"] == pytest.approx(1)


def test_amodal_figures_appear_where_ground_truth_knows_whole_objects(scene):
    episode = scene.add_episode("one")
    scene.write_labels()
    assert metrics_of(scene)["pseudo_labels"]["amodal_mask_ap50"] is None
    whole = tuple(replace(t, amodal=t.modal | np.roll(t.modal, 8, axis=1)) for t in episode.ground_truth)
    scene.add_episode("one", ground_truth=whole)
    scene.write_labels()  # labels' amodal masks are the modal ones: half of the whole
    metrics = metrics_of(scene)["pseudo_labels"]
    assert (metrics["amodal_mask_ap50"], metrics["amodal_mean_iou"]) == (pytest.approx(1), pytest.approx(0.5))
    scene.write_labels(amodal=lambda truth: (truth.category, 0.9, truth.amodal))
    assert metrics_of(scene)["pseudo_labels"]["amodal_mean_iou"] == 1


def test_both_methods_are_compared_on_the_labelled_views_only(scene):
    scene.add_episode("one")
    scene.add_episode("two", detections=())
    scene.write_labels(names=["one"])
    metrics = metrics_of(scene)
    assert metrics["counts"]["episodes"] == 1
    assert metrics["detector"]["mean_iou"] == pytest.approx(0.5)
    assert metrics["notes"] == ["in the dataset but not in the label set, left out: two"]


def test_a_missing_detector_is_undefined_and_a_blind_one_scores_zero(scene):
    scene.add_episode("one", detections=None)
    scene.write_labels()
    metrics = metrics_of(scene)
    assert {metrics["detector"][key] for key in FIGURES} == {None}
    assert {metrics["detector"]["per_class"]["chair"][key] for key in FIGURES} == {None}
    assert metrics["notes"] == ["no episode has a detections.json: the detector's figures are undefined"]
    scene.add_episode("one", detections=())
    metrics = metrics_of(scene)
    assert {metrics["detector"][key] for key in FIGURES} == {0}
    assert metrics["notes"] == []


def test_what_is_left_out_is_said(scene):
    for name in ("blind", "broken", "fine", "gone", "unclear", "untrue"):
        scene.add_episode(name, **({"detections": None} if name == "blind" else {}))
    scene.write_labels()
    scene.add_episode("untrue", ground_truth=None)
    scene.add_episode("unclear", metadata={"detector_categories": "chair"})
    (scene.dataset / "broken" / "rgb" / "000.png").write_text("")
    (scene.dataset / "gone").rename(scene.root / "elsewhere")
    metrics = metrics_of(scene)
    assert metrics["counts"]["episodes"] == 2
    notes = "\n".join(metrics["notes"])
    for expected in (
        "left out, malformed: ",
        "broken/rgb/000.png",
        "unclear/episode.json: detector_categories: must be a list of names",
        "no ground_truth.json: untrue",
        "not in the dataset, left out: gone",
        "no detections.json, counted as nothing found: blind",
    ):
        assert expected in notes


def test_categories_that_the_detector_has_no_name_for_are_left_out(scene):
    chairs = tuple(d for d in scene.add_episode("one").detections if d.category == "chair")
    scene.write_labels(lambda truth: ("chair", 0.9, truth.modal) if truth.category == "chair" else None)
    scene.add_episode("one", detections=chairs, metadata={"detector_categories": ["chair"]})
    metrics = metrics_of(scene)
    assert list(metrics["pseudo_labels"]["per_class"]) == ["chair"]
    assert metrics["pseudo_labels"]["mean_iou"] == 1
    assert metrics["counts"]["ground_truth_instances"] == 2
    assert metrics["notes"] == ["left out, categories that the detector has no name for: plant"]
    # A detector that knows plants and sees none has missed them; so has one that does not say what it knows.
    for metadata in ({"detector_categories": ["chair", "plant"]}, {}):
        scene.add_episode("one", detections=chairs, metadata=metadata)
        assert metrics_of(scene)["detector"]["per_class"]["plant"]["mean_iou"] == 0
    # Labels may name more than the detector: then both are judged on it.
    scene.write_labels()
    scene.add_episode("one", detections=chairs, metadata={"detector_categories": ["chair"]})
    assert list(metrics_of(scene)["pseudo_labels"]["per_class"]) == ["chair", "plant"]


def test_an_episode_can_be_the_dataset(scene):
    scene.add_episode("one")
    scene.write_labels(summary={"dataset": "../dataset/one"})
    assert metrics_of(scene)["counts"]["views"] == 2


def test_the_dataset_can_be_given(scene):
    scene.add_episode("one")
    scene.write_labels(summary={})
    assert metrics_of(scene, "--dataset", str(scene.dataset))["counts"]["views"] == 2


def test_the_same_input_gives_the_same_files(scene):
    for name in ("a", "b"):
        scene.add_episode(name)
    scene.write_labels()
    metrics_of(scene)
    first = [(scene.labels / name).read_bytes() for name in ("metrics.json", "report.html")]
    metrics_of(scene)
    assert first == [(scene.labels / name).read_bytes() for name in ("metrics.json", "report.html")]


@pytest.mark.slow
@settings(max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(seed=st.integers(0, 2**32 - 1))
def test_all_figures_lie_between_zero_and_one(scene, seed):
    rng = np.random.default_rng(seed)
    episode = scene.add_episode("one")

    def noise(truth):
        mask = (truth.modal & (rng.random(truth.modal.shape) < rng.random())) | (rng.random(truth.modal.shape) < 0.05)
        return (str(rng.choice(["chair", "plant", "tv"])), float(rng.random()), mask) if rng.random() < 0.8 else None

    flags = tuple(replace(t, ignore=bool(rng.random() < 0.3), amodal=t.modal) for t in episode.ground_truth)
    scene.add_episode("one", ground_truth=flags)
    scene.write_labels(noise)
    evaluation = evaluate_label_set(scene.labels)
    for method in ("detector", "pseudo_labels"):
        record = evaluation.metrics[method]
        for figures in (record, *record["per_class"].values()):
            for key, value in figures.items():
                if "ap" in key or "iou" in key:
                    assert value is None or 0 <= value <= 1
    ious = [case.pseudo_label_iou for case in evaluation.cases]
    assert ious == sorted(ious)
    mean = evaluation.metrics["pseudo_labels"]["mean_iou"]
    assert mean is None if not ious else mean == pytest.approx(np.mean(ious))


# Bad input -----------------------------------------------------------------------------------------------------------


def assert_refused(scene, capsys, *expected: str, arguments: tuple[str, ...] = ()) -> None:
    """Exit code 2, one line on standard error, and nothing written."""
    before = sorted(path.name for path in scene.root.rglob("*"))
    assert main([str(scene.labels), *arguments]) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ")
    assert error.count("\n") == 1
    for text in expected:
        assert text in error
    assert sorted(path.name for path in scene.root.rglob("*")) == before


def test_no_label_set(scene, capsys):
    assert_refused(scene, capsys, "labels: no such folder")
    scene.labels.mkdir()
    assert_refused(scene, capsys, "instances_modal.json: file is missing")


def test_no_ground_truth(scene, capsys):
    scene.add_episode("one", ground_truth=None)
    scene.episodes["one"] = replace(scene.episodes["one"], ground_truth=())
    scene.write_labels()
    assert_refused(scene, capsys, "no ground truth to compare with", "ground_truth.json")


def test_no_dataset(scene, capsys):
    scene.add_episode("one")
    scene.write_labels(summary={})
    assert_refused(scene, capsys, "give --dataset")
    assert_refused(scene, capsys, "nowhere: no such folder", arguments=("--dataset", str(scene.root / "nowhere")))


def test_another_dataset(scene, capsys):
    scene.add_episode("one")
    scene.write_labels()
    (scene.dataset / "one").rename(scene.dataset / "other")
    assert_refused(scene, capsys, "none of its 1 episodes is in the label set, which covers one")


def test_a_malformed_dataset(scene, capsys):
    scene.add_episode("one")
    scene.write_labels()
    (scene.dataset / "one" / "rgb" / "001.png").unlink()
    assert_refused(scene, capsys, "frames[1].file_path", "does not exist")


def test_negative_counts(scene, capsys):
    assert_refused(scene, capsys, "--max-strips", arguments=("--max-strips", "-1"))


def change(scene, *keys_and_value) -> None:
    *keys, last, value = keys_and_value
    path = scene.labels / "instances_modal.json"
    content = at = json.loads(path.read_text())
    for key in keys:
        at = at[key]
    at[last] = value
    path.write_text(json.dumps(content))


@pytest.mark.parametrize(
    ("keys_and_value", "expected"),
    [
        (("images", 0, "episode", 3), "images[0].episode: must be a non-empty text"),
        (("images", 0, "view", 7), "view 7 of episode 'one', which has 2 views"),
        (("images", 0, "view", -1), "view -1 of episode 'one', which has 2 views"),
        (("images", 0, "view", 1), "images[1].view: view 1 of episode 'one' is listed twice"),
        (("images", 0, "width", 0), "images[0].width: must be above 0"),
        (("images", 0, "width", 99), "must be the picture's [24, 99]"),
        (("annotations", 0, "score", 2), "annotations[0].score: a score lies in [0, 1]"),
        (("annotations", 0, "image_id", 1), "annotations[0].image_id: unknown image id 1"),
        (("annotations", 0, "category_id", 9), "annotations[0].category_id: unknown category id 9"),
        (("annotations", 0, "segmentation", "counts", "z"), "annotations[0].segmentation: RLE"),
        (("annotations", 0, "segmentation", "size", [9, 9]), "annotations[0].segmentation.size: must be"),
        (("annotations", 0, "segmentation", [[1, 2, 3]]), "annotations[0].segmentation: a polygon needs"),
        (("annotations", {}), "annotations: must be a list"),
    ],
)
def test_malformed_labels_are_named_by_file_and_field(scene, capsys, keys_and_value, expected):
    scene.add_episode("one")
    scene.write_labels()
    (scene.labels / "instances_amodal.json").unlink()
    change(scene, *keys_and_value)
    assert_refused(scene, capsys, expected)


def test_modal_and_amodal_files_must_speak_of_the_same_images(scene, capsys):
    scene.add_episode("one")
    scene.write_labels()
    change(scene, "images", 0, "view", 5)
    assert_refused(scene, capsys, "instances_amodal.json: images are not those of instances_modal.json")


def test_labels_of_another_size_than_the_views_are_refused(scene, capsys):
    scene.add_episode("one")
    scene.write_labels(modal=lambda truth: None)
    for kind in ("modal", "amodal"):
        path = scene.labels / f"instances_{kind}.json"
        path.write_text(path.read_text().replace('"width": 32', '"width": 33'))
    assert_refused(scene, capsys, "says view 0 of episode 'one' is (24, 33) pixels")


# The command ---------------------------------------------------------------------------------------------------------


def test_the_table_names_both_methods_and_every_class(scene, capsys):
    scene.add_episode("one")
    scene.write_labels(lambda truth: (f"[bold]{truth.category}[/]", 0.9, truth.modal))
    metrics_of(scene)
    output = capsys.readouterr().out
    for text in ("detector", "pseudo_labels", "0.500", "1.000", "[bold]chair[/]", "metrics.json", "report.html"):
        assert text in output


def test_help_needs_no_heavy_import():
    program = (
        "import sys\nfrom labeling.evaluate import main\n"
        "try:\n    main(['--help'])\nexcept SystemExit as leaving:\n    assert leaving.code == 0\n"
        "print(sorted({'numpy', 'cv2', 'hotcoco', 'torch', 'open3d', 'matplotlib'} & set(sys.modules)))\n"
    )
    output = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, check=True, capture_output=True, text=True
    ).stdout
    assert "LABELS" in output
    assert output.endswith("[]\n")


@pytest.mark.slow
def test_the_real_capture_labelled_with_its_own_ground_truth(apc_shelf, tmp_path):
    """Detections as labels give the detector's own figures; the two rows must then be the same."""
    episode_labels = tmp_path / "labels"
    episode_labels.mkdir()
    detections = json.loads((apc_shelf / "detections.json").read_text())
    truth = json.loads((apc_shelf / "ground_truth.json").read_text())
    images = [{**image, "episode": "apc_shelf", "view": view} for view, image in enumerate(truth["images"])]
    content = {"images": images, "categories": truth["categories"], "annotations": detections}
    (episode_labels / "instances_modal.json").write_text(json.dumps(content))
    (episode_labels / "label_set.json").write_text(json.dumps({"dataset": str(apc_shelf)}))
    assert main([str(episode_labels)]) == 0
    metrics = json.loads((episode_labels / "metrics.json").read_text())
    expected = {"mask_ap50": 0.356, "mask_ap30": 0.561, "mask_ap": 0.081, "mean_iou": 0.339}
    for method in ("detector", "pseudo_labels"):
        assert {key: metrics[method][key] for key in expected} == pytest.approx(expected, abs=5e-4)
