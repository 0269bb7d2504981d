"""Java ``.properties`` text: what Sweet Home 3D writes its furniture catalogues in."""

import re

_ESCAPE = re.compile(r"\\(u[0-9a-fA-F]{4}|.)", re.DOTALL)
_NAMED = {"t": "\t", "n": "\n", "r": "\r", "f": "\f"}
_KEY_END = re.compile(r"(?<!\\)(?:\\\\)*[=:\s]")


def parse_properties(content: bytes) -> dict[str, str]:
    r"""Reads a Java properties file.

    Args:
        content: the file, in ISO-8859-1 with ``\uXXXX`` escapes, as Java writes it.

    Returns:
        The value of every key; of repeated keys the last one counts, as in Java.
    """
    properties = {}
    for line in _logical_lines(content.decode("iso-8859-1")):
        end = _KEY_END.search(line)
        key, rest = (line, "") if end is None else (line[: end.end() - 1], line[end.end() - 1 :].lstrip())
        if rest[:1] in ("=", ":"):
            rest = rest[1:].lstrip()
        properties[_unescape(key)] = _unescape(rest)
    return properties


def _logical_lines(text: str) -> list[str]:
    """Lines without comments and blank lines; a line that ends in an odd number of backslashes goes on in the next."""
    lines, pending = [], ""
    for natural in re.split(r"\r\n|\r|\n", text):
        stripped = natural.lstrip(" \t\f")
        if not pending and (not stripped or stripped[0] in "#!"):
            continue
        trailing = len(stripped) - len(stripped.rstrip("\\"))
        if trailing % 2:
            pending += stripped[:-1]
        else:
            lines.append(pending + stripped)
            pending = ""
    if pending:
        lines.append(pending)
    return lines


def _unescape(text: str) -> str:
    def character(match: re.Match) -> str:
        escaped = str(match.group(1))
        return chr(int(escaped[1:], 16)) if len(escaped) == 5 else _NAMED.get(escaped) or escaped

    return _ESCAPE.sub(character, text)
