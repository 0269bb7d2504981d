"""What decides an outcome besides its inputs: a digest of the code that computes it, found by following imports."""

import ast
import hashlib
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("labeling", "sbm_gym", "agents", "experiments")


@cache
def code_digest(*targets: str | Callable[..., Any]) -> str:
    """Changes whenever code does that an outcome depends on.

    Args:
        targets: functions or classes that compute it: what they are made of counts, with all that they name in their
            module, and all modules of the project that this imports. Or names of modules, which count as a whole.
    """
    found, modules = hashlib.sha256(), []
    for target in targets:
        if isinstance(target, str):
            modules.append(target)
        else:
            source, imported = definitions(target)
            found.update(source.encode())
            modules += imported
    for path in sorted(reached_files(modules)):
        found.update(path.relative_to(ROOT).as_posix().encode() + b"\0" + path.read_bytes())
    return found.hexdigest()


def reached_files(modules: Iterable[str]) -> set[Path]:
    """Source files of these modules and of all that they import, within the project; imports in functions count.

    So do JSON and TOML files beside them: what a module has learnt or reads decides its outcome as its code does.
    """
    found: set[Path] = set()
    waiting = list(modules)
    while waiting:
        path = _source(waiting.pop())
        if path is None or path in found:
            continue
        found.add(path)
        found.update(file for file in path.parent.iterdir() if file.suffix in (".json", ".toml"))
        waiting.extend(_imports(ast.parse(path.read_text(encoding="utf-8"))))
    return found


def definitions(target: Callable[..., Any]) -> tuple[str, list[str]]:
    """What a function or class is made of.

    Returns:
        The source of its definition and of all that it names in its module, directly or not, without comments; and
        the modules that this imports.
    """
    path = _source(target.__module__)
    if path is None:
        return "", []
    statements: dict[str, list[ast.stmt]] = {}
    for statement in _top_level(ast.parse(path.read_text(encoding="utf-8")).body):
        for name in _names(statement):
            statements.setdefault(name, []).append(statement)
    parts: dict[ast.stmt, str] = {}
    waiting = [target.__qualname__.partition(".")[0]]
    while waiting:
        for statement in statements.pop(waiting.pop(), ()):
            parts[statement] = ast.unparse(statement)
            waiting.extend(node.id for node in ast.walk(statement) if isinstance(node, ast.Name))
    return "\n".join(sorted(parts.values())), [module for part in parts for module in _imports(part)]


def _top_level(statements: Iterable[ast.stmt]) -> Iterator[ast.stmt]:
    """Statements of a module, and those in its ``if`` blocks."""
    for statement in statements:
        if isinstance(statement, ast.If):
            yield from _top_level([*statement.body, *statement.orelse])
        else:
            yield statement


def _names(statement: ast.stmt) -> set[str]:
    """What a statement defines."""
    if isinstance(statement, ast.Import | ast.ImportFrom):
        return {(alias.asname or alias.name).partition(".")[0] for alias in statement.names}
    if isinstance(statement, ast.FunctionDef | ast.ClassDef):
        return {statement.name}
    return {
        node.id for node in ast.walk(statement) if isinstance(node, ast.Name) and not isinstance(node.ctx, ast.Load)
    }


def _imports(tree: ast.AST) -> Iterator[str]:
    """Modules that code imports, or that strings of it name as entry points: "package.module:name"."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            module, colon, name = node.value.partition(":")
            if colon and name.isidentifier():
                yield module


def _source(module: str) -> Path | None:
    if module.split(".")[0] not in PACKAGES:
        return None
    stem = ROOT.joinpath(*module.split("."))
    return next((path for path in (stem.with_suffix(".py"), stem / "__init__.py") if path.is_file()), None)
