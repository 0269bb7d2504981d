"""One episode of one policy as JSON: where it starts, what the policy did, what it saw."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import gymnasium as gym
import numpy as np

from agents.policies.base import Policy
from agents.rollouts.environments import inner_env
from agents.rollouts.rollout import rollout
from sbm_gym.env.recording import Capture

DIGITS = 4
"""Metres and radians in results are rounded to so many."""


@dataclass(frozen=True)
class EpisodeSpec:
    """All that decides an episode but the policy: the same for all policies."""

    seed: int
    episode: int
    scene: str
    env_seed: int
    """Decides start, heading, what the scene shows in this episode, and the detector's noise."""
    policy_seed: int
    """Of the policy's own generator."""
    draw: int = 0
    """The how many-eth time that a policy which draws at random plays it."""


def episode_spec(scenes: Sequence[str], seed: int, episode: int) -> EpisodeSpec:
    """Where an episode starts: scenes in turn, in an order that the seed draws.

    Args:
        scenes: names of the scenes of the split.
        seed: of the evaluation.
        episode: number of the episode; the start depends on seed and number only.
    """
    order = np.random.default_rng([seed, 2]).permutation(len(scenes))
    env_seed, policy_seed = np.random.SeedSequence([seed, 3, episode]).generate_state(2)
    return EpisodeSpec(seed, episode, scenes[int(order[episode % len(scenes)])], int(env_seed), int(policy_seed))


def another_draw(spec: EpisodeSpec, draw: int) -> EpisodeSpec:
    """The same start, for a policy that draws otherwise."""
    state = np.random.SeedSequence([spec.seed, 3, spec.episode, draw]).generate_state(1)
    return replace(spec, policy_seed=int(state[0]), draw=draw) if draw else spec


def run_episode(
    env: gym.Env, policy: Policy, spec: EpisodeSpec, size_px: tuple[int, int] | None
) -> tuple[dict[str, Any], list[Capture]]:
    """Has a policy act through one episode.

    An episode in which nothing is found counts like any other: policies are measured by what they bring home from a
    start, not by what they bring home when they are lucky.

    Args:
        env: the environment.
        policy: who acts.
        spec: where it starts.
        size_px: height and width of the full frames to take after every step; None takes none.

    Returns:
        The record of the episode, ready for JSON, and the frames.
    """
    observation, info = env.reset(seed=spec.env_seed, options={"scene": spec.scene})
    start, steps, captures = _pose(info), [], []
    rng = np.random.default_rng(spec.policy_seed)
    undrawn = rng.bit_generator.state
    for step in rollout(env, policy, observation, info, rng):
        info = step.info
        steps.append(
            {
                **_pose(info),
                "reward": step.reward,
                "terms": {name: float(value) for name, value in info["reward_terms"].items()},
                "collided": bool(info["collided"]),
                "target": info["fixation_target"].get("object_id"),
                "objects": len(info["confirmed_objects"]),
                "sectors": sum(len(known["azimuths"]) for known in info["confirmed_objects"]),
            }
        )
        if size_px is not None:
            captures.append(inner_env(env).capture(*size_px))
    record = {
        "seed": spec.seed,
        "episode": spec.episode,
        "scene": spec.scene,
        "env_seed": spec.env_seed,
        "draw": spec.draw,
        "is_random": rng.bit_generator.state != undrawn,
        "start": start,
        "figures": _figures(steps, info),
        "objects": [
            {
                "category": known["category"],
                "confidence": float(known["best_confidence"]),
                "centroid_m": _rounded(known["centroid_m"]),
                "extent_m": _rounded(known["extent_m"]),
                "sectors": [int(sector) for sector in known["azimuths"]],
            }
            for known in info["confirmed_objects"]
        ],
        "num_sectors": inner_env(env).knowledge.view_bins.num_azimuths,
        "steps": steps,
    }
    return record, captures


def _figures(steps: list[dict[str, Any]], info: dict[str, Any]) -> dict[str, float]:
    """Figures of an episode, by name."""
    known = info["confirmed_objects"]
    terms = {name: sum(step["terms"][name] for step in steps) for name in steps[-1]["terms"]}
    return {
        "return": sum(step["reward"] for step in steps),
        **terms,
        "success": float(bool(known)),
        "objects": float(len(known)),
        "target_sectors": float(len(info["fixation_target"].get("azimuths", ()))),
        "best_sectors": float(max((len(one["azimuths"]) for one in known), default=0)),
        "coverage": float(info["coverage"]),
        "sectors": float(sum(len(one["azimuths"]) for one in known)),
        "collisions": float(sum(step["collided"] for step in steps)),
        "path_m": float(info["path_length_m"]),
    }


def _pose(info: dict[str, Any]) -> dict[str, Any]:
    agent = info["agent"]
    return {"position_m": _rounded(agent["position_m"]), "yaw_rad": round(float(agent["yaw_rad"]), DIGITS)}


def _rounded(values: np.ndarray) -> list[float]:
    return [round(float(value), DIGITS) for value in values]
