"""What the package's root gives: light to import, every name there, every example right."""

import doctest
import importlib
import subprocess
import sys

import pytest

import agents


@pytest.mark.parametrize("name", agents.__all__)
def test_every_name_is_there_and_documented(name):
    assert getattr(agents, name).__doc__


def test_names_that_are_not_there_are_attribute_errors():
    with pytest.raises(AttributeError, match="attribute teach"):
        _ = agents.teach  # type: ignore[attr-defined]


@pytest.mark.slow
@pytest.mark.parametrize(
    "module", ["agents", "agents.policies.base", "agents.policies.registry", "agents.rollouts.recorder"]
)
def test_examples_run(module):
    result = doctest.testmod(importlib.import_module(module))
    assert result.attempted > 0
    assert result.failed == 0


def test_importing_loads_nothing_heavy():
    code = "import agents, sys; sys.exit(bool({'torch', 'mujoco', 'stable_baselines3'} & set(sys.modules)))"
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.slow
def test_a_trained_policy_and_a_network_that_looks_do_without_the_compiler_of_torch():
    code = (
        "import sys, numpy as np\n"
        "from agents.policies.registry import make_policy\n"
        "from labeling.detectors.registry import load_detector\n"
        "make_policy('ppo', 'sbm_gym/Indoor-v0')\n"
        "load_detector('compact').detect(np.zeros((1, 64, 64, 3), np.uint8))\n"
        "sys.exit('torch._dynamo' in sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
