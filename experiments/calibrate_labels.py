"""Calibrates a detector's labels: ``python -m experiments.calibrate_labels [TRAIN ...] --check VAL``."""

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from labeling.core.errors import UsageError
from labeling.runtime.cli import make_main
from labeling.runtime.help import CommandHelp

if TYPE_CHECKING:
    import numpy as np

    from experiments.calibration.label_samples import Samples
    from labeling.generator.calibration.detector_calibration import DetectorCalibration
    from labeling.generator.quality.label_quality import LabelQualityModel

RIGHT_IOU = 0.5
"""Labels that overlap what they name less are wrong."""
FOLDS = 5
"""Into how many parts training scenes are divided, each of which is judged by a fit to the others."""
PARTS = ("fitted_to", "held_out", "checked_on")
"""Of the figures: what was fitted to; the same with each part of the scenes judged by a fit to the others; other
scenes."""
DRAWS = 500
"""How often scenes are drawn for intervals."""
SURE = 0.5
"""Confidence from which on a label is believed; ``sure_of_wrong`` is the share of wrong ones that are."""


@dataclass(frozen=True)
class CalibrateConfig:
    """Fits what the detections of a detector are worth to recorded episodes with ground truth: what all looks at an
    object say of it (labeling.generator.objects.object_posterior), what its size does
    (labeling.generator.objects.object_sizes), and how good labels are (labeling.generator.quality.label_quality).

    It goes to labeling/generator/calibration/, from where the label generator reads it. Use training scenes only.
    """

    train: tyro.conf.Positional[tuple[Annotated[Path, tyro.conf.arg(metavar="TRAIN")], ...]] = ()
    """Datasets with detections of one detector and ground truth to fit to. None: the fit that there is gets measured on
    what is to be checked."""
    check: tuple[Path, ...] = ()
    """Datasets to measure the fit on, from other scenes. Besides, each part of the training scenes is judged by a fit
    to the others."""
    out: Path = Path("labeling/generator/calibration")
    """Folder for the fit; its file is named for the detector."""
    results: Path | None = None
    """File for the figures; by default experiments/results/label_trust_DETECTOR.json."""
    picture: Path | None = None
    """The reliability diagram, of what is to be checked or of the training scenes, each judged by a fit to others;
    by default docs/pictures/label_trust_DETECTOR.png."""
    keep_objects: bool = False
    """Fit sizes and the quality of labels alone, and keep what the detector's file says of objects."""
    seed: int = 0
    """Of label generation."""


def run(config: CalibrateConfig) -> None:
    """Fits, writes the fit, and measures it on what is to be checked.

    Raises:
        SbmError: if a dataset cannot be read or has no ground truth.
    """
    from experiments.calibration.episodes import detector_of
    from labeling.formats.atomic import atomic_file, write_json
    from labeling.formats.checked_json import read_json
    from labeling.generator.calibration.detector_calibration import calibration_of, file_name, is_calibrated
    from labeling.runtime.provenance import experiment_provenance

    if not config.train and not config.check:
        raise UsageError("give at least one dataset of training episodes, or with --check one to measure a fit on")
    detector = detector_of([*config.train, *config.check])
    results = config.results or Path(f"experiments/results/label_trust_{Path(file_name(detector)).stem}.json")
    if config.train:
        calibration, figures = _fit(config, detector)
    elif not is_calibrated(detector):
        raise UsageError(f"{detector} has no calibration that could be measured; give episodes to fit one to")
    else:
        calibration, figures = calibration_of(detector), read_json(results).value if results.exists() else {}
    if config.check:
        figures["checked_on"] = {
            name: _figures(some, calibration.labels.expected_iou(some.features, some.categories))
            for name, some in _labels_of(config.check, config.seed, calibration).items()
        }
        figures["checked_with"] = experiment_provenance()
    unseen = figures.get("checked_on", figures.get("held_out"))
    if unseen:
        picture = config.picture or Path(f"docs/pictures/{results.stem}.png")
        with atomic_file(picture) as temporary:
            _draw(unseen, temporary)
        print(f"picture: {picture}")
    write_json(results, figures)
    for part in PARTS:
        for name, record in figures.get(part, {}).items():
            print(part, name, {key: record[key] for key in ("labels", "before", "after", "intervals")})
    print(f"figures: {results}")


