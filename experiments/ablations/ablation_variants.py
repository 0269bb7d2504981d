"""What the label ablation varies: one setting at a time around the default. A new row is a new variant."""

from dataclasses import dataclass, field, replace
from typing import Any

from experiments.cache.stages import Scale
from labeling.generator.settings.label_config import LabelConfig


@dataclass(frozen=True)
class Variant:
    """The default with some settings changed."""

    name: str
    changes: dict[str, Any]
    quick: bool = True
    """Not for the full scale only."""

    def config(self, seed: int) -> LabelConfig:
        """The settings."""
        return replace(LabelConfig(seed=seed), **self.changes)


@dataclass(frozen=True)
class Factor:
    """One question about the defaults, and the answers tried besides the default."""

    title: str
    settings: tuple[str, ...]
    """Fields of ``LabelConfig`` whose default it is about."""
    why: str
    """What the default does and what it is for."""
    variants: tuple[Variant, ...] = field(default_factory=tuple)


def _steps(setting: str, quick: tuple[Any, ...], full: tuple[Any, ...] = ()) -> tuple[Variant, ...]:
    """One variant for each value of a setting."""
    values = sorted({*quick, *full})
    return tuple(Variant(f"{setting} {value:g}", {setting: value}, value in quick) for value in values)


FACTORS = (
    Factor(
        "Classifier",
        ("gaussian_share", "votes", "clamp_seeds"),
        "Each object has a classifier on colour and position, learnt from its seeds: an SVM, averaged with a Gaussian "
        "per class that closes what all views miss. Its detections also vote directly on the points they saw.",
        (
            Variant("SVM alone (thesis)", {"gaussian_share": 0.0}),
            Variant("Gaussians alone (QDA)", {"gaussian_share": 1.0}),
            Variant("no direct votes", {"votes": False}),
            Variant("seeds clamped", {"clamp_seeds": True}, quick=False),
        ),
    ),
    Factor(
        "Training points",
        ("outer_share",),
        "The classifier sees as many points of either class; half of the background comes from the rim around the "
        "masks, where mistakes are made.",
        _steps("outer_share", (0.5,)),
    ),
    Factor(
        "Appearance kernel",
        ("appearance_weight", "appearance_width", "appearance_width_m", "appearance_colour"),
        "Points of like colour pull on each other over a distance that grows with the objects, so that a shelf bin and "
        "a living room need no different settings.",
        (
            *_steps("appearance_weight", (0.0, 8.0), (1.0, 2.0, 16.0)),
            *_steps("appearance_width", (0.2, 0.6), (0.1, 1.0)),
            Variant("25 cm whatever the size", {"appearance_width_m": 0.25}, quick=False),
            *_steps("appearance_colour", (0.2,), (0.05, 0.4)),
        ),
    ),
    Factor(
        "Smoothness kernel",
        ("smoothness_weight", "smoothness_width_voxels", "smoothness_width_m"),
        "Neighbouring points agree whatever their colour; its width follows the voxels, below which nothing is known.",
        (
            *_steps("smoothness_weight", (0.0, 3.0)),
            *_steps("smoothness_width_voxels", (), (1.0, 3.0, 5.0)),
            Variant("5 cm whatever the voxels", {"smoothness_width_m": 0.05}, quick=False),
        ),
    ),
    Factor(
        "Mean-field updates",
        ("iterations",),
        "The CRF refines what classifier and votes say; without it (0) each point stands alone.",
        _steps("iterations", (0,), (2, 10)),
    ),
    Factor(
        "Voxel size",
        ("voxel_share", "voxel_m", "max_voxels"),
        "Voxels are a sixteenth of the object size, but not finer than the pixels sample; their number is bounded.",
        _steps("voxel_share", (0.1, 0.04, 0.05), (0.2, 0.03)),
    ),
    Factor(
        "Where an object may be",
        ("crop", "crop_m", "max_crop_m"),
        "Points may join an object within a margin around its seeds that grows with the objects.",
        (
            *_steps("crop", (0.6,), (0.15, 1.2)),
            Variant("1 m, growing (thesis)", {"crop_m": 1.0}, quick=False),
        ),
    ),
    Factor(
        "Safe parts of a mask",
        ("erode", "dilate", "erode_doubt", "dilate_doubt", "erosions", "dilations"),
        "Outlines are uncertain in proportion to the mask, so the rims left out inside and outside are shares of it, "
        "wider where the detector is less sure.",
        (
            Variant("the same however sure", {"erode_doubt": 0.0, "dilate_doubt": 0.0}),
            *_steps("erode", (0.05,), (0.0, 0.03)),
            *_steps("dilate", (0.1,), (0.02, 0.2)),
            Variant("3x3 pixels, once (thesis)", {"erosions": 1, "dilations": 4}, quick=False),
        ),
    ),
    Factor(
        "Outliers among the seeds",
        ("seed_outliers", "outlier_spread"),
        "A mask that reaches over an edge picks up the wall behind; seeds far from the median in space are dropped.",
        (
            Variant("from the mean (published code)", {"seed_outliers": "mean"}, quick=False),
            Variant("kept", {"seed_outliers": "off"}),
            Variant("beyond 2 deviations", {"outlier_spread": 2.0}, quick=False),
        ),
    ),
    Factor(
        "Free space",
        ("free_space",),
        "Depth that several other views look through is noise or a mixed pixel, and is left out.",
        (Variant("believed", {"free_space": False}),),
    ),
    Factor(
        "Trust in a label",
        ("calibrate", "min_confidence", "ignore_unconfirmed"),
        "A label's confidence is its expected IoU, learnt on training scenes; labels of no trust, and detections that "
        "no label explains, are regions to ignore.",
        (
            Variant("mean confidence and probability", {"calibrate": False, "min_confidence": 0.0}),
            *_steps("min_confidence", (0.0,), (0.2, 0.3)),
            *_steps("ignore_unconfirmed", (1.0,), ()),
        ),
    ),
    Factor(
        "Outliers of finished segments",
        ("segment_outliers", "min_piece", "piece_reach"),
        "Small pieces that lie apart from a finished segment are noise, and pieces far from its body are the ground or "
        "other objects: both are taken out.",
        (
            Variant("kept", {"segment_outliers": "off"}),
            Variant("from the mean (published code)", {"segment_outliers": "mean"}, quick=False),
            *_steps("min_piece", (), (0.02, 0.15)),
            *_steps("piece_reach", (1e6,), (0.3,)),
        ),
    ),
    Factor(
        "How many views speak for an object",
        ("max_sources", "weak_evidence", "agreeing_views"),
        "All confident views of an object seed it together, unsure ones vote with the weight of their score, and views "
        "that agree make up for confidence.",
        (
            *_steps("max_sources", (1,), (2, 4)),
            Variant("confident views alone", {"weak_evidence": False}),
            Variant("one confident view alone", {"weak_evidence": False, "max_sources": 1}, quick=False),
            *_steps("agreeing_views", (0,), (3, 4)),
        ),
    ),
    Factor(
        "Fusion",
        ("fuse_views", "exclusive", "merge_overlap"),
        "Detections of one object are one object in space, and objects compete for points in one CRF.",
        (
            Variant("every detection alone (thesis)", {"fuse_views": False}),
            Variant("objects do not compete", {"exclusive": False}),
            *_steps("merge_overlap", (), (0.3, 0.7)),
        ),
    ),
    Factor(
        "Visibility and holes",
        ("visibility", "fill_px", "fill_edge"),
        "A pixel with depth shows its own point; holes, and the steps of the voxel grid, are filled from around them, "
        "up to the next edge in colour.",
        (
            Variant("nearest point of all views", {"visibility": "z-buffer"}),
            *_steps("fill_px", (0.0,), (2.0, 8.0)),
            *_steps("fill_edge", (100.0,), (0.1, 1.0)),
        ),
    ),
    Factor(
        "Who is a source",
        ("confident", "min_mask_px"),
        "Detections of a confidence of .9 or more are sources, as in the thesis; tiny masks are passed over.",
        (*_steps("confident", (), (0.8, 0.95)), *_steps("min_mask_px", (), (8, 128))),
    ),
)

NOT_STUDIED = {
    "max_range_m": "bounds what a depth sensor is believed at; no recording here reaches it",
    "consistency": "a filter for those who want it, as in the thesis' appendix, off as there",
    "complete_boxes": "concerns 3-D boxes alone, which this table does not score",
    "seed": "every value is as good; the ablation averages over --seeds of them",
    "published": "defects, see `label_modes`",
}
"""Settings without a factor, and why."""


def variants(scale: Scale) -> list[tuple[Factor, Variant]]:
    """All variants of a scale."""
    return [(factor, one) for factor in FACTORS for one in factor.variants if one.quick or scale == "full"]
