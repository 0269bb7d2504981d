"""Fits the simulated detector to a real one: ``python -m sbm_gym.fit_simulated --detector compact``."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from labeling.core.errors import UsageError
from labeling.runtime.cli import make_main
from labeling.runtime.help import CommandHelp
from labeling.runtime.ranges import Count, NonNegative, check_ranges

THRESHOLDS = (0.05, 0.5, 0.9)
"""Confidences at which the page tells how often the real and the fitted detector reach them."""
FIRST_SCENE = 2000
"""Scenes of the endless split before are trained in."""


@dataclass(frozen=True)
class FitConfig:
    """Makes the simulated detector like a real one: as often sure, of the same things, at the same distances, and as
    often wrong about background. Environments take it as "simulated:NAME"; policies learn on it at a tenth of the cost.

    Looks at random views of scenes that nothing is trained, validated or compared in.
    """

    detector: str = "compact"
    """Name of the real detector."""
    env: str = "sbm_gym/Indoor-v0"
    """Gymnasium id of the world."""
    scenes: Count = 20
    """Number of scenes, of the endless split."""
    places: Count = 500
    """Number of places in all; three views are taken at each."""
    seed: NonNegative[int] = 0
    """Decides places and headings."""
    out: Path = Path("sbm_gym/detection/fitted")
    """Folder for the settings; the file is named for the detector and the kind of world."""


def run(config: FitConfig) -> None:
    """Fits, writes the settings, and says how they compare.

    Raises:
        SbmError: if there is no such env or detector, or it detects next to nothing.
    """
    import numpy as np

    from labeling.formats.atomic import write_json
    from labeling.runtime.cli import progress_bar
    from sbm_gym.detection.detector_views import DetectorViews, detector_views
    from sbm_gym.detection.fitted_settings import as_json, settings_file
    from sbm_gym.detection.lasting_phantoms import LastingPhantoms
    from sbm_gym.detection.simulated_fit import fit_settings, predicted_shares
    from sbm_gym.named_env import make_env

    check_ranges(config)
    env = make_env(config.env, "endless", config.detector, colours=False, scene_cache=1)
    names = env.get_wrapper_attr("scene_names")
    scenes = names[FIRST_SCENE : FIRST_SCENE + config.scenes]
    if not scenes:
        env.close()
        raise UsageError(
            f"env {config.env!r} has {len(names)} scenes in its split 'endless'; fitting takes those from number "
            f"{FIRST_SCENE} on, in which nothing is trained or compared"
        )
    env.unwrapped.scene_names = tuple(scenes)
    profile = env.get_wrapper_attr("profile")
    start = profile.detector
    unit_m = start.range_unit_m
    phantoms = LastingPhantoms(0.0, 0.0, 0.0, 0.0, (), cell_m=unit_m, heights_m=(0.3, 1.9 + 0.3 * unit_m))
    parts = list(
        progress_bar(detector_views(env, config.places, config.seed, phantoms), unit="place", total=config.places)
    )
    env.close()
    views = DetectorViews(
        tuple(one for part in parts for one in part.objects),
        tuple(one for part in parts for one in part.cells),
        sum(part.count for part in parts),
    )
    try:
        settings = fit_settings(views, start, phantoms)
    except ValueError as error:
        raise UsageError(str(error)) from error
    known = [
        one
        for one in views.objects
        if one.area_share >= start.min_area_share and one.observed.category in start.categories
    ]
    predicted = predicted_shares(settings, known, THRESHOLDS)
    figures: dict[str, Any] = {"views": views.count, "views_of_objects": len(known), "at_least": {}}
    for level, share in zip(THRESHOLDS, predicted, strict=True):
        real = float(np.mean([one.right >= level for one in known]))
        figures["at_least"][f"{level:g}"] = {"real": round(real, 4), "fitted": round(float(share), 4)}
    file = settings_file(config.out, config.detector, profile.kind)
    provenance = {
        "command": f"python -m sbm_gym.fit_simulated --detector {config.detector} --env {config.env}",
        "scenes": [scenes[0], scenes[-1]],
        "places": config.places,
        "seed": config.seed,
    }
    write_json(file, {"settings": as_json(settings), "fitted_to": provenance, "figures": figures})
    for level, shares in figures["at_least"].items():
        print(f"confidence of {level} and more: real {shares['real']:.3f}, fitted {shares['fitted']:.3f} of views")
    print(f"settings: {file}")


HELP = CommandHelp(
    examples=(("--detector compact", "fit it to the detector that comes with the project"),),
)
main = make_main("sbm_gym.fit_simulated", FitConfig, run, resumes=False, about=HELP)

if __name__ == "__main__":
    sys.exit(main())
