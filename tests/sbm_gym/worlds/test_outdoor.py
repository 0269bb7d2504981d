"""Towns, made from the libraries that the project's set-up installs."""

import functools
import hashlib
import subprocess
import sys
from pathlib import Path

import cv2
import mujoco
import numpy as np
import pytest

from labeling.core.errors import UsageError
from labeling.core.views import Camera
from sbm_gym.assets.catalog.foliage import thin_foliage
from sbm_gym.assets.catalog.home3d import convert
from sbm_gym.assets.catalog.library import default_library
from sbm_gym.assets.models.classes import OUTDOOR_CATEGORIES
from sbm_gym.assets.scene_models import held_out
from sbm_gym.worlds.splits import INTERIORS, TOWNS
from sbm_gym.worlds.towns.outdoor import build_outdoor
from sbm_gym.worlds.towns.plan import draw_plan
from sbm_gym.worlds.towns.vehicles import VEHICLE_USES
from sbm_gym.worlds.towns.weather import draw_weather
from sbm_gym.worlds.world import GEOM_GROUP_COLLISION, GEOM_GROUP_VISUAL

NAMED = TOWNS.of_split(None)
SCENES = (*NAMED, "town/seed/7")
EPISODES = 12
QUICK = ("town/train/00", "town/test/00", "town/seed/7")
"""What is law in these is law in the others, which ``make nightly`` looks at."""


@pytest.fixture(
    scope="module", params=[name if name in QUICK else pytest.param(name, marks=pytest.mark.nightly) for name in SCENES]
)
def name(request):
    """A town. All tests of a town run one after the other, so that one town at a time is in memory."""
    return request.param


@functools.lru_cache(maxsize=1)
def town(name):
    return build_outdoor(name)


@functools.lru_cache(maxsize=1)
def compiled(name):
    model = town(name).spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


@functools.lru_cache(maxsize=1)
def arrangements(name):
    rng = np.random.default_rng(0)
    stage = town(name).stage
    assert stage is not None
    return [stage.arrange(rng) for _ in range(EPISODES)]


def placed(name, arrangement):
    model, data = compiled(name)
    arrangement.apply(model)
    mujoco.mj_resetData(model, data)
    mujoco.mj_forward(model, data)
    return model, data


def drawn_points(model, data, body):
    points = []
    for geom in np.flatnonzero((model.geom_bodyid == body) & (model.geom_group == GEOM_GROUP_VISUAL)):
        mesh = int(model.geom_dataid[geom])
        start, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
        turn = data.geom_xmat[geom].reshape(3, 3)
        points.append(model.mesh_vert[start : start + count] @ turn.T + data.geom_xpos[geom])
    return np.concatenate(points)


def test_splits_have_the_thesis_sizes_and_share_neither_names_nor_seeds():
    assert [len(TOWNS.of_split(split)) for split in ("train", "val", "test")] == [3, 1, 1]
    seeds = {TOWNS.resolve(name)[1].seed for name in NAMED}
    assert len(set(NAMED)) == len(seeds) == 5
    assert not seeds & {TOWNS.resolve(number)[1].seed for number in (*range(100), 1000, 1001, 1002, 2000, 3000)}
    assert not seeds & {source.seed for scenes in INTERIORS.named.values() for source in scenes.values()}


@pytest.mark.parametrize("name", ["town/train/03", "train/00", "town/seed/-1", "", -1, True, 2.5])
def test_unknown_towns_are_refused(name):
    with pytest.raises(UsageError, match="town"):
        TOWNS.resolve(name)


def fingerprint(name: str) -> str:
    """Everything about a compiled town and its first episodes, as one hash."""
    built = build_outdoor(name)
    model = built.spec.compile()
    digest = hashlib.sha256()
    rng = np.random.default_rng(1)
    assert built.stage is not None
    for _ in range(3):
        arrangement = built.stage.arrange(rng)
        arrangement.apply(model)
        fields = (
            "body_pos",
            "body_quat",
            "geom_size",
            "mesh_vert",
            "tex_data",
            "mat_rgba",
            "light_dir",
            "numeric_data",
        )
        for field in fields:
            digest.update(np.ascontiguousarray(getattr(model, field)).tobytes())
        digest.update(arrangement.navigable.free.tobytes() + arrangement.starts.free.tobytes())
        digest.update(
            repr([(o.instance_id, o.category, o.body_name, o.model_name) for o in arrangement.objects]).encode()
        )
    return digest.hexdigest()


