"""The registry of experiments: a module in one of ``FOLDERS`` adds one with ``@experiment(NAME, DESCRIPTION)``."""

import pkgutil
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from experiments.cache.stages import RunContext

FOLDERS = ("experiments.tables", "experiments.loops", "experiments.ablations")
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
    has_rounds: bool = False
    """Whether it goes round in a loop, as many times as is asked for."""


_REGISTRY: dict[str, Experiment] = {}


def experiment(
    name: str, description: str, pages: tuple[str, ...] = (), has_rounds: bool = False
) -> Callable[[Run], Run]:
    """Registers the function below it as an experiment.

    Args:
        name: on the command line, and of the file of results.
        description: one line.
        pages: modules of ``experiments.pages`` that show the results.
        has_rounds: whether it goes round in a loop.

    Raises:
        ValueError: if there is another one of that name.
    """

    def registered(run: Run) -> Run:
        if name in _REGISTRY:
            raise ValueError(f"there are two experiments called {name!r}")
        _REGISTRY[name] = Experiment(name, description, run, pages, has_rounds)
        return run

    return registered


def experiments() -> dict[str, Experiment]:
    """All experiments by name, in alphabetical order."""
    for folder in FOLDERS:
        for module in pkgutil.iter_modules(import_module(folder).__path__, f"{folder}."):
            import_module(module.name)
    return dict(sorted(_REGISTRY.items()))
