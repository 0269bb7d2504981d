"""Which catalogue entries show which class of object: lists made by eye, on contact sheets of the libraries.

A model that is in no list is not used. A use says what a piece is for when a room is furnished; several uses make up
a category, the class that detectors and labels know. Uses without a category are furnishings that no label names.
"""

from dataclasses import dataclass

_BLEND0, _BLEND_BY, _KATOR, _SCOPIA = "Blend Swap CC-0#", "Blend Swap CC-BY#", "Kator Legaz#", "Scopia#"

COCO_CATEGORIES = ("chair", "couch", "plant", "tv", "fridge", "bed", "table", "toilet")
"""The eight classes shared by COCO and Replica. Source: thesis section 5.1."""
OUTDOOR_CATEGORIES = ("car", "truck", "bus", "motorcycle", "bicycle")
"""The vehicle classes of COCO that move on roads. Source: thesis section 5.1.2."""
NOVEL_CATEGORIES = ("cushion", "nightstand", "shelf", "beanbag")
"""Classes that COCO does not have. Source: thesis section A.6."""


MAX_TRIANGLES = 46_000
"""Models with more triangles are left out for now; nothing is thinned, so legs, slats and leaves stay as drawn.

Trees have more: they are thinned leaf by leaf (sbm_gym.assets.catalog.foliage)."""
THINNED = {"street_tree": 8_000, "park_tree": 8_000}
"""Uses whose models are thinned when they are converted, and to how many triangles."""


@dataclass(frozen=True)
class Use:
    """What a list of models is for."""

    category: str | None
    """The class of its objects, None for furnishings without one."""
    models: tuple[str, ...]


def _ids(*groups: tuple[str, str]) -> tuple[str, ...]:
    return tuple(prefix + name for prefix, names in groups for name in names.split())


