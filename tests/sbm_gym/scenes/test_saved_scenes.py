"""Scenes from disk are those that were compiled, whatever happens to the disk."""

import gc
import subprocess
import sys
import weakref
from functools import cache
from pathlib import Path

import gymnasium as gym
import mujoco
import numpy as np
import pytest

from labeling.core.views import Camera
from sbm_gym.env.fixation_env import FixationEnv
from sbm_gym.robot.body import AgentBody, BodyConfig, add_agent
from sbm_gym.scenes import scene_keys
from sbm_gym.scenes.compiled import compile_scene
from sbm_gym.scenes.scene_cache import open_scene
from sbm_gym.scenes.scene_keys import scene_key
from sbm_gym.scenes.world_sources import IndoorWorlds, OutdoorWorlds
from sbm_gym.store import packed_file
from sbm_gym.store.cache_folder import SceneFolder

from ..box_rooms import BoxRooms
from ..rollouts import rollout

HOME, TOWN = ("sbm_gym/IndoorBuiltin-v0", "train/04"), ("sbm_gym/OutdoorBuiltin-v0", "town/train/00")
"""A town, and of homes one of the smallest: it is built many times."""
ROOT = Path(__file__).resolve().parents[3]


@pytest.fixture
def kept_scenes(tmp_path, monkeypatch) -> SceneFolder:
    """An empty cache, and nothing taken for whole that was whole before."""
    monkeypatch.setenv("SBM_CACHE", str(tmp_path))
    monkeypatch.setattr(packed_file, "_checked", set())
    return SceneFolder(tmp_path / "scenes")


