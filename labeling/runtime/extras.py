"""What to install where a Python package is missing."""

import tomllib
from pathlib import Path

_TABLES = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
EXTRAS: dict[str, str] = _TABLES["of_import"]
"""For every import that installing the project without extras does not bring, the extra that does."""


def how_to_install(extra: str) -> str:
    """The command that installs an extra; the project is on no package index.

    >>> print(how_to_install("rl"))
    pip install './CLONE[rl]', with CLONE the folder of seeing-by-moving
    """
    return f"pip install './CLONE[{extra}]', with CLONE the folder of seeing-by-moving"


def missing_extra(error: ModuleNotFoundError, program: str) -> str | None:
    """The sentence for whoever lacks an extra; None if the missing module belongs to none of them.

    >>> print(missing_extra(ModuleNotFoundError(name="gymnasium"), "python -m agents.train"))
    python -m agents.train needs the extra 'rl': pip install './CLONE[rl]', with CLONE the folder of seeing-by-moving

    Args:
        error: what the import has raised.
        program: what needs the module, such as "python -m agents.train".
    """
    extra = EXTRAS.get((error.name or "").partition(".")[0])
    if extra is None:
        return None
    package = program.removeprefix("python -m ").partition(".")[0]
    whole = _TABLES["of_package"].get(package)
    if whole is not None and extra in whole["includes"]:
        extra = whole["extra"]
    return f"{program} needs the extra {extra!r}: {how_to_install(extra)}"
