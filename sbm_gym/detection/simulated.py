"""A stochastic model of an object detector, driven by what the simulator knows. Always named "simulated" in results.

It behaves like a network pre-trained on photographs: sure of itself where objects are large, unhidden, whole and seen
from the front; unsure, confused and sloppy from behind, from above, far away, cut off or half hidden. What makes a view
hard belongs to the object and the viewpoint, not to the moment: bias per model and object and smooth noise over
viewpoints mean that looking again from the same place does not help, while moving does.

Its settings can be fitted to a real detector (``python -m sbm_gym.fit_simulated``), so that policies learn on what is
like it at a tenth of the cost.
"""

import hashlib
import tomllib
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int

from labeling.core.types import Detection
from labeling.core.views import Camera
from sbm_gym.detection.lasting_phantoms import LastingPhantoms, background_cells
from sbm_gym.detection.mask_noise import corrupt_mask, phantom_mask
from sbm_gym.detection.visibility import ObservedObject


@dataclass(frozen=True)
class CategoryTraits:
    """What the simulated detector finds hard about a category."""

    bias: float = 0.0
    """Added to the logit of confidence."""
    behind: float = 2.0
    """Taken from the logit when seen exactly from behind; 0 for things without a front."""
    mistaken_for: tuple[str, ...] = ()
    """Categories it is confused with, most likely first."""


DEFAULT_TRAITS = CategoryTraits()
SAME_PLACE = 0.25
"""Views from places nearer to each other than this share of ``range_unit_m`` have the same noise per pose."""
_TABLE = tomllib.loads(Path(__file__).with_name("traits.toml").read_text(encoding="utf-8"))
TRAITS = {
    category: CategoryTraits(entry["bias"], entry["behind"], tuple(entry["mistaken_for"]))
    for category, entry in _TABLE.items()
}


@dataclass(frozen=True)
class SimulatedDetectorConfig:
    """Settings of the simulated detector. Logits are of confidence; the defaults are calibrated on furnished rooms."""

    seed: int = 0
    """Which detector of the kind: decides the biases per model and object and the noise over viewpoints."""
    base_logit: float = 2.2
    """Of an object of good size, whole, unhidden, from the front, without luck or bad luck."""
    size_gain: float = 1.5
    """Per halving of apparent size below ``good_size``."""
    good_size: float = 0.22
    """Square root of the share of the picture that an object of good size fills."""
    hidden_penalty: float = 6.0
    """When nearly everything of the object is hidden."""
    truncated_penalty: float = 4.0
    """When nearly everything of the object is outside the picture."""
    above_penalty_per_rad: float = 5.0
    """For every radian of elevation above ``easy_elevation_rad``."""
    easy_elevation_rad: float = 0.35
    """Photographs are taken from up to about 20 degrees above an object's centre."""
    model_sigma: float = 1.0
    """Spread of the bias per furniture model."""
    object_sigma: float = 0.4
    """Spread of the bias per object."""
    viewpoint_sigma: float = 2.0
    """Spread of the smooth noise over viewpoints."""
    range_unit_m: float = 1.0
    """Distance over which the noise over viewpoints changes; views of larger things change more slowly."""
    episode_sigma: float = 0.0
    """Spread of a bias per episode, for policies that are to get along with detectors of different strength."""
    frame_sigma: float = 0.3
    """Spread of the noise per frame."""
    min_confidence: float = 0.05
    """Detections below are not reported."""
    min_area_share: float = 1e-3
    """Visible parts smaller than this share of the picture are never detected (7 of 84x84 pixels)."""
    phantoms_per_view: float = 0.7
    """Mean number of false positives on nothing in a view."""
    confident_phantom_share: float = 0.02
    """Share of them with a confidence of .9 or more."""
    duplicate_share: float = 0.15
    """Probability of a second, less confident detection of the same object under another category."""
    categories: tuple[str, ...] = ("chair", "couch", "plant", "tv", "fridge", "bed", "table", "toilet")
    """What it was trained on: objects of other categories are missed or mistaken for these."""
    confusion: float = 0.75
    """Probability of a wrong category where confidence is next to nothing; it falls as confidence rises."""
    pose_sigma: float = 0.0
    """Spread of the noise per pose: a step or a turn aside changes it, another look at the same view does not."""
    traits: Mapping[str, CategoryTraits] = field(default_factory=lambda: TRAITS)
    """What is hard about each category."""
    lasting_phantoms: LastingPhantoms | None = None
    """Parts of the scene that are taken for objects from many views, in scenes that have a name."""

    def __post_init__(self) -> None:
        if not self.categories:
            raise ValueError("categories of the simulated detector: name at least one")


@dataclass(frozen=True)
class SimulatedView:
    """What the simulated detector gets to see."""

    view_index: int
    instance_map: Int[np.ndarray, "h w"]
    """Instance id of every pixel, 0 for none."""
    depth_m: Float[np.ndarray, "h w"]
    objects: tuple[ObservedObject, ...] = field(default_factory=tuple)
    """From ``ObjectSurfaces.observe``."""
    episode_luck: float = 0.0
    """Standard normal number of the episode, for ``episode_sigma``."""
    camera: Camera | None = None
    """Of the view, for lasting phantoms."""
    scene: str = ""
    """Name of the scene, for lasting phantoms."""


