"""Training a frustum PointNet: a folder that holds the best network so far, and all it takes to go on after a kill."""

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from labeling.core.box_overlap import box_iou_3d
from labeling.core.errors import SbmError, UsageError
from labeling.detectors3d.frustum_batches import Samples, batches, collate, plain_sample
from labeling.detectors3d.frustum_dataset import Lesson, category_names, sizes_of
from labeling.detectors3d.frustum_losses import FrustumBatch, frustum_losses
from labeling.detectors3d.frustum_pointnet import FrustumNet, FrustumSpec
from labeling.detectors3d.frustum_weights import save_network
from labeling.detectors3d.train_config import Augment3dConfig, Train3dConfig
from labeling.detectors3d.upright_boxes import to_box
from labeling.io.formats.atomic import write_json
from labeling.training.run_files import CONFIG_FILE, WEIGHTS_FILE
from labeling.training.run_folder import Progress, load_checkpoint, save_checkpoint, tensorboard

CLIP = 10.0
"""Largest norm of the gradient."""


@dataclass(frozen=True)
class BoxScores:
    """How good boxes are, given the 2-D box of every object."""

    objects: int
    mean_iou: float
    right_at_25: float
    """Share of objects whose box has an IoU of at least .25."""
    right_at_50: float
    points_iou: float
    """Of the object's points among the frustum's."""


def train(
    lessons: Sequence[Lesson],
    validation: Sequence[Lesson],
    out: Path,
    config: Train3dConfig,
    augmentation: Augment3dConfig,
    device: str = "cpu",
    about: dict[str, Any] | None = None,
    say: Callable[[str], None] = print,
    bar: Callable[..., Any] | None = None,
) -> Progress:
    """Trains a network and keeps the best of it in ``out/detector.safetensors``; goes on where a killed run stopped.

    Args:
        lessons: to learn from; their categories and sizes are those of the network.
        validation: to choose the best by, by mean IoU; if empty, the last is kept and training does not stop early.
        out: folder of the run.
        config: settings of training.
        augmentation: settings of augmentation.
        device: where to train.
        about: written into the weights: where they come from.
        say: where progress is told.
        bar: makes a progress bar (``tqdm``), if there is to be one.

    Raises:
        SbmError: if settings make no sense, the folder holds another run, or training breaks down.
    """
    config.check()
    augmentation.check()
    names = category_names(lessons)
    known = [one for one in validation if one.category in names]
    if validation and not known:
        raise UsageError(f"validation: none of its objects is a {' or a '.join(names)}, nothing to choose a network by")
    out.mkdir(parents=True, exist_ok=True)
    torch.manual_seed(config.seed)
    network = FrustumNet(FrustumSpec(names, sizes_of(lessons, names), config.width, config.num_points)).to(device)
    optimizer = torch.optim.Adam(network.parameters(), lr=config.learning_rate)
    identity = _identity(network.spec, config, augmentation, lessons, known)

    def restore(content: dict[str, Any]) -> None:
        network.load_state_dict(content["network"])
        optimizer.load_state_dict(content["optimizer"])
        torch.set_rng_state(content["random"].cpu())

    state = load_checkpoint(out, identity, device, restore)
    if state.iteration:
        say(f"going on from step {state.iteration}")
    write_json(out / CONFIG_FILE, {**json.loads(identity), "about": about or {}})
    samples = Samples(lessons, names, config.num_points, augmentation, config.seed, config.trust_scores)
    board = tensorboard(out, state.iteration, say)
    while state.iteration < config.iterations and not (known and state.is_flat(config.patience, config.validate_every)):
        count = min(config.validate_every, config.iterations - state.iteration)
        stream = batches(samples, config.batch_size, state.iteration, count, config.workers)
        if bar is not None:
            stream = bar(stream, total=count, desc=f"steps {state.iteration}-{state.iteration + count}")
        record = {**_epoch(network, optimizer, stream, state.iteration, config, device)}
        state.iteration += count
        record["iteration"], score = state.iteration, float(state.iteration)
        if known:
            record |= asdict(evaluate(network, known, device))
            score = record["mean_iou"]
        state.history.append(record)
        if score > state.best:
            state.best, state.best_iteration = score, state.iteration
            save_network(out / WEIGHTS_FILE, network, {**(about or {}), "trained": _trained(state, config)})
        content = {
            "network": network.state_dict(),
            "optimizer": optimizer.state_dict(),
            "random": torch.get_rng_state(),  # of dropout
        }
        save_checkpoint(out, identity, state, content)
        say(_line(record, state))
        for name, value in record.items():
            if board is not None and name != "iteration":
                board.add_scalar(name, value, state.iteration)
    if board is not None:
        board.close()
    return state


