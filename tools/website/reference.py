"""Reference of what users import: the names that stand in the packages' ``__init__.pyi``, by mkdocstrings."""

import ast
from collections.abc import Mapping
from pathlib import Path

PACKAGES = ("labeling", "sbm_gym", "agents")


def exported(root: Path, package: str) -> dict[str, str]:
    """Names that a package exports, in the order of its stub, and the folder each of them stands in."""
    stub = ast.parse((root / package / "__init__.pyi").read_text(encoding="utf-8"))
    return {
        (alias.asname or alias.name): (node.module or "").split(".")[0]
        for node in stub.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }


def defined_in(root: Path, package: str, name: str) -> str:
    """The dotted name of what a package exports, where it is defined."""
    stub = ast.parse((root / package / "__init__.pyi").read_text(encoding="utf-8"))
    for node in stub.body:
        if isinstance(node, ast.ImportFrom):
            for alias in node.names:
                if alias.asname == name:
                    return f"{package}.{node.module}.{alias.name}"
    raise KeyError(name)


def _docstring(root: Path, package: str) -> str:
    return ast.get_docstring(ast.parse((root / package / "__init__.py").read_text(encoding="utf-8"))) or ""


def package_page(root: Path, package: str) -> str:
    """A package: its docstring, the list of what it exports, and all of that, one after the other."""
    about, _, _ = _docstring(root, package).partition(">>>")
    example = [line for line in _docstring(root, package).splitlines() if line and not line.startswith("What users")]
    start = next(number for number, line in enumerate(example) if line.startswith(">>>"))
    lines = [f"# {package}", "", about.strip(), "", "```pycon", *example[start:], "```", ""]
    for name in exported(root, package):
        lines += [f"::: {package}.{name}", ""]
    return "\n".join(lines)


def all_pages(root: Path) -> Mapping[str, str]:
    """All pages of the reference, by where they stand in the site."""
    lines = ["# Reference", "", "What users import comes from the packages' roots; paths inside them may change.", ""]
    for package in PACKAGES:
        lines += [f"## {package}", "", _docstring(root, package).split("\n")[0], ""]
        lines += [f"- [`{name}`]({package}.md#{package}.{name})" for name in exported(root, package)]
        lines += [""]
    lines += ["Everything else is reached by [commands](../commands/index.md).", ""]
    pages = {f"reference/{package}.md": package_page(root, package) for package in PACKAGES}
    return {"reference/index.md": "\n".join(lines), **pages}
