"""Writes the list of folders in docs/architecture.md from their docstrings: ``python tools/folders.py``."""

import ast
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "architecture.md"
HEADING = "## Folders\n"


def folder_table() -> str:
    """Markdown rows: folder, what it is for."""
    rows = ["| folder | what it holds |", "|---|---|"]
    for package in ("labeling", "sbm_gym", "agents", "experiments"):
        for path in sorted((ROOT / package).rglob("__init__.py")):
            docstring = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
            folder = path.parent.relative_to(ROOT).as_posix()
            rows.append(f"| `{folder}/` | {' '.join(docstring.split(chr(10) * 2)[0].split())} |")
    return "\n".join(rows) + "\n"


def updated_page() -> str:
    """The page with its table as the folders are now."""
    return PAGE.read_text(encoding="utf-8").partition(HEADING)[0] + HEADING + folder_table()


if __name__ == "__main__":
    PAGE.write_text(updated_page(), encoding="utf-8")
