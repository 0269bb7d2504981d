"""Losses, scores, reprojection and training, against brute force and on rooms of boxes."""

import numpy as np
import pytest
import torch

from labeling.core.errors import UsageError
from labeling.memory.settings.train_config import TrainMemoryConfig
from labeling.memory.view_prediction.evaluation import drawn_views, evaluate, predictor, score_pictures
from labeling.memory.view_prediction.losses import info_nce, margin_loss, pick_places, pixel_loss
from labeling.memory.view_prediction.reprojection import reproject_views
from labeling.memory.view_prediction.samples import ViewSamples, collate
from labeling.memory.view_prediction.scenes import small_scene
from labeling.memory.view_prediction.scores import l1, picture_distances, psnr, retrieved, ssim
from labeling.memory.view_prediction.training import MemoryTask
from labeling.training.checkpoint import Progress
from labeling.training.loop import train

from .orbits import orbit_episode, ring
from .test_networks import TINY, replace, scene

# Losses --------------------------------------------------------------------------------------------------------------


def unit(count: int, seed: int, size: int = 6) -> torch.Tensor:
    return torch.nn.functional.normalize(torch.randn(count, size, generator=torch.Generator().manual_seed(seed)), dim=1)


@pytest.mark.parametrize("hard", [1, 3, 100])
def test_the_margin_loss_is_the_papers_by_brute_force(hard):
    top, bottom, margin = unit(9, 0), unit(9, 1), 1.1
    expected = 0.0
    for i in range(9):
        expected += max(float((top[i] - bottom[i]).norm()) - margin, 0.0) / 9
        apart = sorted(float((top[i] - one).norm()) for j, one in enumerate(bottom) if j != i)[:hard]
        expected += sum(max(margin - one, 0.0) for one in apart) / len(apart) / 9
    assert margin_loss(top, bottom, margin, hard).item() == pytest.approx(expected, abs=1e-4)


def test_no_pair_within_the_margin_and_no_other_inside_of_it_costs_nothing():
    top = torch.eye(6)
    assert margin_loss(top, top, 0.5, 4).item() == 0
    assert margin_loss(top, top.roll(1, dims=0), 0.5, 4).item() > 0.5


def test_info_nce_is_the_log_of_a_share_by_brute_force():
    top, bottom = unit(7, 0), unit(7, 1)
    shares = [
        torch.exp(top[i] @ bottom[i] / 0.2) / sum(torch.exp(top[i] @ one / 0.2) for one in bottom) for i in range(7)
    ]
    assert info_nce(top, bottom, 0.2).item() == pytest.approx(-np.mean([float(s.log()) for s in shares]), abs=1e-4)


def test_pixel_losses_are_least_at_the_truth():
    rgb = torch.rand(2, 3, 4, 4) * 0.8 + 0.1
    logits = torch.logit(rgb)
    for kind in ("l1", "cross_entropy"):
        best = pixel_loss(logits, rgb, kind)
        assert all(pixel_loss(logits + shift, rgb, kind) > best for shift in (-0.1, 0.1))
    assert pixel_loss(logits, rgb).item() == pytest.approx(0, abs=1e-5)


def test_places_are_drawn_among_those_allowed_and_by_the_generator():
    allowed = torch.arange(20) % 3 == 0
    first, again = (pick_places(allowed, 4, torch.Generator().manual_seed(5)) for _ in range(2))
    assert torch.equal(first, again)
    assert len(first) == len(set(first.tolist())) == 4
    assert allowed[first].all()
    assert sorted(pick_places(allowed, 99, torch.Generator()).tolist()) == list(range(0, 20, 3))


# Scores --------------------------------------------------------------------------------------------------------------


