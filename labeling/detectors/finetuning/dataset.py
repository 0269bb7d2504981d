"""Annotated pictures as samples and batches to train on."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import torch
from jaxtyping import Float, Int64
from torch.utils.data import Dataset

from labeling.core.errors import UsageError
from labeling.core.masks import box_xyxy
from labeling.core.rle import decode_mask
from labeling.detectors.data.annotated_pictures import AnnotatedPicture, category_names
from labeling.detectors.data.augment import AugmentConfig, Sample, augment
from labeling.detectors.networks.losses import Target
from labeling.detectors.networks.mask_rcnn import STRIDE

Batch = tuple[torch.Tensor, list[tuple[int, int]], list[Target]]
"""Pictures (b, 3, h, w; uint8), their sizes within, and what is in them."""


def load_sample(picture: AnnotatedPicture, categories: Sequence[str]) -> Sample:
    """Reads a picture and its masks. Objects of categories that the list lacks are background; so are empty masks."""
    number = {name: index for index, name in enumerate(categories, start=1) if name}
    kept = [one for one in picture.annotations if one.ignore or one.category in number]
    masks = [decode_mask(one.rle) for one in kept]
    shown = [index for index, mask in enumerate(masks) if mask.any()]
    return Sample(
        rgb=picture.rgb(),
        masks=np.stack([masks[index] for index in shown]) if shown else np.zeros((0, *picture.size), bool),
        labels=np.array([0 if kept[i].ignore else number[kept[i].category] for i in shown], np.int64),
        weights=np.array([kept[i].weight for i in shown], np.float32),
        ignore=np.array([kept[i].ignore for i in shown], bool),
    )


def to_target(sample: Sample) -> Target:
    """The objects of a sample as the network's losses want them."""
    boxes = torch.from_numpy(np.array([box_xyxy(mask) for mask in sample.masks], np.float32).reshape(-1, 4))
    learn = torch.from_numpy(~sample.ignore & (sample.labels > 0))
    weights = torch.from_numpy(sample.weights)[learn]
    return {
        "boxes": boxes[learn],
        "labels": torch.from_numpy(sample.labels)[learn],
        "masks": torch.from_numpy(np.ascontiguousarray(sample.masks)).to(torch.uint8)[learn],
        "weights": weights,
        "presence": weights if sample.trust_scores else torch.ones_like(weights),
        "ignored": boxes[~learn],
        "unannotated": torch.tensor(sample.unannotated, dtype=torch.int64),
    }


def collate(samples: Sequence[Sample]) -> Batch:
    """Pictures of any sizes in one tensor, each in its upper left corner."""
    sizes = [(int(one.rgb.shape[0]), int(one.rgb.shape[1])) for one in samples]
    height, width = (-(-max(side) // STRIDE) * STRIDE for side in zip(*sizes, strict=True))
    pictures = torch.zeros(len(samples), 3, height, width, dtype=torch.uint8)
    targets = []
    for index, (one, (tall, wide)) in enumerate(zip(samples, sizes, strict=True)):
        pictures[index, :, :tall, :wide] = torch.from_numpy(np.ascontiguousarray(one.rgb)).permute(2, 0, 1)
        target = to_target(one)
        room = torch.zeros(len(target["masks"]), height, width, dtype=torch.uint8)
        room[:, :tall, :wide] = target["masks"]
        targets.append({**target, "masks": room})
    return pictures, sizes, targets


def to_device(batch: Batch, device: torch.device) -> Batch:
    """The batch on a device."""
    pictures, sizes, targets = batch
    wait = device.type != "cuda"
    moved = [{name: value.to(device, non_blocking=not wait) for name, value in one.items()} for one in targets]
    return pictures.to(device, non_blocking=not wait), sizes, moved


@dataclass(frozen=True)
class ReplayDataset(Dataset):
    """An endless stream of samples, each a function of its number, so that training can go on where it stopped.

    Pictures are drawn in shuffled rounds, in which some may come several times (``repeats_of``); ``replay_share`` of
    the samples, spread evenly, come from ``replay``.
    """

    pictures: Sequence[AnnotatedPicture]
    categories: tuple[str, ...]
    config: AugmentConfig
    seed: int
    replay: Sequence[AnnotatedPicture] = field(default_factory=tuple)
    replay_share: float = 0.0
    new_categories: tuple[str, ...] = ()
    """Of ``categories``: where no replayed picture names one, background there may be one."""
    repeat_threshold: float = 0.0
    """Of ``repeats_of``, for ``pictures``."""
    trust_scores: bool = False
    """What is annotated is there as surely as its weight says, not for sure."""

    def __post_init__(self) -> None:
        if not self.pictures:
            raise UsageError("there is no picture to train on")

    def source(self, number: int) -> tuple[bool, int]:
        """Whether a sample is replayed, and the index of its picture."""
        share = self.replay_share if self.replay else 0.0
        replayed = int(np.floor(number * share))
        is_replay = int(np.floor((number + 1) * share)) > replayed
        draw, pool = (replayed, np.arange(len(self.replay))) if is_replay else (number - replayed, self._round)
        turn, place = divmod(draw, len(pool))
        order = np.random.default_rng([self.seed, int(is_replay), turn]).permutation(len(pool))
        return is_replay, int(pool[order[place]])

    def __getitem__(self, number: int) -> Sample:
        is_replay, index = self.source(number)
        picture = (self.replay if is_replay else self.pictures)[index]
        rng = np.random.default_rng([self.seed, 2, number])
        sample = replace(load_sample(picture, self.categories), trust_scores=self.trust_scores)
        if is_replay:
            sample = replace(sample, unannotated=self._unannotated)
        return augment(sample, self.config, rng)

    @cached_property
    def _round(self) -> Int64[np.ndarray, "round"]:
        """Indices of the pictures of a round, before they are shuffled."""
        if not self.repeat_threshold:
            return np.arange(len(self.pictures))
        repeats = repeats_of(self.pictures, self.categories, self.repeat_threshold)
        extra = np.random.default_rng([self.seed, 3]).random(len(repeats)) < repeats % 1
        return np.repeat(np.arange(len(repeats)), repeats.astype(np.int64) + extra)

    @cached_property
    def _unannotated(self) -> tuple[int, ...]:
        """Outputs of the categories that replayed pictures never name."""
        named = category_names(self.replay)
        return tuple(1 + self.categories.index(name) for name in self.new_categories if name not in named)


def repeats_of(
    pictures: Sequence[AnnotatedPicture], categories: Sequence[str], threshold: float
) -> Float[np.ndarray, "n"]:
    """How often each picture should come in a round, at least once, on average.

    A category that is in a share f of the pictures has the factor sqrt(threshold / f), at least 1; a picture has that
    of its rarest category (Gupta et al. 2019, LVIS). Labels count by their weight, so that a label which is hardly
    believed neither makes its category frequent nor its picture come again.

    Args:
        pictures: annotated; regions to ignore do not count.
        categories: those that are learnt.
        threshold: share of the pictures, in [0, 1], from which on a category is not rare.
    """
    number = {name: index for index, name in enumerate(categories) if name}
    weight = np.zeros((len(pictures), len(categories)))
    for row, picture in zip(weight, pictures, strict=True):
        for one in picture.annotations:
            if not one.ignore and one.category in number:
                row[number[one.category]] = max(row[number[one.category]], one.weight)
    share = weight.mean(axis=0)
    factor = np.sqrt(np.maximum(threshold / np.maximum(share, 1e-9), 1.0))
    return 1.0 + (weight * (factor - 1.0)).max(axis=1, initial=0.0)
