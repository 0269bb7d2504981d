"""Checks whether the poses of views agree with their depths, and refines them jointly where they do not."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float, Float64, Int

from labeling.core.pose_check import MAX_MISFIT, PoseCheck
from labeling.core.views import RgbdViews
from labeling.generator.poses.joint_step import joint_step, motions, moved
from labeling.generator.poses.pair_sums import PairSums, pair_sums
from labeling.generator.poses.surfels import Surfels, surfels
from labeling.generator.settings.label_config import LabelConfig

CHECKED_CELLS, FITTED_CELLS = 32, 64
"""Cells along a side of a square picture: for the check of all episodes, and for new poses."""
MIN_PARTNERS = 0.03
"""Share of a view's surfels that must have partners in another view for the two to be compared."""
MAX_NEIGHBOURS = 24
"""Views that each view is compared with at most: those that share the most with it."""
STAGES = (
    *((0.08, False),) * 2, *((0.04, False),) * 2,
    *((0.02, True),) * 3, *((0.01, True),) * 2, *((0.005, True),) * 3,
)  # fmt: skip
"""For each Gauss-Newton step the scale of its robust weights, as a share of the depth, and whether brightness counts.
Wide scales converge from errors of several degrees, narrow ones leave noise out; brightness misleads while poses are
far off."""
RECHECK_SCALE = 0.04
"""Scale of the second check, of episodes that the first one finds to be off."""
EVALUATION_SCALE = 0.02
"""Scale at which recorded and fitted poses are compared, on surfels that no pose was fitted to."""
MAX_LEFT = 0.6
"""Fitted poses are taken if they leave at most this share of the residual there, of all views or of a single one whose
pose is wrong. Smaller gains also come from sensors that bend flat walls and from a robot arm in the picture."""
STANDS_OUT = 7.0
"""A pose is taken for the single wrong one if the fit moves its view so many times farther than it moves three quarters
of the views. In twelve recorded episodes single wrong poses of 10 cm, 30 cm and 5 degrees gave 4 to 48, sensors that
bend walls 1.6 to 6."""
SUSPICIOUS_MISFIT = 0.2
"""From this misfit on, at the widest scale, poses are fitted whatever the first estimate of their errors is."""


def with_agreeing_poses(views: RgbdViews, voxel_m: float, config: LabelConfig) -> tuple[RgbdViews, PoseCheck | None]:
    """Measures how well poses and depths agree, and refines the poses if asked to.

    Args:
        views: of one scene.
        voxel_m: edge of the voxels that the views will be fused into, metres; errors are compared with it.
        config: settings, of which ``refine_poses`` and ``max_range_m`` count here.

    Returns:
        The views, with refined poses if these are better, else unchanged; and the result of the check, None where no
        two views overlap enough.
    """
    coarse = surfels(views, CHECKED_CELLS, config.max_range_m)
    found = _neighbours(coarse, views)
    if len(found.pairs) == 0:
        return views, None
    depth_m, recorded = coarse.median_depth_m, np.asarray(views.camera_to_world, float)
    motion = joint_step(found, np.zeros((views.num_views, 6)), depth_m)
    check = _described(found, motion, depth_m, voxel_m)
    if check.is_off:
        # At the widest scale separate surfaces that lie close to each other count as one, so that of hundreds of views
        # some are found to be off by chance. Fitting all poses takes seconds: check at a narrower scale first.
        poses = moved(recorded, motion)
        nearer = pair_sums(coarse, views.intrinsics, poses, found.pairs, RECHECK_SCALE)
        poses = moved(poses, joint_step(nearer, motion, depth_m))
        check = _described(found, motions(recorded, poses), depth_m, voxel_m)
    if config.refine_poses != "on" and not check.is_off and check.misfit < SUSPICIOUS_MISFIT:
        return views, check
    fine = surfels(views, FITTED_CELLS, config.max_range_m)
    pairs = np.concatenate([found.pairs, found.pairs[:, ::-1]])
    poses = _fitted(fine, views, pairs, depth_m)
    before, after = (
        pair_sums(fine, views.intrinsics, one, pairs, EVALUATION_SCALE, held_out=True) for one in (recorded, poses)
    )
    check = _described(before, motions(recorded, poses), depth_m, voxel_m)
    worst = int(np.argmax(check.moved_m))
    judged = [slice(None)]
    if check.moved_m[worst] > STANDS_OUT * np.quantile(check.moved_m, 0.75):
        judged.append(np.any(pairs == worst, axis=1))  # one wrong pose among many hardly shows in all residuals
    fitted = any(after.residual_m(some) < MAX_LEFT * before.residual_m(some) for some in judged)
    better = fitted and after.cost() < min(MAX_MISFIT, before.cost())
    check = replace(
        check,
        refined_residual_m=after.residual_m(),
        refined_misfit=after.cost(),
        can_be_refined=better and (check.is_off or config.refine_poses == "on"),
    )
    if config.refine_poses == "off" or not check.can_be_refined:
        return views, check
    return replace(views, camera_to_world=poses), replace(check, camera_to_world=poses.tolist())


def _neighbours(cells: Surfels, views: RgbdViews) -> PairSums:
    """Pairs of views that share enough surfels, compared at the widest scale."""
    count = views.num_views
    pairs = np.stack(np.triu_indices(count, 1), axis=1)
    poses = np.asarray(views.camera_to_world, float)
    found = pair_sums(cells, views.intrinsics, poses, pairs, STAGES[0][0])
    shared = np.zeros((count, count))
    shared[pairs[:, 0], pairs[:, 1]] = shared[pairs[:, 1], pairs[:, 0]] = found.partners
    limit = np.sort(shared, axis=1)[:, -min(MAX_NEIGHBOURS, count)]
    least = MIN_PARTNERS * 0.5 * cells.grids[0, ..., 0].size
    return found.chosen(found.partners >= np.maximum(least, limit[pairs].min(axis=1)))


def _fitted(
    cells: Surfels, views: RgbdViews, pairs: Int[np.ndarray, "pairs 2"], depth_m: Float[np.ndarray, "views"]
) -> Float64[np.ndarray, "views 4 4"]:
    """Fits all poses jointly, in the steps of ``STAGES``.

    Args:
        cells: surfels of the views.
        views: with the recorded poses.
        pairs: indices of the views to compare.
        depth_m: median depth of each view.
    """
    recorded = np.asarray(views.camera_to_world, float)
    poses = recorded
    for scale, colour in STAGES:
        found = pair_sums(cells, views.intrinsics, poses, pairs, scale, colour=colour)
        poses = moved(poses, joint_step(found, motions(recorded, poses), depth_m))
    return poses


def _described(found: PairSums, motion, depth_m, voxel_m: float) -> PoseCheck:
    """The check's result, from residuals of pairs of views and the motions (``motions``) that would make them agree."""
    rotation, shift = np.linalg.norm(motion[:, :3], axis=1), np.linalg.norm(motion[:, 3:], axis=1)
    return PoseCheck(
        voxel_m=voxel_m,
        residual_m=found.residual_m(),
        misfit=found.cost(),
        view_residual_m=[found.residual_m(np.any(found.pairs == view, axis=1)) for view in range(len(motion))],
        rotation_deg=np.degrees(rotation).tolist(),
        translation_m=shift.tolist(),
        moved_m=(shift + rotation * depth_m).tolist(),
    )
