"""The environments that ``gymnasium.make`` knows after ``import sbm_gym``."""

import gymnasium

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
    """Registers all environments; those registered already are left alone."""
    for env_id, kwargs in ENV_IDS.items():
        if env_id not in gymnasium.registry:
            gymnasium.register(
                env_id,
                entry_point="sbm_gym.env.fixation_env:FixationEnv",
                kwargs=dict(kwargs),
                max_episode_steps=MAX_EPISODE_STEPS,
            )
