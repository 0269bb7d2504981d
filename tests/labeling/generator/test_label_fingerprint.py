"""What invalidates the labels of an episode: its files, the settings, and the code and data that label."""

import ast
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
CALLED = """
import sys, threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
called = set()
def remember(frame, event, argument):
    if event == "call":
        called.add(frame.f_code)
threading.setprofile(remember)
sys.setprofile(remember)
from labeling.generate import main
main([sys.argv[1], "--out", sys.argv[2], "--confident", "0.5"])
sys.setprofile(None)
functions = [code for code in list(called) if code.co_flags & 2]  # others are bodies of classes
print("CALLED", *[f"{code.co_filename}:{code.co_qualname.partition('.')[0]}" for code in functions], sep="\\n")
"""
NOT_LABELLING = (
    "labeling/generate.py",
    "labeling/runtime/cli.py",
    "labeling/runtime/help.py",
    "labeling/runtime/interrupts.py",
    "labeling/runtime/named_option.py",
    "labeling/runtime/progress.py",
    "labeling/runtime/run_folder.py",
    "labeling/generator/label_writer.py",
    "labeling/generator/settings/presets.py",
    "labeling/io/label_set.py",
)
"""Of the command, without a say in the labels of an episode: label_writer writes them anew every time, label_set says
what a finished set holds, run_folder where one may lie."""
GIVEN = {"source_fingerprint", "find_episodes"}
"""What the command asks of the episodes before: which there are, and what masks are made of, is digested by itself."""


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


@pytest.mark.slow
def test_every_function_that_labels_counts(tmp_path: Path) -> None:
    """Oracle: what a process that labels an episode calls."""
    write_episode(tmp_path / "room", make_episode(3, num_views=4, size=(60, 80), num_objects=3, confident_share=2.0))
    command = [sys.executable, "-c", CALLED, str(tmp_path / "room"), str(tmp_path / "out")]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT)
    lines = [line.rpartition(":") for line in done.stdout.split("CALLED")[1].split("\n") if line]
    called = {(Path(file), name) for file, _, name in lines if Path(file).is_relative_to(ROOT / "labeling")}
    called = {(file, name) for file, name in called if name.isidentifier()}
    assert len(called) > 150
    counted = code_digest_module.reached_code("labeling.generator.label_jobs").names()
    missed = {(file.relative_to(ROOT).as_posix(), name) for file, name in called - counted}
    assert {one for one in missed if one[0] not in NOT_LABELLING and one[1] not in GIVEN} == set()


@pytest.mark.slow
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
        ("metrics/average_precision.py", False),
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
    module.write_bytes(sound + b"\n" if module.suffix == ".json" else doing_more(sound))
    try:
        with code_in(folder):
            assert (fingerprint(folder / "no_episode", LabelConfig()) != before) is counts
    finally:
        module.write_bytes(sound)


def doing_more(source: bytes) -> bytes:
    """A module whose functions all have one statement more."""
    tree = ast.parse(source)
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef):
            node.body.append(ast.Pass())
    return ast.unparse(tree).encode()


@pytest.mark.slow
def test_a_comment_does_not_count(copied_code: tuple[Path, str]) -> None:
    folder, before = copied_code
    module = folder / "labeling" / "generator" / "propagate.py"
    sound = module.read_bytes()
    module.write_bytes(b"# explained\n" + sound)
    try:
        with code_in(folder):
            assert fingerprint(folder / "no_episode", LabelConfig()) == before
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
