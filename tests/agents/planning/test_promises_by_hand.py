"""What moves and looks promise in a scene in which left differs from right, worked out by hand.

The robot stands on an open floor and looks north; a pillar stands close ahead of it, a little to the right. On its left
lie all the floor that it has not seen, and the one thing whose labels are worth something.
"""

from types import SimpleNamespace

import numpy as np
import pytest

from agents.planning.choices import DIRECTIONS, LOOKS, STAY
from agents.planning.promises import LOOK_ENTRIES, MOVE_ENTRIES, with_promises
from sbm_gym.env.state_vector import state_names
from sbm_gym.robot.object_memory import ViewBins
from sbm_gym.robot.seen_floor import SeenFloor
from sbm_gym.robot.seen_space import SeenSpace
from sbm_gym.robot.view_history import Candidate
from sbm_gym.worlds.geometry.navigable import NavigableMap

SIDE_M, STRIDE_M, HEADING_RAD = 16.0, 0.5, 0.5 * np.pi
START_M = np.array([8.0, 8.0])
LEFT = 2
"""The move to the left, and the turn to the left in twelfths below: sides and turns go counter-clockwise."""
CHANCES = {"target": 0.7, "candidate": 0.2}
TURNS_DEG = {row: np.rint(np.rad2deg(what)) for row, what in enumerate(LOOKS) if not isinstance(what, str)}


@pytest.fixture(scope="module")
def navigable() -> NavigableMap:
    cells = int(SIDE_M / 0.05)
    middles = 0.05 * (np.arange(cells) + 0.5)
    ahead, right = middles[:, None] - START_M[1], middles[None] - START_M[0]
    pillar = (ahead > 0.3) & (ahead < 0.6) & (right > -0.15) & (right < 0.2)
    return NavigableMap(~pillar, np.zeros(2))


@pytest.fixture(scope="module")
def floor(navigable: NavigableMap) -> SeenFloor:
    found = SeenFloor(navigable, START_M, STRIDE_M, reach_m=5.0)
    middles = found.cell_m * (np.arange(found.is_floor.shape[1]) + 0.5)
    found._seen_at[:] = np.where(middles < START_M[0] - 0.4, -1, 0)
    return found


@pytest.fixture(scope="module")
def promised(navigable: NavigableMap, floor: SeenFloor) -> dict[str, np.ndarray]:
    left_m = np.array([START_M[0] - 3.0, START_M[1], 0.5])
    behind_m = np.array([START_M[0], START_M[1] - 2.0, 0.5])
    size_m = np.full(3, 0.4)

    def worth_from(eyes_m, things):
        """A tenth of what the rows divide by for each stride from the start, and one for the start itself."""
        strides = np.linalg.norm(eyes_m[:, :2] - START_M, axis=1) / STRIDE_M
        return np.repeat(0.3 * (1.0 + strides)[None], len(things), axis=0)

    target = SimpleNamespace(centroid_m=behind_m, extent_m=size_m, cells=set(), best_confidence=0.95)
    robot = SimpleNamespace(
        navigable=navigable,
        stride_m=STRIDE_M,
        camera_height_m=1.5,
        view_bins=ViewBins(),
        seen_floor=floor,
        seen_space=SeenSpace(np.zeros(2), np.full(2, SIDE_M)),
        beliefs=SimpleNamespace(
            things=[SimpleNamespace(centroid_m=left_m, extent_m=size_m, worth=0.9)],
            worth_from=worth_from,
            chance_at=lambda place_m: CHANCES["target" if place_m is behind_m else "candidate"],
        ),
        objects=[target],
        target=target,
        view_history=SimpleNamespace(candidates=[Candidate(left_m, 0.4, 0.5)]),
    )
    pose = np.eye(4)
    pose[:3, 3] = [*START_M, 1.5]
    agent = {"position_m": START_M, "yaw_rad": HEADING_RAD, "camera_to_world": pose}
    observation = {"state": np.zeros(len(state_names(ViewBins())), np.float32)}
    return with_promises(observation, {"agent": agent}, robot)  # type: ignore[arg-type]


def moves(promised: dict[str, np.ndarray], entry: str) -> np.ndarray:
    return promised["moves"][:, MOVE_ENTRIES.index(entry)]


def looks(promised: dict[str, np.ndarray], entry: str, after: int = STAY) -> np.ndarray:
    return promised["looks"][after, :, LOOK_ENTRIES.index(entry)]


