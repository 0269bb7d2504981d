"""The commands that a campaign runs, with the files that each of them reads."""

from dataclasses import dataclass
from pathlib import Path

from experiments.campaign.inputs import ENV, TINY_BOXES, TINY_FLOW, TINY_MEMORY


@dataclass(frozen=True)
class Subject:
    """A command, and files of its input that may be spoilt."""

    name: str
    module: str
    """With the function ``main``; ``python -m`` runs it."""
    arguments: tuple[str, ...]
    """Of the command line; ``{in}`` stands for a copy of the input and ``{out}`` for a place to write to."""
    inputs: str
    """Folder of the input, a name in ``MAKERS``."""
    files: tuple[str, ...]
    """Patterns of the files that may be spoilt."""
    weight: float = 1.0
    """How often, compared with others, it has its turn."""
    resumes: bool = False
    """Whether the same command, given again, goes on with what is missing."""
    writes_beside: bool = False
    """Whether it writes beside what it reads, not to ``{out}``."""
    environment: tuple[tuple[str, str], ...] = ()
    """Environment variables; ``{in}`` and ``{out}`` as in the arguments."""

    def command(self, given: Path, out: Path) -> list[str]:
        """The command line."""
        return [_filled(one, given, out) for one in self.arguments]

    def variables(self, given: Path, out: Path) -> dict[str, str]:
        """The environment variables."""
        return {name: _filled(value, given, out) for name, value in self.environment}


def _filled(text: str, given: Path, out: Path) -> str:
    return text.replace("{in}", str(given)).replace("{out}", str(out))


