"""Blocks of a town that are not built over: parks, squares, car parks."""

import numpy as np

from sbm_gym.worlds.static_meshes import box_quads
from sbm_gym.worlds.towns import materials
from sbm_gym.worlds.towns.furnisher import Furnisher
from sbm_gym.worlds.towns.ground import flat
from sbm_gym.worlds.towns.plan import CAR_PARK_M, KERB_M, PAVEMENT_M, Block, Rect


def park(furnisher: Furnisher, block: Block) -> None:
    """Lawns between crossing paths, a fountain, trees, hedges, benches."""
    lawn, rng = block.rect.shrunk(PAVEMENT_M - 0.6), furnisher.rng
    x, y = lawn.middle_m
    furnisher.meshes.tiled(flat(lawn, KERB_M + 0.01), materials.grass())
    path = 1.3
    for rect in (Rect(lawn.x0, y - path, lawn.x1, y + path), Rect(x - path, lawn.y0, x + path, lawn.y1)):
        furnisher.meshes.tiled(flat(rect, KERB_M + 0.022), materials.material("gravel"))
    furnisher.meshes.tiled(flat(Rect(x - 3.2, y - 3.2, x + 3.2, y + 3.2), KERB_M + 0.03), materials.material("gravel"))
    furnisher.stand(furnisher.pick("fountain"), np.array([x, y]), 0.0)
    for angle in (0.25, 0.75, 1.25, 1.75):
        away = 4.3 * np.array([np.cos(np.pi * angle), np.sin(np.pi * angle)])
        furnisher.stand(furnisher.town_own("bench"), np.array([x, y]) + away, float(np.arctan2(-away[0], away[1])))
    uses = ("park_tree", "street_tree")
    for _ in range(40):
        point = rng.uniform([lawn.x0 + 1.5, lawn.y0 + 1.5], [lawn.x1 - 1.5, lawn.y1 - 1.5])
        if min(abs(point[0] - x), abs(point[1] - y)) < 2.5 or np.hypot(*(point - [x, y])) < 5.5:
            continue
        near = [o for o in furnisher.obstacles if np.hypot(o.x_m - point[0], o.y_m - point[1]) < 5.0]
        if not near and furnisher.trees < 7:
            furnisher.tree(furnisher.pick(uses[int(rng.random() < 0.6)]), point)
    for edge in (lawn.y0 + 0.4, lawn.y1 - 0.4):
        for x0, x1 in ((lawn.x0 + 0.3, x - 2.0), (x + 2.0, lawn.x1 - 0.3)):
            _hedge(furnisher, Rect(x0, edge - 0.3, x1, edge + 0.3))


def square(furnisher: Furnisher, block: Block) -> None:
    """A paved square with a fountain, cafe tables under parasols, trees and benches."""
    ground, rng = block.rect.shrunk(PAVEMENT_M - 1.0), furnisher.rng
    x, y = ground.middle_m
    furnisher.meshes.tiled(flat(ground, KERB_M + 0.01), materials.material("ashlar", (170, 166, 158)))
    furnisher.stand(furnisher.pick("fountain"), np.array([x, y]), 0.0)
    for _ in range(4):
        table = rng.uniform([ground.x0 + 3, ground.y0 + 3], [ground.x1 - 3, ground.y1 - 3])
        if np.hypot(*(table - [x, y])) < 4.0:
            continue
        turn = float(rng.uniform(-np.pi, np.pi))
        if not furnisher.stand(furnisher.town_own("cafe_table"), table, turn):
            continue
        for side in (0.0, np.pi):
            away = 0.68 * np.array([np.sin(turn + side), -np.cos(turn + side)])
            furnisher.stand(furnisher.town_own("cafe_chair"), table + away, turn + side + np.pi)
        shade = furnisher.pick("parasol")
        if shade is not None:
            furnisher.stand(shade, table + np.array([1.4, 1.2]), 0.0)
    for corner in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
        point = np.array([x, y]) + np.array(corner) * (0.5 * np.array(ground.size_m) - 2.0)
        furnisher.tree(furnisher.pick("street_tree"), point)
        inward = -np.array(corner, float)
        furnisher.stand(furnisher.town_own("bench"), point + 3.2 * inward, float(np.arctan2(inward[0], -inward[1])))


def car_park(furnisher: Furnisher, block: Block) -> None:
    """Asphalt with two rows of bays, a drive to the street, trees at its corners."""
    yard = block.rect.shrunk(PAVEMENT_M - 0.8)
    furnisher.meshes.tiled(flat(yard, CAR_PARK_M), materials.asphalt())
    x, y = yard.middle_m
    for x0, x1 in ((block.rect.x0, yard.x0), (yard.x1, block.rect.x1)):
        furnisher.meshes.tiled(flat(Rect(x0, y - 2.8, x1, y + 2.8), CAR_PARK_M - 0.004), materials.asphalt())
    for sx, sy in ((1, 1), (-1, 1), (1, -1), (-1, -1)):
        point = np.array([x, y]) + np.array([sx, sy]) * (0.5 * np.array(yard.size_m) - 1.2)
        furnisher.tree(furnisher.pick("street_tree"), point)
    for edge in (yard.y0 + 0.4, yard.y1 - 0.4):
        _hedge(furnisher, Rect(yard.x0 + 2.5, edge - 0.3, yard.x1 - 2.5, edge + 0.3))


def _hedge(furnisher: Furnisher, rect: Rect) -> None:
    """A clipped hedge, a metre high, unless something is in the way."""
    if furnisher.fits(rect.box):
        quads = box_quads(np.array([[rect.x0, rect.y0, KERB_M]]), np.array([[rect.x1, rect.y1, KERB_M + 1.0]]))
        furnisher.meshes.tiled(quads, materials.leaves())
        furnisher.block(rect.box, 1.1)
