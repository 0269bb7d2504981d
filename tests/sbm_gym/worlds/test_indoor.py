"""Furnished rooms, made from the libraries that the project's set-up installs."""

import functools
import hashlib
import itertools
import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest

from sbm_gym.assets.models.classes import COCO_CATEGORIES, NOVEL_CATEGORIES, categories
from sbm_gym.assets.scene_models import held_out, indoor_library, too_small
from sbm_gym.scenes.world_sources import world_source
from sbm_gym.worlds.geometry.navigable import BEARINGS
from sbm_gym.worlds.rooms.indoor import MAX_TRIANGLES, MIN_BEARINGS, RING_M, build_indoor
from sbm_gym.worlds.splits import INTERIORS
from sbm_gym.worlds.world import GEOM_GROUP_COLLISION, GEOM_GROUP_VISUAL

ROOT = Path(__file__).parents[3]
SCENES = (
    *INTERIORS.of_split("train"),
    "val/00",
    "test/00",
    "test/01",
    *(f"seed/{seed}" for seed in range(4)),
    "builtin/0",
    "builtin/1",
)


QUICK = ("train/00", "test/01", "seed/3", "builtin/0")
"""What is law in these is law in the others, which ``make nightly`` looks at."""


@pytest.fixture(
    scope="module", params=[name if name in QUICK else pytest.param(name, marks=pytest.mark.nightly) for name in SCENES]
)
def name(request):
    """A scene. All tests of a scene run one after the other, so that one scene at a time is in memory."""
    return request.param


@functools.lru_cache(maxsize=1)
def world(name):
    if name.startswith("builtin/"):
        return world_source("indoor-builtin").build(name.replace("builtin", "seed"))
    return build_indoor(name)


@functools.lru_cache(maxsize=1)
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
    fixed = ("world", "room_", "pictures_", "lamps_", "walls", "door_")
    names = [model.body(body).name for body in range(model.nbody)]
    return {name: index for index, name in enumerate(names) if not name.startswith(fixed)}


def room_bodies(model, data):
    """Number of the body, lowest and highest point of every room."""
    rooms = []
    for body in range(model.nbody):
        if model.body(body).name.startswith("room_"):
            floor = model.geom(f"{model.body(body).name}_floor").id
            mesh = model.geom_dataid[floor]
            start = model.mesh_vertadr[mesh]
            points = model.mesh_vert[start : start + model.mesh_vertnum[mesh]]
            points = points @ data.geom_xmat[floor].reshape(3, 3).T + data.geom_xpos[floor]
            rooms.append((body, points.min(axis=0)[:2], points.max(axis=0)[:2]))
    return rooms


@pytest.mark.slow
def test_rooms_hold_enough_and_no_unknown_classes(name):
    objects = world(name).objects
    assert 6 <= len(objects) <= 60
    assert {instance.category for instance in objects} <= set(categories())
    assert [instance.instance_id for instance in objects] == list(range(1, len(objects) + 1))
    assert all(instance.model_name for instance in objects)


@pytest.mark.slow
def test_scenes_stay_light(name):
    model, _ = compiled(name)
    meshes = model.geom_dataid[model.geom_type == mujoco.mjtGeom.mjGEOM_MESH]
    assert model.mesh_facenum[meshes].sum() <= MAX_TRIANGLES + 60_000
    assert model.ngeom < 700
    # OpenGL's fixed pipeline knows eight lights.
    assert 1 <= model.nlight <= 7


def test_pieces_do_not_intersect(name):
    """Collision boxes (the footprints) of different pieces share no point that is not on a surface."""
    model, data = compiled(name)
    boxes = []
    for geom in np.flatnonzero(model.geom_group == GEOM_GROUP_COLLISION):
        half = model.geom_size[geom]
        boxes.append((model.geom_bodyid[geom], data.geom_xpos[geom], data.geom_xmat[geom].reshape(3, 3), half))
    for (body_a, at_a, turn_a, half_a), (body_b, at_b, turn_b, half_b) in itertools.combinations(boxes, 2):
        near = np.linalg.norm(at_a - at_b) < np.linalg.norm(half_a) + np.linalg.norm(half_b)
        if body_a != body_b and near:
            grid = np.stack(np.meshgrid(*[np.linspace(-1, 1, 9)] * 3), axis=-1).reshape(-1, 3)
            for at, turn, half, other_at, other_turn, other_half in (
                (at_a, turn_a, half_a, at_b, turn_b, half_b),
                (at_b, turn_b, half_b, at_a, turn_a, half_a),
            ):
                points = (grid * half) @ turn.T + at
                inside = np.abs((points - other_at) @ other_turn) < other_half - 1e-4
                assert not inside.all(axis=1).any(), (model.body(body_a).name, model.body(body_b).name)


