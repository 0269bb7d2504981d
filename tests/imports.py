"""The project's modules and who imports whom, read from their source: nothing is imported to find out."""

import ast
import re
from collections import defaultdict
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("labeling", "sbm_gym", "agents", "experiments")
"""The floors of the house, the ground floor first: each may import those before it."""
_ANNOTATES_SHAPES = re.compile(r"^from jaxtyping import", re.MULTILINE)
_PROTOCOL = re.compile(r"^class (\w+)\(Protocol", re.MULTILINE)
_USES_NUMBA = re.compile(r"^ *(from|import) numba\b", re.MULTILINE)


@cache
def modules(package: str) -> dict[str, Path]:
    """Modules of a package (or of a folder such as ``sbm_gym.assets``) by dotted name, without ``__init__``."""
    folder = ROOT / package.replace(".", "/")
    return {
        ".".join(path.relative_to(ROOT).with_suffix("").parts): path
        for path in sorted(folder.rglob("*.py"))
        if path.name != "__init__.py"
    }


@cache
def syntax_tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def folder_of(module: str) -> str:
    return module.rpartition(".")[0]


def package_of(module: str) -> str:
    return module.partition(".")[0]


def imported_names(tree: ast.AST) -> Iterator[str]:
    """Dotted names of all imports, also of those inside functions: of ``from a import b`` both ``a`` and ``a.b``."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def relative_imports(path: Path) -> bool:
    return any(isinstance(node, ast.ImportFrom) and node.level for node in ast.walk(syntax_tree(path)))


@cache
def imports() -> dict[str, frozenset[str]]:
    """For every module of the project, the modules of the project that it imports."""
    paths = {name: path for package in PACKAGES for name, path in modules(package).items()}
    return {
        name: frozenset(set(imported_names(syntax_tree(path))) & paths.keys() - {name}) for name, path in paths.items()
    }


def folder_imports(package: str) -> dict[str, set[str]]:
    """For every folder of a package, the other folders of that package that its modules import."""
    found: dict[str, set[str]] = defaultdict(set)
    for name in modules(package):
        for other in imports()[name]:
            if package_of(other) == package and folder_of(other) != folder_of(name):
                found[folder_of(name)].add(folder_of(other))
    return found


def commands() -> list[str]:
    """What ``python -m`` runs: modules that call ``main`` when run, and packages that have a ``__main__``."""
    return sorted(
        name.removesuffix(".__main__")
        for package in PACKAGES
        for name, path in modules(package).items()
        if 'if __name__ == "__main__"' in path.read_text(encoding="utf-8")
    )


def checked_by_jaxtyping() -> list[str]:
    """Modules whose array shapes are checked while tests run: those of ``labeling`` that annotate shapes.

    With two exceptions: modules that compile kernels, because the import hook rewrites functions, which numba's cache
    does not survive; and those that annotate arguments with a ``Protocol``, which nothing can be checked against at run
    time. Of the packages above only the geometry of worlds is checked: the others pass numpy's scalars where a float is
    annotated.
    """
    sources = {
        name: path.read_text(encoding="utf-8") for package in PACKAGES for name, path in modules(package).items()
    }
    protocols = "|".join({found for source in sources.values() for found in _PROTOCOL.findall(source)})
    annotates_protocol = re.compile(rf"(: |-> |\| |\[)({protocols})\b")
    return [
        name
        for name, source in sources.items()
        if name.startswith(("labeling.", "sbm_gym.worlds.geometry."))
        and _ANNOTATES_SHAPES.search(source)
        and not _USES_NUMBA.search(source)
        and not annotates_protocol.search(source)
    ]
