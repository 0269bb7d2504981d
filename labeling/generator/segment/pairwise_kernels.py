"""The CRF's pairwise terms: an appearance kernel (position and colour) and a smoothness kernel (position alone)."""

import numpy as np

from labeling.generator.cloud.voxel_cloud import Cloud
from labeling.generator.segment.active_points import ActivePoints
from labeling.generator.segment.mean_field import Kernel
from labeling.generator.segment.permutohedral_lattice import build_lattice
from labeling.generator.settings.label_config import LabelConfig
from labeling.generator.settings.published_defects import ConstantKernel


def crf_kernels(cloud: Cloud, near: ActivePoints, object_m: float, config: LabelConfig) -> list[Kernel]:
    """The kernels between the points near each object.

    Args:
        cloud: the points.
        near: which of them may belong to which object; objects are blocks that do not see each other's points.
        object_m: size of a typical object, metres.
        config: weights and widths.

    Source: thesis equation 4.1.
    """
    if config.published.empty_kernel:
        return [Kernel(ConstantKernel(near.block_start), config.smoothness_weight)]
    appearance_m = config.appearance_width_m or config.appearance_width * object_m
    smoothness_m = config.smoothness_width_m or config.smoothness_width_voxels * cloud.voxel_m
    points, kernels = cloud.points[near.point], []
    if config.appearance_weight > 0:
        colours = cloud.colours[near.point] / config.appearance_colour
        features = np.concatenate([points / appearance_m, colours], axis=1)
        kernels.append(Kernel(build_lattice(features, near.block_start), config.appearance_weight))
    if config.smoothness_weight > 0:
        kernels.append(Kernel(build_lattice(points / smoothness_m, near.block_start), config.smoothness_weight))
    return kernels
