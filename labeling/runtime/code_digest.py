"""What decides an outcome besides its inputs: a digest of the code that computes it, found by following names.

What counts are definitions, not files: the functions, classes and constants that a target names, what these name, and
so on through all modules of the project. Another function in the same file, a comment or a docstring makes nothing
anew. So that nothing is missed, what only might decide counts, too: whatever a module does when it is imported, and
all of a module that is passed around as a whole.
"""

import ast
import hashlib
import re
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("labeling", "sbm_gym", "agents", "experiments")
_DATA = (".json", ".toml")
_ALL = ""
"""Stands for all of a module."""
_ANNOTATION, _NAME = re.compile(r"[\w.,|\[\] ]+"), re.compile(r"[A-Za-z_]\w*")


@cache
def code_digest(*targets: str | Callable[..., Any], within: tuple[str, ...] = ("",)) -> str:
    """Changes whenever code does that an outcome depends on.

    Args:
        targets: functions or classes that compute it, with all that they reach (``ReachedCode``). Or names of modules,
            of which every definition counts.
        within: folders, of all that is reached, whose files count.
    """
    found = hashlib.sha256()
    for path, content in sorted(reached_code(*targets).contents().items()):
        name = path.relative_to(ROOT).as_posix()
        if name.startswith(within):
            found.update(name.encode() + b"\0" + content)
    return found.hexdigest()


def reached_code(*targets: str | Callable[..., Any]) -> "ReachedCode":
    """What targets of ``code_digest`` reach."""
    reached = ReachedCode()
    for target in targets:
        if isinstance(target, str):
            reached.follow(target, _ALL)
        else:
            reached.follow(target.__module__, target.__qualname__.partition(".")[0])
    return reached


