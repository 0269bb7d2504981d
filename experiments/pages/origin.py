"""When and where results were made, and which are of an earlier label generator, or of detectors taught otherwise."""

from collections.abc import Iterable, Mapping
from typing import Any

from experiments.cache.origin import GENERATOR, MACHINES, MADE_ON, MASKS_FROM
from labeling.core.masks import MASK_THRESHOLD
from labeling.detectors.networks.spec import PREDICTED_MASK_THRESHOLD

COMMIT_DIGITS = 7
TRUST_SCORES = "trust_scores"
"""Of ``FinetuneConfig``, as results have it."""
DAY = len("2026-11-26")
"""Characters of a time that say the day."""
EARLIER = "**An earlier label generator than that of the latest results; made anew, these figures may differ.**"
CUT_OTHERWISE = "Masks of detectors were cut at {was:g}, now they are at {now:g}."
BELIEVED_OTHERWISE = "Scores of labels weighed what is there, too; now they weigh its box and mask alone."


def origins(contents: Mapping[str, Mapping[str, Any]], named: Iterable[str] | None = None) -> dict[str, str]:
    """Of files of results: when each was made, where its networks were trained, and whether a later label generator
    made others.

    Args:
        contents: of the files, by name.
        named: which to tell of; None tells of all.
    """
    found, earlier = {}, of_earlier_generator(contents)
    for name in contents if named is None else named:
        content = contents[name]
        commit = (content.get("git_commit") or "unknown")[:COMMIT_DIGITS]
        when = f"on {content[MADE_ON][:DAY]}, " if MADE_ON in content else ""
        changed = ", with uncommitted changes" if content.get("git_uncommitted_changes") else ""
        sentence = f"Made {when}at commit {commit}{changed}."
        if content.get(MACHINES):
            sentence += f" Trained on {', '.join(content[MACHINES])}."
        found[name] = sentence + _taught_otherwise(content) + (f" {EARLIER}" if name in earlier else "")
    return found


def section_of_origins(contents: Mapping[str, Mapping[str, Any]], names: Iterable[str]) -> str:
    """The section of a page that says where its figures come from.

    Args:
        contents: of all results, by file name; they say what the latest label generator is.
        names: of the files whose figures are of labels; those that are not there are passed over.
    """
    told = origins(contents, [name for name in names if name in contents])
    lines = [f"- `{name}`: {sentence}" for name, sentence in told.items()]
    return "\n".join(["## Where these figures come from", "", *lines]) + "\n"


def of_earlier_generator(contents: Mapping[str, Mapping[str, Any]]) -> set[str]:
    """Names of the results that another label generator than that of the newest ones has made."""
    newest = _newest(contents)
    if newest is None:
        return set()
    return {name for name, content in contents.items() if content.get(GENERATOR) != contents[newest][GENERATOR]}


def _taught_otherwise(content: Mapping[str, Any]) -> str:
    """Says so where masks that detectors predict were cut at another probability than today, or scores of the labels
    that taught them were trusted.
    """
    settings = content.get("settings")
    has_predictions = any(row.get("labels") is None for row in content.get("rows", [{}]))
    if not isinstance(settings, Mapping) or "photographs" not in settings or not has_predictions:
        return ""
    was, said = settings.get(MASKS_FROM, MASK_THRESHOLD), ""
    if was != PREDICTED_MASK_THRESHOLD:
        said += " " + CUT_OTHERWISE.format(was=was, now=PREDICTED_MASK_THRESHOLD)
    if settings.get("train", {}).get(TRUST_SCORES, True):  # earlier settings have no choice
        said += " " + BELIEVED_OTHERWISE
    return said


def _newest(contents: Mapping[str, Mapping[str, Any]]) -> str | None:
    dated = [name for name, content in contents.items() if MADE_ON in content and GENERATOR in content]
    return max(dated, key=lambda name: contents[name][MADE_ON], default=None)
