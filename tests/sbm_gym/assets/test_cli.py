import pytest

from sbm_gym.assets.__main__ import main

from .tiny_library import write_library


@pytest.fixture
def only_box(tmp_path, monkeypatch):
    """A library with one model, under the name of a mapped one."""
    catalogue = "id#1=Scopia#tv\n"
    write_library(tmp_path / "tiny.sh3f", catalogue=catalogue)
    monkeypatch.setenv("SBM_FURNITURE", str(tmp_path))
    monkeypatch.setenv("SBM_CACHE", str(tmp_path / "cache"))
    return tmp_path


def test_list_shows_models_by_class(only_box, capsys):
    assert main(["list"]) == 0
    out = capsys.readouterr().out
    assert "Scopia#tv" in out.replace("\n", "")
    assert "tv 1" in out


def test_an_unknown_class_is_refused(only_box, capsys):
    assert main(["list", "--category", "spaceship"]) == 2
    assert "error: there is no class 'spaceship'; classes are chair, couch" in capsys.readouterr().err


def test_install_fills_the_cache_and_writes_credits(only_box):
    assert main(["install"]) == 0
    assert "A. Maker" in (only_box / "cache" / "CREDITS.md").read_text(encoding="utf-8")
    assert len(list((only_box / "cache").rglob("model.npz"))) == 1


def test_credits_go_to_a_file(only_box):
    out = only_box / "credits.md"
    assert main(["credits", "--out", str(out)]) == 0
    assert "CC0 1.0" in out.read_text(encoding="utf-8")


def test_missing_libraries_are_one_line(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("SBM_FURNITURE", str(tmp_path))
    assert main(["list"]) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: no furniture libraries")
    assert "sudo apt-get install sweethome3d-furniture" in error
    assert error.count("\n") == 1


def test_builtin_models_are_listed_without_libraries(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("SBM_FURNITURE", str(tmp_path))
    assert main(["list", "--builtin", "--category", "cushion"]) == 0
    out = capsys.readouterr().out
    assert "leaning" in out
    assert "fridge" not in out
