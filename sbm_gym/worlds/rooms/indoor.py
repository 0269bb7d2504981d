"""Furnished homes and offices: from a name or a seed to a world."""

import hashlib
from collections.abc import Callable, Iterable, Sequence
from typing import TypeVar

import mujoco
import numpy as np
from jaxtyping import Float

from sbm_gym.assets.catalog.library import FurnitureLibrary
from sbm_gym.assets.parametric.builtin import BuiltinLibrary
from sbm_gym.assets.scene_models import indoor_library, models_of_scene
from sbm_gym.worlds.geometry.navigable import NavigableMap, navigable_map
from sbm_gym.worlds.geometry.placing import Layout, Placement, Room, obstacle_rows
from sbm_gym.worlds.rooms.fittings import hang_lamps, hang_pictures, lay_rug
from sbm_gym.worlds.rooms.floor_plan import (
    OUTER_WALL_M,
    PROGRAMMES,
    ROOM_KINDS,
    FloorPlan,
    complement,
    draw_plan,
)
from sbm_gym.worlds.rooms.room_kinds import furnish
from sbm_gym.worlds.rooms.room_stage import MovablePiece, RoomStage, loose_pieces
from sbm_gym.worlds.rooms.shell import Style, build_shell, build_walls, draw_finish, draw_style
from sbm_gym.worlds.scene_builder import SceneBuilder, instance_of
from sbm_gym.worlds.splits import INTERIORS
from sbm_gym.worlds.world import ObjectInstance, World

AGENT_HEIGHT_M = 1.6
"""What hangs higher than this is not in the agent's way."""
RING_M = (1.0, 1.25, 1.5, 1.75, 2.0)
"""Distances from an object at which it is looked at. Source: thesis section 4.1 (1 to 2 m)."""
CELL_M = 0.05
"""Of the map of where one can stand."""
MIN_BEARINGS = 2
"""An object that can be looked at from fewer directions is taken out of the room."""
MIN_VIEWPOINTS = 8
"""Likewise for places on its rings; 8 viewpoints make a ring."""
ROOM_ATTEMPTS = 8
"""How often a room is furnished until it has what its kind needs."""
PLAN_ATTEMPTS = 4
"""How often a floor plan is drawn until every room has what its kind needs."""
MAX_TRIANGLES = 440_000
"""Of all furniture in a scene; renderers hold every triangle."""
MAX_LAMPS = 7
"""OpenGL's fixed pipeline knows eight lights."""


_T = TypeVar("_T")


def build_indoor(
    scene: str | int,
    *,
    library: FurnitureLibrary | None = None,
    unseen_models: bool = False,
    movable: bool = False,
) -> World:
    """Builds a furnished home or office.

    The same scene gives the same world in any process, given the same furniture libraries.

    Args:
        scene: a named scene (``train/00``), ``seed/N`` or N.
        library: where the furniture comes from; the installed catalogues with builtin cushions if None.
        unseen_models: keep the models that validation and test scenes show out of every other scene but final ones,
            which show no others. Validation and test scenes are the same either way.
        movable: have some pieces of furniture stand loose; the world then has a ``stage`` that can move them.

    Returns:
        The world, without an agent.

    Raises:
        UsageError: if there is no such scene.
        MissingAssetsError: if the furniture is not installed.
    """
    name, source = INTERIORS.resolve(scene)
    library = models_of_scene(library or indoor_library(), INTERIORS.shows_held_out(name, unseen_models), unseen_models)

    # A home in which something a room needs found no place is drawn again; the attempt is part of the seed.
    def attempt(number: int) -> tuple[FloorPlan, list[Layout]]:
        rng = np.random.default_rng((*source.seed, number))
        kinds = list(PROGRAMMES)
        plan = draw_plan(source.kind or kinds[rng.integers(len(kinds))], rng)
        return plan, _furnish_all(plan, library, rng)

    home = _best(map(attempt, range(PLAN_ATTEMPTS)), lambda home: (sum(_faults(layout)[0] for layout in home[1]),))
    style_seed = int.from_bytes(hashlib.sha256(repr(source.seed).encode()).digest()[:8], "little")
    return _assemble(name, *home, library, np.random.default_rng(style_seed), movable)


