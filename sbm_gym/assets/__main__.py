"""Lists, installs and credits furniture; lists and clears compiled scenes: ``python -m sbm_gym.assets``."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from labeling.runtime.cli import run_command
from labeling.runtime.help import CommandHelp
from labeling.runtime.ranges import NonNegative, check_ranges

if TYPE_CHECKING:
    from sbm_gym.assets.catalog.library import Home3dLibrary


@dataclass(frozen=True)
class ListModels:
    """Print a table of the usable models by class."""

    category: str | None = None
    """Only this class, such as chair; all of them if not given."""
    builtin: bool = False
    """List what can be made from seeds instead, which needs no furniture libraries."""


@dataclass(frozen=True)
class Install:
    """Convert all models into the cache, so that no world has to wait for it, and write CREDITS.md beside them."""


@dataclass(frozen=True)
class Credits:
    """Print who made the models, and under which licences."""

    out: Path | None = None
    """File to write instead of printing."""


@dataclass(frozen=True)
class Cache:
    """Print which compiled scenes are kept, those used last first, or remove some."""

    clear: bool = False
    """Remove them all."""
    max_gb: NonNegative[float] | None = None
    """Remove those used longest ago until no more than this is left."""


Command = (
    Annotated[ListModels, tyro.conf.subcommand("list")]
    | Annotated[Install, tyro.conf.subcommand("install")]
    | Annotated[Credits, tyro.conf.subcommand("credits")]
    | Annotated[Cache, tyro.conf.subcommand("cache")]
)


DOES = "Lists, installs and credits furniture; lists and clears compiled scenes."
HELP = CommandHelp(
    examples=(
        ("list --category chair", "the chairs there are"),
        ("install", "convert all models ahead of time"),
        ("cache --max-gb 2", "keep the cache small"),
    ),
)


def main(arguments: list[str] | None = None) -> int:
    """Runs the command line; returns the exit code."""
    return run_command(Command, _run, "python -m sbm_gym.assets", arguments, description=DOES, about=HELP)


def _run(command: ListModels | Install | Credits | Cache) -> None:
    check_ranges(command)
    if isinstance(command, ListModels):
        _list(command)
    elif isinstance(command, Install):
        _install()
    elif isinstance(command, Credits):
        _credits(command.out)
    else:
        _cache(command)


def _list(command: ListModels) -> None:
    from rich.console import Console
    from rich.table import Table

    from labeling.core.errors import UsageError
    from sbm_gym.assets.models.classes import USES, categories

    if command.category is not None and command.category not in categories():
        raise UsageError(f"there is no class {command.category!r}; classes are {', '.join(categories())}")
    if command.builtin:
        from sbm_gym.assets.parametric.builtin import RECIPES

        columns = ("name", "width (m)", "depth (m)", "height (m)")
        rows = [
            (USES[use].category, use, recipe.name, *(f"{low:.2f} .. {high:.2f}" for low, high in recipe.size_m))
            for use, recipe in RECIPES.items()
        ]
        summary = "every whole number from 0 on is the seed of another model"
    else:
        from sbm_gym.assets.catalog.library import Home3dLibrary

        columns = ("model", "name", "width x depth x height (m)", "creator")
        cards = Home3dLibrary().cards()
        sizes = [" x ".join(f"{side:.2f}" for side in card.size_m) for card in cards]
        rows = [(c.category, c.use, c.model_id, c.name, size, c.creator) for c, size in zip(cards, sizes, strict=True)]
        summary = ", ".join(f"{name} {sum(card.category == name for card in cards)}" for name in categories())
    table = Table("class", "use", *columns)
    order = [*categories(), None]
    for category, *row in sorted(rows, key=lambda row: order.index(row[0])):
        if command.category in (None, category):
            table.add_row(category or "-", *row)
    console = Console()
    console.print(table)
    console.print(summary)


def _install() -> None:
    from tqdm import tqdm

    from sbm_gym.assets.catalog.library import Home3dLibrary
    from sbm_gym.store.cache_folder import cache_folder

    library = Home3dLibrary()
    with tqdm(total=len(library.cards()), unit="model", desc="converting") as bar:
        library.install(lambda card: bar.set_postfix_str(card.name, refresh=bool(bar.update())))
    path = cache_folder() / "CREDITS.md"
    _write_credits(library, path)
    print(f"{len(library.cards())} models in {cache_folder()}; credits in {path}")


def _credits(out: Path | None) -> None:
    from sbm_gym.assets.catalog.library import Home3dLibrary
    from sbm_gym.assets.credits import credits_text

    if out is None:
        print(credits_text(Home3dLibrary()), end="")
    else:
        _write_credits(Home3dLibrary(), out)
        print(f"wrote {out}")


def _cache(command: Cache) -> None:
    import time

    from sbm_gym.store.cache_folder import SceneFolder, max_bytes
    from sbm_gym.store.packed_file import DamagedError, read_content

    folder = SceneFolder()
    if command.clear or command.max_gb is not None:
        limit = 0 if command.clear else int(1e9 * (command.max_gb or 0.0))
        removed = folder.shrink(limit, just_used_s=0.0)
        print(f"removed {removed} scenes")
    for scene in folder.scenes():
        try:
            name = read_content(scene.path)["scene"]
        except (OSError, DamagedError, KeyError, TypeError):
            name = "damaged, will be made again"
        used = time.strftime("%Y-%m-%d %H:%M", time.localtime(scene.used_s))
        print(f"{used}  {1e-6 * scene.bytes:6.1f} MB  {scene.path.stem}  ({name})")
    sizes = f"{1e-9 * folder.total_bytes():.2f} GB, {1e-9 * folder.texture_bytes():.2f} of them shared textures"
    print(f"{len(folder.scenes())} scenes in {folder.folder}: {sizes}; at most {1e-9 * max_bytes():g} GB are kept")


def _write_credits(library: "Home3dLibrary", path: Path) -> None:
    from labeling.formats.atomic import atomic_file
    from sbm_gym.assets.credits import credits_text

    with atomic_file(path) as temporary:
        temporary.write_text(credits_text(library), encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
