"""Shows that a change of structure changed nothing: digests of what fixed recordings, rollouts and trainings give.

    python tools/digests.py record BEFORE --recordings RECORDINGS    # in the checkout of before; makes the recordings
    python tools/digests.py record AFTER --recordings RECORDINGS     # in the checkout of now: the same recordings
    python tools/digests.py compare BEFORE AFTER                     # exit code 1 if anything differs

Rooms and streets are recorded, labelled under all presets (the streets, the rooms and the real capture), shared by
scene and from weak supervision; a detector and a frustum PointNet are trained for a few batches and run; episodes are
evaluated; each environment is stepped with random actions; PPO is trained for a few steps. Paths, versions and
fingerprints are left out, JSON and weights are compared by content. About five minutes on two cores; a step that is
done is passed over when the same command is given again.
"""

import argparse
import hashlib
import json
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
CAPTURE = ROOT.parent / "shared" / "data" / "apc_shelf"
WORLDS = ("Indoor", "Outdoor", "IndoorBuiltin", "OutdoorBuiltin")
PROVENANCE = {
    "dataset", "dataset_as_given", "detector", "elapsed_s", "fingerprint", "git_commit", "commit", "mark", "platform",
    "python", "recorded_with", "seconds", "time", "version", "versions",
}  # fmt: skip
PASSED_OVER = (".log", ".done", ".pt", ".html")
ROLLOUT = """
import hashlib, json, sys
import gymnasium as gym
import numpy as np
found = {}
for world in sys.argv[2:]:
    env = gym.make(f"sbm_gym:sbm_gym/{world}-v0")
    env.action_space.seed(0)
    digest = hashlib.sha256()
    for seed in (0, 1):
        observation, info = env.reset(seed=seed)
        ended = False
        while not ended:
            for name in sorted(observation):
                digest.update(np.ascontiguousarray(observation[name]).tobytes())
            observation, reward, terminated, truncated, info = env.step(env.action_space.sample())
            digest.update(np.float64(reward).tobytes())
            digest.update(json.dumps({k: float(v) for k, v in info["reward_terms"].items()}, sort_keys=True).encode())
            ended = terminated or truncated
    frame = env.unwrapped.capture()
    digest.update(np.ascontiguousarray(frame.rgb).tobytes() + np.ascontiguousarray(frame.depth_m).tobytes())
    found[world] = digest.hexdigest()
    env.close()
open(sys.argv[1], "w").write(json.dumps(found))
"""


def recording_steps(out: Path) -> Iterator[tuple[str, list[str]]]:
    """Commands that record episodes, by name."""
    for world, policy, options in (
        ("Indoor", "ring", "--episodes 2 --episodes-per-scene 2 --size 160 --seed 3 --detector compact"),
        ("Outdoor", "ring", "--episodes 2 --episodes-per-scene 2 --size 128 --seed 3 --detector compact"),
        ("IndoorBuiltin", "next_best_view", "--episodes 1 --size 128 --seed 5"),
        ("OutdoorBuiltin", "frontier", "--episodes 1 --size 96 --seed 5"),
    ):
        command = f"-m agents.collect --env sbm_gym/{world}-v0 --policy {policy} {options} --out {out / world}"
        yield f"collect_{world}", command.split()


def working_steps(out: Path, recordings: Path) -> Iterator[tuple[str, list[str]]]:
    """Commands that work on the recordings, by name."""
    labels = out / "labels"
    for preset in ("default", "paper", "released"):
        for world in ("Indoor", "Outdoor"):
            options = f"{recordings / world} --preset {preset} --confident 0.7 --out {labels / f'{world}_{preset}'}"
            yield f"generate_{world}_{preset}", f"-m labeling.generate {options}".split()
        if CAPTURE.is_dir():
            options = f"{CAPTURE} --preset {preset} --confident 0.6 --out {labels / f'capture_{preset}'}"
            yield f"generate_capture_{preset}", f"-m labeling.generate {options}".split()
    rooms, builtin, shared = recordings / "Indoor", recordings / "IndoorBuiltin", labels / "Indoor_shared"
    episodes, episodes_ldls = out / "episodes", out / "episodes_ldls"
    for name, command in {
        "share_Indoor": f"generate {rooms} --share-scenes --confident 0.7 --workers 2 --out {shared}",
        "share_Outdoor": f"generate {recordings / 'Outdoor'} --share-scenes --confident 0.7 --out {labels / 'shared'}",
        "weak": f"generate {rooms} --weak one-view --out {labels / 'weak'}",
        "detector": f"generate {builtin} --detector compact --with-recorded --out {labels / 'detector'}",
        "finetune": f"finetune {shared} --iterations 6 --batch-size 2 --validate-every 3 --out {out / 'finetune'}",
        "train3d": f"train3d {shared} --iterations 12 --batch-size 8 --validate-every 6 --width .25 --num-points 256 "
        f"--out {out / 'train3d'}",
        "convert": f"convert {rooms / '0000'} --every 2 --out {out / 'convert'}",
        "detect": f"detect {episodes} --detector {out / 'finetune'} --replace",
        "detect3d": f"detect3d {episodes} --detector {out / 'train3d'} --boxes compact",
        "ldls": f"detect3d {episodes_ldls} --detector ldls --boxes compact",
        "evaluate": f"evaluate {shared}",
        "inspect": f"inspect {shared} --pictures {out / 'inspect'}",
    }.items():
        yield name, f"-m labeling.{command}".split()
    env = "--env sbm_gym/IndoorBuiltin-v0"
    policies = f"-m agents.evaluate {env} --policies ring spin frontier --episodes 1 --seeds 2 --labels --out"
    yield "evaluate_policies", [*policies.split(), str(out / "policies")]
    few = "--steps 400 --envs 4 --scenes 2 --validation-scenes 1 --eval-episodes 1 --compare-episodes 0"
    yield "train", f"-m agents.train {env} {few} --out {out / 'ppo'}".split()
    yield "rollout", ["-c", ROLLOUT, str(out / "rollout.json"), *WORLDS]


