"""Results of episodes on disk: one JSON file for each policy, seed, episode and draw."""

import json
from pathlib import Path
from typing import Any

from agents.policies.registry import policy_digest
from agents.rollouts.run_episode import EpisodeSpec
from labeling.core.errors import UsageError
from labeling.formats.atomic import write_json
from labeling.formats.regular_file import regular

SETTINGS_FILE, EPISODES_FOLDER = "settings.json", "episodes"
DECISIVE_SETTINGS = ("env", "split", "scenes", "detector", "reward", "labels", "size")
"""Settings that decide what an episode's result is."""
EARLIER_DEFAULTS = {"views": [5, 10, 15, 20, 25], "scenes": None, "reward": "views"}
"""Settings of folders that are older than these settings."""


def policy_key(policy: str, env_id: str) -> str:
    """What a policy's results are kept under: its name, and for a trained one what its checkpoint holds.

    Raises:
        UsageError: if its checkpoint is missing.
    """
    digest = policy_digest(policy, env_id)
    return f"ppo-{digest[:12]}" if digest else policy.replace(":", "-")


def result_path(out: Path, key: str, spec: EpisodeSpec) -> Path:
    """Where the result of an episode lies."""
    draw = f"-draw{spec.draw}" if spec.draw else ""
    return out / EPISODES_FOLDER / key / f"seed{spec.seed}-{spec.episode:04d}{draw}.json"


def copy_results(source: Path, out: Path) -> None:
    """Copies results of episodes that were run for their labels: the returns are the same with labels and without.

    Args:
        source: folder of an evaluation with labels, of the same env, split and detector.
        out: folder of one without; what it has already stays.
    """
    for path in sorted((source / EPISODES_FOLDER).rglob("*.json")):
        target = out / path.relative_to(source)
        if not target.is_file():
            target.parent.mkdir(parents=True, exist_ok=True)
            write_json(target, {name: value for name, value in read_result(path).items() if name != "label_quality"})


def read_result(path: Path) -> dict[str, Any]:
    """What such a file holds.

    Raises:
        UsageError: if it is damaged.
    """
    try:
        content = json.loads(regular(path).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise UsageError(f"{path}: cannot be read ({error}); delete it to have it made again") from None
    parts = {"scene": str, "figures": dict, "steps": list}
    if not isinstance(content, dict) or not all(isinstance(content.get(name), kind) for name, kind in parts.items()):
        raise UsageError(f"{path}: is not a result; delete it to have it made again")
    return content
