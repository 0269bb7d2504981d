"""Labels every view of recorded episodes: ``python -m labeling.generate DATASET --out LABELS``."""

import sys
from contextlib import closing
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Annotated

import msgspec
import tyro

from labeling.cluster.cluster_config import ClusterConfig
from labeling.core.errors import SbmError, UsageError
from labeling.generator.label_jobs import EpisodeResult, Job, label_all
from labeling.generator.settings.label_config import LabelConfig
from labeling.generator.settings.option_groups import GROUPS
from labeling.generator.settings.presets import PRESETS, PresetName, describe
from labeling.generator.settings.source_config import SourceConfig
from labeling.io.recordings.recording_config import FLOOR, RecordingConfig
from labeling.runtime.cli import printable, progress_bar, run_command, say_next, showing_stages
from labeling.runtime.help import CommandHelp
from labeling.runtime.named_option import named_option
from labeling.runtime.run_folder import check_outside_recordings


@dataclass(frozen=True)
class GenerateConfig:
    """Turns the confident detections of each episode into masks and boxes of every object in all of its views.

    Takes the detections that are recorded with the episodes (labeling.detect adds them), unless --detector or
    --detections gives others. Writes COCO JSON (modal and amodal masks), 3-D boxes and segmented clouds. Episodes that
    are already labelled are passed over unless their files, the settings or the program have changed.
    """

    dataset: tyro.conf.Positional[Annotated[Path, tyro.conf.arg(metavar="DATASET")]]
    """An episode, or a folder of episodes: nerfstudio, Record3D, Polycam, TUM RGB-D or ScanNet folders."""
    out: Path
    """Folder of the label set; made if it does not exist."""
    workers: int = 1
    """Episodes labelled side by side, in processes of their own; the threads are shared out among them."""
    where: tyro.conf.OmitArgPrefixes[ClusterConfig] = field(default_factory=ClusterConfig)
    share_scenes: bool = False
    """Label what one episode has found in the other episodes of its scene, too: those whose episode.json names the same
    ``scene`` and whose poses are given in one world frame. What is small and far in one view is near in another."""
    label_together: bool = True
    """With ``--share-scenes``: label the episodes of a scene as one recording, so that what all of them have seen
    decides which objects there are; otherwise each is labelled alone, and then given what the others have found."""
    recording: tyro.conf.OmitArgPrefixes[RecordingConfig] = field(default_factory=RecordingConfig)
    sources: tyro.conf.OmitArgPrefixes[SourceConfig] = field(default_factory=SourceConfig)
    label: Annotated[LabelConfig, tyro.conf.arg(name="")] = field(default_factory=LabelConfig)


@dataclass(frozen=True)
class GenerateCommand(GenerateConfig):  # noqa: D101 - the docstring of GenerateConfig
    __doc__ = GenerateConfig.__doc__

    preset: PresetName = "default"
    """Where the settings of label generation start from: the best known, the same without anything that was fitted to
    ground truth ("unfitted"), the thesis as written ("paper"), or the code published with it, with its defects
    ("released"). Other flags change single settings of it."""


