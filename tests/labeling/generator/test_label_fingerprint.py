"""What invalidates the labels of an episode: its files, the settings, and the code and data that label."""

import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from labeling.generator.label_jobs import fingerprint
from labeling.generator.settings.label_config import LabelConfig
from labeling.io.episodes import write_episode
from labeling.runtime import code_digest as code_digest_module

from ..synthetic_room import make_episode

ROOT = Path(__file__).parents[3]
LOADED = """
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from labeling.generate import main
main([sys.argv[1], "--out", sys.argv[2], "--confident", "0.5"])
modules = [m for name, m in sys.modules.items() if name.startswith("labeling.") and getattr(m, "__file__", None)]
print("LOADED", *[m.__file__ for m in modules if not hasattr(m, "__path__")])
"""
NOT_LABELLING = (
    "labeling/generate.py",
    "labeling/runtime/cli.py",
    "labeling/runtime/extras.py",
    "labeling/runtime/help.py",
    "labeling/runtime/named_option.py",
    "labeling/runtime/start_up.py",
    "labeling/generator/settings/option_groups.py",
    "labeling/generator/settings/presets.py",
    "labeling/generator/label_writer.py",
    "labeling/io/label_set.py",
)
"""Loaded by the command, and without a say in the labels of an episode: label_writer writes them anew every time,
label_set says what a finished set holds."""


@contextmanager
def code_in(folder: Path) -> Iterator[None]:
    """Within, fingerprints are those of the code that lies in a folder."""
    with pytest.MonkeyPatch.context() as settings:
        settings.setattr(code_digest_module, "ROOT", folder)
        code_digest_module.code_digest.cache_clear()
        yield
    code_digest_module.code_digest.cache_clear()


@pytest.fixture(scope="module")
def copied_code(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """Where a copy of the code lies, to be changed and changed back, and its fingerprint."""
    folder = tmp_path_factory.mktemp("code")
    shutil.copytree(ROOT / "labeling", folder / "labeling", ignore=shutil.ignore_patterns("__pycache__", "weights"))
    with code_in(folder):
        return folder, fingerprint(folder / "no_episode", LabelConfig())


def test_every_module_that_labels_counts(tmp_path: Path) -> None:
    """Oracle: what a process that labels an episode has loaded."""
    write_episode(tmp_path / "room", make_episode(3, num_views=4, size=(60, 80), num_objects=3, confident_share=2.0))
    command = [sys.executable, "-c", LOADED, str(tmp_path / "room"), str(tmp_path / "out")]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT)
    loaded = {Path(name) for name in done.stdout.split("LOADED")[1].split()}
    assert len(loaded) > 40
    counted = code_digest_module.reached_files(["labeling.generator.label_jobs"])
    assert {path.relative_to(ROOT).as_posix() for path in loaded - counted} <= set(NOT_LABELLING)


@pytest.mark.parametrize(
    ("changed", "counts"),
    [
        ("generator/objects/seeds.py", True),
        ("generator/settings/source_config.py", True),
        ("generator/detection_pooling.py", True),
        ("generator/calibration/compact.json", True),
        ("metrics/matching.py", True),
        ("io/recordings/tum.py", True),
        ("core/rle.py", True),
        ("evaluation/compare.py", False),
        ("inspection/checks.py", False),
        ("inspect.py", False),
    ],
)
def test_a_change_of_code_counts_where_labels_depend_on_it(
    copied_code: tuple[Path, str], changed: str, counts: bool
) -> None:
    folder, before = copied_code
    module = folder / "labeling" / changed
    sound = module.read_bytes()
    module.write_bytes(sound + b"\n")
    try:
        with code_in(folder):
            assert (fingerprint(folder / "no_episode", LabelConfig()) != before) is counts
    finally:
        module.write_bytes(sound)


def test_files_settings_and_sources_count(tmp_path: Path) -> None:
    (tmp_path / "transforms.json").write_text("{}")
    before = fingerprint(tmp_path, LabelConfig(), ["detections.json"])
    assert fingerprint(tmp_path, LabelConfig(), ["detections.json"]) == before
    assert fingerprint(tmp_path, LabelConfig(seed=1), ["detections.json"]) != before
    assert fingerprint(tmp_path, LabelConfig(), ["compact"]) != before
    (tmp_path / ".notes").write_text("hidden files do not count")
    assert fingerprint(tmp_path, LabelConfig(), ["detections.json"]) == before
    (tmp_path / "depth.png").write_bytes(b"1")
    assert fingerprint(tmp_path, LabelConfig(), ["detections.json"]) != before
