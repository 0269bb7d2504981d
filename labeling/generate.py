"""Labels every view of recorded episodes: ``python -m labeling.generate DATASET --out LABELS``."""

import sys
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from labeling.cli import run_command
from labeling.errors import SbmError, UsageError
from labeling.label_config import LabelConfig
from labeling.recordings.config import RecordingConfig
from labeling.source_config import SourceConfig

if TYPE_CHECKING:
    from labeling.label_set import EpisodeState


@dataclass(frozen=True)
class GenerateConfig:
    """Turns the confident detections of each episode into masks and boxes of every object in all of its views.

    Writes COCO JSON (modal and amodal masks), 3-D boxes and segmented clouds. Episodes that are already labelled are
    passed over unless their files, the settings or the program have changed.
    """

    dataset: tyro.conf.Positional[Annotated[Path, tyro.conf.arg(metavar="DATASET")]]
    """An episode, or a folder of episodes: nerfstudio, Record3D, Polycam, TUM RGB-D or ScanNet folders."""
    out: Path
    """Folder of the label set; made if it does not exist."""
    recording: tyro.conf.OmitArgPrefixes[RecordingConfig] = field(default_factory=RecordingConfig)
    sources: tyro.conf.OmitArgPrefixes[SourceConfig] = field(default_factory=SourceConfig)
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
    from labeling.label_sources import identity

    config.label.check()
    config.recording.check()
    config.sources.check()
    inputs = [asdict(config.recording), identity(config.sources)]
    folders = find_episodes(config.dataset, config.recording)
    _check_out(config.out, config.dataset)
    states = []
    for folder in tqdm(folders, desc="labelling", unit="episode", delay=2.0, leave=False, file=sys.stderr):
        state = _label_one(folder, config, inputs)
        for note in [] if state.record is None else state.record["notes"]:
            tqdm.write(f"note: {state.name}: {note}", file=sys.stderr)
        if state.error is not None:
            tqdm.write(f"error: {state.error}", file=sys.stderr)
        states.append(state)
    about = {
        "recording": asdict(config.recording),
        "sources": {name: value and str(value) for name, value in asdict(config.sources).items()},
    }
    write_label_set(config.out, config.dataset, config.label, states, about)
    _report(config, states)
    failed = sum(state.record is None for state in states)
    if failed:
        raise SbmError(f"{failed} of {len(states)} episodes could not be labelled, for the reasons above")


def _label_one(folder: Path, config: GenerateConfig, inputs: list[Any]) -> "EpisodeState":
    """Labels one episode, or takes what an earlier run has left."""
    from labeling.episodes import read_episode
    from labeling.files import write_json
    from labeling.label_set import EpisodeState, episode_record, fingerprint, read_record
    from labeling.label_sources import DETECTIONS_FOLDER, find_sources
    from labeling.ply import write_ply

    name = folder.resolve().name
    relative = "." if folder == config.dataset else folder.relative_to(config.dataset).as_posix()
    record_file, cloud_file = config.out / "episodes" / f"{name}.json", config.out / "clouds" / f"{name}.ply"
    try:
        mark = fingerprint(folder, config.label, inputs)
        record = read_record(record_file, mark)
        if record is None or not cloud_file.is_file():
            episode = read_episode(folder, config.recording)
            cache = config.out / DETECTIONS_FOLDER / f"{name}.json"
            sources = find_sources(folder, episode, relative, config.sources, config.label, cache)
            from labeling.propagate import propagate

            labels = propagate(
                episode.rgb,
                episode.depth_m,
                episode.intrinsics,
                episode.camera_to_world,
                sources.detections,
                config.label,
            )
            cloud = labels.cloud
            write_ply(cloud_file, cloud.points, cloud.colours, cloud.instance_id, cloud.confidence)
            record = episode_record(episode, labels, name, mark, sources.origin, (*episode.notes, *sources.notes))
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
