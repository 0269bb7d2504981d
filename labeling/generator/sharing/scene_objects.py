"""The objects of a scene across its episodes.

A detector misses objects that are far away, and an episode whose views are all far from an object cannot label it. An
episode elsewhere in the same scene may have gone around the same object. So segments of all episodes of a scene that
overlap in space are one object, and a view of any episode is labelled with it where the view's depth shows that it is
still there. Beyond the thesis, which labels each episode by itself.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Float32, Int

from labeling.core.geometry import transform_points, unproject_depth
from labeling.core.splatting import silhouettes, splat
from labeling.core.types import Box3d
from labeling.core.views import Camera

OVERLAP = 0.3
"""Segments of two episodes are one object if this share of the points of either lies near the other's (``REACH``)."""
REACH = 4.0
"""Largest distance of points of one surface, in distances between neighbouring points of a segment."""
AGREEMENT = 0.5
"""Least IoU of the pixels whose depth lies in an object's box with those that its points cover; with less the view
shows something else there."""
MARGIN_SHARE = 0.02
"""Largest difference between a point's depth and the view's depth that still agrees, as a share of its depth."""


@dataclass(frozen=True, eq=False)
class ObjectObservation:
    """An object in the labels of one episode."""

    episode: str
    instance_id: int
    """Within the episode."""
    category: str
    confidence: float
    """In [0, 1]."""
    box_3d: Box3d
    """Upright, world."""
    points: Float[np.ndarray, "n 3"]
    """Points of its segment, metres, world; of 64 bits far from its origin."""
    source_view_index: int
    """Index of the episode's view that is most confident of it."""
    source_confidence: float


@dataclass(frozen=True, eq=False)
class SceneObject:
    """An object of a scene, from all episodes that found it."""

    observations: tuple[ObjectObservation, ...]
    """The most confident first: its category and box are the object's."""
    points: Float[np.ndarray, "n 3"]
    """Of all observations; metres, world."""
    spacing_m: float
    """Distance between neighbouring points of a segment."""

    @property
    def best(self) -> ObjectObservation:
        """The most confident observation."""
        return self.observations[0]

    def is_found_in(self, episodes: Collection[str]) -> bool:
        """Whether one of these episodes has found the object itself."""
        return any(observation.episode in episodes for observation in self.observations)


@dataclass(frozen=True, eq=False)
class ObjectMasks:
    """Masks of an object in one view."""

    modal: Bool[np.ndarray, "h w"]
    amodal: Bool[np.ndarray, "h w"]


def associate_observations(observations: Sequence[ObjectObservation]) -> list[SceneObject]:
    """Puts together observations that found one and the same object.

    Args:
        observations: of all episodes of a scene; those of fewer than two points are left out.

    Returns:
        The objects, the most confident first.
    """
    found: list[SceneObject] = []
    usable = [observation for observation in observations if len(observation.points) > 1]
    for observation in sorted(usable, key=lambda one: (-one.confidence, one.episode, one.instance_id)):
        alone = SceneObject((observation,), observation.points, _spacing_m(observation.points))
        for place, known in enumerate(found):
            if _overlap(known, alone) >= OVERLAP:
                found[place] = SceneObject(
                    (*known.observations, observation),
                    np.concatenate([known.points, observation.points]),
                    max(known.spacing_m, alone.spacing_m),
                )
                break
        else:
            found.append(alone)
    return found


def project_objects(
    objects: Sequence[SceneObject], depth_m: Float32[np.ndarray, "h w"], camera: Camera
) -> list[ObjectMasks | None]:
    """Where a view shows objects that its episode may not have found itself.

    Args:
        objects: of the scene.
        depth_m: the view's z-depth, 0 where there is no return.
        camera: of the view.

    Returns:
        Of each object its visible pixels, those whose depth lies in its box, and its whole silhouette; None if it is
        out of view, hidden, or not there (any more): if these pixels are not those that its points cover.
    """
    points, pixels = unproject_depth(depth_m.astype(float), camera.intrinsics, camera.camera_to_world)
    eye_m = np.asarray(camera.camera_to_world, float)[:3, 3]
    near_eye = (points - eye_m).astype(np.float32)  # coordinates of a map are too large for single precision

    def project(one: SceneObject) -> ObjectMasks | None:
        modal = np.zeros(depth_m.size, bool)
        box = replace(one.best.box_3d, centre_m=one.best.box_3d.centre_m - eye_m)
        modal[pixels[_in_box(near_eye, box, one.spacing_m)]] = True
        modal = modal.reshape(depth_m.shape)
        return _compared(one, modal, depth_m, camera) if modal.any() else None

    return [project(one) for one in objects]


def _in_box(points: Float32[np.ndarray, "n 3"], box: Box3d, margin_m: float) -> Int[np.ndarray, "m"]:
    """Points that lie in a box of their frame, its margin included except below: there is what the object stands on."""
    half = 0.5 * box.extent_m + margin_m
    near = np.ones(len(points), bool)
    for axis, reach_m in enumerate(np.abs(box.rotation) @ half):
        near &= np.abs(points[:, axis] - np.float32(box.centre_m[axis])) <= reach_m
    near = np.flatnonzero(near)
    local = (points[near] - box.centre_m) @ box.rotation
    return near[np.all(np.abs(local) <= half, axis=1) & (local[:, 2] >= margin_m - 0.5 * box.extent_m[2])]


def _compared(one: SceneObject, modal: Bool[np.ndarray, "h w"], depth_m, camera: Camera) -> ObjectMasks | None:
    """The masks of an object whose visible pixels agree with what its points cover; None if they do not."""
    point_size_m = 2 * one.spacing_m
    drawn = silhouettes(one.points, np.zeros(len(one.points), np.int32), 1, camera, point_size_m)[0]
    nearest = splat(one.points, camera, point_size_m)
    expected_m = transform_points(camera.world_to_camera, one.points)[:, 2][np.maximum(nearest, 0)]
    margin_m = REACH * one.spacing_m + MARGIN_SHARE * expected_m
    hidden = drawn & ~modal & (depth_m > 0) & (depth_m < expected_m - margin_m)
    agreement = np.count_nonzero(modal & drawn) / np.count_nonzero(modal | (drawn & ~hidden))
    return ObjectMasks(modal, modal | hidden | (drawn & (depth_m <= 0))) if agreement >= AGREEMENT else None


def _spacing_m(points) -> float:
    from scipy.spatial import cKDTree

    distances, _ = cKDTree(points).query(points, k=2)
    return float(np.median(distances[:, 1]))


def _overlap(a: SceneObject, b: SceneObject) -> float:
    """The greater share of the points of either that lie within reach of the other."""
    from scipy.spatial import cKDTree

    reach_m = REACH * max(a.spacing_m, b.spacing_m)
    low, high = (np.maximum(a.points.min(0), b.points.min(0)), np.minimum(a.points.max(0), b.points.max(0)))
    if np.any(low > high + reach_m):
        return 0.0
    shares = []
    for points, others in ((a.points, b.points), (b.points, a.points)):
        distances, _ = cKDTree(others).query(points, distance_upper_bound=reach_m)
        shares.append(float(np.isfinite(distances).mean()))
    return max(shares)
