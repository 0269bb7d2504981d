"""The network that scores rows: what it depends on, and that it treats all sides alike."""

import gymnasium as gym
import numpy as np
import pytest
import torch
from gymnasium import spaces

from agents.network.choice_policy import ChoicePolicy
from agents.network.policy_network import build_policy, observed_keys
from agents.planning.moves_and_looks import ACTION_SPACE, observation_space
from labeling.core.errors import UsageError
from sbm_gym.env.observations import observation_space as env_space
from sbm_gym.robot.object_memory import ViewBins

WHOLE = observation_space(env_space(84, 84, ViewBins()))
SPACE = spaces.Dict({name: WHOLE[name] for name in observed_keys("ChoicePolicy", {})})


def scores(policy: ChoicePolicy, observations: dict[str, np.ndarray]) -> np.ndarray:
    with torch.no_grad():
        given, _ = policy.obs_to_tensor(observations)
        return policy.action_net(policy.extract_features(given)).numpy()


@pytest.fixture(scope="module")
def policy() -> ChoicePolicy:
    torch.manual_seed(0)
    built = build_policy(SPACE, ACTION_SPACE, "ChoicePolicy", {"width": 16})
    assert isinstance(built, ChoicePolicy)
    return built


@pytest.fixture
def observations() -> dict[str, np.ndarray]:
    SPACE.seed(0)
    drawn = [SPACE.sample() for _ in range(5)]
    return {name: np.stack([one[name] for one in drawn]) for name in SPACE.spaces}


def test_what_moves_promise_moves_with_them(policy, observations):
    before = scores(policy, observations)
    turned = np.roll(np.arange(9), 3)
    after = scores(policy, observations | {"moves": observations["moves"][:, turned]})
    np.testing.assert_allclose(after[:, :9], before[:, turned], atol=1e-6)
    np.testing.assert_allclose(after[:, 9:], before[:, 9:], atol=1e-6)


def test_scores_depend_on_the_rows_and_the_summary_and_values_on_all(policy, observations):
    before = scores(policy, observations)
    with torch.no_grad():
        values = policy.predict_values(policy.obs_to_tensor(observations)[0])
    for name, part in observations.items():
        changed = observations | {name: part * 0.5}
        assert np.array_equal(scores(policy, changed), before) == (name == "state")
        with torch.no_grad():
            assert not torch.equal(policy.predict_values(policy.obs_to_tensor(changed)[0]), values)


def test_untrained_it_draws_nearly_evenly(policy, observations):
    odds = torch.softmax(torch.from_numpy(scores(policy, observations)[:, :9]), dim=1)
    assert float(odds.max()) < 2.0 / 9.0


def test_all_weights_are_learnt(policy, observations):
    known = {id(parameter) for group in policy.optimizer.param_groups for parameter in group["params"]}
    assert known == {id(parameter) for parameter in policy.parameters()}
    actions = torch.zeros((5, 2), dtype=torch.long)
    values, log_odds, _ = policy.evaluate_actions(policy.obs_to_tensor(observations)[0], actions)
    (values.sum() + log_odds.sum()).backward()
    assert all(p.grad is not None and p.grad.abs().sum() > 0 for p in policy.parameters())


def test_other_observations_and_arguments_are_refused():
    with pytest.raises(UsageError, match="observations must be a Dict of state, summary, moves, looks"):
        build_policy(spaces.Dict({"state": SPACE["state"]}), ACTION_SPACE, "ChoicePolicy", {})
    with pytest.raises(UsageError, match="width"):
        build_policy(SPACE, gym.spaces.Box(-1, 1, (4,)), "MultiInputPolicy", {"width": 8})
