"""A network that scores choices: each choice is a row of features, and all rows of a kind are scored by one network.

What is learnt about one direction holds for all directions, which takes far fewer episodes than a score for each. A
move and the look at its end are one choice: their odds follow from the sum of both scores.
"""

import math
from typing import Any

import torch
from gymnasium import spaces
from jaxtyping import Float
from stable_baselines3.common.distributions import Distribution
from stable_baselines3.common.policies import MultiInputActorCriticPolicy
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from stable_baselines3.common.type_aliases import Schedule
from torch import nn
from torch.distributions import Categorical

PARTS = ("state", "summary", "moves", "looks")
"""Parts of observations: ``state`` (n) is seen by the value network alone, ``summary`` (s) by the scorers as well;
``moves`` (m, i) has one row of features for each move, in the order of the action's numbers, the last for staying;
``looks`` (m, l, j) one for each look after each move. The value network sees those after staying."""


class ChoiceFeatures(BaseFeaturesExtractor):
    """Concatenates state, summary and all rows."""

    def __init__(self, observation_space: spaces.Dict) -> None:
        """Makes an extractor; it has no weights.

        Raises:
            ValueError: if the observation space lacks the state or rows.
        """
        parts = observation_space.spaces if isinstance(observation_space, spaces.Dict) else {}
        shapes: list[tuple[int, ...]] = [parts[name].shape or () for name in PARTS if name in parts]
        if [len(shape) for shape in shapes] != [1, 1, 2, 3] or shapes[2][0] != shapes[3][0]:
            raise ValueError(f"observations must be a Dict of {', '.join(PARTS)}; not {observation_space}")
        self.shapes = shapes
        """Of all parts."""
        super().__init__(observation_space, sum(map(math.prod, shapes)))

    def forward(self, observations: dict[str, torch.Tensor]) -> Float[torch.Tensor, "b features"]:
        """Features of a batch."""
        return torch.cat([observations[name].flatten(1) for name in PARTS], dim=1)


class ChoicePolicy(MultiInputActorCriticPolicy):
    """An actor-critic policy whose actor scores rows and whose critic has layers of its own."""

    def __init__(self, *arguments: Any, width: int = 64, **named: Any) -> None:
        """Makes a policy with random weights; arguments as Stable-Baselines3 has them.

        Args:
            arguments: of Stable-Baselines3.
            width: width of the scorers' layers; those of the critic are twice as wide.
            named: of Stable-Baselines3.
        """
        self._width = width
        super().__init__(*arguments, **{**named, "net_arch": [], "features_extractor_class": ChoiceFeatures})

    def _build(self, lr_schedule: Schedule) -> None:
        super()._build(lr_schedule)
        features = self.features_extractor
        assert isinstance(features, ChoiceFeatures)
        self.action_net = RowScores(features, self._width)
        wide = 2 * self._width
        seen = _OfThePresent(features.shapes)
        layers = [seen, nn.Linear(seen.size, wide), nn.Tanh(), nn.Linear(wide, wide), nn.Tanh()]
        self.value_net = nn.Sequential(*layers, nn.Linear(wide, 1))  # type: ignore[assignment]
        for part, gain in ((self.action_net, 1.4), (self.value_net, 1.4)):
            part.apply(lambda module, gain=gain: self.init_weights(module, gain))
        for scorer in self.action_net.scorers:
            assert isinstance(scorer, _RowScorer)
            self.init_weights(scorer.score, 0.01)
            self.init_weights(scorer.direct, 0.01)
        self.init_weights(self.value_net[-1], 1.0)
        self.optimizer = self.optimizer_class(self.parameters(), lr=lr_schedule(1), **self.optimizer_kwargs)  # type: ignore[call-arg]

    def _get_action_dist_from_latent(self, latent_pi: torch.Tensor) -> "JointChoices":
        return JointChoices().proba_distribution(self.action_net(latent_pi))


