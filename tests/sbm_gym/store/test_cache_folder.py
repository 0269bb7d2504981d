"""The folder of compiled scenes stays as small as it was told to."""

import os

import numpy as np
import pytest

from labeling.core.errors import UsageError
from sbm_gym.store.cache_folder import DEFAULT_GB, SceneFolder, max_bytes
from sbm_gym.store.packed_file import write_packed
from sbm_gym.store.texel_files import save_texels


def keep(folder: SceneFolder, key: str, textures: list[int], used_s: float) -> None:
    """A scene of 100 kB with textures of 100 kB each."""
    names = [save_texels(folder.textures, np.full((25_000, 4), texture, np.uint8)).name for texture in textures]
    write_packed(folder.path(key), {"textures": names}, [np.zeros(12_500)])
    os.utime(folder.path(key), (used_s, used_s))


@pytest.fixture
def folder(tmp_path) -> SceneFolder:
    folder = SceneFolder(tmp_path / "scenes")
    for number, textures in enumerate(([1, 2], [2, 3], [3, 4])):
        keep(folder, f"scene-{number}", textures, used_s=1000.0 + number)
    return folder


def test_what_was_used_longest_ago_goes_first(folder):
    assert [scene.path.stem for scene in folder.scenes()] == ["scene-2", "scene-1", "scene-0"]
    assert folder.shrink(folder.total_bytes()) == 0
    folder.used(folder.path("scene-0"))
    assert folder.shrink(folder.total_bytes() - 1, just_used_s=0.0) == 1
    assert [scene.path.stem for scene in folder.scenes()] == ["scene-0", "scene-2"]
    # The two that are left have no texture in common, and the one of the third that nobody else shows is none.
    assert len(list(folder.textures.iterdir())) == 4
    assert folder.shrink(350_000, just_used_s=0.0) == 1
    assert [scene.path.stem for scene in folder.scenes()] == ["scene-0"]
    assert len(list(folder.textures.iterdir())) == 2
    assert folder.total_bytes() <= 350_000


def test_textures_of_a_scene_about_to_be_written_stay(folder):
    assert folder.shrink(0) == 3
    assert not folder.scenes()
    assert len(list(folder.textures.iterdir())) == 4
    folder.shrink(0, just_used_s=0.0)


def test_everything_can_go(folder):
    (folder.folder / ".scene-9.scene.1.tmp").write_bytes(b"half")
    folder.shrink(0, just_used_s=0.0)
    assert folder.total_bytes() == 0
    assert not list(folder.folder.glob(".*.tmp"))


def test_an_empty_folder_is_fine(tmp_path):
    folder = SceneFolder(tmp_path / "nothing")
    assert folder.scenes() == []
    assert folder.total_bytes() == folder.shrink(0) == 0


def test_the_limit_comes_from_the_environment(monkeypatch):
    monkeypatch.delenv("SBM_SCENE_CACHE", raising=False)
    assert max_bytes() == DEFAULT_GB * 1e9
    for text, expected in (("off", 0), ("0", 0), ("1.5", 1_500_000_000)):
        monkeypatch.setenv("SBM_SCENE_CACHE", text)
        assert max_bytes() == expected
    for text in ("on", "-1", "nan", "inf"):
        monkeypatch.setenv("SBM_SCENE_CACHE", text)
        with pytest.raises(UsageError, match="SBM_SCENE_CACHE is a number of GB or 'off'"):
            max_bytes()
