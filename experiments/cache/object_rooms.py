"""Rooms with a few pieces of furniture in the middle, seen from all around: scenes for view prediction.

The thesis (2.6, after Tung et al. 2019) trains on scenes of two objects, tests on scenes of four, and does arithmetic
with scenes: A - B + C is A without what stands in B and with what stands in C.
"""

from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from experiments.cache.stages import RunContext, digest, run_tasks
from labeling.runtime.code_digest import code_digest
from labeling.runtime.provenance import experiment_versions

if TYPE_CHECKING:
    from sbm_gym.assets.catalog.library import FurnitureLibrary
    from sbm_gym.worlds.geometry.placing import Layout, Placement
    from sbm_gym.worlds.world import World

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


PARTS = ("a", "b", "c", "answer")
"""Rooms of an exchange: of two objects; of one of them; of a third one; of the other of the two and the third, which is
what A - B + C is."""
STANDING = {"a": (0, 1), "b": (1,), "c": (2,), "answer": (0, 2)}
"""Which of its three objects stand in each."""


@dataclass(frozen=True)
class Exchanges:
    """A set of exchanges: rooms that differ in what stands in them, seen by the same cameras."""

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


def record_exchanges(exchanges: Exchanges, context: RunContext) -> dict[str, list[Path]]:
    """Likewise the rooms of exchanges.

    Returns:
        For each of ``PARTS`` episodes, one for each exchange, of the same names.
    """
    settings = {name: value for name, value in asdict(exchanges).items() if name != "scenes"}
    key = digest(settings, experiment_versions(), code_digest(record_exchange))
    folder = context.cache / "episodes" / f"exchanges-{key}"
    folders = {part: [folder / part / f"{number:04d}" for number in range(exchanges.scenes)] for part in PARTS}
    missing = [
        (exchanges, number, folder)
        for number in range(exchanges.scenes)
        if not all(of_part[number].is_dir() for of_part in folders.values())
    ]
    run_tasks(record_exchange, missing, context.workers, "exchanges", spawn=context.workers > 1)
    return folders


def record_scene(task: tuple[ObjectRooms, int, Path]) -> None:
    """Builds a room and records views of it.

    Raises:
        RuntimeError: if its pieces find no place.
    """
    rooms, number, folder = task
    rng = np.random.default_rng([rooms.seed, rooms.objects, number])
    name = f"objects/{rooms.objects}/{rooms.seed}/{number}"
    seed = int(rng.integers(2**31))
    world = _room(name, seed, lambda layout, library: _furnish(layout, library, rooms.objects, rng))
    about = {"world": "object_rooms", "scene": name, "objects": rooms.objects, "seed": rooms.seed}
    _record(world, camera_poses(rooms.views, rng), folder, about)


def record_boxed_rooms(rooms: ObjectRooms, context: RunContext) -> list[Path]:
    """The same episodes with ground truth: which pixels are of which object, and 3-D boxes.

    Returns:
        Episodes, one for each scene, of the same names and pictures.
    """
    bare = record_object_rooms(rooms, context)
    folder = context.cache / "episodes" / f"{bare[0].parent.name}-boxed-{code_digest(add_truth)[:12]}"
    folders = [folder / path.name for path in bare]
    missing = [
        (rooms, number, *places)
        for number, places in enumerate(zip(bare, folders, strict=True))
        if not places[1].is_dir()
    ]
    run_tasks(add_truth, missing, context.workers, "boxes of rooms", spawn=context.workers > 1)
    return folders


def add_truth(task: tuple[ObjectRooms, int, Path, Path]) -> None:
    """Builds the room of an episode again, and writes the episode with what its cameras see of which object."""
    from dataclasses import replace

    import mujoco

    from labeling.core.types import GroundTruth
    from labeling.io.episodes import read_episode, write_episode
    from sbm_gym.rendering.rays.renderer import RaysRenderer

    rooms, number, bare, folder = task
    rng = np.random.default_rng([rooms.seed, rooms.objects, number])
    seed = int(rng.integers(2**31))
    name = f"objects/{rooms.objects}/{rooms.seed}/{number}"
    world = _room(name, seed, lambda layout, library: _furnish(layout, library, rooms.objects, rng))
    model = world.spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    renderer, instance_of_geom = RaysRenderer(model), world.instance_of_geom(model)
    episode, truths = read_episode(bare), []
    for view in range(episode.num_views):
        geom_id = renderer.render(data, episode.camera(view), colours=False).geom_id
        instances = np.where(geom_id >= 0, instance_of_geom[geom_id], 0)
        for one in world.objects:
            modal = instances == one.instance_id
            if modal.any():
                truths.append(GroundTruth(view, one.instance_id, one.category, modal, box_3d=one.box_3d))
    categories = tuple(sorted({one.category for one in world.objects}))
    write_episode(folder, replace(episode, ground_truth=tuple(truths), categories=categories))


