"""What decides an outcome besides its inputs: a digest of the source of all modules that its code imports."""

import ast
import hashlib
from collections.abc import Sequence
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


PACKAGES = ("labeling", "sbm_gym", "agents", "experiments")


@cache
def code_digest(*modules: str) -> str:
    """Changes whenever the source of one of these modules does, or of any module of the project that they import."""
    found = hashlib.sha256()
    for path in sorted(reached_files(modules)):
        found.update(path.relative_to(ROOT).as_posix().encode() + b"\0" + path.read_bytes())
    return found.hexdigest()


def reached_files(modules: Sequence[str]) -> set[Path]:
    """Source files of these modules and of all that they import, within the project; imports in functions count.

    So do JSON and TOML files beside them: what a module has learnt decides its outcome as its code does.
    """
    found: set[Path] = set()
    waiting = list(modules)
    while waiting:
        path = _source(waiting.pop())
        if path is None or path in found:
            continue
        found.add(path)
        found.update(data for data in path.parent.iterdir() if data.suffix in (".json", ".toml"))
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                waiting.extend(alias.name for alias in node.names)
            elif isinstance(node, ast.ImportFrom) and node.module:
                waiting.append(node.module)
                waiting.extend(f"{node.module}.{alias.name}" for alias in node.names)
    return found


def _source(module: str) -> Path | None:
    if module.split(".")[0] not in PACKAGES:
        return None
    stem = ROOT.joinpath(*module.split("."))
    return next((path for path in (stem.with_suffix(".py"), stem / "__init__.py") if path.is_file()), None)
