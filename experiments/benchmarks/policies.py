"""Time that policies take to choose an action, beside ``next_best_view``, from the same starts in the same scenes."""

import contextlib
import time
from collections.abc import Iterator

from experiments.benchmarks.rows import Row, log

ENVS = {"rooms": "sbm_gym/Indoor-v0", "streets": "sbm_gym/Outdoor-v0"}
SPLIT, DETECTOR, SEED = "val", "simulated", 0
BASELINE = "next_best_view"
POLICIES = ("ppo", "ring", "frontier")
"""The first is the learnt one, of which the project promises something."""
FASTER = 10.0
"""What it promises: so many times as fast as the planner."""
EPISODES = 10


def measure(quick: bool) -> Iterator[Row]:
    """Measures row by row; times are CPU times of one thread, means over all steps of all episodes.

    Args:
        quick: few episodes.
    """
    for world, env_id in ENVS.items():
        planner = seconds_to_act(BASELINE, env_id, 1 if quick else EPISODES)
        for policy in POLICIES:
            seconds = seconds_to_act(policy, env_id, 1 if quick else EPISODES)
            log(f"{world}, {policy}: {1e3 * seconds:.1f} ms; {BASELINE}: {1e3 * planner:.1f} ms")
            learnt = policy == POLICIES[0]
            target, holds = (f"{FASTER:g}x", planner >= FASTER * seconds) if learnt else ("", None)
            yield Row(f"choosing an action in {world}: {policy}", BASELINE, seconds, planner, target, holds)


def seconds_to_act(name: str, env_id: str, episodes: int) -> float:
    """CPU seconds that a policy takes to choose one action, of the ways that it goes itself."""
    import numpy as np
    import torch

    from agents.policies.registry import make_policy
    from agents.rollouts.run_episode import episode_spec
    from sbm_gym.named_env import make_env

    torch.set_num_threads(1)
    policy, seconds, steps = make_policy(name, env_id), 0.0, 0
    with contextlib.closing(make_env(env_id, SPLIT, DETECTOR, colours=False)) as env:
        scenes = env.get_wrapper_attr("scene_names")
        for number in range(-1, episodes):  # the first compiles and is not counted
            spec = episode_spec(scenes, SEED, max(number, 0))
            observation, info = env.reset(seed=spec.env_seed, options={"scene": spec.scene})
            policy.reset(env, observation, info, np.random.default_rng(spec.policy_seed))
            ended = False
            while not ended:
                started = time.process_time()
                action = policy.act(observation, info)
                if number >= 0:
                    seconds, steps = seconds + time.process_time() - started, steps + 1
                observation, _, terminated, truncated, info = env.step(action)
                ended = terminated or truncated
    return seconds / steps
