"""Pictures of boxes and balls, cheap to make and easy to learn."""

import json
from pathlib import Path

import cv2
import numpy as np

from labeling.core.rle import encode_mask
from labeling.detectors.data.augment_config import AugmentConfig

CATEGORIES = ("ball", "box")
NO_AUGMENTATION = AugmentConfig(flip=0.0, scale=(1.0, 1.0), crop=0.0, colour=0.0, blur=0.0, noise=0.0)


def draw(seed: int, side: int = 64, objects: int = 2) -> tuple[np.ndarray, list[tuple[str, np.ndarray]]]:
    """A picture and what is in it, in separate quarters so that nothing overlaps."""
    rng = np.random.default_rng(seed)
    rgb = rng.integers(0, 90, (side, side, 3)).astype(np.uint8)
    found = []
    for quarter in rng.permutation(4)[:objects]:
        centre = np.array([quarter % 2, quarter // 2]) * side // 2 + side // 4 + rng.integers(-2, 3, 2)
        radius = int(rng.integers(side // 8, side // 5))
        mask = np.zeros((side, side), np.uint8)
        category = CATEGORIES[int(rng.integers(2))]
        if category == "ball":
            cv2.circle(mask, (int(centre[0]), int(centre[1])), radius, 1, -1)
        else:
            low, high = centre - radius, centre + radius
            cv2.rectangle(mask, (int(low[0]), int(low[1])), (int(high[0]), int(high[1])), 1, -1)
        rgb[mask > 0] = (230, 60, 40) if category == "ball" else (50, 200, 220)
        found.append((category, mask > 0))
    return rgb, found


def write_coco_folder(folder: Path, pictures: int = 4, side: int = 64, first_seed: int = 0, objects: int = 2) -> Path:
    """A COCO folder of such pictures."""
    (folder / "images").mkdir(parents=True)
    images, annotations = [], []
    for index in range(pictures):
        rgb, found = draw(first_seed + index, side, objects)
        cv2.imwrite(str(folder / "images" / f"{index}.png"), rgb[:, :, ::-1])
        images.append({"id": index + 7, "file_name": f"{index}.png", "width": side, "height": side})
        for category, mask in found:
            annotations.append(
                {
                    "id": len(annotations) + 1,
                    "image_id": index + 7,
                    "category_id": CATEGORIES.index(category) + 1,
                    "segmentation": encode_mask(mask),
                    "iscrowd": 0,
                }
            )
    categories = [{"id": number, "name": name} for number, name in enumerate(CATEGORIES, start=1)]
    content = {"images": images, "annotations": annotations, "categories": categories}
    (folder / "annotations.json").write_text(json.dumps(content))
    return folder
