"""Help of a command: what it does, its options in groups, and examples."""

import argparse
import os
import re
import shutil
import sys
import textwrap
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

HELP_FLAGS = ("-h", "--help")
MAX_WIDTH = 100
_COLUMN = 24
"""Where explanations begin, in letters from the left."""
_DEFAULT = re.compile(r"\s*\(default: (.*)\)$", re.DOTALL)


@dataclass(frozen=True)
class CommandHelp:
    """What the help of a command says beside its options.

    Example:
        >>> CommandHelp({"common": ("dataset", "out")}, (("EPISODES --out LABELS", "label all episodes"),)).groups
        {'common': ('dataset', 'out')}
    """

    groups: Mapping[str, Sequence[str]] = field(default_factory=dict)
    """Title of a group -> names of its options, without the dashes before them, both in the order to be shown in.
    Options named in none stand with the others of their dataclass, after those."""
    examples: Sequence[tuple[str, str]] = ()
    """What may be typed after the command's name, and what that does."""


NOTHING = CommandHelp()
"""No groups and no examples."""


def asks_for_help(arguments: Sequence[str]) -> bool:
    """Whether a command line asks for help."""
    return any(flag in arguments for flag in HELP_FLAGS)


def help_text(
    config_type: Any,
    prog: str,
    about: CommandHelp,
    arguments: Sequence[str] = (),
    description: str | None = None,
    given: Mapping[str, Any] | None = None,
) -> str:
    """The help of a command or, where the command line names one, of its subcommand.

    Args:
        config_type: as ``labeling.runtime.cli.run_command`` takes it, like all that follows.
        prog: how the command is called.
        about: groups of options, and examples.
        arguments: the command line, which may name a subcommand.
        description: what the command does; by default the docstring of ``config_type``.
        given: ``{"default": config}`` where defaults are not those of ``config_type``.

    Raises:
        KeyError: if ``about`` groups an option that the command does not have.
    """
    parser = _parser(config_type, prog, description, dict(given or {}))
    examples = about.examples
    if (subcommands := _subcommands(parser)) and (chosen := [one for one in arguments if one in subcommands][:1]):
        parser = subcommands[chosen[0]]
        examples = [example for example in examples if example[0].split()[:1] == chosen]
        name, subcommands = f"{prog} {chosen[0]}", {}
    else:
        name = prog
    # What other modules call it, help calls as it is typed.
    flags = {flag[2:].replace("-", "_"): flag for one in parser._actions for flag in one.option_strings}
    width = min(shutil.get_terminal_size().columns, MAX_WIDTH)
    parts = [_usage(parser, name, bool(subcommands), width)]
    for paragraph in re.split(r"\n\s*\n", (parser.description or "").strip()):
        parts.append(textwrap.fill(_plain(paragraph, flags), width))
    if subcommands:
        rows = [(one, _plain(sub.description or "", flags)) for one, sub in subcommands.items()]
        parts.append("\n".join([_title("commands"), *(_row(*row, width) for row in rows)]))
    for title, actions in _grouped(parser, about.groups if name == prog else {}):
        rows = [(_invocation(action), _explanation(action, flags)) for action in actions]
        parts.append("\n".join([_title(title), *(_row(*row, width) for row in rows)]))
    if subcommands:
        parts.append(f"{prog} COMMAND --help tells of one.")
    if examples:
        shown = [f"  # {what}\n  {prog} {line}".rstrip() for line, what in examples]
        parts.append("\n".join([_title("examples"), *shown]))
    return "\n\n".join(parts)


def _parser(config_type: Any, prog: str, description: str | None, given: dict[str, Any]) -> argparse.ArgumentParser:
    """The command's options as argparse knows them, which is the only list of them that tyro gives to others."""
    import tyro

    with warnings.catch_warnings():
        # pyproject.toml keeps to the releases of tyro that have it.
        warnings.filterwarnings("ignore", "get_parser", DeprecationWarning)
        parser: Any = tyro.extras.get_parser(config_type, prog=prog, description=description, **given)
    return parser


