"""3-D boxes on views and from above: ``python -m experiments.box_pictures``. As the thesis' figure 5.4."""

import sys
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from experiments.cache.stages import Scale
from experiments.figures.boxes_on_views import MIN_CONFIDENCE, RECORD, busiest_view, draw, true_boxes
from labeling.runtime.cli import make_main
from labeling.runtime.help import CommandHelp

if TYPE_CHECKING:
    from experiments.cache.stages import RunContext


@dataclass(frozen=True)
class PictureConfig:
    """Draws the boxes of LDLS and of the SbM frustum PointNet (on shared labels) on views of test scenes, and from
    above. Or, of rooms in which things move, flow and the boxes of what moves, from above.

    The networks are those of table 5.5 and of moving_objects (from made-up motion): trained if they are not in the
    cache yet.
    """

    world: Literal["rooms", "streets", "moving"] = "streets"
    """Which world; ``moving`` are rooms in which things do."""
    scale: Scale = "quick"
    """Of the experiment."""
    seed: int = 0
    """Of labels and training."""
    views: int = 4
    """How many: of so many episodes that one each with the most objects; of what moves the first of two."""
    cache: Path = Path("out/experiments")
    """Folder for recorded episodes and intermediate results."""
    results: Path = Path("experiments/results")
    """Folder for the record of what is drawn."""
    docs: Path = Path("docs")
    """Folder for the picture."""


def run(config: PictureConfig) -> None:
    """Draws the picture.

    Raises:
        SbmError: if a world cannot be built, or nothing moves where it should.
    """
    from experiments.cache.origin import origin
    from experiments.cache.stages import RunContext
    from labeling.formats.atomic import write_json

    context = RunContext(config.scale, (config.seed,), 1, config.cache)
    picture = config.docs / "pictures" / f"{RECORD.format(config.world)}.png"
    drawn = (_moving if config.world == "moving" else _boxes)(config, context, picture)
    record = config.results / f"{RECORD.format(config.world)}.json"
    settings = {name: value for name, value in asdict(config).items() if not isinstance(value, Path)}
    write_json(record, {**settings, "views": drawn, **origin()})
    print(f"{picture}\n{record}")


def _moving(config: PictureConfig, context: "RunContext", picture: Path) -> list[dict[str, Any]]:
    from experiments.figures import moving_flow
    from experiments.tables.moving_objects import made_up_flow

    flow, folders = made_up_flow(config.seed, context)
    return moving_flow.draw(Path(flow), folders, config.views, picture)


def _boxes(config: PictureConfig, context: "RunContext", picture: Path) -> list[dict[str, Any]]:
    from experiments.cache.box_stages import detections, load_detector_3d
    from experiments.tables import table_5_5
    from experiments.tables.training_sets import TrainingSets
    from labeling.io.episodes import read_episode

    sets = TrainingSets(config.world, context)
    network, categories = table_5_5.sbm_network(config.world, config.seed, context)
    ldls_ap25 = table_5_5.ldls_ap25_by_scale(config.world, sets.episodes("choose"), categories, context)
    detectors = {
        table_5_5.TUNED: load_detector_3d(table_5_5.best_ldls(ldls_ap25)),
        table_5_5.SHARED: load_detector_3d(network),
    }
    panels, drawn = [], []
    for folder in sets.episodes(table_5_5.TEST_SUBSET)[: config.views]:
        episode = read_episode(folder)
        view = busiest_view(episode, categories)
        seen = [one for one in detections(episode, "recorded", categories) if one.view_index == view]
        sure = [one for one in seen if one.confidence >= MIN_CONFIDENCE]
        found = {name: detector.lift(episode, sure) for name, detector in detectors.items()}
        panels.append((episode, view, found, true_boxes(episode, view, categories)))
        counts = {name: len(some) for name, some in found.items()}
        drawn.append({"episode": episode.name, "view": view, "boxes": counts})
    draw(panels, picture)
    return drawn


HELP = CommandHelp(
    examples=(("", "draw boxes in streets anew"), ("--world moving", "flow, and what moves in rooms")),
)
main = make_main("experiments.box_pictures", PictureConfig, run, resumes=False, about=HELP)

if __name__ == "__main__":
    sys.exit(main())
