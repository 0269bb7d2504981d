"""Policies by name."""

from agents.policies.base import Policy
from labeling.errors import UsageError

POLICIES = ("random", "ring")


def make_policy(name: str) -> Policy:
    """The policy of that name.

    Raises:
        UsageError: if there is none, naming those there are.
    """
    if name == "random":
        from agents.policies.random_walk import RandomWalk

        return RandomWalk()
    if name == "ring":
        from agents.policies.ring import Ring

        return Ring()
    raise UsageError(f"unknown policy {name!r}; known: {', '.join(POLICIES)}")
