"""Contact sheets of worlds, renderers and furniture: ``python -m sbm_gym.preview``. Faults are seen there first."""

import sys
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from labeling.core.errors import UsageError
from labeling.runtime.cli import make_main
from labeling.runtime.help import CommandHelp
from labeling.runtime.ranges import Count, PictureHeight, Settings

if TYPE_CHECKING:
    import numpy as np
    from jaxtyping import UInt8

    from sbm_gym.assets.catalog.library import FurnitureLibrary, ModelCard
    from sbm_gym.scenes.compiled import WorldSource

SHEETS = ("scenes", "renderers", "assets")
MOVING = "moving"
"""A further sheet, of scenes in which things move."""
MOMENTS, MOVING_THINGS, STEPS_BETWEEN = 5, 6, 2
"""Pictures in a row of that sheet, what moves in them, and the robot's steps from one to the next."""
EYE_VIEWS = 4
SCENES_PER_SHEET = 6
"""Sheets stay below 2000 pixels in height at the default size."""
WIDE, WIDE_COLUMNS = 1.9, 3
"""Pictures at least so wide, over their height, stand in two rows a scene, so many in a row: pages are narrow."""
ABOVE_ASPECT = 1.4
"""Width of pictures from above, over their height."""
CARDS_PER_ROW = 8


@dataclass(frozen=True)
class PreviewConfig(Settings):
    """Writes contact sheets as PNG: every scene from above and from four places, both renderers side by side, and
    every furniture model of every class.
    """

    out: Path = Path("out/preview")
    """Folder for the sheets."""
    what: tuple[str, ...] = SHEETS
    """Which sheets: scenes, renderers, assets; or moving, each scene at five moments while things move in it."""
    worlds: tuple[str, ...] = ()
    """Kinds of worlds, such as indoor; all of them if not given."""
    split: str | None = None
    """Only scenes of this split: train, val, test, wide or endless."""
    scenes: Count | None = None
    """At most so many scenes of each kind of world."""
    size: PictureHeight = 240
    """Height of a picture of a scene, pixels."""


def run(config: PreviewConfig) -> list[Path]:
    """Writes the sheets that were asked for.

    Returns:
        The files, in the order in which they were written.

    Raises:
        SbmError: if a kind of sheet or world is unknown, or what it needs is not installed.
    """
    from tqdm import tqdm

    from sbm_gym.scenes.world_sources import WORLDS, world_source

    for given, known, name in ((config.what, (*SHEETS, MOVING), "sheet"), (config.worlds, WORLDS, "kind of world")):
        unknown = [entry for entry in given if entry not in known]
        if unknown:
            raise UsageError(f"there is no {name} {unknown[0]!r}; known: {', '.join(known)}")
    config.check()
    sources = {kind: world_source(kind) for kind in config.worlds or WORLDS}
    written: list[Path] = []
    with tqdm(unit="picture", mininterval=0.5) as bar:
        for kind, source in sources.items() if {"scenes", "renderers"} & set(config.what) else ():
            written += _scene_sheets(config, kind, source, bar)
        for kind in sources if MOVING in config.what else ():
            written += _moving_sheets(config, kind, world_source(kind, movable=True), bar)
        if "assets" in config.what:
            written += _asset_sheets(config, bar)
    return written


# Scenes ---------------------------------------------------------------------------------------------------------------


