"""The pictures of README and docs, drawn from a run of the demo: ``python -m experiments.pictures``."""

import sys
from dataclasses import dataclass
from pathlib import Path

from labeling.core.errors import UsageError
from labeling.runtime.cli import make_main
from labeling.runtime.help import CommandHelp


@dataclass(frozen=True)
class PicturesConfig:
    """Draws the pictures that README and docs show, of the demo with the thesis' policy.

    Run that first: ``python -m experiments.demo --policy ring --out out/pictures``.
    """

    demo: Path = Path("out/pictures")
    """Folder of that demo's results."""
    out: Path = Path("docs/pictures")
    """Folder for the pictures."""


def run(config: PicturesConfig) -> None:
    """Draws all pictures.

    Raises:
        SbmError: if the demo has not been run.
    """
    from experiments.figures.episodes import draw_episode, draw_label_steps, draw_labels
    from experiments.figures.policies import draw_without_a_map
    from labeling.formats.atomic import atomic_file
    from labeling.io.episodes import find_episodes, read_episode
    from sbm_gym import preview

    if not (config.demo / "episodes").is_dir():
        command = f"python -m experiments.demo --policy ring --out {config.demo}"
        raise UsageError(f"{config.demo} holds no demo yet; {command} makes one")
    episodes = [read_episode(folder) for folder in find_episodes(config.demo / "episodes")]
    pictures = {"episode": draw_episode, "label_steps": draw_label_steps, "labels": draw_labels}
    for name, draw in pictures.items():
        path = config.out / f"{name}.png"
        with atomic_file(path) as temporary:
            draw(episodes, temporary)
        print(path)
    path = config.out / "policies_unmapped.png"
    draw_without_a_map(path)
    print(path)
    # Of the scenes only those of the test split: enough to see what worlds look like.
    preview.run(preview.PreviewConfig(out=config.out, what=("scenes",), worlds=("indoor", "outdoor"), split="test"))
    two = ("indoor", "outdoor")
    preview.run(preview.PreviewConfig(out=config.out, what=("moving",), worlds=two, split="train", scenes=1, size=160))


HELP = CommandHelp(
    examples=(("", "draw docs/pictures anew from out/pictures"),),
)
main = make_main("experiments.pictures", PicturesConfig, run, resumes=False, about=HELP)

if __name__ == "__main__":
    sys.exit(main())