_EPISODE = ("*/*.json", "*/*.json", "*/rgb/000.png", "*/depth/000.png")
_TRAIN = ("--env", ENV, "--steps", "25", "--scenes", "1", "--validation-scenes", "1", "--eval-episodes", "1")
_TRAIN += ("--compare-episodes", "0", "--processes", "1")
TUNING = ("--iterations", "4", "--validate-every", "2", "--batch-size", "1", "--device", "cpu")
"""Options of a training of a detector that takes a few seconds."""
SUBJECTS = (
    Subject("label", "labeling.generate", ("{in}", "--out", "{out}"), "episodes", _EPISODE, 4.0, True),
    Subject(
        "label, scenes shared",
        "labeling.generate",
        ("{in}", "--out", "{out}", "--share-scenes"),
        "episodes",
        _EPISODE,
        2.0,
        True,
    ),
    Subject(
        "label, weak",
        "labeling.generate",
        ("{in}", "--out", "{out}", "--weak", "one-view"),
        "episodes",
        _EPISODE,
        1.0,
        True,
    ),
    Subject(
        "label a ScanNet folder",
        "labeling.generate",
        ("{in}", "--out", "{out}"),
        "scannet",
        ("room/pose/*.txt", "room/intrinsic/*.txt", "room/*.json", "room/color/0.png", "room/depth/0.png"),
        2.0,
        True,
    ),
    Subject(
        "convert a TUM folder",
        "labeling.convert",
        ("{in}/room", "--out", "{out}"),
        "tum",
        ("room/*.txt", "room/*.txt", "room/rgb/0.png", "room/depth/0.png"),
        2.0,
    ),
    Subject("convert an episode", "labeling.convert", ("{in}/0000", "--out", "{out}"), "episodes", _EPISODE),
    Subject("inspect labels", "labeling.inspect", ("{in}/set",), "labels", ("set/*.json", "set/*/*"), 3.0),
    Subject(
        "evaluate labels",
        "labeling.evaluate",
        ("{in}/set", "--dataset", "{in}/episodes"),
        "labels",
        ("set/*.json", "set/*.json", "episodes/*/*.json"),
        3.0,
        writes_beside=True,
    ),
    Subject(
        "record with a policy",
        "agents.collect",
        (*("--env", ENV, "--episodes", "1", "--size", "32"), *("--policy", "ppo:{in}/run", "--out", "{out}")),
        "policy",
        ("run/*.json", "run/best/*"),
        2.0,
        True,
    ),
    Subject(
        "go on with a training",
        "agents.train",
        ("--resume", "{in}/run", "--steps", "75", "--compare-episodes", "0"),
        "policy",
        ("run/*.json", "run/last/*", "run/best/*.json"),
        1.0,
        writes_beside=True,
    ),
    Subject(
        "train with hyperparameters of others",
        "agents.train",
        (*_TRAIN, "--hyperparams", "{in}/ppo.yaml", "--out", "{out}"),
        "policy",
        ("ppo.yaml",),
        2.0,
        True,
    ),
    Subject(
        "detect with a network",
        "labeling.detect",
        ("{in}/episode", "--detector", "{in}/run", "--device", "cpu", "--replace"),
        "network",
        ("run/**/*.json", "run/**/*.safetensors", "episode/*.json"),
        1.0,
        writes_beside=True,
    ),
    Subject(
        "detect with an ONNX file",
        "labeling.detect",
        ("{in}/episode", "--detector", "onnx:{in}/model.onnx", "--replace"),
        "onnx",
        ("model.onnx", "model.onnx", "episode/*.json"),
        2.0,
        writes_beside=True,
    ),
    Subject(
        "label by outlines",
        "labeling.generate",
        ("{in}/episodes/0000", "--annotations", "{in}/outlines.json", "--out", "{out}"),
        "outlines",
        ("outlines.json", "outlines.json", "episodes/0000/*.json"),
        2.0,
        True,
    ),
    Subject(
        "label by a file of results",
        "labeling.generate",
        ("{in}/episodes", "--detections", "{in}/results.json", "--out", "{out}"),
        "outlines",
        ("results.json", "results.json", "episodes/*/*.json"),
        2.0,
        True,
    ),
    Subject(
        "find 3-D boxes",
        "labeling.detect3d",
        ("{in}/episodes", "--detector", "{in}/run", "--device", "cpu"),
        "boxes",
        ("run/**/*.json", "run/**/*.safetensors", "episodes/*/*.json"),
        1.0,
        writes_beside=True,
    ),
    Subject(
        "draw what a memory predicts",
        "labeling.imagine",
        ("{in}/run", "{in}/episode", "--out", "{out}", "--device", "cpu"),
        "memory",
        ("run/**/*.json", "run/**/*.safetensors", "episode/*.json"),
        1.0,
    ),
    Subject(
        "write labels for other tools",
        "labeling.convert",
        ("{in}/set", "--dataset", "{in}/episodes", "--to", "openlabel", "--out", "{out}"),
        "labels",
        ("set/*.json", "set/*/*", "episodes/*/*.json"),
    ),
    Subject(
        "write labels as clouds",
        "labeling.convert",
        ("{in}/set", "--to", "gltf", "--out", "{out}"),
        "labels",
        ("set/*.json", "set/*/*", "set/*/*"),
    ),
    Subject(
        "learn from labels",
        "labeling.finetune",
        ("{in}/set", "--dataset", "{in}/episodes", *TUNING, "--out", "{out}"),
        "labels",
        ("set/*.json", "set/*.json", "episodes/*/*.json", "episodes/*/rgb/000.png"),
        1.0,
        True,
    ),
    Subject(
        "learn boxes",
        "labeling.train3d",
        ("{in}/set", "--dataset", "{in}/episodes", *TINY_BOXES, "--out", "{out}"),
        "labels",
        ("set/*.json", "set/*.json", "episodes/*/*.json", "episodes/*/depth/000.png"),
        1.0,
        True,
    ),
    Subject(
        "learn a memory",
        "labeling.train_memory",
        ("{in}", *TINY_MEMORY, "--out", "{out}"),
        "episodes",
        _EPISODE,
        1.0,
        True,
    ),
    Subject(
        "learn flow",
        "labeling.train_flow",
        ("{in}/episode", "--memory", "{in}/run", *TINY_FLOW, "--out", "{out}"),
        "memory",
        ("run/memory.safetensors", "episode/*.json", "episode/depth/000.png"),
        1.0,
        True,
    ),
    Subject(
        "install furniture",
        "sbm_gym.assets.__main__",
        ("install",),
        "furniture",
        ("library.sh3f",),
        2.0,
        environment=(("SBM_FURNITURE", "{in}/library.sh3f"), ("SBM_CACHE", "{out}")),
    ),
    Subject(
        "train on an atlas",
        "agents.train",
        (
            *_TRAIN,
            "--hyperparams",
            "{in}/ppo.yaml",
            "--detector",
            "simulated",
            "--atlas",
            "{in}/atlas",
            "--out",
            "{out}",
        ),
        "atlas",
        ("atlas/**/*",),
        1.0,
        True,
    ),
)
"""Each works on a copy of its input."""


def files_of(subject: Subject, given: Path) -> list[str]:
    """The files of an input that may be spoilt, in a fixed order; named twice by patterns, they come twice."""
    found = [
        sorted(path.relative_to(given).as_posix() for path in given.glob(pattern) if path.is_file())
        for pattern in subject.files
    ]
    return [name for names in found for name in names]
