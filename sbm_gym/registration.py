"""The environments that ``gymnasium.make`` knows after ``import sbm_gym``."""

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sbm_gym.scenes.profiles import WorldProfile
    from sbm_gym.worlds.world import World

ENV_IDS = {
    "sbm_gym/Indoor-v0": {"worlds": "indoor"},
    "sbm_gym/IndoorBuiltin-v0": {"worlds": "indoor-builtin"},
    "sbm_gym/Outdoor-v0": {"worlds": "outdoor"},
    "sbm_gym/OutdoorBuiltin-v0": {"worlds": "outdoor-builtin"},
}
"""Constructor arguments of the registered environments."""
MAX_EPISODE_STEPS = 25
"""Views of an episode (thesis 5.1.1)."""


def register_envs() -> None:
    """Registers all environments; those registered already are left alone.

    ``import sbm_gym`` does it; so does ``gymnasium.make("sbm_gym:sbm_gym/Indoor-v0")``.

    >>> import gymnasium
    >>> "sbm_gym/Indoor-v0" in gymnasium.registry
    True
    """
    try:
        import gymnasium
        from gymnasium.envs.registration import WrapperSpec
    except ModuleNotFoundError:  # the extra "sim" is not installed; commands answer --help all the same
        return

    for env_id, kwargs in ENV_IDS.items():
        if env_id not in gymnasium.registry:
            gymnasium.register(
                env_id,
                entry_point="sbm_gym.env.fixation_env:FixationEnv",
                kwargs=dict(kwargs),
                max_episode_steps=MAX_EPISODE_STEPS,
                additional_wrappers=(WrapperSpec("WarnOfTimeLimit", "sbm_gym.env.time_limit:WarnOfTimeLimit", {}),),
            )


def register_world(
    name: str,
    build: "Callable[[str], World]",
    splits: Mapping[str, Sequence[str]],
    profile: "WorldProfile | None" = None,
) -> str:
    """Adds a kind of world of one's own, and the environment that explores it.

    All commands know it by its id, if they are told the module that registers it: ``--env my_module:sbm_gym/Arena-v0``.

    >>> import gymnasium, sbm_gym
    >>> def build(scene):
    ...     def furnish(layout, library):
    ...         for use in ("couch", "tv_stand", "floor_plant"):
    ...             layout.against_wall(library.models(use)[0])
    ...     return sbm_gym.build_room(scene, (5.0, 4.0), furnish, seed=int(scene[-1]))
    >>> sbm_gym.register_world("Arena", build, {"train": ["arena/0", "arena/1"], "val": ["arena/2"]})
    'sbm_gym/Arena-v0'
    >>> env = gymnasium.make("sbm_gym/Arena-v0")
    >>> observation, info = env.reset(seed=0)
    >>> info["scene"]
    'arena/1'

    Args:
        name: in the env's id, such as "Arena".
        build: builds the scene of a name; the same name gives the same world in every process.
        splits: names of the scenes by split ("train", "val", "test", ...); a split that is missing has those of all
            others, but "endless", which ``agents.train`` learns from, those of "train" where there is one.
        profile: what fits these worlds (body, strides, picture sizes); that of rooms if None.

    Returns:
        The env's id.

    Raises:
        UsageError: if a split is unknown or empty, or the name cannot stand in an id or belongs to a kind of world
            that comes with sbm_gym.
    """
    from labeling.core.errors import UsageError
    from sbm_gym.scenes.profiles import INDOOR
    from sbm_gym.scenes.world_sources import OWN_NAME, SHIPPED, WORLDS, NamedWorlds

    env_id = f"sbm_gym/{name}-v0"
    if not OWN_NAME.fullmatch(name):
        raise UsageError(f"a world's name has letters, digits, '_', '-' and '.' only, such as Arena; not {name!r}")
    if name in SHIPPED or ENV_IDS.get(env_id, {"worlds": name}) != {"worlds": name}:
        raise UsageError(f"{name!r} comes with sbm_gym; give your world another name")
    source = NamedWorlds(build, splits, profile or INDOOR)
    WORLDS[name] = lambda unseen_models: source
    ENV_IDS[env_id] = {"worlds": name}
    register_envs()
    return env_id