def test_ssim_is_that_of_the_paper_by_brute_force():
    rng = np.random.default_rng(0)
    a = rng.random((1, 3, 14, 13))
    b = np.clip(a + rng.normal(0, 0.2, a.shape), 0, 1)
    line = np.exp(-0.5 * ((np.arange(11) - 5) / 1.5) ** 2)
    window = np.outer(line, line) / line.sum() ** 2
    found = []
    for channel in range(3):
        for y in range(4):
            for x in range(3):
                p, q = a[0, channel, y : y + 11, x : x + 11], b[0, channel, y : y + 11, x : x + 11]
                mp, mq = (window * p).sum(), (window * q).sum()
                vp, vq = (window * (p - mp) ** 2).sum(), (window * (q - mq) ** 2).sum()
                cov = (window * (p - mp) * (q - mq)).sum()
                found.append((2 * mp * mq + 1e-4) * (2 * cov + 9e-4) / ((mp**2 + mq**2 + 1e-4) * (vp + vq + 9e-4)))
    one, other = (torch.from_numpy(x).float() for x in (a, b))
    assert ssim(one, other).item() == pytest.approx(np.mean(found), abs=1e-4)
    assert ssim(one, one).item() == pytest.approx(1, abs=1e-5)
    assert psnr(one, other).item() == pytest.approx(-10 * np.log10(((a - b) ** 2).mean()), abs=1e-3)
    assert l1(one, other).item() == pytest.approx(np.abs(a - b).mean(), abs=1e-5)


def test_a_picture_is_retrieved_if_no_other_is_nearer():
    pictures = torch.rand(5, 3, 8, 8)
    assert retrieved(picture_distances(pictures + 0.01, pictures)).all()
    assert not retrieved(picture_distances(pictures.roll(1, dims=0), pictures)).any()


def test_more_inputs_come_in_addition_and_targets_stay():
    one = scene(1, 9)
    few, many = drawn_views(one, 1, 4), drawn_views(one, 4, 4)
    assert few[1] == many[1]
    assert many[0][:1] == few[0]
    assert not set(many[0]) & set(many[1])


# Reprojection --------------------------------------------------------------------------------------------------------


def test_a_view_reprojected_into_itself_is_itself():
    one = scene(2)
    views = one.views([3], 3)
    assert (reproject_views(views, views) - views.rgb[0]).abs().mean() < 0.05
    assert (reproject_views(views, views) - views.rgb[0]).abs().median() < 0.02


def test_views_all_around_tell_more_than_one():
    def predict(views, cameras):
        return reproject_views(views, cameras)

    scenes = [scene(seed, 10) for seed in (1, 2)]
    one, four = (score_pictures(predict, scenes, inputs, 4) for inputs in (1, 4))
    assert np.mean(four["psnr"]) > np.mean(one["psnr"]) + 0.5
    assert len(one["l1"]) == 8


# Training ------------------------------------------------------------------------------------------------------------

QUICK = TrainMemoryConfig(iterations=4, validate_every=2, inputs=3, targets=2, pairs=32, hard_negatives=4)


def silent(line: str) -> None:
    del line


def test_samples_are_functions_of_their_number():
    scenes = [scene(1), scene(2)]
    data, again = (ViewSamples(scenes, 3, 2, 2, seed=5) for _ in range(2))
    counts = set()
    for number in range(0, 12, 2):
        batch = collate([data[number], data[number + 1]])
        assert torch.equal(batch.inputs.rgb, collate([again[number], again[number + 1]]).inputs.rgb)
        counts.add(batch.inputs.rgb.shape[1])
        assert batch.targets.rgb.shape[:2] == (2, 2)
        same = (batch.inputs.rgb[0][:, None] - batch.targets.rgb[0][None]).abs().flatten(2).sum(dim=2)
        assert same.min() > 0
        assert batch.inputs.camera_to_grid[0, 0, 1, 2].abs() < 1e-5  # the first view's heading is +X
    assert counts == {1, 2, 3}


def test_a_short_episode_takes_views_from_its_own_batches_only():
    data = ViewSamples([scene(1, 9), scene(2, 3)], 6, 2, 2, seed=5)
    shapes: dict[bool, set[tuple[int, int]]] = {True: set(), False: set()}
    for number in range(0, 200, 2):
        batch = collate([data[number], data[number + 1]])
        of_short = any(data.draws.scene(one)[0] == 1 for one in (number, number + 1))
        shapes[of_short].add((batch.inputs.rgb.shape[1], batch.targets.rgb.shape[1]))
    assert shapes == {True: {(1, 2)}, False: {(inputs, 2) for inputs in range(1, 7)}}


