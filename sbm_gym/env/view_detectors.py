"""What looks at views on the robot's behalf: the simulated detector, or any detector of ``labeling.detectors``."""

import functools
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from jaxtyping import Int32

from labeling.core.detector import Detector
from labeling.core.types import Detection
from labeling.core.views import Camera
from sbm_gym.detection.fitted_settings import fitted_digest, fitted_settings
from sbm_gym.detection.simulated import SimulatedDetector, SimulatedDetectorConfig, SimulatedView
from sbm_gym.rendering.base import Frame
from sbm_gym.scenes.compiled import Scene
from sbm_gym.scenes.profiles import WorldProfile

SIMULATED, SIMULATED_WEAK, SIMULATED_LIKE = "simulated", "simulated_weak", "simulated:"
WEAKER_LOGIT, WEAK_SPREAD = 1.9, 1.0
"""How much less sure the weak simulated detector is, and how much that differs from episode to episode. Chosen so that
``spin`` confirms about as many objects as it does with ``compact`` in training homes."""


@dataclass(frozen=True)
class View:
    """A picture and what the simulator knows about it."""

    frame: Frame
    instance_map: Int32[np.ndarray, "h w"]
    """Instance id of every pixel, 0 for none."""
    camera: Camera


class ViewDetector(Protocol):
    """Detects objects in views of a scene."""

    name: str
    """What calibrations of detectors know it by; a simulated one that is fitted to a real one has the name of that."""
    needs_detail: bool
    """Whether it looks at large, smooth pictures; else at those of the observation."""

    @property
    def categories(self) -> tuple[str, ...]:
        """What it can say, as far as it is known."""
        ...

    def detect(self, scene: Scene, view: View, step_index: int, entropy: int) -> list[Detection]:
        """Detections of one view; the same view, step and entropy give the same detections.

        Args:
            scene: in which the view was taken; its camera has not moved since.
            view: the view.
            step_index: number of the step, which becomes the detections' view index.
            entropy: seeds an episode's noise.
        """
        ...


class SimulatedViewDetector:
    """The simulated detector, which is told what is in view. Looking twice at a view is no help."""

    needs_detail = False

    def __init__(self, config: SimulatedDetectorConfig, name: str) -> None:
        self.name = name
        self._detector = SimulatedDetector(config)
        self._spread = config.episode_sigma > 0.0
        self.categories = config.categories

    def detect(self, scene: Scene, view: View, step_index: int, entropy: int) -> list[Detection]:
        """See ``ViewDetector``."""
        observed = scene.surfaces.observe(view.instance_map, view.camera)
        luck = float(np.random.default_rng([entropy, 0, 1]).normal()) if self._spread else 0.0
        seen = SimulatedView(
            step_index, view.instance_map, view.frame.depth_m, tuple(observed), luck, view.camera, scene.name
        )
        return self._detector.detect(np.random.default_rng([entropy, step_index]), seen)


class PictureDetector:
    """A real detector: it gets colour and depth, and nothing that the simulator knows."""

    needs_detail = True

    def __init__(self, name: str, load: bool = True) -> None:
        """Loads a detector, or has it wait until it is asked for.

        Args:
            name: what ``labeling.detectors.registry`` knows.
            load: now.
        """
        self.name = name
        if load:
            _ = self._detector

    @functools.cached_property
    def _detector(self) -> Detector:
        from labeling.detectors.registry import detector_by_name

        return detector_by_name(self.name)

    @property
    def categories(self) -> tuple[str, ...]:
        """What it can say, as far as it is known."""
        return self._detector.categories or ()

    def detect(self, scene: Scene, view: View, step_index: int, entropy: int) -> list[Detection]:
        """See ``ViewDetector``.

        Raises:
            DetectorError: if the detector fails.
        """
        found = self._detector.detect(view.frame.rgb[None], view.frame.depth_m[None])
        return list(found[0].as_detections(step_index))


def make_detector(detector: str | SimulatedDetectorConfig, profile: WorldProfile, load: bool = True) -> ViewDetector:
    """The detector that an env was asked for.

    Args:
        detector: "simulated", "simulated_weak", "simulated:NAME" for the simulated detector with settings that are
            fitted to a real one, settings of the simulated detector, or what ``labeling.detectors.registry`` knows.
        profile: of the kind of world.
        load: read a real one's weights now, not when it is first asked for something.

    Raises:
        ValueError: if there is no such detector, naming those there are.
        DetectorError: if its files are missing or damaged.
    """
    if isinstance(detector, SimulatedDetectorConfig):
        return SimulatedViewDetector(detector, SIMULATED)
    if not isinstance(detector, str):
        raise ValueError(f"detector is a name or a SimulatedDetectorConfig, not {detector!r}")
    fitting = profile.detector
    if detector == SIMULATED:
        return SimulatedViewDetector(fitting, SIMULATED)
    if detector.startswith(SIMULATED_LIKE):
        real = calibrated_as(detector)
        return SimulatedViewDetector(fitted_settings(real, profile.kind, fitting), real)
    if detector == SIMULATED_WEAK:
        weaker = replace(fitting, base_logit=fitting.base_logit - WEAKER_LOGIT, episode_sigma=WEAK_SPREAD)
        return SimulatedViewDetector(weaker, SIMULATED_WEAK)
    from labeling.core.errors import UsageError
    from labeling.detectors.registry import check_name

    try:
        check_name(detector)
    except UsageError as error:
        raise ValueError(
            f"{error}, {SIMULATED}, {SIMULATED_WEAK}, {SIMULATED_LIKE}NAME, or a SimulatedDetectorConfig"
        ) from None
    return PictureDetector(detector, load)


def calibrated_as(name: str) -> str:
    """The name by which calibrations know a detector: of a simulated one that is fitted to a real one, that one's.

    >>> calibrated_as("simulated:compact"), calibrated_as("simulated_weak"), calibrated_as("onnx:net.onnx")
    ('compact', 'simulated_weak', 'onnx:net.onnx')
    """
    return name.removeprefix(SIMULATED_LIKE)


def digest_of_detector(name: str) -> str:
    """Changes with the weights of a real detector, and with the settings that make the simulated one like it.

    Raises:
        SbmError: if there is no such detector, or its files are missing or damaged.
    """
    if name.startswith(SIMULATED_LIKE):
        return fitted_digest(calibrated_as(name))
    if is_simulated(name):
        return ""
    from labeling.detectors.registry import detector_by_name

    return detector_by_name(name).digest  # which is at hand where an environment looks with it


def is_simulated(detector: str | SimulatedDetectorConfig) -> bool:
    """Whether this names a simulated detector."""
    return (
        not isinstance(detector, str) or detector in (SIMULATED, SIMULATED_WEAK) or detector.startswith(SIMULATED_LIKE)
    )
