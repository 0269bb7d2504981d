"""Folders for results that say with which settings they were made, so that they are never mixed with others."""

from pathlib import Path
from typing import Any

from labeling.core.errors import UsageError
from labeling.io.formats.atomic import write_json
from labeling.io.formats.checked_json import read_json


def claim_folder(folder: Path, file_name: str, settings: dict[str, Any], defaults: dict[str, Any]) -> None:
    """Notes settings in a folder for results; does nothing if the same are there already.

    Args:
        folder: made if it does not exist.
        file_name: of the note.
        settings: those that decide what the results are.
        defaults: by name, for folders that are older than a setting.

    Raises:
        UsageError: if the folder holds results of other settings, or something else, or cannot be written to.
    """
    path = folder / file_name
    if path.is_file():
        noted = read_json(path).mapping().get("settings")
        before = {**defaults, **(noted if isinstance(noted, dict) else {})}
        differing = [
            f"--{name} {before.get(name)!s} there, {value!s} now"
            for name, value in settings.items()
            if before.get(name) != value
        ]
        if differing:
            raise UsageError(
                f"{folder} was made with other settings ({'; '.join(differing)}); give another --out, or the same "
                "settings to go on"
            )
        return
    if folder.exists() and not folder.is_dir():
        raise UsageError(f"{folder} is a file; --out is a folder for results")
    if folder.is_dir() and any(folder.iterdir()):
        raise UsageError(f"{folder} is not empty and was not made by this program; give another --out")
    try:
        write_json(path, {"settings": settings})
    except OSError as error:
        raise UsageError(f"cannot write to {folder}: {error.strerror}") from error