class ReachedCode:
    """The definitions that some targets are made of, in all modules of the project.

    A definition is a statement of a module that binds a name: a function, a class, a constant. It reaches what it
    names: definitions of its module, imported ones (imports in functions count, and so do strings that name an entry
    point, "package.module:name"), and attributes of imported modules. A module that is named in any other way, or asked
    for what it does not define, is reached as a whole. Of every module that is imported on the way, what has effects
    counts: statements that bind nothing, and those that call functions of the project, as decorators do, which may
    register what they define.
    """

    def __init__(self) -> None:
        self._modules: dict[str, _Module | None] = {}
        self._statements: dict[ast.stmt, _Module] = {}
        self._imported: set[str] = set()
        self._seen: set[tuple[str, str]] = set()
        self._waiting: list[tuple[str, str]] = []

    def follow(self, module: str, name: str) -> None:
        """Adds a definition and what it reaches.

        Args:
            module: of the project; others are passed over.
            name: that the module binds, imports or contains as a module; whatever else, as "", stands for all of it.
        """
        self._waiting.append((module, name))
        while self._waiting:
            key = self._waiting.pop()
            if key not in self._seen:
                self._seen.add(key)
                self._visit(*key)

    def contents(self) -> dict[Path, bytes]:
        """What counts of each file: of code the definitions that are reached, without comments and docstrings; and all
        of the JSON and TOML files beside it, since what it has learnt or reads decides its outcome as well.
        """
        texts: dict[Path, list[str]] = {}
        for statement, module in self._statements.items():
            texts.setdefault(module.path, []).append(ast.unparse(statement))
        data = {file for folder in {path.parent for path in texts} for file in folder.iterdir() if file.suffix in _DATA}
        code = {path: "\n".join(sorted(some)).encode() for path, some in texts.items()}
        return {**code, **{file: file.read_bytes() for file in data}}

    def names(self) -> set[tuple[Path, str]]:
        """The functions and classes that are reached: their files and names."""
        return {
            (module.path, statement.name)
            for statement, module in self._statements.items()
            if isinstance(statement, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef)
        }

    def _visit(self, module: str, name: str) -> None:
        found = self._module(module)
        if found is None:
            return
        self._import(module)
        if name not in found.bound:
            within = self._module(f"{module}.{name}") if name != _ALL else None
            names = found.bound if within is None else [_ALL]
            self._waiting += [(module if within is None else within.name, one) for one in names]
        for statement in found.bound.get(name, ()):
            if isinstance(statement, ast.Import | ast.ImportFrom):
                self._waiting += _imported_as(statement, name)
            else:
                self._add(found, statement)

    def _add(self, module: "_Module", statement: ast.stmt) -> None:
        if statement in self._statements:
            return
        self._statements[statement] = module
        nodes, of_modules = list(_nodes(statement)), set()
        for node in nodes:
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id in module.bound:
                named = self._module_called(module, node.value.id)
                if named is not None:
                    of_modules.add(node.value)
                    self._waiting.append((named, node.attr))
        for node in nodes:
            if isinstance(node, ast.Name):
                if node.id in module.bound and node not in of_modules:
                    self._waiting.append((module.name, node.id))
            elif isinstance(node, ast.Constant):
                if isinstance(node.value, str):
                    self._waiting += self._in_string(module, node.value)
            elif isinstance(node, ast.Import | ast.ImportFrom):
                for name in _binds(node):
                    self._waiting += _imported_as(node, name)

    def _in_string(self, module: "_Module", text: str) -> list[tuple[str, str]]:
        """What a string names: types, if it is an annotation, and an entry point."""
        names = _NAME.findall(text) if _ANNOTATION.fullmatch(text) else ()
        found = [(module.name, name) for name in names if name in module.bound]
        entry, colon, name = text.partition(":")
        return [*found, (entry, name)] if colon and name.isidentifier() else found

    def _module_called(self, module: "_Module", name: str) -> str | None:
        """The module of the project that a name of another one means, if that is all that it means."""
        bound = module.bound.get(name, ())
        if len(bound) != 1 or not isinstance(bound[0], ast.Import | ast.ImportFrom):
            return None
        ((where, what), *more) = _imported_as(bound[0], name)
        if more or (what == _ALL and where != name and not _renamed(bound[0], name)):
            return None  # "import a.b" binds a, which has other modules as well
        above, called = self._module(where), where if what == _ALL else f"{where}.{what}"
        if what != _ALL and above is not None and what in above.bound:
            return None
        return None if self._module(called) is None else called

    def _import(self, name: str) -> None:
        """Adds what a module does when it is imported, and those that it imports, and the packages that it lies in."""
        waiting = [name]
        while waiting:
            one = waiting.pop()
            module = self._module(one)
            if one in self._imported or module is None:
                continue
            self._imported.add(one)
            waiting += [*module.imports, one.rpartition(".")[0]]
            for statement, called in module.effects:
                if called is None or any(self._is_function(module, name) for name in called):
                    self._add(module, statement)

    def _is_function(self, module: "_Module", name: str) -> bool:
        """Whether a name means something of the project that does things when it is called: anything but a class."""
        for statement in module.bound.get(name, ()):
            if not isinstance(statement, ast.Import | ast.ImportFrom):
                return not isinstance(statement, ast.ClassDef)
            for where, what in _imported_as(statement, name):
                found = self._module(where)
                if found is not None and self._is_function(found, what):
                    return True
        return False

    def _module(self, name: str) -> "_Module | None":
        if name not in self._modules:
            path = _source(name)
            self._modules[name] = None if path is None else _Module(name, path)
        return self._modules[name]


class _Module:
    """A module, taken apart into its statements."""

    def __init__(self, name: str, path: Path) -> None:
        self.name, self.path = name, path
        self.bound: dict[str, list[ast.stmt]] = {}
        """Statements that bind a name, imports among them."""
        self.effects: list[tuple[ast.stmt, set[str] | None]] = []
        """What happens when it is imported: statements that bind nothing, and others with the names that they call."""
        self.imports: list[str] = []
        """Modules that are imported with this one."""
        for statement, runs in _top_level(ast.parse(path.read_text(encoding="utf-8")).body):
            if _is_text(statement):
                continue
            names = _binds(statement)
            for bound in names:
                self.bound.setdefault(bound, []).append(statement)
            if isinstance(statement, ast.Import | ast.ImportFrom):
                self.imports += list(_imports(statement)) if runs else []
            else:
                self.effects.append((statement, _called(statement) if names else None))
        stub = path.with_suffix(".pyi")  # names what a package gives on demand
        if stub.is_file():
            for statement, _ in _top_level(ast.parse(stub.read_text(encoding="utf-8")).body):
                for bound in _binds(statement):
                    self.bound.setdefault(bound, []).append(statement)


