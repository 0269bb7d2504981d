"""Which results are of an earlier label generator than others."""

from collections.abc import Mapping
from typing import Any

from experiments.cache.origin import GENERATOR, MADE_ON

COMMIT_DIGITS = 7


def origins(contents: Mapping[str, Mapping[str, Any]], titles: Mapping[str, str]) -> dict[str, str]:
    """A sentence about each file of results: when it was made, and whether a later label generator made others.

    Args:
        contents: of the files, by name.
        titles: what their sections are called; only these count.
    """
    known = {name: content for name, content in contents.items() if name in titles}
    dated = [name for name, content in known.items() if MADE_ON in content]
    newest = max(dated, key=lambda name: known[name][MADE_ON], default=None)
    found = {}
    for name, content in known.items():
        commit = (content.get("git_commit") or "unknown")[:COMMIT_DIGITS]
        when = f"on {content[MADE_ON]}, " if MADE_ON in content else ""
        sentence = f"Made {when}at commit {commit}."
        if newest is not None and content.get(GENERATOR) != known[newest][GENERATOR]:
            later = titles[newest]
            sentence += f" **\u201c{later}\u201d is of a later label generator: made anew, these figures may differ.**"
        found[name] = sentence
    return found
