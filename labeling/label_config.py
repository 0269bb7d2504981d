"""Settings of the label generator. Lengths are given in object sizes, so that one set of defaults fits a shelf bin and
a room; the object size itself is measured in the data (labeling.scale).
"""

from dataclasses import dataclass

from labeling.errors import UsageError
from labeling.instances import CONFIDENT


@dataclass(frozen=True)
class LabelConfig:
    """Settings of label generation."""

    confident: float = CONFIDENT
    """Detections at least this confident become sources of labels. Source: thesis A.2.2."""
    weak_evidence: bool = True
    """Let detections below ``confident`` vote, with the weight of their score, on objects that a source has found."""
    agreeing_views: int = 2
    """Objects that no view is sure of are labelled too if at least this many views agree on place and category, and the
    chance that not all of them are wrong reaches ``confident``. 0 leaves them out, as in the thesis."""
    min_mask_px: int = 32
    """Smaller detections are passed over. Source: field notes (published code)."""
    max_range_m: float = 50.0
    """Depth beyond this is not used. Source: field notes (published code)."""
    erode: float = 0.015
    """Width of the uncertain rim inside a mask, as a share of the square root of its pixels (thesis: 3x3, once)."""
    dilate: float = 0.05
    """Width of the uncertain rim outside a mask, as a share of the square root of its pixels (published code: 4 px)."""
    voxel_share: float = 1 / 16
    """Voxel edge as a share of the object size (3-4 cm for furniture, 8 mm for a book)."""
    voxel_m: float | None = None
    """Voxel edge in metres; None derives it from object size and pixel footprint."""
    max_voxels: int = 300_000
    """Voxels grow until the cloud has at most this many: bounds time and memory."""
    crop: float = 0.3
    """Margin around an object's seeds within which points may belong to it, in object sizes (thesis: 1 m)."""
    svm_samples: int = 300
    """Training points per class; half of the background comes from the rim around the object. Source: field notes."""
    appearance_weight: float = 4.0
    """Weight of the appearance kernel (position and colour), nats."""
    appearance_width: float = 0.35
    """Its standard deviation in space, in object sizes."""
    appearance_colour: float = 0.1
    """Its standard deviation in colour, channels in [0, 1]."""
    smoothness_weight: float = 1.0
    """Weight of the smoothness kernel (position only), nats."""
    smoothness_width_voxels: float = 1.5
    """Its standard deviation in voxels."""
    iterations: int = 5
    """Mean-field updates. Source: field notes (published code)."""
    exclusive: bool = True
    """One CRF in which objects compete for points; False: one binary CRF per object, as in the thesis."""
    merge_overlap: float = 0.5
    """Detections (or segments) that share this much of the space both can see are one object."""
    min_piece: float = 0.05
    """Pieces of a segment that hold less than this share of it and lie apart are strays."""
    fill_px: float = 0.0
    """Reach of hole filling in pixels; 0 takes half a voxel."""
    fill_edge: float = 0.3
    """Change of colour (sum over channels in [0, 1]) that stops hole filling as far as its reach does."""
    consistency: bool = False
    """Keep only objects that at least four views are confident of, all under one name. Source: thesis A.5."""
    seed: int = 0
    """Seed of the sampling of training points."""

    def check(self) -> None:
        """Refuses settings that make no sense.

        Raises:
            UsageError: naming the setting.
        """
        shares = ("confident", "merge_overlap")
        positive = [
            "max_range_m",
            "voxel_share",
            "max_voxels",
            "crop",
            "svm_samples",
            "appearance_width",
            "appearance_colour",
            "smoothness_width_voxels",
            "fill_edge",
        ]
        not_negative = [
            "agreeing_views",
            "min_mask_px",
            "min_piece",
            "erode",
            "dilate",
            "appearance_weight",
            "smoothness_weight",
            "iterations",
            "fill_px",
            "seed",
        ]
        for name in shares:
            if not 0 < getattr(self, name) <= 1:
                raise UsageError(
                    f"--{name.replace('_', '-')} must lie above 0 and at most at 1, not {getattr(self, name)}"
                )
        for name in (*positive, *(["voxel_m"] if self.voxel_m is not None else [])):
            if not 0 < getattr(self, name) < float("inf"):
                raise UsageError(f"--{name.replace('_', '-')} must be above 0 and finite, not {getattr(self, name)}")
        for name in not_negative:
            if not 0 <= getattr(self, name) < float("inf"):
                raise UsageError(f"--{name.replace('_', '-')} must be 0 or more and finite, not {getattr(self, name)}")
