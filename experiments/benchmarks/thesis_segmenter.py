"""The thesis' way to segment an episode, with the libraries it used: what the label generator's speed is measured by.

Per object a support vector machine with Platt scaling (scikit-learn's ``SVC(probability=True)``) and a dense CRF
(pydensecrf). Voxels, objects, kernels, drawing and files are ours, so that only these two differ.
"""

import importlib.util
import warnings
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32

from labeling.core.episode_labels import Scale
from labeling.core.errors import SbmError
from labeling.generator.cloud.voxel_cloud import Cloud
from labeling.generator.objects.association import Candidate
from labeling.generator.settings.label_config import LabelConfig
from labeling.runtime.extras import how_to_install

SAMPLES = 300
SURE = 0.99
"""Probability given to the seeds. Source: field notes (published code)."""


def check_installed() -> None:
    """Checks that the baseline is there.

    Raises:
        SbmError: saying what to install.
    """
    if importlib.util.find_spec("pydensecrf") is None:
        raise SbmError(f"this bench needs pydensecrf, which is built with g++: {how_to_install('bench')}")


@dataclass(frozen=True)
class ThesisSegmenter:
    """Takes the place of the label generator's own segmentation."""

    crop_m: float = np.inf
    """Points further than this from the object's seeds stay out (the published code: 1 m; the thesis tells none)."""

    def __call__(
        self, cloud: Cloud, candidates: list[Candidate], scale: Scale, config: LabelConfig
    ) -> tuple[list[Candidate], Float32[np.ndarray, "n k"]]:
        """Probability of every object at every point, each object on its own."""
        probability = np.zeros((cloud.num_points, len(candidates)), np.float32)
        for k, candidate in enumerate(candidates):
            self._one(cloud, candidate, scale, config, np.random.default_rng([config.seed, k]), probability[:, k])
        return candidates, probability

    def _one(self, cloud: Cloud, candidate: Candidate, scale: Scale, config: LabelConfig, rng, probability) -> None:
        front = np.flatnonzero(candidate.votes_for > candidate.votes_against)
        seeds = cloud.points[front]
        middle = np.median(seeds, axis=0)
        half = np.quantile(np.abs(seeds - middle), 0.98, axis=0) + self.crop_m
        near = np.all(np.abs(cloud.points - middle) <= half, axis=1)
        back = np.flatnonzero(near & (candidate.votes_against >= candidate.votes_for) & (candidate.votes_against > 0))
        if len(back) == 0:
            probability[front] = SURE
            return
        rim = np.zeros(cloud.num_points, bool)
        for source in candidate.sources:
            rim[source.hard_negatives] = True
        hard = _sample(back[rim[back]], SAMPLES // 2, rng)
        chosen = [_sample(front, SAMPLES, rng), hard, _sample(back, SAMPLES - len(hard), rng)]
        features = np.concatenate([cloud.colours, cloud.points - middle], axis=1)[near]
        row = np.cumsum(near) - 1
        labels = np.repeat([1, 0, 0], [len(part) for part in chosen])
        chance = _svm(features, row[np.concatenate(chosen)], labels)
        chance[row[front[near[front]]]], chance[row[back]] = SURE, 1 - SURE
        probability[near] = _dense_crf(chance, cloud, near, scale, config)


def _svm(features, training, labels) -> np.ndarray:
    """Probability of the object at all rows, from some of them."""
    from sklearn.preprocessing import StandardScaler
    from sklearn.svm import SVC

    scaler = StandardScaler().fit(features[training])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FutureWarning)  # SVC(probability=True) is deprecated; the thesis used it
        machine = SVC(C=1.0, gamma="auto", probability=True, random_state=0)  # pyright: ignore[reportArgumentType]
        machine.fit(scaler.transform(features[training]), labels)
        return machine.predict_proba(scaler.transform(features))[:, 1]


def _dense_crf(chance, cloud: Cloud, near, scale: Scale, config: LabelConfig) -> np.ndarray:
    import pydensecrf.densecrf as dense  # pyright: ignore[reportMissingImports]  (of the bench extra)

    held = np.clip(chance, 1 - SURE, SURE)
    points, colours = cloud.points[near], cloud.colours[near]
    appearance = np.concatenate(
        [points / (config.appearance_width * scale.object_m), colours / config.appearance_colour], axis=1
    )
    smoothness = points / (config.smoothness_width_voxels * cloud.voxel_m)
    field = dense.DenseCRF(len(points), 2)
    field.setUnaryEnergy(np.ascontiguousarray(-np.log([1 - held, held]), np.float32))
    for features, weight in ((appearance, config.appearance_weight), (smoothness, config.smoothness_weight)):
        field.addPairwiseEnergy(np.ascontiguousarray(features.T, np.float32), compat=float(weight))
    return np.array(field.inference(config.iterations))[1]


def _sample(members, count: int, rng):
    return rng.choice(members, min(count, len(members)), replace=False)
