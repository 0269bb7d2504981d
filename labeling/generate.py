"""Labels every view of recorded episodes: ``python -m labeling.generate DATASET --out LABELS``."""

import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from labeling.cli import run_command
from labeling.errors import EpisodeFormatError, SbmError, UsageError
from labeling.label_config import LabelConfig

if TYPE_CHECKING:
    from labeling.label_set import EpisodeState


@dataclass(frozen=True)
class GenerateConfig:
    """Turns the confident detections of each episode into masks and boxes of every object in all of its views.

    Writes COCO JSON (modal and amodal masks), 3-D boxes and segmented clouds. Episodes that are already labelled are
    passed over unless their files, the settings or the program have changed.
    """

    dataset: tyro.conf.Positional[Annotated[Path, tyro.conf.arg(metavar="DATASET")]]
    """An episode, or a folder of episodes."""
    out: Path
    """Folder of the label set; made if it does not exist."""
    label: tyro.conf.OmitArgPrefixes[LabelConfig] = field(default_factory=LabelConfig)


def run(config: GenerateConfig) -> None:
    """Labels a dataset and writes the label set.

    Raises:
        SbmError: if the dataset holds no episode or the output folder cannot be used; and, after all the others have
            been labelled and written, if any episode failed (each has been told on stderr in one line).
    """
    from tqdm import tqdm

    from labeling.episodes import find_episodes
    from labeling.label_set import write_label_set

    config.label.check()
    folders = find_episodes(config.dataset)
    _check_out(config.out, config.dataset)
    states = []
    for folder in tqdm(folders, desc="labelling", unit="episode", delay=2.0, leave=False, file=sys.stderr):
        state = _label_one(folder, config)
        if state.error is not None:
            tqdm.write(f"error: {state.error}", file=sys.stderr)
        states.append(state)
    write_label_set(config.out, config.dataset, config.label, states)
    _report(config, states)
    failed = sum(state.record is None for state in states)
    if failed:
        raise SbmError(f"{failed} of {len(states)} episodes could not be labelled, for the reasons above")


def _label_one(folder: Path, config: GenerateConfig) -> "EpisodeState":
    """Labels one episode, or takes what an earlier run has left."""
    from labeling.episodes import read_episode
    from labeling.files import write_json
    from labeling.label_set import EpisodeState, episode_record, fingerprint, read_record
    from labeling.ply import write_ply

    name = folder.resolve().name
    relative = "." if folder == config.dataset else folder.relative_to(config.dataset).as_posix()
    record_file, cloud_file = config.out / "episodes" / f"{name}.json", config.out / "clouds" / f"{name}.ply"
    try:
        mark = fingerprint(folder, config.label)
        record = read_record(record_file, mark)
        if record is None or not cloud_file.is_file():
            episode = read_episode(folder)
            if episode.detections is None:
                raise EpisodeFormatError(f"{folder / 'detections.json'}: is missing; run a detector on the views first")
            from labeling.propagate import propagate

            labels = propagate(
                episode.rgb,
                episode.depth_m,
                episode.intrinsics,
                episode.camera_to_world,
                episode.detections,
                config.label,
            )
            cloud = labels.cloud
            write_ply(cloud_file, cloud.points, cloud.colours, cloud.instance_id, cloud.confidence)
            record = episode_record(episode, labels, name, mark)
            write_json(record_file, record)
    except SbmError as error:
        return EpisodeState(name, relative, None, str(error))
    except OSError as error:
        return EpisodeState(name, relative, None, f"{folder}: cannot be read or written ({error})")
    return EpisodeState(name, relative, record)


def _check_out(out: Path, dataset: Path) -> None:
    if out.resolve() == dataset.resolve():
        raise UsageError(f"--out {out} is the dataset itself; give another folder")
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"--out {out}: cannot make this folder ({error})") from None


def _report(config: GenerateConfig, states: "list[EpisodeState]") -> None:
    records = [state.record for state in states if state.record is not None]
    views = sum(len(record["file_names"]) for record in records)
    objects = sum(len(record["objects"]) for record in records)
    labels = sum(label["modal"] is not None for record in records for label in record["labels"])
    print(f"{objects} objects, {labels} masks in {views} views of {len(records)} episodes")
    if objects == 0 and records:
        print(f"note: no object reached --confident {config.label.confident:g}; a lower threshold may find sources")
    print(f"labels: {config.out}")


def main(arguments: list[str] | None = None) -> int:
    """Runs the command line; returns its exit code."""
    return run_command(GenerateConfig, run, "python -m labeling.generate", arguments)


if __name__ == "__main__":
    sys.exit(main())
