"""Makes a trained policy the one that comes with the project: ``python -m experiments.ship_policy RUN``."""

import hashlib
import re
import shutil
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

from agents.network.files import POLICY_FILE, STATE_FILE
from labeling.core.errors import UsageError
from labeling.runtime.cli import make_main
from labeling.runtime.help import CommandHelp

MAX_MB = 20
MAX_POINTS = 400
SUFFIXES = (".safetensors", ".json")
"""Of the files of a checkpoint that is to be shipped."""
RECORD = "policy_training_{}.json"
"""Name of the record of a training run, by env without namespace."""
ENV_NAME = re.compile(r"[A-Za-z0-9_]+-v\d+")


@dataclass(frozen=True)
class ShipConfig:
    """Copies a checkpoint of RUN to where the policy ``ppo`` is read from, and keeps how it was trained."""

    run: tyro.conf.Positional[Annotated[Path, tyro.conf.arg(metavar="RUN")]]
    """Folder of a run of agents.train."""
    checkpoint: Literal["best", "last"] = "best"
    """The one that did best on validation scenes, or the latest: where training has not helped, the best is the
    untrained network."""
    weights: Path | None = Path("agents/weights")
    """Folder for the policies that come with the project; None ships nothing, and only keeps how it was trained."""
    results: Path = Path("experiments/results")
    """Folder for the record of the training."""
    as_seed: bool = False
    """Beside the policy of the env, not in its place: under the names ppo_seed_N, ppo_evidence_seed_N or
    ppo_unmapped_seed_N, where N is the seed of the training."""
    record: str | None = None
    """Name of the record; by default that of the folder of the weights."""
    remark: str = ""
    """What readers of the record should know of the run; the page of results prints it."""


def run(config: ShipConfig) -> None:
    """Ships a policy.

    Raises:
        SbmError: if there is no checkpoint in the folder, it is damaged or too large, or no policy goes by its weights.
    """
    from agents.planning.promises import UNMAPPED
    from agents.policies.registry import TRAINED
    from experiments.tables.trained_policies import origin_of
    from labeling.formats.atomic import atomic_folder, write_json

    folder = config.run / config.checkpoint
    files = checkpoint_files(config.run, config.checkpoint)
    origin = origin_of(folder)
    name = str(origin.get("env")).rpartition("/")[2]  # names folders
    if not ENV_NAME.fullmatch(name):
        raise UsageError(f"{folder}: was trained on {origin.get('env')!r}, which is no id of an env such as Indoor-v0")
    rewarded_by_evidence = origin.get("reward") == "evidence"
    without_a_map = origin.get("hyperparameters", {}).get("env_wrapper") == UNMAPPED
    if rewarded_by_evidence and without_a_map and config.weights is not None:
        raise UsageError(
            f"{folder}: was trained for evidence and without a map, and no policy goes by weights of both; "
            "ship its record alone (without --weights), or add a name to TRAINED in agents/policies/registry.py"
        )
    if rewarded_by_evidence:
        name += TRAINED["ppo_evidence"]
    if without_a_map:
        name += TRAINED["ppo_unmapped"]
    if config.as_seed:
        name += f"-seed-{origin['seed']}"
    record = {
        **training_record(config.run, origin, files),
        "shipped": config.weights is not None,
        "remark": config.remark,
    }
    if config.weights is not None:
        with atomic_folder(config.weights / name) as temporary:
            for file in files:
                shutil.copyfile(file, temporary / file.name)
        print(config.weights / name)
    path = config.results / RECORD.format(config.record or name)
    write_json(path, record)
    print(path)


def checkpoint_files(run_folder: Path, checkpoint: str) -> list[Path]:
    """The files of a checkpoint of a run.

    Raises:
        SbmError: if there is none, or it is damaged, or it is too large to ship.
    """
    from agents.network.checkpoint import read_policy

    folder = run_folder / checkpoint
    if not (folder / POLICY_FILE).is_file():
        raise UsageError(f"{run_folder}: has no {checkpoint}/{POLICY_FILE}; give the folder of a run of agents.train")
    files = sorted(path for path in folder.iterdir() if path.name != STATE_FILE)
    strange = [file.name for file in files if file.suffix not in SUFFIXES or not file.is_file()]
    if strange:
        raise UsageError(
            f"{folder}: holds {strange[0]}, which is no part of a checkpoint; it holds safetensors and JSON"
        )
    megabytes = sum(file.stat().st_size for file in files) / 1e6
    if megabytes > MAX_MB:
        raise UsageError(
            f"{folder}: has {megabytes:.1f} MB, and at most {MAX_MB} MB are shipped; train a smaller network"
        )
    read_policy(folder)
    return files


