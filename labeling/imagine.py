"""Shows what a memory predicts, or what moves: ``python -m labeling.imagine RUN EPISODE --out PICTURES``."""

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from labeling.core.errors import UsageError
from labeling.runtime.cli import make_main
from labeling.runtime.help import CommandHelp

if TYPE_CHECKING:
    import numpy as np
    from jaxtyping import UInt8

    from labeling.memory.networks.weights import Memory
    from labeling.memory.view_prediction.scenes import SmallScene

    Rows = list[tuple[str, UInt8[np.ndarray, "n h w 3"]]]

DEFAULT_INPUTS, DEFAULT_VIEWS = 4, 6
FILMED_PAIRS = 30
"""At most, of a long recording spread evenly: a film should stay small."""


@dataclass(frozen=True)
class ImagineCommand:
    """Draws views that a memory predicts beside the true ones, as a picture and as a film of all views.

    Of cn3d it draws features as colours: those predicted from the memory beside those of the view itself. Of a
    labeling.train_flow run it draws pairs of views with their flow from above: arrows in blue, what was found to move
    in orange, and in green what does, where the episode knows it.
    """

    run: tyro.conf.Positional[Annotated[Path, tyro.conf.arg(metavar="RUN")]]
    """Folder of a labeling.train_memory or a labeling.train_flow run."""
    episode: tyro.conf.Positional[Annotated[Path, tyro.conf.arg(metavar="EPISODE")]]
    """An episode with depth and poses, best one that RUN has not learnt from."""
    out: Path
    """Folder for EPISODE_views.png and EPISODE_film.gif; of flow EPISODE_flow.png and EPISODE_flow.gif."""
    inputs: tuple[int, ...] = ()
    """Numbers of the views that go into the memory; by default four of those that look at its middle. Of
    flow there are none."""
    views: tuple[int, ...] = ()
    """Numbers of the views that are predicted; by default six others. Of flow the first views of the pairs that are
    drawn; by default six pairs, those with the surest objects."""
    device: str | None = None
    """cpu, cuda, ...; by default a GPU if there is one."""


def run(command: ImagineCommand) -> list[Path]:
    """Draws.

    Returns:
        The files.

    Raises:
        SbmError: if there is no such run, episode or view.
    """
    from labeling.memory.flow.flow_detector import is_flow_run

    picture, film = draw_flow(command) if is_flow_run(command.run) else draw_predictions(command)
    print(picture)
    print(film)
    return [picture, film]


def draw_predictions(command: ImagineCommand) -> tuple[Path, Path]:
    """Draws predicted views.

    Returns:
        Picture and film.

    Raises:
        SbmError: if there is no such run, episode or view.
    """
    from labeling.detectors.registry import choose_device
    from labeling.formats.atomic import write_png
    from labeling.formats.film import write_film
    from labeling.io.episodes import read_episode
    from labeling.memory.networks.weights import load_memory, read_around
    from labeling.memory.view_prediction.pictures import draw_rows
    from labeling.memory.view_prediction.scenes import small_scene

    network, around = load_memory(command.run).to(choose_device(command.device)), read_around(command.run)
    scene = small_scene(command.episode.name, read_episode(command.episode, ground_truth=False), network.spec, around)
    inputs, asked = choose_views(scene, command.inputs, command.views)
    name = command.episode.resolve().name
    picture, film = command.out / f"{name}_views.png", command.out / f"{name}_film.gif"
    given: Rows = [(f"given: views {' '.join(str(scene.view_index[one]) for one in inputs)}", scene.rgb[inputs])]
    rows = predicted_rows(network, scene, inputs, asked)
    widest = max(len(pictures) for _, pictures in given + rows)
    write_png(picture, draw_rows([(title, _padded(pictures, widest)) for title, pictures in given + rows]))
    everything = predicted_rows(network, scene, inputs, list(range(scene.num_views)))
    frames = [
        draw_rows([("   ".join(title for title, _ in everything), _beside([one[number] for _, one in everything]))])
        for number in range(scene.num_views)
    ]
    write_film(frames, film)
    return picture, film


