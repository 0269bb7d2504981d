"""Detectors by name."""

from functools import lru_cache
from pathlib import Path

from labeling.core.detector import Detector, DetectorError
from labeling.core.errors import UsageError
from labeling.core.masks import MASK_THRESHOLD
from labeling.detectors.networks.spec import PREDICTED_MASK_THRESHOLD

COMPACT_FILE = Path(__file__).with_name("weights") / "compact.safetensors"
DEFAULT = "compact"
NAMES = ("compact", "maskrcnn_resnet50_fpn")
KINDS = (*NAMES, "onnx:FILE", "package.module:function", "the folder of a labeling.finetune run")
ONNX_PREFIX = "onnx:"


def check_name(name: str) -> None:
    """Refuses names that lead nowhere, without loading anything.

    Raises:
        UsageError: listing what there is.
    """
    if name in NAMES or is_run(name):
        return
    kind, colon, rest = name.partition(":")
    if colon and kind and rest:
        return
    hint = " (give package.module:function)" if colon else ""
    if Path(name).is_dir():
        hint = f" (the folder {name} holds no {run_weights(name).name})"
    raise UsageError(f"unknown detector {name!r}{hint}; known: {', '.join(KINDS)}")


def load_detector(
    name: str,
    device: str | None = None,
    batch_size: int = 8,
    mask_threshold: float = PREDICTED_MASK_THRESHOLD,
) -> Detector:
    """Makes a detector from its name.

    Args:
        name: one of ``KINDS``.
        device: of networks: "cpu", "cuda", ...; by default a GPU if there is one.
        batch_size: pictures at a time, for detectors that can take several.
        mask_threshold: from which probability on a pixel is part of the mask of a network, in [0, 1]; by default what
            is best for predictions. Other detectors have thresholds of their own.

    Raises:
        UsageError: if there is no such detector, or a number makes no sense.
        DetectorError: if its files are missing or damaged.

    Example:
        >>> load_detector("compcat")
        Traceback (most recent call last):
        ...
        labeling.core.errors.UsageError: unknown detector 'compcat'; known: compact, maskrcnn_resnet50_fpn, onnx:FILE, \
package.module:function, the folder of a labeling.finetune run
    """
    check_name(name)
    if batch_size < 1:
        raise UsageError(f"--batch-size must be at least 1, not {batch_size}")
    if not 0 <= mask_threshold <= 1:
        raise UsageError(f"mask_threshold is a probability, from 0 to 1, not {mask_threshold:g}")
    if name in NAMES or is_run(name):
        from labeling.detectors.networks.network_detector import NetworkDetector

        network, digest = load_named_network(name)
        return NetworkDetector(network, name, digest, choose_device(device), batch_size, mask_threshold)
    if name.startswith(ONNX_PREFIX):
        from labeling.detectors.adapters.onnx import OnnxDetector

        path = name.removeprefix(ONNX_PREFIX)
        family, colon, file = path.partition(":")
        told = bool(colon) and not Path(path).is_file()
        return OnnxDetector(Path(file if told else path), name, family if told else None)
    from labeling.detectors.adapters.function import FunctionDetector

    return FunctionDetector(name)


def detector_by_name(name: str) -> Detector:
    """The detector of this name, for recordings and labels; loaded once, and again when its weights have changed.

    Its masks are cut at .5, for which the label generator is calibrated.

    Raises:
        SbmError: if there is none, or its files are missing or damaged.
    """
    weights = run_weights(name)
    stamp = weights.stat() if weights.is_file() else None
    return _loaded(name, stamp and (stamp.st_mtime_ns, stamp.st_size))


@lru_cache(maxsize=2)
def _loaded(name: str, stamp: tuple[int, int] | None) -> Detector:
    return load_detector(name, mask_threshold=MASK_THRESHOLD)


def load_named_network(name: str):
    """The network (labeling.detectors.networks.mask_rcnn.Network) of a detector that is one, to use or to train, and
    its digest.

    Raises:
        UsageError: if this detector is no network of ours.
        DetectorError: if its weights are missing or damaged.
    """
    from labeling.detectors.networks.weights import load_network
    from labeling.training.weights import file_digest

    check_name(name)
    if name == "maskrcnn_resnet50_fpn":
        from labeling.detectors.networks.coco_weights import load_coco_network

        return load_coco_network(), "torchvision COCO_V1"
    if name == "compact":
        if not COMPACT_FILE.is_file():
            raise DetectorError(
                f"{COMPACT_FILE}: the weights of compact are missing; python -m experiments.pretrain_compact makes them"
            )
        return load_network(COMPACT_FILE), file_digest(COMPACT_FILE)
    if is_run(name):
        path = run_weights(name)
        return load_network(path), file_digest(path)
    raise UsageError(f"{name} cannot be trained here; these can: {', '.join(NAMES)}, {KINDS[-1]}")


def detector_digest(name: str) -> str:
    """The ``digest`` of a detector; a network's is found without reading the network.

    Args:
        name: one of ``KINDS``.

    Raises:
        UsageError: if there is no such detector.
        DetectorError: if its files are missing or damaged.
    """
    from labeling.training.weights import file_digest

    check_name(name)
    path = COMPACT_FILE if name == "compact" else run_weights(name)
    return file_digest(path) if path.is_file() else load_detector(name).digest


def is_run(name: str) -> bool:
    """Whether this is the folder of a fine-tuning run, or the file of a network."""
    return run_weights(name).is_file()


def run_weights(name: str) -> Path:
    """Where the weights of a run lie."""
    from labeling.training.config import WEIGHTS_FILE

    path = Path(name)
    return path if path.suffix == ".safetensors" else path / WEIGHTS_FILE


def choose_device(device: str | None = None) -> str:
    """The device asked for, or the fastest there is.

    Raises:
        UsageError: if there is no such device.
    """
    import torch

    chosen = device or ("cuda" if torch.cuda.is_available() else "cpu")
    try:
        torch.zeros(1, device=chosen)
    except (RuntimeError, AssertionError) as error:
        from labeling.detectors.adapters.function import first_line

        raise UsageError(f"--device {chosen}: cannot be used ({first_line(error)})") from None
    return chosen
