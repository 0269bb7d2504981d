"""The loop that pre-trains ``compact``: cosine over a number of steps or a span of time, small views first."""

import json
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch

from experiments.pretraining.views import ViewConfig, stream
from labeling.core.errors import SbmError, UsageError
from labeling.detectors.data.annotated_pictures import AnnotatedPicture
from labeling.detectors.finetuning.batches import Batch
from labeling.detectors.finetuning.epochs import evaluate, train_one_epoch
from labeling.detectors.finetuning.train_config import TrainConfig
from labeling.detectors.networks.mask_rcnn import Network
from labeling.detectors.networks.network_detector import NetworkDetector
from labeling.detectors.networks.weights import save_network
from labeling.io.formats.atomic import atomic_file, write_json

CHECKPOINT_FILE, HISTORY_FILE, WEIGHTS_FILE = "checkpoint.pt", "history.json", "pretrained.safetensors"
_LONGEST_STEP_S = 60.0
"""Whatever takes longer was a pause: a process that was stopped, a machine that slept."""
_CHECKED = 200
"""Held-out photographs that are scored on the way."""


@dataclass(frozen=True)
class PretrainConfig:
    """How long and how fast the network learns."""

    minutes: float = 90.0
    """Time for training; the learning rate reaches its end when either time or steps are used up. Runs that must be
    the same on every machine need more minutes than they take."""
    steps: int = 6000
    """Batches at most."""
    batch_size: int = 16
    """Views in a batch."""
    learning_rate: float = 1e-3
    """Of AdamW; the trunk, which knows ImageNet, learns at a third of it."""
    weight_decay: float = 0.01
    warmup: int = 100
    """Batches over which the learning rate rises."""
    sides: tuple[tuple[int, ...], ...] = ((128,), (128, 160), (160, 192), (192, 224))
    """Sides of views in each quarter of training, pixels: small ones teach more a minute, large ones more detail."""
    average: float = 0.995
    """Decay per batch of the running average of the weights, which is what is kept."""
    frozen_stages: int = 4
    """So many parts of the trunk stay as ImageNet made them; see ``Network.freeze``."""
    settle: float = 0.9
    """From this share of training on batch normalisation keeps its statistics."""
    checkpoint_minutes: float = 4.0
    """Between checkpoints."""
    score_every: int = 250
    """Batches between looks at held-out photographs, which steer nothing."""
    seed: int = 0

    def check(self) -> None:
        """Refuses settings that make no sense.

        Raises:
            UsageError: naming the setting.
        """
        for name in ("minutes", "steps", "batch_size", "learning_rate", "checkpoint_minutes", "score_every"):
            if not 0 < getattr(self, name) < float("inf"):
                raise UsageError(f"--{name.replace('_', '-')} must be above 0, not {getattr(self, name)}")
        if not self.sides or any(side < 64 for sides in self.sides for side in sides):
            raise UsageError(f"--sides must be 64 pixels or more, not {self.sides}")


@dataclass
class State:
    """How far training has come."""

    step: int = 0
    minutes: float = 0.0
    history: list[dict[str, Any]] = field(default_factory=list)


def learning_rate(progress: float, step: int, config: PretrainConfig) -> float:
    """Rises linearly during the warm-up, then falls as a cosine to a hundredth.

    Args:
        progress: share of training that is over.
        step: number of the batch.
        config: settings.
    """
    rise = min(1.0, (step + 1) / max(config.warmup, 1))
    return config.learning_rate * rise * (0.01 + 0.99 * 0.5 * (1 + float(np.cos(np.pi * min(progress, 1.0)))))


def side_of(progress: float, step: int, config: PretrainConfig) -> int:
    """Side of the views of a batch."""
    phase = min(int(progress * len(config.sides)), len(config.sides) - 1)
    choices = config.sides[phase]
    return choices[int(np.random.default_rng((config.seed, 4, step)).integers(len(choices)))]


