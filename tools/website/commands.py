"""Pages of commands, made of what the commands say themselves when asked for ``--help``."""

import contextlib
import importlib
import io
import os
import re
from collections.abc import Mapping
from unittest.mock import patch

from experiments.sbm import VERBS
from labeling.runtime.cli import called_as
from tests.imports import PACKAGES, commands

DEVELOPERS = "for developers"
"""Title of the commands that make what is committed; they have no verb."""
_COLUMN = 24
"""Where explanations begin in a help (``labeling.runtime.help``), in letters from the left."""
_WIDTH = 100


def groups() -> dict[str, dict[str, tuple[str, str]]]:
    """All commands by group and name: the module with ``main``, and what the command does in a few words or none."""
    known = {module.removesuffix(".__main__") for verbs in VERBS.values() for module, _ in verbs.values()}
    hidden = [one for one in commands() if one not in {*known, *PACKAGES, "experiments.sbm"}]
    named = {group: {f"sbm {verb}": what for verb, what in verbs.items()} for group, verbs in VERBS.items()}
    return {**named, DEVELOPERS: {f"python -m {one}": (one, "") for one in hidden}}


def page_of(name: str) -> str:
    """Of a command by its name: the page, from the root of the site."""
    return f"commands/{name.removeprefix('python -m experiments.').removeprefix('sbm ').replace('_', '-')}.md"


def navigation() -> list[dict[str, object] | str]:
    """What stands below "Commands" in the site's navigation."""
    entries: list[dict[str, object] | str] = ["commands/index.md"]
    for group, names in groups().items():
        pages = [{name.removeprefix("python -m experiments."): page_of(name)} for name in names]
        entries.append({group.capitalize(): pages})
    return entries


def help_of(name: str, module: str, arguments: tuple[str, ...] = ()) -> str:
    """What a command says about itself, without colours."""
    said = io.StringIO()
    narrow = patch.dict(os.environ, {"COLUMNS": str(_WIDTH), "NO_COLOR": "1"})
    with narrow, called_as(name), contextlib.redirect_stdout(said), contextlib.suppress(SystemExit):
        importlib.import_module(module).main([*arguments, "--help"])
    return said.getvalue()


def overview_page() -> str:
    """Every command in a row, by group."""
    lines = ["# Commands", ""]
    lines += ["`sbm VERB ...` is `python -m MODULE ...`; both take `--help`, which these pages show.", ""]
    lines += [
        "`source <(sbm completion bash)` completes verbs and options (or `zsh`), `sbm --version` tells the version."
    ]
    for group, names in groups().items():
        lines += ["", f"## {group.capitalize()}", ""]
        if group == DEVELOPERS:
            lines += ["They make what is committed, and have no short name.", ""]
        lines += ["| | |", "|---|---|"]
        for name, (module, what) in names.items():
            shown = what or _first_sentence(help_of(name, module))
            lines.append(f"| [`{name}`]({page_of(name).removeprefix('commands/')}) | {_escaped(shown)} |")
    return "\n".join(lines) + "\n"


def command_page(name: str, module: str) -> str:
    """A command: what it does, options group by group, examples, and its subcommands."""
    text = help_of(name, module)
    long_name = f"python -m {module.removesuffix('.__main__')}"
    lines = [f"# {name}", ""]
    if name != long_name:
        lines += [f"Also `{long_name}`.", ""]
    lines += _sections(text, 2)
    for subcommand in _rows(_parts(text).get("commands", "")):
        lines += [f"## {name} {subcommand}", "", *_sections(help_of(name, module, (subcommand,)), 3)]
    return "\n".join(lines) + "\n"


def _parts(text: str) -> dict[str, str]:
    """Of a help: its groups by title. Usage, paragraphs and hints stand under numbers."""
    parts: dict[str, str] = {}
    for part in re.split(r"\n\s*\n", text.strip("\n")):
        title, _, rest = part.partition("\n")
        if title.endswith(":") and rest.startswith("  "):
            parts[title[:-1]] = rest
        else:
            parts[str(len(parts))] = part
    return parts


def _rows(part: str) -> dict[str, str]:
    """Of a group of a help: options as they are typed, and what they mean."""
    rows: dict[str, list[str]] = {}
    for line in part.splitlines():
        if line.startswith(" " * _COLUMN):
            rows[list(rows)[-1]].append(line.strip())
        elif line.startswith(" " * 6):
            before = list(rows)[-1]
            rows[f"{before} {line.strip()}"] = rows.pop(before)
        elif line[_COLUMN - 2 : _COLUMN] == "  ":
            rows[line[:_COLUMN].strip()] = [line[_COLUMN:].strip()]
        else:
            rows[line.strip()] = []
    return {option: " ".join(words) for option, words in rows.items()}


def _sections(text: str, level: int) -> list[str]:
    lines: list[str] = []
    examples = _parts(text).get("examples", "")
    for title, part in _parts(text).items():
        if examples and not title.isdigit():
            lines += [*_shown(examples, level)]
            examples = ""
        if title == "examples" or "COMMAND --help tells of one" in part:
            continue
        if title.isdigit():
            is_usage = part.startswith("usage:")
            words = " ".join(part.split())
            lines += ["```text", words.removeprefix("usage: "), "```", ""] if is_usage else [_escaped(words), ""]
        else:
            lines += [f"{'#' * level} {_escaped(title[:1].upper() + title[1:])}", ""]
            lines += [line for option, what in _rows(part).items() for line in _defined(option, what)]
    return lines


def _shown(examples: str, level: int) -> list[str]:
    block = "\n".join(line.removeprefix("  ") for line in examples.splitlines())
    return [f"{'#' * level} Examples", "", "```sh", block, "```", ""]


def _defined(option: str, what: str) -> list[str]:
    return [f"`{option}`", f":   {_escaped(what) or '&nbsp;'}", ""]


def _first_sentence(text: str) -> str:
    paragraph = next((part for title, part in _parts(text).items() if title == "1"), "")
    return re.split(r"(?<=[.:])\s", " ".join(paragraph.split()))[0].rstrip(".:")


def _escaped(text: str) -> str:
    """Plain text as Markdown that shows it as it is; options as code."""
    parts = re.split(r"((?<![\w-])--[a-z][\w-]*)", text)
    for number, part in enumerate(parts):
        plain = re.sub(r"([\\`*_\[\]#|])", r"\\\1", part.replace("&", "&amp;").replace("<", "&lt;"))
        parts[number] = f"`{part}`" if number % 2 else plain
    return "".join(parts)


def all_pages() -> Mapping[str, str]:
    """All pages of commands, by where they stand in the site."""
    pages = {
        page_of(name): command_page(name, module) for names in groups().values() for name, (module, _) in names.items()
    }
    return {"commands/index.md": overview_page(), **pages}