def record_exchange(task: tuple[Exchanges, int, Path]) -> None:
    """Builds the rooms of an exchange, in which the same objects stand at the same places, and records views of them.

    Raises:
        RuntimeError: if its pieces find no place.
    """
    exchanges, number, folder = task
    rng = np.random.default_rng([exchanges.seed, len(PARTS), number])
    seed = int(rng.integers(2**31))
    pieces: list[Placement] = []
    _room("all", seed, lambda layout, library: pieces.extend(_furnish(layout, library, 3, rng)))
    poses = camera_poses(exchanges.views, rng)
    for part, standing in STANDING.items():
        name, place = f"exchanges/{exchanges.seed}/{number}/{part}", folder / part / f"{number:04d}"
        if not place.is_dir():
            world = _room(name, seed, lambda layout, _, kept=standing: [layout.add(pieces[one]) for one in kept])
            about = {"world": "exchanges", "scene": name, "objects": len(standing), "seed": exchanges.seed}
            _record(world, poses, place, about)


def _room(name: str, seed: int, furnish: "Callable[[Layout, FurnitureLibrary], object]") -> "World":
    from sbm_gym.worlds.rooms.indoor import build_room

    return build_room(name, (ROOM_M, ROOM_M), furnish, seed=seed)


def _record(world: "World", poses: list[Float[np.ndarray, "4 4"]], folder: Path, about: dict[str, Any]) -> None:
    """Writes views of a world as an episode."""
    import mujoco

    from labeling.core.episode import Episode
    from labeling.core.views import Camera
    from labeling.io.episodes import write_episode
    from sbm_gym.rendering.rays.renderer import RaysRenderer

    model = world.spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    renderer = RaysRenderer(model)
    cameras = [Camera.from_fov(pose, (SIZE_PX, SIZE_PX), np.deg2rad(FOV_DEG)) for pose in poses]
    frames = [renderer.render(data, camera) for camera in cameras]
    episode = Episode(
        rgb=np.stack([frame.rgb for frame in frames]),
        depth_m=np.stack([frame.depth_m for frame in frames]),
        intrinsics=np.stack([camera.intrinsics for camera in cameras]),
        camera_to_world=np.stack(poses),
        name=folder.name,
        file_names=tuple(f"rgb/{view:03d}.png" for view in range(len(poses))),
        metadata=about,
    )
    write_episode(folder, episode)


def _furnish(layout: "Layout", library: "FurnitureLibrary", count: int, rng: np.random.Generator) -> "list[Placement]":
    """Stands pieces of different kinds around the middle; all of them anew where one finds no place."""
    empty = layout.mark()
    for _ in range(TRIES):
        placed: list[Placement] = []
        for use in rng.choice(USES, count, replace=False):
            piece = _place(layout, library, str(use), rng)
            if piece is None:
                break
            placed.append(piece)
        if len(placed) == count:
            return placed
        layout.undo(empty)
    raise RuntimeError(f"{count} pieces found no place within {PLACED_M} m")


def _place(layout: "Layout", library: "FurnitureLibrary", use: str, rng: np.random.Generator) -> "Placement | None":
    """Stands one piece somewhere; None if it found no place."""
    from sbm_gym.worlds.geometry.placing import Placement

    models = library.models(use)
    card = models[int(rng.integers(len(models)))]
    for _ in range(TRIES):
        spot = PLACED_M * np.sqrt(rng.random()) * _direction(rng.uniform(0, 2 * np.pi))
        piece = Placement(card, float(spot[0]), float(spot[1]), float(rng.uniform(-np.pi, np.pi)))
        if layout.fits(piece):
            return layout.add(piece)
    return None


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