def pretrain(
    network: Network,
    out: Path,
    photographs: Sequence[AnnotatedPicture],
    held_out: Sequence[AnnotatedPicture],
    config: PretrainConfig,
    views: ViewConfig,
    say: Callable[[str], None] = print,
) -> Network:
    """Pre-trains a network; goes on where a killed run stopped.

    Args:
        network: trunk with ImageNet weights, the rest random; changed.
        out: folder for checkpoint, history and the averaged weights, which are usable at any time.
        photographs: to learn from.
        held_out: scored at times; nothing is chosen by them.
        config: settings of training.
        views: settings of augmentation.
        say: where progress is told.

    Returns:
        The network with averaged weights.

    Raises:
        SbmError: if settings make no sense, the folder holds another run, or training breaks down.
    """
    config.check()
    if not photographs:
        raise UsageError("there is no photograph to train on")
    out.mkdir(parents=True, exist_ok=True)
    network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
    averaged = _copy(network)
    optimizer = make_optimizer(network, config)
    identity = _identity(config, views, photographs)
    state = _resume(out, identity, network, averaged, optimizer)
    if state.step:
        say(f"going on from step {state.step}, {state.minutes:.1f} minutes in")
    settings = TrainConfig(seed=config.seed, average=config.average)
    checked = list(held_out[:: max(len(held_out) // _CHECKED, 1)])
    while progress_of(state, config) < 1.0:
        clock = _Clock(state, config)
        network.frozen_statistics = clock.progress() >= config.settle
        batches = stream(
            photographs,
            network.spec.categories,
            views,
            config.batch_size,
            config.seed,
            state.step,
            lambda step, clock=clock: side_of(clock.progress(step), step, config),
        )
        losses = train_one_epoch(
            network,
            optimizer,
            clock.limit(batches),
            lambda step, clock=clock: learning_rate(clock.progress(step), step, config),
            state.step,
            settings,
            averaged,
        )
        state.step, state.minutes = clock.step, clock.minutes()
        record = {"step": state.step, "minutes": round(state.minutes, 2), **losses}
        scored = max((past["step"] for past in state.history if "ap50" in past), default=0)
        if checked and (state.step - scored >= config.score_every or progress_of(state, config) >= 1.0):
            record["ap50"] = evaluate(NetworkDetector(averaged, "pretraining"), checked).mask_ap50 or 0.0
        state.history.append(record)
        save_network(out / WEIGHTS_FILE, averaged)
        _save(out, identity, network, averaged, optimizer, state)
        say(", ".join(f"{k} {v:.3f}" if isinstance(v, float) else f"{k} {v}" for k, v in record.items()))
    return averaged


def _identity(config: PretrainConfig, views: ViewConfig, photographs: Sequence[AnnotatedPicture]) -> str:
    """What a checkpoint must agree on to be gone on from. A run may be given more or less time on the way."""
    free = ("minutes", "steps", "checkpoint_minutes", "score_every")
    fixed = {name: value for name, value in asdict(config).items() if name not in free}
    return json.dumps({"train": fixed, "views": asdict(views), "photographs": len(photographs)}, sort_keys=True)


def progress_of(state: State, config: PretrainConfig) -> float:
    """Share of training that is over: of its steps or of its time, whichever is more."""
    return max(state.step / config.steps, state.minutes / config.minutes)


class _Clock:
    """Time and steps since the last checkpoint. Scoring, checkpoints and pauses cost no training time."""

    def __init__(self, state: State, config: PretrainConfig) -> None:
        self._state, self._config, self._last, self._spent = state, config, time.monotonic(), 0.0
        self.step = state.step

    def minutes(self) -> float:
        now = time.monotonic()
        self._spent += min(now - self._last, _LONGEST_STEP_S)
        self._last = now
        return self._state.minutes + self._spent / 60

    def progress(self, step: int | None = None) -> float:
        return progress_of(State(self.step if step is None else step, self.minutes()), self._config)

    def limit(self, batches: Iterator[Batch]) -> Iterator[Batch]:
        """Batches until the next checkpoint is due, training is over, or normalisation is to settle."""
        unsettled = self.progress() < self._config.settle
        for batch in batches:
            yield batch
            self.step += 1
            is_due = self.minutes() - self._state.minutes >= self._config.checkpoint_minutes
            if is_due or self.progress() >= 1.0 or (unsettled and self.progress() >= self._config.settle):
                return


def make_optimizer(network: Network, config: PretrainConfig) -> torch.optim.Optimizer:
    """AdamW; the trunk learns more slowly, vectors (biases, normalisation) do not decay."""
    network.freeze(config.frozen_stages)
    trunk = {id(value) for value in network.backbone.trunk.parameters()}
    groups: dict[tuple[bool, bool], list[torch.Tensor]] = {}
    for value in network.parameters():
        if value.requires_grad:
            groups.setdefault((id(value) in trunk, value.ndim > 1), []).append(value)
    return torch.optim.AdamW(
        [
            {"params": values, "weight_decay": config.weight_decay if decays else 0.0, "share": 1 / 3 if known else 1.0}
            for (known, decays), values in groups.items()
        ],
        lr=config.learning_rate,
    )


@torch.no_grad()
def _copy(network: Network) -> Network:
    import copy

    return copy.deepcopy(network).requires_grad_(False).eval()


def _save(out: Path, identity: str, network: Network, averaged: Network, optimizer: Any, state: State) -> None:
    content = {
        "identity": identity,
        "network": network.state_dict(),
        "averaged": averaged.state_dict(),
        "optimizer": optimizer.state_dict(),
        "state": json.dumps(asdict(state)),
    }
    with atomic_file(out / CHECKPOINT_FILE) as temporary:
        torch.save(content, temporary)
    write_json(out / HISTORY_FILE, state.history)


def _resume(out: Path, identity: str, network: Network, averaged: Network, optimizer: Any) -> State:
    path = out / CHECKPOINT_FILE
    if not path.is_file():
        return State()
    import pickle

    try:
        content = torch.load(path, weights_only=True)
        if content["identity"] != identity:
            raise UsageError(
                f"{out}: holds a run with other data or settings; give another --out, or remove {path.name}"
            )
        network.load_state_dict(content["network"])
        averaged.load_state_dict(content["averaged"])
        optimizer.load_state_dict(content["optimizer"])
        return State(**json.loads(content["state"]))
    except (OSError, KeyError, ValueError, TypeError, RuntimeError, EOFError, pickle.UnpicklingError) as error:
        if isinstance(error, UsageError):
            raise
        raise SbmError(f"{path}: is damaged ({type(error).__name__}); remove it to start anew") from None
