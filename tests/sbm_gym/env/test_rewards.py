"""Laws of the reward terms."""

import dataclasses

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sbm_gym.env.rewards import RewardWeights, evidence_terms, reward_terms
from sbm_gym.robot.object_beliefs import BeliefUpdate
from sbm_gym.robot.object_memory import MemoryUpdate

NOTHING = MemoryUpdate((), 0.0, 0, 0, (), {}, ())
updates = st.builds(
    MemoryUpdate,
    st.lists(st.integers(0, 50), max_size=5).map(tuple),
    st.floats(0, 3),
    st.integers(0, 5),
    st.integers(0, 5),
    st.just(()),
    st.just({}),
    st.none(),
)
weights = st.builds(RewardWeights, *[st.floats(0, 5)] * 6)


def test_learning_nothing_earns_nothing():
    assert all(value == 0.0 for value in reward_terms(NOTHING, False, RewardWeights()).values())


def test_each_event_earns_its_weight_in_its_own_term():
    w = RewardWeights(1.0, 0.5, 0.25, 0.05, 0.1, 0.01)

    def earned(term: str, collided: bool = False, **learned) -> float:
        return reward_terms(dataclasses.replace(NOTHING, **learned), collided, w)[term]

    assert earned("discovery", new_objects=(3, 4)) == 2.0
    assert earned("discovery", confidence_gain=1.0) == 0.5
    assert earned("diversity", num_new_azimuths=2, num_new_cells=1) == pytest.approx(0.55)
    assert earned("collision", collided=True) == -0.1
    assert earned("collision") == 0.0
    assert reward_terms(NOTHING, False, w)["step"] == -0.01


@given(updates, weights, st.booleans())
def test_only_collisions_and_steps_cost(update, w, collided):
    terms = reward_terms(update, collided, w)
    assert terms["discovery"] >= 0.0
    assert terms["diversity"] >= 0.0
    assert terms["collision"] <= 0.0
    assert terms["step"] <= 0.0


@given(updates, weights, st.booleans())
def test_a_weight_of_zero_switches_its_event_off(update, w, collided):
    off = RewardWeights(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    assert all(value == 0.0 for value in reward_terms(update, collided, off).values())
    no_discovery = dataclasses.replace(w, new_object=0.0, better_view=0.0)
    changed = reward_terms(update, collided, no_discovery)
    assert changed.pop("discovery") == 0.0
    unchanged = reward_terms(update, collided, w)
    del unchanged["discovery"]
    assert changed == unchanged


@given(st.floats(-5, 5), st.integers(0, 4), st.booleans(), st.floats(0, 1))
def test_evidence_is_paid_by_labels_and_early_finds(labels, found, collided, views_left):
    terms = evidence_terms(BeliefUpdate(labels, found), collided, views_left, RewardWeights(label=0.5, found_early=2.0))
    assert terms["labels"] == 0.5 * labels
    assert terms["discovery"] == 2.0 * found * views_left
    assert (terms["collision"] < 0.0) == collided
    off = RewardWeights(collision=0.0, label=0.0, found_early=0.0)
    assert not any(evidence_terms(BeliefUpdate(labels, found), collided, views_left, off).values())
