"""Modules of the 3-D memory, beside what other libraries, or simpler modules of our own, take for the same."""

import tempfile
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from experiments.benchmarks.rows import Row, log, median_seconds

if TYPE_CHECKING:
    import torch

    from labeling.memory.networks.view_batch import Views
    from labeling.memory.networks.weights import Memory

VIEWS = 4
"""That go into a memory; one more is predicted."""
CATEGORIES = 12
AZIMUTHS, ELEVATIONS = 18, 3
"""Bins of the search for the rotation."""


def measure(quick: bool) -> Iterator[Row]:
    """Measures row by row, in one thread, at the default size, on one room of two objects.

    Args:
        quick: one repetition.
    """
    import torch

    from experiments.cache.object_rooms import ObjectRooms, record_object_rooms
    from experiments.cache.stages import RunContext
    from labeling.io.episodes import read_episode
    from labeling.memory.settings.memory_spec import MemorySpec
    from labeling.memory.view_prediction.scenes import small_scene

    torch.set_num_threads(1)
    torch.manual_seed(0)
    repeats = 1 if quick else 7
    with tempfile.TemporaryDirectory() as folder:
        (room,) = record_object_rooms(ObjectRooms(2, 1, views=VIEWS + 1), RunContext("smoke", (0,), 1, Path(folder)))
        episode = read_episode(room)
    scene = small_scene(room.name, episode, MemorySpec())
    log(f"{room.name}: {scene.num_views} views, grid of {MemorySpec().grid.shape}")
    chosen = list(range(min(VIEWS, scene.num_views - 1)))
    inputs, target = scene.views(chosen, 0), scene.views([scene.num_views - 1], 0)
    with torch.inference_mode():
        yield from _lifting(inputs, repeats)
        yield from _egomotion(episode, repeats)
        yield from _reading(inputs, target, repeats)
    yield from _learning(inputs, target, repeats)


def _lifting(inputs: "Views", repeats: int) -> Iterator[Row]:
    """From pictures and depth to a memory."""
    import open3d as o3d
    import torch
    from scipy import ndimage

    from labeling.memory.lifting.running_mean import RunningMean
    from labeling.memory.lifting.stabilisation import warp
    from labeling.memory.lifting.unprojection import depth_points, free_space, occupancy, unproject_features
    from labeling.memory.networks.conv_gru import ConvGru
    from labeling.memory.settings.memory_spec import MemorySpec

    spec = MemorySpec()
    depth = inputs.depth_m[0], inputs.depth_intrinsics[0], inputs.camera_to_grid[0]
    pictures = inputs.rgb[0], inputs.intrinsics[0], inputs.camera_to_grid[0]

    def lift() -> None:
        occupancy(*depth, spec.grid)
        free_space(*depth, spec.grid)
        unproject_features(*pictures, spec.grid)

    def lift_by_open3d() -> None:
        for points in depth_points(*depth).flatten(1, 2).double().numpy():
            cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points[np.isfinite(points[:, 0])]))
            o3d.geometry.VoxelGrid.create_from_point_cloud(cloud, spec.grid.voxel_m)

    what = f"unprojection of {len(depth[0])} views: occupied and free voxels, colours"
    yield _row(what, lift, "Open3D VoxelGrid: occupied voxels only", lift_by_open3d, repeats)
    volume, turn = torch.rand(1, spec.channels, *spec.grid.shape), torch.eye(4)[None]
    turn[0, :2, :2] = torch.tensor([[0.8, -0.6], [0.6, 0.8]])
    matrix = turn[0, :3, :3].numpy()[::-1, ::-1]

    def warp_by_scipy() -> None:
        for channel in volume[0].numpy():
            ndimage.affine_transform(channel, matrix, order=1)

    what = f"warp of a volume of {spec.channels} channels"
    yield _row(what, partial(warp, volume, turn, spec.grid), "SciPy affine_transform", warp_by_scipy, repeats)
    gru, weight = ConvGru(spec.channels, spec.channels, 3), torch.ones(1, 1, *spec.grid.shape)
    mean = RunningMean.of(volume, weight)
    what = "writing a view into the memory: convolutional GRU"
    yield _row(what, lambda: gru(volume, volume), "running mean", lambda: mean.updated(volume, weight).mean(), repeats)


