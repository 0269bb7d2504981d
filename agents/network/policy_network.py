"""The policy's network, made from plain values: names of classes stand in tables, so that nothing need be pickled."""

from typing import Any

from gymnasium import spaces
from stable_baselines3.common.policies import ActorCriticPolicy, MultiInputActorCriticPolicy
from stable_baselines3.common.preprocessing import is_image_space, is_image_space_channels_first
from stable_baselines3.common.vec_env import VecTransposeImage
from torch import nn
from torch.optim import Optimizer

from agents.network.choice_policy import PARTS, ChoicePolicy
from agents.network.features import PICTURES, LookFeatures
from labeling.core.errors import UsageError

POLICIES: dict[str, type[ActorCriticPolicy]] = {
    "ChoicePolicy": ChoicePolicy,
    "MultiInputPolicy": MultiInputActorCriticPolicy,
}
EXTRACTORS = {"LookFeatures": LookFeatures}
ACTIVATIONS: dict[str, type[nn.Module]] = {"Tanh": nn.Tanh, "ReLU": nn.ReLU, "ELU": nn.ELU, "SiLU": nn.SiLU}
PLAIN = (
    *("net_arch", "log_std_init", "ortho_init", "full_std", "share_features_extractor", "features_extractor_kwargs"),
    "width",
)
TABLES: dict[str, dict[str, Any]] = {"activation_fn": ACTIVATIONS, "features_extractor_class": EXTRACTORS}


def policy_arguments(plain: dict[str, Any]) -> dict[str, Any]:
    """Arguments of the policy's class, with classes for their names.

    Args:
        plain: ``policy_kwargs`` of the hyperparameters.

    Raises:
        UsageError: if one is unknown, naming those there are.
    """
    arguments: dict[str, Any] = {"features_extractor_class": LookFeatures}
    for name, value in plain.items():
        if name in TABLES:
            if value not in TABLES[name]:
                raise UsageError(f"policy_kwargs: {name} must be one of {', '.join(TABLES[name])}, not {value!r}")
            arguments[name] = TABLES[name][value]
        elif name in PLAIN:
            arguments[name] = value
        else:
            raise UsageError(f"policy_kwargs: unknown argument {name!r}; known: {', '.join((*PLAIN, *TABLES))}")
    return arguments


def observed_keys(name: str, plain: dict[str, Any]) -> tuple[str, ...]:
    """The parts of observations that a network of that class with these ``policy_kwargs`` looks at."""
    if policy_class(name) is ChoicePolicy:
        return PARTS
    given = plain.get("features_extractor_kwargs")
    pictures = given.get("pictures", PICTURES) if isinstance(given, dict) else PICTURES
    return (*pictures, "state")


def policy_class(name: str) -> type[ActorCriticPolicy]:
    """The class of that name.

    Raises:
        UsageError: if there is none, naming those there are.
    """
    if name not in POLICIES:
        raise UsageError(f"unknown policy {name!r}; known: {', '.join(POLICIES)}")
    return POLICIES[name]


class NoOptimizer(Optimizer):
    """For policies that are not trained: the first real one of a process imports torch's compiler, which takes long."""

    def __init__(self, *arguments: Any, **named: Any) -> None: ...


def build_policy(
    observation_space: spaces.Dict, action_space: spaces.Space, name: str, plain: dict[str, Any], use_sde: bool = False
) -> ActorCriticPolicy:
    """A network with random weights on the CPU, not to be trained.

    Args:
        observation_space: of the environment, pictures with channels last.
        action_space: likewise.
        name: of the policy's class.
        plain: its ``policy_kwargs``.
        use_sde: whether its noise depends on the state.

    Raises:
        UsageError: if the arguments do not make a network for these spaces.
    """
    arguments = policy_arguments(plain)
    try:
        space = channels_first(observation_space)
        made = policy_class(name)
        return made(space, action_space, lambda left: 0.0, use_sde=use_sde, optimizer_class=NoOptimizer, **arguments)
    except (TypeError, ValueError, AssertionError, RuntimeError) as error:
        raise UsageError(f"policy_kwargs do not make a network for this environment: {error}") from None


def channels_first(space: spaces.Dict) -> spaces.Dict:
    """The observation space as the network sees it: Stable-Baselines3 puts the channels of pictures first."""
    return spaces.Dict(
        {
            name: VecTransposeImage.transpose_space(part, name)
            if isinstance(part, spaces.Box) and is_image_space(part) and not is_image_space_channels_first(part)
            else part
            for name, part in space.spaces.items()
        }
    )
