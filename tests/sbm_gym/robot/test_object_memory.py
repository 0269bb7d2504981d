"""The object memory against scenes whose geometry is known on paper: spheres before a backdrop."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from labeling.core.geometry import intrinsics_from_fov, look_at
from labeling.core.types import Detection
from labeling.core.views import Camera
from sbm_gym.robot.object_memory import MemoryConfig, ObjectMemory, ViewBins, find, visible_share

SIZE_PX = 96
INTRINSICS = intrinsics_from_fov(SIZE_PX, SIZE_PX, np.pi / 2)
FAR_M = 6.0


def sphere_view(eye, centre, radius_m=0.4, blocker=None, target=None):
    """Depth image and mask of a sphere before a backdrop 6 m away; ``blocker`` is (centre, radius) of another one."""
    pose = look_at(np.array(eye, float), np.array(target if target is not None else centre, float))
    y, x = np.mgrid[:SIZE_PX, :SIZE_PX]
    rays = np.stack([(x - INTRINSICS[0, 2]) / INTRINSICS[0, 0], (y - INTRINSICS[1, 2]) / INTRINSICS[1, 1]], axis=-1)
    rays = np.concatenate([rays, np.ones((SIZE_PX, SIZE_PX, 1))], axis=-1)

    def hit(middle, radius):
        local = pose[:3, :3].T @ (np.array(middle, float) - pose[:3, 3])
        a, b, c = np.sum(rays**2, -1), rays @ local, local @ local - radius**2
        root = b**2 - a * c
        depth = (b - np.sqrt(np.maximum(root, 0))) / a
        return np.where((root > 0) & (depth > 0), depth, np.inf)

    depth, front = hit(centre, radius_m), np.full((SIZE_PX, SIZE_PX), FAR_M)
    if blocker is not None:
        front = np.minimum(front, hit(*blocker))
    return np.minimum(depth, front), depth < front, pose


def camera_at(pose):
    return Camera(INTRINSICS, pose, (SIZE_PX, SIZE_PX))


def observe(memory, eye, centre, confidence=0.95, category="chair", **scene):
    depth, mask, pose = sphere_view(eye, centre, **scene)
    found = [Detection(0, category, confidence, mask)] if mask.any() and confidence > 0 else []
    return memory.observe(found, depth, camera_at(pose))


def ring_eye(angle, radius_m=1.4, height_m=1.5, centre=(0.0, 0.0)):
    return (centre[0] + radius_m * np.cos(angle), centre[1] + radius_m * np.sin(angle), height_m)


def test_a_confident_detection_becomes_an_object_where_it_is():
    memory = ObjectMemory()
    update = observe(memory, (2.0, 0.0, 1.5), (0.0, 0.0, 0.5))
    assert update.new_objects == (0,)
    (known,) = memory.objects
    # The mean of the visible half of a sphere lies within its radius of the centre, on the camera's side.
    assert np.linalg.norm(known.centroid_m - [0, 0, 0.5]) < 0.4
    assert known.centroid_m[0] > 0.0
    assert update.visible == (0,)


def test_an_unconfident_detection_is_a_candidate_and_no_object():
    memory = ObjectMemory()
    update = observe(memory, (2.0, 0.0, 1.5), (0.0, 0.0, 0.5), confidence=0.89)
    assert memory.objects == []
    (finding,) = update.unconfirmed
    assert finding.confidence == 0.89
    assert np.linalg.norm(finding.centroid_m - [0, 0, 0.5]) < 0.4


def test_circling_an_object_keeps_it_one_and_fills_every_sector():
    memory = ObjectMemory()
    azimuths = 0
    for k in range(18):
        azimuths += observe(memory, ring_eye(np.deg2rad(20 * k + 10)), (0.0, 0.0, 0.5)).num_new_azimuths
    assert len(memory.objects) == 1
    assert azimuths == 18
    assert memory.objects[0].azimuths == set(range(18))
    # Seen from all around, the estimated centroid is the centre's.
    assert np.linalg.norm(memory.objects[0].centroid_m[:2]) < 0.02


def test_the_same_view_twice_teaches_nothing_new():
    memory = ObjectMemory()
    observe(memory, (1.4, 0.0, 1.5), (0.0, 0.0, 0.5))
    update = observe(memory, (1.4, 0.0, 1.5), (0.0, 0.0, 0.5))
    assert update.new_objects == ()
    assert update.confidence_gain == 0.0
    assert update.num_new_azimuths == update.num_new_cells == 0


def test_objects_apart_stay_apart():
    memory = ObjectMemory()
    observe(memory, (1.5, 0.0, 1.5), (0.0, 0.0, 0.5))
    observe(memory, (1.5, 1.2, 1.5), (0.0, 1.2, 0.5))
    assert len(memory.objects) == 2


def test_confidence_gain_is_the_share_of_what_was_left():
    memory = ObjectMemory()
    observe(memory, (1.4, 0.0, 1.5), (0.0, 0.0, 0.5), confidence=0.92)
    assert observe(memory, (1.4, 0.1, 1.5), (0.0, 0.0, 0.5), confidence=0.97).confidence_gain == pytest.approx(0.5)
    assert observe(memory, (1.4, 0.2, 1.5), (0.0, 0.0, 0.5), confidence=0.93).confidence_gain == 0.0
    assert memory.objects[0].best_confidence == 0.97


def test_the_most_confident_detection_names_the_object():
    memory = ObjectMemory()
    observe(memory, (1.4, 0.0, 1.5), (0.0, 0.0, 0.5), confidence=0.92, category="couch")
    observe(memory, (1.4, 0.1, 1.5), (0.0, 0.0, 0.5), confidence=0.97, category="chair")
    assert [known.category for known in memory.objects] == ["chair"]


def test_a_sector_counts_only_if_the_object_is_visible_from_it():
    memory = ObjectMemory()
    observe(memory, (-1.4, 0.0, 1.5), (0.0, 0.0, 0.5), radius_m=0.25)
    behind_something = observe(
        memory, (1.4, 0.0, 1.5), (0.0, 0.0, 0.5), confidence=0.0, radius_m=0.25, blocker=((0.7, 0.0, 1.0), 0.35)
    )
    assert behind_something.num_new_azimuths == 0
    assert behind_something.visible == ()
    in_the_open = observe(memory, (1.4, 0.0, 1.5), (0.0, 0.0, 0.5), confidence=0.0, radius_m=0.25)
    assert in_the_open.num_new_azimuths == 1
    assert in_the_open.visible == (0,)


def test_an_object_outside_the_picture_is_not_visible():
    memory = ObjectMemory()
    observe(memory, (1.4, 0.0, 1.5), (0.0, 0.0, 0.5))
    update = observe(memory, (-1.4, 0.0, 1.5), (0.0, 0.0, 0.5), confidence=0.0, target=(-3.0, 0.0, 1.0))
    assert update.visible == ()
    assert update.num_new_azimuths == 0


def test_an_object_that_is_gone_is_not_visible():
    memory = ObjectMemory()
    observe(memory, (1.4, 0.0, 1.5), (0.0, 0.0, 0.5))
    pose = look_at(np.array([1.4, 0.0, 1.5]), np.array([0.0, 0.0, 0.5]))
    assert visible_share(memory.objects[0], np.full((SIZE_PX, SIZE_PX), FAR_M), camera_at(pose)) == 0.0


def chair(mask):
    return Detection(0, "chair", 0.9, mask)


def test_points_of_a_mask_lie_on_the_surface_and_stray_background_is_dropped():
    depth, mask, pose = sphere_view((1.5, 0.0, 1.2), (0.0, 0.0, 0.5))
    finding = find(chair(mask), depth, camera_at(pose), MemoryConfig())
    assert finding is not None
    assert np.allclose(np.linalg.norm(finding.points_m - [0, 0, 0.5], axis=1), 0.4, atol=1e-6)
    spilled = mask.copy()
    y = int(np.argwhere(mask)[:, 0].mean())
    spilled[y - 1 : y + 2, :3] = True
    clean = find(chair(spilled), depth, camera_at(pose), MemoryConfig())
    assert clean is not None
    assert np.all(np.linalg.norm(clean.points_m - [0, 0, 0.5], axis=1) < 0.5)


def test_small_far_and_depthless_masks_are_dropped():
    depth, mask, pose = sphere_view((1.5, 0.0, 1.2), (0.0, 0.0, 0.5))
    tiny = np.zeros_like(mask)
    tiny[0, 0] = True
    assert find(chair(tiny), depth, camera_at(pose), MemoryConfig()) is None
    assert find(chair(mask), depth * 0.0, camera_at(pose), MemoryConfig()) is None
    assert find(chair(mask), depth + 9.0, camera_at(pose), MemoryConfig()) is None


@given(st.floats(-20.0, 20.0), st.floats(0.5, 2.9), st.integers(0, 17))
def test_a_turn_by_one_sector_moves_the_bin_by_one(azimuth, radius_m, sectors):
    bins = ViewBins()
    # On the very edge between two ranges rounding decides.
    assume(all(abs(radius_m - edge_m) > 1e-6 for edge_m in bins.range_edges_m))
    assume(all(abs(np.arctan2(1.0, radius_m) - edge) > 1e-6 for edge in bins.elevation_edges_rad))
    centroid = np.array([0.3, -0.2, 0.5])

    def cell(angle):
        return bins.cell(centroid + np.array([radius_m * np.cos(angle), radius_m * np.sin(angle), 1.0]), centroid)

    width = 2 * np.pi / 18
    middle = (np.floor(azimuth / width) + 0.5) * width
    here, there = cell(middle), cell(middle + sectors * width)
    assert here is not None
    assert there is not None
    assert (there[0] - here[0]) % 18 == sectors
    assert here[1:] == there[1:]


@given(st.integers(0, 2**32 - 1))
def test_bins_of_many_cameras_are_those_of_each(seed):
    rng, bins = np.random.default_rng(seed), ViewBins()
    centroid = rng.uniform(-1, 1, 3)
    cameras = centroid + rng.uniform(-3.5, 3.5, (30, 3))
    inside, cells = bins.cells(cameras, centroid)
    for camera, within, *cell in zip(cameras, inside, *cells, strict=True):
        expected = bins.cell(camera, centroid)
        assert within == (expected is not None)
        if expected is not None:
            assert tuple(cell) == expected
        assert all(0 <= index < count for index, count in zip(cell, bins.shape, strict=True))


def test_views_from_too_near_or_too_far_are_in_no_bin():
    bins = ViewBins()
    assert bins.cell(np.array([0.2, 0.0, 1.5]), np.zeros(3)) is None
    assert bins.cell(np.array([3.5, 0.0, 1.5]), np.zeros(3)) is None
    assert bins.cell(np.array([1.0, 0.0, 1.5]), np.zeros(3)) is not None
