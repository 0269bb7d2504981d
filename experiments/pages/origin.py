"""When and where results were made, and which are of an earlier label generator than others."""

from collections.abc import Mapping
from typing import Any

from experiments.cache.origin import GENERATOR, MACHINES, MADE_ON

COMMIT_DIGITS = 7
DAY = len("2026-11-26")
"""Characters of a time that say the day."""


def origins(contents: Mapping[str, Mapping[str, Any]], titles: Mapping[str, str]) -> dict[str, str]:
    """Of each file of results: when it was made, where its networks were trained, and whether a later label generator
    made others.

    Args:
        contents: of the files, by name.
        titles: what their sections are called; only these count.
    """
    known = {name: content for name, content in contents.items() if name in titles}
    newest = _newest(known)
    found, earlier = {}, of_earlier_generator(known)
    for name, content in known.items():
        commit = (content.get("git_commit") or "unknown")[:COMMIT_DIGITS]
        when = f"on {content[MADE_ON][:DAY]}, " if MADE_ON in content else ""
        sentence = f"Made {when}at commit {commit}."
        if content.get(MACHINES):
            sentence += f" Trained on {', '.join(content[MACHINES])}."
        if newest is not None and name in earlier:
            later = titles[newest]
            sentence += f" **\u201c{later}\u201d is of a later label generator: made anew, these figures may differ.**"
        found[name] = sentence
    return found


def of_earlier_generator(contents: Mapping[str, Mapping[str, Any]]) -> set[str]:
    """Names of the results that another label generator than that of the newest ones has made."""
    newest = _newest(contents)
    if newest is None:
        return set()
    return {name for name, content in contents.items() if content.get(GENERATOR) != contents[newest][GENERATOR]}


def _newest(contents: Mapping[str, Mapping[str, Any]]) -> str | None:
    dated = [name for name, content in contents.items() if MADE_ON in content]
    return max(dated, key=lambda name: contents[name][MADE_ON], default=None)