def _fit(config: CalibrateConfig, detector: str) -> tuple["DetectorCalibration", dict[str, Any]]:
    """Fits a calibration and writes it; its figures on the training scenes."""
    import numpy as np

    from experiments.calibration.label_samples import joined_samples
    from experiments.calibration.object_samples import object_samples
    from experiments.calibration.size_samples import size_samples
    from labeling.formats.atomic import write_json
    from labeling.formats.checked_json import read_json
    from labeling.generator.calibration.detector_calibration import FOLDER, calibration_of, file_name, is_calibrated
    from labeling.generator.objects.object_posterior import fit_object_model
    from labeling.generator.objects.object_sizes import fit_size_model

    file = config.out / file_name(detector)
    if config.keep_objects:
        if not is_calibrated(detector):
            raise UsageError(f"{detector} has no calibration whose model of objects could be kept")
        calibration = calibration_of(detector)
        about = read_json(FOLDER / file_name(detector)).value["fitted_to"]
        objects = {"objects": about["objects"], "objects_fitted_to": about.get("objects_fitted_to", about["episodes"])}
    else:
        looks = object_samples(config.train)
        if not looks:
            raise UsageError("there is no detection on known depth in these episodes")
        calibration = replace(calibration_of(), objects=fit_object_model(looks))
        objects = {"objects": len(looks)}
    sized = size_samples(config.train, config.seed, calibration)
    calibration = replace(calibration, sizes=fit_size_model(sized))
    parts = _labels_of(config.train, config.seed, calibration)
    fitted = joined_samples(list(parts.values()))
    counted = ~fitted.ignored
    if not counted.any():
        raise UsageError("no label of these episodes can be compared with ground truth")
    calibration = replace(calibration, labels=_fitted([fitted], [counted]))
    provenance = {
        "command": "python -m experiments.calibrate_labels",
        "episodes": fitted.origins,
        **objects,
        "sizes": len(sized),
        "labels": int(np.count_nonzero(counted)),
        "mean_iou": round(float(fitted.iou[counted].mean()), 4),
    }
    write_json(file, {**calibration.as_json(), "fitted_to": provenance})
    print(f"calibration: {file}, from {provenance['objects']} objects and {provenance['labels']} labels")
    expected = {name: calibration.labels.expected_iou(some.features, some.categories) for name, some in parts.items()}
    figures = {"fitted_to": {name: _figures(some, expected[name]) for name, some in parts.items()}}
    if len(set(fitted.scene)) > 1:
        figures["held_out"] = _held_out(parts)
    return calibration, figures


def _labels_of(datasets: Sequence[Path], seed: int, calibration: "DetectorCalibration") -> "dict[str, Samples]":
    """Labels of episodes alone, and of all episodes of a scene together."""
    from experiments.calibration.label_samples import label_samples

    return {
        name: label_samples(datasets, seed, calibration, together)
        for name, together in {"alone": False, "together": True}.items()
    }


def _held_out(parts: "Mapping[str, Samples]") -> dict[str, Any]:
    """The figures of training scenes, each part of which is judged by a model that is fitted to the others."""
    import numpy as np

    scenes = sorted({scene for some in parts.values() for scene in some.scene})
    fold = dict(zip(scenes, np.random.default_rng(0).permutation(len(scenes)) % FOLDS, strict=True))
    of_part = {name: np.array([fold[scene] for scene in some.scene]) for name, some in parts.items()}
    confidence = {name: np.zeros(len(some.iou)) for name, some in parts.items()}
    for k in sorted(set(fold.values())):
        model = _fitted([*parts.values()], [~some.ignored & (of_part[name] != k) for name, some in parts.items()])
        for name, some in parts.items():
            own = of_part[name] == k
            confidence[name][own] = model.expected_iou(some.features, some.categories)[own]
    return {name: _figures(some, confidence[name]) for name, some in parts.items()}


def _fitted(parts: "Sequence[Samples]", chosen: "Sequence[np.ndarray]") -> "LabelQualityModel":
    """The model of labels that is fitted to those chosen of each part."""
    import numpy as np

    from labeling.generator.quality.label_quality import fit_model

    features, iou, categories = (
        np.concatenate([np.asarray(getattr(some, column))[own] for some, own in zip(parts, chosen, strict=True)])
        for column in ("features", "iou", "categories")
    )
    return fit_model(features, iou, categories.tolist())