@pytest.mark.slow
@pytest.mark.parametrize("model", ["grnn", "cn3d", "tower"])
def test_a_run_that_goes_on_ends_like_one_that_never_stopped(tmp_path, model):
    scenes = [scene(1), scene(2)]
    spec = replace(TINY, model=model)

    def task(iterations=4):
        return MemoryTask(spec, scenes, [scene(3)], replace(QUICK, iterations=iterations))

    whole = task()
    train(whole, tmp_path / "whole", silent)

    class KilledError(Exception):
        pass

    def dies(line: str) -> None:
        raise KilledError

    with pytest.raises(KilledError):
        train(task(), tmp_path / "killed", dies)
    resumed = task()
    progress = train(resumed, tmp_path / "killed", silent)
    assert progress.iteration == 4
    for (name, value), other in zip(
        whole.network.state_dict().items(), resumed.network.state_dict().values(), strict=True
    ):
        assert torch.equal(value, other), name


@pytest.mark.slow
def test_a_run_does_not_go_on_from_one_with_other_episodes_of_the_same_names(tmp_path):
    def task(*seeds: int) -> MemoryTask:
        scenes = [replace(scene(seed), name=f"{number:04d}") for number, seed in enumerate(seeds)]
        return MemoryTask(TINY, scenes[:1], scenes[1:], replace(QUICK, iterations=1, validate_every=1))

    train(task(1, 2), tmp_path, silent)
    for others in ((3, 2), (1, 3)):
        with pytest.raises(UsageError, match="holds a run with other data or settings"):
            train(task(*others), tmp_path, silent)
    assert train(task(1, 2), tmp_path, silent).iteration == 1


def test_what_is_learnt_from_is_told_apart_by_pixels_depths_and_poses():
    episode = orbit_episode(1, ring(1, 5))
    known = small_scene("one", episode, TINY).digest
    assert small_scene("other", episode, TINY).digest == known
    for name in ("rgb", "depth_m", "camera_to_world"):
        array = getattr(episode, name).copy()
        array[3] = array[2]
        assert small_scene("one", replace(episode, **{name: array}), TINY).digest != known


def test_settings_that_make_no_sense_are_refused():
    with pytest.raises(UsageError, match="--margin must be above 0"):
        MemoryTask(TINY, [scene(1)], [], replace(QUICK, margin=0.0))


@pytest.mark.nightly
def test_grnn_learns_to_predict_views_of_a_room():
    """On the scenes it learns from, better than a picture of the mean colour and than the nearest input view."""
    torch.manual_seed(0)
    scenes = [scene(seed, 8) for seed in (1, 2)]
    task = MemoryTask(TINY, scenes, [], TrainMemoryConfig(iterations=400, learning_rate=3e-3, inputs=3))
    first = np.mean(evaluate(task.network, scenes, 3, 4)["l1"])
    for step in range(400):
        losses = task.losses(collate([task.dataset[2 * step], task.dataset[2 * step + 1]]), step)
        task.optimizer.zero_grad()
        sum(losses.values()).backward()
        task.optimizer.step()
    found = score_pictures(predictor(task.network.eval()), scenes, 3, 4)
    means = [
        (one.views([0], 0).rgb - one.views(list(range(8)), 0).rgb.mean(dim=(0, 1, 3, 4))[:, None, None])
        for one in scenes
    ]
    assert np.mean(found["l1"]) < 0.6 * first
    assert np.mean(found["l1"]) < 0.7 * float(torch.stack(means).abs().mean())
    assert np.mean(found["view_r1"]) >= 0.75


@pytest.mark.nightly
def test_cn3d_finds_held_out_pixels_ten_times_as_often_as_chance(tmp_path):
    spec = replace(TINY, model="cn3d", channels=16, embedding=16)
    scenes = [small_scene(f"toys_{seed}", orbit_episode(seed, ring(seed, 8)), spec) for seed in range(12)]
    task = MemoryTask(spec, scenes[:10], [], TrainMemoryConfig(iterations=300, inputs=4, validate_every=300))
    train(task, tmp_path, silent)
    found = evaluate(task.network, scenes[10:], 4, 4)
    assert np.mean(found["pixel_r1"]) >= 10 * np.mean(found["chance"])
    assert Progress().iteration == 0