@pytest.mark.nightly
def test_the_same_name_gives_the_same_town_in_another_process():
    names = ["town/train/01", "town/seed/3"]
    script = (
        "import sys; sys.path.insert(0, sys.argv[1]); import test_outdoor as t; "
        "print(*[t.fingerprint(name) for name in sys.argv[2:]])"
    )
    here = str(Path(__file__).parent)
    other = subprocess.run([sys.executable, "-c", script, here, *names], capture_output=True, text=True, check=True)
    first, second = other.stdout.split()
    assert [first, second] == [fingerprint(name) for name in names]
    assert first != second


@pytest.mark.slow
def test_towns_hold_vehicles_of_the_classes_and_models_of_their_own(name):
    objects = town(name).objects
    assert len(objects) >= 8
    assert {instance.category for instance in objects} <= set(OUTDOOR_CATEGORIES)
    for arrangement in arrangements(name):
        ids = [instance.instance_id for instance in arrangement.objects]
        assert arrangement.objects[:-2] == objects
        assert len(set(ids)) == len(ids) == len(objects) + 2


@pytest.mark.slow
def test_all_classes_come_as_visitors():
    seen = {instance.category for name in NAMED for a in arrangements(name) for instance in a.objects}
    assert seen == set(OUTDOOR_CATEGORIES)


@pytest.mark.slow
def test_the_two_vehicles_of_an_episode_stand_apart_and_the_agent_starts_near(name):
    rng = np.random.default_rng(0)
    for arrangement in arrangements(name):
        first, second = (instance.box_3d.centre_m[:2] for instance in arrangement.objects[-2:])
        assert np.linalg.norm(first - second) >= 3.0
        for _ in range(5):
            start = arrangement.starts.random_point(rng)
            assert arrangement.navigable.is_free(start)
            assert 2.7 < np.linalg.norm(start - first) < 15.3


def test_episodes_of_a_town_differ():
    places = {tuple(np.round(a.objects[-2].box_3d.centre_m, 1)) for a in arrangements("town/train/00")}
    assert len(places) > EPISODES // 2


@pytest.mark.slow
def test_nothing_solid_is_inside_a_vehicle(name):
    """Points of each vehicle's collision boxes lie in no other body's, and the other way round."""
    for arrangement in arrangements(name)[:4]:
        model, data = placed(name, arrangement)
        vehicles = {model.body(instance.body_name).id for instance in arrangement.objects}
        solid = np.flatnonzero((model.geom_group == GEOM_GROUP_COLLISION) & (data.geom_xpos[:, 2] > -5.0))
        grid = np.stack(np.meshgrid(*[np.linspace(-1, 1, 7)] * 3), axis=-1).reshape(-1, 3)
        clouds = {g: (grid * model.geom_size[g]) @ data.geom_xmat[g].reshape(3, 3).T + data.geom_xpos[g] for g in solid}
        for a in solid:
            if model.geom_bodyid[a] not in vehicles:
                continue
            for b in solid:
                near = (
                    np.linalg.norm(data.geom_xpos[a] - data.geom_xpos[b]) < model.geom_rbound[a] + model.geom_rbound[b]
                )
                if model.geom_bodyid[a] == model.geom_bodyid[b] or not near:
                    continue
                for points, other in ((clouds[a], b), (clouds[b], a)):
                    local = (points - data.geom_xpos[other]) @ data.geom_xmat[other].reshape(3, 3)
                    inside = np.all(np.abs(local) < model.geom_size[other] - 1e-4, axis=1)
                    names = (model.body(model.geom_bodyid[g]).name for g in (a, b))
                    assert not inside.any(), tuple(names)


@pytest.mark.slow
def test_vehicles_stand_on_the_ground_where_vehicles_stand(name):
    plan = draw_plan(np.random.default_rng(TOWNS.resolve(name)[1].seed))
    for arrangement in arrangements(name)[:4]:
        model, data = placed(name, arrangement)
        for instance in arrangement.objects:
            body = model.body(instance.body_name).id
            box = instance.box_3d
            corners = box.centre_m[:2] + (np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * box.extent_m[:2] / 2) @ (
                box.rotation[:2, :2].T
            )
            homes = []
            for spawn in plan.spawns:
                ahead = np.array([np.cos(spawn.heading_rad), np.sin(spawn.heading_rad)])
                offset = corners - [spawn.x_m, spawn.y_m]
                along, across = offset @ ahead, offset @ [-ahead[1], ahead[0]]
                # Buses are wider than a bay and stand out into the lane; nobody parks quite straight.
                slack = 1.0 if spawn.kind == "bus" else 0.35
                homes.append(
                    np.all(np.abs(along) <= spawn.length_m / 2 + 0.1)
                    and np.all(np.abs(across) <= spawn.width_m / 2 + slack)
                )
            assert any(homes), instance.body_name
            heights = {round(spawn.z_m, 6) for spawn, home in zip(plan.spawns, homes, strict=True) if home}
            lowest = drawn_points(model, data, body)[:, 2].min()
            assert min(abs(lowest - height) for height in heights) < 0.02