def _epoch(network, optimizer, stream, first: int, config: Train3dConfig, device: str) -> dict[str, float]:
    """Some batches; returns the mean of every term of the loss.

    Raises:
        SbmError: if the loss is not finite.
    """
    network.train()
    sums: dict[str, float] = {}
    count = 0
    for step, batch in enumerate(stream, start=first):
        for group in optimizer.param_groups:
            group["lr"] = learning_rate(step, config)
        on_device = FrustumBatch(**{name: value.to(device) for name, value in vars(batch).items()})
        terms = frustum_losses(network, network(on_device.points, on_device.category), on_device)
        loss = torch.stack(list(terms.values())).sum()
        if not bool(torch.isfinite(loss)):
            raise SbmError(f"the loss is not finite at step {step}; give a smaller --learning-rate")
        optimizer.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(network.parameters(), CLIP)
        optimizer.step()
        count += 1
        for name, value in {"loss": loss, **terms}.items():
            sums[name] = sums.get(name, 0.0) + float(value.detach())
    return {name: value / max(1, count) for name, value in sums.items()}


def learning_rate(step: int, config: Train3dConfig) -> float:
    """Falls to a hundredth along a cosine."""
    share = min(1.0, step / config.iterations)
    return config.learning_rate * (0.01 + 0.99 * 0.5 * (1 + math.cos(math.pi * share)))


def evaluate(network: FrustumNet, lessons: Sequence[Lesson], device: str = "cpu", batch_size: int = 32) -> BoxScores:
    """How good the boxes are that a network finds, given the 2-D box of every object.

    Args:
        network: whose categories contain those of the lessons.
        lessons: at least one.
        device: where to run.
        batch_size: lessons at a time.
    """
    was_training = network.training
    network.eval()
    overlaps, points = [], []
    for start in range(0, len(lessons), batch_size):
        some = lessons[start : start + batch_size]
        batch = collate([plain_sample(one, network.spec.categories, network.spec.num_points) for one in some])
        with torch.inference_mode():
            output = network(batch.points.to(device), batch.category.to(device))
            found = network.boxes(output).cpu().numpy()
        own, said = batch.own.numpy() > 0, output.logits.cpu().numpy() > 0
        points += list((own & said).sum(axis=1) / np.maximum(1, (own | said).sum(axis=1)))
        overlaps += [
            box_iou_3d(to_box(one), to_box(true)) for one, true in zip(found, batch.boxes.numpy(), strict=True)
        ]
    network.train(was_training)
    right = np.array(overlaps)
    return BoxScores(
        objects=len(lessons),
        mean_iou=float(right.mean()),
        right_at_25=float(np.mean(right >= 0.25)),
        right_at_50=float(np.mean(right >= 0.5)),
        points_iou=float(np.mean(points)),
    )


def _trained(state: Progress, config: Train3dConfig) -> dict[str, Any]:
    return {"iteration": state.iteration, "seed": config.seed, "mean_iou": state.history[-1].get("mean_iou")}


def _identity(
    spec: FrustumSpec,
    config: Train3dConfig,
    augmentation: Augment3dConfig,
    lessons: Sequence[Lesson],
    validation: Sequence[Lesson],
) -> str:
    """What a checkpoint must agree on to be gone on from; more patience is welcome."""
    fixed = {name: value for name, value in asdict(config).items() if name not in ("patience", "workers")}
    lesson_counts = {"objects": [len(lessons), len(validation)]}
    return json.dumps(
        {"network": asdict(spec), "train": fixed, "augment": asdict(augmentation), **lesson_counts}, sort_keys=True
    )


def _line(record: dict[str, Any], state: Progress) -> str:
    line = f"step {record['iteration']}: loss {record['loss']:.3f}"
    if "mean_iou" in record:
        line += (
            f", IoU {record['mean_iou']:.3f}, {100 * record['right_at_25']:.0f} % of boxes right at .25, "
            f"best IoU {state.best:.3f} at step {state.best_iteration}"
        )
    return line
