"""Figures of labels and their summary over episodes and seeds, as counted by hand."""

import numpy as np
import pytest
from scipy.stats import norm, t

from agents.evaluation.evaluate_config import EvaluateConfig
from agents.evaluation.label_quality import episode_figures, pooled_ap
from agents.evaluation.statistics import over_seeds
from agents.evaluation.summary import over_trainings, summary
from labeling.core.rle import encode_mask


def square(left: int, width: int = 4) -> list:
    """A mask of 4 rows in a picture of 8 x 8 pixels, as results hold it."""
    mask = np.zeros((8, 8), bool)
    mask[2:6, left : left + width] = True
    rle = encode_mask(mask)
    return [rle["size"], rle["counts"]]


def record() -> dict:
    """A chair in views 0 and 6, a couch in view 0, a sliver in view 1; half of the couch is labelled (IoU .5)."""
    chair, couch = [0, "chair", square(0), 1, False], [0, "couch", square(4), 2, False]
    truths = [chair, couch, [1, "couch", square(0, 1), 2, True], [6, "chair", square(2), 1, False]]
    some = [[0, "chair", square(0), 0.9], [0, "couch", square(4, 2), 0.8]]
    return {"truths": truths, "labels": {"5": some, "10": [*some, [6, "chair", square(2), 0.7]]}}


def test_label_figures_of_a_case_counted_by_hand():
    figures = episode_figures(record())
    assert (figures["5"]["right"], figures["10"]["right"]) == (2, 3)
    assert figures["10"]["right_per_view"] == pytest.approx(3 / 10)
    assert figures["10"]["objects"] == 2
    wrong = record()
    wrong["labels"]["5"][1][2] = square(7, 1)
    figures = episode_figures(wrong)
    assert figures["5"] == {
        "ap50": pytest.approx(0.5),
        "ap30": pytest.approx(0.5),
        "labels": 2,
        "right": 1,
        "right_per_view": pytest.approx(1 / 5),
        "objects": 1,
        "visible": 2,
    }


def test_what_is_seen_later_is_not_asked_for_earlier():
    blind = record()
    blind["truths"] = [truth for truth in blind["truths"] if truth[0] == 6]
    blind["labels"]["5"] = []
    figures = episode_figures(blind)
    assert figures["5"]["ap50"] is None
    assert figures["5"]["visible"] == 0
    assert figures["10"]["visible"] == 1


def test_looking_at_nothing_gains_nothing():
    nothing = {**record(), "labels": {"5": [], "10": []}}
    for row in episode_figures(nothing).values():
        assert row["ap50"] == row["right"] == row["objects"] == 0


def test_pooled_ap_ranks_all_episodes_together():
    good, silent = record(), {**record(), "labels": {"5": [], "10": []}}
    alone = pooled_ap([good], "10")["ap50"]
    assert alone == pytest.approx(1.0)
    # Half of each category's instances are found, without a mistake: 51 of 101 recall points.
    assert pooled_ap([good, silent], "10")["ap50"] == pytest.approx(51 / 101)


def test_spread_over_seeds_by_hand():
    assert over_seeds([1.0, 3.0]) == {"mean": 2.0, "std": pytest.approx(2**0.5, abs=1e-5), "per_seed": [1.0, 3.0]}
    assert over_seeds([1.0]) == {"mean": 1.0, "std": None, "per_seed": [1.0]}


def test_summary_without_labels_says_so(tmp_path):
    step = {"reward": 1.0, "sectors": 2}
    episode = {"figures": {"return": 2.0}, "scene": "here", "steps": [step, step]}
    settings = EvaluateConfig(policies=("ring",), episodes=2, seeds=1, labels=False, out=tmp_path)
    found = summary(settings, {"ring": [[episode], [episode]]})["policies"]["ring"]
    assert found["labels"] is None
    assert found["curves"]["return"] == {"mean": [1.0, 2.0], "std": None}


def test_early_labels_are_compared_with_those_of_the_first_policy_at_its_end(tmp_path):
    rng = np.random.default_rng(0)

    def episode(number: int) -> dict:
        """Labels in some of 25 views; which ones are right differs from episode to episode."""
        truths = [[view, "chair", square(0), view % 3, False] for view in range(25)]
        made = {
            str(count): [[view, "chair", square(int(rng.integers(0, 3)) * 2), 0.9] for view in range(0, count, 2)]
            for count in (12, 25)
        }
        step = {"reward": 1.0, "sectors": 2}
        quality = {"truths": truths, "labels": made}
        return {"figures": {}, "scene": "here", "steps": [step], "label_quality": quality, "episode": number}

    records = {policy: [episode(number) for number in range(6)] for policy in ("ring", "random")}
    content = summary(
        EvaluateConfig(policies=("ring", "random"), episodes=3, seeds=2, labels=True, out=tmp_path),
        {policy: [[one] for one in some] for policy, some in records.items()},
    )
    found = content["policies"]
    figures = {policy: [episode_figures(one["label_quality"]) for one in some] for policy, some in records.items()}
    for policy in records:
        early = found[policy]["early"]
        assert (early["views"], early["base_views"]) == (12, 25)
        for name in ("right", "objects", "ap50"):
            ours = np.array([one["12"][name] for one in figures[policy]], float)
            gaps = ours - np.array([one["25"][name] for one in figures["ring"]], float)
            assert early["difference"][name]["mean"] == pytest.approx(np.mean(gaps), abs=1e-4)
            means = [np.mean(rng.choice(gaps, 6)) for _ in range(4000)]
            spread = 0.15 * float(np.std(gaps)) + 1e-4
            student = (6 / 5) ** 0.5 * t.ppf(0.975, 5) / norm.ppf(0.975)
            low = np.mean(gaps) + student * (np.quantile(means, 0.025) - np.mean(gaps))
            assert early["difference"][name]["low"] == pytest.approx(low, abs=spread)
    assert any(
        found["random"]["early"]["difference"][name] != found["random"]["labels"]["12"][name]["difference"]
        for name in ("right", "ap50")
    )


def test_trainings_that_differ_in_their_seed_count_as_one_policy_too() -> None:
    records = {
        "ring": [[{"seed": "ring", "start": 0}], [{"seed": "ring", "start": 1}]],
        "ppo": [[{"seed": 0, "start": 0}], [{"seed": 0, "start": 1}]],
        "ppo_evidence": [[{"seed": 0, "start": 0}], [{"seed": 0, "start": 1}]],
        "ppo_seed_1": [[{"seed": 1, "start": 0}], [{"seed": 1, "start": 1}]],
        "other_seed_1": [[{"seed": 1, "start": 0}], [{"seed": 1, "start": 1}]],
    }
    together = over_trainings(records)
    assert list(together) == ["ppo of 2 trainings"]
    assert together["ppo of 2 trainings"] == [
        [{"seed": 0, "start": 0}, {"seed": 1, "start": 0}],
        [{"seed": 0, "start": 1}, {"seed": 1, "start": 1}],
    ]
