"""Names of the files of an episode and of a label set (docs/data-formats.md)."""

from pathlib import Path

TRANSFORMS_FILE, ABOUT_FILE, TRUTH_FILE = "transforms.json", "episode.json", "ground_truth.json"
DETECTIONS_FILE = "detections.json"
MOTION_FILE = "motion.json"
"""Where the objects are that may move; labels do not depend on it."""
DETECTIONS_3D_FILE = "detections_3d.json"
"""What ``labeling.detect3d`` writes beside an episode's frames; labels do not depend on it."""
WRITTEN_BY_DETECTORS = (DETECTIONS_FILE, ABOUT_FILE, DETECTIONS_3D_FILE)
"""What is no part of the recording that detectors look at."""

MODAL_FILE, AMODAL_FILE, BOXES_FILE = "instances_modal.json", "instances_amodal.json", "boxes_3d.json"
SUMMARY_FILE = "label_set.json"
"""Which settings, recordings and versions made the labels; written last."""
RECORDS_FOLDER = "episodes"
"""What ``labeling.generate`` keeps of each episode that is labelled."""


def cloud_file(label_set: Path, episode: str) -> Path:
    """The segmented cloud of an episode."""
    return label_set / "clouds" / f"{episode}.ply"