def build_room(
    name: str,
    size_m: tuple[float, float],
    furnish: Callable[[Layout, FurnitureLibrary], object],
    *,
    kind: str = "living_room",
    library: FurnitureLibrary | None = None,
    seed: int = 0,
) -> World:
    """Builds a world of one closed room, furnished as one likes.

    >>> import sbm_gym
    >>> world = sbm_gym.build_room("den", (4.0, 3.0), lambda layout, library: layout.in_the_open(
    ...     library.models("coffee_table")[0], around_m=0.5))
    >>> [instance.category for instance in world.objects]
    ['table']

    Args:
        name: of the scene.
        size_m: lengths along x and y; the middle is the origin.
        furnish: puts pieces into the room, given its empty layout and the library. What it returns is ignored.
        kind: decides floor and walls, a key of ``ROOM_KINDS``.
        library: where the furniture comes from; models made from seeds if None.
        seed: decides all that is drawn at random.

    Returns:
        The world, without an agent.
    """
    rng = np.random.default_rng(seed)
    half_x, half_y = 0.5 * size_m[0], 0.5 * size_m[1]
    room = Room((-half_x, -half_y), (half_x, half_y), height_m=2.6, kind=kind)
    layout, library = Layout(room, rng), library or BuiltinLibrary(seed)
    furnish(layout, library)
    outer_x, outer_y = half_x + OUTER_WALL_M, half_y + OUTER_WALL_M
    plan = FloorPlan((room,), (), (-outer_x, -outer_y, outer_x, outer_y))
    return _assemble(name, plan, [layout], library, rng)


def _best(attempts: Iterable[_T], faults: Callable[[_T], tuple[int, ...]]) -> _T:
    """The first attempt without faults, else the first of those with the fewest."""
    made: list[_T] = []
    for attempt in attempts:
        made.append(attempt)
        if not any(faults(attempt)):
            break
    return min(made, key=faults)


def _furnish_all(plan: FloorPlan, library: FurnitureLibrary, rng: np.random.Generator) -> list[Layout]:
    """Furnishes every room of a plan, each with its share of the triangles that are left."""
    area = np.array([np.prod(room.size_m) for room in plan.rooms])
    left = MAX_TRIANGLES
    layouts: list[Layout] = []
    for index in range(len(plan.rooms)):
        budget = int(left * area[index] / area[index:].sum())
        tries = (_furnish(plan, index, library, stream, budget) for stream in rng.spawn(ROOM_ATTEMPTS))
        layouts.append(_best(tries, _faults))
        left -= sum(library.load(piece.card).num_triangles for piece in layouts[-1].placements)
    return layouts


def _furnish(
    plan: FloorPlan, index: int, library: FurnitureLibrary, rng: np.random.Generator, max_triangles: int
) -> Layout:
    """Furnishes one room once."""
    layout = Layout(plan.rooms[index], rng)
    furnish(layout, library, max_triangles)
    _make_approachable(plan, index, layout, library)
    return layout


def _faults(layout: Layout) -> tuple[int, int]:
    """How many classes found no place that a room of its kind needs, and how many uses without a class."""
    kind, cards = ROOM_KINDS[layout.room.kind], [piece.card for piece in layout.placements]
    missing = set(kind.needed) - {card.category for card in cards}
    return len(missing), len(set(kind.expected) - {card.use for card in cards})