class JointChoices(Distribution):
    """A move and a look, drawn together."""

    def proba_distribution_net(self, *arguments: Any, **named: Any) -> nn.Module:
        """Not used: the policy makes the network."""
        raise NotImplementedError

    def proba_distribution(self, scores: Float[torch.Tensor, "b moves looks"]) -> "JointChoices":
        """Sets the odds: a softmax over all pairs."""
        self._num_looks = scores.shape[2]
        self.distribution = Categorical(logits=scores.flatten(1))
        return self

    def log_prob(self, actions: Float[torch.Tensor, "b 2"]) -> Float[torch.Tensor, "b"]:
        """Logarithm of the odds of pairs."""
        return self.distribution.log_prob(actions[:, 0] * self._num_looks + actions[:, 1])

    def entropy(self) -> Float[torch.Tensor, "b"]:
        """Of the pairs, nats."""
        return self.distribution.entropy()

    def sample(self) -> Float[torch.Tensor, "b 2"]:
        """A pair by its odds."""
        return self._pairs(self.distribution.sample())

    def mode(self) -> Float[torch.Tensor, "b 2"]:
        """The most likely pair."""
        return self._pairs(self.distribution.probs.argmax(dim=1))

    def actions_from_params(self, *arguments: Any, **named: Any) -> torch.Tensor:
        """Actions for scores."""
        deterministic = named.pop("deterministic", False)
        return self.proba_distribution(*arguments, **named).get_actions(deterministic=deterministic)

    def log_prob_from_params(self, *arguments: Any, **named: Any) -> tuple[torch.Tensor, torch.Tensor]:
        """Actions for scores, and the logarithms of their odds."""
        actions = self.actions_from_params(*arguments, **named)
        return actions, self.log_prob(actions)

    def _pairs(self, numbers: torch.Tensor) -> torch.Tensor:
        return torch.stack([numbers // self._num_looks, numbers % self._num_looks], dim=1)


class _OfThePresent(nn.Module):
    """Features without those of looks after moves; those after staying, the last ones, remain."""

    def __init__(self, shapes: list[tuple[int, ...]]) -> None:
        super().__init__()
        self._before, self._looks = sum(map(math.prod, shapes[:3])), math.prod(shapes[3][1:])
        self.size = self._before + self._looks
        """How many there are."""

    def forward(self, features: Float[torch.Tensor, "b features"]) -> Float[torch.Tensor, "b fewer"]:
        return torch.cat([features[:, : self._before], features[:, -self._looks :]], dim=1)


class RowScores(nn.Module):
    """The actor: scores all rows, with one scorer for moves and one for looks."""

    def __init__(self, features: ChoiceFeatures, width: int) -> None:
        """Makes scorers with random weights."""
        super().__init__()
        self._shapes = features.shapes
        _, (summary,), (_, move), (*_, look) = features.shapes
        self.scorers = nn.ModuleList(_RowScorer(summary, size, width) for size in (move, look))

    def forward(self, features: Float[torch.Tensor, "b features"]) -> Float[torch.Tensor, "b moves looks"]:
        """The score of each move with each look: logits of the pairs."""
        _, summary, moves, looks = features.split([math.prod(shape) for shape in self._shapes], dim=1)
        (num_moves, move), (_, num_looks, look) = self._shapes[2:]
        of_moves = self.scorers[0](summary, moves.reshape(-1, num_moves, move))
        of_looks = self.scorers[1](summary, looks.reshape(-1, num_moves * num_looks, look))
        return of_moves[:, :, None] + of_looks.reshape(-1, num_moves, num_looks)


class _RowScorer(nn.Module):
    """Scores rows of one kind: a linear score plus that of a network with two hidden layers."""

    def __init__(self, summary_size: int, row_size: int, width: int) -> None:
        super().__init__()
        self.direct = nn.Linear(row_size, 1, bias=False)
        self.summary = nn.Linear(summary_size, width)
        self.row = nn.Linear(row_size, width, bias=False)
        self.hidden = nn.Linear(width, width)
        self.score = nn.Linear(width, 1, bias=False)

    def forward(self, summary: torch.Tensor, rows: torch.Tensor) -> torch.Tensor:
        hidden = torch.tanh(self.summary(summary)[:, None] + self.row(rows))
        return (self.direct(rows) + self.score(torch.tanh(self.hidden(hidden))))[..., 0]