USES: dict[str, Use] = {
    "dining_chair": Use(
        "chair",
        _ids(
            (
                _BLEND0,
                "plasticChair chair chairWithCushion chair2 osakaChair antiqueChair sillaBlanca designChair thonet",
            ),
            (_BLEND_BY, "cafe_set_mota_chair cafe_set_tonon_chair chairWithCushion ella_chair_f plaidChair"),
            (_BLEND_BY, "kitchenChair chair3 chair4"),
            (_KATOR, "dining-chair"),
            (_SCOPIA, "chair3 chair4 chair tubular_chair white_kitchen_chair plastic_chair modern_armchair"),
        ),
    ),
    "office_chair": Use(
        "chair", _ids((_BLEND0, "armchair"), (_KATOR, "office-chair"), (_SCOPIA, "office_chair kids_desk_chair"))
    ),
    "lounge_chair": Use(
        "chair",
        _ids(
            (_BLEND0, "armchair2 modernArmchair winchesterArmchair"),
            (_BLEND_BY, "armchair1 fotel leaf_chair armChair2"),
            (_KATOR, "mid-century-chair"),
            (_SCOPIA, "armchair armchair1 armchair2 armchair3"),
        ),
    ),
    "couch": Use(
        "couch",
        _ids(
            (_BLEND0, "couch couch2 sofa sofa2 winchesterSofa"),
            (_BLEND_BY, "sofa2 couch3 sofa3 cornerSofa"),
            (_KATOR, "futon-couch mid-century-sofa mid-century-bench-sofa"),
            (_SCOPIA, "beige_sofa beige_sofa_2seats burlap_sofa clear_sofa leather_sofa simple_sofa sofa_white_beige"),
            (_SCOPIA, "convertible-sofa-BZ-closed"),
        ),
    ),
    "floor_plant": Use(
        "plant",
        _ids(
            (_BLEND0, "plant"), (_BLEND_BY, "decorativePlant mediumIndoorPlant yuccaPlant"), (_SCOPIA, "ficus maceta")
        ),
    ),
    "small_plant": Use(
        "plant", _ids((_BLEND0, "augalas littlePlant orchids"), (_BLEND_BY, "luckyBamboo"), (_SCOPIA, "bonsai-tree"))
    ),
    "tv": Use("tv", _ids((_BLEND0, "led_tv"), (_SCOPIA, "tv"))),
    "wall_tv": Use("tv", _ids((_SCOPIA, "wall-flat-tv"))),
    "fridge": Use("fridge", _ids((_BLEND0, "largeFridge refrigerator"), (_KATOR, "fridge"))),
    "double_bed": Use("bed", _ids((_BLEND0, "bed1 bed2 bed3 bedWithTexture"), (_SCOPIA, "bed1 iron_bed"))),
    "single_bed": Use("bed", _ids((_BLEND_BY, "juniorBed"), (_SCOPIA, "captains-bed children_bed"))),
    "dining_table": Use(
        "table",
        _ids(
            (_BLEND0, "oakTable table tableWithTablecloth"),
            (_BLEND_BY, "cafe_set_mota_table cafe_set_tonon_table table"),
            (_KATOR, "folding-table glass-dining-table"),
            (_SCOPIA, "black_table table4 white_kitchen_table wooden_table_office round-table table-with-leaning-feet"),
        ),
    ),
    "coffee_table": Use(
        "table",
        _ids((_BLEND_BY, "coffeeTable"), (_SCOPIA, "saloon_table table_wood_and_iron coffee-table2 living_room_table")),
    ),
    "desk": Use(
        "table",
        _ids(
            (_BLEND0, "lbDesk"),
            (_BLEND_BY, "biurko3 simpleDesk"),
            (_SCOPIA, "kids_desk_table kids_wooden_desk wooden_office_alder_table wooden_office_pear_table_rect"),
            (_SCOPIA, "table-on-trestles"),
        ),
    ),
    "toilet": Use("toilet", _ids((_BLEND0, "toiletsUnit"), (_BLEND_BY, "modernToilet toilets_unit_jay_hardy"))),
    "nightstand": Use("nightstand", _ids((_BLEND0, "bedsideTable2"), (_BLEND_BY, "bedsideTable"))),
    "shelf": Use(
        "shelf",
        _ids(
            (_BLEND0, "bookcase shelves verticalShelves"),
            (_BLEND_BY, "bookcase"),
            (_KATOR, "full-bookcase utility-shelving"),
            (_SCOPIA, "kids_shelves"),
        ),
    ),
    "beanbag": Use("beanbag", _ids((_SCOPIA, "puff"))),
    # No library has cushions: they are made from seeds, see builtin.py.
    "cushion": Use("cushion", ()),
    "leaning_cushion": Use("cushion", ()),
    # Furnishings without a class ----------------------------------------------------------------------------------
    "cupboard": Use(
        None,
        _ids((_BLEND0, "wardrobeWithSlidingDoors cupboard"), (_BLEND_BY, "wardrobe wardrobe2"), (_SCOPIA, "wardrobe1")),
    ),
    "dresser": Use(None, _ids((_BLEND_BY, "chest dresserWithDrawers"))),
    "tv_stand": Use(None, _ids((_BLEND_BY, "tvStand"))),
    "office_cabinet": Use(None, _ids((_KATOR, "filing-cabinet"), (_SCOPIA, "water_cooler"))),
    "kitchen_unit": Use(
        None,
        _ids(
            (_BLEND0, "lowerCabinet drawersCabinet"),
            (_BLEND_BY, "kitchenLowerCabinet kitchenDrawersCabinet kitchenSmallLowerCabinet"),
        ),
    ),
    "kitchen_sink": Use(None, _ids((_BLEND0, "sinkCabinet"), (_BLEND_BY, "kitchenSink"))),
    "wall_cabinet": Use(
        None,
        _ids(
            (_BLEND0, "upperCabinet glassDoorCabinet smallUpperCabinet"),
            (_BLEND_BY, "kitchenUpperCabinet kitchenSmallUpperCabinet kitchenGlassDoorCabinet"),
        ),
    ),
    # Cookers of the libraries have as many triangles as a whole kitchen.
    "cooker": Use(None, ()),
    "cooker_hood": Use(None, _ids((_BLEND0, "rangeHood"))),
    "washing_machine": Use(None, _ids((_SCOPIA, "clothes_washing_machine dryer_machine"))),
    "worktop_thing": Use(
        None, _ids((_BLEND_BY, "boiler breadBox utensilsPot"), (_SCOPIA, "toaster coffee_machine paperTowelHolder"))
    ),
    "washbasin": Use(
        None, _ids((_BLEND0, "modernVanity"), (_BLEND_BY, "washbasin_jay_hardy"), (_SCOPIA, "bathroom_vanity"))
    ),
    "bathtub": Use(None, _ids((_SCOPIA, "islandBath"))),
    "shower": Use(None, ()),
    "mirror": Use(None, ()),
    "towel_rail": Use(None, _ids((_BLEND0, "towel3"))),
    "bath_mat": Use(None, _ids((_KATOR, "bathmat"))),
    "coat_rack": Use(None, ()),
    "whiteboard": Use(None, ()),
    "wall_clock": Use(None, ()),
    "floor_lamp": Use(None, _ids((_SCOPIA, "living_lamp"))),
    "table_lamp": Use(
        None,
        _ids(
            (_BLEND0, "desklamp"),
            (_BLEND_BY, "lamp"),
            (_KATOR, "pedestal-vase-lamp"),
            (_SCOPIA, "little_lamp1 little_lamp2 table_lamp livingroom_lamp1"),
        ),
    ),
    "desk_lamp": Use(None, _ids((_SCOPIA, "desk_lamp1 desk_lamp2"))),
    "hanging_lamp": Use(None, _ids((_BLEND_BY, "hangingLight"), (_KATOR, "hanging-restaurant-light"))),
    "rug": Use(None, _ids((_KATOR, "oriental-rug"))),
    "radiator": Use(None, _ids((_BLEND0, "radiator"), (_BLEND_BY, "modernRadiator"))),
    "bin": Use(None, _ids((_BLEND0, "dustbin"), (_KATOR, "bullet-trash-can"), (_SCOPIA, "clothes-basket"))),
    "table_thing": Use(
        None, _ids((_KATOR, "red-wine-bottle-01 bowl"), (_SCOPIA, "bowl vase1 jar"), (_BLEND0, "bread"))
    ),
    "desk_thing": Use(None, _ids((_BLEND_BY, "laptop"), (_SCOPIA, "phone penbox"))),
    # Towns --------------------------------------------------------------------------------------------------------
    "car": Use(
        "car",
        _ids(
            (_SCOPIA, "seat_leon suv chevrolet renault-scenic peugeot-308 smart-car"),
            (_KATOR, "VW-new-beetle concept-sedan-01v1 concept-sedan-01v2"),
        ),
    ),
    # COCO calls cargo vans trucks more often than cars.
    "van": Use("truck", _ids((_SCOPIA, "van"))),
    "truck": Use("truck", _ids((_SCOPIA, "truck"), (_BLEND_BY, "dafTruck"))),
    "bus": Use("bus", _ids((_SCOPIA, "cityBus bus"))),
    "motorcycle": Use("motorcycle", _ids((_SCOPIA, "yamaha-yzr-r6 scooter2"), (_KATOR, "scooter"))),
    "bicycle": Use("bicycle", _ids((_SCOPIA, "bicycle"), (_BLEND_BY, "bike"))),
    "street_tree": Use(None, _ids((_SCOPIA, "ficusTree sycamoreMaple copperBeech pine japaneseMaple"))),
    "park_tree": Use(None, _ids((_SCOPIA, "palm peachBlossom"))),
    "street_light": Use(None, _ids((_SCOPIA, "candelabre"), (_KATOR, "classic-lamppost"))),
    "bench": Use(None, _ids((_KATOR, "painted-bench"), (_BLEND0, "bench"), (_SCOPIA, "littlebank"))),
    "litter_bin": Use(None, _ids((_KATOR, "park-trashcan"))),
    "traffic_cone": Use(None, _ids((_SCOPIA, "cone"))),
    "cafe_table": Use(None, _ids((_KATOR, "cafe-table"))),
    "cafe_chair": Use(None, _ids((_KATOR, "cafe-chair"))),
    "parasol": Use(None, _ids((_BLEND0, "umbrella"))),
    "fountain": Use(None, _ids((_BLEND_BY, "fountain"))),
}
"""Every use with its models."""

