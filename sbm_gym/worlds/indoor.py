"""Furnished rooms: from a name or a seed to a world."""

import mujoco
import numpy as np
from jaxtyping import Float

from labeling.instances import Box3d
from sbm_gym.assets.library import FurnitureLibrary, default_library
from sbm_gym.worlds.building import SceneBuilder
from sbm_gym.worlds.navigable import NavigableMap, navigable_map
from sbm_gym.worlds.placing import Layout, Opening, Placement, Room, rotation
from sbm_gym.worlds.room_kinds import NEEDED, ROOM_KINDS, furnish
from sbm_gym.worlds.shell import build_shell, draw_finish, hang_lamps, hang_pictures, lay_rug
from sbm_gym.worlds.splits import scene_seed
from sbm_gym.worlds.world import ObjectInstance, World

AGENT_HEIGHT_M = 1.6
"""What hangs higher than this is not in the agent's way."""
RING_M = (1.0, 1.25, 1.5, 1.75, 2.0)
"""Distances from an object at which it is looked at. Source: thesis section 4.1 (1 to 2 m)."""
BEARINGS = 18
"""Directions from an object that are told apart. Source: the published code (yaw bins of 20 degrees)."""
MIN_BEARINGS = 3
"""An object that can be looked at from fewer directions is taken out of the room."""
MIN_OBJECTS = 6
ATTEMPTS = 12
"""How often a room is drawn until it has what its kind needs."""


def build_indoor(scene: str | int, *, library: FurnitureLibrary | None = None) -> World:
    """Builds a furnished room.

    The same scene gives the same world in any process, given the same furniture libraries.

    Args:
        scene: a named scene (``train/00``), ``seed/N`` or N.
        library: where the furniture comes from; the installed Sweet Home 3D libraries if None.

    Returns:
        The world, without an agent.

    Raises:
        UsageError: if there is no such scene.
        MissingAssetsError: if the furniture is not installed.
    """
    name, source = scene_seed(scene)
    library = library or default_library()
    # A room in which something its kind needs found no place is drawn again; the attempt is part of the seed.
    best: tuple[int, str, Layout, list[Placement], NavigableMap] | None = None
    for attempt in range(ATTEMPTS):
        rng = np.random.default_rng((*source.seed, attempt))
        kinds = list(ROOM_KINDS)
        kind = source.kind or kinds[rng.integers(len(kinds))]
        layout = Layout(draw_room(rng), rng)
        rugs = furnish(kind, layout, library)
        navigable = _make_approachable(layout, library)
        missing = _missing(kind, layout)
        if best is None or missing < best[0]:
            best = (missing, kind, layout, rugs, navigable)
        if missing == 0:
            break
    assert best is not None
    _, kind, layout, rugs, navigable = best
    return _assemble(name, kind, layout, rugs, navigable, library)


def _missing(kind: str, layout: Layout) -> int:
    """How many objects a room lacks: classes that its kind needs, and others up to ``MIN_OBJECTS``."""
    present = [piece.card.category for piece in layout.placements if piece.card.category is not None]
    return sum(category not in present for category in NEEDED[kind]) + max(MIN_OBJECTS - len(present), 0)


def draw_room(rng: np.random.Generator) -> Room:
    """An empty room of 4 to 6.4 by 4.6 to 7.6 metres with a door and one or two windows."""
    size = np.round(np.array([rng.uniform(4.0, 6.4), rng.uniform(4.6, 7.6)]), 2)
    low = -size / 2
    room = Room(
        (float(low[0]), float(low[1])), (float(-low[0]), float(-low[1])), float(np.round(rng.uniform(2.5, 2.8), 2))
    )
    lengths = [wall.length_m for wall in room.walls()]
    order = [int(index) for index in rng.permutation(4)]
    width = 0.86
    near_corner = rng.uniform(0.25, 0.9)
    start = near_corner if rng.random() < 0.5 else lengths[order[0]] - near_corner - width
    openings = [Opening("door", order[0], float(start), float(start + width), 0.0, 2.03)]
    for wall in order[1 : 1 + int(rng.integers(1, 3))]:
        wide = float(rng.uniform(1.0, min(2.2, lengths[wall] - 1.2)))
        at = float(rng.uniform(0.5, lengths[wall] - wide - 0.5))
        sill = float(rng.choice([0.85, 0.95]))
        openings.append(Opening("window", wall, at, at + wide, sill, float(rng.uniform(2.05, 2.25))))
    return Room(room.low_m, room.high_m, room.height_m, tuple(openings))


def _make_approachable(layout: Layout, library: FurnitureLibrary) -> NavigableMap:
    """Takes objects out of the room until every one that is left can be looked at from several sides.

    Returns:
        The map of the room as it is then. Pockets that cannot be reached are not free, so the free space is connected.
    """
    while True:
        everything = navigable_map(
            np.array(layout.room.low_m), np.array(layout.room.high_m), _obstacles(layout.placements, library)
        )
        navigable = NavigableMap(everything.largest_component, everything.origin_m, everything.cell_m)
        hidden = [
            piece
            for piece in layout.placements
            if piece.card.category is not None
            and approach_bearings(navigable, np.array([piece.x_m, piece.y_m])) < MIN_BEARINGS
        ]
        if not hidden:
            return navigable
        # Whatever blocks an object is usually the last thing put near it; the object itself goes with what it carries.
        gone = hidden[-1]
        layout.placements[:] = [p for p in layout.placements if p is not gone and not _stands_on(p, gone)]


