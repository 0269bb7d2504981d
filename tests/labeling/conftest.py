"""Small datasets and label sets with known figures."""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from labeling.core.episode import Episode
from labeling.core.geometry import intrinsics_from_fov, look_at
from labeling.core.masks import box_xywh
from labeling.core.rle import encode_mask
from labeling.core.types import Detection, GroundTruth
from labeling.io.episodes import write_episode
from labeling.runtime import threads

HEIGHT_PX, WIDTH_PX = 24, 32


@pytest.fixture
def threads_told(monkeypatch: pytest.MonkeyPatch) -> Callable[[int], None]:
    """Says how many threads there are, as ``NUMBA_NUM_THREADS`` would.

    That variable is numba's, too: what is compiled while another number stands there begins so many threads, and
    nothing can be compiled any more when the number is as it was.
    """
    told = threads._told

    def tell(count: int) -> None:
        monkeypatch.setattr(threads, "_told", lambda name: count if name == "NUMBA_NUM_THREADS" else told(name))

    return tell


def rectangle(top: int, left: int, height: int, width: int) -> np.ndarray:
    mask = np.zeros((HEIGHT_PX, WIDTH_PX), bool)
    mask[top : top + height, left : left + width] = True
    return mask


@dataclass
class Scene:
    """A dataset on disk, and beside it a label set; both may be changed and written again."""

    root: Path
    episodes: dict[str, Episode] = field(default_factory=dict)

    @property
    def dataset(self) -> Path:
        return self.root / "dataset"

    @property
    def labels(self) -> Path:
        return self.root / "labels"

    def add_episode(self, name: str, **changes: Any) -> Episode:
        """Two views of a chair and a plant: the detector outlines half of each, and sees a chair that is not there."""
        chair, plant = rectangle(2, 2, 8, 8), rectangle(10, 20, 8, 8)
        rng = np.random.default_rng(len(self.episodes))
        views = range(2)
        episode = Episode(
            name=name,
            rgb=rng.integers(0, 256, (2, HEIGHT_PX, WIDTH_PX, 3), dtype=np.uint8),
            depth_m=np.ones((2, HEIGHT_PX, WIDTH_PX), np.float32),
            intrinsics=np.stack([intrinsics_from_fov(WIDTH_PX, HEIGHT_PX, 1.0)] * 2),
            camera_to_world=np.stack([look_at(np.array([0.0, v, 1]), np.array([1.0, v, 1])) for v in views]),
            file_names=("rgb/000.png", "rgb/001.png"),
            detections=tuple(
                detection
                for view in views
                for detection in (
                    Detection(view, "chair", 0.9, rectangle(2, 2, 8, 4)),
                    Detection(view, "plant", 0.8, rectangle(10, 20, 4, 8)),
                    Detection(view, "chair", 0.3, rectangle(0, 28, 3, 3)),
                )
            ),
            ground_truth=tuple(
                truth
                for view in views
                for truth in (GroundTruth(view, 1, "chair", chair), GroundTruth(view, 2, "plant", plant))
            ),
            categories=("chair", "plant"),
        )
        episode = replace(episode, **changes)
        self.episodes[name] = episode
        write_episode(self.dataset / name, episode)
        return episode

    def write_labels(
        self,
        modal: Callable[[GroundTruth], tuple[str, float, np.ndarray] | None] = lambda truth: (
            truth.category,
            0.9,
            truth.modal,
        ),
        amodal: Callable[[GroundTruth], tuple[str, float, np.ndarray] | None] | None = None,
        names: Sequence[str] | None = None,
        summary: dict[str, Any] | None = None,
    ) -> None:
        """Writes labels made from the ground truth; by default a perfect copy of it."""
        self.labels.mkdir(exist_ok=True)
        names = list(self.episodes) if names is None else names
        keys = [(name, view) for name in names for view in range(2)]
        images = [
            {
                "id": 10 + number,
                "file_name": f"{name}/rgb/{view:03d}.png",
                "width": WIDTH_PX,
                "height": HEIGHT_PX,
                "episode": name,
                "view": view,
            }
            for number, (name, view) in enumerate(keys)
        ]
        for kind, make in (("modal", modal), ("amodal", amodal or modal)):
            ids: dict[str, int] = {}
            annotations = []
            for name in names:
                for truth in self.episodes[name].ground_truth or ():
                    made = make(truth)
                    if made is None:
                        continue
                    category, score, mask = made
                    annotations.append(
                        {
                            "id": len(annotations) + 1,
                            "image_id": 10 + keys.index((name, truth.view_index)),
                            "category_id": ids.setdefault(category, len(ids) + 1),
                            "segmentation": encode_mask(mask),
                            "bbox": list(box_xywh(mask)),
                            "area": int(mask.sum()),
                            "iscrowd": 0,
                            "score": score,
                            "instance_id": truth.instance_id,
                            "source_image_id": 10,
                            "source_score": 0.9,
                        }
                    )
            categories = [{"id": number, "name": name} for name, number in ids.items()]
            content = {"info": {}, "images": images, "categories": categories, "annotations": annotations}
            (self.labels / f"instances_{kind}.json").write_text(json.dumps(content))
        default = {"schema_version": 1, "dataset": "../dataset", "config": {"confident": 0.9}}
        (self.labels / "label_set.json").write_text(json.dumps(default if summary is None else summary))


@pytest.fixture
def scene(tmp_path) -> Scene:
    """A scene without any episode yet."""
    return Scene(tmp_path)
