"""Calibrates a detector's labels: ``python -m experiments.calibrate_labels TRAIN [TRAIN ...] --check VAL``."""

import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from labeling.core.errors import UsageError
from labeling.runtime.cli import make_main

if TYPE_CHECKING:
    from labeling.generator.quality.label_quality import LabelQualityModel

RIGHT_IOU = 0.5
"""Labels that overlap what they name less are wrong."""
SURE = 0.5
"""Confidence from which on a label is believed; ``sure_of_wrong`` is the share of wrong ones that are."""


@dataclass(frozen=True)
class CalibrateConfig:
    """Fits what the detections of a detector are worth to recorded episodes with ground truth: what all looks at an
    object say of it (labeling.generator.objects.object_posterior), and how good labels are
    (labeling.generator.quality.label_quality).

    It goes to labeling/generator/calibration/, from where the label generator reads it. Use training scenes only.
    """

    train: tyro.conf.Positional[tuple[Annotated[Path, tyro.conf.arg(metavar="TRAIN")], ...]]
    """Datasets with detections of one detector and ground truth to fit to."""
    check: tuple[Path, ...] = ()
    """Datasets to measure the fit on, from other scenes."""
    out: Path = Path("labeling/generator/calibration")
    """Folder for the fit; its file is named for the detector."""
    results: Path | None = None
    """File for the figures; by default experiments/results/label_trust_DETECTOR.json."""
    picture: Path | None = None
    """The reliability diagram, drawn if there is anything to check;
    by default docs/pictures/label_trust_DETECTOR.png."""
    seed: int = 0
    """Of label generation."""


def run(config: CalibrateConfig) -> None:
    """Fits, writes the fit, and measures it on what is to be checked.

    Raises:
        SbmError: if a dataset cannot be read or has no ground truth.
    """
    import numpy as np

    from experiments.calibration.episodes import detector_of
    from experiments.calibration.label_samples import label_samples
    from experiments.calibration.object_samples import object_samples
    from labeling.formats.atomic import atomic_file, write_json
    from labeling.generator.calibration.detector_calibration import (
        DetectorCalibration,
        calibration_of,
        file_name,
    )
    from labeling.generator.objects.object_posterior import fit_object_model
    from labeling.generator.quality.label_quality import fit_model

    if not config.train:
        raise UsageError("give at least one dataset of training episodes")
    detector = detector_of([*config.train, *config.check])
    looks = object_samples(config.train)
    if not looks:
        raise UsageError("there is no detection on known depth in these episodes")
    calibration = DetectorCalibration(fit_object_model(looks), calibration_of().labels)
    fitted = label_samples(config.train, config.seed, calibration)
    counted = ~fitted.ignored
    if not counted.any():
        raise UsageError("no label of these episodes can be compared with ground truth")
    calibration = replace(calibration, labels=fit_model(fitted.features[counted], fitted.iou[counted]))
    provenance = {
        "command": "python -m experiments.calibrate_labels",
        "episodes": fitted.origins,
        "objects": len(looks),
        "labels": int(np.count_nonzero(counted)),
        "mean_iou": round(float(fitted.iou[counted].mean()), 4),
    }
    file = config.out / file_name(detector)
    write_json(file, {**calibration.as_json(), "fitted_to": provenance})
    print(f"calibration: {file}, from {len(looks)} objects and {provenance['labels']} labels")
    figures: dict[str, Any] = {"fitted_to": _figures(fitted, calibration.labels)}
    if config.check:
        checked = label_samples(config.check, config.seed, calibration)
        figures["checked_on"] = _figures(checked, calibration.labels)
        picture = config.picture or Path(f"docs/pictures/label_trust_{file.stem}.png")
        with atomic_file(picture) as temporary:
            _draw(figures["checked_on"], temporary)
        print(f"picture: {picture}")
    results = config.results or Path(f"experiments/results/label_trust_{file.stem}.json")
    write_json(results, figures)
    for name, record in figures.items():
        print(name, {key: record[key] for key in ("labels", "before", "after")})
    print(f"figures: {results}")


def _figures(samples, model: "LabelQualityModel") -> dict[str, Any]:
    """How honest and how good a ranking the confidences are, without the model and with it."""
    import numpy as np

    from labeling.metrics.calibration_error import calibration_curve
    from labeling.metrics.mask_ap import average_precision

    counted, wrong = ~samples.ignored, samples.iou < RIGHT_IOU
    found: dict[str, Any] = {"episodes": samples.origins, "labels": int(np.count_nonzero(counted))}
    for name, confidence in (("before", samples.confidence), ("after", model.expected_iou(samples.features))):
        curve = calibration_curve(confidence[counted], samples.iou[counted])
        assert curve is not None, "samples_of gives at least one"
        ap50 = average_precision(samples.predictions(confidence), samples.truths, (0.5,)).mean[0.5]
        assert ap50 is not None, "samples_of gives at least one object"
        found[name] = {
            "ece": round(curve.expected_calibration_error, 4),
            "mean_squared_error": round(float(np.mean((confidence - samples.iou)[counted] ** 2)), 4),
            "sure_of_wrong": round(float(np.mean(confidence[counted & wrong] >= SURE)), 4),
            "correlation": round(float(np.corrcoef(confidence[counted], samples.iou[counted])[0, 1]), 4),
            "mask_ap50": round(ap50, 4),
        }
        found[f"{name}_curve"] = {
            key: np.round(getattr(curve, key), 4).tolist() for key in ("confidence", "outcome", "count")
        }
    return found


def _draw(figures: dict[str, Any], path: Path) -> None:
    """Reliability diagrams side by side."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    figure, panels = plt.subplots(1, 2, figsize=(8.4, 4.0), sharey=True, layout="constrained")
    titles = {"before": "sources' confidence x mean probability", "after": "expected IoU"}
    for axes, (name, title) in zip(panels, titles.items(), strict=True):
        curve, record = figures[f"{name}_curve"], figures[name]
        axes.plot([0, 1], [0, 1], color="0.75", linewidth=1)
        sizes = [8 + 300 * count / sum(curve["count"]) for count in curve["count"]]
        axes.plot(curve["confidence"], curve["outcome"], color="tab:blue", linewidth=1)
        axes.scatter(curve["confidence"], curve["outcome"], s=sizes, color="tab:blue")
        axes.set(xlim=(0, 1), ylim=(0, 1), aspect="equal", xlabel="confidence of labels")
        axes.set_title(f"{title}\nECE {record['ece']:.3f}, mask AP50 {record['mask_ap50']:.3f}", fontsize=10)
    panels[0].set_ylabel("mean IoU with ground truth")
    figure.savefig(path, dpi=110, format="png")
    plt.close(figure)


main = make_main("experiments.calibrate_labels", CalibrateConfig, run)

if __name__ == "__main__":
    sys.exit(main())