def test_boxes_fit_what_is_drawn(name):
    arrangement = arrangements(name)[0]
    model, data = placed(name, arrangement)
    for instance in arrangement.objects:
        points = drawn_points(model, data, model.body(instance.body_name).id)
        local = (points - instance.box_3d.centre_m) @ instance.box_3d.rotation
        np.testing.assert_allclose(local.min(axis=0), -instance.box_3d.extent_m / 2, atol=0.03)
        np.testing.assert_allclose(local.max(axis=0), instance.box_3d.extent_m / 2, atol=0.03)


def directions_seen_from(model, data, navigable, instance):
    """From how many of 18 bearings, 3 to 15 m away, one can stand and see the object. Oracle: MuJoCo's rays."""
    body, centre = model.body(instance.body_name).id, instance.box_3d.centre_m
    drawn, geom = np.array([1, 1, 1, 0, 0, 0], np.uint8), np.zeros(1, np.int32)
    points = drawn_points(model, data, body)
    aims = points[np.linspace(0, len(points) - 1, 10).astype(int)]
    count = 0
    for bearing in np.arange(18) * np.pi / 9:
        for distance in (3.5, 5.0, 7.0, 10.0, 14.0):
            eye = np.append(centre[:2] + distance * np.array([np.cos(bearing), np.sin(bearing)]), 1.65)
            if navigable.is_free(eye[:2]):
                hits = 0
                for aim in aims:
                    mujoco.mj_ray(model, data, eye, aim - eye, drawn, 1, -1, geom)
                    hits += geom[0] >= 0 and model.geom_bodyid[geom[0]] == body
                if hits >= 3:
                    count += 1
                    break
    return count


@pytest.mark.slow
def test_every_vehicle_can_be_seen_from_a_ring_of_eight_viewpoints(name):
    world = town(name)
    np.testing.assert_array_equal(world.navigable.free, world.navigable.largest_component)
    for arrangement in arrangements(name)[:3]:
        model, data = placed(name, arrangement)
        np.testing.assert_array_equal(arrangement.navigable.free, arrangement.navigable.largest_component)
        for instance in arrangement.objects[-2:]:
            assert directions_seen_from(model, data, arrangement.navigable, instance) >= 8, instance.body_name
    for instance in world.objects:
        assert directions_seen_from(model, data, world.navigable, instance) >= 8, instance.body_name


@pytest.mark.slow
def test_the_agent_touches_nothing_where_the_map_of_an_episode_is_free(name):
    """MuJoCo as the oracle: a pole of the agent's radius, put down at free places, has no contact."""
    compiled.cache_clear()  # so that one model at a time is in memory
    spec = town(name).spec.copy()
    pole = spec.worldbody.add_body(name="pole")
    for axis in ([1, 0, 0], [0, 1, 0]):
        pole.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
    pole.add_geom(
        type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=[0.18, 0.7, 0], pos=[0, 0, 0.85], mass=1, contype=1, conaffinity=1
    )
    model = spec.compile()
    data = mujoco.MjData(model)
    rng = np.random.default_rng(0)
    for arrangement in arrangements(name)[:3]:
        arrangement.apply(model)
        mujoco.mj_resetData(model, data)
        for _ in range(40):
            data.qpos[:2] = arrangement.navigable.random_point(rng)
            mujoco.mj_forward(model, data)
            assert data.ncon == 0
        # And it would touch the vehicles.
        data.qpos[:2] = arrangement.objects[-2].box_3d.centre_m[:2]
        mujoco.mj_forward(model, data)
        assert data.ncon > 0


def test_weather_of_an_episode_is_that_of_a_town_built_with_it():
    rng = np.random.default_rng(3)
    for _ in range(20):
        weather = draw_weather(rng)
        lit = mujoco.MjSpec()
        weather.add_to(lit)
        expected = lit.compile()
        other = mujoco.MjSpec()
        draw_weather(rng).add_to(other)
        model = other.compile()
        weather.apply(model)
        for field in ("light_dir", "light_pos", "light_diffuse", "light_specular", "numeric_data"):
            np.testing.assert_allclose(getattr(model, field), getattr(expected, field), atol=1e-6)
        np.testing.assert_allclose(model.vis.headlight.ambient, expected.vis.headlight.ambient, atol=1e-6)
        assert model.light_dir[0, 2] < -0.25  # the sun is up
        assert np.all(weather.sky() >= 0.0)


