"""Which episodes of a dataset show one and the same scene."""

from collections.abc import Sequence
from pathlib import Path

from labeling.formats.checked_json import read_json


def scene_of(folder: Path) -> tuple[str, str] | None:
    """World and scene of an episode, None if it does not say.

    Raises:
        EpisodeFormatError: if its ``episode.json`` is malformed.
    """
    file = folder / "episode.json"
    if not file.is_file():
        return None
    about = read_json(file)
    if not about.has("scene"):
        return None
    return (about.text("world") if about.has("world") else "", about.text("scene"))


def scene_groups(folders: Sequence[Path]) -> list[list[Path]]:
    """Episodes by their scene, in the order in which scenes first appear; those that name none are alone.

    Raises:
        EpisodeFormatError: if an ``episode.json`` is malformed.
    """
    groups: dict[object, list[Path]] = {}
    for folder in folders:
        groups.setdefault(scene_of(folder) or folder, []).append(folder)
    return list(groups.values())
