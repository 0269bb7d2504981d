"""One training loop for all networks: detectors in 2-D and 3-D, and pre-training.

A ``TrainingTask`` brings what differs: network, optimizer, batches, losses, validation. ``train`` does the rest:
optimizer steps, running average, validation, the best network, curves, and checkpoints with exact resume. An epoch here
is the stretch between two validations, as in torchvision's references/detection.
"""

import json
import math
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, Generic, TypeVar

import torch
from torch import Tensor, nn
from torch.utils.data import DataLoader, Dataset

from labeling.core.errors import SbmError
from labeling.formats.atomic import write_json
from labeling.runtime.interrupts import StopRequest
from labeling.runtime.threads import settle_network_threads
from labeling.training.checkpoint import Progress, load_checkpoint, save_checkpoint
from labeling.training.config import CONFIG_FILE, WEIGHTS_FILE, TrainingConfig
from labeling.training.curves import tensorboard_writer

SAVE_EVERY_S = 300.0
"""A checkpoint is written at least so often, however long the next validation is away."""
RATE_FLOOR = 0.01
"""Where the cosine of a learning rate ends, as a share of the highest rate."""
Batch = TypeVar("Batch")
Net = TypeVar("Net", bound=nn.Module)


class TrainingTask(ABC, Generic[Batch, Net]):
    """What a training consists of, apart from the loop. Whoever makes one sets the attributes without a default."""

    config: TrainingConfig
    network: Net
    """Trained in place, on its device."""
    optimizer: torch.optim.Optimizer
    """Of the network's parameters; a group with a ``share`` learns at that share of the learning rate."""
    dataset: Dataset
    """Maps every number from 0 to a sample: batch i holds samples ``size * i`` and following."""
    collate: Callable[[Sequence[Any]], Batch]
    """Makes a batch of samples."""
    workers: int = 0
    """Processes that prepare samples; 0 prepares them in this one."""
    identity: Mapping[str, Any]
    """Data and settings that a run must share to go on from a checkpoint; written into ``train.json``."""
    about: Mapping[str, Any] = MappingProxyType({})
    """Where the network comes from; written into ``train.json``."""
    averaged: Net | None = None
    """Running average of the network's weights, which is validated and kept in its place; None: the network itself."""
    average: float = 0.0
    """Decay of that average per batch."""
    clip: float = 10.0
    """Largest norm of the gradient."""
    patience: int = 0
    """Validations without a better score after which training stops; 0: never."""
    score_name: str = ""
    """Which validation figure the best network is chosen by; without such a figure the last network is kept."""
    weights_file: str = WEIGHTS_FILE
    mixed_precision: bool = False
    """Whether forward passes on CUDA use half precision."""

    def batches(self, progress: Progress) -> Iterable[Batch]:
        """The batches of the next epoch. Batch and losses must be functions of the batch's number (and of torch's
        generator, whose state checkpoints keep), so that a run that goes on ends like one that never stopped.
        """
        first, size, every = progress.iteration, self.config.batch_size, self.config.validate_every
        last = min((first // every + 1) * every, self.config.iterations)
        return DataLoader(
            self.dataset,
            batch_sampler=[list(range(size * batch, size * (batch + 1))) for batch in range(first, last)],
            collate_fn=self.collate,
            generator=torch.Generator(),  # else every start of an epoch, or of the rest of one, draws from torch's own
            num_workers=self.workers,
            multiprocessing_context="spawn" if self.workers else None,
            pin_memory=self.workers > 0 and torch.cuda.is_available(),
        )

    @abstractmethod
    def losses(self, batch: Batch, step: int) -> dict[str, Tensor]:
        """Terms of the loss, each a scalar; their sum is minimised."""

    @abstractmethod
    def learning_rate(self, progress: Progress) -> float:
        """At step ``progress.iteration``."""

    @abstractmethod
    def validate(self, progress: Progress) -> dict[str, Any]:
        """Figures of ``candidate``, as JSON; empty if there is nothing to validate on."""

    @abstractmethod
    def save(self, path: Path, progress: Progress) -> None:
        """Writes ``candidate``, and in its header where it comes from."""

    @abstractmethod
    def summary(self, record: Mapping[str, Any], progress: Progress) -> str:
        """One line for people.

        Args:
            record: of the history: position, mean losses, validation figures.
            progress: how far training has come.
        """

    def is_finished(self, progress: Progress) -> bool:
        """Whether training is over."""
        unimproved = progress.iteration - progress.best_iteration
        is_flat = 0 < self.patience * self.config.validate_every <= unimproved
        return is_flat or progress.iteration >= self.config.iterations

    def share_done(self, progress: Progress) -> float:
        """Share of training that is over, if it is not ended early; from which the time left is estimated."""
        return progress.iteration / self.config.iterations

    def position(self, progress: Progress) -> dict[str, float]:
        """How a record of the history begins."""
        return {"iteration": progress.iteration}

    @property
    def candidate(self) -> Net:
        """The network that is validated and kept."""
        return self.network if self.averaged is None else self.averaged

    @property
    def device(self) -> torch.device:
        """Where the network computes."""
        return next(self.network.parameters()).device


def train(
    task: TrainingTask,
    out: Path,
    say: Callable[[str], None] = print,
    bar: Callable[..., Iterable[Any]] | None = None,
    stop: StopRequest | None = None,
) -> Progress:
    """Trains, and keeps the best network in the run's folder; goes on where a killed run stopped.

    A checkpoint is written at every validation, every ``SAVE_EVERY_S`` between them, and when told to stop.

    Args:
        task: what to train, and how.
        out: folder of the run.
        say: told a line after each validation, with the time that is left.
        bar: makes a progress bar of the whole training around the batches of an epoch (``tqdm``), if there is to be
            one.
        stop: once it is set, a checkpoint is written after the batch at hand, and the program left. Network and history
            of a run that goes on from there are those of one that never stopped.

    Returns:
        How far training has come, with its history.

    Raises:
        SbmError: if the folder holds another run or a damaged checkpoint, or training breaks down.
    """
    settle_network_threads()
    out.mkdir(parents=True, exist_ok=True)
    identity = json.dumps(task.identity, sort_keys=True)
    scaler = torch.amp.GradScaler("cuda", enabled=task.mixed_precision and task.device.type == "cuda")
    progress = load_checkpoint(out, identity, task.device, lambda state: _restore(task, scaler, state))
    if progress.iteration:
        say(f"going on from step {progress.iteration}")
    machine = {"device": device_name(task.device), "torch": torch.__version__}
    write_json(out / CONFIG_FILE, {**json.loads(identity), "about": dict(task.about), "machine": machine})
    with tensorboard_writer(out / "tensorboard", progress.iteration, say) as writer:

        def draw(group: str, figures: Mapping[str, Any], step: int) -> None:
            for name, value in figures.items():
                if writer is not None and isinstance(value, float):
                    writer.add_scalar(f"{group}/{name}", value, step)

        _train_on(task, out, progress, scaler, draw, say, bar, stop)
    return progress


def _train_on(
    task: TrainingTask,
    out: Path,
    progress: Progress,
    scaler: torch.amp.GradScaler,
    draw: Callable[[str, Mapping[str, Any], int], None],
    say: Callable[[str], None],
    bar: Callable[..., Iterable[Any]] | None,
    stop: StopRequest | None,
) -> None:
    """Trains until the task is finished, or the program is told to stop and left."""
    began, begun_at, saved = time.monotonic(), task.share_done(progress), time.monotonic()

    def is_within() -> bool:
        return progress.iteration % task.config.validate_every > 0 and not task.is_finished(progress)

    def save() -> None:
        nonlocal saved
        save_checkpoint(out, json.dumps(task.identity, sort_keys=True), progress, _state(task, scaler))
        saved = time.monotonic()

    def note(step: int, losses: Mapping[str, float]) -> None:
        draw("train", losses, step)
        # Where a validation is due, it comes first: a run that went on from here would leave it out.
        if time.monotonic() - saved >= SAVE_EVERY_S and is_within():
            save()

    while not task.is_finished(progress):
        batches = task.batches(progress)
        if bar is not None:
            batches = bar(batches, desc="training", total=task.config.iterations, initial=progress.iteration)
        losses = train_one_epoch(task, _until(stop, batches), progress, scaler, note)
        if stop is not None and stop.is_set() and is_within():
            save()
            stop.leave()
        progress.sums, progress.summed = {}, 0
        figures = task.validate(progress)
        draw("val", figures, progress.iteration)
        record = {**task.position(progress), **losses, **figures}
        progress.history.append(record)
        score = float(progress.iteration)
        if task.score_name in figures:
            score = figures[task.score_name] or 0.0
        if score > progress.best:
            progress.best, progress.best_iteration = score, progress.iteration
            task.save(out / task.weights_file, progress)
        save()
        done = task.share_done(progress) - begun_at
        left_s = (time.monotonic() - began) * (1 - begun_at - done) / done if done > 0 else 0.0
        over = task.is_finished(progress)
        say(task.summary(record, progress) + ("" if over else f"; at most {duration(left_s)} left"))
        if stop is not None and stop.is_set():
            stop.leave()


def device_name(device: torch.device) -> str:
    """What a device is: the name of a GPU, or ``cpu``."""
    return torch.cuda.get_device_name(device) if device.type == "cuda" else device.type


def duration(seconds: float) -> str:
    """A time in words, in the unit that suits it.

    >>> duration(42), duration(600), duration(9000)
    ('42 s', '10 min', '2.5 h')
    """
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


def _until(stop: StopRequest | None, batches: Iterable[Batch]) -> Iterator[Batch]:
    """Batches, none after a request to stop."""
    for batch in batches:
        yield batch
        if stop is not None and stop.is_set():
            return


def train_one_epoch(
    task: TrainingTask,
    batches: Iterable[Any],
    progress: Progress,
    scaler: torch.amp.GradScaler,
    on_step: Callable[[int, dict[str, float]], None] = lambda step, losses: None,
) -> dict[str, float]:
    """Takes one optimizer step for each batch.

    Args:
        task: its network is left in training mode.
        batches: of the epoch.
        progress: advanced by one iteration for each batch.
        scaler: of losses, for mixed precision; disabled otherwise.
        on_step: told the number of each step and its losses.

    Returns:
        Mean of each loss since the last validation, and of their sum as ``loss``.

    Raises:
        SbmError: if the loss is no longer a finite number.
    """
    task.network.train()
    for batch in batches:
        step = progress.iteration
        rate = task.learning_rate(progress)
        for group in task.optimizer.param_groups:
            group["lr"] = rate * group.get("share", 1.0)
        with torch.autocast(task.device.type, torch.float16, enabled=scaler.is_enabled()):
            losses = task.losses(batch, step)
            loss = torch.stack([value.float() for value in losses.values()]).sum()
        if not bool(torch.isfinite(loss)):
            raise SbmError(f"training broke down in step {step}: the loss is {loss.item()}; lower --learning-rate")
        task.optimizer.zero_grad(set_to_none=True)
        scaler.scale(loss).backward()
        scaler.unscale_(task.optimizer)
        nn.utils.clip_grad_norm_(task.network.parameters(), task.clip)
        scaler.step(task.optimizer)
        scaler.update()
        if task.averaged is not None:
            _update_average(task.averaged, task.network, min(task.average, (1 + step) / (10 + step)))
        values = {name: float(value.detach()) for name, value in {**losses, "loss": loss}.items()}
        progress.sums = {name: progress.sums.get(name, 0.0) + value for name, value in values.items()}
        progress.summed += 1
        progress.iteration += 1
        on_step(step, values)
    return {name: value / max(1, progress.summed) for name, value in progress.sums.items()}


def scheduled_rate(
    highest: float, step: int, warmup: int = 0, progress: float = 0.0, schedule: str = "cosine"
) -> float:
    """A learning rate that rises linearly during the warm-up; then falls along a cosine to a hundredth, or stays.

    Args:
        highest: rate at the end of the warm-up.
        step: number of the batch, from 0.
        warmup: batches over which the rate rises.
        progress: share of training that is over; of 1 and more, all of it.
        schedule: "cosine" or "constant".

    Source: Loshchilov and Hutter 2017, "SGDR: Stochastic Gradient Descent with Warm Restarts" (without restarts).
    """
    rate = highest * (min(1.0, (step + 1) / warmup) if warmup else 1.0)
    if schedule == "constant":
        return rate
    return rate * (RATE_FLOOR + (1 - RATE_FLOOR) * 0.5 * (1 + math.cos(math.pi * min(1.0, progress))))


@torch.no_grad()
def _update_average(averaged: nn.Module, network: nn.Module, decay: float) -> None:
    for mean, value in zip(averaged.state_dict().values(), network.state_dict().values(), strict=True):
        if value.is_floating_point():
            mean.lerp_(value, 1 - decay)
        else:
            mean.copy_(value)


def _state(task: TrainingTask, scaler: torch.amp.GradScaler) -> dict[str, Any]:
    return {
        "network": task.network.state_dict(),
        "averaged": None if task.averaged is None else task.averaged.state_dict(),
        "optimizer": task.optimizer.state_dict(),
        "random": torch.get_rng_state(),
        "random_cuda": torch.cuda.get_rng_state(task.device) if task.device.type == "cuda" else None,
        "scaler": scaler.state_dict(),
    }


def _restore(task: TrainingTask, scaler: torch.amp.GradScaler, state: Mapping[str, Any]) -> None:
    task.network.load_state_dict(state["network"])
    if task.averaged is not None:
        task.averaged.load_state_dict(state["averaged"])
    task.optimizer.load_state_dict(state["optimizer"])
    if "random" in state:
        torch.set_rng_state(state["random"].cpu())
    if state.get("random_cuda") is not None and task.device.type == "cuda":
        torch.cuda.set_rng_state(state["random_cuda"].cpu(), task.device)
    if state.get("scaler") and scaler.is_enabled():
        scaler.load_state_dict(state["scaler"])