def run(config: GenerateConfig) -> None:
    """Labels a dataset and writes the label set.

    Raises:
        SbmError: if the dataset holds no episode or the output folder cannot be used; and, after all the others have
            been labelled and written, if any episode failed (each has been told on stderr in one line).
    """
    from labeling.generator.label_writer import write_label_set
    from labeling.generator.sources import source_fingerprint
    from labeling.io.episodes import find_episodes

    config.label.check()
    config.recording.check()
    config.sources.check()
    if config.workers < 1:
        raise UsageError(f"--workers must be at least 1, not {config.workers}")
    if config.share_scenes and config.recording.up == FLOOR:
        raise UsageError(
            "--share-scenes needs all episodes of a scene in one world frame, and --up=floor finds one for each; give "
            "the direction that a note told for one of them: --up=X,Y,Z"
        )
    inputs = (asdict(config.recording), source_fingerprint(config.sources))
    folders = find_episodes(config.dataset, config.recording)
    _check_out(config.out, config.dataset)
    job = Job(config.dataset, config.out, config.recording, config.sources, config.label, inputs)
    results = []
    together = config.share_scenes and config.label_together and config.label.fuse_views
    label = label_all
    if together:
        from labeling.generator.sharing.label_together import label_scenes as label
    bar = progress_bar(total=len(folders), desc="labelling", unit="episode")
    with bar, showing_stages(bar), closing(label(job, folders, config.workers, config.where)) as found:
        for result in found:
            bar.update()
            results.append(result)
            _print_notes(result)
    results.sort(key=lambda result: folders.index(job.dataset / result.folder))
    if config.share_scenes:
        from labeling.generator.sharing.share_scenes import share_scenes

        results = share_scenes(job, results, partial(progress_bar, desc="sharing", unit="episode"))
    about = {
        **describe(config.label),
        "share_scenes": config.share_scenes,
        **({"label_together": together} if config.share_scenes else {}),
        "recording": asdict(config.recording),
        "sources": msgspec.to_builtins(config.sources, enc_hook=str),
    }
    write_label_set(config.out, config.dataset, config.label, results, about)
    _report(config, results)
    failed = sum(result.record is None for result in results)
    if failed:
        raise SbmError(f"{failed} of {len(results)} episodes could not be labelled, for the reasons above")


def _print_notes(result: EpisodeResult) -> None:
    """Says on stderr, beside the progress bar, what a user should know about an episode."""
    from tqdm import tqdm

    for note in result.notes:
        tqdm.write(printable(f"note: {result.name}: {note}"), file=sys.stderr)
    if result.error is not None:
        tqdm.write(printable(f"error: {result.error}"), file=sys.stderr)


def _check_out(out: Path, dataset: Path) -> None:
    if out.resolve() == dataset.resolve():
        raise UsageError(f"--out {out} is the dataset itself; give another folder")
    check_outside_recordings(out)
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"--out {out}: cannot make this folder ({error})") from None


def _report(config: GenerateConfig, results: list[EpisodeResult]) -> None:
    from labeling.generator.label_writer import uncalibrated_detectors
    from labeling.io.label_set import calibration_note

    records = [result.record for result in results if result.record is not None]
    views = sum(len(record.file_names) for record in records)
    objects = sum(len(record.objects) for record in records)
    labels = sum(label.modal is not None for record in records for label in record.labels)
    print(f"{objects} objects, {labels} masks in {views} views of {len(records)} episodes")
    if objects == 0 and records:
        reached = f"--confident {config.label.confident:g}, nor all looks at it together --min-posterior"
        advice = "a lower threshold of either may find objects"
        print(f"note: no view of an object reached {reached} {config.label.min_posterior:g}; {advice}")
    if unmeasured := calibration_note({"uncalibrated_detectors": uncalibrated_detectors(results)}):
        print(f"note: {unmeasured}")
    print(f"labels: {config.out}")
    say_next("look at them", "labeling.inspect", config.out, "--view")
    say_next("if there is ground truth", "labeling.evaluate", config.out)


HELP = CommandHelp(
    GROUPS,
    examples=(
        ("MY_CAPTURE --detector compact --out LABELS", "a recording without detections: find them, then label"),
        ("EPISODES --workers 4 --share-scenes --out LABELS", "many episodes; those of a scene label each other"),
        ("EPISODES --preset paper --out LABELS", "as the thesis does"),
    ),
)


def main(arguments: list[str] | None = None) -> int:
    """Runs the command line; returns its exit code."""
    preset = named_option(arguments, "--preset", PRESETS)
    start = GenerateCommand(dataset=tyro.MISSING, out=tyro.MISSING, label=PRESETS[preset], preset=preset)
    return run_command(GenerateCommand, run, "python -m labeling.generate", arguments, start=start, about=HELP)


if __name__ == "__main__":
    sys.exit(main())