@cache
def rolled_out_afresh(which: tuple[str, str]) -> str:
    """A rollout without any cache."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SBM_SCENE_CACHE", "off")
        return rollout(*which)


def another_process(which: tuple[str, str]) -> subprocess.Popen:
    program = [sys.executable, "-m", "tests.sbm_gym.rollouts", *which]
    return subprocess.Popen(program, cwd=ROOT, stdout=subprocess.PIPE, text=True)


@pytest.mark.slow
@pytest.mark.parametrize("which", [HOME, pytest.param(TOWN, marks=pytest.mark.nightly)], ids=["home", "town"])
def test_rollouts_are_the_same_to_the_last_bit(which, kept_scenes):
    """Built and kept here, opened again here, opened by another process."""
    assert rollout(*which) == rolled_out_afresh(which)
    (kept,) = kept_scenes.scenes()
    modified = kept.path.stat().st_ino
    assert rollout(*which) == rolled_out_afresh(which)
    other = another_process(which)
    assert other.communicate()[0].strip() == rolled_out_afresh(which)
    # Nobody has written it again.
    assert kept.path.stat().st_ino == modified


@pytest.mark.slow
def test_two_processes_may_race_for_a_scene(kept_scenes):
    racers = [another_process(HOME) for _ in range(2)]
    assert {racer.communicate()[0].strip() for racer in racers} == {rolled_out_afresh(HOME)}
    assert len(kept_scenes.scenes()) == 1
    assert rollout(*HOME) == rolled_out_afresh(HOME)
    assert not [path for path in kept_scenes.folder.rglob("*") if path.suffix == ".tmp"]


def _cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2 // 4096 * 4096])


def _flip(path: Path) -> None:
    content = bytearray(path.read_bytes())
    content[len(content) // 2 // 4096 * 4096] ^= 0x10
    path.write_bytes(bytes(content))


FIRST = [("scene", _cut), ("texture", _flip), ("texture", Path.unlink)]
"""What every run tries: each kind of damage, and both kinds of file."""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("what", "damage"),
    [
        pytest.param(what, damage, marks=() if (what, damage) in FIRST else pytest.mark.nightly, id=f"{how}-{what}")
        for what in ("scene", "texture")
        for damage, how in ((_cut, "cut"), (_flip, "flipped"), (Path.unlink, "removed"))
    ],
)
def test_what_is_damaged_is_made_again(what, damage, kept_scenes, monkeypatch):
    source, body = IndoorWorlds(builtin=True), BodyConfig()
    open_scene(source, HOME[1], "rays", body)
    files = {path: path.read_bytes() for path in kept_scenes.folder.rglob("*") if path.is_file()}
    (scene,) = kept_scenes.scenes()
    largest = max(kept_scenes.textures.iterdir(), key=lambda path: path.stat().st_size)
    damage(scene.path if what == "scene" else largest)
    monkeypatch.setattr(packed_file, "_checked", set())
    built = []
    build = IndoorWorlds.build
    monkeypatch.setattr(IndoorWorlds, "build", lambda *asked: built.append(asked) or build(*asked))
    open_scene(source, HOME[1], "rays", body)
    assert len(built) == 1
    # What was made again is what there was, byte by byte.
    assert {path: path.read_bytes() for path in kept_scenes.folder.rglob("*") if path.is_file()} == files
    open_scene(source, HOME[1], "rays", body)
    assert len(built) == 1


@pytest.mark.slow
def test_scenes_in_use_outlive_their_files(kept_scenes):
    with gym.make(f"sbm_gym:{HOME[0]}") as env:
        env.reset(seed=0, options={"scene": HOME[1]})
        before = env.get_wrapper_attr("capture")(64, 64).rgb
        kept_scenes.shrink(0, just_used_s=0.0)
        assert not list(kept_scenes.textures.iterdir())
        assert np.array_equal(env.get_wrapper_attr("capture")(64, 64).rgb, before)
    assert rollout(*HOME) == rolled_out_afresh(HOME)


@pytest.mark.slow
def test_a_cache_that_cannot_be_written_is_done_without(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("not a folder")
    monkeypatch.setenv("SBM_CACHE", str(tmp_path / "file"))
    with pytest.warns(UserWarning, match="compiled scenes cannot be kept in"):
        assert rollout(*HOME) == rolled_out_afresh(HOME)


@pytest.mark.nightly
def test_old_scenes_make_room(kept_scenes, monkeypatch):
    source, body = IndoorWorlds(builtin=True), BodyConfig()
    open_scene(source, HOME[1], "rays", body)
    one = kept_scenes.total_bytes()
    monkeypatch.setenv("SBM_SCENE_CACHE", str(0.5 * one / 1e9))
    open_scene(source, HOME[1], "rays", body)
    assert len(kept_scenes.scenes()) == 1  # only who writes makes room
    open_scene(source, "train/05", "rays", body)
    assert not kept_scenes.scenes()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("source", "scene"), [(IndoorWorlds(builtin=True), HOME[1]), (OutdoorWorlds(builtin=True), "town/train/00")]
)
def test_a_model_without_looks_moves_as_the_whole_one(source, scene):
    world = source.build(scene)
    config = source.profile.body
    add_agent(world.bare, config)
    light = world.bare.compile()
    whole = world.spec.compile()
    assert world.spec is world.bare
    assert mujoco.mj_sizeModel(light) < mujoco.mj_sizeModel(whole) / 50
    assert light.nmesh == light.ntex == 0
    states, touched = [], np.flatnonzero(light.geom_contype)
    for model in (whole, light):
        data = mujoco.MjData(model)
        agent = AgentBody(model, data, config)
        rng = np.random.default_rng(0)
        state = []
        for _ in range(12):
            agent.place(world.navigable.random_point(rng), rng.uniform(-3.0, 3.0), 0.1)
            # Farther than where walls and furniture stand.
            collided = agent.move(rng.uniform(-2.0, 2.0, 2))
            contacts = data.contact
            state += [collided, contacts.geom.copy(), contacts.dist.copy(), contacts.pos.copy(), data.qpos.copy()]
            state += [data.xpos.copy(), data.geom_xmat[touched].copy(), data.light_xpos.copy(), data.cam_xmat.copy()]
        states.append(state)
    for ours, theirs in zip(*states, strict=True):
        assert np.array_equal(ours, theirs)
    assert any(part is True for part in states[0])
    for name in ("geom_rgba", "geom_group", "geom_contype", "geom_matid", "mat_rgba", "light_diffuse", "body_mocapid"):
        assert np.array_equal(getattr(light, name), getattr(whole, name))
    for name in ("geom_aabb", "geom_rbound"):
        assert np.array_equal(getattr(light, name)[touched], getattr(whole, name)[touched])
    for kind in (mujoco.mjtObj.mjOBJ_BODY, mujoco.mjtObj.mjOBJ_GEOM, mujoco.mjtObj.mjOBJ_LIGHT):
        count = {mujoco.mjtObj.mjOBJ_BODY: whole.nbody, mujoco.mjtObj.mjOBJ_GEOM: whole.ngeom}.get(kind, whole.nlight)
        names = [[mujoco.mj_id2name(model, kind, number) for number in range(count)] for model in (whole, light)]
        assert names[0] == names[1]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("source", "scene"),
    [
        (IndoorWorlds(builtin=True), HOME[1]),
        pytest.param(IndoorWorlds(builtin=True), "train/00", marks=pytest.mark.nightly),
        pytest.param(OutdoorWorlds(builtin=True), TOWN[1], marks=pytest.mark.nightly),
    ],
)
def test_what_a_model_does_without_looks_as_in_the_whole_one(source, scene):
    """Poses of meshes differ by rounding: MuJoCo gives them the axes of their inertia."""
    body = source.profile.body
    light, whole = (compile_scene(scene, source.build(scene), "rays", body, made) for made in (False, True))
    assert light.model.nmesh == 0 < whole.model.nmesh
    np.testing.assert_allclose(light.surfaces.points_m, whole.surfaces.points_m, atol=1e-5)
    camera = Camera.from_fov(light.body.camera_to_world, (64, 64), 0.5 * np.pi)
    ours, theirs = (one.renderer.render(one.data, camera) for one in (light, whole))
    assert (ours.geom_id != theirs.geom_id).mean() < 0.002
    same = ours.geom_id == theirs.geom_id
    np.testing.assert_allclose(ours.depth_m[same], theirs.depth_m[same], atol=1e-3)
    assert (np.abs(ours.rgb.astype(int) - theirs.rgb).max(axis=2) > 2).mean() < 0.005
    assert light.whole_model().nmesh == whole.model.nmesh
    np.testing.assert_array_equal(light.whole_data().geom_xpos, whole.data.geom_xpos)


@pytest.mark.nightly
def test_pictures_from_outside_are_the_same(kept_scenes, monkeypatch):
    pictures = []
    for _ in range(2):
        with gym.make(f"sbm_gym:{TOWN[0]}", render_mode="third_person", render_size=(48, 64)) as env:
            env.reset(seed=1, options={"scene": TOWN[1]})
            pictures.append(env.render())
    monkeypatch.setenv("SBM_SCENE_CACHE", "off")
    with gym.make(f"sbm_gym:{TOWN[0]}", render_mode="third_person", render_size=(48, 64)) as env:
        env.reset(seed=1, options={"scene": TOWN[1]})
        pictures.append(env.render())
    assert all(np.array_equal(picture, pictures[-1]) for picture in pictures)


def test_keys_tell_apart_what_differs(monkeypatch):
    monkeypatch.setattr(scene_keys, "_libraries", lambda: "some libraries")
    home, body = IndoorWorlds(builtin=True), BodyConfig()
    keys = [
        scene_key(home, "train/00", "rays", body),
        scene_key(home, "train/01", "rays", body),
        scene_key(home, "train/00", "gl", body),
        scene_key(home, "train/00", "rays", BodyConfig(radius_m=0.2)),
        scene_key(IndoorWorlds(builtin=True, unseen_models=True), "train/00", "rays", body),
        scene_key(OutdoorWorlds(builtin=True), "train/00", "rays", body),
        scene_key(IndoorWorlds(), "train/00", "rays", body),
    ]
    assert scene_key(home, "train/00", "rays", body) == keys[0]
    monkeypatch.setattr(scene_keys, "_surroundings", lambda: ("other code",))
    keys.append(scene_key(home, "train/00", "rays", body))
    assert len(set(keys)) == len(keys)


def test_worlds_of_which_nothing_is_known_are_not_kept(kept_scenes):
    class Mine(IndoorWorlds):
        pass

    for source in (BoxRooms(), Mine()):
        assert scene_key(source, "train/00", "rays", BodyConfig()) is None
    open_scene(BoxRooms(), "box_0", "rays", BodyConfig())
    assert not kept_scenes.scenes()


def test_nothing_is_kept_once_the_code_has_changed(kept_scenes, monkeypatch):
    """What runs is then no longer what the files say, and so the key is not that of what is built."""
    monkeypatch.setattr(scene_keys, "_AT_START", "as it was")
    monkeypatch.setattr(scene_keys, "_surroundings", lambda: ("as it was",))
    assert rollout(*HOME) == rolled_out_afresh(HOME)
    assert not kept_scenes.scenes()


@pytest.mark.slow
def test_gl_draws_kept_scenes_as_fresh_ones(kept_scenes, monkeypatch):
    pictures = []
    for limit in ("1", "1", "off"):
        monkeypatch.setenv("SBM_SCENE_CACHE", limit)
        with gym.make(f"sbm_gym:{HOME[0]}", renderer="gl") as env:
            observation, _ = env.reset(seed=0, options={"scene": HOME[1]})
            pictures.append(observation["rgb"])
    assert len(kept_scenes.scenes()) == 1
    assert all(np.array_equal(picture, pictures[-1]) for picture in pictures)


@pytest.mark.slow
def test_the_digest_of_code_is_found_out_once(kept_scenes, monkeypatch):
    found = scene_keys._code()
    monkeypatch.setattr(scene_keys, "code_digest", None)
    assert scene_keys._code() == found


def test_a_scene_that_is_left_is_freed_at_once(kept_scenes):
    """Not when the garbage collector comes to it: scenes hold tens of megabytes that it knows nothing of."""
    env = FixationEnv(BoxRooms(), split=None, scene_cache=1)
    first, second = env.scene_names[:2]
    env.reset(seed=0, options={"scene": first})
    env.step(np.zeros(4, np.float32))
    gone = weakref.ref(env.scene.renderer)
    gc.collect()
    gc.disable()
    try:
        env.reset(seed=0, options={"scene": second})
        assert gone() is None
    finally:
        gc.enable()
