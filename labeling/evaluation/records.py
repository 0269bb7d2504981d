"""What evaluation needs of a dataset: detections and ground truth of the views that a label set covers."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import compress
from pathlib import Path

from labeling.core.episode import Episode
from labeling.core.errors import EpisodeFormatError, LabelFormatError, UsageError
from labeling.generator.sources import with_source_detections
from labeling.io.episodes import find_episodes, read_episode
from labeling.io.label_set import LabelSet, View, recording_config
from labeling.metrics.matching import MaskInstance, instances_of


@dataclass(frozen=True)
class EpisodeRecords:
    """What is known about the views of one episode, without its pictures."""

    name: str
    folder: Path
    views: tuple[View, ...]
    """The views evaluated."""
    has_detections: bool
    detections: tuple[MaskInstance, ...]
    truths: tuple[MaskInstance, ...]
    instance_ids: tuple[int, ...]
    """For each of ``truths`` the object's id within the episode."""
    amodal_truths: tuple[MaskInstance, ...]
    amodal_views: frozenset[View]
    """Views in which the amodal mask of every object is known."""
    detector_categories: frozenset[str] | None = None
    """What the detector has names for; None if the episode does not say (``detector_categories`` of episode.json)."""


def read_records(
    dataset: Path, labels: LabelSet, progress: Callable[[Iterable[Path]], Iterable[Path]], notes: list[str]
) -> Iterator[EpisodeRecords]:
    """Reads the labelled episodes that have ground truth; notes why others are left out.

    Raises:
        EpisodeFormatError: if the dataset holds no episode.
        UsageError: if no labelled episode has ground truth.
    """
    config = recording_config(labels.provenance)
    folders = {folder.resolve().name: folder for folder in find_episodes(dataset, config)}
    labelled = {episode for episode, _ in labels.sizes}
    found, without_truth = False, []
    for folder in progress([folder for name, folder in folders.items() if name in labelled]):
        try:
            episode = with_source_detections(read_episode(folder, config), labels.folder, labels.provenance)
            categories = detector_categories(folder, episode)
        except EpisodeFormatError as error:
            notes.append(f"left out, malformed: {error}")
            continue
        if episode.ground_truth is None:
            without_truth.append(episode.name)
            continue
        found = True
        yield _records(folder, episode, categories, labels)
    if without_truth:
        notes.append(f"left out, no ground_truth.json: {_listing(without_truth)}")
    if found:
        if unlabelled := [name for name in folders if name not in labelled]:
            notes.append(f"in the dataset but not in the label set, left out: {_listing(unlabelled)}")
        if unseen := sorted(labelled - folders.keys()):
            notes.append(f"labelled but not in the dataset, left out: {_listing(unseen)}")
        return
    if without_truth:
        raise UsageError(
            f"{dataset}: no ground truth to compare with; put a ground_truth.json (COCO instances with RLE masks) into "
            "its episodes"
        )
    if notes:
        raise EpisodeFormatError(notes[0].removeprefix("left out, malformed: "))
    raise UsageError(
        f"{dataset}: none of its {len(folders)} episodes is in the label set, which covers "
        f"{_listing(sorted(labelled)) or 'nothing'}; give the dataset that the labels were made from with --dataset"
    )


def _records(folder: Path, episode: Episode, categories: frozenset[str] | None, labels: LabelSet) -> EpisodeRecords:
    views = tuple((episode.name, view) for view in range(episode.num_views) if (episode.name, view) in labels.sizes)
    for name, view in (key for key in labels.sizes if key[0] == episode.name):
        if not 0 <= view < episode.num_views:
            raise LabelFormatError(
                f"{labels.folder}: has labels for view {view} of episode {name!r}, which has {episode.num_views} views"
            )
        if labels.sizes[name, view] != episode.size:
            raise LabelFormatError(
                f"{labels.folder}: says view {view} of episode {name!r} is {labels.sizes[name, view]} pixels "
                f"(height, width), but it is {episode.size}"
            )
    kept = {view for _, view in views}
    truths = [t for t in episode.ground_truth or () if t.view_index in kept]
    unknown = {t.view_index for t in truths if t.amodal is None}
    return EpisodeRecords(
        name=episode.name,
        folder=folder,
        views=views,
        has_detections=episode.detections is not None,
        detections=tuple(instances_of(episode.name, (d for d in episode.detections or () if d.view_index in kept))),
        truths=tuple(instances_of(episode.name, truths)),
        instance_ids=tuple(t.instance_id for t in truths if t.modal.any()),
        amodal_truths=tuple(instances_of(episode.name, truths, "amodal")),
        amodal_views=frozenset(view for view in views if view[1] not in unknown),
        detector_categories=categories,
    )


def detector_categories(folder: Path, episode: Episode) -> frozenset[str] | None:
    """What an episode says that its detector has names for; None if it does not say.

    Raises:
        EpisodeFormatError: if it says so in another way.
    """
    names = episode.metadata.get("detector_categories")
    if names is None:
        return None
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise EpisodeFormatError(f"{folder / 'episode.json'}: detector_categories: must be a list of names")
    return frozenset(names)


def without_unknown_categories(
    episodes: Sequence[EpisodeRecords], labels: LabelSet, notes: list[str]
) -> tuple[EpisodeRecords, ...]:
    """Leaves out ground truth of categories that neither the detector nor the labels have a name for.

    A category the detector was never taught says nothing about either of them; as in the thesis (5.1.2), figures are
    about the categories that detector and world share. Where an episode does not say what its detector knows,
    nothing is left out.
    """
    known: set[str] = {item.category for item in [*labels.modal, *labels.amodal]}
    for episode in episodes:
        if episode.detector_categories is None:
            return tuple(episodes)
        known |= episode.detector_categories | {item.category for item in episode.detections}
    unknown = sorted({item.category for episode in episodes for item in episode.truths} - known)
    if unknown:
        notes.append(f"left out, categories that the detector has no name for: {_listing(unknown)}")
    kept = []
    for episode in episodes:
        named = [item.category in known for item in episode.truths]
        truths, instance_ids = (tuple(compress(values, named)) for values in (episode.truths, episode.instance_ids))
        amodal_truths = tuple(item for item in episode.amodal_truths if item.category in known)
        kept.append(replace(episode, truths=truths, instance_ids=instance_ids, amodal_truths=amodal_truths))
    return tuple(kept)


def note_missing(episodes: Sequence[EpisodeRecords], labels: LabelSet, notes: list[str]) -> None:
    """Notes what a reader of the figures must know about the data."""
    undetected = [episode.name for episode in episodes if not episode.has_detections]
    if undetected and len(undetected) == len(episodes):
        notes.append("no episode has a detections.json: the detector's figures are undefined")
    elif undetected:
        notes.append(f"no detections.json, counted as nothing found: {_listing(undetected)}")
    if not labels.modal:
        notes.append("the label set holds no label")


def _listing(names: Sequence[str], most: int = 5) -> str:
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more
