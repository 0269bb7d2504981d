"""Groups of environments in processes of their own."""

import os
import signal

import numpy as np
import pytest

from agents.ppo.vec_env import GroupedVecEnv, ProcessGroup
from labeling.runtime.interrupts import STOPPING

from ..toy_world import Echo


@pytest.mark.slow
def test_a_signal_to_all_processes_is_the_parents_to_answer() -> None:
    group = ProcessGroup([Echo, Echo])
    envs = GroupedVecEnv([group], [2])
    envs.reset()
    process = group._process
    assert process.pid is not None
    for one in STOPPING:
        os.kill(process.pid, one)
    _, rewards, _, _ = envs.step(np.zeros((2, 4), np.float32))
    assert rewards.shape == (2,)
    envs.close()
    assert process.exitcode == 0
    assert signal.SIGTERM in STOPPING
