"""The training loop on a task that is solved by hand: a line fitted to points."""

import json
import threading

import pytest
import torch

from labeling.core.errors import SbmError, UsageError
from labeling.runtime.interrupts import StopRequest
from labeling.training import loop
from labeling.training.checkpoint import Progress, load_checkpoint
from labeling.training.config import CHECKPOINT_FILE, HISTORY_FILE, TrainingConfig


class Line(loop.TrainingTask[torch.Tensor, torch.nn.Module]):
    """Learns 3 x with noise from torch's generator, so that exact resume needs its state."""

    def __init__(self, config: TrainingConfig, average: float = 0.0, scores: list[float] | None = None) -> None:
        torch.manual_seed(config.seed)
        self.config, self.average, self.scores = config, average, scores
        self.line = torch.nn.Linear(1, 1, bias=False)
        self.network = self.line
        self.averaged = torch.nn.Linear(1, 1, bias=False).requires_grad_(False) if average else None
        self.optimizer = torch.optim.SGD(self.network.parameters(), lr=1.0)
        self.identity = {"learning_rate": config.learning_rate}
        self.score_name = "score" if scores else ""
        self.saved: list[int] = []

    def batches(self, progress):
        steps = range(progress.iteration, min(progress.iteration + self.config.validate_every, self.config.iterations))
        return [torch.full((4, 1), float(1 + step % 3)) for step in steps]

    def losses(self, batch, step):
        error = self.network(batch) - 3 * batch
        return {"square": (error**2).mean(), "noise": (torch.randn(()) * self.line.weight).sum()}

    def learning_rate(self, progress):
        return self.config.learning_rate

    def validate(self, progress):
        return {"score": self.scores[len(progress.history)]} if self.scores else {}

    def save(self, path, progress):
        self.saved.append(progress.iteration)

    def summary(self, record, progress):
        return f"step {progress.iteration}"


CONFIG = TrainingConfig(iterations=6, learning_rate=0.02, validate_every=2)


def silent(line: str) -> None:
    del line


def test_one_step_is_that_of_gradient_descent(tmp_path):
    task = Line(TrainingConfig(iterations=1, learning_rate=0.02))
    before = task.line.weight.item()
    state = torch.get_rng_state()
    noise = torch.randn(()).item()
    torch.set_rng_state(state)
    loop.train(task, tmp_path, say=silent)
    assert task.line.weight.item() == pytest.approx(before - 0.02 * (2 * (before - 3) + noise), rel=1e-5)


def test_a_killed_run_ends_like_one_that_was_not(tmp_path):
    class KilledError(Exception):
        pass

    def dies(line: str) -> None:
        if line.startswith("step 4"):
            raise KilledError

    whole = Line(CONFIG, average=0.9)
    loop.train(whole, tmp_path / "whole", say=silent)
    with pytest.raises(KilledError):
        loop.train(Line(CONFIG, average=0.9), tmp_path / "killed", say=dies)
    lines: list[str] = []
    resumed = Line(CONFIG, average=0.9)
    loop.train(resumed, tmp_path / "killed", say=lines.append)
    assert lines == ["going on from step 4", "step 6"]
    assert torch.equal(whole.line.weight, resumed.line.weight)
    average, resumed_average = (task.candidate.state_dict()["weight"] for task in (whole, resumed))
    assert torch.equal(average, resumed_average)
    assert not torch.equal(average, whole.line.weight)
    histories = [json.loads((tmp_path / name / HISTORY_FILE).read_text()) for name in ("whole", "killed")]
    assert histories[0] == histories[1]
    assert [record["iteration"] for record in histories[0]] == [2, 4, 6]


def test_the_best_is_kept_or_without_a_score_the_last(tmp_path):
    scored, unscored = Line(CONFIG, scores=[0.2, 0.5, 0.1]), Line(CONFIG)
    progress = loop.train(scored, tmp_path / "scored", say=silent)
    assert scored.saved == [2, 4]
    assert (progress.best, progress.best_iteration) == (0.5, 4)
    loop.train(unscored, tmp_path / "unscored", say=silent)
    assert unscored.saved == [2, 4, 6]


def test_training_stops_when_the_score_is_flat(tmp_path):
    task = Line(TrainingConfig(iterations=100, learning_rate=0.02, validate_every=1), scores=[0.2] * 100)
    task.patience = 3
    assert loop.train(task, tmp_path, say=silent).iteration == 4