def _figures(samples: "Samples", expected: "np.ndarray") -> dict[str, Any]:
    """How honest and how good a ranking confidences are, as they were before and as expected IoU."""
    import numpy as np

    from labeling.metrics.calibration_error import calibration_curve
    from labeling.metrics.mask_ap import average_precision

    counted, wrong = ~samples.ignored, samples.iou < RIGHT_IOU
    found: dict[str, Any] = {"episodes": samples.origins, "labels": int(np.count_nonzero(counted))}
    for name, confidence in (("before", samples.confidence), ("after", expected)):
        curve = calibration_curve(confidence[counted], samples.iou[counted])
        assert curve is not None, "samples_of gives at least one"
        ap50 = average_precision(samples.predictions(confidence), samples.truths, (0.5,)).mean[0.5]
        assert ap50 is not None, "samples_of gives at least one object"
        found[name] = {
            "ece": round(curve.expected_calibration_error, 4),
            "mean_squared_error": round(float(np.mean((confidence - samples.iou)[counted] ** 2)), 4),
            "sure_of_wrong": round(_share_of_sure(confidence[counted & wrong]), 4),
            "correlation": round(float(np.corrcoef(confidence[counted], samples.iou[counted])[0, 1]), 4),
            "mask_ap50": round(ap50, 4),
        }
        found[f"{name}_curve"] = {
            key: np.round(getattr(curve, key), 4).tolist() for key in ("confidence", "outcome", "count")
        }
    found["intervals"] = _intervals(samples, expected)
    return found


def _intervals(samples: "Samples", expected: "np.ndarray") -> dict[str, list[float]]:
    """95 % intervals of figures of the expected IoU, by drawing scenes with replacement."""
    import numpy as np

    from labeling.metrics.calibration_error import calibration_curve

    counted = ~samples.ignored
    confidence, iou = expected[counted], samples.iou[counted]
    names, scene = np.unique(np.array(samples.scene)[counted], return_inverse=True)
    own = [np.flatnonzero(scene == k) for k in range(len(names))]
    rng, drawn = np.random.default_rng(0), []
    for _ in range(DRAWS):
        some = np.concatenate([own[k] for k in rng.integers(len(names), size=len(names))])
        curve, wrong = calibration_curve(confidence[some], iou[some]), some[iou[some] < RIGHT_IOU]
        assert curve is not None, "every scene has a label"
        drawn.append((curve.expected_calibration_error, _share_of_sure(confidence[wrong])))
    bounds = np.round(np.quantile(drawn, (0.025, 0.975), axis=0), 4)
    return {name: bounds[:, k].tolist() for k, name in enumerate(("ece", "sure_of_wrong"))}


def _share_of_sure(confidence: "np.ndarray") -> float:
    """The share of some labels that are believed, 0 of none."""
    return float((confidence >= SURE).mean()) if len(confidence) else 0.0


def _draw(figures: dict[str, Any], path: Path) -> None:
    """Reliability diagrams: episodes labelled alone above, together below; without the model left, with it right."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    figure, panels = plt.subplots(2, 2, figsize=(8.4, 8.0), sharex=True, sharey=True, layout="constrained")
    titles = {"before": "sources' confidence x mean probability", "after": "expected IoU"}
    cells = [(kind, name, title) for kind in figures for name, title in titles.items()]
    for axes, (kind, name, title) in zip(panels.flat, cells, strict=True):
        curve, record = figures[kind][f"{name}_curve"], figures[kind][name]
        axes.plot([0, 1], [0, 1], color="0.75", linewidth=1)
        sizes = [8 + 300 * count / sum(curve["count"]) for count in curve["count"]]
        axes.plot(curve["confidence"], curve["outcome"], color="tab:blue", linewidth=1)
        axes.scatter(curve["confidence"], curve["outcome"], s=sizes, color="tab:blue")
        axes.set(xlim=(0, 1), ylim=(0, 1), aspect="equal")
        axes.set_title(f"{kind}: {title}\nECE {record['ece']:.3f}, mask AP50 {record['mask_ap50']:.3f}", fontsize=10)
    for axes in panels[:, 0]:
        axes.set_ylabel("mean IoU with ground truth")
    for axes in panels[-1]:
        axes.set_xlabel("confidence of labels")
    figure.savefig(path, dpi=110, format="png")
    plt.close(figure)


HELP = CommandHelp(
    examples=(
        ("EPISODES", "fit to recorded episodes with ground truth"),
        ("--check UNSEEN", "measure the fit that there is on episodes of other scenes"),
    ),
)
main = make_main("experiments.calibrate_labels", CalibrateConfig, run, about=HELP)

if __name__ == "__main__":
    sys.exit(main())
