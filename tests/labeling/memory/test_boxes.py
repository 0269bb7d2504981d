"""Boxes in a memory: targets, losses, decoding, the network, against independent oracles."""

import json
from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from labeling.core.box_overlap import box_iou_3d
from labeling.core.errors import EpisodeFormatError, UsageError
from labeling.core.types import Box3d
from labeling.detectors3d.several_views import SceneDetection3d
from labeling.detectors3d.upright_boxes import encode_box
from labeling.io.episodes import box_3d_record, write_episode
from labeling.io.file_names import BOXES_FILE, MODAL_FILE
from labeling.memory.boxes import box_evaluation
from labeling.memory.boxes.box_decoding import find_boxes, in_world, peaks
from labeling.memory.boxes.box_detector import load_box_net
from labeling.memory.boxes.box_evaluation import evaluate, inside_grid, instances_to_find, spread_views
from labeling.memory.boxes.box_losses import filled_loss, heat_loss, number_losses
from labeling.memory.boxes.box_net import BoxHead, BoxOutput
from labeling.memory.boxes.box_samples import BoxSamples, collate, filled_voxels, scene_targets
from labeling.memory.boxes.box_targets import BoxTargets, GridBox, box_targets, other_name
from labeling.memory.boxes.box_training import BoxTask
from labeling.memory.boxes.labelled_scenes import LabelledScene, read_labelled_scenes, true_scene
from labeling.memory.networks.scene_memory import SceneMemory
from labeling.memory.networks.tower import Tower
from labeling.memory.networks.weights import build_memory
from labeling.memory.settings.box_settings import TrainBoxesConfig
from labeling.memory.settings.grid_spec import GridSpec
from labeling.memory.settings.memory_spec import MemorySpec
from labeling.training.config import WEIGHTS_FILE
from labeling.training.loop import train

from ..detectors3d.boxed_rooms import boxed_room, known_of, upright

GRID = GridSpec((8, 16, 20), 0.25)
TINY = MemorySpec("cn3d", GridSpec((8, 16, 16), 0.3), 8, 8, 8, 8, (32, 32))
STANDING = np.eye(4)


def grid_box(x: float, y: float, sides: tuple[float, float, float], yaw: float, category: int = 0) -> GridBox:
    """A box on the floor of ``GRID``."""
    numbers = encode_box(upright(x, y, sides, yaw))
    numbers[2] -= 0.9
    return GridBox(torch.from_numpy(numbers.astype(np.float32)), category)


def said(targets: BoxTargets) -> tuple[torch.Tensor, torch.Tensor]:
    """Heat and numbers of a network that says exactly what it is to say, of one scene."""
    return targets.heat[0], targets.numbers[0]


SIDES = st.tuples(*[st.floats(0.3, 1.8)] * 3)
PLACES = st.lists(
    st.tuples(st.integers(0, 3), st.integers(0, 4)), min_size=1, max_size=5, unique=True
)  # in cells of 4 x 4 columns, so that boxes are told apart


@st.composite
def boxes_apart(draw: st.DrawFn) -> list[GridBox]:
    found = []
    for row, column in draw(PLACES):
        x, y = (-half + 1.0 * (place + draw(st.floats(0.3, 0.7))) for place, half in ((column, 2.5), (row, 2.0)))
        sides = draw(SIDES)
        # Boxes of one category that overlap are taken for one object: by NMS, not by what is learnt.
        found.append(grid_box(x, y, sides, draw(st.floats(0, 3.1)), len(found)))
    return found


# Targets and decoding -------------------------------------------------------------------------------------------------


@settings(max_examples=15)
@given(boxes_apart())
def test_what_is_to_be_said_of_boxes_gives_them_back(boxes):
    found = find_boxes(*said(box_targets(boxes, 5, GRID)), GRID, STANDING)
    assert [score for _, score, _ in found] == [1.0] * len(boxes)
    by_category = {category: box for category, _, box in found}
    for one in boxes:
        numbers = one.numbers.numpy().astype(float)
        true = Box3d(numbers[:3], numbers[3:6], upright(0, 0, (1, 1, 1), numbers[6]).rotation)
        assert box_iou_3d(by_category[one.category], true) > 0.999


