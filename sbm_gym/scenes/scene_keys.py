"""Cache keys of compiled scenes: digests of everything that decides what a compiled scene is."""

import contextlib
import functools
import hashlib
import platform

from labeling.formats.atomic import atomic_file
from labeling.runtime.code_digest import ROOT, code_digest
from sbm_gym.robot.body import BodyConfig
from sbm_gym.scenes.compiled import WorldSource
from sbm_gym.scenes.world_sources import IndoorWorlds, OutdoorWorlds
from sbm_gym.store.cache_folder import cache_folder

FORMAT = 1
"""To be increased when the meaning of saved scenes changes without a change of code."""
_CODE = ("sbm_gym.scenes.saved_scenes", "sbm_gym.scenes.world_sources")
_SUFFIXES = (".py", ".toml", ".json")


def scene_key(source: WorldSource, scene: str, renderer: str, body: BodyConfig) -> str | None:
    """The cache key of a compiled scene; None if it cannot be cached.

    Args:
        source: builds the scene's world; scenes of sources that do not come with sbm_gym are not cached.
        scene: canonical name.
        renderer: "rays" or "gl".
        body: the agent's body.
    """
    if type(source) not in (IndoorWorlds, OutdoorWorlds):
        return None
    assert isinstance(source, IndoorWorlds)
    libraries = "" if source.builtin else _libraries()
    parts = (FORMAT, type(source).__name__, source.unseen_models, source.builtin, scene, renderer, body, libraries)
    if source.movable:
        parts += ("movable",)
    digest = hashlib.sha256(repr((*parts, *_surroundings())).encode()).hexdigest()[:24]
    safe = "".join(letter if letter.isalnum() else "-" for letter in scene)
    return f"{safe}-{renderer}-{digest}"


def _libraries() -> str:
    """The installed furniture libraries: their files, as they are now."""
    from sbm_gym.assets.catalog.catalog import find_libraries

    return repr([(path.name, path.stat().st_size, path.stat().st_mtime_ns) for path in find_libraries()])


@functools.cache
def _surroundings() -> tuple[str, ...]:
    """The parts of keys that all scenes of a process share: operating system, processor, versions, digest of code."""
    import cv2
    import mujoco
    import numba
    import numpy
    import scipy

    versions = [module.__version__ for module in (cv2, mujoco, numba, numpy, scipy)]
    return (platform.system(), platform.machine(), *versions, _code())


def _state_of_sources() -> str:
    """A digest of names, sizes and times of all source files that scenes could depend on."""
    files = [
        path for name in ("labeling", "sbm_gym") for path in (ROOT / name).rglob("*.*") if path.suffix in _SUFFIXES
    ]
    states = [(str(path), path.stat().st_size, path.stat().st_mtime_ns) for path in sorted(files)]
    return hashlib.sha256(repr(states).encode()).hexdigest()[:24]


_AT_START = _state_of_sources()


def sources_unchanged() -> bool:
    """Whether no source file has changed since this process started; scenes built after a change are not cached."""
    return _state_of_sources() == _AT_START


def _code() -> str:
    """The digest of the code that makes scenes; cached, since following imports takes longer than opening a scene."""
    kept = cache_folder() / "scenes" / "code" / _AT_START
    try:
        return kept.read_text(encoding="ascii")
    except (OSError, ValueError):
        digest = code_digest(*_CODE)
    with contextlib.suppress(OSError), atomic_file(kept) as temporary:  # without the file the digest is computed again
        temporary.write_text(digest, encoding="ascii")
    return digest
