"""The cache folder, and the bounded cache of compiled scenes in it."""

import contextlib
import os
import time
from dataclasses import dataclass
from pathlib import Path

from labeling.core.errors import UsageError

CACHE_VARIABLE = "SBM_CACHE"
"""Environment variable that names the cache folder."""
SCENES_VARIABLE = "SBM_SCENE_CACHE"
"""Environment variable that says how many GB of compiled scenes are kept, or ``off``."""
DEFAULT_GB = 8.0
JUST_USED_S = 3600.0
"""Textures used more recently than this are not removed: their scene may not be written yet."""


def cache_folder() -> Path:
    """The user's cache folder: ``SBM_CACHE`` if set, else ``seeing-by-moving`` in the XDG cache folder."""
    override = os.environ.get(CACHE_VARIABLE)
    if override:
        return Path(override)
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "seeing-by-moving"


def max_bytes() -> int:
    """Largest size of the cache of compiled scenes, bytes; 0 turns it off.

    Raises:
        UsageError: if the environment variable says something else.
    """
    text = os.environ.get(SCENES_VARIABLE, str(DEFAULT_GB))
    try:
        size = 0.0 if text == "off" else float(text)
    except ValueError:
        size = -1.0
    if not 0.0 <= size < float("inf"):
        raise UsageError(f"{SCENES_VARIABLE} is a number of GB or 'off', not {text!r}")
    return int(size * 1e9)


@dataclass(frozen=True)
class KeptScene:
    """A compiled scene in the cache."""

    path: Path
    bytes: int
    """Size without textures, which scenes share."""
    used_s: float
    """When it was last used, seconds since 1970."""


class SceneFolder:
    """The cache of compiled scenes on disk. Anything in it may be deleted at any time: it is made again."""

    def __init__(self, folder: Path | None = None) -> None:
        """Does not touch the disk yet.

        Args:
            folder: by default ``scenes`` in the cache folder.
        """
        self.folder = folder or cache_folder() / "scenes"
        self.textures = self.folder / "textures"

    def path(self, key: str) -> Path:
        """The file of a scene."""
        return self.folder / f"{key}.scene"

    def used(self, path: Path) -> None:
        """Records that a scene was used now."""
        with contextlib.suppress(OSError):
            os.utime(path)

    def scenes(self) -> list[KeptScene]:
        """All scenes, those used last first."""
        found = []
        for path in self.folder.glob("*.scene"):
            with contextlib.suppress(OSError):  # another process has just removed it
                status = path.stat()
                found.append(KeptScene(path, status.st_size, status.st_mtime))
        return sorted(found, key=lambda scene: -scene.used_s)

    def texture_bytes(self) -> int:
        """Bytes of all textures together."""
        return sum(status.st_size for _, status in self._texture_files())

    def total_bytes(self) -> int:
        """Bytes of all scenes and textures."""
        return sum(scene.bytes for scene in self.scenes()) + self.texture_bytes()

    def shrink(self, limit: int, just_used_s: float = JUST_USED_S) -> int:
        """Removes the scenes used longest ago, and textures of no scene, until the cache is within the limit.

        Processes that have opened a removed scene can go on using it.

        Args:
            limit: largest size, bytes; 0 removes everything.
            just_used_s: textures of no scene stay if they were used more recently than this, seconds.

        Returns:
            How many scenes were removed.
        """
        from sbm_gym.store.packed_file import DamagedError, read_content

        scenes = self.scenes()
        total = sum(scene.bytes for scene in scenes) + self.texture_bytes()
        removed = 0
        while scenes and (total > limit or limit == 0):
            # A tenth at a time: finding the textures of all other scenes takes longer than removing.
            for _ in range(max(len(scenes) // 10, 1)):
                scenes.pop().path.unlink(missing_ok=True)
                removed += 1
            shown: set[str] = set()
            for scene in scenes:
                with contextlib.suppress(OSError, DamagedError):
                    shown.update(read_content(scene.path)["textures"])
            for path, status in self._texture_files():
                if path.name not in shown and time.time() - status.st_mtime >= just_used_s:
                    path.unlink(missing_ok=True)
            total = sum(scene.bytes for scene in scenes) + self.texture_bytes()
        for path in self.folder.glob(".*.tmp"):  # of processes that were killed
            with contextlib.suppress(OSError):
                if time.time() - path.stat().st_mtime >= just_used_s:
                    path.unlink()
        return removed

    def _texture_files(self) -> list[tuple[Path, os.stat_result]]:
        found = []
        for path in self.textures.glob("*"):
            with contextlib.suppress(OSError):
                found.append((path, path.stat()))
        return found