def test_boxes_fit_what_is_drawn(name):
    model, data = compiled(name)
    for instance in world(name).objects:
        points = drawn_points(model, data, model.body(instance.body_name).id)
        local = (points - instance.box_3d.centre_m) @ instance.box_3d.rotation
        np.testing.assert_allclose(local.min(axis=0), -instance.box_3d.extent_m / 2, atol=0.005)
        np.testing.assert_allclose(local.max(axis=0), instance.box_3d.extent_m / 2, atol=0.005)


def test_nothing_floats_and_nothing_leaves_its_room(name):
    """Every piece is in one room, and stands on the floor or on another piece, hangs from the ceiling, or on a wall."""
    model, data = compiled(name)
    rooms = room_bodies(model, data)
    ceiling = drawn_points(model, data, rooms[0][0])[:, 2].max()
    bodies = furniture_bodies(model)
    spans = {
        n: (p.min(axis=0), p.max(axis=0)) for n, p in ((n, drawn_points(model, data, b)) for n, b in bodies.items())
    }
    for body, (low, high) in spans.items():
        homes = [(a, b) for _, a, b in rooms if np.all(low[:2] > a - 1e-3) and np.all(high[:2] < b + 1e-3)]
        assert len(homes) == 1, body
        inner_low, inner_high = homes[0]
        assert high[2] <= ceiling + 1e-3, body
        on_floor = abs(low[2]) < 1e-3 or body.startswith("rug")
        hangs = abs(high[2] - ceiling) < 1e-3
        on_wall = min((low[:2] - inner_low).min(), (inner_high - high[:2]).min()) < 0.04
        middle = 0.5 * (low + high)
        rests = any(
            (abs(other_high[2] - low[2]) < 2e-3 or body.startswith("cushion"))
            and np.all(middle[:2] > other_low[:2])
            and np.all(middle[:2] < other_high[:2])
            for other, (other_low, other_high) in spans.items()
            if other != body
        )
        assert on_floor or hangs or rests or on_wall, body


def test_cushions_lie_on_what_carries_them(name):
    """Straight down from a cushion's lowest parts comes its couch or bed, within a centimetre or two of its skin."""
    import open3d as o3d

    model, data = compiled(name)
    cushions = [o for o in world(name).objects if o.category == "cushion"]
    for cushion in cushions:
        scene = o3d.t.geometry.RaycastingScene(nthreads=1)
        for carrier in world(name).objects:
            if carrier.category in ("couch", "bed"):
                body = model.body(carrier.body_name).id
                for geom in np.flatnonzero(model.geom_bodyid == body):
                    if model.geom_type[geom] != mujoco.mjtGeom.mjGEOM_MESH:
                        continue
                    mesh = model.geom_dataid[geom]
                    at, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
                    points = model.mesh_vert[at : at + count] @ data.geom_xmat[geom].reshape(3, 3).T
                    first, faces = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
                    scene.add_triangles(
                        o3d.core.Tensor.from_numpy((points + data.geom_xpos[geom]).astype(np.float32)),
                        o3d.core.Tensor.from_numpy(model.mesh_face[first : first + faces].astype(np.uint32)),
                    )
        skin = drawn_points(model, data, model.body(cushion.body_name).id)
        rays = np.zeros((len(skin), 6), np.float32)
        rays[:, :2], rays[:, 2], rays[:, 5] = skin[:, :2], 3.0, -1.0
        below = 3.0 - scene.cast_rays(o3d.core.Tensor.from_numpy(rays), nthreads=1)["t_hit"].numpy()
        gap = skin[:, 2] - below
        under = np.isfinite(below)
        assert under.mean() > 0.8, cushion.body_name
        # A leaning cushion touches a steep back, where two centimetres sideways are many in height.
        assert np.percentile(gap[under], 2) > -0.05, cushion.body_name
        assert gap[under].min() < 0.02, cushion.body_name


def test_free_space_is_connected_and_every_object_has_a_ring_of_eight_viewpoints(name):
    navigable = world(name).navigable
    np.testing.assert_array_equal(navigable.free, navigable.largest_component)
    assert np.count_nonzero(navigable.free) * navigable.cell_m**2 > 4.0
    for instance in world(name).objects:
        views = []
        for bearing in np.arange(BEARINGS) * (2 * np.pi / BEARINGS):
            direction = np.array([np.cos(bearing), np.sin(bearing)])
            views.append(sum(navigable.is_free(instance.box_3d.centre_m[:2] + r * direction) for r in RING_M))
        assert sum(views) >= 8, instance.body_name
        assert np.count_nonzero(views) >= MIN_BEARINGS, instance.body_name


