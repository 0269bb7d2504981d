"""Masks of all objects of an episode in all of its views."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float32
from numba import njit

from labeling.core.episode_labels import EpisodeLabels, LabelledObject, Scale, SegmentedCloud
from labeling.core.masks import blank_masks
from labeling.core.splatting import silhouettes
from labeling.core.types import PseudoLabel
from labeling.generator.draw.fused_views import FusedViews, fill_reach_px, has_holes
from labeling.generator.draw.gone_objects import gone_objects
from labeling.generator.draw.part_masks import draw_parts
from labeling.generator.draw.view_masks import NO_OBJECT, ViewChances, likely_voxels, point_owners, view_chances
from labeling.generator.segment.thin_parts import ThinParts
from labeling.generator.settings.label_config import LabelConfig
from labeling.generator.settings.published_defects import paint_in_order
from labeling.runtime.threads import in_threads

PART_PROBABILITY = np.float32(0.95)
"""Of an object in the voxels of its thin parts: so many of their pixels are right on development scenes."""


def draw_labels(
    fused: FusedViews,
    objects: Sequence[LabelledObject],
    probability: Float32[np.ndarray, "n k"],
    parts: ThinParts | None,
    scale: Scale,
    config: LabelConfig,
    moves: Bool[np.ndarray, "k"] | None = None,
) -> EpisodeLabels:
    """Draws every object into every view.

    Args:
        fused: the views and their clouds.
        objects: numbered 1 to k.
        probability: of each object at each point of the cloud.
        parts: what belongs to objects besides, if that is known.
        scale: of the episode.
        config: settings.
        moves: which objects have moved, if any have: only a view's own depth tells that one is there.

    Returns:
        The objects, their masks by view, and the segmented cloud. The confidence of a mask is that of its object times
        the mean probability in it.
    """
    cloud, fine, views = fused.cloud, fused.fine, fused.views
    owner = point_owners(probability, config.exclusive)
    owner_of_fine = owner[fine.voxel]
    if parts is not None:
        of_part = np.where(fine.points[:, 2] > parts.top_m[fine.voxel], parts.owner[fine.voxel], np.int32(-1))
        owner_of_fine = np.where(of_part >= 0, of_part, owner_of_fine)
    # Of each voxel whether its object has moved; that of no object (-1) is the last one.
    passing = None if moves is None or not moves.any() else np.append(moves, False)[owner]
    reach_px = fill_reach_px(cloud.voxel_m, scale.pixel_m, config)
    likely = likely_voxels(probability)
    gone = np.zeros((views.num_views, len(objects)), bool)
    if config.moving:
        gone = gone_objects(cloud, views, owner, objects, moves)
    whole = [float(probability[owner == k, k].mean()) if (owner == k).any() else 0.0 for k in range(len(objects))]

    def labels_of(view: int) -> list[PseudoLabel]:
        voxels = fused.visible_voxels(view, config)
        rendered = fused.filling_voxels(view, config) if has_holes(voxels) else None
        if rendered is not None and passing is not None:
            rendered[(rendered >= 0) & passing[np.maximum(rendered, 0)]] = NO_OBJECT
        chances = view_chances(views.rgb[view], voxels, rendered, probability, reach_px, config.fill_edge, likely)
        rows = np.zeros((len(objects), voxels.shape[0]), bool)
        # Where the view sees what is at an object's place or behind it, and that is not the object, the object is not.
        before_m = None if config.published.missing_z_buffer else views.depth_m[view]
        drawn = silhouettes(
            fine.points, owner_of_fine, len(objects), views.camera(view), fine.spacing_m, rows, before_m
        )
        shown, pixels, means = chances.masks(config.exclusive)
        windows = chances.windows
        if parts is not None:
            own_voxels = cloud.voxel_of_pixel[view]
            windows = draw_parts(shown, pixels, windows, parts, view, own_voxels, views.depth_m[view])
        if config.published.missing_z_buffer:
            shown, pixels, means = _painted(drawn, chances)
        seen = [k for k in range(len(objects)) if (pixels[k] or np.any(rows[k])) and not gone[view, k]]
        blank, labels = blank_masks(2 * len(seen), voxels.shape), []
        for k, modal, amodal in zip(seen, blank[::2], blank[1::2], strict=True):
            one = objects[k]
            first, end = (0, len(shown)) if config.published.missing_z_buffer else windows[k, :2]
            _write_masks(k, shown, first, end, drawn[k], rows[k], modal, amodal)
            labels.append(
                PseudoLabel(
                    view_index=view,
                    instance_id=one.instance_id,
                    category=one.category,
                    confidence=min(1.0, one.confidence * (float(means[k]) if pixels[k] else whole[k])),
                    modal=modal,
                    amodal=amodal,
                    source_view_index=one.sources[0].view_index,
                    source_confidence=one.sources[0].confidence,
                )
            )
        return labels

    labels = tuple(label for found in in_threads(labels_of, range(views.num_views)) for label in found)
    if parts is not None:
        new = np.flatnonzero(parts.owner >= 0)
        owner[new] = parts.owner[new]
        probability = probability.copy()
        probability[new] *= 1 - PART_PROBABILITY
        probability[new, owner[new]] = PART_PROBABILITY
    instance_ids = np.array([0, *(one.instance_id for one in objects)], np.int32)[owner + 1]
    return EpisodeLabels(
        tuple(objects), labels, SegmentedCloud(cloud.points, cloud.colours, instance_ids, probability), scale
    )


@njit(cache=True, nogil=True)
def _write_masks(k, shown, first, end, drawn, rows, modal, amodal):  # pragma: no cover - compiled
    """Writes the masks of an object into blank ones, row by row where there is anything.

    Args:
        k: its number.
        shown: (h, w) int32, the object at each pixel.
        first: no earlier row shows it.
        end: nor does this one, or a later one.
        drawn: (h, w) bool, all of it; only where ``rows``.
        rows: (h,) bool.
        modal: (h, w) bool, receives where it is shown.
        amodal: (h, w) bool, receives all of it.
    """
    for y in range(len(rows)):
        if rows[y]:
            for x in range(shown.shape[1]):
                amodal[y, x] = drawn[y, x]
        if first <= y < end:
            for x in range(shown.shape[1]):
                modal[y, x] = shown[y, x] == k
                amodal[y, x] |= modal[y, x]


def _painted(drawn: Bool[np.ndarray, "k h w"], chances: ViewChances):
    """What ``ViewChances.masks`` returns, if objects are painted over each other in their order."""
    shown, chance = paint_in_order(drawn), chances.dense()
    pixels = np.bincount(shown[shown >= 0], minlength=len(drawn))
    means = [float(chance[:, :, k][shown == k].mean()) if pixels[k] else 0.0 for k in range(len(drawn))]
    return shown, pixels, np.array(means, np.float32)
