"""Named settings of the label generator: the best known, the thesis as written, and the code published with it.

``python -m labeling.generate --preset NAME`` starts from one of them; flags on the command line change single settings.
"""

from dataclasses import fields, replace
from typing import Any, Literal

from labeling.generator.settings.label_config import LabelConfig
from labeling.generator.settings.published_defects import PublishedDefects

PresetName = Literal["default", "unfitted", "paper", "released"]

PAPER = LabelConfig(
    weak_evidence=False,
    min_posterior=1.0,
    fuse_views=False,
    exclusive=False,
    erosions=1,
    dilations=4,
    seed_outliers="mean",
    crop_m=1.0,
    colour_beyond=0.0,
    gaussian_share=0.0,
    erode_doubt=0.0,
    dilate_doubt=0.0,
    refine_poses="off",
    free_space=False,
    moving=False,
    calibrate=False,
    min_confidence=0.0,
    ignore_unconfirmed=1.0,
    complete_boxes=False,
    clear_ground=False,
    level_surfaces=False,
    end_boards=False,
    thin_parts=False,
    class_sizes=False,
    votes=False,
    nested_masks=False,
    clamp_seeds=True,
    outer_share=0.5,
    appearance_weight=10.0,
    appearance_width_m=0.25,
    appearance_colour=13 / 255,
    smoothness_weight=3.0,
    smoothness_width_m=0.05,
    segment_outliers="mean",
    fill_px=0.0,
)
"""The thesis as written (4.3, A.2), with its settings for rooms.

For streets it takes ``--erosions 3 --outlier-spread 2 --crop-m 6 --max-crop-m 6`` (field notes).

Where thesis and field notes are silent, this was chosen: the kernels' weights and the width in colour are those of the
usual examples of the dense CRF that the thesis builds on (3; 10 and 13/255), their widths in space 5 and 25 cm, since
wide ones fared best in a first trial (design notes); seeds are calibrated on a fifth of the training points held out
instead of scikit-learn's five folds; points are gathered in the same voxels as by default, since that concerns cost,
not method; outliers are told along each axis, from seeds and again from finished segments, as that code means to;
"the same object" is told by the published code's rule (``per_detection.NMS_OVERLAP``).
"""

RELEASED = replace(
    PAPER,
    published=PublishedDefects(**{one.name: True for one in fields(PublishedDefects)}),
)
"""The thesis with the defects of the code that was published with it."""

UNFITTED = LabelConfig(min_posterior=0.5, class_sizes=False, calibrate=False)
"""The default without anything that was fitted to ground truth: the chance of an object is the highest confidence of
the detector in it (``labeling.generator.calibration.unfitted``), objects are those that are more likely than not, and
labels are worth this chance times the mean probability in their masks."""

PRESETS: dict[PresetName, LabelConfig] = {
    "default": LabelConfig(),
    "unfitted": UNFITTED,
    "paper": PAPER,
    "released": RELEASED,
}


def describe(config: LabelConfig) -> dict[str, Any]:
    """The preset that settings come nearest to, and which of them differ from it.

    Returns:
        ``{"preset": name, "changed": {setting: value}}``; the seed is no difference.
    """
    changes = {name: _changes(config, preset) for name, preset in PRESETS.items()}
    nearest = min(changes, key=lambda name: len(changes[name]))
    return {"preset": nearest, "changed": changes[nearest]}


def _changes(config: Any, base: Any, prefix: str = "") -> dict[str, Any]:
    found: dict[str, Any] = {}
    for one in fields(base):
        value, usual = getattr(config, one.name), getattr(base, one.name)
        if isinstance(usual, PublishedDefects):
            found |= _changes(value, usual, f"{one.name}.")
        elif value != usual and one.name != "seed":
            found[prefix + one.name] = value
    return found
