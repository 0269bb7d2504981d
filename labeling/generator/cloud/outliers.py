"""Points that do not belong to the object their mask shows: behind its edges, or left over apart from it."""

import numpy as np
from jaxtyping import Bool, Float32, Int32

from labeling.generator.cloud.connected_components import detached_points
from labeling.generator.settings.label_config import LabelConfig
from labeling.generator.settings.published_defects import first_two_points

COMPONENT_GAP_VOXELS = 2.0
"""Pieces of a segment closer than this are one piece."""


def far_from_mean(points: Float32[np.ndarray, "n 3"], spread: float) -> Bool[np.ndarray, "n"]:
    """Points further from the mean than ``spread`` standard deviations along any axis.

    Source: field notes (published code, which measures each axis by itself).
    """
    if len(points) < 4:
        return np.zeros(len(points), bool)
    offset = np.abs(points - points.mean(axis=0))
    return np.any(offset > spread * points.std(axis=0), axis=1)


def segment_outliers(
    points: Float32[np.ndarray, "n 3"],
    object_of_point: Int32[np.ndarray, "n"],
    num_objects: int,
    voxel_m: float,
    config: LabelConfig,
    support: Float32[np.ndarray, "n"] | None = None,
) -> Bool[np.ndarray, "n"]:
    """Points of segments that are taken out again.

    Args:
        points: world points, metres.
        object_of_point: index of the object, -1 for none.
        num_objects: how many objects there are.
        voxel_m: edge of a voxel.
        config: settings; ``segment_outliers`` says by which rule.
        support: sum of the confidences of the detections of its object at each point, if that is known.
    """
    if config.segment_outliers == "pieces" and not config.published.first_two_outliers:
        gap_m = COMPONENT_GAP_VOXELS * voxel_m
        shares = config.min_piece, config.piece_reach
        return detached_points(points, object_of_point, num_objects, gap_m, *shares, support)
    removed = np.zeros(len(points), bool)
    if config.segment_outliers == "off":
        return removed
    for k in range(num_objects):
        members = np.flatnonzero(object_of_point == k)
        far = (
            first_two_points(len(members))
            if config.published.first_two_outliers
            else far_from_mean(points[members], config.outlier_spread)
        )
        removed[members[far]] = True
    return removed
