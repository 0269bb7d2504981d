"""Pictures of episodes: drawn from the same starts as evaluations, and films that are small enough."""

import json
from pathlib import Path

import pytest

from agents.rollouts.run_episode import episode_spec
from experiments import policy_pictures
from experiments.policy_pictures import main

from ..sbm_gym.box_rooms import BoxRooms
from .box_env import SHORT_ENV_ID, SHORT_STEPS

NAME = SHORT_ENV_ID.rpartition("/")[2]


def test_episodes_are_drawn_and_the_last_policy_filmed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from PIL import Image

    monkeypatch.setattr(policy_pictures, "FILM_PX", {"wide": (24, 72), "square": (48, 48)})
    places = ["--out", str(tmp_path / "pictures"), "--results", str(tmp_path)]
    assert main(["--policies", "ring", "random", "--env", SHORT_ENV_ID, "--episodes", "2", "--seed", "4", *places]) == 0
    content = json.loads((tmp_path / f"policy_pictures_{NAME}.json").read_text())
    assert [one["scene"] for one in content["episodes"]] == [
        episode_spec(BoxRooms().scenes("val"), 4, number).scene for number in range(2)
    ]
    for one in content["episodes"]:
        assert (tmp_path / "pictures" / one["picture"]).read_bytes().startswith(b"\x89PNG")
        assert set(one["figures"]) == {"ring", "random"}
    assert content["film"]["policy"] == "random"
    with Image.open(tmp_path / "pictures" / content["film"]["file"]) as film:
        assert film.n_frames == content["film"]["frames"] == SHORT_STEPS + 1  # type: ignore[attr-defined]
        assert film.size == (2 * 48 + policy_pictures.GAP_PX, 48)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--policies", "ring", "ring"], "each once"),
        (["--policies", "ring", "--episodes", "0"], "--episodes"),
        (["--policies", "clever"], "clever"),
        (["--policies", "ring", "--env", "sbm_gym/Moon-v0"], "sbm_gym/Moon-v0"),
    ],
)
def test_bad_arguments_are_one_line(
    arguments: list[str], says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*arguments, "--out", str(tmp_path / "out"), "--results", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert says in error
    assert len(error.splitlines()) == 1
    assert not (tmp_path / "out").exists()
