"""Draws docs/architecture.md's picture and writes its list of folders, from imports and docstrings alone.

    python tools/architecture.py

Nothing of the project is imported: what the picture shows is what the source says.
"""

import ast
import sys
from graphlib import TopologicalSorter
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from tests.imports import PACKAGES, folder_of, imports, modules, package_of  # noqa: E402

PAGE = ROOT / "docs" / "architecture.md"
PICTURE = ROOT / "docs" / "pictures" / "architecture.png"
HEADING = "## Folders\n"
COLOURS = {"labeling": "#d9ead3", "sbm_gym": "#d0e0f0", "agents": "#fce5cd", "experiments": "#ead1dc"}
BOX_WIDTH, BOX_HEIGHT, ROW_HEIGHT = 1.9, 0.62, 1.05
COLUMNS = 8
"""Boxes a row at most."""


def room_of(module: str) -> str:
    """The room a module stands in: the first folder below its package, or ``commands`` for the package's top."""
    package, *folders = folder_of(module).split(".")
    return f"{package}.{folders[0] if folders else 'commands'}"


def room_graph(package: str) -> dict[str, set[str]]:
    """For every room of a package, the other rooms of it that its modules import."""
    graph: dict[str, set[str]] = {room_of(module): set() for module in modules(package)}
    for module in modules(package):
        for other in imports()[module]:
            if package_of(other) == package and room_of(other) != room_of(module):
                graph[room_of(module)].add(room_of(other))
    return graph


def without_detours(graph: dict[str, set[str]]) -> dict[str, set[str]]:
    """The graph less every arrow that a longer way replaces."""

    def reachable(room: str) -> set[str]:
        return {far for near in graph[room] for far in {near} | reachable(near)}

    return {room: {n for n in near if not any(n in reachable(o) for o in near - {n})} for room, near in graph.items()}


def rows_of(graph: dict[str, set[str]]) -> list[list[str]]:
    """Rooms in rows, each above all that it imports; wide rows are split."""
    sorter = TopologicalSorter(graph)
    sorter.prepare()
    rows: list[list[str]] = []
    while sorter.is_active():
        ready = sorted(sorter.get_ready())
        rows += [ready[start : start + COLUMNS] for start in range(0, len(ready), COLUMNS)]
        sorter.done(*ready)
    return rows


def draw(path: Path) -> None:
    """Draws the four packages as floors, their rooms as boxes, and the imports between rooms as arrows."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt
    from matplotlib.patches import FancyArrowPatch, FancyBboxPatch

    floors = {package: rows_of(room_graph(package)) for package in PACKAGES}
    height = sum(len(rows) * ROW_HEIGHT + 0.75 for rows in floors.values())
    width = COLUMNS * (BOX_WIDTH + 0.25) + 0.4
    figure, axes = plt.subplots(figsize=(width * 0.72, height * 0.72), dpi=110)
    middle: dict[str, tuple[float, float]] = {}
    bottom = 0.0
    for package, rows in floors.items():
        floor_height = len(rows) * ROW_HEIGHT + 0.55
        axes.add_patch(
            FancyBboxPatch((0, bottom), width, floor_height, "round,pad=0.02", fc=COLOURS[package], ec="none")
        )
        lines = sum(len(path.read_text(encoding="utf-8").splitlines()) for path in modules(package).values())
        title = f"{package}/   {len(modules(package))} modules, {lines / 1000:.1f}k lines"
        axes.text(0.15, bottom + floor_height - 0.3, title, fontsize=12, weight="bold", va="center")
        for number, row in enumerate(rows):
            y = bottom + 0.5 + number * ROW_HEIGHT
            step = width / len(row)
            # Rows are shifted a little against each other, so that arrows do not run through boxes.
            shift = (0.35 if number % 2 else -0.35) if len(row) > 1 else 0.0
            for column, room in enumerate(row):
                middle[room] = ((column + 0.5) * step + shift, y)
        bottom += floor_height + 0.2
    for package in PACKAGES:
        for room, others in without_detours(room_graph(package)).items():
            for other in others:
                (x, y), (to_x, to_y) = middle[room], middle[other]
                start, end = (x, y - BOX_HEIGHT / 2), (to_x, to_y + BOX_HEIGHT / 2)
                arrow = FancyArrowPatch(start, end, arrowstyle="-|>", mutation_scale=9, lw=0.9, color="#555", zorder=1)
                axes.add_patch(arrow)
    for room, (x, y) in middle.items():
        package, _, name = room.partition(".")
        count = sum(room_of(module) == room for module in modules(package))
        corner = (x - BOX_WIDTH / 2, y - BOX_HEIGHT / 2)
        axes.add_patch(FancyBboxPatch(corner, BOX_WIDTH, BOX_HEIGHT, "round,pad=0.02", fc="white", ec="#444", zorder=2))
        axes.text(
            x, y + 0.09, name if name == "commands" else f"{name}/", ha="center", va="center", fontsize=9.5, zorder=3
        )
        axes.text(x, y - 0.17, f"{count} modules", ha="center", va="center", fontsize=7, color="#666", zorder=3)
    axes.set(xlim=(-0.1, width + 0.1), ylim=(-0.1, bottom))
    axes.set_axis_off()
    figure.savefig(path, bbox_inches="tight", metadata={"Software": None})
    plt.close(figure)


def folder_table() -> str:
    """Markdown rows: folder, what it is for."""
    rows = ["| folder | what it holds |", "|---|---|"]
    for package in PACKAGES:
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
    draw(PICTURE)
    print(f"{PAGE}\n{PICTURE}")
