"""A warm start: the network first learns to do what a hand-written policy does, and what that is worth."""

from collections.abc import Iterable
from dataclasses import dataclass

import gymnasium as gym
import numpy as np
import torch
from jaxtyping import Float32, Float64
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecNormalize

from agents.policies.base import Policy

EPOCHS = 20
BATCH = 50
LEARNING_RATE = 1e-3
VALUE_SHARE = 0.1
"""What the value's error counts beside that of the actions."""


@dataclass(frozen=True)
class Demonstrations:
    """Steps of whole episodes, one after the other."""

    observations: dict[str, np.ndarray]
    """By name, each n and the shape of its space: what was seen before each step."""
    actions: Float32[np.ndarray, "n actions"]
    rewards: list[Float64[np.ndarray, "steps"]]
    """Of every episode."""


def demonstrate(env: gym.Env, policy: Policy, numbers: Iterable[int], seed: int) -> Demonstrations:
    """Has a policy show what it does.

    Args:
        env: the environment.
        policy: who shows it.
        numbers: of the episodes; an iterable, so that it may draw a progress bar.
        seed: decides the episodes.
    """
    seen: list[dict[str, np.ndarray]] = []
    actions, rewards = [], []
    for number in numbers:
        env_seed, policy_seed = (int(word) for word in np.random.SeedSequence([seed, number]).generate_state(2))
        observation, info = env.reset(seed=env_seed)
        policy.reset(env, observation, info, np.random.default_rng(policy_seed))
        earned, ended = [], False
        while not ended:
            seen.append(observation)
            actions.append(np.clip(policy.act(observation, info), -1.0, 1.0))
            observation, reward, terminated, truncated, info = env.step(actions[-1])
            earned.append(float(reward))
            ended = terminated or truncated
        rewards.append(np.array(earned))
    return Demonstrations(
        {name: np.stack([one[name] for one in seen]) for name in seen[0]}, np.array(actions, np.float32), rewards
    )


def imitate(model: PPO, env: VecNormalize, shown: Demonstrations, seed: int) -> float:
    """Fits the policy to the actions that were shown, and the value to what came of them.

    The spread of actions stays as it is: exploring is PPO's business.

    Args:
        model: changed; its optimizer is not.
        env: takes over how rewards are to be scaled.
        shown: what to learn from.
        seed: decides the order.

    Returns:
        Root mean square of what differs, in the last pass, between an action shown and the most likely one.
    """
    env.ret_rms.update(np.concatenate([running_sums(rewards, env.gamma) for rewards in shown.rewards]))
    to_come = [running_sums(env.normalize_reward(rewards)[::-1], env.gamma)[::-1] for rewards in shown.rewards]
    values = torch.as_tensor(np.concatenate(to_come), dtype=torch.float32, device=model.device)
    actions = torch.as_tensor(shown.actions, device=model.device)
    policy, rng = model.policy, np.random.default_rng(seed)
    policy.set_training_mode(True)
    optimizer = torch.optim.Adam([one for name, one in policy.named_parameters() if name != "log_std"], LEARNING_RATE)
    square = 0.0
    for _ in range(EPOCHS):
        square = 0.0
        for chosen in np.array_split(rng.permutation(len(actions)), max(1, len(actions) // BATCH)):
            observations, _ = policy.obs_to_tensor({name: part[chosen] for name, part in shown.observations.items()})
            mean = policy.get_distribution(observations).distribution.mean
            off = torch.nn.functional.mse_loss(mean, actions[chosen])
            expected = policy.predict_values(observations).flatten()
            loss = off + VALUE_SHARE * torch.nn.functional.mse_loss(expected, values[chosen])
            optimizer.zero_grad()
            loss.backward()
            torch.nn.utils.clip_grad_norm_(policy.parameters(), model.max_grad_norm)
            optimizer.step()
            square += float(off.detach()) * len(chosen) / len(actions)
    return float(np.sqrt(square))


def running_sums(rewards: np.ndarray, gamma: float) -> Float64[np.ndarray, "steps"]:
    """Each reward plus all before it, discounted once more for every step that lies between."""
    sums, so_far = np.zeros(len(rewards)), 0.0
    for step, reward in enumerate(rewards):
        so_far = gamma * so_far + float(reward)
        sums[step] = so_far
    return sums