def test_haze_makes_far_things_fade_into_the_sky():
    from sbm_gym.rendering.rays.renderer import RaysRenderer

    def wall_at(distance_m: float, haze_per_m: float) -> np.ndarray:
        spec = mujoco.MjSpec()
        spec.worldbody.add_geom(
            type=mujoco.mjtGeom.mjGEOM_BOX, size=[50, 0.1, 50], pos=[0, distance_m, 0], rgba=[0.02, 0.02, 0.02, 1]
        )
        spec.add_numeric(name="sky", data=[*[0.1, 0.2, 0.5], *[0.5, 0.5, 0.5], *[0.2, 0.2, 0.2], haze_per_m])
        model = spec.compile()
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        pose = np.eye(4)
        pose[:3, :3] = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])
        frame = RaysRenderer(model).render(data, Camera.from_fov(pose, (9, 9), np.pi / 2))
        return frame.rgb[4, 4].astype(int)

    clear, near, far = wall_at(20.0, 0.0), wall_at(20.0, 0.01), wall_at(100.0, 0.01)
    assert np.all(clear < near)
    assert np.all(near < far)


def silhouette_m2(model) -> float:
    """Area that a tree hides, seen from its front. Oracle: its triangles, filled in on a grid of centimetres."""
    picture = np.zeros((1200, 1200), np.uint8)
    for surface in model.surfaces:
        corners = surface.vertices_m[surface.faces][..., [0, 2]]
        for triangle in np.round(100.0 * corners + [600.0, 0.0]).astype(np.int32):
            cv2.fillConvexPoly(picture, triangle, 1)
    return float(picture.sum()) * 1e-4


@pytest.mark.slow
@pytest.mark.parametrize(
    "model_id",
    [
        "Scopia#palm",
        *(pytest.param(f"Scopia#{tree}", marks=pytest.mark.nightly) for tree in ("ficusTree", "peachBlossom")),
    ],
)
def test_thinned_trees_keep_their_size_and_cover(model_id):
    library = default_library()
    (entry,) = [entry for source in library.libraries for entry in source.entries if entry.model_id == model_id]
    whole = convert(entry)
    thin = thin_foliage(whole, 8_000)
    assert thin.num_triangles < 0.2 * whole.num_triangles
    assert silhouette_m2(thin) == pytest.approx(silhouette_m2(whole), rel=0.15)
    points = np.concatenate([surface.vertices_m for surface in thin.surfaces])
    np.testing.assert_allclose(np.ptp(points, axis=0), whole.size_m, rtol=0.12)


@pytest.mark.slow
def test_towns_are_no_heavier_than_they_must_be(name):
    """Renderers and resets pay for triangles, and towns hold many things."""
    model, _ = compiled(name)
    meshes = model.geom_dataid[model.geom_type == mujoco.mjtGeom.mjGEOM_MESH]
    assert model.mesh_facenum[meshes].sum() < 420_000
    moving = model.body_mocapid[model.geom_bodyid] >= 0
    drawn = moving & (model.geom_group == GEOM_GROUP_VISUAL)
    assert model.mesh_facenum[model.geom_dataid[drawn]].sum() < 45_000


@pytest.mark.slow
def test_training_towns_use_no_model_that_test_towns_use():
    tests = {o.model_name for name in ("town/val/00", "town/test/00") for o in shown(name, unseen_models=False)}
    assert tests == {o.model_name for name in ("town/val/00", "town/test/00") for o in shown(name, unseen_models=True)}
    library = default_library()
    reserved = {model for use in VEHICLE_USES for model in held_out(library.models(use))}
    tests |= {o.model_name for o in shown("town/seed/200003", unseen_models=True)}  # of the final split
    assert tests <= reserved
    for name in ("town/train/00", "town/train/02", "town/seed/7"):
        assert not tests & {o.model_name for o in shown(name, unseen_models=True)}
    assert tests & {o.model_name for name in NAMED[:3] for o in shown(name, unseen_models=False)}


def shown(name: str, unseen_models: bool):
    """All vehicles of a town and of some of its episodes."""
    world = build_outdoor(name, unseen_models=unseen_models) if unseen_models else town(name)
    assert world.stage is not None
    rng = np.random.default_rng(0)
    return [*world.objects, *(o for _ in range(EPISODES) for o in world.stage.arrange(rng).objects)]