class SimulatedDetector:
    """Detects objects in views of simulated worlds; the same generator state gives the same detections."""

    def __init__(self, config: SimulatedDetectorConfig | None = None) -> None:
        """Makes a detector.

        Args:
            config: None takes the defaults.
        """
        self.config = config or SimulatedDetectorConfig()

    def detect(self, rng: np.random.Generator, view: SimulatedView) -> list[Detection]:
        """Detections of one view, most confident first.

        Noise is drawn per object, so that the same generator gives about the same confidences at any resolution and
        whatever else is in view.

        Args:
            rng: noise per frame; one number is drawn from it.
            view: the view.
        """
        entropy = int(rng.integers(2**62))
        detections = []
        for observed in view.objects:
            detections += self._detect_object(np.random.default_rng([entropy, observed.instance_id]), view, observed)
        detections += self._phantoms(np.random.default_rng([entropy]), view)
        detections += self._lasting_phantoms(view)
        return sorted(detections, key=lambda detection: -detection.confidence)

    def logit(self, observed: ObservedObject, area_share: float) -> float:
        """Logit of confidence without the noise per frame.

        Args:
            observed: the object.
            area_share: share of the picture that its visible part covers, above 0.
        """
        c, traits = self.config, self.config.traits.get(observed.category, DEFAULT_TRAITS)
        bias_model = _constant(c.seed, observed.model_key) * c.model_sigma
        bias_object = _constant(c.seed, observed.object_key) * c.object_sigma
        too_small = max(0.0, np.log2(c.good_size / np.sqrt(area_share)))
        logit = c.base_logit + traits.bias + bias_model + bias_object
        logit += c.viewpoint_sigma * _viewpoint_noise(
            c.seed, observed.object_key + "/confidence", observed, c.range_unit_m
        )
        logit -= c.size_gain * too_small
        logit -= c.hidden_penalty * max(0.0, 1.0 - observed.visible_share / 0.9) ** 1.3
        logit -= c.truncated_penalty * observed.truncated_share**1.5
        logit -= traits.behind * (0.5 * (1.0 - np.cos(observed.azimuth_rad))) ** 1.5
        logit -= c.above_penalty_per_rad * max(0.0, observed.elevation_rad - c.easy_elevation_rad)
        return float(logit)

    def _detect_object(self, rng, view: SimulatedView, observed: ObservedObject) -> list[Detection]:
        c = self.config
        mask = view.instance_map == observed.instance_id
        area_share = np.count_nonzero(mask) / mask.size
        if area_share < c.min_area_share:
            return []
        logit = self.logit(observed, area_share) + c.episode_sigma * view.episode_luck + c.frame_sigma * rng.normal()
        if c.pose_sigma > 0.0:
            logit += c.pose_sigma * _pose_noise(c.seed, observed, mask, SAME_PLACE * c.range_unit_m)
        confidence = _sigmoid(logit)
        duplicate, duplicate_confidence = rng.random() < c.duplicate_share, rng.uniform(0.2, 0.8)
        known = observed.category in c.categories
        if not known:
            confidence *= 0.5
        if confidence < c.min_confidence:
            return []
        # How likely the category and how poor the mask are follow confidence, as they do in a calibrated network,
        # and stay the same from one viewpoint to the next.
        luck = _normal_cdf(_viewpoint_noise(c.seed, observed.object_key + "/category", observed, c.range_unit_m))
        wrong = luck < 0.02 + c.confusion * (1.0 - confidence) ** 1.5
        poor = _normal_cdf(_viewpoint_noise(c.seed, observed.object_key + "/mask", observed, c.range_unit_m))
        error = min(max(1.5 * (1.0 - confidence) + 0.35 * (poor - 0.5), 0.0), 1.0)
        others = self._other_categories(observed)
        if not known and not others:
            return []
        category = others[0] if others and (wrong or not known) else observed.category
        found = [self._detection(rng, view, mask, category, confidence, error)]
        if duplicate and len(others) > 1:
            second = observed.category if (wrong and known) else others[1]
            found.append(self._detection(rng, view, mask, second, confidence * duplicate_confidence, error))
        return [d for d in found if d is not None and d.confidence >= c.min_confidence]

    def _other_categories(self, observed: ObservedObject) -> list[str]:
        """What the object may be mistaken for, in an order of the object's own."""
        c, traits = self.config, self.config.traits.get(observed.category, DEFAULT_TRAITS)
        likely = [name for name in traits.mistaken_for if name in c.categories]
        if len(likely) > 1 and _constant(c.seed, observed.object_key + "/order") > 0.7:
            likely[0], likely[1] = likely[1], likely[0]
        return likely + [name for name in c.categories if name not in likely and name != observed.category]

    @staticmethod
    def _detection(rng, view, mask, category: str, confidence: float, error: float) -> Detection | None:
        drawn = corrupt_mask(rng, mask, view.depth_m, error)
        if not drawn.any():
            return None
        return Detection(view.view_index, category, min(max(confidence, 0.0), 1.0), drawn)

    def _phantoms(self, rng, view: SimulatedView) -> list[Detection]:
        c, found = self.config, []
        for _ in range(int(rng.poisson(c.phantoms_per_view))):
            sure = rng.random() < c.confident_phantom_share
            confidence = float(rng.uniform(0.9, 0.97) if sure else min(0.05 + rng.exponential(0.18), 0.88))
            category = str(c.categories[int(rng.integers(len(c.categories)))])
            mask = phantom_mask(rng, view.depth_m)
            if np.count_nonzero(mask) >= c.min_area_share * mask.size:
                found.append(Detection(view.view_index, category, confidence, mask))
        return found

    def _lasting_phantoms(self, view: SimulatedView) -> list[Detection]:
        c, found = self.config, []
        phantoms = c.lasting_phantoms
        if phantoms is None or view.camera is None or not view.scene:
            return []
        eye_m, ahead = view.camera.camera_to_world[:3, 3], view.camera.camera_to_world[:3, 2]
        pose = f"{_rounded(eye_m, SAME_PLACE * c.range_unit_m)}/{_rounded(ahead, 0.25)}"
        cells = background_cells(
            view.depth_m, view.instance_map, view.camera, phantoms.cell_m, phantoms.heights_m, c.min_area_share
        )
        for cell, mask in cells:
            key = f"{view.scene}/{cell}"
            logit = phantoms.logit(_constant(c.seed, key), np.count_nonzero(mask) / mask.size)
            logit += phantoms.pose_sigma * _hashed_normal(c.seed, f"{key}/{pose}")
            confidence = _sigmoid(logit + c.episode_sigma * view.episode_luck)
            if confidence >= c.min_confidence:
                category = phantoms.category(_hashed_uniform(c.seed, f"{key}/category"))
                found.append(Detection(view.view_index, category, confidence, mask))
        return found