def test_the_running_average_is_one_of_weights(tmp_path):
    task = Line(TrainingConfig(iterations=3, learning_rate=0.02, validate_every=1), average=0.15)
    assert task.averaged is not None
    expected = task.averaged.state_dict()["weight"].item()
    weights: list[float] = []
    loop.train(task, tmp_path, say=lambda line: weights.append(task.line.weight.item()))
    weights = weights[-3:]  # the first line may be a note
    for step, weight in enumerate(weights):
        decay = min(0.15, (1 + step) / (10 + step))
        expected = decay * expected + (1 - decay) * weight
    assert task.averaged.state_dict()["weight"].item() == pytest.approx(expected, rel=1e-5)


def test_losses_that_are_no_numbers_and_folders_of_other_runs_are_refused(tmp_path):
    loop.train(Line(CONFIG), tmp_path, say=silent)
    with pytest.raises(UsageError, match="other data or settings"):
        loop.train(Line(TrainingConfig(learning_rate=0.5)), tmp_path, say=silent)
    (tmp_path / CHECKPOINT_FILE).write_bytes(b"PK\x03\x04 broken")
    with pytest.raises(SbmError, match="is damaged"):
        loop.train(Line(CONFIG), tmp_path, say=silent)
    broken, others = Line(CONFIG), set(threading.enumerate())
    torch.nn.init.constant_(broken.line.weight, float("nan"))
    with pytest.raises(SbmError, match="training broke down in step 0"):
        loop.train(broken, tmp_path / "broken", say=silent)
    assert set(threading.enumerate()) <= others, "curves are still being written"


@pytest.mark.parametrize(
    "saved",
    [
        {"progress": {"iteration": 5, "best": 0.5, "best_iteration": 3, "history": [{"loss": 1.0}]}},
        {"state": {"step": 5, "minutes": 2.5, "history": [{"step": 5}]}},  # of pre-training
    ],
)
def test_checkpoints_written_before_are_gone_on_from(tmp_path, saved):
    content = {name: json.dumps(value) for name, value in saved.items()}
    torch.save({"identity": "{}", "network": {}, **content}, tmp_path / CHECKPOINT_FILE)
    progress = load_checkpoint(tmp_path, "{}", "cpu", lambda state: None)
    assert isinstance(progress, Progress)
    assert progress.iteration == 5
    assert len(progress.history) == 1
    assert progress.minutes in (0.0, 2.5)


