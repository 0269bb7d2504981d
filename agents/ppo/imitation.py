"""A warm start: the network first learns to do what a hand-written policy does, and what that is worth.

In the first round the teacher acts. In the others the network does, and the teacher says what it would have done
there, so that the network learns its way back from where its own mistakes lead (DAgger: Ross, Gordon and Bagnell 2011,
"A reduction of imitation learning and structured prediction to no-regret online learning").
"""

from collections.abc import Sequence
from dataclasses import dataclass

import gymnasium as gym
import numpy as np
import torch
from gymnasium import spaces
from jaxtyping import Float32, Float64
from stable_baselines3 import PPO
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.vec_env import VecNormalize

from agents.policies.base import Policy

ROUNDS = 4
EPOCHS = 20
BATCH = 50
LEARNING_RATE = 1e-3
VALUE_SHARE = 0.1
"""What the value's error counts beside that of the actions."""


@dataclass(frozen=True)
class Demonstration:
    """Steps of whole episodes, one after the other."""

    observations: dict[str, np.ndarray]
    """By name, each n and the shape of its space: what was seen before each step. Only what the network looks at."""
    actions: Float32[np.ndarray, "n actions"]
    """What the teacher did, or would have done."""
    rewards: list[Float64[np.ndarray, "steps"]]
    """Of every episode."""


def demonstrate(
    env: gym.Env, teacher: Policy, number: int, seed: int, keys: Sequence[str], student: ActorCriticPolicy | None = None
) -> Demonstration:
    """Has a teacher show what it does, or would do in the student's place, through one episode.

    Args:
        env: the environment.
        teacher: who shows it.
        number: of the episode.
        seed: decides the episodes.
        keys: the observations to keep.
        student: acts, if given.
    """
    env_seed, policy_seed = (int(word) for word in np.random.SeedSequence([seed, number]).generate_state(2))
    observation, info = env.reset(seed=env_seed)
    teacher.reset(env, observation, info, np.random.default_rng(policy_seed))
    seen: list[dict[str, np.ndarray]] = []
    actions, earned, ended = [], [], False
    while not ended:
        seen.append({name: observation[name] for name in keys})
        actions.append(np.clip(teacher.act(observation, info), -1.0, 1.0))
        taken = actions[-1] if student is None else student.predict(observation, deterministic=True)[0]
        observation, reward, terminated, truncated, info = env.step(taken)
        earned.append(float(reward))
        ended = terminated or truncated
    observations = {name: np.stack([one[name] for one in seen]) for name in keys}
    return Demonstration(observations, np.array(actions, np.float32), [np.array(earned)])


def joined(parts: Sequence[Demonstration]) -> Demonstration:
    """Several demonstrations as one."""
    names = parts[0].observations
    return Demonstration(
        {name: np.concatenate([part.observations[name] for part in parts]) for name in names},
        np.concatenate([part.actions for part in parts]),
        [rewards for part in parts for rewards in part.rewards],
    )


def imitate(model: PPO, env: VecNormalize, shown: Demonstration, seed: int) -> float:
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
            observations, _ = policy.obs_to_tensor(_complete(shown.observations, chosen, policy.observation_space))
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


def _complete(parts: dict[str, np.ndarray], chosen: np.ndarray, space: spaces.Space) -> dict[str, np.ndarray]:
    """Some of the observations, with black pictures for those that were not kept."""
    assert isinstance(space, spaces.Dict)
    return {
        name: parts[name][chosen] if name in parts else np.zeros((len(chosen), *(part.shape or ())), part.dtype)
        for name, part in space.spaces.items()
    }


def running_sums(rewards: np.ndarray, gamma: float) -> Float64[np.ndarray, "steps"]:
    """Each reward plus all before it, discounted once more for every step that lies between."""
    sums, so_far = np.zeros(len(rewards)), 0.0
    for step, reward in enumerate(rewards):
        so_far = gamma * so_far + float(reward)
        sums[step] = so_far
    return sums