def _scene_sheets(config: PreviewConfig, kind: str, source: "WorldSource", bar: Any) -> Iterator[Path]:
    from sbm_gym.rendering.contact_sheet import write_sheet

    names = source.scenes(config.split)[: config.scenes]
    height = config.size
    shape = source.profile.capture_size
    width = round(height * min(shape[1] / shape[0], 2.0))
    is_wide = width >= WIDE * height
    per_sheet = SCENES_PER_SHEET // 2 if is_wide else SCENES_PER_SHEET
    for start in range(0, len(names), per_sheet):
        chosen = names[start : start + per_sheet]
        scene_tiles, renderer_tiles = [], []
        for name in chosen:
            bar.set_description(f"{kind} {name}", refresh=False)
            overview, pairs = _draw_scene(config, source, name, height, width, bar)
            # The second row of wide pictures begins below the first of them, not below the view from above.
            scene_tiles += [*overview[:WIDE_COLUMNS], _blank(height), *overview[WIDE_COLUMNS:]] if is_wide else overview
            renderer_tiles += pairs
        suffix = f"{kind}_{start // per_sheet}.png"
        in_a_row = (WIDE_COLUMNS, 2) if is_wide else (1 + EYE_VIEWS, 4)
        for what, tiles, columns in zip(("scenes", "renderers"), (scene_tiles, renderer_tiles), in_a_row, strict=True):
            if what in config.what:
                yield write_sheet(config.out / f"{what}_{suffix}", tiles, columns)


def _moving_sheets(config: PreviewConfig, kind: str, source: "WorldSource", bar: Any) -> Iterator[Path]:
    import numpy as np

    from sbm_gym.rendering.contact_sheet import write_sheet
    from sbm_gym.scenes.moving_views import moments
    from sbm_gym.scenes.scene_cache import open_scene
    from sbm_gym.worlds.moving.motion_config import MotionConfig

    shape, tiles = source.profile.capture_size, []
    size = config.size, round(config.size * min(shape[1] / shape[0], 2.0))
    for name in source.scenes(config.split)[: config.scenes]:
        bar.set_description(f"{kind} {name}", refresh=False)
        rng = np.random.default_rng(zlib.crc32(name.encode()))
        step_s = source.profile.step_s
        scene = open_scene(source, name, "rays", source.profile.body)
        scene = scene.for_episode(rng, MotionConfig(MOVING_THINGS), MOMENTS * STEPS_BETWEEN * step_s)
        if scene.arrangement is None or not scene.arrangement.movers:
            bar.write(f"note: nothing in {name} can move", file=sys.stderr)
            bar.update(MOMENTS)
            scene.renderer.close()
            continue
        pictures = moments(scene, MOMENTS, STEPS_BETWEEN * step_s, size, rng)
        captions = [f"{name} {number * STEPS_BETWEEN * step_s:.1f} s" for number in range(MOMENTS)]
        tiles += list(zip(pictures, captions, strict=True))
        bar.update(len(pictures))
        scene.renderer.close()
    if tiles and size[1] >= WIDE * size[0]:
        blanks = [_blank(size[0])] * (-MOMENTS % WIDE_COLUMNS)
        rows = [[*tiles[start : start + MOMENTS], *blanks] for start in range(0, len(tiles), MOMENTS)]
        yield write_sheet(config.out / f"moving_{kind}.png", [one for row in rows for one in row], WIDE_COLUMNS)
    elif tiles:
        yield write_sheet(config.out / f"moving_{kind}.png", tiles, MOMENTS)


def _blank(height: int) -> "tuple[UInt8[np.ndarray, 'h w 3'], str]":
    """Takes a place on a sheet."""
    import numpy as np

    from sbm_gym.rendering.contact_sheet import PAPER

    return np.full((height, 1, 3), PAPER, np.uint8), ""


def _draw_scene(config: PreviewConfig, source: "WorldSource", name: str, height: int, width: int, bar: Any):
    """Captioned pictures of one scene: from above and at eye level, and pairs of rays and gl."""
    import mujoco
    import numpy as np

    from labeling.core.views import Camera
    from sbm_gym.rendering.gl.renderer import GlRenderer
    from sbm_gym.rendering.rays.renderer import RaysRenderer
    from sbm_gym.scenes.viewpoints import eye_level_views, view_from_above

    world = source.build(name)
    model = world.spec.compile()
    data = mujoco.MjData(model)
    if world.stage is not None:
        # As an episode finds it.
        arrangement = world.stage.arrange(np.random.default_rng(zlib.crc32(name.encode())))
        arrangement.apply(model)
        world = replace(world, objects=arrangement.objects)
    mujoco.mj_forward(model, data)
    rays = RaysRenderer(model)
    eye_m, near_m = source.profile.body.camera_height_m, source.profile.ring_m[0]
    poses = eye_level_views(world, model, data, eye_m, EYE_VIEWS, near_m, rays)
    cameras = [Camera.from_fov(pose, (height, width), 0.5 * np.pi) for pose in poses]
    overview, pairs = [], []
    if "scenes" in config.what:
        overview.append((view_from_above(model, data, eye_m, height, round(ABOVE_ASPECT * height)), name))
        bar.update()
    frames = [rays.render(data, camera).rgb for camera in cameras]
    bar.update(len(frames))
    if "scenes" in config.what:
        overview += [(frame, f"view {number}") for number, frame in enumerate(frames)]
    if "renderers" in config.what:
        gl = GlRenderer(model)
        for number in (0, 2):
            frame = gl.render(data, cameras[number]).rgb
            pairs += [(frames[number], f"{name} rays"), (frame, f"{name} gl")]
            bar.update()
        gl.close()
    return overview, pairs


