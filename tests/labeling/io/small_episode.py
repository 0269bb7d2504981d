"""A small episode of noise that tests write, read and spoil."""

import numpy as np

from labeling.core.episode import Episode
from labeling.core.geometry import look_at
from labeling.core.types import Box3d, Detection, GroundTruth

HEIGHT_PX, WIDTH_PX = 5, 7


def make_episode(seed: int = 0, views: int = 3, same_camera: bool = True, annotated: bool = True) -> Episode:
    """A small episode of noise, with everything an episode can hold."""
    rng = np.random.default_rng(seed)
    intrinsics = np.array([[6.5, 0, 3.25], [0, 6.25, 2.5], [0, 0, 1.0]])

    def mask():
        return rng.random((HEIGHT_PX, WIDTH_PX)) < 0.4

    box = Box3d(rng.normal(size=3), rng.uniform(0.1, 2, 3), look_at(np.zeros(3), rng.normal(size=3))[:3, :3])
    return Episode(
        name="episode",
        rgb=rng.integers(0, 256, (views, HEIGHT_PX, WIDTH_PX, 3), dtype=np.uint8),
        depth_m=(rng.integers(0, 9000, (views, HEIGHT_PX, WIDTH_PX)) * 0.001).astype(np.float32),
        intrinsics=np.stack([intrinsics + np.diag([0 if same_camera else v, 0, 0]) for v in range(views)]),
        camera_to_world=np.stack([look_at(rng.normal(size=3), rng.normal(size=3)) for _ in range(views)]),
        file_names=tuple(f"rgb/{view:03d}.png" for view in range(views)),
        detections=tuple(
            Detection(int(rng.integers(views)), ["chair", "plant"][i % 2], float(rng.random()), mask())
            for i in range(4)
        )
        if annotated
        else None,
        ground_truth=tuple(
            GroundTruth(view, i + 1, ["chair", "plant"][i], mask(), *(((mask(), box)) if i else (None, None)), i == 0)
            for view in range(views)
            for i in range(2)
        )
        if annotated
        else None,
        categories=("plant", "chair", "couch") if annotated else (),
        metadata={"seed": seed, "policy": "ring", "actions": [[0.0, 1.0]]},
    )