def training_record(folder: Path, origin: dict[str, Any], files: Sequence[Path]) -> dict[str, Any]:
    """How a run went and where it comes from.

    Args:
        folder: of the run.
        origin: of the checkpoint.
        files: of this checkpoint.

    Raises:
        SbmError: if the run keeps no history.
    """
    from agents.network.files import HISTORY_FILE, SETTINGS_FILE
    from experiments.tables.trained_policies import training_command
    from labeling.formats.checked_json import read_json
    from labeling.runtime.provenance import experiment_provenance

    settings, history = read_json(folder / SETTINGS_FILE).mapping(), read_json(folder / HISTORY_FILE).mapping()
    rollouts, validations = history["rollouts"], history["validations"]
    if not validations:
        raise UsageError(f"{folder / HISTORY_FILE}: has no validation; train on with --resume {folder}")
    return {
        "env": settings["env"],
        "command": training_command(settings),
        "settings": dict(settings),
        "best": max(validations, key=lambda one: one["return"]),
        "validations": [_short(one) for one in validations],
        "rollouts": [_short(one) for one in thinned(rollouts, MAX_POINTS)],
        "rollouts_in_all": len(rollouts),
        "references": {name: _short(figures) for name, figures in history.get("baselines", {}).items()},
        "checkpoint": {
            **{name: value for name, value in origin.items() if name not in ("command", "hyperparameters")},
            "sha256": {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in files},
            "bytes": sum(file.stat().st_size for file in files),
        },
        "unseen": unseen_returns(folder),
        "shipped_with": experiment_provenance(),
    }


def unseen_returns(folder: Path) -> dict[str, Any] | None:
    """Returns from the unseen starts that a run ends with; None of a run that was not compared.

    Args:
        folder: of the run.

    Returns:
        How many starts and scenes; and by policy its mean return, and by how much the trained one is above it, with an
        interval. The run's own checkpoints go by their names.

    Raises:
        SbmError: if the file is damaged.
    """
    from agents.evaluation.run import RESULT_FILE
    from agents.network.files import UNSEEN_FOLDER
    from labeling.formats.checked_json import read_json

    path = folder / UNSEEN_FOLDER / RESULT_FILE
    if not path.is_file():
        return None
    content = read_json(path).mapping()
    trained, settings = content["compared_with"], content["settings"]
    policies = {}
    for name, found in content["policies"].items():
        kind, _, checkpoint = name.partition(":")
        above = content["pairs"].get(f"{name} minus {trained}", {}).get("return")
        policies[Path(checkpoint).name if kind == "ppo" else name] = {
            "return": round(found["figures"]["return"]["mean"], 4),
            "above": above and {**above, **_turned_round(above)},
        }
    return {"starts": settings["episodes"], "scenes": len(settings["scenes"]), "policies": policies}


def _turned_round(difference: Mapping[str, Any]) -> dict[str, float | None]:
    """A difference and its interval, None where starts are few, of the other minus this one."""
    negative = {name: None if difference[name] is None else -difference[name] for name in ("mean", "low", "high")}
    return {"mean": negative["mean"], "low": negative["high"], "high": negative["low"]}


def thinned(points: Sequence[Any], count: int) -> list[Any]:
    """At most so many points, evenly spread, with the first and the last."""
    if len(points) <= count:
        return list(points)
    return [points[round(place * (len(points) - 1) / (count - 1))] for place in range(count)]


def _short(figures: dict[str, float]) -> dict[str, float]:
    return {name: round(value, 4) for name, value in figures.items()}


HELP = CommandHelp(
    examples=(("RUN", "make a run of agents.train the policy ppo"),),
)
main = make_main("experiments.ship_policy", ShipConfig, run, resumes=False, about=HELP)

if __name__ == "__main__":
    sys.exit(main())
