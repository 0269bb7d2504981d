"""A network that scores choices: each choice is a row of features, and all rows of a kind are scored by one network.

What is learnt about one direction holds for all directions, which takes far fewer episodes than a score for each.
"""

from typing import Any

import torch
from gymnasium import spaces
from jaxtyping import Float
from stable_baselines3.common.policies import MultiInputActorCriticPolicy
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from stable_baselines3.common.type_aliases import Schedule
from torch import nn

PARTS = ("state", "summary", "moves", "looks")
"""Parts of observations: ``state`` (n) is seen by the value network alone, ``summary`` (s) by the scorers as well;
``moves`` and ``looks`` have one row of features for each choice, in the order of the action's numbers."""


class ChoiceFeatures(BaseFeaturesExtractor):
    """Concatenates state, summary and all rows."""

    def __init__(self, observation_space: spaces.Dict) -> None:
        """Makes an extractor; it has no weights.

        Raises:
            ValueError: if the observation space lacks the state or rows.
        """
        parts = observation_space.spaces if isinstance(observation_space, spaces.Dict) else {}
        shapes: list[tuple[int, ...]] = [parts[name].shape or () for name in PARTS if name in parts]
        if [len(shape) for shape in shapes] != [1, 1, 2, 2]:
            raise ValueError(f"observations must be a Dict of {', '.join(PARTS)}; not {observation_space}")
        (self.state_size,), (self.summary_size,), *rows = shapes
        """Length of the state and of its summary."""
        self.row_shapes = [(shape[0], shape[1]) for shape in rows]
        """Number and length of the rows of each kind."""
        rows_size = sum(rows * length for rows, length in self.row_shapes)
        super().__init__(observation_space, self.state_size + self.summary_size + rows_size)

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
        layers = [nn.Linear(features.features_dim, wide), nn.Tanh(), nn.Linear(wide, wide), nn.Tanh()]
        self.value_net = nn.Sequential(*layers, nn.Linear(wide, 1))  # type: ignore[assignment]
        for part, gain in ((self.action_net, 1.4), (self.value_net, 1.4)):
            part.apply(lambda module, gain=gain: self.init_weights(module, gain))
        for scorer in self.action_net.scorers:
            assert isinstance(scorer, _RowScorer)
            self.init_weights(scorer.score, 0.01)
            self.init_weights(scorer.direct, 0.01)
        self.init_weights(self.value_net[-1], 1.0)
        self.optimizer = self.optimizer_class(self.parameters(), lr=lr_schedule(1), **self.optimizer_kwargs)  # type: ignore[call-arg]


class RowScores(nn.Module):
    """The actor: scores all rows, with one scorer for each kind of rows."""

    def __init__(self, features: ChoiceFeatures, width: int) -> None:
        """Makes scorers with random weights, one for each kind of rows."""
        super().__init__()
        self._shapes = features.row_shapes
        self._sizes = [features.state_size, features.summary_size]
        self._sizes += [rows * length for rows, length in self._shapes]
        self.scorers = nn.ModuleList(_RowScorer(features.summary_size, shape[1], width) for shape in self._shapes)

    def forward(self, features: Float[torch.Tensor, "b features"]) -> Float[torch.Tensor, "b rows"]:
        """The score of each row: logits of the choices."""
        _, summary, *rows = features.split(self._sizes, dim=1)
        found = zip(self.scorers, rows, self._shapes, strict=True)
        return torch.cat([scorer(summary, part.reshape(-1, *shape)) for scorer, part, shape in found], dim=1)


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
