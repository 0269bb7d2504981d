"""How the help of ``labeling.generate`` groups its options: common ones first, the thesis' last."""

GROUPS: dict[str, tuple[str, ...]] = {
    "common options": (
        *("dataset", "out", "detector", "preset", "confident", "share-scenes", "label-together", "workers", "seed"),
    ),
    "where the masks come from": ("detections", "with-recorded", "weak", "annotations"),
    "how a recording is read": ("layout", "every", "max-views", "up", "camera", "depth-unit-m", "max-gap-s"),
    "where the work is done": ("cluster", "shared"),
    "algorithm: views and their points": (
        *("refine-poses", "free-space", "max-range-m", "voxel-share", "voxel-m", "max-voxels"),
    ),
    "algorithm: which objects there are": (
        *(
            "min-posterior",
            "moving",
            "class-sizes",
            "weak-evidence",
            "min-mask-px",
            "max-sources",
            "merge-overlap",
            "nested-masks",
        ),
    ),
    "algorithm: seeds of an object": (
        *("erode", "dilate", "erode-doubt", "dilate-doubt", "seed-outliers", "outlier-spread", "crop", "crop-cut"),
    ),
    "algorithm: segmentation": (
        *("gaussian-share", "votes", "min-vote", "colour-beyond", "appearance-weight", "appearance-width"),
        *("appearance-colour", "smoothness-weight", "smoothness-width-voxels", "iterations"),
    ),
    "algorithm: finished objects": (
        *("segment-outliers", "min-piece", "piece-reach", "clear-ground", "level-surfaces", "end-boards"),
        *("thin-parts", "complete-boxes"),
    ),
    "algorithm: masks in the views": ("visibility", "fill-px", "fill-edge", "fill-views"),
    "algorithm: confidence, and what is ignored": (
        *("calibrate", "min-confidence", "ignore-unconfirmed", "doubt-across-views"),
    ),
    "what the presets paper and released are made of": (
        *("fuse-views", "exclusive", "consistency", "erosions", "dilations", "crop-m", "max-crop-m", "clamp-seeds"),
        *("outer-share", "appearance-width-m", "smoothness-width-m"),
    ),
    "defects of the published code (preset released)": (
        *("published.empty-kernel", "published.first-two-outliers", "published.full-confidence"),
        *("published.drifting-classes", "published.whole-masks-only", "published.amodal-boxes"),
        "published.missing-z-buffer",
    ),
}
"""Title -> options as they are typed, without the dashes before them."""
