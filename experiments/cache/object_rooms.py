"""Rooms with a few pieces of furniture in the middle, seen from all around: scenes for view prediction.

The thesis (2.6, after Tung et al. 2019) trains on scenes of two objects and tests on scenes of four.
"""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from experiments.cache.stages import RunContext, digest, run_tasks
from labeling.runtime.code_digest import code_digest
from labeling.runtime.provenance import experiment_versions

if TYPE_CHECKING:
    from sbm_gym.assets.catalog.library import FurnitureLibrary
    from sbm_gym.worlds.geometry.placing import Layout

USES = ("dining_chair", "office_chair", "lounge_chair", "floor_plant", "coffee_table", "toilet", "beanbag")
"""Pieces of less than a metre."""
ROOM_M, PLACED_M, MIDDLE_M = 5.0, 1.05, 0.5
"""Side of the room; how far from its middle pieces stand at most; height of the point that cameras look at."""
DISTANCE_M, ELEVATION_DEG, FOV_DEG = (1.75, 2.2), (15.0, 50.0), 75.0
"""Of cameras."""
SIZE_PX = 128
TRIES = 50


@dataclass(frozen=True)
class ObjectRooms:
    """A set of such scenes."""

    objects: int
    """In each."""
    scenes: int
    views: int = 16
    seed: int = 0


def record_object_rooms(rooms: ObjectRooms, context: RunContext) -> list[Path]:
    """Records what is not there yet; scene i depends on the settings and on i alone.

    Returns:
        Episodes, one for each scene.
    """
    settings = {name: value for name, value in asdict(rooms).items() if name != "scenes"}
    key = digest(settings, experiment_versions(), code_digest(record_scene))
    folder = context.cache / "episodes" / f"object_rooms_{rooms.objects}-{key}"
    folders = [folder / f"{number:04d}" for number in range(rooms.scenes)]
    missing = [(rooms, number, path) for number, path in enumerate(folders) if not path.is_dir()]
    run_tasks(record_scene, missing, context.workers, f"rooms of {rooms.objects} objects", spawn=context.workers > 1)
    return folders


def record_scene(task: tuple[ObjectRooms, int, Path]) -> None:
    """Builds a room and records views of it.

    Raises:
        RuntimeError: if its pieces find no place.
    """
    import mujoco

    from labeling.core.episode import Episode
    from labeling.core.views import Camera
    from labeling.io.episodes import write_episode
    from sbm_gym.rendering.rays.renderer import RaysRenderer
    from sbm_gym.worlds.rooms.indoor import build_room

    rooms, number, folder = task
    rng = np.random.default_rng([rooms.seed, rooms.objects, number])
    name = f"objects/{rooms.objects}/{rooms.seed}/{number}"
    seed = int(rng.integers(2**31))
    world = build_room(name, (ROOM_M, ROOM_M), lambda layout, library: _furnish(layout, library, rooms, rng), seed=seed)
    model = world.spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    renderer = RaysRenderer(model)
    poses = camera_poses(rooms.views, rng)
    cameras = [Camera.from_fov(pose, (SIZE_PX, SIZE_PX), np.deg2rad(FOV_DEG)) for pose in poses]
    frames = [renderer.render(data, camera) for camera in cameras]
    episode = Episode(
        rgb=np.stack([frame.rgb for frame in frames]),
        depth_m=np.stack([frame.depth_m for frame in frames]),
        intrinsics=np.stack([camera.intrinsics for camera in cameras]),
        camera_to_world=np.stack(poses),
        name=folder.name,
        file_names=tuple(f"rgb/{view:03d}.png" for view in range(rooms.views)),
        metadata={"world": "object_rooms", "scene": name, "objects": rooms.objects, "seed": rooms.seed},
    )
    write_episode(folder, episode)


def _furnish(layout: "Layout", library: "FurnitureLibrary", rooms: ObjectRooms, rng: np.random.Generator) -> None:
    """Stands pieces of different kinds around the middle; all of them anew where one finds no place."""
    empty = layout.mark()
    for _ in range(TRIES):
        if all(_place(layout, library, str(use), rng) for use in rng.choice(USES, rooms.objects, replace=False)):
            return
        layout.undo(empty)
    raise RuntimeError(f"{rooms.objects} pieces found no place within {PLACED_M} m")


def _place(layout: "Layout", library: "FurnitureLibrary", use: str, rng: np.random.Generator) -> bool:
    """Stands one piece somewhere; False if it found no place."""
    from sbm_gym.worlds.geometry.placing import Placement

    models = library.models(use)
    card = models[int(rng.integers(len(models)))]
    for _ in range(TRIES):
        spot = PLACED_M * np.sqrt(rng.random()) * _direction(rng.uniform(0, 2 * np.pi))
        piece = Placement(card, float(spot[0]), float(spot[1]), float(rng.uniform(-np.pi, np.pi)))
        if layout.fits(piece):
            layout.add(piece)
            return True
    return False


def _direction(angle_rad: float) -> Float[np.ndarray, "2"]:
    return np.array([np.cos(angle_rad), np.sin(angle_rad)])


def camera_poses(views: int, rng: np.random.Generator) -> list[Float[np.ndarray, "4 4"]]:
    """Cameras all around the room's middle, in any order."""
    from labeling.core.geometry import look_at

    poses, middle = [], np.array([0.0, 0.0, MIDDLE_M])
    for slot in rng.permutation(views):
        azimuth = 2 * np.pi * (slot + rng.random()) / views
        elevation, distance = np.deg2rad(rng.uniform(*ELEVATION_DEG)), rng.uniform(*DISTANCE_M)
        level = np.cos(elevation) * _direction(azimuth)
        poses.append(look_at(middle + distance * np.array([*level, np.sin(elevation)]), middle))
    return poses
