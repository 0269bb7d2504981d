"""Recorded episodes that a detector is calibrated with."""

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from tqdm import tqdm

from labeling.core.episode import Episode
from labeling.core.errors import UsageError
from labeling.formats.checked_json import read_json
from labeling.io.episodes import find_episodes, read_episode


def training_episodes(datasets: Sequence[Path], title: str) -> Iterator[Episode]:
    """The episodes of some datasets, one after the other.

    Args:
        datasets: folders of episodes.
        title: of the progress bar.

    Raises:
        SbmError: if one cannot be read, or has no detections or no ground truth.
    """
    folders = [folder for dataset in datasets for folder in find_episodes(dataset)]
    for folder in tqdm(folders, desc=title, unit="episode", file=sys.stderr):
        yield read_training_episode(folder)


def read_training_episode(folder: Path) -> Episode:
    """An episode with detections and ground truth.

    Raises:
        SbmError: if it cannot be read, or lacks one of them.
    """
    episode = read_episode(folder)
    if episode.ground_truth is None or episode.detections is None:
        raise UsageError(f"{folder}: needs detections.json and ground_truth.json")
    return episode


def detector_of(datasets: Sequence[Path]) -> str:
    """The detector that some datasets were recorded with.

    Raises:
        UsageError: if they do not say, or not all name the same.
    """
    names = {
        read_json(folder / "episode.json").text("detector") if (folder / "episode.json").is_file() else "(none named)"
        for dataset in datasets
        for folder in find_episodes(dataset)
    }
    if len(names) != 1:
        raise UsageError(f"calibrate one detector at a time; these episodes are of {', '.join(sorted(names))}")
    return names.pop()
