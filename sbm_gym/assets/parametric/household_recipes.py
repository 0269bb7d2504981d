"""Recipes of furniture and furnishings."""

from sbm_gym.assets.parametric.furniture import (
    beds,
    cabinets,
    couches,
    cushions,
    lamps,
    plants,
    screens,
    seating,
    shelves,
    small_things,
    tables,
    wall_things,
)
from sbm_gym.assets.parametric.kitchen_bath import appliances, bathroom, fridges, kitchen
from sbm_gym.assets.parametric.parts.recipe import Recipe

HOUSEHOLD: dict[str, Recipe] = {
    "dining_chair": Recipe("chair", ((0.40, 0.50), (0.44, 0.54), (0.78, 1.02)), seating.dining_chair),
    "office_chair": Recipe("office chair", ((0.58, 0.70), (0.58, 0.70), (0.88, 1.20)), seating.office_chair),
    "lounge_chair": Recipe("armchair", ((0.68, 0.92), (0.72, 0.90), (0.72, 0.98)), couches.lounge_chair),
    "couch": Recipe("couch", ((1.45, 2.45), (0.80, 1.0), (0.70, 0.92)), couches.couch, adjust=couches.couch_size),
    "beanbag": Recipe("beanbag", ((0.72, 0.98), (0.76, 1.02), (0.58, 0.86)), seating.beanbag),
    "cushion": Recipe("cushion", ((0.30, 0.54), (0.26, 0.54), (0.10, 0.18)), cushions.cushion, free=True),
    "leaning_cushion": Recipe(
        "cushion", ((0.30, 0.54), (0.15, 0.40), (0.25, 0.58)), cushions.leaning_cushion, free=True
    ),
    "dining_table": Recipe(
        "table", ((0.9, 1.9), (0.75, 0.95), (0.72, 0.77)), tables.dining_table, supports=True, square=0.35
    ),
    "coffee_table": Recipe(
        "coffee table", ((0.6, 1.2), (0.5, 0.65), (0.32, 0.48)), tables.coffee_table, supports=True, square=0.3
    ),
    "desk": Recipe("desk", ((1.05, 1.65), (0.58, 0.78), (0.72, 0.76)), tables.desk, supports=True),
    "double_bed": Recipe("double bed", ((1.42, 1.85), (2.06, 2.18), (0.8, 1.25)), beds.bed),
    "single_bed": Recipe("single bed", ((0.92, 1.05), (2.04, 2.12), (0.75, 1.1)), beds.single_bed),
    "nightstand": Recipe("nightstand", ((0.38, 0.55), (0.34, 0.46), (0.42, 0.62)), cabinets.nightstand, supports=True),
    "shelf": Recipe("shelf", ((0.6, 1.5), (0.27, 0.38), (0.75, 2.1)), shelves.shelf),
    "cupboard": Recipe("wardrobe", ((0.9, 1.8), (0.55, 0.64), (1.85, 2.2)), cabinets.cupboard),
    "dresser": Recipe("chest of drawers", ((0.75, 1.4), (0.42, 0.5), (0.75, 1.0)), cabinets.dresser, supports=True),
    "tv_stand": Recipe(
        "television cabinet", ((1.1, 1.8), (0.38, 0.46), (0.38, 0.58)), cabinets.tv_stand, supports=True
    ),
    "office_cabinet": Recipe("filing cabinet", ((0.4, 0.5), (0.5, 0.62), (0.7, 1.35)), cabinets.office_cabinet),
    "kitchen_unit": Recipe(
        "kitchen cabinet",
        ((0.45, 0.8), (0.60, 0.64), (0.88, 0.92)),
        kitchen.base_cabinet,
        supports=True,
        adjust=kitchen.base_size,
        style=kitchen.draw_style,
    ),
    "kitchen_sink": Recipe(
        "sink",
        ((0.6, 0.8), (0.60, 0.64), (1.12, 1.16)),
        kitchen.sink_cabinet,
        adjust=kitchen.sink_size,
        style=kitchen.draw_style,
    ),
    "wall_cabinet": Recipe(
        "wall cabinet",
        ((0.45, 0.8), (0.32, 0.37), (0.66, 0.76)),
        kitchen.wall_cabinet,
        adjust=kitchen.wall_size,
        style=kitchen.draw_style,
    ),
    "cooker": Recipe("cooker", ((0.55, 0.62), (0.60, 0.64), (0.88, 0.92)), appliances.cooker),
    "cooker_hood": Recipe("cooker hood", ((0.58, 0.62), (0.44, 0.50), (0.55, 0.75)), appliances.cooker_hood),
    "washing_machine": Recipe(
        "washing machine", ((0.58, 0.62), (0.56, 0.62), (0.83, 0.87)), appliances.washing_machine, supports=True
    ),
    "worktop_thing": Recipe(
        "kitchen thing", ((0.18, 0.50), (0.16, 0.34), (0.18, 0.30)), appliances.worktop_thing, free=True
    ),
    "fridge": Recipe("fridge", ((0.56, 0.72), (0.62, 0.74), (0.86, 2.0)), fridges.fridge, adjust=fridges.fridge_size),
    "toilet": Recipe("toilet", ((0.37, 0.45), (0.62, 0.74), (0.74, 0.86)), bathroom.toilet),
    "tv": Recipe("television", ((0.75, 1.25), (0.2, 0.28), (0.5, 0.82)), screens.tv),
    "wall_tv": Recipe("wall television", ((0.8, 1.35), (0.07, 0.09), (0.48, 0.78)), screens.wall_tv),
    "floor_plant": Recipe("plant", ((0.5, 0.9), (0.5, 0.9), (0.9, 1.8)), plants.plant, square=1.0),
    "small_plant": Recipe("small plant", ((0.2, 0.36), (0.2, 0.36), (0.25, 0.5)), plants.plant, square=1.0),
    "floor_lamp": Recipe("standard lamp", ((0.36, 0.5), (0.36, 0.5), (1.4, 1.75)), lamps.floor_lamp, square=1.0),
    "table_lamp": Recipe("table lamp", ((0.2, 0.34), (0.2, 0.34), (0.34, 0.6)), lamps.table_lamp, square=1.0),
    "desk_lamp": Recipe("desk lamp", ((0.14, 0.18), (0.3, 0.42), (0.36, 0.5)), lamps.desk_lamp),
    "hanging_lamp": Recipe("hanging lamp", ((0.28, 0.5), (0.28, 0.5), (0.6, 0.9)), lamps.hanging_lamp, square=1.0),
    "rug": Recipe("rug", ((1.5, 2.4), (1.1, 1.7), (0.01, 0.014)), small_things.rug),
    "radiator": Recipe("radiator", ((0.6, 1.3), (0.1, 0.14), (0.5, 0.66)), small_things.radiator),
    "bin": Recipe("bin", ((0.22, 0.34), (0.22, 0.34), (0.3, 0.62)), small_things.waste_bin, square=1.0),
    "washbasin": Recipe("washbasin", ((0.48, 0.7), (0.42, 0.5), (0.92, 1.0)), bathroom.washbasin),
    "bathtub": Recipe("bathtub", ((1.5, 1.75), (0.7, 0.78), (0.54, 0.6)), bathroom.bathtub),
    "shower": Recipe("shower", ((0.78, 1.0), (0.78, 0.95), (1.92, 2.1)), bathroom.shower),
    "mirror": Recipe("mirror", ((0.42, 0.8), (0.03, 0.05), (0.6, 0.85)), bathroom.mirror),
    "towel_rail": Recipe("towels", ((0.5, 0.75), (0.09, 0.12), (0.42, 0.6)), bathroom.towel_rail),
    "table_thing": Recipe(
        "vase or bowl", ((0.08, 0.28), (0.08, 0.28), (0.1, 0.34)), small_things.table_thing, square=1.0
    ),
    "desk_thing": Recipe("books or pens", ((0.17, 0.3), (0.14, 0.24), (0.06, 0.14)), small_things.desk_thing),
    "coat_rack": Recipe("coat rack", ((0.6, 1.0), (0.16, 0.2), (0.95, 1.15)), wall_things.coat_rack),
    "whiteboard": Recipe("whiteboard", ((1.2, 1.9), (0.09, 0.11), (0.85, 1.15)), wall_things.whiteboard),
    "wall_clock": Recipe(
        "clock", ((0.24, 0.36), (0.04, 0.06), (0.24, 0.36)), wall_things.wall_clock, adjust=wall_things.clock_size
    ),
}