def test_every_room_can_be_entered_from_every_other(name):
    model, data = compiled(name)
    navigable = world(name).navigable
    rng = np.random.default_rng(0)
    places = []
    for _, low, high in room_bodies(model, data):
        cells = np.argwhere(navigable.free)
        points = navigable.origin_m + navigable.cell_m * (cells[:, ::-1] + 0.5)
        inside = points[np.all((points > low) & (points < high), axis=1)]
        assert len(inside) > 20
        places.append(inside[rng.integers(len(inside))])
    for place in places[1:]:
        way = navigable.shortest_path(places[0], place)
        assert way is not None
        # Walked through MuJoCo's walls nowhere: all straight parts are free.
        assert all(navigable.line_is_free(a, b) for a, b in itertools.pairwise(way))


def test_open_door_leaves_stand_where_they_are_drawn_in_one_room_and_in_nobodys_way(name):
    model, data = compiled(name)
    navigable = world(name).navigable
    rooms = room_bodies(model, data)
    for body in range(model.nbody):
        touched = [g for g in np.flatnonzero(model.geom_bodyid == body) if model.geom_group[g] == GEOM_GROUP_COLLISION]
        if not model.body(body).name.startswith("door_") or not touched:
            continue
        (solid,) = touched
        drawn = [g for g in np.flatnonzero(model.geom_bodyid == body) if g != solid]
        largest = max(drawn, key=lambda g: np.prod(model.geom_size[g]))
        np.testing.assert_allclose(model.geom_size[largest], model.geom_size[solid], atol=1e-6)
        np.testing.assert_allclose(data.geom_xpos[largest], data.geom_xpos[solid], atol=1e-6)
        half_x, half_y, half_z = model.geom_size[solid]
        turn, middle = data.geom_xmat[solid].reshape(3, 3), data.geom_xpos[solid]
        assert middle[2] - half_z == pytest.approx(0.0, abs=1e-6)
        corners = middle + (np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * [half_x, half_y, 0]) @ turn.T
        homes = [(a, b) for _, a, b in rooms if np.all(corners[:, :2] > a) and np.all(corners[:, :2] < b)]
        assert len(homes) == 1
        # It stands along a wall: its far end is as near to one as its hinge is to its own.
        tip = middle + half_x * turn[:, 0]
        assert min((tip[:2] - homes[0][0]).min(), (homes[0][1] - tip[:2]).min()) < 0.45
        for t in np.linspace(-1, 1, 9):
            assert not navigable.is_free((middle + t * half_x * turn[:, 0])[:2])


@pytest.mark.nightly
def test_most_homes_have_doors_that_stand_open():
    leaves = {}
    for name in INTERIORS.of_split("train"):
        model, _ = compiled(name)
        bodies = np.flatnonzero([model.body(body).name.startswith("door_") for body in range(model.nbody)])
        solid = model.geom_bodyid[model.geom_group == GEOM_GROUP_COLLISION]
        leaves[name] = int(np.isin(bodies, solid).sum())
    assert sum(count > 0 for count in leaves.values()) >= 12
    assert sum(leaves.values()) >= 20


def test_wall_cabinets_and_hoods_hang_over_kitchen_cabinets(name):
    """Seen from above, each lies within the cabinets and cookers below it, with a worktop's height between."""
    model, data = compiled(name)
    bodies = furniture_bodies(model)
    spans = {
        n: (p.min(axis=0), p.max(axis=0))
        for n, p in ((n, drawn_points(model, data, b)) for n, b in bodies.items() if _is_fitted(n))
    }
    below = [
        span for n, span in spans.items() if n.startswith(("kitchen_unit", "kitchen_sink", "cooker_0", "cooker_1"))
    ]
    for body, (low, high) in spans.items():
        if body.startswith(("wall_cabinet", "cooker_hood")):
            assert low[2] > 1.3
            middle = 0.5 * (low + high)[:2]
            under = [b for a, b in below if np.all(middle > a[:2] - 0.02) and np.all(middle < b[:2] + 0.02)]
            assert len(under) >= 1, body
            assert all(b[2] < low[2] for b in under), body


def _is_fitted(body):
    return body.startswith(("kitchen_unit", "kitchen_sink", "cooker", "wall_cabinet"))