def _egomotion(episode, repeats: int) -> Iterator[Row]:
    """Finding how the camera has moved."""
    import torch

    from experiments.cache.egomotion import cloud, icp_motion
    from labeling.memory.lifting.egomotion import coloured_volume, motion_between
    from labeling.memory.lifting.placement import grid_centre, place_grid
    from labeling.memory.lifting.rotation_search import camera_in_gaze_grid, search_rotation
    from labeling.memory.settings.grid_spec import GridSpec

    grid = GridSpec()
    clouds = [cloud(episode, view) for view in (0, 1)]
    icp = partial(icp_motion, *clouds)
    align = partial(motion_between, episode, 0, 1, grid)
    yield _row("motion between two views: alignment of volumes", align, "Open3D ICP of their clouds", icp, repeats)
    place = np.linalg.inv(place_grid(grid_centre(episode, grid), episode.camera_to_world[0]))
    pose = torch.from_numpy((place @ episode.camera_to_world[0]).astype(np.float32))
    memory, view = (coloured_volume(episode, 0, one, grid) for one in (pose, camera_in_gaze_grid(2.0)))
    azimuths = torch.arange(AZIMUTHS) * (2 * torch.pi / AZIMUTHS)
    elevations = torch.linspace(0.1, 0.6, ELEVATIONS)
    volumes = [one[None] for one in (*memory, *view)]
    search = partial(search_rotation, *volumes, azimuths, elevations, grid)
    yield _row(f"search over {AZIMUTHS} x {ELEVATIONS} rotations", search, "alignment of volumes", align, repeats)


def _reading(inputs: "Views", target: "Views", repeats: int) -> Iterator[Row]:
    """From a memory to views, boxes and flow."""
    from labeling.memory.boxes.box_decoding import find_boxes
    from labeling.memory.boxes.box_net import BoxNet
    from labeling.memory.flow.correlation_flow import correlation_flow
    from labeling.memory.flow.flow_net import FlowNet
    from labeling.memory.networks.grnn import Grnn
    from labeling.memory.settings.box_settings import BoxSpec
    from labeling.memory.settings.flow_settings import FlowSpec
    from labeling.memory.settings.memory_spec import MemorySpec

    grnn = Grnn(MemorySpec("grnn")).eval()
    memory = grnn.remember(inputs)
    remember = partial(grnn.remember, inputs)
    yield _row("a view decoded from the memory", lambda: grnn.imagine(memory, target), "making it", remember, repeats)
    boxes = BoxNet(BoxSpec(tuple(map(str, range(CATEGORIES))), MemorySpec("cn3d"))).eval()
    known = boxes.memory.remember(inputs)

    def find() -> None:
        output = boxes.head(known)
        find_boxes(output.heat[0].sigmoid(), output.numbers[0], MemorySpec().grid, np.eye(4))

    yield _row("boxes found in a memory", find, "making it", lambda: boxes.memory.remember(inputs), repeats)
    flow = FlowNet(FlowSpec()).eval()
    before, after = flow.both(inputs, target)
    grid = MemorySpec().grid
    by_blocks = partial(correlation_flow, before.features, after.features, grid)
    yield _row(
        "flow between two memories", lambda: flow.head(before, after, grid), "blocks compared", by_blocks, repeats
    )


def _learning(inputs: "Views", target: "Views", repeats: int) -> Iterator[Row]:
    """A scene forwards and backwards."""
    from labeling.memory.networks.weights import build_memory
    from labeling.memory.settings.memory_spec import MODELS, MemorySpec

    steps = {model: partial(_step, build_memory(MemorySpec(model)), inputs, target) for model in MODELS}
    rival = MODELS[-1]
    theirs = median_seconds(steps[rival], repeats)
    for model in MODELS[:-1]:
        what = f"{model}: {inputs.rgb.shape[1]} views in, one predicted, forwards and backwards"
        yield Row(what, f"{rival}: no geometry", median_seconds(steps[model], repeats), theirs)


def _step(network: "Memory", inputs: "Views", target: "Views") -> "torch.Tensor":
    loss = network(inputs, target).square().mean()
    loss.backward()
    return loss


def _row(what: str, ours: Callable[[], object], baseline: str, theirs: Callable[[], object], repeats: int) -> Row:
    return Row(what, baseline, median_seconds(ours, repeats), median_seconds(theirs, repeats))
