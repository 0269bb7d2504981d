"""Digests change with all code that an outcome depends on, and with no other."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from agents.rollouts.recorder import collect_episodes
from labeling.runtime import code_digest as module
from labeling.runtime.code_digest import ROOT, code_digest, definitions, reached_files

CODE = {
    "__init__": "",
    "a": "def f():\n    from labeling import b\n    import numpy\n    return 'labeling.named:thing'\n",
    "named": "",
    "b": "from labeling.c import x\n",
    "c": "import labeling.a\nx = 1\n",
    "d": "x = 2\n",
    "e": """
from typing import TYPE_CHECKING
from labeling.b import x
from labeling.d import x as other
if TYPE_CHECKING:
    from labeling.a import f
LIMIT = 3
UNUSED = 4
def called(value: "f"):
    return helped(value)  # a comment
def helped(value):
    return value + x * LIMIT
def apart():
    return other + UNUSED
class Named:
    kind: f
""",
}


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    monkeypatch.setattr(module, "ROOT", tmp_path)
    (tmp_path / "labeling").mkdir()
    for name, text in CODE.items():
        (tmp_path / "labeling" / f"{name}.py").write_text(text)
    code_digest.cache_clear()
    yield tmp_path / "labeling"
    code_digest.cache_clear()


def changed_by(path: Path, text: str, *targets: Any) -> bool:
    before = code_digest(*targets)
    path.write_text(text)
    code_digest.cache_clear()
    return code_digest(*targets) != before


def function(name: str) -> Callable[..., Any]:
    """What stands for a function of the module ``labeling.e``."""

    def stand() -> None: ...

    stand.__module__, stand.__qualname__ = "labeling.e", name
    return stand


def test_modules_reach_what_is_imported_in_functions_and_through_packages(package: Path) -> None:
    (package / "learnt.json").write_text("{}")
    names = {path.name for path in reached_files(["labeling.a"])}
    assert names == {"__init__.py", "a.py", "b.py", "c.py", "named.py", "learnt.json"}
    assert not changed_by(package / "d.py", "x = 3\n", "labeling.a")
    assert changed_by(package / "c.py", "import labeling.a\nx = 2\n", "labeling.a")
    assert changed_by(package / "learnt.json", "[]", "labeling.a")


def test_functions_are_made_of_what_they_name_directly_or_not(package: Path) -> None:
    source, imported = definitions(function("called"))
    assert "LIMIT = 3" in source
    assert "def helped" in source
    assert not any(text in source for text in ("UNUSED", "apart", "comment", "Named"))
    assert "labeling.b" in imported
    assert "labeling.d" not in imported
    assert "labeling.a" in definitions(function("Named.kind"))[1]


@pytest.mark.parametrize(
    ("old", "new", "counts"),
    [
        ("LIMIT = 3", "LIMIT = 4", True),
        ("value + x", "value - x", True),
        ("UNUSED = 4", "UNUSED = 5", False),
        ("other + UNUSED", "other - UNUSED", False),
        ("a comment", "another", False),
        ("labeling.b import x", "labeling.d import x", True),
    ],
)
def test_a_change_counts_where_the_function_depends_on_it(package: Path, old: str, new: str, counts: bool) -> None:
    text = CODE["e"].replace(old, new)
    assert text != CODE["e"]
    assert changed_by(package / "e.py", text, function("called")) is counts


def test_what_a_function_imports_counts(package: Path) -> None:
    assert not changed_by(package / "d.py", "x = 3\n", function("called"))
    assert changed_by(package / "c.py", "import labeling.a\nx = 2\n", function("called"))


def test_labels_and_recordings_depend_on_the_code_that_makes_them() -> None:
    names = {path.stem for path in reached_files(["labeling.generator.propagate"])}
    assert {"association", "mean_field", "permutohedral_lattice", "per_detection", "published_defects"} <= names
    assert not names & {"html", "viewer"}
    recorded = {path.relative_to(ROOT).as_posix() for path in reached_files(definitions(collect_episodes)[1])}
    assert {"sbm_gym/env/fixation_env.py", "sbm_gym/registration.py", "agents/policies/ring.py"} <= recorded
