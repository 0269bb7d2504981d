"""The network that scores rows: what it depends on, and that it treats all sides alike."""

import gymnasium as gym
import numpy as np
import pytest
import torch
from gymnasium import spaces

from agents.network.choice_policy import ChoicePolicy
from agents.network.policy_network import build_policy, observed_keys
from agents.planning.choices import ACTION_SPACE
from agents.planning.promises import observation_space
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


def test_what_moves_and_looks_promise_moves_with_them(policy, observations):
    before = scores(policy, observations)
    moves, looks = np.roll(np.arange(9), 3), np.roll(np.arange(17), 5)
    turned = {"moves": observations["moves"][:, moves], "looks": observations["looks"][:, moves][:, :, looks]}
    after = scores(policy, observations | turned)
    np.testing.assert_allclose(after, before[:, moves][:, :, looks], atol=1e-6)


def test_odds_are_those_of_pairs_by_brute_force(policy, observations):
    given, _ = policy.obs_to_tensor(observations)
    odds = torch.softmax(torch.from_numpy(scores(policy, observations)).flatten(1), dim=1).reshape(5, 9, 17)
    with torch.no_grad():
        drawn = policy.get_distribution(given)
        for move in range(9):
            for look in range(17):
                pair = torch.tensor([[move, look]]).expand(5, 2)
                assert torch.allclose(drawn.log_prob(pair).exp(), odds[:, move, look], atol=1e-6)
        assert torch.allclose(drawn.entropy(), -(odds * odds.log()).sum(dim=(1, 2)), atol=1e-4)
        best, _ = policy.predict(observations, deterministic=True)
        assert all(odds[k, *best[k]] == odds[k].max() for k in range(5))
        pairs = torch.cat([drawn.sample() for _ in range(400)])
    assert pairs.min(dim=0).values.tolist() == [0, 0]
    assert pairs.max(dim=0).values.tolist() == [8, 16]


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
    odds = torch.softmax(torch.from_numpy(scores(policy, observations)).flatten(1), dim=1)
    assert float(odds.max()) < 2.0 / (9.0 * 17.0)


@pytest.mark.slow
def test_all_weights_are_learnt(observations):
    policy = ChoicePolicy(SPACE, ACTION_SPACE, lambda left: 1e-3, width=16)  # as training makes it
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
