"""Pictures per second of ``compact`` and ResNet-50 Mask R-CNN at the sizes of the worlds' views, and time by stage."""

import time
from collections.abc import Iterator
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any
from unittest import mock

import numpy as np
from jaxtyping import UInt8

from experiments.benchmarks.rows import Row, log, median_seconds, timed

if TYPE_CHECKING:
    from labeling.core.detector import Detector
    from labeling.detectors.networks.losses import Target
    from labeling.detectors.networks.mask_rcnn import Network
    from labeling.detectors.networks.network_detector import NetworkDetector

BATCH = 8
LIMITS_S = {128: 0.040, 256: 0.120}
"""What the project promises for a frame on two cores."""
BASELINE = "ResNet-50 Mask R-CNN"
CLASSES = tuple(f"class {number}" for number in range(13))
PARTS = (("backbone", "trunk and pyramid"), ("rpn", "proposals"), ("roi_heads", "classes, boxes and masks"))


def measure(quick: bool) -> Iterator[Row]:
    """Measures row by row, per frame.

    Networks with random weights report as many detections as they may in every picture, which is the worst case; both
    networks are measured so. With its own weights, ``compact`` is measured on views of a furnished room as well.

    Args:
        quick: few repetitions, and the baseline only at the smaller size.
    """
    import torch

    from labeling.detectors.registry import load_detector

    log(f"torch {torch.__version__}, {torch.get_num_threads()} threads")
    repeats = 1 if quick else 7
    noise = np.random.default_rng(0)
    for size, limit in LIMITS_S.items():
        pictures = noise.integers(0, 256, (BATCH, size, size, 3), dtype=np.uint8)
        detector = _random("compact")
        seconds, found = _per_frame(detector, pictures, repeats)
        theirs = None
        if not (quick and size > min(LIMITS_S)):
            theirs, _ = _per_frame(_random("maskrcnn_resnet50_fpn"), pictures[: 1 if quick else 2], 1 if quick else 3)
        what = f"compact {size}x{size}, batch {BATCH}, worst case: {found:g} detections a frame"
        target = f"< {1e3 * limit:g} ms"
        yield Row(what, f"{BASELINE}, not enlarged", seconds, theirs, target, seconds < limit)
        yield from _parts(detector, pictures, size)
    if quick:
        return
    size = max(LIMITS_S)
    pictures = noise.integers(0, 256, (1, size, size, 3), dtype=np.uint8)
    seconds, _ = _per_frame(_random("maskrcnn_resnet50_fpn", enlarged=True), pictures, 1)
    yield Row(f"{BASELINE}, {size}x{size} enlarged to 800x800 as torchvision does", "-", seconds, None)
    detector = load_detector("compact", "cpu", BATCH)
    for size, limit in LIMITS_S.items():
        seconds, found = _per_frame(detector, _views(size), repeats)
        what = f"compact {size}x{size}, batch {BATCH}, views of a room: {found:g} detections a frame"
        yield Row(what, "limit", seconds, None, f"< {1e3 * limit:g} ms", seconds < limit)
    yield from _one_thread(repeats)


def _one_thread(repeats: int) -> Iterator[Row]:
    """What ``PointwiseConv2d`` saves where networks compute in one thread, as in a recording or training of several."""
    import torch

    from labeling.detectors.networks.losses import with_training_losses
    from labeling.detectors.networks.pointwise import PointwiseConv2d
    from labeling.detectors.registry import load_detector, load_named_network
    from labeling.runtime.threads import one_network_thread

    size = max(LIMITS_S)
    pictures, network = _views(size), with_training_losses(load_named_network("compact")[0])
    with one_network_thread():
        detector = load_detector("compact", "cpu", BATCH)
        targets = _targets(detector, pictures)
        batch = torch.from_numpy(pictures).permute(0, 3, 1, 2)

        def step() -> None:
            network.zero_grad()
            sum(network(batch, [(size, size)] * BATCH, targets).values()).backward()

        network.train()
        for what, work, share in (
            (
                f"compact {size}x{size}, batch {BATCH}, views of a room, one thread",
                lambda: detector.detect(pictures),
                BATCH,
            ),
            (f"gradient of compact's losses, {BATCH} pictures of {size}x{size}, one thread", step, 1),
        ):
            ours = median_seconds(work, repeats) / share
            with mock.patch.object(PointwiseConv2d, "forward", torch.nn.Conv2d.forward):
                theirs = median_seconds(work, repeats) / share
            yield Row(what, "1x1 convolutions as PyTorch chooses", ours, theirs)


def _targets(detector: "Detector", pictures: UInt8[np.ndarray, "b h w 3"]) -> "list[Target]":
    """What the detector finds, to be learnt."""
    import torch

    return [
        {
            "boxes": torch.from_numpy(one.boxes_xyxy),
            "labels": torch.ones(len(one.scores), dtype=torch.int64),
            "masks": torch.from_numpy(one.masks).to(torch.uint8),
            "weights": torch.ones(len(one.scores)),
            "presence": torch.ones(len(one.scores)),
            "ignored": torch.zeros(0, 4),
            "unannotated": torch.zeros(0, dtype=torch.int64),
        }
        for one in detector.detect(pictures)
    ]


def _views(size: int) -> UInt8[np.ndarray, "b h w 3"]:
    """Pictures of a room of builtin furniture."""
    import mujoco

    from experiments.benchmarks.render import views
    from labeling.core.views import Camera
    from sbm_gym.rendering.rays.renderer import RaysRenderer
    from sbm_gym.scenes.world_sources import world_source

    world = world_source("indoor-builtin").build("train/00")
    model = world.spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    renderer = RaysRenderer(model)
    cameras = [Camera.from_fov(pose, (size, size), 0.5 * np.pi) for pose in (views(world) * BATCH)[:BATCH]]
    return np.stack([renderer.render(data, camera).rgb for camera in cameras])


def _random(architecture: str, enlarged: bool = False) -> "NetworkDetector":
    import torch

    from labeling.detectors.networks.mask_rcnn import build_network
    from labeling.detectors.networks.network_detector import NetworkDetector
    from labeling.detectors.networks.spec import NetworkSpec

    torch.manual_seed(0)
    sizes: dict[str, Any] = {"short_side_px": (800, 800)} if enlarged else {}
    return NetworkDetector(build_network(NetworkSpec(architecture, CLASSES, **sizes)), architecture, batch_size=BATCH)


def _per_frame(detector: "Detector", pictures: UInt8[np.ndarray, "b h w 3"], repeats: int) -> tuple[float, float]:
    """Seconds, and detections, per picture."""
    seconds = median_seconds(lambda: detector.detect(pictures), repeats)
    found = detector.detect(pictures)
    return seconds / len(pictures), round(float(np.mean([len(one.scores) for one in found])), 1)


def _parts(detector: "NetworkDetector", pictures: UInt8[np.ndarray, "b h w 3"], size: int) -> Iterator[Row]:
    """Where the time of one batch goes."""
    network: Network = detector.network
    spent = dict.fromkeys([name for name, _ in PARTS], 0.0)
    with ExitStack() as patches:
        for name in spent:
            module = network.get_submodule(name)
            patches.enter_context(mock.patch.object(module, "forward", timed(module.forward, spent, name)))
        before = time.perf_counter()
        detector.detect(pictures)
        spent["rest"] = time.perf_counter() - before - sum(spent.values())
    for name, title in (*PARTS, ("rest", "resizing, pasting of masks, names")):
        yield Row(f"  of which, {size}x{size}: {title}", "-", spent[name] / len(pictures), None)