@settings(max_examples=20)
@given(st.floats(-0.9, 0.9), st.floats(-0.9, 0.9), SIDES, st.floats(0, 3.1), st.integers(-4, 4), st.integers(-3, 3))
def test_a_scene_shifted_by_whole_voxels_has_its_boxes_shifted(x, y, sides, yaw, columns, rows):
    one = grid_box(x, y, sides, yaw)
    shift = torch.tensor([columns * GRID.voxel_m, rows * GRID.voxel_m, 0, 0, 0, 0, 0])
    before = box_targets([one], 1, GRID)
    after = box_targets([replace(one, numbers=one.numbers + shift)], 1, GRID)
    rolled = (rows, columns), (-2, -1)
    if before.weight.roll(*rolled).equal(after.weight):  # else the middle lies on an edge of a voxel
        torch.testing.assert_close(before.numbers.roll(*rolled), after.numbers, atol=1e-4, rtol=0)
    ours, theirs = (find_boxes(*said(targets), GRID, STANDING)[0][2] for targets in (before, after))
    np.testing.assert_allclose(theirs.centre_m - ours.centre_m, shift[:3], atol=1e-4)
    np.testing.assert_allclose(theirs.extent_m, ours.extent_m, atol=1e-4)


@settings(max_examples=20)
@given(SIDES, st.floats(-3, 3), st.sampled_from([0.0, np.pi]), st.booleans())
def test_all_names_of_a_box_ask_for_the_same(sides, yaw, turn, exchanged):
    other = upright(0.1, 0.2, (sides[1], sides[0], sides[2]), yaw + turn + np.pi / 2)
    same = upright(0.1, 0.2, sides, yaw + turn)
    numbers = [encode_box(box) for box in (upright(0.1, 0.2, sides, yaw), other if exchanged else same)]
    one, another = (
        box_targets([GridBox(torch.from_numpy(one.astype(np.float32)), 0)], 1, GRID).numbers.numpy() for one in numbers
    )
    if sides[0] != sides[1]:
        np.testing.assert_allclose(one, another, atol=1e-4)