def _make_approachable(plan: FloorPlan, index: int, layout: Layout, library: FurnitureLibrary) -> None:
    """Takes pieces out of a room until its doorways are joined and every object can be looked at from several sides."""
    room = layout.room
    doorways = [passage for passage in plan.passages if index in passage.rooms]
    margin = 0.5
    # Its cells are cells of the whole home's map.
    origin = np.array(plan.bounds[:2])
    low = origin + CELL_M * np.floor((np.array(room.low_m) - margin - origin) / CELL_M)
    high = np.array(room.high_m) + margin
    # The room and its doorways are all there is: what one sees an object from is never behind a wall.
    open_floor = [(*room.low_m, *room.high_m), *(passage.through(margin) for passage in doorways)]
    walls = np.concatenate([_rows(complement(open_floor, (*low.tolist(), *high.tolist()))), obstacle_rows(room.leaves)])
    while True:
        solid = np.concatenate([walls, _obstacles(layout.placements, library)])
        navigable = navigable_map(low, high, solid, cell_m=CELL_M).connected()
        shut = [passage for passage in doorways if not navigable.is_free(passage.middle_m)]
        hidden = [
            piece
            for piece in layout.placements
            if piece.card.category is not None and not _can_be_looked_at(navigable, np.array([piece.x_m, piece.y_m]))
        ]
        if shut:
            # Doors have free floor before them, so what shuts one in stands farther off: the newest piece nearby goes.
            middle = shut[0].middle_m
            standing = [piece for piece in layout.placements if piece.on is None and piece.z_m <= AGENT_HEIGHT_M]
            gone = min(standing, key=lambda piece: float(np.hypot(piece.x_m - middle[0], piece.y_m - middle[1])))
        elif hidden:
            # Whatever blocks an object is usually the last thing put near it; the object goes with what it carries.
            gone = hidden[-1]
        else:
            return
        layout.placements[:] = [piece for piece in layout.placements if piece is not gone and piece.on is not gone]


def _rows(rectangles) -> Float[np.ndarray, "n 5"]:
    """Rectangles as rows of ``navigable_map``."""
    r = np.array(rectangles, float).reshape(-1, 4)
    middle, half = 0.5 * (r[:, :2] + r[:, 2:]), 0.5 * (r[:, 2:] - r[:, :2])
    return np.concatenate([middle, half, np.zeros((len(r), 1))], axis=1)


def _can_be_looked_at(navigable: NavigableMap, centre_m: Float[np.ndarray, "2"]) -> bool:
    free = navigable.free_around(centre_m, RING_M)
    return bool(free.sum() >= MIN_VIEWPOINTS and free.any(axis=1).sum() >= MIN_BEARINGS)


def _obstacles(placements: list[Placement], library: FurnitureLibrary) -> Float[np.ndarray, "n 5"]:
    """What stands in the agent's way, as rows of ``navigable_map``."""
    touched = [piece for piece in placements if _is_touched(piece)]
    return obstacle_rows(box for piece in touched for box in piece.footprint(library.load(piece.card).footprint_m))


def _is_touched(piece: Placement) -> bool:
    """Whether the agent can run into a piece; cushions lie within what carries them."""
    return piece.z_m <= AGENT_HEIGHT_M and piece.card.category != "cushion"


