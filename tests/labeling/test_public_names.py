"""What users import from ``labeling``: all there, explained by an example that runs, and loaded when asked for."""

import doctest
import subprocess
import sys

import pytest

import labeling


@pytest.mark.parametrize("name", ["labeling", *labeling.__all__])
def test_every_public_name_has_an_example_that_runs(name: str) -> None:
    thing = labeling if name == "labeling" else getattr(labeling, name)
    if not isinstance(thing, type) and not callable(thing) and thing is not labeling:
        return  # a value, such as the presets
    module = sys.modules[getattr(thing, "__module__", name)]
    examples = doctest.DocTestParser().get_doctest(thing.__doc__ or "", dict(vars(module)), name, None, None)
    runner = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE)
    runner.run(examples)
    assert runner.tries > 0
    assert runner.failures == 0


def test_the_root_is_light_and_says_what_it_lacks() -> None:
    heavy = "import sys, labeling; print([m for m in ('numpy', 'numba', 'cv2', 'torch', 'scipy') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", heavy], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
    with pytest.raises(AttributeError, match="Nothing"):
        labeling.Nothing  # noqa: B018
