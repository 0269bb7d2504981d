"""Where a detector fails in worlds, by view: ``python -m experiments.detector_failures``."""

import sys
from dataclasses import dataclass, field
from pathlib import Path

from experiments.pretraining.world_views import WORLDS, WorldViewsConfig
from labeling.runtime.cli import make_main
from labeling.runtime.help import CommandHelp


@dataclass(frozen=True)
class FailuresConfig:
    """Runs a detector on views of the worlds' training scenes, and draws how often it finds objects by the side that
    they are seen from, by how much of them is visible, and by their distance.
    """

    detector: str = "compact"
    """Which detector: compact, maskrcnn_resnet50_fpn, onnx:FILE, package.module:function, or a run's folder."""
    views: WorldViewsConfig = field(default_factory=WorldViewsConfig)
    """Which views."""
    picture: Path = Path("docs/pictures/detector_failures.png")
    """PNG to write."""
    results: Path = Path("experiments/results/detector_failures.json")
    """File for the figures."""


def run(config: FailuresConfig) -> None:
    """Draws the picture and writes the figures.

    Raises:
        SbmError: if there is no such detector, or it cannot run.
    """
    import os
    from dataclasses import asdict

    os.environ.setdefault("OMP_WAIT_POLICY", "passive")
    from experiments.cache.origin import origin
    from experiments.pretraining.failure_figures import CONDITIONS, bin_by, draw_failures, find_objects
    from experiments.pretraining.world_views import record_views
    from labeling.detectors.registry import check_name, load_detector
    from labeling.formats.atomic import write_json
    from labeling.io.episodes import find_episodes, read_episode

    check_name(config.detector)
    detector = load_detector(config.detector)
    objects = {}
    for world in WORLDS:
        folders = find_episodes(record_views(config.views, world, "train"))
        objects[world] = [one for folder in folders for one in find_objects(read_episode(folder), detector)]
    tables = {world: {name: bin_by(objects[world], name, world) for name in CONDITIONS} for world in WORLDS}
    draw_failures(tables, config.picture)
    content = {
        "detector": config.detector,
        "seed": config.views.seed,
        "episodes": config.views.episodes,
        "objects": {world: len(objects[world]) for world in WORLDS},
        "by": {world: {name: [asdict(row) for row in rows] for name, rows in t.items()} for world, t in tables.items()},
        **origin(),
    }
    write_json(config.results, content)
    print(config.picture)
    print(config.results)


HELP = CommandHelp(
    examples=(("", "measure, and draw the picture"),),
)
main = make_main("experiments.detector_failures", FailuresConfig, run, about=HELP)

if __name__ == "__main__":
    sys.exit(main())
