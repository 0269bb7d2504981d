"""The registry of experiments: a module in one of ``FOLDERS`` adds one with ``@experiment(NAME, DESCRIPTION)``."""

import pkgutil
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from experiments.cache.stages import RunContext

FOLDERS = ("experiments.tables", "experiments.ablations")
Run = Callable[[RunContext], dict[str, Any]]


@dataclass(frozen=True)
class Experiment:
    """What ``python -m experiments.run NAME`` runs."""

    name: str
    description: str
    """One line for ``run list``, and for the record of results."""
    run: Run
    """Computes the results, as JSON content."""
    pages: tuple[str, ...] = ()
    """Modules of ``experiments.pages`` that show the results."""

    def write_pages(self, results: Path, docs: Path) -> list[Path]:
        """Writes the pages of docs that show the results.

        Args:
            results: folder with the results of experiments.
            docs: folder for the pages.

        Returns:
            The files written.

        Raises:
            SbmError: if there are no results.
        """
        modules = [import_module(f"experiments.pages.{page}") for page in self.pages]
        return [path for module in modules for path in module.write_page(results, docs)]


_REGISTRY: dict[str, Experiment] = {}


def register(new: Experiment) -> None:
    """Adds an experiment.

    Raises:
        ValueError: if there is another one of that name.
    """
    if new.name in _REGISTRY:
        raise ValueError(f"there are two experiments called {new.name!r}")
    _REGISTRY[new.name] = new


def experiment(name: str, description: str, pages: tuple[str, ...] = ()) -> Callable[[Run], Run]:
    """Registers the function below it as an experiment.

    Args:
        name: on the command line, and of the file of results.
        description: one line.
        pages: modules of ``experiments.pages`` that show the results.
    """

    def registered(run: Run) -> Run:
        register(Experiment(name, description, run, pages))
        return run

    return registered


def experiments() -> dict[str, Experiment]:
    """All experiments by name, in alphabetical order."""
    for folder in FOLDERS:
        for module in pkgutil.iter_modules(import_module(folder).__path__, f"{folder}."):
            import_module(module.name)
    return dict(sorted(_REGISTRY.items()))
