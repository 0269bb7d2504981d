"""A training run: a folder that holds the best network so far, and all it takes to go on after a kill."""

import copy
import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import torch

from labeling.detectors.data.annotated_pictures import AnnotatedPicture
from labeling.detectors.data.augment_config import AugmentConfig
from labeling.detectors.finetuning.batches import Mixture, batches
from labeling.detectors.finetuning.epochs import evaluate, learning_rate, make_optimizer, train_one_epoch
from labeling.detectors.finetuning.train_config import TrainConfig
from labeling.detectors.networks.mask_rcnn import Network, channels_last
from labeling.detectors.networks.network_detector import NetworkDetector
from labeling.detectors.networks.spec import NetworkSpec
from labeling.detectors.networks.weights import load_network, save_network
from labeling.io.formats.atomic import write_json
from labeling.training.run_files import CONFIG_FILE, WEIGHTS_FILE
from labeling.training.run_folder import Progress, load_checkpoint, save_checkpoint, tensorboard


def train(
    network: Network,
    out: Path,
    pictures: Sequence[AnnotatedPicture],
    validation: Sequence[AnnotatedPicture],
    config: TrainConfig,
    augmentation: AugmentConfig,
    replay: Sequence[AnnotatedPicture] = (),
    device: str | torch.device = "cpu",
    about: dict[str, Any] | None = None,
    say: Callable[[str], None] = print,
    bar: Callable[..., Any] | None = None,
    new_categories: Sequence[str] = (),
) -> Progress:
    """Trains a network and keeps the best of it in ``out/detector.safetensors``; goes on where a killed run stopped.

    Args:
        network: where to start; changed.
        out: folder of the run.
        pictures: to learn from. What is not annotated is background.
        validation: to choose the best by; if empty, the last is kept and training does not stop early.
        config: settings of training.
        augmentation: settings of augmentation.
        replay: source pictures to mix in, against forgetting.
        device: where to train.
        about: written into the weights: where they come from.
        say: where progress is told.
        bar: makes a progress bar (``tqdm``), if there is to be one.
        new_categories: those of the network's that it had no name for when the source pictures taught it. Where these
            never name one, what is not annotated there is background or one of them.

    Raises:
        SbmError: if settings make no sense, the folder holds another run, or training breaks down.
    """
    config.check()
    augmentation.check()
    out.mkdir(parents=True, exist_ok=True)
    device = torch.device(device)
    names, new = network.spec.categories, tuple(new_categories)
    mixture = Mixture(pictures, names, augmentation, config.seed, replay, config.replay_share, new)
    network.frozen_statistics = config.frozen_statistics
    network.freeze(config.frozen_stages)
    channels_last(network.to(device))
    optimizer = make_optimizer(network, config, bool(new))
    averaged = _copy(network) if config.average else None
    scaler = torch.amp.GradScaler("cuda") if device.type == "cuda" else None
    identity = _identity(network.spec, config, augmentation, mixture, validation)

    def restore(content: dict[str, Any]) -> None:
        network.load_state_dict(content["network"])
        if averaged is not None:
            averaged.load_state_dict(content["averaged"])
        optimizer.load_state_dict(content["optimizer"])

    state = load_checkpoint(out, identity, device, restore)
    if state.iteration:
        say(f"going on from step {state.iteration}")
    write_json(out / CONFIG_FILE, {**json.loads(identity), "about": about or {}})
    board = tensorboard(out, state.iteration, say)
    kept = averaged or network
    while state.iteration < config.iterations and not (
        validation and state.is_flat(config.patience, config.validate_every)
    ):
        count = min(config.validate_every, config.iterations - state.iteration)
        stream = batches(mixture, config.batch_size, state.iteration, count, config.workers)
        if bar is not None:
            stream = bar(stream, total=count, desc=f"steps {state.iteration}-{state.iteration + count}")
        losses = train_one_epoch(
            network,
            optimizer,
            stream,
            lambda step: learning_rate(step, config),
            state.iteration,
            config,
            averaged,
            scaler,
            lambda step, values: _draw(board, "train", values, step),
        )
        state.iteration += count
        record: dict[str, Any] = {"iteration": state.iteration, **losses}
        score = float(state.iteration)
        if validation:
            scores = evaluate(NetworkDetector(kept, "training", device=device), validation)
            record |= {name: value for name, value in asdict(scores).items() if name not in ("pictures", "objects")}
            score = scores.mask_ap50 or 0.0
            _draw(
                board, "val", {k: v for k, v in record.items() if "ap" in k and isinstance(v, float)}, state.iteration
            )
        state.history.append(record)
        if score > state.best:
            state.best, state.best_iteration = score, state.iteration
            save_network(out / WEIGHTS_FILE, kept, _described(kept.spec, about, state, config))
        content = {
            "network": network.state_dict(),
            "averaged": averaged.state_dict() if averaged is not None else None,
            "optimizer": optimizer.state_dict(),
        }
        save_checkpoint(out, identity, state, content)
        say(_line(record, state))
    if board is not None:
        board.close()
    return state


def _described(spec: NetworkSpec, about: dict[str, Any] | None, state: Progress, config: TrainConfig) -> NetworkSpec:
    trained = {"iteration": state.iteration, "seed": config.seed, "validation_ap50": state.history[-1].get("mask_ap50")}
    return replace(spec, about={**spec.about, **(about or {}), "trained": trained})


def _copy(network: Network) -> Network:
    return copy.deepcopy(network).requires_grad_(False)


def _identity(
    spec: NetworkSpec,
    config: TrainConfig,
    augmentation: AugmentConfig,
    mixture: Mixture,
    validation: Sequence[AnnotatedPicture],
) -> str:
    """What a checkpoint must agree on to be gone on from; more iterations or patience are welcome."""
    fixed = {k: v for k, v in asdict(config).items() if k not in ("iterations", "patience", "workers")}
    if config.schedule == "cosine":
        fixed["iterations"] = config.iterations
    return json.dumps(
        {
            "architecture": spec.architecture,
            "categories": list(spec.categories),
            "train": fixed,
            "augment": asdict(augmentation),
            "pictures": [len(mixture.pictures), len(mixture.replay), len(validation)],
            "objects": sum(len(picture.annotations) for picture in mixture.pictures),
        },
        sort_keys=True,
    )


def best_of(out: Path) -> Network:
    """The best network of a run."""
    return load_network(out / WEIGHTS_FILE)


def _draw(board: Any, group: str, values: dict[str, float], step: int) -> None:
    if board is not None:
        for name, value in values.items():
            board.add_scalar(f"{group}/{name}", value, step)


def _line(record: dict[str, Any], state: Progress) -> str:
    parts = [f"step {record['iteration']}: loss {record['loss']:.3f}"]
    if "mask_ap50" in record:
        parts += [
            f"{name} {100 * (record[key] or 0):.1f}" for name, key in (("AP50", "mask_ap50"), ("AP30", "mask_ap30"))
        ]
        parts.append(f"best AP50 {100 * state.best:.1f} at step {state.best_iteration}")
    return ", ".join(parts)