def _nodes(statement: ast.AST) -> Iterator[ast.AST]:
    """What a statement is made of. Docstrings are taken out of it."""
    waiting = [statement]
    while waiting:
        node = waiting.pop()
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            node.body = [one for one in node.body if not _is_text(one)] or [ast.Pass()]
        yield node
        for field in node._fields:
            value = getattr(node, field, None)
            if type(value) is list:
                waiting += [one for one in value if isinstance(one, ast.AST)]
            elif isinstance(value, ast.AST) and field not in ("ctx", "op"):
                waiting.append(value)


def _called(statement: ast.stmt) -> set[str]:
    """Names of what is called when a statement is executed: decorators, or what an expression calls."""
    if isinstance(statement, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
        return {node.id for one in statement.decorator_list for node in ast.walk(one) if isinstance(node, ast.Name)}
    calls = (node.func for node in ast.walk(statement) if isinstance(node, ast.Call))
    return {node.id for func in calls for node in ast.walk(func) if isinstance(node, ast.Name)}


def _is_text(statement: ast.stmt) -> bool:
    """Whether a statement is a docstring, of a field perhaps."""
    return isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant)


def _top_level(statements: Iterable[ast.stmt], runs: bool = True) -> Iterator[tuple[ast.stmt, bool]]:
    """Statements of a module, those in its ``if`` blocks among them, and whether they run when it is imported."""
    for statement in statements:
        if isinstance(statement, ast.If):
            asked = {node.id for node in ast.walk(statement.test) if isinstance(node, ast.Name)}
            if "__name__" not in asked:
                yield ast.Expr(statement.test), runs
                yield from _top_level(statement.body, runs and "TYPE_CHECKING" not in asked)
            yield from _top_level(statement.orelse, runs)
        else:
            yield statement, runs


def _binds(statement: ast.AST) -> set[str]:
    """The names that a statement gives a meaning."""
    if isinstance(statement, ast.Import | ast.ImportFrom):
        return {(alias.asname or alias.name).partition(".")[0] for alias in statement.names}
    if isinstance(statement, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
        return {statement.name}
    found = set()
    for node in ast.walk(statement):
        if isinstance(node, ast.Name):
            found |= set() if isinstance(node.ctx, ast.Load) else {node.id}
        elif node is not statement and isinstance(
            node, ast.Import | ast.ImportFrom | ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef
        ):
            found |= _binds(node)
    return found


def _imported_as(statement: ast.Import | ast.ImportFrom, name: str) -> list[tuple[str, str]]:
    """What a name means that an import binds: modules, and what of them."""
    if isinstance(statement, ast.ImportFrom):
        module = statement.module or ""
        return [(module, alias.name) for alias in statement.names if (alias.asname or alias.name) == name]
    return [
        (alias.name, _ALL)
        for alias in statement.names
        if name in (alias.asname, None if alias.asname else alias.name.partition(".")[0])
    ]


def _renamed(statement: ast.Import | ast.ImportFrom, name: str) -> bool:
    """Whether an import calls something so that is called otherwise."""
    return any(alias.asname == name for alias in statement.names)


def _imports(node: ast.AST) -> Iterator[str]:
    """Modules that a statement imports, or may import."""
    if isinstance(node, ast.Import):
        yield from (alias.name for alias in node.names)
    elif isinstance(node, ast.ImportFrom) and node.module:
        yield node.module
        yield from (f"{node.module}.{alias.name}" for alias in node.names)


def _source(module: str) -> Path | None:
    if module.split(".")[0] not in PACKAGES:
        return None
    path = ROOT.joinpath(*module.split("."))
    return next((one for one in (path.with_suffix(".py"), path / "__init__.py") if one.is_file()), None)
