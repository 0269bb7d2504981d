"""Masks of all objects of an episode in all of its views."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float32

from labeling.core.episode_labels import EpisodeLabels, LabelledObject, Scale, SegmentedCloud
from labeling.core.splatting import silhouettes
from labeling.core.types import PseudoLabel
from labeling.generator.draw.fused_views import FusedViews, fill_reach_px
from labeling.generator.draw.view_masks import modal_masks, point_owners, view_probabilities
from labeling.generator.settings.label_config import LabelConfig
from labeling.generator.settings.published_defects import paint_in_order
from labeling.runtime.threads import in_threads


def draw_labels(
    fused: FusedViews,
    objects: Sequence[LabelledObject],
    probability: Float32[np.ndarray, "n k"],
    scale: Scale,
    config: LabelConfig,
) -> EpisodeLabels:
    """Draws every object into every view.

    Args:
        fused: the views and their clouds.
        objects: numbered 1 to k.
        probability: of each object at each point of the cloud.
        scale: of the episode.
        config: settings.

    Returns:
        The objects, their masks by view, and the segmented cloud. The confidence of a mask is that of its object times
        the mean probability in it.
    """
    cloud, fine, views = fused.cloud, fused.fine, fused.views
    owner = point_owners(probability, config.exclusive)
    owner_of_fine = owner[fused.voxel_of_fine]
    reach_px = fill_reach_px(cloud.voxel_m, scale.pixel_m, config)

    def labels_of(view: int) -> list[PseudoLabel]:
        voxels = fused.visible_voxels(view, config)
        rendered = fused.rendered_voxels(view) if (voxels < 0).any() else None
        chance, known = view_probabilities(views.rgb[view], voxels, rendered, probability, reach_px, config.fill_edge)
        drawn = silhouettes(fine.points, owner_of_fine, len(objects), views.camera(view), fine.voxel_m)
        modal = modal_masks(chance, known, config.exclusive)
        if config.published.missing_z_buffer:
            modal = paint_in_order(drawn)
        labels = []
        for k, one in enumerate(objects):
            visible = modal == k
            amodal = drawn[k] | visible
            if not amodal.any():
                continue
            within = chance[:, :, k][visible] if visible.any() else probability[owner == k, k]
            labels.append(
                PseudoLabel(
                    view_index=view,
                    instance_id=one.instance_id,
                    category=one.category,
                    confidence=float(min(1.0, one.confidence * within.mean())),
                    modal=visible,
                    amodal=amodal,
                    source_view_index=one.sources[0].view_index,
                    source_confidence=one.sources[0].confidence,
                )
            )
        return labels

    labels = tuple(label for found in in_threads(labels_of, range(views.num_views)) for label in found)
    instance_ids = np.array([0, *(one.instance_id for one in objects)], np.int32)[owner + 1]
    return EpisodeLabels(
        tuple(objects), labels, SegmentedCloud(cloud.points, cloud.colours, instance_ids, probability), scale
    )
