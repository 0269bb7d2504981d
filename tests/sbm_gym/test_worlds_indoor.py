"""Furnished rooms, made from the libraries that the project's set-up installs."""

import functools
import hashlib
import itertools
import subprocess
import sys

import mujoco
import numpy as np
import pytest

from sbm_gym.assets.classes import COCO_CATEGORIES, categories
from sbm_gym.assets.library import default_library
from sbm_gym.worlds.indoor import MIN_BEARINGS, approach_bearings, build_indoor
from sbm_gym.worlds.splits import scene_names
from sbm_gym.worlds.world import GEOM_GROUP_COLLISION, GEOM_GROUP_VISUAL

SCENES = (*scene_names("train"), "val/00", "test/00", "test/01", *(f"seed/{seed}" for seed in range(6)))


@functools.cache
def world(name):
    return build_indoor(name)


@functools.cache
def compiled(name):
    """The model, and the lower and upper corner of what is drawn of every body with a piece of furniture."""
    model = world(name).spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return model, data


def drawn_points(model, data, body):
    """World positions of the mesh vertices that are drawn for a body."""
    points = []
    for geom in np.flatnonzero(model.geom_bodyid == body):
        if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH and model.geom_group[geom] == GEOM_GROUP_VISUAL:
            mesh = model.geom_dataid[geom]
            start = model.mesh_vertadr[mesh]
            vertices = model.mesh_vert[start : start + model.mesh_vertnum[mesh]]
            points.append(vertices @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom])
    return np.concatenate(points)


def furniture_bodies(model):
    fixed = ("world", "room", "pictures", "lamps")
    names = [model.body(body).name for body in range(model.nbody)]
    return {name: index for index, name in enumerate(names) if name not in fixed}


@pytest.mark.parametrize("name", SCENES)
def test_rooms_hold_enough_and_no_unknown_classes(name):
    objects = world(name).objects
    assert 6 <= len(objects) <= 14
    assert {instance.category for instance in objects} <= set(categories())
    assert [instance.instance_id for instance in objects] == list(range(1, len(objects) + 1))
    known = {card.model_id for card in default_library().cards()}
    assert {instance.model_name for instance in objects} <= known


@pytest.mark.parametrize("name", SCENES)
def test_pieces_do_not_intersect(name):
    """Collision boxes (the footprints) of different pieces share no point that is not on a surface."""
    model, data = compiled(name)
    boxes = []
    for geom in np.flatnonzero(model.geom_group == GEOM_GROUP_COLLISION):
        half = model.geom_size[geom]
        boxes.append((model.geom_bodyid[geom], data.geom_xpos[geom], data.geom_xmat[geom].reshape(3, 3), half))
    for (body_a, at_a, turn_a, half_a), (body_b, at_b, turn_b, half_b) in itertools.combinations(boxes, 2):
        if body_a != body_b:
            grid = np.stack(np.meshgrid(*[np.linspace(-1, 1, 9)] * 3), axis=-1).reshape(-1, 3)
            for at, turn, half, other_at, other_turn, other_half in (
                (at_a, turn_a, half_a, at_b, turn_b, half_b),
                (at_b, turn_b, half_b, at_a, turn_a, half_a),
            ):
                points = (grid * half) @ turn.T + at
                inside = np.abs((points - other_at) @ other_turn) < other_half - 1e-4
                assert not inside.all(axis=1).any(), (model.body(body_a).name, model.body(body_b).name)


@pytest.mark.parametrize("name", SCENES)
def test_boxes_fit_what_is_drawn(name):
    model, data = compiled(name)
    for instance in world(name).objects:
        points = drawn_points(model, data, model.body(instance.body_name).id)
        local = (points - instance.box_3d.centre_m) @ instance.box_3d.rotation
        np.testing.assert_allclose(local.min(axis=0), -instance.box_3d.extent_m / 2, atol=0.005)
        np.testing.assert_allclose(local.max(axis=0), instance.box_3d.extent_m / 2, atol=0.005)