def _sigmoid(logit: float) -> float:
    return float(1.0 / (1.0 + np.exp(-logit)))


def _normal_cdf(value: float) -> float:
    """Close enough for deciding luck: the logistic approximation of the normal distribution."""
    return _sigmoid(1.702 * value)


def _rng(seed: int, key: str) -> np.random.Generator:
    """A generator that is the same in every process, which Python's own ``hash`` of text is not."""
    return np.random.default_rng((seed, zlib.crc32(key.encode())))


@lru_cache(maxsize=4096)
def _constant(seed: int, key: str) -> float:
    """A standard normal number that belongs to a key."""
    return float(_rng(seed, key).normal())


def _hashed_uniform(seed: int, key: str) -> float:
    """A number in (0, 1) that belongs to a key; far cheaper than a generator of its own."""
    digest = hashlib.blake2b(f"{seed}/{key}".encode(), digest_size=8).digest()
    return (int.from_bytes(digest, "little") + 0.5) / 2.0**64


def _hashed_normal(seed: int, key: str) -> float:
    """About a standard normal number that belongs to a key: the logistic approximation of the normal distribution."""
    share = _hashed_uniform(seed, key)
    return float(np.log(share / (1.0 - share))) / 1.702


def _rounded(values: Float[np.ndarray, "n"], unit: float) -> str:
    return ",".join(str(round(value / unit)) for value in values.tolist())


def _pose_noise(seed: int, observed: ObservedObject, mask: Bool[np.ndarray, "h w"], unit_m: float) -> float:
    """Noise that belongs to where an object is seen from, to ``unit_m``, and where in the picture it is."""
    place_m = observed.range_m * np.array([np.cos(observed.azimuth_rad), np.sin(observed.azimuth_rad)])
    columns = np.flatnonzero(mask.any(axis=0))
    middle = (columns[0] + columns[-1]) / (2.0 * mask.shape[1])
    return _hashed_normal(seed, f"{observed.object_key}/{_rounded(place_m, unit_m)}/{round(6.0 * middle)}")


@lru_cache(maxsize=4096)
def _waves(seed: int, key: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = _rng(seed, key)
    amplitude = rng.normal(size=5) * np.array([1.0, 0.9, 0.7, 0.5, 0.6])
    return amplitude, rng.uniform(0.0, 2.0 * np.pi, 5), rng.uniform(0.5, 1.5, 5)


def _viewpoint_noise(seed: int, key: str, observed: ObservedObject, unit_m: float = 1.0) -> float:
    """Smooth noise of zero mean and about unit variance over the directions and distances an object is seen from."""
    amplitude, phase, rate = _waves(seed, key)
    azimuth, metres = observed.azimuth_rad, observed.range_m / unit_m
    angles = np.array([azimuth, 2.0 * azimuth, 3.0 * azimuth, 5.0 * azimuth, 0.0]) + phase + rate * 1.5 * metres
    # The variance of cos is 1/2; the amplitudes' squares sum to 2.8 on average over keys, hence 1.4.
    return float(amplitude @ np.cos(angles)) / np.sqrt(1.455)
