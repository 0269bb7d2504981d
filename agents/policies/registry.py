"""Policies by name."""

import hashlib
import importlib
import re
from inspect import signature
from pathlib import Path

from agents.policies.base import Policy
from labeling.core.errors import UsageError

POLICIES = {
    "frontier": "agents.policies.frontier:FrontierPolicy",
    "next_best_view": "agents.policies.next_best_view:NextBestView",
    "random": "agents.policies.random_walk:RandomWalk",
    "ring": "agents.policies.ring:Ring",
    "spin": "agents.policies.spin:Spin",
}
"""The hand-written ones: name -> module and class. A policy that is added here is known to all commands."""
WEIGHTS = Path(__file__).resolve().parents[1] / "weights"
"""Trained policies that come with the project: a folder for each env, such as ``Indoor-v0``."""
TRAINED = {"ppo": "", "ppo_evidence": "-evidence", "ppo_unmapped": "-unmapped"}
"""Names of these: the one trained for the reward of the thesis, the one trained for ``reward="evidence"``, and the one
that is given no map; and how their folders' names end. Each also goes by NAME_seed_N, in folders that end in
``-seed-N``: the same training from another seed, to show how much trainings differ."""
SEED = re.compile(r"(.*)_seed_(\d+)")


def make_policy(name: str, env_id: str | None = None) -> Policy:
    """The policy of that name.

    Args:
        name: one of ``POLICIES``, "next_best_view:GOAL" (goals: agents.policies.next_best_view), one of ``TRAINED``
            (which come with the project), "ppo:CHECKPOINT", or "package.module:Class" for one of your own.
        env_id: for which environment; trained policies without a checkpoint need it.

    Raises:
        UsageError: if there is none, naming those there are, or its checkpoint is missing or does not fit.

    Example:
        >>> type(make_policy("next_best_view")).__name__
        'NextBestView'
    """
    kind, colon, argument = name.partition(":")
    if kind == "next_best_view" and colon:
        from agents.policies.next_best_view import NextBestView

        return NextBestView(argument)
    checkpoint = checkpoint_of(name, env_id)
    if checkpoint is not None:
        from agents.policies.ppo import Ppo

        return Ppo(checkpoint)
    if (not colon and name not in POLICIES) or (kind in POLICIES and colon):
        raise UsageError(
            f"unknown policy {name!r}; known: {', '.join((*POLICIES, *TRAINED))}, ppo:CHECKPOINT, package.module:Class"
        )
    policy = _policy_class(POLICIES.get(name, name))
    try:
        signature(policy).bind()
    except TypeError as error:
        raise UsageError(f"policy {name!r}: must be made without arguments ({error}); give them defaults") from None
    return policy()


def _policy_class(entry_point: str) -> type[Policy]:
    """The class that ``module:Class`` names.

    Raises:
        UsageError: if there is none.
    """
    module, _, name = entry_point.partition(":")
    try:
        found = getattr(importlib.import_module(module), name)
    except (ImportError, ValueError, TypeError, AttributeError) as error:
        raise UsageError(f"policy {entry_point!r}: cannot be imported ({error})") from None
    if not isinstance(found, type) or not all(hasattr(found, method) for method in ("reset", "act")):
        raise UsageError(f"policy {entry_point!r}: must be a class with reset and act, as agents.policies.base.Policy")
    return found


def checkpoint_of(name: str, env_id: str | None = None) -> Path | None:
    """Where a trained policy is read from; None if the policy is not a trained one.

    Raises:
        UsageError: if it is one, and there is nothing there.
    """
    kind, colon, path = name.partition(":")
    seed = SEED.fullmatch(kind)
    trained = seed.group(1) if seed else kind
    if trained not in TRAINED or (colon and kind != "ppo"):
        return None
    if colon:
        if not path or not Path(path).exists():
            raise UsageError(f"policy {name!r}: no such checkpoint; give ppo:RUN, where RUN is what agents.train wrote")
        return Path(path)
    if env_id is None:
        raise UsageError(f"policy {kind!r} is a trained one for each env, and no env is given; give ppo:CHECKPOINT")
    env_name = env_id.rpartition("/")[2]
    suffix = TRAINED[trained] + (f"-seed-{seed.group(2)}" if seed else "")
    # Builtin furniture makes no difference to a robot's observations and actions.
    folders = [WEIGHTS / (name + suffix) for name in (env_name, env_name.replace("Builtin", ""))]
    folder = next((folder for folder in folders if folder.is_dir()), None)
    if folder is None:
        shipped = sorted(path.name for path in WEIGHTS.glob("*") if path.is_dir())
        raise UsageError(
            f"policy {kind!r}: no trained policy comes with the project for {env_id!r} (there is one for: "
            f"{', '.join(shipped) or 'none'}); train one with python -m agents.train and give ppo:CHECKPOINT"
        )
    return folder


def policy_digest(name: str, env_id: str | None = None) -> str:
    """Changes with what the checkpoint of a trained policy holds; empty if the policy is not a trained one.

    Raises:
        UsageError: if its checkpoint is missing.
    """
    checkpoint = checkpoint_of(name, env_id)
    if checkpoint is None:
        return ""
    from agents.network.checkpoint import checkpoint_folder

    found = hashlib.sha256()
    for file in sorted(path for path in checkpoint_folder(checkpoint).iterdir() if path.is_file()):
        found.update(file.name.encode() + b"\0" + hashlib.sha256(file.read_bytes()).digest())
    return found.hexdigest()
