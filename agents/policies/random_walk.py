"""The ``random`` policy: actions drawn evenly from the action space."""

from typing import Any

import numpy as np

from agents.policies.base import RobotPolicy


class RandomWalk(RobotPolicy):
    """Wanders about and looks around without a plan."""

    def act(self, observation: dict[str, np.ndarray], info: dict[str, Any]) -> np.ndarray:
        """Four independent uniform numbers."""
        return self.rng.uniform(-1.0, 1.0, 4).astype(np.float32)
