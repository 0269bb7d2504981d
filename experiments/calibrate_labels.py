"""Fits how far labels can be trusted: ``python -m experiments.calibrate_labels TRAIN [TRAIN ...] --check VAL``."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from labeling.core.errors import UsageError
from labeling.runtime.cli import make_main

if TYPE_CHECKING:
    from labeling.generator.quality.label_quality import LabelQualityModel


@dataclass(frozen=True)
class CalibrateConfig:
    """Labels recorded episodes, compares each label with ground truth, and fits the model of
    labeling.generator.quality.label_quality.

    The model goes to labeling/generator/quality/label_quality.json, from where the label generator reads it.
    Use training scenes only.
    """

    train: tyro.conf.Positional[tuple[Annotated[Path, tyro.conf.arg(metavar="TRAIN")], ...]]
    """Datasets with detections and ground truth to fit to."""
    check: tuple[Path, ...] = ()
    """Datasets to measure the fit on, from other scenes."""
    out: Path = Path("labeling/generator/quality/label_quality.json")
    """The model."""
    results: Path = Path("experiments/results/label_trust.json")
    """File for the figures."""
    picture: Path = Path("docs/pictures/label_trust.png")
    """The reliability diagram; drawn if there is anything to check."""
    seed: int = 0
    """Of label generation."""


def run(config: CalibrateConfig) -> None:
    """Fits, writes the model, and measures it on what is to be checked.

    Raises:
        SbmError: if a dataset cannot be read or has no ground truth.
    """
    import numpy as np

    from experiments.calibration.label_samples import samples_of
    from labeling.formats.atomic import atomic_file, write_json
    from labeling.generator.quality.label_quality import FEATURES, fit_model

    if not config.train:
        raise UsageError("give at least one dataset of training episodes")
    fitted = samples_of(config.train, config.seed)
    counted = ~fitted.ignored
    if not counted.any():
        raise UsageError("no label of these episodes can be compared with ground truth")
    model = fit_model(fitted.features[counted], fitted.iou[counted])
    rows = {
        name: {"mean": float(model.mean[i]), "scale": float(model.scale[i]), "weight": float(model.weight[i])}
        for i, name in enumerate(FEATURES)
    }
    provenance = {
        "command": "python -m experiments.calibrate_labels",
        "episodes": fitted.origins,
        "labels": int(np.count_nonzero(counted)),
        "mean_iou": round(float(fitted.iou[counted].mean()), 4),
    }
    write_json(config.out, {"features": rows, "intercept": model.intercept, "fitted_to": provenance})
    print(f"model: {config.out}, from {provenance['labels']} labels of {len(fitted.origins)} episodes")
    figures: dict[str, Any] = {"fitted_to": _figures(fitted, model)}
    if config.check:
        checked = samples_of(config.check, config.seed)
        figures["checked_on"] = _figures(checked, model)
        with atomic_file(config.picture) as temporary:
            _draw(figures["checked_on"], temporary)
        print(f"picture: {config.picture}")
    write_json(config.results, figures)
    for name, record in figures.items():
        print(name, {key: record[key] for key in ("labels", "before", "after")})
    print(f"figures: {config.results}")


def _figures(samples, model: "LabelQualityModel") -> dict[str, Any]:
    """How honest and how good a ranking the confidences are, without the model and with it."""
    import numpy as np

    from labeling.metrics.calibration_error import calibration_curve
    from labeling.metrics.mask_ap import average_precision

    counted = ~samples.ignored
    found: dict[str, Any] = {"episodes": samples.origins, "labels": int(np.count_nonzero(counted))}
    for name, confidence in (("before", samples.confidence), ("after", model.expected_iou(samples.features))):
        curve = calibration_curve(confidence[counted], samples.iou[counted])
        assert curve is not None, "samples_of gives at least one"
        ap50 = average_precision(samples.predictions(confidence), samples.truths, (0.5,)).mean[0.5]
        assert ap50 is not None, "samples_of gives at least one object"
        found[name] = {
            "ece": round(curve.expected_calibration_error, 4),
            "mean_squared_error": round(float(np.mean((confidence - samples.iou)[counted] ** 2)), 4),
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
