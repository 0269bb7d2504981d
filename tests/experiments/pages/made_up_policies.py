"""Made-up results about policies, every number in them another one, so that none can stand in for another."""

import itertools
from collections.abc import Iterator
from typing import Any

NAMES = ("return", "discovery", "diversity", "objects", "sectors", "collisions", "path_m")
LABELS = ("pooled_ap50", "ap50", "right", "objects")
COUNTS = ("5", "12", "25")


def figure(numbers: Iterator[int], sure: bool, first: bool) -> dict[str, Any]:
    """A figure with spread, and with a difference that is beyond chance or not."""
    mean = next(numbers) / 100
    ends = {"low": mean + 0.5 if sure else -mean - 1, "high": mean + 2}
    difference = {"mean": mean + 1, **ends, "episodes": 120, "scenes": 12}
    return {"mean": mean, "std": mean / 10, "per_seed": [mean, mean], "difference": None if first else difference}


def evaluation(only: str | None = None) -> dict[str, Any]:
    """As ``policy_evaluation.json``, of one world or both; without a trained policy in streets."""
    numbers = itertools.count(101)
    worlds = {}
    for world, policies in (("rooms", ("ring", "random", "ppo", "spin")), ("streets", ("ring", "random"))):
        found = {}
        for place, policy in enumerate(policies):
            first, sure = place == 0, place == 1
            difference = {name: figure(numbers, sure, False)["difference"] for name in ("right", "objects", "ap50")}
            found[policy] = {
                "figures": {name: figure(numbers, sure, first) for name in NAMES},
                "labels": None
                if policy == "spin"
                else {count: {name: figure(numbers, sure, first) for name in LABELS} for count in COUNTS},
                "early": None if policy == "spin" else {"views": 12, "base_views": 25, "difference": difference},
                "curves": {},
            }
        trained = {"steps": 4321, "seed": 7, "command": "python -m agents.train --seed 7"}
        worlds[world] = {
            "settings": {
                "env": f"sbm_gym/{world}-v0",
                "split": "val",
                "detector": "compact",
                "episodes": 20,
                "seeds": [0, 1],
                "scenes": ["a", "b"],
            },
            "labelled": {"episodes": 6, "picture_px": None},
            "left_out": {} if "ppo" in policies else {"ppo": "there is none for streets"},
            "trained": {"ppo": trained} if "ppo" in policies else {},
            "policies": found,
        }
    kept = {world: found for world, found in worlds.items() if only in (None, world)}
    return {"scale": "quick", "seeds": [0, 1], "compared_with": "ring", "worlds": kept}


def teaching() -> dict[str, Any]:
    """As ``policies.json``: in rooms every seed learns more from the second policy, in streets only some do."""
    gains = {"rooms": (0.05, 0.01, 0.02), "streets": (0.05, -0.01, 0.02)}
    worlds = {}
    for place, (world, more) in enumerate(gains.items()):
        base = 0.3 + place / 10

        def scores(ap50: float) -> dict[str, Any]:
            of_each = {"bed": ap50 + 0.02, "chair": ap50 - 0.02, "car": None}
            part = {"mask_ap50": ap50, "mask_ap30": ap50 + 0.1, "box_ap50": ap50 - 0.05, "per_class_ap50": of_each}
            seen = {f"views of {policy}": {"mask_ap50": ap50 + gain} for policy, gain in (("ring", 0), ("ppo", 0.03))}
            return {"dev": part, "photographs": {"mask_ap50": ap50 + 0.2, "mask_ap30": ap50 + 0.3}, **seen}

        worlds[world] = {
            "pools": {
                "dev": {"scenes": ["home/1", "home/2", "home/1"]},
                **(
                    {f"{policy}_learn": {"episodes": 20} for policy in ("ring", "ppo")}
                    if world == "streets"  # as results before every seed had its own episodes
                    else {f"{one}_{seed}_learn": {"episodes": 20} for one in ("ring", "ppo") for seed in range(3)}
                ),
            },
            "left_out": {},
            "labels": [
                {"policy": policy, "seed": seed, "pseudo_labels": {"mask_ap50": base + 0.2 + seed / 100}}
                for policy in ("ring", "ppo")
                for seed in range(3)
            ],
            "before": scores(base - 0.05),
            "runs": [
                {"policy": policy, "seed": seed, **scores(base + seed / 100 + (more[seed] if policy == "ppo" else 0))}
                for policy in ("ring", "ppo")
                for seed in range(3)
            ],
        }
    return {"scale": "quick", "seeds": [0, 1, 2], "compared_with": "ring", "detector": "compact", "worlds": worlds}


def ablation() -> dict[str, Any]:
    """As ``reward_ablation.json``."""
    numbers = itertools.count(5001)
    planner = "next_best_view"
    policies = (planner, *(f"{planner}:{goal}" for goal in ("discovery", "diversity", "neither")), "random")
    settings = {"env": "sbm_gym/Some-v0", "split": "val", "detector": "simulated", "episodes": 50, "seeds": [0, 1]}

    def world() -> dict[str, Any]:
        figures = {
            policy: {"figures": {name: figure(numbers, place == 1, place == 0) for name in NAMES}}
            for place, policy in enumerate(policies)
        }
        return {"settings": settings, "policies": figures}

    return {
        "scale": "full",
        "seeds": [0, 1],
        "compared_with": planner,
        "worlds": {"rooms": world(), "streets": world()},
    }


def training() -> dict[str, Any]:
    """As ``policy_training_ENV.json``."""
    validations = [{"at": 0.0, "return": 1.11}, {"at": 500.0, "return": 3.33}, {"at": 1000.0, "return": 2.22}]
    return {
        "command": "python -m agents.train --env x",
        "settings": {"eval_episodes": 17, "detector": "simulated"},
        "best": validations[1],
        "checkpoint": {"steps": 777},
        "validations": validations,
        "rollouts": [{"at": 100.0 * step, "return": 0.1 * step} for step in range(1, 11)],
        "references": {"ring": {"return": 4.44}},
    }


def ways() -> dict[str, Any]:
    """As ``policy_pictures_ENV.json``."""
    place = {"scene": "val/00", "seed": 3, "episode": 1}
    figures = {
        "ring": {"return": 6.5, "objects": 2.0, "sectors": 12.0},
        "ppo": {"return": 7.5, "objects": 1.0, "sectors": 9.0},
    }
    return {
        "episodes": [{**place, "picture": "ways.png", "figures": figures}],
        "film": {**place, "policy": "ppo", "file": "film.gif", "frames": 26},
    }
