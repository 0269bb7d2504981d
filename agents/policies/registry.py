"""Policies by name."""

from collections.abc import Callable
from pathlib import Path

from agents.policies.base import Policy
from labeling.core.errors import UsageError

WEIGHTS = Path(__file__).resolve().parents[1] / "weights"
"""Trained policies that come with the project: a folder for each env, such as ``Indoor-v0``."""
TRAINED = "ppo"
"""The trained policy of an env, or, with a colon and a path, any other one."""


def _frontier() -> Policy:
    from agents.policies.frontier import FrontierWalk

    return FrontierWalk()


def _next_best_view(goal: str = "both") -> Policy:
    from agents.policies.next_best_view import NextBestView

    return NextBestView(goal)


def _random() -> Policy:
    from agents.policies.random_walk import RandomWalk

    return RandomWalk()


def _ring() -> Policy:
    from agents.policies.ring import Ring

    return Ring()


def _spin() -> Policy:
    from agents.policies.spin import Spin

    return Spin()


_MAKERS: dict[str, Callable[[], Policy]] = {
    "frontier": _frontier,
    "next_best_view": _next_best_view,
    "random": _random,
    "ring": _ring,
    "spin": _spin,
}
BUILTIN = "Builtin"
GREEDY = "next_best_view"
"""Goes by this name alone, or with a colon and what it values."""
POLICIES = tuple(_MAKERS)
"""The hand-written ones."""


def make_policy(name: str, env_id: str | None = None) -> Policy:
    """The policy of that name.

    Args:
        name: one of ``POLICIES``, "next_best_view:GOAL" (goals: agents.policies.next_best_view), "ppo" (the trained
            policy that comes with the project), or "ppo:CHECKPOINT".
        env_id: for which environment; "ppo" alone needs it.

    Raises:
        UsageError: if there is none, naming those there are, or its checkpoint is missing or does not fit.
    """
    if name in _MAKERS:
        return _MAKERS[name]()
    if name.startswith(f"{GREEDY}:"):
        return _next_best_view(name.partition(":")[2])
    checkpoint = checkpoint_of(name, env_id)
    if checkpoint is None:
        raise UsageError(f"unknown policy {name!r}; known: {', '.join(POLICIES)}, ppo, ppo:CHECKPOINT")
    from agents.policies.ppo import Ppo

    return Ppo(checkpoint)


def checkpoint_of(name: str, env_id: str | None = None) -> Path | None:
    """Where a trained policy is read from; None if the policy is not a trained one.

    Raises:
        UsageError: if it is one, and there is nothing there.
    """
    kind, colon, place = name.partition(":")
    if kind != TRAINED:
        return None
    if colon:
        if not place or not Path(place).exists():
            raise UsageError(f"policy {name!r}: no such checkpoint; give ppo:RUN, where RUN is what agents.train wrote")
        return Path(place)
    if env_id is None:
        raise UsageError("policy 'ppo' is a trained one for each env, and no env is given; give ppo:CHECKPOINT")
    name_of_env = env_id.rpartition("/")[2]
    # Builtin furniture makes no difference to a robot's observations and actions.
    places = [WEIGHTS / name_of_env, WEIGHTS / name_of_env.replace(BUILTIN, "")]
    folder = next((place for place in places if place.is_dir()), None)
    if folder is None:
        shipped = sorted(path.name for path in WEIGHTS.glob("*") if path.is_dir())
        raise UsageError(
            f"policy 'ppo': no trained policy comes with the project for {env_id!r} (there is one for: "
            f"{', '.join(shipped) or 'none'}); train one with python -m agents.train and give ppo:CHECKPOINT"
        )
    return folder