# Furniture ------------------------------------------------------------------------------------------------------------


def _asset_sheets(config: PreviewConfig, bar: Any) -> Iterator[Path]:
    from sbm_gym.assets.catalog.library import default_library
    from sbm_gym.assets.models.classes import USES
    from sbm_gym.assets.parametric.builtin import BuiltinLibrary
    from sbm_gym.rendering.contact_sheet import write_sheet

    uses: dict[str, list[str]] = {}
    for use, described in USES.items():
        uses.setdefault(described.category or "furnishings", []).append(use)
    libraries: list[tuple[str, Any]] = [("installed", default_library()), ("builtin", BuiltinLibrary())]
    for source, library in libraries:
        for category, members in uses.items():
            cards = {card.model_id: card for use in members for card in library.models(use)}
            if not cards:
                continue
            tiles = []
            for card in cards.values():
                bar.set_description(f"{source} {category}", refresh=False)
                tiles.append((draw_model(library, card, 2 * config.size // 3), f"{card.use}: {card.model_id}"))
                bar.update()
            yield write_sheet(config.out / f"assets_{source}_{category}.png", tiles, CARDS_PER_ROW)


def draw_model(library: "FurnitureLibrary", card: "ModelCard", size: int) -> "UInt8[np.ndarray, 'h w 3']":
    """A furniture model on a grey floor, from its front, a little from the left and above.

    Args:
        library: where it comes from.
        card: which one.
        size: height and width of the picture.
    """
    import mujoco
    import numpy as np

    from labeling.core.geometry import look_at
    from labeling.core.views import Camera
    from sbm_gym.rendering.rays.renderer import RaysRenderer
    from sbm_gym.worlds.scene_builder import SceneBuilder

    spec = mujoco.MjSpec()
    spec.visual.headlight.ambient, spec.visual.headlight.diffuse = [0.35] * 3, [0.15] * 3
    radius = 0.5 * float(np.linalg.norm(card.size_m))
    ground = spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[50 * radius, 50 * radius, 1.0])
    ground.rgba = [0.75, 0.75, 0.73, 1.0]
    sun = mujoco.mjtLightType.mjLIGHT_DIRECTIONAL
    spec.worldbody.add_light(type=sun, pos=[0, 0, 9], dir=[0.5, 0.6, -1.0], diffuse=[0.6] * 3, castshadow=True)
    builder = SceneBuilder(spec)
    builder.furniture(spec.worldbody.add_body(name="model"), library.load(card))
    model = builder.whole_spec().compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    middle = np.array([0.0, 0.0, 0.5 * card.size_m[2]])
    pose = look_at(middle + 3.2 * radius * np.array([-0.55, -0.75, 0.45]), middle)
    return RaysRenderer(model).render(data, Camera.from_fov(pose, (size, size), np.deg2rad(40.0))).rgb


def _run_and_list(config: PreviewConfig) -> None:
    for path in run(config):
        print(path)


HELP = CommandHelp(
    examples=(("", "contact sheets of everything"),),
)
main = make_main("sbm_gym.preview", PreviewConfig, _run_and_list, resumes=False, about=HELP)

if __name__ == "__main__":
    sys.exit(main())