def _stands_on(thing: Placement, support: Placement) -> bool:
    if thing.z_m <= 0 or abs(thing.z_m - support.z_m - support.card.size_m[2]) > 1e-6:
        return False
    local = rotation(-support.yaw_rad) @ [thing.x_m - support.x_m, thing.y_m - support.y_m]
    return bool(np.all(np.abs(local) <= np.array(support.card.size_m[:2]) / 2))


def approach_bearings(navigable: NavigableMap, centre_m: Float[np.ndarray, "2"]) -> int:
    """From how many of ``BEARINGS`` directions an object can be looked at from 1 to 2 m away."""
    count = 0
    for bearing in np.arange(BEARINGS) * (2 * np.pi / BEARINGS):
        direction = np.array([np.cos(bearing), np.sin(bearing)])
        count += any(navigable.is_free(centre_m + distance * direction) for distance in RING_M)
    return count


def _obstacles(placements: list[Placement], library: FurnitureLibrary) -> Float[np.ndarray, "n 5"]:
    """What stands in the agent's way, as rows of ``navigable_map``."""
    rows = []
    for piece in placements:
        if piece.z_m > AGENT_HEIGHT_M:
            continue
        for x0, y0, x1, y1 in library.load(piece.card).footprint_m:
            x, y = piece.at((x0 + x1) / 2, (y0 + y1) / 2)
            rows.append((x, y, (x1 - x0) / 2, (y1 - y0) / 2, piece.yaw_rad))
    return np.array(rows, float).reshape(-1, 5)


def _assemble(
    name: str,
    kind: str,
    layout: Layout,
    rugs: list[Placement],
    navigable: NavigableMap,
    library: FurnitureLibrary,
) -> World:
    """Turns a layout into MuJoCo geometry."""
    rng, room = layout.rng, layout.room
    spec = mujoco.MjSpec()
    spec.modelname = name.replace("/", "_")
    spec.visual.headlight.active = 0
    # Light from lamps that has bounced about the room; the lamps themselves give the shadows.
    spec.visual.headlight.ambient = [0.3, 0.3, 0.3]
    spec.visual.map.znear, spec.visual.map.zfar = 0.01, 30.0
    spec.stat.extent, spec.stat.center = 3.0, [0.0, 0.0, 1.0]
    builder = SceneBuilder(spec)
    build_shell(builder, room, draw_finish(kind, rng), rng)
    hang_lamps(builder, room, rng)
    hang_pictures(builder, room, _taken_wall(layout), rng)
    for number, rug in enumerate(rugs):
        body = _body(spec, f"rug_{number}", rug)
        if rng.random() < 0.5:
            builder.furniture(body, library.load(rug.card))
        else:
            lay_rug(builder, body, rug.card.size_m, rng)
    objects: list[ObjectInstance] = []
    for number, piece in enumerate(layout.placements):
        label = piece.card.category or piece.card.use
        body_name = f"{label}_{number:02d}"
        body = _body(spec, body_name, piece)
        model = library.load(piece.card)
        builder.furniture(body, model)
        if piece.z_m <= AGENT_HEIGHT_M:
            for rectangle in model.footprint_m:
                builder.touched_box(body, rectangle, (0.0, piece.card.size_m[2]))
        if piece.card.category is not None:
            objects.append(_instance(len(objects) + 1, piece, body_name))
    return World(name, spec, tuple(objects), navigable)


def _body(spec: mujoco.MjSpec, name: str, piece: Placement) -> mujoco.MjsBody:
    half = piece.yaw_rad / 2
    return spec.worldbody.add_body(
        name=name, pos=[piece.x_m, piece.y_m, piece.z_m], quat=[np.cos(half), 0.0, 0.0, np.sin(half)]
    )


def _instance(instance_id: int, piece: Placement, body_name: str) -> ObjectInstance:
    turn = np.eye(3)
    turn[:2, :2] = rotation(piece.yaw_rad)
    extent = np.array(piece.card.size_m)
    centre = np.array([piece.x_m, piece.y_m, piece.z_m + extent[2] / 2])
    assert piece.card.category is not None
    return ObjectInstance(instance_id, piece.card.category, body_name, Box3d(centre, extent, turn), piece.card.model_id)


def _taken_wall(layout: Layout) -> list[tuple[int, float, float]]:
    """Stretches of wall at eye level that have an opening or tall furniture before them."""
    taken = [(o.wall, o.start_m, o.end_m) for o in layout.room.openings]
    for wall in layout.room.walls():
        for piece in layout.placements:
            box = piece.box()
            relative = box.corners() - wall.origin
            if box.high_m > 1.2 and (relative @ wall.normal).min() < 0.3:
                along = relative @ wall.along
                taken.append((wall.index, float(along.min()), float(along.max())))
    return taken
