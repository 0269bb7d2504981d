"""The result of checking an episode's poses against its depths."""

from dataclasses import dataclass
from typing import Any

import numpy as np

MAX_OFF = 0.5
"""Largest displacement by pose errors of what a view sees that is not reported, in voxels."""
MAX_MISFIT = 0.3
"""From this misfit on no poses make the views agree: settings or files are wrong."""


@dataclass(frozen=True)
class PoseCheck:
    """How well the poses and depths of one episode's views agree, and the corrections that make them agree best."""

    voxel_m: float
    """Edge of the voxels that the views are fused into."""
    residual_m: float
    """Point-to-plane distance between the surfaces of two views, metres; robust root mean square."""
    misfit: float
    """Mean robust loss of these distances, in [0, 1], surfaces too far apart to be fitted included: 0 if all agree."""
    view_residual_m: list[float]
    """``residual_m`` of each view: from it to the others, and from them to it."""
    rotation_deg: list[float]
    """Angle by which each view would have to be turned to agree with the others best."""
    translation_m: list[float]
    """Distance by which its camera would have to be shifted."""
    moved_m: list[float]
    """How far both corrections together displace what it sees, at its median depth."""
    refined_residual_m: float | None = None
    """``residual_m`` after these corrections; None if they are a first estimate, which found nothing to correct."""
    refined_misfit: float | None = None
    """``misfit`` after them."""
    can_be_refined: bool = False
    """Whether the corrected poses agree enough better with the depths to be used."""
    camera_to_world: list[list[list[float]]] | None = None
    """The corrected poses, if labels were made with them. Their frame is the one in which corrections are least."""

    @property
    def is_off(self) -> bool:
        """Whether pose errors of any view displace what it sees by more than ``MAX_OFF`` voxels."""
        return max(self.moved_m) > MAX_OFF * self.voxel_m

    @property
    def warning(self) -> str | None:
        """What a user should know, in one sentence; None if poses and depths agree as far as anyone can tell."""
        if self.refined_residual_m is None:
            return None
        worst = int(np.argmax(self.moved_m))
        many = sum(one > MAX_OFF * self.voxel_m for one in self.moved_m)
        off = (
            f"poses do not fit depth in {many} of {len(self.moved_m)} views, in view {worst} by "
            f"{self.rotation_deg[worst]:.1f} degrees and {100 * self.translation_m[worst]:.1f} cm"
        )
        fell = f"surfaces of two views {100 * self.residual_m:.2g} cm apart, then {100 * self.refined_residual_m:.2g}"
        if self.camera_to_world is not None:
            return f"{off}; labels were made with refined poses ({fell})"
        if self.can_be_refined:
            return f"{off}; --refine-poses auto would mend them ({fell})"
        if (self.refined_misfit or 0.0) < MAX_MISFIT:
            return None
        return (
            f"views do not fit together under any poses nearby ({self.refined_misfit:.0%} of their surfaces disagree); "
            "check camera axes, depth unit, intrinsics, and that poses belong to their pictures"
        )

    def summary(self) -> dict[str, Any]:
        """The figures of the episode for ``label_set.json``."""
        worst = int(np.argmax(self.moved_m))
        told = {
            "refined": self.camera_to_world is not None,
            "residual_m": round(self.residual_m, 6),
            "refined_residual_m": None if self.refined_residual_m is None else round(self.refined_residual_m, 6),
            "worst_view": worst,
            "rotation_deg": round(self.rotation_deg[worst], 4),
            "translation_m": round(self.translation_m[worst], 6),
            "warning": self.warning,
        }
        return {name: value for name, value in told.items() if value is not None}