QUARTER_TURNS: dict[str, int] = {}
"""Models that do not face the front in their library: turns of 90 degrees, counter-clockwise from above."""

VEHICLE_PAINT: dict[str, tuple[float, float, float]] = {
    "Scopia#seat_leon": (0.537, 0.192, 0.24),
    "Scopia#suv": (0.431, 0.431, 0.431),
    "Scopia#chevrolet": (0.8, 0.0, 0.0),
    "Scopia#peugeot-308": (0.8, 0.8, 0.8),
    "Kator Legaz#VW-new-beetle": (0.8, 0.68, 0.0),
    "Kator Legaz#concept-sedan-01v1": (0.8, 0.0, 0.0),
    "Kator Legaz#concept-sedan-01v2": (0.8, 0.0, 0.0),
    "Scopia#van": (0.64, 0.64, 0.64),
    "Scopia#truck": (0.474, 0.027, 0.027),
    "Scopia#cityBus": (0.017, 0.41, 0.48),
    "Scopia#bus": (0.718, 0.718, 0.718),
    "Scopia#scooter2": (0.118, 0.111, 0.437),
    "Kator Legaz#scooter": (0.64, 0.64, 0.0),
    "Blend Swap CC-BY#bike": (0.3, 0.6, 0.8),
}
"""Display colour of a vehicle model's paint, where it has a plain one: such parts are painted anew for each vehicle."""

