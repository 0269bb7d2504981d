"""Pairs of views that were taken one after the other: a time each, in a grid around what both of them see."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np

from labeling.core.episode import Episode
from labeling.core.errors import EpisodeFormatError
from labeling.core.views import RgbdViews
from labeling.io.episodes import find_episodes, read_episode
from labeling.memory.lifting.placement import grid_and_floor
from labeling.memory.settings.memory_spec import SceneSize
from labeling.memory.view_prediction.scenes import SmallScene, shrunk

Pair = TypeVar("Pair")

WIDEST_TURN_DEG, FURTHEST_M = 40.0, 1.5
"""Views further apart than this, of gaze or place, are no pair: they see too little in common."""


def view_pairs(name: str, views: RgbdViews, spec: SceneSize) -> list[SmallScene]:
    """All pairs of one view and the next that see something in common.

    Args:
        name: of the episode.
        views: in order of time.
        spec: of the memory, or its size. Its grid stands around the middle of what each pair has seen.

    Returns:
        Scenes of two views each; ``view_index`` says which.

    Raises:
        EpisodeFormatError: if there is no pair: a single view, no depth, or views that see nothing in common.
    """
    pairs = []
    poses = views.camera_to_world.astype(float)
    for first in range(views.num_views - 1):
        both = [first, first + 1]
        gazes, places = poses[both, :3, 2], poses[both, :3, 3]
        turn_deg = np.degrees(np.arccos(np.clip(gazes[0] @ gazes[1], -1, 1)))
        away_m = float(np.linalg.norm(places[1] - places[0]))
        if turn_deg > WIDEST_TURN_DEG or away_m > FURTHEST_M or not (views.depth_m[both] > 0).any(axis=(1, 2)).all():
            continue
        own = RgbdViews(views.rgb[both], views.depth_m[both], views.intrinsics[both], views.camera_to_world[both])
        pairs.append(shrunk(name, views, both, spec, *grid_and_floor(own, spec.grid, "scene")))
    if not pairs:
        raise EpisodeFormatError(
            f"{name}: no two of its {views.num_views} views follow each other within {WIDEST_TURN_DEG:g} degrees and "
            f"{FURTHEST_M:g} m with depth in both, so that nothing can be seen to move"
        )
    return pairs


def read_view_pairs(datasets: Sequence[Path], spec: SceneSize) -> tuple[list[list[SmallScene]], list[str]]:
    """Pairs of views of all episodes of some datasets.

    Args:
        datasets: folders of episodes, or episodes.
        spec: of the memory, or its size.

    Returns:
        The pairs of each episode, and a sentence about each episode that had to be left out.

    Raises:
        EpisodeFormatError: if a dataset is none, or no episode of all is left.
    """
    return read_pairs(datasets, lambda episode: view_pairs(episode.name, episode, spec))


def read_pairs(
    datasets: Sequence[Path], pairs_of: Callable[[Episode], list[Pair]], ground_truth: bool = False
) -> tuple[list[list[Pair]], list[str]]:
    """Pairs of any kind of all episodes of some datasets.

    Args:
        datasets: folders of episodes, or episodes.
        pairs_of: the pairs of an episode.
        ground_truth: read it, too.

    Returns:
        The pairs of each episode, and a sentence about each episode that had to be left out.

    Raises:
        EpisodeFormatError: if a dataset is none, or no episode of all is left.
    """
    from labeling.runtime.cli import progress_bar

    folders = [folder for dataset in datasets for folder in find_episodes(dataset)]
    found, notes = [], []
    for folder in progress_bar(folders, desc="reading episodes"):
        try:
            found.append(pairs_of(read_episode(folder, ground_truth=ground_truth)))
        except EpisodeFormatError as error:
            notes.append(str(error))
    if not found:
        raise EpisodeFormatError(f"no episode to learn flow from; the first: {notes[0]}")
    return found, notes
