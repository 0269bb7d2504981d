"""Episodes of a scene that are labelled together: what one recording of all views gives is the oracle."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from labeling.core.episode import Episode
from labeling.formats.ply import read_ply
from labeling.generate import main
from labeling.generator.propagate import propagate
from labeling.generator.settings.label_config import LabelConfig
from labeling.generator.sharing import label_together
from labeling.generator.sharing.joined_episodes import join_episodes, split_labels
from labeling.generator.sharing.label_together import MAX_EPISODES, groups_to_label
from labeling.inspection.checks import inspect_label_set
from labeling.io.episodes import write_episode

from ...synthetic_room import make_episode, pick

VISITS = ([0, 3, 6, 9], [1, 4, 7, 10], [2, 5, 8, 11])


@pytest.fixture(scope="module")
def whole() -> Episode:
    return make_episode(3, num_views=12, size=(90, 120), num_objects=4, wrong_class=0.0)


@pytest.fixture(scope="module")
def visits(whole: Episode) -> list[Episode]:
    return [replace(pick(whole, views), metadata={"world": "rooms", "scene": "room_3"}) for views in VISITS]


@pytest.fixture(scope="module")
def dataset(visits: list[Episode], tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("visits")
    for number, visit in enumerate(visits):
        write_episode(folder / f"visit_{number}", visit)
    return folder


def labelled(dataset: Path, out: Path, *options: str) -> Path:
    assert main([str(dataset), "--share-scenes", "--out", str(out), *options]) == 0
    return out


@pytest.fixture(scope="module")
def together(dataset: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return labelled(dataset, tmp_path_factory.mktemp("labels") / "together")


def annotations(labels: Path, episode: str | None = None) -> list[dict]:
    content = json.loads((labels / "instances_modal.json").read_text())
    images = {one["id"]: one for one in content["images"]}
    return [one for one in content["annotations"] if episode in (None, images[one["image_id"]]["episode"])]


@pytest.mark.slow
def test_the_parts_are_those_of_one_recording(visits: list[Episode]) -> None:
    views, detections = join_episodes(visits, [one.detections or () for one in visits])
    labels = propagate(views, detections)
    parts = split_labels(labels, [one.num_views for one in visits])
    assert len(labels.objects) >= 3
    found, start = [], 0
    for visit, part in zip(visits, parts, strict=True):
        whole_of = {}
        for own, one in zip(
            part.labels.labels,
            [one for one in labels.labels if start <= one.view_index < start + visit.num_views],
            strict=True,
        ):
            assert own.view_index == one.view_index - start
            assert own.modal is one.modal
            assert own.amodal is one.amodal
            assert (own.category, own.confidence) == (one.category, one.confidence)
            assert whole_of.setdefault(own.instance_id, one.instance_id) == one.instance_id
            found.append(one)
        assert [one.instance_id for one in part.labels.objects] == list(range(1, 1 + len(part.labels.objects)))
        by_id = {one.instance_id: one for one in labels.objects}
        for one in part.labels.objects:
            if one.instance_id in whole_of:
                assert one.box_3d is by_id[whole_of[one.instance_id]].box_3d
                points = labels.cloud.instance_id == whole_of[one.instance_id]
                assert np.array_equal(part.labels.cloud.instance_id == one.instance_id, points)
        assert part.labels.cloud.probability.shape[1] == len(part.labels.objects)
        start += visit.num_views
    assert len(found) == len(labels.labels)
    sources = sum(len(one.sources) for part in parts for one in part.labels.objects)
    assert sources == sum(len(one.sources) for one in labels.objects)


@pytest.mark.slow
def test_sources_are_an_episodes_own_or_said_to_be_another_s(visits: list[Episode]) -> None:
    views, detections = join_episodes(visits, [one.detections or () for one in visits])
    parts = split_labels(propagate(views, detections), [one.num_views for one in visits])
    for number, (visit, part) in enumerate(zip(visits, parts, strict=True)):
        for one in part.labels.objects:
            assert bool(one.sources) != (one.instance_id in part.origins)
            for source in one.sources:
                seen = {(d.view_index, d.category, float(d.confidence)) for d in visit.detections or ()}
                assert (source.view_index, source.category, source.confidence) in seen
        for episode, instance_id in part.origins.values():
            assert episode != number
            assert any(one.instance_id == instance_id and one.sources for one in parts[episode].labels.objects)


def unsure(visit: Episode, confidence: float) -> Episode:
    return replace(visit, detections=tuple(replace(one, confidence=confidence) for one in visit.detections or ()))


@pytest.mark.slow
def test_what_no_episode_is_sure_of_all_may_be_together(visits: list[Episode]) -> None:
    """The chance of an object grows with looks that agree: three visits are worth more than one."""
    doubtful = [unsure(one, 0.5) for one in visits]
    lenient = LabelConfig(min_posterior=0.01, calibrate=False, class_sizes=False)
    alone = [one.confidence for visit in doubtful for one in propagate(visit, visit.detections, lenient).objects]
    config = replace(lenient, min_posterior=max(alone) + 1e-6)
    assert not any(propagate(one, one.detections, config).objects for one in doubtful)
    views, detections = join_episodes(doubtful, [one.detections or () for one in doubtful])
    assert propagate(views, detections, config).objects


@pytest.mark.slow
def test_an_unsure_phantom_of_one_episode_is_outvoted_by_the_others(visits: list[Episode]) -> None:
    """They look at the same place and find nothing there. A confident one stays: it makes an object by itself."""
    first = list(visits[0].detections or ())
    mask = np.zeros(visits[0].size, bool)
    taken = np.any([one.mask for one in first if one.view_index == 0], axis=0)
    corners = ((y, x) for y in range(5, 60, 5) for x in range(5, 90, 5))
    y, x = next((y, x) for y, x in corners if not taken[y : y + 22, x : x + 22].any())
    mask[y : y + 22, x : x + 22] = True
    phantom = replace(first[0], view_index=0, category="refrigerator", confidence=0.85, mask=mask)
    fooled = replace(visits[0], detections=(*first, phantom))
    config = LabelConfig(min_posterior=0.4)
    alone = {one.category for one in propagate(fooled, fooled.detections, config).objects}
    episodes = [fooled, *visits[1:]]
    views, detections = join_episodes(episodes, [one.detections or () for one in episodes])
    joined = {one.category for one in propagate(views, detections, config).objects}
    assert "refrigerator" in alone
    assert "refrigerator" not in joined
    assert joined >= {"chair", "couch", "plant", "table"}


@pytest.mark.slow
def test_the_order_of_episodes_decides_no_object(visits: list[Episode]) -> None:
    """Voxels are filled in another order, so that posteriors may differ in the third digit, but nothing else."""
    found = []
    for order in (visits, visits[::-1]):
        views, detections = join_episodes(order, [one.detections or () for one in order])
        found.append(sorted((one.category, one.confidence) for one in propagate(views, detections).objects))
    assert [name for name, _ in found[0]] == [name for name, _ in found[1]]
    assert [chance for _, chance in found[0]] == pytest.approx([chance for _, chance in found[1]], abs=0.01)


@pytest.mark.slow
def test_the_label_set_is_sound_and_says_where_objects_were_found(together: Path, dataset: Path) -> None:
    assert inspect_label_set(together, []) == []
    about = json.loads((together / "label_set.json").read_text())
    assert (about["share_scenes"], about["label_together"]) == (True, True)
    for visit in dataset.iterdir():
        assert annotations(together, visit.name)


@pytest.mark.slow
def test_a_scene_has_as_fine_voxels_as_its_episodes(dataset: Path, tmp_path: Path) -> None:
    """The bound on voxels is that of one episode: three that show different things may have three times as many."""
    bound = 1500
    together = labelled(dataset, tmp_path / "labels", "--max-voxels", str(bound))
    for file in (together / "clouds").iterdir():
        assert bound < len(read_ply(file)["x"]) <= 3 * bound


@pytest.mark.slow
def test_workers_change_nothing_and_what_is_done_is_kept(together: Path, dataset: Path, tmp_path: Path) -> None:
    again = labelled(dataset, tmp_path / "again", "--workers", "2")
    for name in ("instances_modal.json", "instances_amodal.json", "boxes_3d.json"):
        assert (again / name).read_bytes() == (together / name).read_bytes()
    clouds = {file: file.stat().st_mtime_ns for file in (again / "clouds").iterdir()}
    labelled(dataset, again)
    assert {file: file.stat().st_mtime_ns for file in clouds} == clouds
    labelled(dataset, again, "--no-label-together")
    assert all(file.stat().st_mtime_ns != before for file, before in clouds.items())


@pytest.mark.slow
def test_a_change_in_one_episode_labels_its_scene_anew(visits: list[Episode], tmp_path: Path) -> None:
    dataset, out = tmp_path / "visits", tmp_path / "labels"
    for number, visit in enumerate(visits[:2]):
        write_episode(dataset / str(number), visit)
    labelled(dataset, out)
    before = {file: file.stat().st_mtime_ns for file in (out / "clouds").iterdir()}
    write_episode(dataset / "1", unsure(visits[1], 0.3))
    labelled(dataset, out)
    assert all(file.stat().st_mtime_ns != time for file, time in before.items())


@pytest.mark.slow
def test_an_episode_that_cannot_be_labelled_fails_alone(
    visits: list[Episode], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    dataset = tmp_path / "visits"
    for number, visit in enumerate(visits):
        write_episode(dataset / str(number), visit)
    (dataset / "1" / "detections.json").unlink()
    assert main([str(dataset), "--share-scenes", "--out", str(tmp_path / "labels")]) == 2
    assert "1: has no detections.json" in capsys.readouterr().err
    assert annotations(tmp_path / "labels", "0")
    assert annotations(tmp_path / "labels", "2")


@pytest.mark.slow
def test_pictures_of_different_sizes_are_labelled_one_by_one_and_shared(visits: list[Episode], tmp_path: Path) -> None:
    small = make_episode(3, num_views=12, size=(60, 80), num_objects=4, wrong_class=0.0)
    write_episode(tmp_path / "visits" / "0", visits[0])
    write_episode(
        tmp_path / "visits" / "1", replace(pick(small, VISITS[1]), metadata=visits[0].metadata, detections=())
    )
    labels = labelled(tmp_path / "visits", tmp_path / "labels")
    assert annotations(labels, "1")
    assert labelled(tmp_path / "visits", tmp_path / "apart", "--no-label-together")
    assert annotations(labels) == annotations(tmp_path / "apart")


@pytest.mark.slow
def test_a_frame_for_each_recording_is_refused(
    dataset: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([str(dataset), "--share-scenes", "--up=floor", "--out", str(tmp_path / "labels")]) == 2
    assert "--up=X,Y,Z" in capsys.readouterr().err
    assert not (tmp_path / "labels").exists()


@pytest.mark.slow
def test_long_recordings_are_labelled_one_by_one_and_shared(
    dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(label_together, "MAX_PIXELS", 9 * 90 * 120)
    labels, apart = labelled(dataset, tmp_path / "labels"), labelled(dataset, tmp_path / "apart", "--no-label-together")
    assert annotations(labels) == annotations(apart)


@pytest.mark.slow
def test_groups_of_a_scene_share_what_one_episode_of_a_group_has_found(
    visits: list[Episode], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(label_together, "MAX_EPISODES", 2)
    finds = visits[1]
    names = ("visit_0", "visit_1", "visit_2")
    for number, visit in enumerate([replace(visits[0], detections=()), finds, replace(visits[2], detections=())]):
        write_episode(tmp_path / "visits" / names[number], visit)
    groups = groups_to_label(sorted((tmp_path / "visits").iterdir()))
    assert [[folder.name for folder in group] for group in groups] == [["visit_0"], ["visit_1", "visit_2"]]
    labels = labelled(tmp_path / "visits", tmp_path / "labels")
    assert inspect_label_set(labels, []) == []
    assert annotations(labels, "visit_0")
    boxes = json.loads((labels / "boxes_3d.json").read_text())["boxes"]
    origins = {name: [one.get("shared_from") for one in boxes if one["episode"] == name] for name in names}
    assert origins["visit_1"]
    assert not any(origins["visit_1"]), "it has found all of them"
    for name in ("visit_0", "visit_2"):
        assert {one["episode"] for one in origins[name]} == {"visit_1"}


@given(st.lists(st.integers(1, 30), min_size=1, max_size=3))
def test_every_episode_is_labelled_once_with_no_more_than_so_many(tmp_path_factory, counts: Sequence[int]) -> None:
    dataset = tmp_path_factory.mktemp("scenes")
    folders = []
    for scene, count in enumerate(counts):
        for visit in range(count):
            folder = dataset / f"{visit}_{scene}"
            folder.mkdir()
            (folder / "episode.json").write_text(json.dumps({"world": "rooms", "scene": f"room_{scene}"}))
            folders.append(folder)
    groups = groups_to_label(folders)
    assert sorted(folder for group in groups for folder in group) == sorted(folders)
    assert all(len({folder.name.split("_")[1] for folder in group}) == 1 for group in groups)
    assert max(map(len, groups)) <= MAX_EPISODES
    assert len(groups) == sum(-(-count // MAX_EPISODES) for count in counts)
