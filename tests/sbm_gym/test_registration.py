"""A world of one's own, on one screen, and what the package's root gives."""

import doctest
import re
import subprocess
import sys
from pathlib import Path

import gymnasium
import numpy as np
import pytest

import sbm_gym
from labeling.core.errors import UsageError
from sbm_gym import registration
from sbm_gym.scenes.profiles import INDOOR, OUTDOOR
from sbm_gym.scenes.world_sources import WORLDS, NamedWorlds, world_source
from sbm_gym.worlds.rooms import indoor


def furnish(layout, library):
    for use in ("couch", "floor_plant", "single_bed"):
        layout.against_wall(library.models(use)[0])


def build(scene):
    return sbm_gym.build_room(scene, (5.0, 4.0), furnish, seed=int(scene[-1]))


@pytest.fixture
def arena():
    yield sbm_gym.register_world("TestArena", build, {"train": ["arena/0", "arena/1"], "val": ["arena/2"]})
    for known, key in ((sbm_gym.ENV_IDS, "sbm_gym/TestArena-v0"), (WORLDS, "TestArena")):
        known.pop(key)  # type: ignore[attr-defined]
    gymnasium.registry.pop("sbm_gym/TestArena-v0")


def test_a_world_of_ones_own_is_an_environment(arena):
    env = gymnasium.make(arena, split="val")
    observation, info = env.reset(seed=0)
    assert info["scene"] == "arena/2"
    assert env.observation_space.contains(observation)
    assert {instance.category for instance in env.unwrapped.scene.world.objects} == {"couch", "plant", "bed"}  # type: ignore[attr-defined]
    for _ in range(3):
        observation, reward, *_ = env.step(env.action_space.sample())
        assert np.isfinite(float(reward))
    assert gymnasium.make(arena, split="test").unwrapped.scene_names == ("arena/0", "arena/1", "arena/2")  # type: ignore[attr-defined]
    with pytest.raises(UsageError, match="arena/9"):
        env.reset(options={"scene": "arena/9"})


def test_what_is_learnt_from_are_training_scenes_alone(arena):
    assert gymnasium.make(arena, split="endless").unwrapped.scene_names == ("arena/0", "arena/1")  # type: ignore[attr-defined]
    everything = {"test": ["arena/3"], "train": ["arena/0"], "endless": ["arena/4", "arena/5"]}
    assert NamedWorlds(build, everything).scenes("endless") == ("arena/4", "arena/5")
    del everything["endless"]
    assert NamedWorlds(build, everything).scenes("endless") == ("arena/0",)
    del everything["train"]
    assert NamedWorlds(build, everything).scenes("endless") == ("arena/3",)


def test_registering_again_replaces_and_mistakes_are_told(arena):
    assert sbm_gym.register_world("TestArena", build, {"train": ["arena/0"]}) == arena
    with pytest.raises(UsageError, match="comes with sbm_gym"):
        sbm_gym.register_world("Indoor", build, {"train": ["arena/0"]})
    with pytest.raises(UsageError, match="'training'"):
        sbm_gym.register_world("TestArena", build, {"training": ["arena/0"]})
    with pytest.raises(UsageError, match="no scene"):
        sbm_gym.register_world("TestArena", build, {})
    with pytest.raises(UsageError, match="no scene for 'val'"):
        sbm_gym.register_world("TestArena", build, {"train": ["arena/0"], "val": []})
    known = dict(WORLDS), dict(sbm_gym.ENV_IDS)
    for shipped in ("indoor", "outdoor-builtin"):
        with pytest.raises(UsageError, match="comes with sbm_gym"):
            sbm_gym.register_world(shipped, build, {"train": ["arena/0"]})
    for name in ("My Arena", "a/b", "", "x:y"):
        with pytest.raises(UsageError, match="letters, digits"):
            sbm_gym.register_world(name, build, {"train": ["arena/0"]})
    assert (dict(WORLDS), dict(sbm_gym.ENV_IDS)) == known


@pytest.mark.parametrize("module", [sbm_gym, registration, indoor])
def test_the_examples_run(module):
    result = doctest.testmod(module)
    assert result.attempted > 0
    assert result.failed == 0


def test_the_example_of_the_page_runs():
    page = (Path(__file__).parents[2] / "docs" / "worlds.md").read_text(encoding="utf-8")
    section = page.split("## A world of your own")[1].split("\n## ")[0]
    (example,) = re.findall(r"```python\n(.*?)```", section, re.DOTALL)
    names: dict = {}
    exec(compile(example, "docs/worlds.md", "exec"), names)
    assert names["info"]["scene"] == "den/2"


def test_the_root_lists_what_it_gives_and_stays_light():
    for name in sbm_gym.__all__:
        assert getattr(sbm_gym, name) is not None
    with pytest.raises(AttributeError, match="Nothing"):
        sbm_gym.Nothing  # noqa: B018
    heavy = "import sys, sbm_gym; print([m for m in ('mujoco', 'torch', 'open3d', 'numba', 'cv2') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", heavy], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize(("kind", "profile"), [("indoor", INDOOR), ("outdoor", OUTDOOR)])
def test_worlds_of_builtin_models_have_the_profile_of_their_kind(kind, profile):
    assert world_source(kind).profile == world_source(f"{kind}-builtin").profile == profile
