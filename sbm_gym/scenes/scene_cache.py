"""The cache of compiled scenes: the last few in memory, and on disk those that any process has compiled."""

import functools
import warnings
from collections import OrderedDict

import mujoco

from labeling.core.errors import SbmError
from labeling.formats.atomic import atomic_file
from labeling.runtime.memory import trim_memory
from sbm_gym.rendering.base import Renderer
from sbm_gym.robot.body import BodyConfig
from sbm_gym.scenes.compiled import Scene, WorldSource, compile_scene, make_renderer, renderer_kind
from sbm_gym.scenes.saved_scenes import load_scene, rebuild_whole_model, save_scene
from sbm_gym.scenes.scene_keys import scene_key, sources_unchanged
from sbm_gym.store.cache_folder import SceneFolder, max_bytes
from sbm_gym.store.packed_file import read_content


class SceneCache:
    """The compiled scenes used last: compiling one takes about as long as an episode, opening one from disk less."""

    def __init__(
        self, source: WorldSource, renderer: str, body: BodyConfig, capacity: int, on_disk: bool = True
    ) -> None:
        """Starts empty.

        Args:
            source: where worlds come from.
            renderer: one of ``RENDERERS``.
            body: the agent's body.
            capacity: how many scenes are kept in memory, at least 1.
            on_disk: whether scenes are kept on disk, too; those from disk have a ``model`` without meshes and textures.
        """
        if capacity < 1:
            raise ValueError(f"a scene cache holds at least 1 scene, not {capacity}")
        self._source, self._renderer, self._body, self._capacity = source, renderer, body, capacity
        self._open = open_scene if on_disk else build_whole_scene
        self._scenes: OrderedDict[str, Scene] = OrderedDict()

    def get(self, name: str) -> Scene:
        """The scene of that name, opened or built if it is not at hand."""
        if name not in self._scenes:
            while len(self._scenes) >= self._capacity:
                _, oldest = self._scenes.popitem(last=False)
                oldest.renderer.close()
            self._scenes[name] = self._open(self._source, name, self._renderer, self._body)
        self._scenes.move_to_end(name)
        return self._scenes[name]

    def clear(self) -> None:
        """Forgets all scenes."""
        for scene in self._scenes.values():
            scene.renderer.close()
        self._scenes.clear()

    def make_renderer(self, model: mujoco.MjModel) -> Renderer:
        """A renderer of the scenes' kind for another model."""
        return make_renderer(self._renderer, model)


def open_scene(source: WorldSource, name: str, renderer: str, body: BodyConfig) -> Scene:
    """A scene from disk, or else compiled and kept there.

    Args:
        source: where worlds come from.
        name: canonical name of the scene.
        renderer: one of ``RENDERERS``.
        body: the agent's body.
    """
    limit = max_bytes()
    key = scene_key(source, name, renderer_kind(renderer), body) if limit > 0 else None
    if key is None:
        return build_scene(source, name, renderer, body)
    folder = SceneFolder()
    whole = functools.partial(rebuild_whole_model, functools.partial(source.build, name), body)
    scene = load_scene(folder, key, renderer, body, whole)
    if scene is not None:
        return scene
    world = source.build(name)
    scene = compile_scene(name, world, renderer, body)
    if not sources_unchanged():
        return scene
    try:
        save_scene(folder, key, scene)
        folder.shrink(limit)
    except OSError as error:
        warnings.warn(f"compiled scenes cannot be kept in {folder.folder} ({error})", stacklevel=2)
        return scene
    # Read from disk the scene takes less memory than as it was compiled.
    del world
    scene = load_scene(folder, key, renderer, body, whole) or scene
    trim_memory()
    return scene


def build_scene(source: WorldSource, name: str, renderer: str, body: BodyConfig, whole: bool = False) -> Scene:
    """A scene built and compiled now; arguments as of ``open_scene`` and ``compile_scene``."""
    scene = compile_scene(name, source.build(name), renderer, body, whole)
    trim_memory()
    return scene


def build_whole_scene(source: WorldSource, name: str, renderer: str, body: BodyConfig) -> Scene:
    """A scene of which the model has meshes and textures; arguments as of ``open_scene``."""
    return build_scene(source, name, renderer, body, whole=True)


def is_kept(source: WorldSource, renderer: str, name: str) -> bool:
    """Whether a scene is on disk, for agents of the usual body; arguments as of ``open_scene``."""
    key = scene_key(source, name, renderer_kind(renderer), source.profile.body)
    return key is not None and SceneFolder().path(key).is_file()


def keep_scene(source: WorldSource, renderer: str, name: str) -> str:
    """Compiles a scene for whoever needs it later; arguments as of ``open_scene``. Returns its name."""
    open_scene(source, name, renderer, source.profile.body).renderer.close()
    return name


def scene_files(source: WorldSource, renderer: str, name: str) -> tuple[str, dict[str, bytes]]:
    """Compiles a scene for another machine that has the same code and libraries; arguments as of ``open_scene``.

    Returns:
        Its name, and the files that the cache keeps of it: by its own name the scene, by theirs its textures.

    Raises:
        SbmError: if scenes of this source, or this scene on this machine, cannot be kept.
    """
    keep_scene(source, renderer, name)
    key, folder = scene_key(source, name, renderer_kind(renderer), source.profile.body), SceneFolder()
    path = folder.path(key or "")
    if key is None or not path.is_file():
        raise SbmError(f"{name}: was compiled, but the machine that did so cannot keep it")
    textures = {file: (folder.textures / file).read_bytes() for file in read_content(path)["textures"]}
    return name, {**textures, name: path.read_bytes()}


def keep_scene_files(source: WorldSource, renderer: str, name: str, files: dict[str, bytes]) -> str:
    """Keeps on this machine what ``scene_files`` has returned on another. Returns the scene's name."""
    key, folder = scene_key(source, name, renderer_kind(renderer), source.profile.body), SceneFolder()
    assert key is not None
    for file, content in files.items():
        path = folder.path(key) if file == name else folder.textures / file
        if not path.is_file():
            with atomic_file(path) as temporary:
                temporary.write_bytes(content)
    folder.shrink(max_bytes())
    return name