@pytest.mark.parametrize("stop_at", [1, 2, 3, 4, 5])
def test_a_run_that_is_told_to_stop_keeps_every_batch_and_ends_like_one_that_was_not(tmp_path, stop_at):
    class Told(Line):
        def batches(self, progress):
            every = self.config.validate_every
            last = min((progress.iteration // every + 1) * every, self.config.iterations)
            return [torch.full((4, 1), float(1 + step % 3)) for step in range(progress.iteration, last)]

        def losses(self, batch, step):
            if step + 1 == stop_at:
                stop.set()
            return super().losses(batch, step)

    stop = StopRequest()
    whole = Line(CONFIG)
    expected = loop.train(whole, tmp_path / "whole", say=silent)
    with pytest.raises(KeyboardInterrupt):
        loop.train(Told(CONFIG), tmp_path / "told", say=silent, stop=stop)
    assert (
        load_checkpoint(tmp_path / "told", json.dumps({"learning_rate": 0.02}), "cpu", lambda state: None).iteration
        == stop_at
    )
    stop.clear()
    stop_at = 0
    resumed = Told(CONFIG)
    progress = loop.train(resumed, tmp_path / "told", say=silent, stop=stop)
    assert torch.equal(resumed.line.weight, whole.line.weight)
    assert progress.history == expected.history
    assert [one["iteration"] for one in progress.history] == [2, 4, 6]


class Clock:
    """A clock of the loop that tests turn."""

    def __init__(self) -> None:
        self.now_s = 1000.0

    def monotonic(self) -> float:
        return self.now_s


class Slow(Line):
    """Every batch takes a minute, and epochs go on from any batch."""

    clock: Clock

    def batches(self, progress):
        every = self.config.validate_every
        last = min((progress.iteration // every + 1) * every, self.config.iterations)
        return [torch.full((4, 1), float(1 + step % 3)) for step in range(progress.iteration, last)]

    def losses(self, batch, step):
        self.clock.now_s += 60
        return super().losses(batch, step)


def test_lines_and_bars_tell_of_the_whole_training(tmp_path, monkeypatch):
    clock, bars, lines = Clock(), [], []
    monkeypatch.setattr(loop, "time", clock)

    def bar(batches, **options):
        bars.append((options["initial"], options["total"]))
        return batches

    task = Slow(CONFIG)
    task.clock = clock
    loop.train(task, tmp_path, say=lines.append, bar=bar)
    assert lines == ["step 2; at most 4 min left", "step 4; at most 2 min left", "step 6"]
    assert bars == [(0, 6), (2, 6), (4, 6)]


def test_a_run_that_is_killed_between_validations_loses_five_minutes_at_most(tmp_path, monkeypatch):
    class Killed(Slow):
        def losses(self, batch, step):
            if step == die_at:
                raise MemoryError
            return super().losses(batch, step)

    clock = Clock()
    monkeypatch.setattr(loop, "time", clock)
    config = TrainingConfig(iterations=20, learning_rate=0.02, validate_every=20)
    Slow.clock = clock
    whole = Slow(config)
    loop.train(whole, tmp_path / "whole", say=silent)
    die_at = 13
    with pytest.raises(MemoryError):
        loop.train(Killed(config), tmp_path / "killed", say=silent)
    identity = json.dumps({"learning_rate": 0.02})
    assert load_checkpoint(tmp_path / "killed", identity, "cpu", lambda state: None).iteration == 10
    die_at = -1
    resumed = Killed(config)
    loop.train(resumed, tmp_path / "killed", say=silent)
    assert torch.equal(resumed.line.weight, whole.line.weight)
    histories = [(tmp_path / name / HISTORY_FILE).read_text() for name in ("whole", "killed")]
    assert histories[0] == histories[1]


@pytest.mark.parametrize("killed_at", [10, 20])
def test_a_validation_that_was_cut_off_is_made_by_the_run_that_goes_on(tmp_path, monkeypatch, killed_at):
    class Killed(Slow):
        def validate(self, progress):
            if progress.iteration == killed_at:
                raise MemoryError
            return super().validate(progress)

    monkeypatch.setattr(loop, "time", clock := Clock())
    config = TrainingConfig(iterations=20, learning_rate=0.02, validate_every=10)
    Slow.clock = clock
    whole = Slow(config)
    loop.train(whole, tmp_path / "whole", say=silent)
    with pytest.raises(MemoryError):
        loop.train(Killed(config), tmp_path / "killed", say=silent)
    resumed = Slow(config)
    loop.train(resumed, tmp_path / "killed", say=silent)
    histories = [(tmp_path / name / HISTORY_FILE).read_text() for name in ("whole", "killed")]
    assert histories[0] == histories[1]
    assert resumed.saved[-1] == 20
    assert torch.equal(resumed.line.weight, whole.line.weight)


class Dropped(Line):
    """Its batches are those of the loop, and its network draws from torch's generator."""

    def __init__(self, config: TrainingConfig) -> None:
        super().__init__(config)
        self.dataset = [torch.full((1,), float(1 + number % 3)) for number in range(4 * config.iterations)]
        self.collate, self.workers = torch.stack, 0

    def batches(self, progress):
        return loop.TrainingTask.batches(self, progress)

    def losses(self, batch, step):
        if step + 1 == self.stop_at:
            self.stop.set()
        return {"square": (torch.nn.functional.dropout(self.network(batch) - 3 * batch) ** 2).mean()}

    stop, stop_at = StopRequest(), 0


def test_a_run_that_goes_on_between_validations_draws_what_it_would_have_drawn(tmp_path):
    config = TrainingConfig(iterations=6, learning_rate=0.02, validate_every=6, batch_size=4)
    whole, told, resumed = Dropped(config), Dropped(config), Dropped(config)
    for task, out in ((whole, "whole"), (told, "told"), (resumed, "told")):
        torch.manual_seed(1)
        task.stop, task.stop_at = StopRequest(), 3 if task is told else 0
        if task is told:
            with pytest.raises(KeyboardInterrupt):
                loop.train(task, tmp_path / out, say=silent, stop=task.stop)
        else:
            loop.train(task, tmp_path / out, say=silent, stop=task.stop)
    assert torch.equal(resumed.line.weight, whole.line.weight)
    assert not torch.equal(told.line.weight, whole.line.weight)
