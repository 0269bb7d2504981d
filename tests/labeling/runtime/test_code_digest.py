"""Digests change with all code that an outcome depends on, and with no other."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from agents.rollouts.recorder import collect_episodes
from labeling.runtime import code_digest as module
from labeling.runtime.code_digest import ROOT, code_digest, reached_code

CODE = {
    "__init__": "attach = 'on demand'\n",
    "a": "def f():\n    from labeling import b\n    import numpy\n    return 'labeling.named:thing'\n",
    "named": "def thing(): ...\ndef other_thing(): ...\n",
    "b": "from labeling.c import x\n",
    "c": "import labeling.a\nx = 1\nunused = 1\n",
    "d": "x = 2\n",
    "e": """
from typing import TYPE_CHECKING
from labeling.b import x
from labeling.d import x as other
from labeling import registers, tools
if TYPE_CHECKING:
    from labeling.types import Told
LIMIT = 3
UNUSED = 4
def called(value: "Told"):
    '''Says what it does.'''
    return helped(value)  # a comment
def helped(value):
    return tools.used(value + x * LIMIT)
def apart():
    return other + UNUSED
class Named:
    kind: Told
""",
    "types": "class Told:\n    size = 1\n",
    "tools": "def used(value): ...\ndef idle(): ...\n",
    "registers": """
KNOWN = {}
def known(what):
    KNOWN[what.__name__] = what
    return what
class Plain: ...
@known
def one():
    return helper()
def helper(): ...
def two(): ...
settings = Plain()
made = known(two)
KNOWN["three"] = 3
if one():
    four = 4
if __name__ == "__main__":
    two()
""",
    "whole": "from labeling import tools\ndef everything():\n    return vars(tools)\n",
}


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    monkeypatch.setattr(module, "ROOT", tmp_path)
    (tmp_path / "labeling").mkdir()
    for name, text in CODE.items():
        (tmp_path / "labeling" / f"{name}.py").write_text(text)
    (tmp_path / "labeling" / "__init__.pyi").write_text("from labeling.tools import used as used\n")
    code_digest.cache_clear()
    yield tmp_path / "labeling"
    code_digest.cache_clear()


def changed_by(path: Path, text: str, *targets: Any) -> bool:
    before = code_digest(*targets)
    path.write_text(text)
    code_digest.cache_clear()
    return code_digest(*targets) != before


def function(name: str, where: str = "e") -> Callable[..., Any]:
    """What stands for a function of one of the modules."""

    def stand() -> None: ...

    stand.__module__, stand.__qualname__ = f"labeling.{where}", name
    return stand


def reached_by(target: Callable[..., Any]) -> set[str]:
    """Names of functions and classes."""
    return {name for _, name in reached_code(target).names()}


def test_modules_reach_what_is_imported_in_functions_and_through_packages(package: Path) -> None:
    (package / "learnt.json").write_text("{}")
    names = {path.name for path in reached_code("labeling.a").contents()}
    assert names == {"a.py", "c.py", "named.py", "learnt.json"}  # b.py only hands on
    assert not changed_by(package / "d.py", "x = 3\n", "labeling.a")
    assert changed_by(package / "c.py", "import labeling.a\nx = 2\nunused = 1\n", "labeling.a")
    assert changed_by(package / "learnt.json", "[]", "labeling.a")


def test_functions_reach_what_they_name_directly_or_not(package: Path) -> None:
    found = reached_by(function("called"))
    assert {"called", "helped", "used", "Told"} <= found
    assert not found & {"apart", "Named", "idle"}
    assert "Told" in reached_by(function("Named.kind"))
    assert reached_by(function("f", "a")) & {"thing", "other_thing"} == {"thing"}
    assert {"used", "idle"} <= reached_by(function("everything", "whole"))


@pytest.mark.parametrize(
    ("where", "old", "new", "counts"),
    [
        ("e", "LIMIT = 3", "LIMIT = 4", True),
        ("e", "value + x", "value - x", True),
        ("e", "UNUSED = 4", "UNUSED = 5", False),
        ("e", "other + UNUSED", "other - UNUSED", False),
        ("e", "a comment", "another", False),
        ("e", "what it does", "more", False),
        ("e", "labeling.b import x", "labeling.d import x", True),
        ("c", "x = 1", "x = 2", True),
        ("c", "unused = 1", "unused = 2", False),
        ("d", "x = 2", "x = 3", False),
        ("types", "size = 1", "size = 2", True),
        ("tools", "def used(value): ...", "def used(value): return value", True),
        ("tools", "def idle(): ...", "def idle(): return 1", False),
        # What a module does that is imported on the way: it registers by a decorator, by a call, as it goes.
        ("registers", "def helper(): ...", "def helper(): return 1", True),
        ("registers", "def two(): ...", "def two(): return 2", True),
        ("registers", '["three"] = 3', '["three"] = 4', True),
        ("registers", "if one():", "if not one():", True),
        ("registers", "class Plain: ...", "class Plain:\n    x = 1", False),  # to make an object registers nothing
        ("registers", "four = 4", "four = 5", False),
        ("registers", "    two()\n", "    one()\n", False),
    ],
)
def test_a_change_counts_where_the_function_depends_on_it(
    package: Path, where: str, old: str, new: str, counts: bool
) -> None:
    text = CODE[where].replace(old, new)
    assert text != CODE[where]
    assert changed_by(package / f"{where}.py", text, function("called")) is counts


@pytest.mark.parametrize(
    "text",
    [
        "import labeling.named\nimport labeling.tools\ndef asks():\n    return labeling.tools.idle()\n",
        "try:\n    from labeling import named as one\nexcept ImportError:\n    from labeling import tools as one\n"
        "def asks():\n    return one.idle()\n",
        "if 1 > 0:\n    from labeling import named as one\nelse:\n    from labeling import tools as one\n"
        "def asks():\n    return one.idle()\n",
    ],
    ids=["several modules of a package", "one or the other", "under a condition"],
)
def test_a_name_that_may_mean_several_modules_reaches_all(package: Path, text: str) -> None:
    (package / "asks.py").write_text(text)
    assert {"idle", "thing"} <= reached_by(function("asks", "asks"))


def test_what_a_package_gives_on_demand_is_found(package: Path) -> None:
    (package / "asks.py").write_text("import labeling\ndef asks():\n    return labeling.used(1)\n")
    found = reached_by(function("asks", "asks"))
    assert "used" in found
    assert "idle" not in found


@pytest.mark.slow
def test_labels_and_recordings_depend_on_the_code_that_makes_them() -> None:
    names = {path.stem for path in reached_code("labeling.generator.propagate").contents()}
    assert {"association", "mean_field", "permutohedral_lattice", "per_detection", "published_defects"} <= names
    assert not names & {"html", "viewer"}
    files = {path.relative_to(ROOT).as_posix() for path in reached_code(collect_episodes).contents()}
    assert {"sbm_gym/env/fixation_env.py", "sbm_gym/registration.py", "agents/policies/ring.py"} <= files
