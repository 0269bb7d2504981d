"""Folders of runs: each says with which settings it was begun, so that a run goes on with the same and no others."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from labeling.core.errors import UsageError
from labeling.formats.atomic import is_half_written, write_json
from labeling.formats.checked_json import read_json

Settings = Mapping[str, Any]
RECORDING_FILE = "transforms.json"
"""Makes a folder a recording: ``TRANSFORMS_FILE`` of ``labeling.io``, which builds on this package."""

OTHER_RECORDINGS = (("rgb.txt", "depth.txt", "groundtruth.txt"), ("color", "depth", "pose", "intrinsic"))
"""Files and folders that together make a folder a recording, too: the ``FILES`` of TUM and ScanNet."""


def check_outside_recordings(folder: Path) -> None:
    """Refuses to write results into a recording, of which they would become a part.

    Raises:
        UsageError: if the folder lies inside of one.
    """
    recording = next((one for one in folder.resolve().parents if _is_recording(one)), None)
    if recording is not None:
        raise UsageError(f"{folder} lies inside the recording {recording}; give an --out outside of it")


def _is_recording(folder: Path) -> bool:
    if (folder / RECORDING_FILE).is_file():
        return True
    return any(all((folder / mark).exists() for mark in marks) for marks in OTHER_RECORDINGS)


def claim_run_folder(
    folder: Path,
    file_name: str,
    content: Settings,
    decisive: Callable[[Settings], Settings] = lambda content: content,
    results: str = "results",
) -> None:
    """Writes the settings of a run into its folder; in a folder of the same settings, the run goes on.

    Args:
        folder: of the run; made if it does not exist.
        file_name: of the settings.
        content: the settings, as JSON.
        decisive: takes such content, this or that of an earlier run, and returns the settings that must agree, by the
            names that an error calls them. What else has changed since is written anew.
        results: what the folder holds, for error messages.

    Raises:
        UsageError: if the folder was begun with other settings, holds something else, lies inside a recording, or
            cannot be written to.
    """
    check_outside_recordings(folder)
    path = folder / file_name
    earlier = read_json(path).mapping() if path.is_file() else None
    if earlier is not None:
        before, now = _read_decisive(path, earlier, decisive), decisive(content)
        differing = [
            f"{name} {before.get(name)!s} there, {value!s} now"
            for name, value in now.items()
            if before.get(name) != value
        ]
        if differing:
            raise UsageError(
                f"{folder} holds {results} made with other settings ({'; '.join(differing)}); give another --out, or "
                "the same settings to go on"
            )
        if earlier == content:
            return
    elif folder.exists() and not folder.is_dir():
        raise UsageError(f"{folder} is a file; --out is a folder for {results}")
    elif folder.is_dir() and not all(is_half_written(one) for one in folder.iterdir()):
        raise UsageError(f"{folder} is not empty and was not made by this program; give another --out")
    try:
        write_json(path, content)
    except OSError as error:
        raise UsageError(f"cannot write to {folder}: {error.strerror}") from error


def _read_decisive(path: Path, earlier: Settings, decisive: Callable[[Settings], Settings]) -> Settings:
    try:
        return decisive(earlier)
    except (KeyError, TypeError):
        raise UsageError(f"{path}: is damaged: it does not say what was begun here; give another --out") from None


def as_options(settings: Settings) -> dict[str, Any]:
    """Settings by the names of their command-line options: ``{"batch_size": 2}`` gives ``{"--batch-size": 2}``."""
    return {f"--{name.replace('_', '-')}": value for name, value in settings.items()}
