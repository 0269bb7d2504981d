"""A warning for who makes episodes shorter than the robot is told that they are."""

from typing import Any

import gymnasium as gym
from gymnasium.utils import RecordConstructorArgs


class WarnOfTimeLimit(gym.Wrapper, RecordConstructorArgs):
    """Warns where a ``max_episode_steps`` given to ``gym.make`` ends episodes before their last view.

    ``gym.make`` gives that number to its ``TimeLimit`` alone: the spec of the environment inside holds none. So the
    registered environments have this wrapper around ``TimeLimit``, where the number can be read. It changes nothing.
    """

    def __init__(self, env: gym.Env) -> None:
        """Wraps an environment with a ``FixationEnv`` inside."""
        RecordConstructorArgs.__init__(self)
        gym.Wrapper.__init__(self, env)
        self._is_checked = False

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Starts an episode; the first time, warns if it is going to be cut short."""
        if not self._is_checked:
            self._is_checked = True
            steps = None if self.spec is None else self.spec.max_episode_steps
            views = self.env.get_wrapper_attr("num_views")
            if steps is not None and steps < views:
                gym.logger.warn(
                    f"max_episode_steps={steps} ends episodes before their {views} views, of which the robot counts on "
                    f"all: 'time_left' and views_left are too high; give gym.make num_views={steps} instead"
                )
        return self.env.reset(seed=seed, options=options)