def record(out: Path, recordings: Path) -> None:
    """Runs every step that is not done yet."""
    out.mkdir(parents=True, exist_ok=True)
    for name, command in recording_steps(out / "recordings"):
        run(out, name, command)
    if not recordings.is_dir():
        shutil.copytree(out / "recordings", recordings)
    for folder, world in (("episodes", "Indoor"), ("episodes_ldls", "IndoorBuiltin")):
        if not (out / folder).is_dir():
            shutil.copytree(recordings / world, out / folder)
    for name, command in working_steps(out, recordings):
        run(out, name, command)
    print(out)


def run(out: Path, name: str, command: list[str]) -> None:
    """Runs a step once; what it prints goes to NAME.log."""
    if (out / f"{name}.done").exists():
        return
    print(name, flush=True)
    with (out / f"{name}.log").open("w") as log:
        done = subprocess.run([sys.executable, *command], cwd=ROOT, stdout=log, stderr=subprocess.STDOUT, check=False)
    if done.returncode:
        sys.exit(f"{name} failed; see {out / f'{name}.log'}")
    (out / f"{name}.done").touch()


def digests(out: Path) -> dict[str, str]:
    """The digest of the content of every file that the steps left, by its path."""
    found = {}
    for path in sorted(path for path in out.rglob("*") if path.is_file()):
        name = path.relative_to(out).as_posix()
        if path.suffix in PASSED_OVER or "tfevents" in name or name.startswith(".") or "/." in name:
            continue
        found[name] = hashlib.sha256(content(path, out)).hexdigest()
    return found


def content(path: Path, out: Path) -> bytes:
    """What a file says, without its provenance and without how it was packed."""
    if path.suffix == ".json":
        text = json.dumps(without_provenance(json.loads(path.read_text())), sort_keys=True)
        return text.replace(str(out), "OUT").encode()
    if path.suffix == ".safetensors":
        from safetensors.numpy import load_file

        tensors = sorted(load_file(path).items())
        return b"".join(name.encode() + str(value.shape).encode() + value.tobytes() for name, value in tensors)
    if path.suffix == ".png":
        import cv2

        picture = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        if picture is None:
            raise SystemExit(f"{path}: not a picture that can be read")
        return str(picture.shape).encode() + picture.tobytes()
    return path.read_bytes()


def without_provenance(value):
    """JSON without the entries that tell where and when it was made."""
    if isinstance(value, dict):
        return {key: without_provenance(one) for key, one in value.items() if key not in PROVENANCE}
    return [without_provenance(one) for one in value] if isinstance(value, list) else value


def compare(before: Path, after: Path) -> int:
    """Prints what differs; returns how much does."""
    old, new = digests(before), digests(after)
    changed = [name for name in old if name in new and old[name] != new[name]]
    for what, names in (("missing", old.keys() - new.keys()), ("new", new.keys() - old.keys()), ("changed", changed)):
        for name in sorted(names):
            print(f"{what}: {name}")
    print(f"{len(old)} files before, {sum(old[name] == new.get(name) for name in old)} of them the same now")
    return len(old.keys() ^ new.keys()) + len(changed)


def main() -> None:
    """Runs the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    verbs = parser.add_subparsers(dest="verb", required=True)
    recorder = verbs.add_parser("record", help="run every step and keep what it leaves")
    recorder.add_argument("out", type=Path)
    recorder.add_argument("--recordings", type=Path, required=True, help="episodes to work on; made if missing")
    comparer = verbs.add_parser("compare", help="say which files differ between two such folders")
    comparer.add_argument("before", type=Path)
    comparer.add_argument("after", type=Path)
    given = parser.parse_args()
    if given.verb == "record":
        record(given.out.resolve(), given.recordings.resolve())
    else:
        sys.exit(1 if compare(given.before.resolve(), given.after.resolve()) else 0)


if __name__ == "__main__":
    main()