def test_a_grid_that_is_turned_finds_boxes_where_they_stand():
    yaw, centre = 0.7, np.array([3.0, -2.0, 1.0])
    grid_to_world = np.eye(4)
    grid_to_world[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
    grid_to_world[:3, 3] = centre
    true = upright(3.4, -2.5, (1.2, 0.5, 0.8), 1.9)
    numbers = encode_box(in_world(true, np.linalg.inv(grid_to_world)))
    targets = box_targets([GridBox(torch.from_numpy(numbers.astype(np.float32)), 0)], 1, GRID)
    ((_, _, found),) = find_boxes(*said(targets), GRID, grid_to_world)
    assert box_iou_3d(found, true) > 0.999


def test_boxes_outside_of_the_grid_are_not_asked_for_and_larger_ones_win_a_column():
    outside = box_targets([grid_box(2.6, 0, (1, 1, 1), 0), grid_box(0, -2.1, (1, 1, 1), 0)], 1, GRID)
    assert not outside.heat.any()
    assert not outside.weight.any()
    small, large = grid_box(0.1, 0.1, (0.4, 0.4, 0.4), 0), grid_box(0.12, 0.1, (1.0, 0.9, 0.4), 0, category=1)
    for order in ([small, large], [large, small]):
        targets = box_targets(order, 2, GRID)
        assert targets.weight.sum() == 1
        assert targets.numbers[0, 3].exp().max() == pytest.approx(1.0)
        assert targets.heat.amax(dim=(0, 2, 3)).tolist() == [1, 1]


def test_what_does_not_count_is_neither_right_nor_wrong():
    unknown = replace(grid_box(0.1, 0.1, (1, 1, 1), 0), counts=False)
    targets = box_targets([unknown], 2, GRID)
    assert not targets.heat.any()
    y, x = 8, 10
    assert targets.known[0, :, y, x].tolist() == [0, 1]
    said_there = torch.full_like(targets.heat, -9.0)
    said_there[0, 0, y, x] = 9.0
    nothing = torch.full_like(targets.heat, -9.0)
    costs = [heat_loss(logits, targets.heat, targets.known, targets.weight).item() for logits in (said_there, nothing)]
    assert costs[0] == pytest.approx(costs[1], abs=1e-6)


def test_peaks_are_those_of_brute_force():
    heat = torch.rand(2, 7, 9, generator=torch.Generator().manual_seed(3))
    expected = set()
    for k in range(2):
        for y in range(7):
            for x in range(9):
                around = heat[k, max(0, y - 1) : y + 2, max(0, x - 1) : x + 2]
                if heat[k, y, x] == around.max() and heat[k, y, x] >= 0.02:
                    expected.add((k, y, x))
    scores, places = peaks(heat)
    assert {tuple(one) for one in places.tolist()} == expected
    assert scores.tolist() == sorted(scores.tolist(), reverse=True)
    assert len(peaks(heat, most=3)[0]) == 3


# Losses ---------------------------------------------------------------------------------------------------------------


def test_the_heat_loss_is_the_papers_by_brute_force():
    generator = torch.Generator().manual_seed(0)
    targets = box_targets([grid_box(0.1, 0.1, (1, 0.5, 1), 0), grid_box(1.4, 0.9, (1, 1, 1), 0)], 1, GRID)
    weight = 0.5 * targets.weight
    logits = torch.randn(targets.heat.shape, generator=generator)
    total = 0.0
    for place in np.ndindex(*targets.heat.shape):
        p, y = float(logits[place].sigmoid()), float(targets.heat[place])
        if y == 1:
            total -= 0.5 * (1 - p) ** 2 * np.log(p)
        else:
            total -= (1 - y) ** 4 * p**2 * np.log(1 - p)
    assert heat_loss(logits, targets.heat, targets.known, weight).item() == pytest.approx(total / 1.0, rel=1e-3)


def test_what_is_right_costs_nothing_and_so_does_the_other_name_of_a_square():
    square, long = grid_box(0.1, 0.1, (1.0, 0.9, 0.7), 0.4), grid_box(-1.4, 0.9, (1.6, 0.5, 0.7), 1.2)
    for one, matters in ((square, False), (long, True)):
        targets = box_targets([one], 1, GRID)
        assert sum(number_losses(targets.numbers, targets).values()).item() == pytest.approx(0, abs=1e-6)
        flat = targets.numbers.movedim(1, -1).reshape(-1, 8)
        renamed = other_name(flat).reshape(1, 16, 20, 8).movedim(-1, 1)
        assert (sum(number_losses(renamed, targets).values()).item() > 0.1) == matters


def test_losses_of_numbers_are_weighted_means_and_none_without_a_box():
    light, heavy = replace(grid_box(0.1, 0.1, (1, 0.5, 1), 0), weight=0.2), grid_box(1.4, 0.9, (1, 0.5, 1), 0)
    targets = box_targets([light, heavy], 1, GRID)
    numbers = targets.numbers.clone()
    numbers[:, 2] += (targets.weight[:, 0] == 1) * 0.6
    assert number_losses(numbers, targets)["place"].item() == pytest.approx(0.6 / 1.2, rel=1e-5)
    empty = box_targets([], 1, GRID)
    assert sum(number_losses(torch.ones_like(empty.numbers), empty).values()).item() == 0


def test_filled_and_empty_voxels_weigh_the_same():
    filled = torch.zeros(1, 1, 2, 2, 5)
    filled[0, 0, 0, 0, 0] = 1
    assert filled_loss(torch.zeros_like(filled), filled).item() == pytest.approx(np.log(2))
    assert filled_loss(20 * filled - 10, filled).item() < 1e-3
    assert filled_loss(torch.full_like(filled, -10), filled).item() == pytest.approx(5, rel=1e-3)


def test_points_fill_the_voxels_that_they_lie_in():
    points = torch.tensor([[0.1, 0.1, 0.1], [-2.4, -1.9, -0.9], [99.0, 0, 0]])
    filled = filled_voxels(points, GRID)[0, 0]
    assert torch.nonzero(filled).tolist() == [[0, 0, 0], [4, 8, 10]]


# Scenes and samples ---------------------------------------------------------------------------------------------------


def test_the_truth_of_an_episode_is_asked_for_where_it_stands_and_seen_surfaces_lie_in_it():
    episode = boxed_room(2)
    labelled = true_scene(episode, TINY)
    names = sorted({one.category for one, _ in known_of(episode)})
    for first in range(3):
        targets = scene_targets(labelled, [first, 3], names, TINY.grid)
        found = find_boxes(*said(targets), TINY.grid, labelled.scene.grid_to_world(first))
        assert len(found) == sum(one.shown_by[[first, 3]].any() for one in labelled.objects)
        for category, _, box in found:
            assert max(box_iou_3d(box, one.box) for one in labelled.objects if one.category == names[category]) > 0.999
    distance = [
        np.abs((labelled.surface - one.box.centre_m) @ one.box.rotation) / (0.5 * one.box.extent_m)
        for one in labelled.objects
    ]
    outermost = np.min([one.max(axis=1) for one in distance], axis=0)
    assert len(labelled.surface) > 100
    assert np.all(outermost <= 1 + 1e-6)
    assert np.mean(outermost > 0.9) > 0.9


def test_what_no_given_view_shows_need_not_be_found():
    labelled = true_scene(boxed_room(2), TINY)
    hidden = replace(labelled.objects[0], shown_by=np.arange(labelled.scene.num_views) == 1)
    labelled = replace(labelled, objects=(hidden, *labelled.objects[1:]))
    names = sorted({one.category for one in labelled.objects})
    asked = [int(scene_targets(labelled, views, names, TINY.grid).weight.sum()) for views in ([0], [0, 1])]
    assert asked[1] == asked[0] + 1
    ignored = [
        [one.ignore for one in instances_to_find(labelled, [0], names, TINY.grid, shown)] for shown in ([0], [1], "any")
    ]
    assert [one[0] for one in ignored] == [True, False, False]


def test_samples_are_functions_of_their_number():
    scenes = [true_scene(boxed_room(seed), TINY) for seed in (1, 2)]
    samples, again = (BoxSamples(scenes, ["crate", "locker"], TINY.grid, 4, 2, seed=3) for _ in range(2))
    counts = set()
    for number in (0, 5, 17, 40):
        one, other = samples[number], again[number]
        assert torch.equal(one.views.rgb, other.views.rgb)
        assert torch.equal(one.targets.heat, other.targets.heat)
        assert one.views.rgb.shape[1] == samples[number ^ 1].views.rgb.shape[1]
        counts.add(one.views.rgb.shape[1])
    assert len(counts) > 1
    assert counts <= {1, 2, 3, 4}
    batch = collate([samples[0], samples[1]])
    assert batch.targets.heat.shape == (2, 2, 16, 16)


def test_a_short_episode_takes_views_from_its_own_batches_only():
    long, short = true_scene(boxed_room(1, 12), TINY), true_scene(boxed_room(2, 3), TINY)
    assert short.scene.num_views == 3
    alone, both = (BoxSamples(rooms, ["crate"], TINY.grid, 8, 2, seed=3) for rooms in ([long] * 2, [long, short]))
    counts: dict[bool, set[int]] = {True: set(), False: set()}
    for number in range(0, 120, 2):
        first, second = (both[one].views.rgb.shape[1] for one in (number, number + 1))
        assert first == second
        of_short = any(both.draws.scene(one)[0] == 1 for one in (number, number + 1))
        counts[of_short].add(first)
        if not of_short:
            assert torch.equal(both[number].views.rgb, alone[number].views.rgb)
    assert counts[True] == {1, 2, 3}
    assert max(counts[False]) == 8
    task = BoxTask(TINY, [long, short], [], TrainBoxesConfig(views=20, iterations=1))
    assert task.network.spec.views == long.scene.num_views  # what it says that it was trained with


@given(st.integers(1, 40), st.integers(1, 10))
def test_views_are_spread_over_all_of_them(num_views, count):
    found = spread_views(num_views, count)
    assert found == sorted(set(found))
    assert len(found) == min(count, num_views)
    assert found[0] == 0
    gaps = np.diff([*found, num_views])
    assert gaps.max() - gaps.min() <= 1


def test_rooms_of_one_name_are_told_apart(monkeypatch):
    """Episodes of two datasets may both be called 0009."""
    rooms = [true_scene(replace(boxed_room(seed), name="0009"), TINY) for seed in (1, 2)]
    said_of: dict[int, LabelledScene] = {}

    def says(network, scene, chosen, device="cpu"):
        return [SceneDetection3d((0,), one.category, 0.9, one.box) for one in said_of[id(scene)].objects]

    monkeypatch.setattr(box_evaluation, "detect_in", says)
    task = BoxTask(TINY, rooms, [], TrainBoxesConfig(iterations=1))
    found = []
    for order in (rooms, rooms[::-1]):
        said_of = {id(one.scene): other for one, other in zip(rooms, order, strict=True)}
        found.append(evaluate(task.network, rooms, 6)["ap50"])
    assert found[0] == 1
    assert found[1] < 0.5


def test_a_run_does_not_go_on_from_one_with_other_labels_of_the_same_episodes(tmp_path):
    room = true_scene(boxed_room(1), TINY)
    doubted = replace(room, objects=tuple(replace(one, weight=0.5) for one in room.objects))
    config = TrainBoxesConfig(iterations=1, validate_every=1, views=2)
    train(BoxTask(TINY, [room], [], config), tmp_path, say=lambda line: None)
    with pytest.raises(UsageError, match="holds a run with other data or settings"):
        train(BoxTask(TINY, [doubted], [], config), tmp_path, say=lambda line: None)


def test_scores_of_boxes_outside_of_0_to_1_are_refused(tmp_path):
    room, labels = boxed_room(1), tmp_path / "labels"
    write_episode(tmp_path / "episodes" / room.name, room)
    labels.mkdir()
    image = {"id": 1, "width": 128, "height": 96, "episode": room.name, "view": 0, "file_name": "rgb/000.png"}
    modal = {"images": [image], "annotations": [], "categories": [{"id": 1, "name": "crate"}]}
    (labels / MODAL_FILE).write_text(json.dumps(modal))
    record = {"instance_id": 1, "episode": room.name, "score": 7.0, **box_3d_record(upright(0, 0, (1, 1, 1), 0))}
    (labels / BOXES_FILE).write_text(json.dumps({"boxes": [record]}))
    with pytest.raises(EpisodeFormatError, match=r"a score lies in \[0, 1\], not 7"):
        read_labelled_scenes([labels], TINY, dataset=tmp_path / "episodes")


def test_a_box_is_inside_of_the_grid_if_its_middle_is():
    scene = true_scene(boxed_room(1), TINY).scene
    axis = scene.grid_to_world(0)[:3, 0]
    near, far = (
        Box3d(scene.centre_m + away * axis, np.array([3.0, 1, 1]), np.eye(3)) for away in (2.3, 2.5)
    )  # the grid reaches 2.4 m
    assert inside_grid(near, scene, 0, TINY.grid)
    assert not inside_grid(far, scene, 0, TINY.grid)


# The network ----------------------------------------------------------------------------------------------------------


def test_the_head_says_of_a_shifted_memory_what_it_said_shifted():
    torch.manual_seed(0)
    head = BoxHead(4, 4, 8, 2).eval()
    features, occupied = torch.zeros(1, 4, 4, 48, 48), torch.zeros(1, 1, 4, 48, 48)
    features[..., 22:26, 22:26] = torch.randn(1, 4, 4, 4, 4)
    before = head(SceneMemory(features, occupied, torch.ones_like(occupied)))
    after = head(SceneMemory(features.roll((2, -4), (-2, -1)), occupied, torch.ones_like(occupied)))
    inner = slice(14, 34)
    for name in ("heat", "numbers", "filled"):
        one, other = (getattr(output, name) for output in (before, after))
        torch.testing.assert_close(
            one.roll((2, -4), (-2, -1))[..., inner, inner], other[..., inner, inner], atol=1e-4, rtol=1e-4
        )


def test_what_a_memory_imagines_where_nothing_was_seen_makes_no_boxes():
    torch.manual_seed(0)
    head = BoxHead(4, 4, 8, 2).eval()
    features, occupied, seen = torch.randn(1, 4, 4, 16, 16), torch.zeros(1, 1, 4, 16, 16), torch.zeros(1, 1, 4, 16, 16)
    seen[..., :8] = 1
    imagined = torch.where(seen > 0, features, torch.randn_like(features))
    before, after = (head(SceneMemory(one, occupied, seen)) for one in (features, imagined))
    assert torch.equal(before.heat, after.heat)
    assert not torch.equal(before.heat, head(SceneMemory(-features, occupied, seen)).heat)


@pytest.mark.parametrize("model", ["cn3d", "grnn"])
def test_a_memory_knows_what_any_of_its_views_has_seen(model):
    network = build_memory(replace(TINY, model=model)).eval()
    assert not isinstance(network, Tower)
    views = true_scene(boxed_room(1), TINY).scene.views([0, 2], 0)
    memory, mapped = network.remember(views), network.mapper(views)
    expected = ((mapped.occupied + mapped.free) > 0).any(dim=1)
    assert torch.equal(memory.seen > 0, expected)
    assert 0.05 < memory.seen.mean() < 0.95


@pytest.mark.slow
@pytest.mark.parametrize("model", ["cn3d", pytest.param("grnn", marks=pytest.mark.nightly)])
def test_two_rooms_are_learnt_by_heart(model, tmp_path):
    spec = replace(TINY, model=model, width=16)
    scenes = [true_scene(boxed_room(seed, 3), spec) for seed in (1, 2)]
    config = TrainBoxesConfig(iterations=150, views=3, validate_every=25, learning_rate=1e-2, seed=1)
    task = BoxTask(spec, scenes, scenes, config)
    progress = train(task, tmp_path / "run", say=lambda line: None)
    best = load_box_net(tmp_path / "run" / WEIGHTS_FILE)
    assert evaluate(best, scenes, 3)["ap50"] == pytest.approx(1.0), progress.history
    # The best of three views is the first that finds all; with fewer views all is found at the end of training.
    for views in (1, 2, 3):
        assert evaluate(task.candidate, scenes, views)["ap25"] == pytest.approx(1.0)
    assert progress.history[-1]["filled"] < 0.3


def test_heat_maps_of_untrained_networks_say_that_nearly_nothing_is_there():
    scenes = [true_scene(boxed_room(1, 4), TINY)]
    task = BoxTask(TINY, scenes, [], TrainBoxesConfig(iterations=1))
    with torch.inference_mode():
        output = task.network(scenes[0].scene.views([0], 0))
    assert isinstance(output, BoxOutput)
    assert output.heat.sigmoid().mean() == pytest.approx(0.1, abs=0.05)
    sides = output.numbers[0, 3:6].exp().mean(dim=(1, 2)).detach().numpy()
    expected = np.exp(np.mean([np.log(encode_box(one.box)[3:6]) for one in scenes[0].objects], axis=0))
    np.testing.assert_allclose(sides, expected, rtol=0.5)
