"""Settings of the simulated detector that make it like a real one, fitted by ``python -m sbm_gym.fit_simulated``.

One JSON file for each detector and kind of world. What is not in a file is as in the kind's own settings.
"""

import hashlib
from dataclasses import asdict, replace
from functools import cache
from pathlib import Path
from typing import Any

import msgspec

from labeling.generator.calibration.detector_calibration import file_name
from sbm_gym.detection.lasting_phantoms import LastingPhantoms
from sbm_gym.detection.simulated import CategoryTraits, SimulatedDetectorConfig

FOLDER = Path(__file__).parent / "fitted"
FITTED = ("base_logit", "size_gain", "good_size", "hidden_penalty", "truncated_penalty", "above_penalty_per_rad")
FITTED += ("model_sigma", "object_sigma", "viewpoint_sigma", "pose_sigma", "frame_sigma", "confusion")
FITTED += ("phantoms_per_view", "traits", "lasting_phantoms")
"""Settings that a file holds."""


def fitted_detectors(kind: str) -> tuple[str, ...]:
    """The detectors that settings have been fitted to, in a kind of world."""
    return tuple(sorted(path.stem.rpartition("_")[0] for path in FOLDER.glob(f"*_{kind}.json")))


def settings_file(folder: Path, detector: str, kind: str) -> Path:
    """The file of a detector, whose own name may be a path, and a kind of world."""
    return folder / f"{Path(file_name(detector)).stem}_{kind}.json"


def fitted_digest(detector: str) -> str:
    """Changes with the settings that are fitted to a detector, in any kind of world."""
    files = (settings_file(FOLDER, detector, kind) for kind in ("indoor", "outdoor"))
    return hashlib.sha256(b"".join(file.read_bytes() for file in files if file.is_file())).hexdigest()


@cache
def _content(detector: str, kind: str) -> dict[str, Any]:
    return msgspec.json.decode(settings_file(FOLDER, detector, kind).read_bytes())["settings"]


def fitted_settings(detector: str, kind: str, fitting: SimulatedDetectorConfig) -> SimulatedDetectorConfig:
    """Settings that make the simulated detector like a real one.

    Args:
        detector: name of the real one.
        kind: of world, "indoor" or "outdoor".
        fitting: the kind's own settings.

    Raises:
        ValueError: if none have been fitted, naming those that have.
    """
    if not settings_file(FOLDER, detector, kind).is_file():
        known = ", ".join(fitted_detectors(kind)) or "none"
        raise ValueError(
            f"the simulated detector has not been fitted to {detector!r} in {kind} worlds (it has to: {known}); "
            "python -m sbm_gym.fit_simulated does that"
        )
    content = dict(_content(detector, kind))
    content["traits"] = msgspec.convert(content["traits"], dict[str, CategoryTraits])
    content["lasting_phantoms"] = msgspec.convert(content["lasting_phantoms"], LastingPhantoms)
    return replace(fitting, **content)


def as_json(settings: SimulatedDetectorConfig) -> dict[str, Any]:
    """The fitted settings as a file holds them, numbers rounded to four digits."""
    found = {name: value for name, value in asdict(settings).items() if name in FITTED}
    return _rounded(found)


def _rounded(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _rounded(one) for name, one in value.items()}
    if isinstance(value, list | tuple):
        return [_rounded(one) for one in value]
    return round(value, 4) if isinstance(value, float) else value