def _subcommands(parser: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    """Subcommands by name; empty for a command without."""
    return {name: sub for one in parser._actions if isinstance(one.choices, dict) for name, sub in one.choices.items()}


def _usage(parser: argparse.ArgumentParser, name: str, has_subcommands: bool, width: int) -> str:
    # Lists of which tyro asks one at least are no requirement to argparse; their explanation says it.
    needed = [_invocation(one) for one in parser._actions if str(one.help).endswith("(required)")]
    # What stands without a name comes first.
    needed.sort(key=lambda text: text.startswith("-"))
    rest = "COMMAND ..." if has_subcommands else "[OPTIONS]"
    text = " ".join(["usage:", name, "[-h]", *needed, rest])
    return textwrap.fill(text, width, subsequent_indent="  ", break_on_hyphens=False, break_long_words=False)


def _grouped(
    parser: argparse.ArgumentParser, groups: Mapping[str, Sequence[str]]
) -> Iterator[tuple[str, list[argparse.Action]]]:
    """Titles and their options: the groups given, then what is left, dataclass by dataclass."""
    of_class = {_class_title(group): _listed(group) for group in parser._action_groups}
    by_name = {_name(action): action for actions in of_class.values() for action in actions}
    for title, names in groups.items():
        yield title, [by_name[name] for name in names]
    taken = {name for names in groups.values() for name in names}
    left = {title: [one for one in actions if _name(one) not in taken] for title, actions in of_class.items()}
    positional = left.pop("positional arguments")
    left["options"] = positional + left["options"]
    yield from ((title, actions) for title, actions in left.items() if actions)


def _listed(group: Any) -> list[argparse.Action]:
    """Options of a group of argparse, without what has lines of its own in the help: subcommands, and ``--help``."""
    return [one for one in group._group_actions if not isinstance(one.choices, dict) and one.dest != "help"]


def _class_title(group: Any) -> str:
    """Of a group of argparse: the description of the dataclass as far as its first full stop, or what argparse says."""
    first = re.split(r"[.;]( |$)", " ".join(_plain(group.description or "", {}).split()))[0]
    return first[:1].lower() + first[1:] or group.title


def _name(action: argparse.Action) -> str:
    return action.option_strings[0].lstrip("-") if action.option_strings else action.dest


def _invocation(action: argparse.Action) -> str:
    """The option as it is typed: its names, and what stands for its value."""
    if not action.option_strings:
        return str(action.metavar)
    names = ", ".join(action.option_strings)
    return f"{names} {_metavar(action)}" if action.metavar else names


def _metavar(action: argparse.Action) -> str:
    """What stands for a value, without the ``{None}|`` of options that may be left out, or None among choices."""
    words = str(action.metavar).replace("{None,", "{")
    while "{None}|" in words or "|{None}" in words:
        words = words.replace("{None}|", "").replace("|{None}", "")
    # {FLOAT FLOAT} groups words that stood beside None; {a,b} are choices.
    return words[1:-1] if re.fullmatch(r"\{[^{},]*\}", words) else words


def _explanation(action: argparse.Action, flags: Mapping[str, str]) -> str:
    text = (action.help if isinstance(action.help, str) else "").replace("%%", "%")
    default = _DEFAULT.search(text)
    if default is not None:
        value = default.group(1)
        if action.nargs == 0:
            value = {"True": "on", "False": "off"}.get(value, value)
        text = text[: default.start()] + ("" if value in ("None", "") else f" (default: {value})")
    return _plain(text, flags)


def _plain(text: str, flags: Mapping[str, str]) -> str:
    """Without the marks of reStructuredText; settings that it names become options."""

    def named(found: re.Match[str]) -> str:
        return flags.get(found.group(1), found.group(1))

    return " ".join(re.sub(r"``(.*?)``", named, text, flags=re.DOTALL).split())


def _row(invocation: str, explanation: str, width: int) -> str:
    """An option and its explanation beside it, or below it where the option is long."""
    indent = " " * _COLUMN
    wrapped = textwrap.fill(explanation, width, initial_indent=indent, subsequent_indent=indent, break_on_hyphens=False)
    head = textwrap.fill(
        invocation,
        width,
        initial_indent="  ",
        subsequent_indent="      ",
        break_on_hyphens=False,
        break_long_words=False,
    )
    if not wrapped:
        return head
    return f"{head:{_COLUMN}}{wrapped[_COLUMN:]}" if len(head) < _COLUMN - 1 else f"{head}\n{wrapped}"


def _title(title: str) -> str:
    bold = sys.stdout.isatty() and "NO_COLOR" not in os.environ
    return f"\x1b[1m{title}:\x1b[0m" if bold else f"{title}:"
