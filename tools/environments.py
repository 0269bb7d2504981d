"""Writes docs/environments: a page for each kind of world, in Gymnasium's form, from the code that it tells of.

python tools/environments.py
"""

import inspect
import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

import gymnasium  # noqa: E402

import sbm_gym  # noqa: E402
from sbm_gym.env.fixation_env import FixationEnv  # noqa: E402
from sbm_gym.scenes.profiles import INDOOR, OUTDOOR, WorldProfile  # noqa: E402

FOLDER = ROOT / "docs" / "environments"
KINDS: dict[str, tuple[str, WorldProfile, str]] = {
    "indoor": ("Rooms", INDOOR, "Homes, hotels and offices of one to six furnished rooms"),
    "outdoor": ("Towns", OUTDOOR, "Streets with parked vehicles, trees, houses and weather"),
}
"""Kinds of worlds: title of the page, settings, and what the worlds are."""
NOTE = "<!-- Written by `python tools/environments.py` from the code; do not edit by hand. -->"


def env_ids(kind: str) -> list[str]:
    """Ids of a kind's registered environments."""
    return [name for name, settings in sbm_gym.ENV_IDS.items() if settings["worlds"].split("-")[0] == kind]


def sections() -> dict[str, str]:
    """What stands below each heading of the docstring of ``FixationEnv``, by heading."""
    parts = re.split(r"^## (.*)\n", inspect.getdoc(FixationEnv) or "", flags=re.MULTILINE)
    return {title: text.strip() for title, text in zip(parts[1::2], parts[2::2], strict=True)}


def of_kind(text: str, kind: str) -> str:
    """Text of the docstring with the values of one kind of world: those of streets stand in brackets."""
    pairs = re.compile(r"(1\.5 m above|(?:[\d.]+ c?m\b)|\(84, 84, \d\)) \[([^\]]+)\]")
    return pairs.sub(lambda found: found[2] if kind == "outdoor" else found[1], text)


def arguments() -> list[tuple[str, str, str]]:
    """Names of the constructor's arguments, their defaults, and what they mean."""
    defaults = {name: one.default for name, one in inspect.signature(FixationEnv).parameters.items()}
    rows = []
    for names, meaning in re.findall(r"^- (`\w+`(?:, `\w+`)*): (.*?)(?=^- |\Z)", sections()["Arguments"], re.M | re.S):
        for name in re.findall(r"\w+", names):
            rows.append((name, repr(defaults[name]), " ".join(meaning.split()).replace("|", r"\|")))
    return rows


def page(kind: str) -> str:
    """The page of a kind of world."""
    title, profile, what = KINDS[kind]
    ids, said = env_ids(kind), sections()
    env = gymnasium.make(ids[0].replace("Builtin", ""), disable_env_checker=True).unwrapped
    spaces = env.observation_space
    height_m = profile.body.camera_height_m
    capture = "x".join(map(str, reversed(profile.capture_size)))
    rows = [
        ("Action space", f"`{env.action_space}`"),
        *((f"Observation `{name}`", f"`{space}`") for name, space in spaces.spaces.items()),
        ("Made by", "<br>".join(f'`gymnasium.make("sbm_gym:{one}")`' for one in ids)),
        ("Episode", f"{env.num_views} views"),
        ("Recorded pictures", f"{capture} pixels"),
        ("Categories of its detector", ", ".join(profile.detector.categories)),
    ]
    body = said["Description"].split("Its detector", 1)[1]
    names = "\n".join(f"| {number} | `{name}` |" for number, name in enumerate(env.state_names))
    return f"""# {title}

{NOTE}

![Scenes from above and at eye level](../pictures/scenes_{kind}_0.png)

{what}: `{"` and `".join(ids)}`. `Builtin` worlds are
furnished with models made from seeds, so that nothing has to be installed; the others use
[furniture libraries](../worlds.md#furniture-models).

| | |
|---|---|
{chr(10).join(f"| {name} | {value} |" for name, value in rows)}

![An episode, from above and through its camera](../pictures/policies_film_{title_of_film(kind)}-v0.gif)

## Description
A round robot with an RGB-D camera {height_m:g} m above the floor looks for objects. Its detector{body}

## Action space
{of_kind(said["Action Space"], kind)}

## Observation space
{of_kind(said["Observation Space"], kind)}

<details markdown><summary>All {len(env.state_names)} entries of <code>state</code></summary>

| | entry |
|---|---|
{names}

</details>

## Rewards
{said["Rewards"]}

## Starting state
{said["Starting State"]}

## Episode end
{said["Episode End"]}

## Information
`info` of `reset` and `step` has

- `detections`: what the detector says about the latest view;
- `sight`: the depth and intrinsics that masks of detections lie over;
- `fixation_target` and `confirmed_objects`: `object_id`, `category`, `best_confidence`, `centroid_m`,
  `extent_m`, `visible`, `azimuths`;
- `reward_terms`: the reward, term by term;
- `agent`: `position_m`, `yaw_rad`, `tilt_rad`, `camera_to_world` (OpenCV axes), `intrinsics`;
- `scene`, `collided`, `is_success` (something is confirmed), `coverage` (the largest share of an object's sectors
  that were seen), `path_length_m`.

## Arguments
```python
env = gymnasium.make("sbm_gym:{ids[-1]}", split="val", render_mode="rgb_array")
```

| argument | default | |
|---|---|---|
{chr(10).join(f"| `{name}` | `{default}` | {meaning} |" for name, default, meaning in arguments())}

## Version history
{said["Version History"]}
"""


def title_of_film(kind: str) -> str:
    """Indoor or Outdoor, as pictures are called."""
    return kind.capitalize()


def index() -> str:
    """The page that lists them."""
    rows = "\n".join(
        f"| [`{one}`]({kind}.md) | {what} | {'made from seeds' if 'Builtin' in one else 'furniture libraries'} |"
        for kind, (_, _, what) in KINDS.items()
        for one in env_ids(kind)
    )
    return f"""# Environments

{NOTE}

All are one class, [`FixationEnv`](../../sbm_gym/env/fixation_env.py), in other worlds;
`import sbm_gym` registers them with Gymnasium.

| id | worlds | models |
|---|---|---|
{rows}

```python
import gymnasium

env = gymnasium.make("sbm_gym:sbm_gym/IndoorBuiltin-v0")
observation, info = env.reset(seed=0)
```

What the worlds are made of, and how to add one of your own: [worlds](../worlds.md).
Policies that move in them: [policies](../policies.md).
"""


def pages() -> dict[str, str]:
    """All pages by file name."""
    return {"index.md": index(), **{f"{kind}.md": page(kind) for kind in KINDS}}


if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    for name, text in pages().items():
        (FOLDER / name).write_text(text, encoding="utf-8")
        print(FOLDER / name)
