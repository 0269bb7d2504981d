"""``python -m sbm_gym.scenes`` and ``python -m sbm_gym.assets cache``."""

import pytest

from sbm_gym.assets.__main__ import main as assets
from sbm_gym.scenes.__main__ import main
from sbm_gym.store.cache_folder import SceneFolder

BUILTIN = ["--env", "sbm_gym/IndoorBuiltin-v0", "--split", "test"]


@pytest.fixture
def cache(tmp_path, monkeypatch) -> SceneFolder:
    monkeypatch.setenv("SBM_CACHE", str(tmp_path))
    return SceneFolder()


@pytest.mark.slow
def test_scenes_are_built_once_listed_and_cleared(cache, capsys):
    assert main(["list", *BUILTIN]) == 0
    assert capsys.readouterr().out.splitlines() == ["test/00", "test/01"]
    assert main(["build", *BUILTIN, "--scenes", "1"]) == 0
    assert "1 of 1 scenes are kept, 1 of them built now" in capsys.readouterr().out
    assert main(["build", *BUILTIN, "--workers", "2"]) == 0
    assert "2 of 2 scenes are kept, 1 of them built now" in capsys.readouterr().out
    assert main(["build", *BUILTIN]) == 0
    assert "2 of 2 scenes are kept, 0 of them built now" in capsys.readouterr().out
    assert main(["list", *BUILTIN]) == 0
    assert capsys.readouterr().out.splitlines() == ["test/00  kept", "test/01  kept"]
    assert assets(["cache"]) == 0
    listed = capsys.readouterr().out
    assert "(test/00)" in listed
    assert "(test/01)" in listed
    assert f"2 scenes in {cache.folder}" in listed
    cache.scenes()[0].path.write_bytes(b"")
    assert assets(["cache", "--max-gb", "1"]) == 0
    assert "damaged, will be made again" in capsys.readouterr().out
    assert assets(["cache", "--clear"]) == 0
    assert "removed 2 scenes" in capsys.readouterr().out
    assert cache.total_bytes() == 0


@pytest.mark.slow
def test_a_cache_too_small_for_the_scenes_says_so(cache, monkeypatch, capsys):
    monkeypatch.setenv("SBM_SCENE_CACHE", "0.001")
    assert main(["build", *BUILTIN, "--scenes", "1"]) == 2
    assert "more scenes than the cache may hold" in capsys.readouterr().err


def test_bad_input_is_one_line(cache, monkeypatch, capsys):
    assert main(["build", "--env", "sbm_gym/Nowhere-v0"]) == 2
    assert "unknown env 'sbm_gym/Nowhere-v0'" in capsys.readouterr().err
    assert main(["build", "--workers", "0"]) == 2
    assert assets(["cache", "--max-gb", "-1"]) == 2
    monkeypatch.setenv("SBM_SCENE_CACHE", "off")
    assert main(["list", *BUILTIN]) == 2
    assert "SBM_SCENE_CACHE says that no scenes are kept" in capsys.readouterr().err


@pytest.mark.slow
def test_a_scene_that_another_machine_has_compiled_is_kept_here(tmp_path, monkeypatch):
    from sbm_gym.scenes.scene_cache import is_kept, keep_scene_files, scene_files
    from sbm_gym.scenes.world_sources import world_source

    source = world_source("indoor-builtin")
    name = source.scenes("train")[0]
    monkeypatch.setenv("SBM_CACHE", str(tmp_path / "there"))
    made = scene_files(source, "rays", name)
    monkeypatch.setenv("SBM_CACHE", str(tmp_path / "here"))
    assert not is_kept(source, "rays", name)
    assert keep_scene_files(source, "rays", *made) == name
    assert is_kept(source, "rays", name)
    kept = [
        {path.name: path.read_bytes() for files in ("*.scene", "textures/*") for path in (at / "scenes").glob(files)}
        for at in (tmp_path / "here", tmp_path / "there")
    ]
    assert kept[0] == kept[1]
    assert len(kept[0]) > 1