@pytest.mark.parametrize("name", SCENES)
def test_nothing_floats_and_nothing_leaves_the_room(name):
    """Every piece stands on the floor or on another piece, hangs from the ceiling, or hangs on a wall."""
    model, data = compiled(name)
    room = drawn_points(model, data, model.body("room").id)
    ceiling = room[:, 2].max()
    bodies = furniture_bodies(model)
    spans = {
        n: (p.min(axis=0), p.max(axis=0)) for n, p in ((n, drawn_points(model, data, b)) for n, b in bodies.items())
    }
    inner_low, inner_high = _inner_walls(model, data)
    for body, (low, high) in spans.items():
        assert np.all(low[:2] > inner_low - 1e-3), body
        assert np.all(high[:2] < inner_high + 1e-3), body
        assert high[2] <= ceiling + 1e-3, body
        on_floor = abs(low[2]) < 1e-3 or body.startswith("rug")
        hangs = abs(high[2] - ceiling) < 1e-3
        on_wall = min((low[:2] - inner_low).min(), (inner_high - high[:2]).min()) < 0.04
        middle = 0.5 * (low + high)
        rests = any(
            abs(other_high[2] - low[2]) < 2e-3
            and np.all(middle[:2] > other_low[:2])
            and np.all(middle[:2] < other_high[:2])
            for other, (other_low, other_high) in spans.items()
            if other != body
        )
        assert on_floor or hangs or rests or on_wall, body


def _inner_walls(model, data):
    """Inner faces of the walls, from their collision boxes."""
    geoms = [
        geom
        for geom in np.flatnonzero(model.geom_bodyid == model.body("room").id)
        if model.geom_group[geom] == GEOM_GROUP_COLLISION
    ]
    low, high = np.full(2, -np.inf), np.full(2, np.inf)
    for geom in geoms:
        at, half = data.geom_xpos[geom][:2], model.geom_size[geom][:2]
        axis = int(np.argmin(half))
        if at[axis] < 0:
            low[axis] = at[axis] + half[axis]
        else:
            high[axis] = at[axis] - half[axis]
    assert np.all(np.isfinite([low, high]))
    return low, high


@pytest.mark.parametrize("name", SCENES)
def test_free_space_is_connected_and_every_object_can_be_looked_at(name):
    navigable = world(name).navigable
    np.testing.assert_array_equal(navigable.free, navigable.largest_component)
    assert np.count_nonzero(navigable.free) * navigable.cell_m**2 > 4.0
    for instance in world(name).objects:
        assert approach_bearings(navigable, instance.box_3d.centre_m[:2]) >= MIN_BEARINGS, instance.body_name


@pytest.mark.parametrize("name", SCENES[:6])
def test_the_agent_touches_nothing_where_the_map_is_free(name):
    """MuJoCo as the oracle: a pole of the agent's radius, put down at free places, has no contact."""
    spec = world(name).spec.copy()
    pole = spec.worldbody.add_body(name="pole")
    for axis in ([1, 0, 0], [0, 1, 0]):
        pole.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
    pole.add_geom(
        type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=[0.18, 0.7, 0], pos=[0, 0, 0.85], mass=1, contype=1, conaffinity=1
    )
    model = spec.compile()
    data = mujoco.MjData(model)
    rng = np.random.default_rng(0)
    for _ in range(60):
        data.qpos[:2] = world(name).navigable.random_point(rng)
        mujoco.mj_forward(model, data)
        assert data.ncon == 0
    outside = np.array([100.0, 0.0])
    assert not world(name).navigable.is_free(outside)


def test_all_eight_classes_occur_in_a_quarter_of_the_training_rooms():
    rooms = [{instance.category for instance in world(name).objects} for name in scene_names("train")]
    for category in COCO_CATEGORIES:
        assert sum(category in room for room in rooms) >= len(rooms) / 4, category


def test_rooms_have_lamps_that_cast_shadows():
    model, _ = compiled("train/00")
    assert model.nlight >= 1
    assert np.all(model.light_castshadow)


def fingerprint(name: str) -> str:
    """Everything about a compiled world, as one hash."""
    built = build_indoor(name)
    model = built.spec.compile()
    digest = hashlib.sha256()
    for field in ("body_pos", "body_quat", "geom_pos", "geom_size", "mesh_vert", "tex_data", "mat_rgba", "light_pos"):
        digest.update(np.ascontiguousarray(getattr(model, field)).tobytes())
    digest.update(built.navigable.free.tobytes())
    digest.update(repr([(o.instance_id, o.category, o.body_name, o.model_name) for o in built.objects]).encode())
    return digest.hexdigest()


def test_the_same_name_gives_the_same_world_in_another_process():
    names = ["train/03", "seed/12345"]
    script = (
        "import sys; sys.path.insert(0, sys.argv[1]); import test_worlds_indoor as t; "
        "print(*[t.fingerprint(name) for name in sys.argv[2:]])"
    )
    here = str(__import__("pathlib").Path(__file__).parent)
    other = subprocess.run([sys.executable, "-c", script, here, *names], capture_output=True, text=True, check=True)
    first, second = other.stdout.split()
    assert [first, second] == [fingerprint(name) for name in names]
    assert first != second