def draw_flow(command: ImagineCommand) -> tuple[Path, Path]:
    """Draws pairs of views with their flow from above.

    Returns:
        Picture of some pairs, and film of all or of ``FILMED_PAIRS``.

    Raises:
        SbmError: if there is no such run, episode or pair.
    """
    from labeling.formats.atomic import write_png
    from labeling.formats.film import write_film
    from labeling.io.episodes import read_episode
    from labeling.memory.flow.flow_detector import load_moving_detector
    from labeling.memory.flow.flow_pictures import draw_pairs, pair_pictures
    from labeling.memory.flow.view_pairs import view_pairs
    from labeling.runtime.cli import progress_bar

    if command.inputs:
        raise UsageError(f"{command.run}: tells flow between two views; give the first ones with --views, no --inputs")
    detector, episode = load_moving_detector(command.run, command.device), read_episode(command.episode)
    pairs = view_pairs(command.episode.name, episode, detector.spec.memory)
    starts = [pair.view_index[0] for pair in pairs]
    for one in command.views:
        if one not in starts:
            raise UsageError(f"view {one} has no view after it to compare; those that do are {_listed(starts)}")
    drawn, sure = [], []
    for pair in progress_bar(pairs, desc="telling flow"):
        pictures, found = pair_pictures(detector, episode, pair)
        drawn.append(pictures)
        sure.append(max((one.confidence for one in found), default=0.0))
    surest = sorted(range(len(pairs)), key=lambda one: -sure[one])
    shown = [starts.index(one) for one in command.views] or sorted(surest[:DEFAULT_VIEWS])
    name = command.episode.resolve().name
    picture, film = command.out / f"{name}_flow.png", command.out / f"{name}_flow.gif"
    write_png(picture, draw_pairs([drawn[one] for one in shown], f"views {_listed([starts[one] for one in shown])}"))
    filmed = _spread(range(len(pairs)), FILMED_PAIRS)
    write_film([draw_pairs([drawn[one]], f"view {starts[one]}") for one in filmed], film)
    return picture, film


def choose_views(scene: "SmallScene", inputs: Sequence[int], views: Sequence[int]) -> tuple[list[int], list[int]]:
    """Views to remember and to predict, as positions in the scene.

    Args:
        scene: of the episode.
        inputs: numbers of views in the episode; if empty, some are chosen.
        views: likewise.

    Raises:
        UsageError: if a view does not look at the grid, or is not there.
    """
    for one in (*inputs, *views):
        if one not in scene.view_index:
            raise UsageError(
                f"view {one} does not look at the middle of the memory, or is not there; those that do are "
                f"{_listed(scene.view_index)}"
            )
    given = [scene.view_index.index(one) for one in inputs]
    asked = [scene.view_index.index(one) for one in views]
    if not given:
        others = [one for one in range(scene.num_views) if one not in asked]
        given = _spread(others, min(DEFAULT_INPUTS, len(others) - (0 if asked else 1)))
    if not given:
        raise UsageError("all views are to be predicted, none is left to remember; give fewer --views")
    others = [one for one in range(scene.num_views) if one not in given]
    if not asked and not others:
        raise UsageError("all views are to be remembered, none is left to predict; give fewer --inputs, or --views")
    return given, asked or _spread(others, DEFAULT_VIEWS)


def _listed(numbers: Sequence[int]) -> str:
    return ", ".join(map(str, numbers))


def _spread(numbers: Sequence[int], count: int) -> list[int]:
    """Some of the numbers, evenly."""
    count = min(count, len(numbers))
    return [numbers[int((one + 0.5) * len(numbers) / count)] for one in range(count)]


def predicted_rows(network: "Memory", scene: "SmallScene", inputs: list[int], asked: list[int]) -> "Rows":
    """Titles and pictures of what is true and what a network predicts."""
    import torch

    from labeling.memory.networks.cn3d import Cn3d
    from labeling.memory.view_prediction.evaluation import predictor
    from labeling.memory.view_prediction.pictures import feature_colours, to_bytes
    from labeling.memory.view_prediction.reprojection import reproject_views

    network.eval()
    device = next(network.parameters()).device
    given, true = scene.views(inputs, inputs[0]), scene.views(asked, inputs[0])
    if isinstance(network, Cn3d):
        with torch.inference_mode():
            top_down = network(given.to(device), true.to(device))[0]
            bottom_up = network.look(true.rgb.to(device))[0]
        of_memory, of_view = feature_colours(top_down, bottom_up)
        return [("true", scene.rgb[asked]), ("its own features", of_view), ("predicted", of_memory)]
    return [
        ("true", scene.rgb[asked]),
        ("predicted", to_bytes(predictor(network, device)(given, true))),
        ("reprojected", to_bytes(reproject_views(given, true))),
    ]


def _padded(pictures: "UInt8[np.ndarray, 'n h w 3']", count: int) -> "UInt8[np.ndarray, 'm h w 3']":
    """With white pictures at the end."""
    import numpy as np

    blank = np.full((count - len(pictures), *pictures.shape[1:]), 255, np.uint8)
    return np.concatenate([pictures, blank])


def _beside(pictures: "Sequence[UInt8[np.ndarray, 'h w 3']]") -> "UInt8[np.ndarray, 'n h w 3']":
    """Pictures of one size, that of the largest."""
    import cv2
    import numpy as np

    height, width = max(one.shape[:2] for one in pictures)
    return np.stack([cv2.resize(one, (width, height), interpolation=cv2.INTER_NEAREST) for one in pictures])


HELP = CommandHelp(
    examples=(
        ("RUN EPISODE --out PICTURES", "four views given, six predicted"),
        ("RUN EPISODE --inputs 3 9 --views 15 20 --out PICTURES", "views by their numbers"),
        ("FLOW EPISODE --out PICTURES", "what moves, from above"),
    ),
)
main = make_main("labeling.imagine", ImagineCommand, run, about=HELP, resumes=False)

if __name__ == "__main__":
    sys.exit(main())