def unseen_shares(floor: SeenFloor, low: float, high: float) -> np.ndarray:
    """Of each eighth of a ring around the start, from straight ahead on, the share that is unseen; strides."""
    rows, columns = np.nonzero(floor.unseen())
    x, y = floor.cell_m * (columns + 0.5) - START_M[0], floor.cell_m * (rows + 0.5) - START_M[1]
    strides, side = np.hypot(x, y) / STRIDE_M, np.rad2deg(np.arctan2(y, x) - HEADING_RAD) / 45.0
    inside = (low <= strides) & (strides < high)
    counts = np.bincount(np.rint(side[inside]).astype(int) % DIRECTIONS, minlength=DIRECTIONS)
    return np.minimum(counts * (floor.cell_m / STRIDE_M) ** 2 / (np.pi * (high**2 - low**2) / DIRECTIONS), 1.0)


@pytest.mark.parametrize(("entry", "low", "high"), [("unseen_near", 0.0, 3.0), ("unseen_far", 3.0, 12.0)])
def test_unseen_floor_lies_on_the_left_alone(promised, floor, entry, low, high):
    shares = unseen_shares(floor, low, high)
    assert shares[LEFT] > 0.5
    assert not shares[DIRECTIONS - LEFT]
    assert moves(promised, entry)[:DIRECTIONS] == pytest.approx(shares, abs=1e-6)
    seen = looks(promised, entry)
    for row, turn_deg in TURNS_DEG.items():
        assert seen[row] == pytest.approx(shares[int(np.rint(turn_deg / 45)) % DIRECTIONS], abs=1e-6)
    assert seen[LOOKS.index("candidate_0")] == pytest.approx(shares[LEFT], abs=1e-6)


def test_ways_to_unseen_floor_begin_on_the_left(promised):
    by_way = moves(promised, "unseen_by_way")
    assert np.argmax(by_way) == LEFT
    assert by_way[DIRECTIONS - LEFT] < 0.02


def test_labels_are_expected_of_looks_to_the_left_alone(promised):
    # What lies straight to the left is in view up to 38 degrees beside it; from the start it is worth a tenth.
    labels = looks(promised, "labels")
    for row, turn_deg in TURNS_DEG.items():
        assert labels[row] == pytest.approx(0.1 if turn_deg in (60, 90, 120) else 0.0)
    assert labels[LOOKS.index("candidate_0")] == pytest.approx(0.1)
    assert labels[LOOKS.index("target")] == 0.0


def test_labels_of_moves_grow_with_the_strides_of_their_entries(promised):
    for side in range(DIRECTIONS):
        told = [moves(promised, name)[side] for name in ("labels", "labels_2_strides", "labels_4_strides")]
        # Ahead stands the pillar: the step goes round it, and nothing is promised from behind it.
        assert told == pytest.approx([0.2, 0.0, 0.0] if side == 0 else [0.2, 0.3, 0.5])
    assert moves(promised, "labels")[STAY] == pytest.approx(0.1)


def test_looks_tell_by_how_much_the_camera_turns(promised):
    turns = looks(promised, "turn")
    for row, turn_deg in TURNS_DEG.items():
        assert turns[row] == pytest.approx(min(turn_deg, 360 - turn_deg) / 180)
    assert turns[LOOKS.index("target")] == pytest.approx(1.0)  # behind
    assert turns[LOOKS.index("candidate_0")] == pytest.approx(0.5)


def test_things_have_the_chances_that_are_believed(promised):
    chances = looks(promised, "chance")
    assert chances[LOOKS.index("target")] == pytest.approx(CHANCES["target"])
    assert chances[LOOKS.index("candidate_0")] == pytest.approx(CHANCES["candidate"])
    assert not chances[[row for row, what in enumerate(LOOKS) if what not in ("target", "candidate_0")]].any()


def test_a_move_tells_how_far_it_is_turned_aside(promised):
    # The pillar reaches 15 cm to the left: the first free way ahead is 30 degrees beside, a third of a quarter turn.
    aside = moves(promised, "aside")
    assert aside[0] == pytest.approx(1.0 / 3.0, abs=1e-6)
    assert aside[1:] == pytest.approx(np.zeros(DIRECTIONS), abs=1e-6)
    assert moves(promised, "length")[:STAY] == pytest.approx(np.ones(DIRECTIONS))