EXCLUDED: dict[str, str] = {
    **dict.fromkeys(
        _ids((_KATOR, "concept-sedan-02 concept-sedan-02-sport"), (_BLEND0, "peterbilt")),
        "more than 100 000 triangles, and towns have other vehicles of its kind",
    ),
    _BLEND_BY + "fordFocus": "more triangles than MAX_TRIANGLES",
    _BLEND0 + "forkLift": "not a class of COCO",
    _BLEND0 + "motorbike": "a spring rider of a playground",
    **dict.fromkeys(
        _ids((_SCOPIA, "poplar cypress acacia hedgeTextured bush high-hedge hedge")),
        "more triangles than a street can have of it, and not made of leaves that could be thinned",
    ),
    _KATOR + "fire-hydrant": "as heavy as ten cars, and easily made of prisms",
    _SCOPIA + "scooter": "a kick scooter, not a class of COCO",
    **dict.fromkeys(
        _ids((_BLEND0, "decorativePlant"), (_BLEND_BY, "lettoCloud spider_plant spatifilum bath_jay_hardy")),
        "more triangles than MAX_TRIANGLES",
    ),
    **dict.fromkeys(
        _ids((_BLEND_BY, "white_lily tulip tulips"), (_SCOPIA, "calla_lily_with_roses")),
        "cut flowers in a vase: COCO calls that a vase",
    ),
    **dict.fromkeys(
        _ids((_SCOPIA, "tv-remote-control apple_pc"), (_KATOR, "apple-imac-1998")),
        "a screen that COCO would call a tv, joined with other things",
    ),
    **dict.fromkeys(
        _ids((_SCOPIA, "crib hospital-bed mezzanine-bed day_bed_frame futon"), (_BLEND_BY, "bunkBed")),
        "a bed that people would argue about",
    ),
    _BLEND_BY + "officeTable": "its table top has two faces in one plane, which flicker",
    **dict.fromkeys(_ids((_KATOR, "chair-ottoman")), "two objects in one model"),
    **dict.fromkeys(_ids((_SCOPIA, "coffee_table")), "its glass top is hardly visible: a table without a table top"),
}
"""Models that would fit a use but are left out, with the reason."""


def categories() -> tuple[str, ...]:
    """All classes that the libraries can show."""
    return COCO_CATEGORIES + NOVEL_CATEGORIES + OUTDOOR_CATEGORIES