def test_kitchen_cabinets_of_a_row_leave_no_gap(name):
    """Each cabinet, sink or cooker touches another one side to side; a single one may stand alone."""
    model, data = compiled(name)
    boxes = []
    for geom in np.flatnonzero(model.geom_group == GEOM_GROUP_COLLISION):
        body = model.body(model.geom_bodyid[geom]).name
        if body.startswith(("kitchen_unit", "kitchen_sink", "cooker")) and not body.startswith("cooker_hood"):
            half = np.abs(data.geom_xmat[geom].reshape(3, 3)[:2, :2]) @ model.geom_size[geom][:2]
            boxes.append((data.geom_xpos[geom][:2] - half, data.geom_xpos[geom][:2] + half))
    alone = 0
    for index, (low, high) in enumerate(boxes):
        gaps = [np.maximum(np.maximum(a - high, low - b), 0).sum() for k, (a, b) in enumerate(boxes) if k != index]
        alone += min(gaps, default=np.inf) > 0.005
    assert alone <= max(2, len(boxes) // 3)


@pytest.mark.slow
def test_the_agent_touches_nothing_where_the_map_is_free(name):
    """MuJoCo as the oracle: a pole of the agent's radius, put down at free places, has no contact."""
    compiled.cache_clear()  # so that one model at a time is in memory
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


@pytest.mark.nightly
def test_every_class_has_ten_instances_in_training_and_some_to_spare():
    found = [instance.category for name in INTERIORS.of_split("train") for instance in world(name).objects]
    counts = {category: found.count(category) for category in COCO_CATEGORIES + NOVEL_CATEGORIES}
    assert min(counts.values()) >= 11, counts
    row = f"| `Indoor-v0` | {' | '.join(map(str, counts.values()))} |"
    assert row in (ROOT / "docs" / "worlds.md").read_text(), row


def test_homes_have_what_they_are_lived_in_with(name):
    """Where there is a kitchen there is a fridge, where a bathroom a toilet, and each stands in its room."""
    model, data = compiled(name)
    for body, low, high in room_bodies(model, data):
        inside = {
            o.category
            for o in world(name).objects
            if np.all(o.box_3d.centre_m[:2] > low) and np.all(o.box_3d.centre_m[:2] < high)
        }
        kind = model.body(body).name
        for word, category in (("kitchen", "fridge"), ("bathroom", "toilet"), ("bedroom", "bed")):
            if word in kind:
                assert category in inside, (name, kind)
        names = furniture_bodies(model)
        fixtures = {n for n, b in names.items() if np.all(data.xpos[b][:2] > low) and np.all(data.xpos[b][:2] < high)}
        for word, expected in (("kitchen", "kitchen_sink"), ("kitchen", "cooker_"), ("bathroom", "washbasin")):
            if word in kind:
                assert any(n.startswith(expected) for n in fixtures), (name, kind, expected)


@pytest.mark.slow
def test_lamps_cast_shadows():
    model, _ = compiled("train/00")
    assert np.all(model.light_castshadow)


@pytest.mark.nightly
def test_unseen_models_never_meet():
    """Test scenes are the same either way; with the switch on, training shows none of their models."""
    library = indoor_library()
    shared = too_small(library)
    assert shared == ()
    shown = {o.model_name for name in ("val/00", "test/00", "test/01") for o in world(name).objects}
    shown |= {o.model_name for o in build_indoor("seed/200003", unseen_models=True).objects}  # of the final split
    for name in ("train/00", "train/01", "seed/3"):
        assert not shown & {o.model_name for o in build_indoor(name, unseen_models=True).objects}
    for use in ("dining_chair", "couch", "toilet", "fridge", "cushion"):
        cards = library.models(use)
        assert 0 < len(held_out(cards)) < len(cards)
    again = build_indoor("test/01", unseen_models=True)
    assert [(o.model_name, o.body_name) for o in again.objects] == [
        (o.model_name, o.body_name) for o in world("test/01").objects
    ]


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


@pytest.mark.slow
def test_the_same_name_gives_the_same_world_in_another_process():
    names = ["train/03", "seed/12345"]
    script = (
        "import sys; sys.path.insert(0, sys.argv[1]); import test_indoor as t; "
        "print(*[t.fingerprint(name) for name in sys.argv[2:]])"
    )
    here = str(__import__("pathlib").Path(__file__).parent)
    other = subprocess.run([sys.executable, "-c", script, here, *names], capture_output=True, text=True, check=True)
    first, second = other.stdout.split()
    assert [first, second] == [fingerprint(name) for name in names]
    assert first != second