def _assemble(
    name: str,
    plan: FloorPlan,
    layouts: list[Layout],
    library: FurnitureLibrary,
    rng: np.random.Generator,
    movable: bool = False,
) -> World:
    """Turns furnished rooms into MuJoCo geometry."""
    spec = mujoco.MjSpec()
    spec.modelname = name.replace("/", "_")
    spec.visual.headlight.active = 0
    # Light from lamps that has bounced about the rooms; the lamps themselves give the shadows.
    spec.visual.headlight.ambient = [0.3, 0.3, 0.3]
    spec.visual.map.znear, spec.visual.map.zfar = 0.01, 40.0
    x0, y0, x1, y1 = plan.bounds
    spec.stat.extent = max(3.0, 0.5 * float(np.hypot(x1 - x0, y1 - y0)))
    spec.stat.center = [0.0, 0.0, 1.0]
    builder = SceneBuilder(spec)
    build_walls(builder, plan, plan.rooms[0].height_m)
    style = draw_style(rng)
    lamps = _lamps(plan.rooms)
    obstacles = [_rows(plan.solid_rectangles())]
    loose = loose_pieces([piece for one in layouts for piece in one.placements], library) if movable else []
    movables: list[MovablePiece] = []
    objects: list[ObjectInstance] = []
    pieces = 0
    for number, layout in enumerate(layouts):
        _finish_room(builder, layout, number, style, lamps[number], library, rng)
        fixed = [piece for piece in layout.placements if not any(piece is one for one in loose)]
        obstacles += [obstacle_rows(layout.room.leaves), _obstacles(fixed, library)]
        for piece in layout.placements:
            body_name = f"{piece.card.category or piece.card.use}_{pieces:03d}"
            pieces += 1
            is_loose = any(piece is one for one in loose)
            body = builder.place(body_name, piece, moves=is_loose)
            model = library.load(piece.card)
            builder.furniture(body, model)
            if _is_touched(piece):
                for rectangle in model.footprint_m:
                    builder.touched_box(body, rectangle, (0.0, piece.card.size_m[2]))
            if piece.card.category is not None:
                objects.append(instance_of(piece, len(objects) + 1, body_name))
            if is_loose:
                movables.append(MovablePiece(piece, body_name, len(objects), model.footprint_m))
    solid = np.concatenate(obstacles)
    floor = navigable_map(np.array([x0, y0]), np.array([x1, y1]), solid, cell_m=CELL_M)
    if not movable:
        return World(name, spec, tuple(objects), floor.connected(), left_out=builder.left_out)
    stage = RoomStage(floor, tuple(movables), tuple(objects))
    navigable = stage.floor_around(movables).connected()
    return World(name, spec, tuple(objects), navigable, stage=stage, left_out=builder.left_out)


def _lamps(rooms: Sequence[Room]) -> list[int]:
    """How many lamps each room has: large rooms two, as long as there are no more than ``MAX_LAMPS`` in all."""
    counts = [1] * len(rooms)
    area = np.array([np.prod(room.size_m) for room in rooms])
    for index in np.argsort(-area):
        if area[index] > 17.0 and sum(counts) < MAX_LAMPS:
            counts[index] = 2
    return counts


def _finish_room(
    builder: SceneBuilder,
    layout: Layout,
    number: int,
    style: Style,
    lamps: int,
    library: FurnitureLibrary,
    rng: np.random.Generator,
) -> None:
    """Adds what belongs to the room itself: its surfaces, lamps, pictures and rugs."""
    room, kind = layout.room, ROOM_KINDS[layout.room.kind]
    name = f"room_{number}_{room.kind}"
    curtains = kind.curtains and rng.random() < 0.75
    build_shell(builder, room, draw_finish(room.kind, style, rng), rng, name, curtains)
    hang_lamps(builder, room, rng, f"lamps_{number}", lamps)
    hang_pictures(builder, room, _taken_wall(layout), rng, f"pictures_{number}", kind.pictures)
    for index, rug in enumerate(layout.rugs):
        body = builder.place(f"rug_{number}_{index}", rug)
        if rng.random() < 0.6:
            builder.furniture(body, library.load(rug.card))
        else:
            lay_rug(builder, body, rug.card.size_m, rng)


def _taken_wall(layout: Layout) -> list[tuple[int, float, float]]:
    """Stretches of wall at eye level that have an opening or tall furniture before them."""
    # Curtains hang beside windows.
    taken = [
        (o.wall, o.start_m - beside, o.end_m + beside)
        for o in layout.room.openings
        for beside in [0.35 if o.kind == "window" else 0.08]
    ]
    for wall in layout.room.walls():
        for box in (*layout.room.leaves, *(piece.box for piece in layout.placements)):
            low, high, out = wall.shadow(box)
            if box.high_m > 1.2 and out < 0.3:
                taken.append((wall.index, low, high))
    return taken
