"""Episodes of policies from above, and one as a film: ``python -m experiments.policy_pictures --policies ring``."""

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from labeling.core.errors import UsageError
from labeling.runtime.cli import make_main
from labeling.runtime.help import CommandHelp

if TYPE_CHECKING:
    import gymnasium as gym
    import numpy as np
    from jaxtyping import UInt8

    from agents.rollouts.run_episode import EpisodeSpec

RECORD = "policy_pictures_{}.json"
FIGURES = ("return", "objects", "sectors", "collisions")
FILM_PX = {"wide": (192, 576), "square": (288, 288)}
"""Height and width of the two pictures of a film, by the shape of the world's pictures."""
GAP_PX = 6


@dataclass(frozen=True)
class PolicyPicturesConfig:
    """Draws what policies do from the same starts, from above, and films the last policy in the first episode.

    Keeps what was drawn in RESULTS/policy_pictures_ENV.json, from which the page about policies shows it.
    """

    policies: tuple[str, ...] = ("ring", "ppo")
    """Who is drawn; names as of agents.evaluate."""
    env: str = "sbm_gym/Indoor-v0"
    """Gymnasium id of the world."""
    episodes: int = 2
    """How many: the first ones of the seed, as in agents.evaluate."""
    seed: int = 0
    """Of the starts."""
    detector: str = "simulated"
    """The detector in the loop."""
    split: Literal["train", "val"] = "val"
    """Scenes."""
    out: Path = Path("docs/pictures")
    """Folder for the pictures."""
    results: Path = Path("experiments/results")
    """Folder for what is known about them."""


def run(config: PolicyPicturesConfig) -> None:
    """Plays, draws and films.

    Raises:
        SbmError: if env, detector or a policy are unknown, or the film cannot be made small enough.
    """
    import contextlib

    from agents.evaluation.trajectories import draw_trajectories
    from agents.policies.registry import make_policy
    from agents.rollouts.environments import inner_env
    from agents.rollouts.run_episode import episode_spec, run_episode
    from labeling.formats.atomic import write_json
    from labeling.formats.film import write_film
    from labeling.runtime.provenance import experiment_provenance
    from sbm_gym.named_env import make_env

    names = labels(config.policies)
    if config.episodes < 1 or config.seed < 0:
        raise UsageError(f"--episodes must be at least 1 and --seed at least 0, not {config.episodes}, {config.seed}")
    if not names or len(set(config.policies)) < len(config.policies):
        raise UsageError("--policies must name one policy or more, each once")
    name = config.env.rpartition("/")[2]
    policies = {policy: make_policy(policy, config.env) for policy in config.policies}
    episodes = []
    with contextlib.closing(make_env(config.env, config.split, config.detector)) as env:
        scenes, (height, width) = inner_env(env).scene_names, inner_env(env).profile.capture_size
        specs = [episode_spec(scenes, config.seed, number) for number in range(config.episodes)]
        for spec in specs:
            played = [run_episode(env, chosen, spec, None)[0] for chosen in policies.values()]
            records = dict(zip(names, played, strict=True))
            picture = f"policies_ways_{name}_{spec.seed}_{spec.episode}.png"
            draw_trajectories(inner_env(env), records, config.out / picture)
            print(config.out / picture)
            figures = {policy: {name: one["figures"][name] for name in FIGURES} for policy, one in records.items()}
            about = {"scene": spec.scene, "seed": spec.seed, "episode": spec.episode}
            episodes.append({**about, "picture": picture, "figures": figures})
    film, last = f"policies_film_{name}.gif", config.policies[-1]
    frames = filmed(config, last, specs[0], FILM_PX["wide" if width > 1.5 * height else "square"])
    write_film(frames, config.out / film)
    print(config.out / film)
    content = {
        "env": config.env,
        "split": config.split,
        "detector": config.detector,
        "episodes": episodes,
        "film": {
            **{key: episodes[0][key] for key in ("scene", "seed", "episode")},
            "policy": names[-1],
            "file": film,
            "frames": len(frames),
        },
        **experiment_provenance(),
    }
    write_json(config.results / RECORD.format(name), content)
    print(config.results / RECORD.format(name))


def labels(policies: Sequence[str]) -> list[str]:
    """What policies are called in a picture: without the place of their checkpoint, or what they value, unless that is
    what tells them apart.

    >>> labels(["ring", "ppo:RUN/best"]), labels(["ppo:A/best", "ppo:B/best"])
    (['ring', 'ppo'], ['ppo:A/best', 'ppo:B/best'])
    """
    short = [policy.partition(":")[0] for policy in policies]
    return [policy if short.count(name) > 1 else name for policy, name in zip(policies, short, strict=True)]


# Film ----------------------------------------------------------------------------------------------------------------


def filmed(
    config: PolicyPicturesConfig, policy: str, spec: "EpisodeSpec", size_px: tuple[int, int]
) -> "list[UInt8[np.ndarray, 'h w 3']]":
    """An episode as pictures: the robot from above beside what its camera sees and detects, before the first step and
    after each.

    An env renders in one mode, so the episode is played once for each; the same spec gives the same episode.

    Args:
        config: the settings.
        policy: who is filmed.
        spec: where it starts.
        size_px: height and width of either picture; wide ones stand above each other.
    """
    import contextlib

    import numpy as np
    from gymnasium.wrappers import RenderCollection

    from agents.policies.registry import make_policy
    from agents.rollouts.run_episode import run_episode
    from experiments.figures.films import DetectionsDrawn
    from sbm_gym.named_env import make_env

    seen: list[Sequence[Any]] = []
    for mode in ("third_person", "rgb_array"):
        settings = {"render_mode": mode, "render_size": size_px}
        with contextlib.closing(make_env(config.env, config.split, config.detector, **settings)) as inner:
            env: gym.Env = RenderCollection(DetectionsDrawn(inner) if mode == "rgb_array" else inner)
            run_episode(env, make_policy(policy, config.env), spec, None)
            frames = env.render()
            assert isinstance(frames, list)
            seen.append(frames)
    height_px, width_px = size_px
    wide = width_px > height_px
    gap = np.full((GAP_PX, width_px, 3) if wide else (height_px, GAP_PX, 3), 255, np.uint8)
    return [np.concatenate([above, gap, ahead], axis=0 if wide else 1) for above, ahead in zip(*seen, strict=True)]


HELP = CommandHelp(
    examples=(("--policies ring next_best_view", "episodes of two policies from above"),),
)
main = make_main("experiments.policy_pictures", PolicyPicturesConfig, run, about=HELP)

if __name__ == "__main__":
    sys.exit(main())
