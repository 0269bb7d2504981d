"""Compiled scenes on disk: the parts of a scene that stepping through it needs."""

import contextlib
from collections.abc import Callable
from dataclasses import dataclass, replace

import mujoco
import numpy as np
from jaxtyping import Float, UInt8

from sbm_gym.detection.visibility import ObjectSurfaces
from sbm_gym.rendering.rays.ray_scene import StillScene
from sbm_gym.rendering.rays.renderer import RaysRenderer
from sbm_gym.robot.body import BodyConfig, add_agent
from sbm_gym.scenes.compiled import Scene, WholeModel, assemble, make_renderer
from sbm_gym.store.cache_folder import SceneFolder
from sbm_gym.store.packed_file import DamagedError, read_packed, write_packed
from sbm_gym.store.records import decode, encode
from sbm_gym.store.texel_files import TexelFile, open_texels, save_texels
from sbm_gym.worlds.world import World, WorldContents

_MODEL_FILE = "scene.mjb"


@dataclass(frozen=True)
class SavedScene:
    """A scene as it is kept."""

    world: WorldContents
    model: UInt8[np.ndarray, "bytes"]
    """As MuJoCo saves it; for ``rays`` without textures and meshes that are only drawn."""
    surface_points_m: Float[np.ndarray, "n k 3"]
    points_of_moved: dict[str, Float[np.ndarray, "k 3"]]
    still: StillScene | None
    """For ``rays``; its textures have no texels."""
    texels: list[TexelFile]


def save_scene(folder: SceneFolder, key: str, scene: Scene) -> None:
    """Keeps a scene for all processes.

    Args:
        folder: where.
        key: names it.
        scene: as ``compile_scene`` made it; no episode has begun in it.

    Raises:
        OSError: if it cannot be written.
        TypeError: if it holds something that cannot be kept.
    """
    still, texels = None, []
    if isinstance(scene.renderer, RaysRenderer):
        still = scene.renderer.still(scene.data)
        textures = still.textures
        first = textures.level_start[:, 0]
        ends = np.append(first[1:], len(textures.texels))
        texels = [save_texels(folder.textures, textures.texels[a:b]) for a, b in zip(first, ends, strict=True)]
        textures = textures._replace(texels=textures.texels[:0], level_start=textures.level_start - first[:, None])
        still = replace(still, textures=textures)
    points = scene.surfaces.points_m
    saved = SavedScene(scene.world, _as_bytes(scene.model), points, dict(scene.points_of_moved), still, texels)
    arrays: list[np.ndarray] = []
    record = encode(SavedScene, saved, arrays, _stage)
    content = {"scene": scene.name, "textures": [file.name for file in texels], "record": record}
    write_packed(folder.path(key), content, arrays)


def load_scene(
    folder: SceneFolder, key: str, renderer: str, body: BodyConfig, whole: Callable[[], mujoco.MjModel]
) -> Scene | None:
    """A scene that any process has saved; None if there is none, or it is damaged, which removes it.

    Args:
        folder: where.
        key: names it.
        renderer: one of ``RENDERERS``.
        body: the agent's body.
        whole: makes the scene's model with meshes and textures.
    """
    path = folder.path(key)
    try:
        content, arrays = read_packed(path)
        saved = decode(SavedScene, content["record"], arrays, _stage)
        still = saved.still
        if still is not None:
            texels, starts = open_texels(folder.textures, saved.texels)
            level_start = still.textures.level_start + starts[:, None]
            still = replace(still, textures=still.textures._replace(texels=texels, level_start=level_start))
        model = mujoco.MjModel.from_binary_path(_MODEL_FILE, {_MODEL_FILE: saved.model.tobytes()})
    except (OSError, DamagedError, KeyError, TypeError, ValueError, IndexError):
        with contextlib.suppress(OSError):
            path.unlink()
        return None
    folder.used(path)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    drawn = make_renderer(renderer, model) if still is None else RaysRenderer(model, still=still)
    surfaces = ObjectSurfaces(saved.world.objects, saved.surface_points_m, saved.world.name)
    whole_model = WholeModel((lambda: model) if still is None else whole)
    return assemble(
        content["scene"], saved.world, model, data, body, drawn, surfaces, saved.points_of_moved, whole_model
    )


def _as_bytes(model: mujoco.MjModel) -> UInt8[np.ndarray, "bytes"]:
    content = np.empty(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, content)
    return content


def _stage(name: str) -> type | None:
    """The stage of that name, if it can be kept."""
    if name == "TownStage":
        from sbm_gym.worlds.towns.outdoor import TownStage

        return TownStage
    if name == "RoomStage":
        from sbm_gym.worlds.rooms.room_stage import RoomStage

        return RoomStage
    return None


def rebuild_whole_model(world: Callable[[], World], body: BodyConfig) -> mujoco.MjModel:
    """The whole model of a scene, from its world."""
    spec = world().spec
    add_agent(spec, body)
    return spec.compile()
