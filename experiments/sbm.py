"""All commands by short names: ``sbm VERB ...`` is ``python -m PACKAGE.COMMAND ...``.

``sbm`` alone lists what there is, ``sbm VERB --help`` tells of one, ``sbm completion bash`` completes them in a shell.
"""

import contextlib
import difflib
import io
import re
import sys
from importlib import import_module
from pathlib import Path

from labeling import __version__
from labeling.runtime.cli import BAD_INPUT, called_as

VERBS: dict[str, dict[str, tuple[str, str]]] = {
    "labels": {
        "label": ("labeling.generate", "make pseudo-labels for recordings"),
        "inspect": ("labeling.inspect", "check a label set, or look at it in 3-D"),
        "evaluate": ("labeling.evaluate", "compare labels and detector with ground truth; writes report.html"),
        "convert": ("labeling.convert", "write a recording as an episode, or labels for other tools"),
    },
    "detectors": {
        "detect": ("labeling.detect", "run a detector on episodes"),
        "finetune": ("labeling.finetune", "teach a detector what labels show"),
        "train3d": ("labeling.train3d", "train a frustum PointNet on labels"),
        "detect3d": ("labeling.detect3d", "find 3-D boxes in episodes"),
    },
    "memories": {
        "train-memory": ("labeling.train_memory", "teach a 3-D memory to predict views"),
        "train-flow": ("labeling.train_flow", "teach a 3-D memory to see what moves"),
        "imagine": ("labeling.imagine", "draw what a memory predicts"),
    },
    "agents": {
        "collect": ("agents.collect", "let a policy move through a world, and record"),
        "play": ("agents.play", "move the robot yourself, by the keyboard"),
        "train": ("agents.train", "train a policy with PPO"),
        "compare": ("agents.evaluate", "compare policies from the same starts"),
    },
    "worlds": {
        "preview": ("sbm_gym.preview", "draw scenes"),
        "scenes": ("sbm_gym.scenes.__main__", "compile scenes ahead of time"),
        "assets": ("sbm_gym.assets.__main__", "list, install and credit furniture; clear caches"),
        "photographs": ("sbm_gym.photographs.__main__", "take annotated photographs of a world"),
        "atlas": ("sbm_gym.build_atlas", "look at scenes from everywhere once, to learn on"),
        "fit-simulated": ("sbm_gym.fit_simulated", "fit the simulated detector to a real one"),
    },
    "experiments": {
        "demo": ("experiments.demo", "the whole way in a few minutes"),
        "run": ("experiments.run", "make a table of the thesis, or another experiment"),
        "bench": ("experiments.bench", "measure speed against rivals"),
        "capture": ("experiments.capture", "label a real capture, and score it"),
        "campaign": ("experiments.campaign.__main__", "spoil inputs, kill commands, fill disks"),
        "pages": ("experiments.pages.__main__", "write the pages of results"),
    },
}
"""Commands by group and verb: the module with ``main``, and what it does."""
MODULES = {verb: module for group in VERBS.values() for verb, (module, _) in group.items()}
SHELLS = ("bash", "zsh")


def main(arguments: list[str] | None = None) -> int:
    """Runs a command, or tells which there are; returns the exit code."""
    given = sys.argv[1:] if arguments is None else arguments
    if not given or given[0] in ("-h", "--help", "help"):
        print(overview())
        return 0
    verb, rest = given[0], given[1:]
    if verb == "--version":
        print(f"seeing-by-moving {__version__}")
        return 0
    if verb == "completion":
        return _complete(rest)
    if verb not in MODULES:
        near = difflib.get_close_matches(verb, [*MODULES, "completion"], 1)
        hint = f"; did you mean {near[0]!r}?" if near else ";"
        print(f"error: there is no command {verb!r}{hint} sbm --help lists all", file=sys.stderr)
        return BAD_INPUT
    _find_own_code()
    with called_as(f"sbm {verb}"):
        return import_module(MODULES[verb]).main(rest)


def _find_own_code() -> None:
    """Has Python look in the working directory, too, as by ``python -m``, but last: nothing installed is hidden.

    There lies what ``--policy my_policy:Forward`` and the like name.
    """
    with contextlib.suppress(FileNotFoundError):  # a working directory that is gone
        here = str(Path.cwd())
        if here not in sys.path and "" not in sys.path:
            sys.path.append(here)


def overview() -> str:
    """What there is, group by group."""
    lines = [
        "usage: sbm [-h] [--version] COMMAND ...",
        "",
        "Agents that move to see better, and teach their detectors.",
        "",
    ]
    width = max(map(len, MODULES))
    for group, verbs in VERBS.items():
        lines += [f"{group}:", *(f"  {verb:{width}}  {what}" for verb, (_, what) in verbs.items()), ""]
    lines += [
        "shell:",
        f"  {'completion':{width}}  print completions for {' or '.join(SHELLS)}: source <(sbm completion bash)",
        "",
        "sbm COMMAND --help tells of one. examples:",
        "  sbm label MY_CAPTURE --detector compact --out LABELS    # pseudo-labels of a recording",
        "  sbm inspect LABELS --view                               # look at them in a browser",
        "  sbm collect --policy ppo --out EPISODES                 # record what a trained policy sees",
    ]
    return "\n".join(lines)


def _complete(shells: list[str]) -> int:
    if len(shells) != 1 or shells[0] not in SHELLS:
        print(f"error: give one of {', '.join(SHELLS)}: sbm completion bash", file=sys.stderr)
        return BAD_INPUT
    print(completion(shells[0]))
    return 0


def completion(shell: str) -> str:
    """A script that completes commands and their options.

    Args:
        shell: one of ``SHELLS``.
    """
    cases = "\n".join(f'        {verb}) words="{" ".join(options(verb))}" ;;' for verb in MODULES)
    script = f"""\
_sbm() {{
    local current="${{COMP_WORDS[COMP_CWORD]}}" words=""
    if [ "$COMP_CWORD" -eq 1 ]; then
        COMPREPLY=($(compgen -W "{" ".join([*MODULES, "completion"])} --help --version" -- "$current"))
        return
    fi
    case "${{COMP_WORDS[1]}}" in
        completion) words="{" ".join(SHELLS)}" ;;
{cases}
    esac
    if [[ "$current" == -* || "${{COMP_WORDS[1]}}" == completion ]]; then
        COMPREPLY=($(compgen -W "$words" -- "$current"))
    else
        COMPREPLY=($(compgen -f -- "$current"))
    fi
}}
complete -o filenames -F _sbm sbm"""
    return script if shell == "bash" else f"autoload -U +X bashcompinit && bashcompinit\n{script}"


def options(verb: str) -> list[str]:
    """The options of a command, as its help names them."""
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.suppress(SystemExit):
        import_module(MODULES[verb]).main(["--help"])
    plain = re.sub(r"\x1b\[[0-9;]*m", "", said.getvalue())
    rows = re.findall(r"^[│ ] ((?:-h|--)[^ ,]+(?:, --[^ ,]+)*)", plain, re.MULTILINE)
    return sorted({name for row in rows for name in row.split(", ") if name.startswith("--")})


if __name__ == "__main__":
    sys.exit(main())
