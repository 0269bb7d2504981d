"""What a robot believes of things, against spheres whose geometry is known on paper, and against its definition."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from labeling.core.types import MIN_POSTERIOR, Detection
from labeling.generator.calibration.detector_calibration import calibration_of
from labeling.generator.objects.object_posterior import MIN_SIDE, SAME_ANGLE_RAD, SAME_RANGE
from sbm_gym.robot.object_beliefs import RESEMBLANCE, ObjectBeliefs
from sbm_gym.robot.object_memory import MemoryConfig, ObjectMemory

from .test_object_memory import camera_at, ring_eye, sphere_view

CENTRE = (0.0, 0.0, 0.5)


class Robot:
    """A memory and what follows from it."""

    def __init__(self, num_views: int = 30) -> None:
        self.memory = ObjectMemory()
        self.beliefs = ObjectBeliefs(calibration_of("compact").objects, MemoryConfig(), num_views)

    def look(self, eye, confidence: float, category: str = "chair", centre=CENTRE, **scene) -> None:
        depth_m, mask, pose = sphere_view(eye, centre, **scene)
        found = [Detection(0, category, confidence, mask)] if mask.any() and confidence > 0.0 else []
        update = self.memory.observe(found, depth_m, camera_at(pose))
        self.beliefs.add(update.findings, depth_m, camera_at(pose))


def distinct_looks(from_object_m: np.ndarray) -> float:
    """By the definition: each look counts less, the more looks resemble it."""
    total = 0.0
    for one in from_object_m:
        company = 0.0
        for other in from_object_m:
            ranges_m = np.linalg.norm(one), np.linalg.norm(other)
            angle_rad = np.arccos(np.clip(one @ other / (ranges_m[0] * ranges_m[1]), -1.0, 1.0))
            further = np.log(ranges_m[0] / ranges_m[1])
            company += np.exp(-0.5 * ((angle_rad / SAME_ANGLE_RAD) ** 2 + (further / SAME_RANGE) ** 2))
        total += company**-RESEMBLANCE
    return total


@pytest.mark.slow
@settings(max_examples=15)
@given(st.lists(st.tuples(st.floats(0.0, 6.28), st.floats(1.0, 3.0), st.floats(0.0, 1.0)), min_size=1, max_size=6))
def test_expected_labels_are_what_their_definition_says(looks):
    robot = Robot()
    robot.look(ring_eye(0.0), 0.7)
    for angle_rad, radius_m, confidence in looks:
        robot.look(ring_eye(angle_rad, radius_m), confidence)
    eyes_m = np.array([ring_eye(0.0), *(ring_eye(angle, radius) for angle, radius, _ in looks)])
    total = 0.0
    for thing in robot.beliefs.things:
        seen = thing.side[: len(eyes_m)] > MIN_SIDE
        total += thing.chance * (thing.chance >= MIN_POSTERIOR) * distinct_looks(eyes_m[seen] - thing.centroid_m)
        assert 0.0 <= thing.chance <= 1.0
    assert robot.beliefs.expected_labels == pytest.approx(total)


def test_updates_add_up():
    robot, total, found = Robot(), 0.0, 0
    for k in range(12):
        robot.look(ring_eye(0.5 * k), (0.3, 0.95, 0.6)[k % 3])
        total += robot.beliefs.update.labels
        found += robot.beliefs.update.found
    assert robot.beliefs.expected_labels == pytest.approx(total)
    assert found == 1


def test_a_thing_that_is_found_again_and_again_becomes_likely_and_one_that_is_missed_does_not():
    sure, missed = Robot(), Robot()
    for k in range(8):
        sure.look(ring_eye(0.7 * k), 0.8)
        missed.look(ring_eye(0.7 * k), 0.8 if k == 0 else 0.0)
    ((seen,), (doubtful,)) = sure.beliefs.things, missed.beliefs.things
    assert seen.category == doubtful.category == "chair"
    assert seen.chance > 0.5 > doubtful.chance
    assert seen.labels > 2.0 * doubtful.labels


def test_what_is_hidden_is_not_looked_at():
    robot = Robot()
    robot.look(ring_eye(0.0), 0.9)
    eye = ring_eye(np.pi)
    robot.look(eye, 0.0, blocker=((-0.9, 0.0, 1.15), 0.4))
    (thing,) = robot.beliefs.things
    assert thing.side[0] > MIN_SIDE
    assert thing.side[1] == 0.0


def test_sides_are_about_those_of_the_mask():
    for radius_m in (1.2, 2.0, 3.0):
        robot, eye = Robot(), ring_eye(0.3, radius_m)
        robot.look(eye, 0.9)
        robot.look(eye, 0.9)
        _, mask, _ = sphere_view(eye, CENTRE)
        assert robot.beliefs.things[0].side[1] == pytest.approx(np.sqrt(mask.mean()), rel=0.34)


@given(st.floats(0.0, 6.28), st.floats(1.0, 3.0))
@settings(max_examples=20)
def test_the_worth_of_a_place_is_what_a_look_from_it_adds(angle_rad, radius_m):
    robot = Robot()
    for k in range(3):
        robot.look(ring_eye(0.4 * k), 0.9)
    (thing,) = robot.beliefs.things
    eye_m = np.array(ring_eye(angle_rad, radius_m))
    (worth,) = robot.beliefs.worth_from(eye_m[None], [thing])[0]
    eyes_m = np.array([ring_eye(0.4 * k) for k in range(3)]) - thing.centroid_m
    more = distinct_looks(np.vstack([eyes_m, eye_m - thing.centroid_m])) - distinct_looks(eyes_m)
    assert thing.chance >= MIN_POSTERIOR
    assert worth == pytest.approx(thing.chance * more)
    assert robot.beliefs.worth_from(eye_m[None] + 100.0, [thing])[0, 0] == 0.0


def test_two_things_are_two_and_parts_of_one_become_one():
    robot = Robot()
    robot.look((3.0, 0.0, 1.5), 0.9, centre=(0.0, 0.0, 0.5))
    robot.look((3.0, 4.0, 1.5), 0.9, centre=(0.0, 4.0, 0.5))
    assert len(robot.beliefs.things) == 2
    for k in range(6):
        robot.look(ring_eye(k, 1.6, centre=(0.0, 4.0)), 0.9, centre=(0.0, 4.0, 0.5))
    assert len(robot.beliefs.things) == 2
    assert (
        robot.beliefs.chance_at(np.array([0.0, 4.0, 0.5])) > robot.beliefs.chance_at(np.array([50.0, 0.0, 0.0])) == 0.0
    )


def test_an_episode_may_go_on_beyond_its_end():
    short, long = Robot(num_views=2), Robot(num_views=20)
    for k in range(9):
        for robot in (short, long):
            robot.look(ring_eye(0.5 * k), 0.7)
    assert short.beliefs.expected_labels == pytest.approx(long.beliefs.expected_labels)
