"""3-D detectors by name."""

from pathlib import Path

from labeling.core.errors import UsageError
from labeling.detectors3d.base import Detector3d

LDLS = "ldls"


def load_detector_3d(name: str, device: str | None = None) -> Detector3d:
    """Loads a 3-D detector.

    Args:
        name: ``ldls``, or the folder of a ``labeling.train3d`` run.
        device: cpu, cuda, ...; by default a GPU if there is one.

    Raises:
        SbmError: if there is none by this name, or its files are damaged.
    """
    if name == LDLS:
        from labeling.detectors3d.ldls import Ldls

        return Ldls()
    if not Path(name).is_dir():
        raise UsageError(f"there is no 3-D detector {name!r}; give {LDLS}, or the folder of a labeling.train3d run")
    from labeling.detectors.registry import choose_device
    from labeling.detectors3d.frustum_detector import FrustumDetector, load_network
    from labeling.training.config import WEIGHTS_FILE
    from labeling.training.weights import file_digest

    path = Path(name) / WEIGHTS_FILE
    return FrustumDetector(load_network(path), name, file_digest(path), choose_device(device))
