"""Flow of what moves, from above, beside the views it was told from."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from labeling.core.errors import EpisodeFormatError, SbmError


def draw(flow: Path, folders: Sequence[Path], count: int, path: Path) -> list[dict[str, Any]]:
    """Draws pairs of views with arrows, boxes that were found, and true ones.

    Of the first episodes in which something is to be found that pair each is drawn in which most is.

    Args:
        flow: folder of a ``labeling.train_flow`` run.
        folders: episodes with ground truth of motion, in order.
        count: how many pairs.
        path: of the picture.

    Returns:
        What is drawn: episode, views, how many boxes were found and how many were to be.

    Raises:
        SbmError: if nothing moves in any episode.
    """
    from labeling.formats.atomic import write_png
    from labeling.io.episodes import read_episode
    from labeling.memory.flow.flow_detector import load_moving_detector
    from labeling.memory.flow.flow_evaluation import moving_truths
    from labeling.memory.flow.flow_pictures import draw_pairs, pair_pictures
    from labeling.memory.flow.view_pairs import view_pairs

    detector = load_moving_detector(flow)
    memory = detector.spec.memory
    panels, drawn = [], []
    for folder in folders:
        episode = read_episode(folder)
        try:
            pairs = view_pairs(folder.name, episode, memory)
        except EpisodeFormatError:  # it has none
            continue
        to_find = [sum(not one.ignore for one in moving_truths(episode, pair, memory.grid)) for pair in pairs]
        most = max(to_find)
        if most == 0:
            continue
        pair = pairs[to_find.index(most)]
        pictures, found = pair_pictures(detector, episode, pair)
        panels.append(pictures)
        drawn.append({"episode": folder.name, "view": list(pair.view_index), "found": len(found), "to_find": most})
        if len(drawn) == count:
            break
    if not drawn:
        raise SbmError("nothing moves in any test episode; take a larger --scale")
    write_png(path, draw_pairs(panels, "two views after each other"))
    return drawn
