"""``python -m sbm_gym.assets``: list, install and credit the furniture that worlds are made of."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from labeling.runtime.cli import run_command


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


Command = (
    Annotated[ListModels, tyro.conf.subcommand("list")]
    | Annotated[Install, tyro.conf.subcommand("install")]
    | Annotated[Credits, tyro.conf.subcommand("credits")]
)


def main(arguments: list[str] | None = None) -> int:
    """Runs the command line; returns the exit code."""
    return run_command(Command, _run, "python -m sbm_gym.assets", arguments, description=__doc__)


def _run(command: ListModels | Install | Credits) -> None:
    if isinstance(command, ListModels):
        _list(command.category, command.builtin)
    elif isinstance(command, Install):
        _install()
    else:
        _credits(command.out)


def _list(category: str | None, builtin: bool) -> None:
    from rich.console import Console
    from rich.table import Table

    from labeling.core.errors import UsageError
    from sbm_gym.assets.models.classes import categories

    if category is not None and category not in categories():
        raise UsageError(f"there is no class {category!r}; classes are {', '.join(categories())}")
    if builtin:
        _list_builtin(category)
        return
    from sbm_gym.assets.catalog.library import Home3dLibrary

    table = Table("class", "use", "model", "name", "width x depth x height (m)", "creator")
    cards = Home3dLibrary().cards()
    order = [*categories(), None]
    for card in sorted(cards, key=lambda card: order.index(card.category)):
        if category in (None, card.category):
            size = " x ".join(f"{side:.2f}" for side in card.size_m)
            table.add_row(card.category or "-", card.use, card.model_id, card.name, size, card.creator)
    console = Console()
    console.print(table)
    counts = {name: sum(card.category == name for card in cards) for name in categories()}
    console.print(", ".join(f"{name} {count}" for name, count in counts.items()))


def _list_builtin(category: str | None) -> None:
    from rich.console import Console
    from rich.table import Table

    from sbm_gym.assets.models.classes import USES, categories
    from sbm_gym.assets.parametric.builtin import RECIPES

    table = Table("class", "use", "name", "width (m)", "depth (m)", "height (m)")
    order = [*categories(), None]
    for use, recipe in sorted(RECIPES.items(), key=lambda item: order.index(USES[item[0]].category)):
        if category in (None, USES[use].category):
            ranges = [f"{low:.2f} .. {high:.2f}" for low, high in recipe.size_m]
            table.add_row(USES[use].category or "-", use, recipe.name, *ranges)
    console = Console()
    console.print(table)
    console.print("every whole number from 0 on is the seed of another model")


def _install() -> None:
    from tqdm import tqdm

    from labeling.io.formats.atomic import atomic_file
    from sbm_gym.assets.catalog.home3d import cache_folder
    from sbm_gym.assets.catalog.library import Home3dLibrary
    from sbm_gym.assets.credits import credits_text

    library = Home3dLibrary()
    with tqdm(total=len(library.cards()), unit="model", desc="converting") as bar:
        library.install(lambda card: bar.set_postfix_str(card.name, refresh=bool(bar.update())))
    path = cache_folder() / "CREDITS.md"
    with atomic_file(path) as temporary:
        temporary.write_text(credits_text(library), encoding="utf-8")
    print(f"{len(library.cards())} models in {cache_folder()}; credits in {path}")


def _credits(out: Path | None) -> None:
    from labeling.io.formats.atomic import atomic_file
    from sbm_gym.assets.catalog.library import Home3dLibrary
    from sbm_gym.assets.credits import credits_text

    text = credits_text(Home3dLibrary())
    if out is None:
        print(text, end="")
        return
    with atomic_file(out) as temporary:
        temporary.write_text(text, encoding="utf-8")
    print(f"wrote {out}")


if __name__ == "__main__":
    sys.exit(main())
