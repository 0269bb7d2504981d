"""Recipes of vehicles and street furniture."""

from sbm_gym.assets.parametric.parts.recipe import Recipe
from sbm_gym.assets.parametric.towns import cars, heavy_vehicles, squares, street_furniture, trees, two_wheelers

TOWN: dict[str, Recipe] = {
    "car": Recipe("car", ((1.74, 1.96), (3.7, 4.8), (1.42, 1.7)), cars.car),
    "van": Recipe("van", ((2.0, 2.2), (4.9, 5.9), (2.1, 2.6)), cars.van),
    "truck": Recipe("lorry", ((2.3, 2.5), (6.2, 9.0), (2.9, 3.6)), heavy_vehicles.truck),
    "bus": Recipe("bus", ((2.5, 2.7), (9.5, 12.0), (2.95, 3.2)), heavy_vehicles.bus),
    "motorcycle": Recipe("motorcycle", ((0.7, 0.85), (1.9, 2.2), (1.1, 1.25)), two_wheelers.motorcycle),
    "bicycle": Recipe("bicycle", ((0.52, 0.64), (1.68, 1.85), (1.0, 1.12)), two_wheelers.bicycle),
    "street_tree": Recipe("tree", ((3.2, 5.5), (3.2, 5.5), (5.5, 9.0)), trees.tree, square=1.0),
    "park_tree": Recipe("tree", ((3.0, 5.0), (3.0, 5.0), (4.5, 8.0)), trees.tree, square=1.0),
    "street_light": Recipe("street lamp", ((0.3, 0.42), (1.2, 1.9), (5.0, 7.0)), street_furniture.street_light),
    "bench": Recipe("bench", ((1.5, 2.0), (0.6, 0.72), (0.8, 0.92)), street_furniture.bench),
    "litter_bin": Recipe(
        "litter bin", ((0.42, 0.55), (0.42, 0.55), (0.8, 1.0)), street_furniture.litter_bin, square=1.0
    ),
    "traffic_cone": Recipe(
        "traffic cone", ((0.28, 0.4), (0.28, 0.4), (0.45, 0.75)), street_furniture.traffic_cone, square=1.0
    ),
    "cafe_table": Recipe("cafe table", ((0.6, 0.8), (0.6, 0.8), (0.7, 0.75)), squares.cafe_table, square=1.0),
    "cafe_chair": Recipe("cafe chair", ((0.4, 0.46), (0.46, 0.54), (0.82, 0.92)), squares.cafe_chair),
    "parasol": Recipe("parasol", ((2.0, 2.8), (2.0, 2.8), (2.3, 2.6)), squares.parasol, square=1.0),
    "fountain": Recipe("fountain", ((3.0, 4.0), (3.0, 4.0), (1.6, 2.2)), squares.fountain, square=1.0),
}
