"""What the thesis reports, in points of AP, by table and by the name that our row has.

Source: Jain 2020, "Active Embodied Vision - Towards Self-Supervised Never Ending Learners", tables 5.1 to 5.4 and A.1
to A.3. Its worlds, detector and AP are others than ours: what compares are differences and shares of gaps, not figures.
"""

from collections.abc import Mapping

ROOM_CATEGORIES = ("bed", "chair", "couch", "table", "plant", "fridge", "toilet", "tv")
NOVEL_CATEGORIES = ("cushion", "nightstand", "shelf", "beanbag")
Figures = Mapping[str, tuple[float | None, ...]]
"""By figure (``ap50``, ``ap30``): one of each category."""

MEANS: dict[str, dict[str, dict[str, float]]] = {
    "table_5_1": {
        "pre-trained": {"ap50": 68.23, "ap30": 75.55},
        "pre-trained, training towns": {"ap50": 68.05, "ap30": 73.09},
        "SbM labels, training towns": {"ap50": 75.94, "ap30": 85.62},
        "SbM labels, test town": {"ap50": 76.14, "ap30": 85.78},
        "SbM fine-tuned": {"ap50": 78.59, "ap30": 86.33},
        "GT fine-tuned": {"ap50": 93.76, "ap30": 94.71},
    },
    "table_5_2": {
        "pre-trained": {"ap50": 11.58, "ap30": 15.93},
        "SbM labels": {"ap50": 17.73, "ap30": 25.53},
        "SbM-ws labels": {"ap50": 42.15, "ap30": 61.99},
    },
    "table_5_3": {
        "pre-trained": {"ap50": 19.71, "ap30": 22.65},
        "SbM fine-tuned": {"ap50": 24.34, "ap30": 32.60},
        "GT fine-tuned": {"ap50": 56.70, "ap30": 59.46},
    },
    "table_5_4": {
        "SbM labels": {"ap50": 17.73, "ap30": 25.53},
        "SbM labels of the fine-tuned detector": {"ap50": 18.85, "ap30": 31.53},
    },
    "table_a_1": {
        "pre-trained": {"ap50": 19.71, "ap30": 22.65},
        "SbM without consistency": {"ap50": 24.34, "ap30": 32.60},
        "SbM with consistency": {"ap50": 22.47, "ap30": 25.35},
    },
    "table_a_2": {"SbM-ws labels": {"ap50": 58.93, "ap30": 73.64}},
    "table_a_3": {
        "SbM-ws labels": {"ap50": 83.74, "ap30": 91.58},
        "SbM trained": {"ap50": 93.62, "ap30": 94.23},
        "trained on the annotated views alone": {"ap50": 87.24, "ap30": 87.24},
    },
}
"""Over all categories; ``table_a_3`` has cushions alone."""

_ = None
PER_CLASS: dict[str, dict[str, Figures]] = {
    "table_5_2": {
        "pre-trained": {
            "ap50": (3.13, 12.48, 22.81, 0.14, 13.18, 8.37, 1.45, 30.43),
            "ap30": (12.79, 14.06, 23.22, 0.16, 35.57, 8.37, 2.38, 30.86),
        },
        "SbM labels": {
            "ap50": (7.03, 22.65, 34.15, 0.14, 16.26, 26.49, 3.72, 31.39),
            "ap30": (19.39, 33.03, 36.74, 0.14, 38.20, 30.97, 7.18, 38.57),
        },
        "SbM-ws labels": {
            "ap50": (29.82, 46.91, 51.54, 29.65, 52.15, 32.85, 42.18, 52.10),
            "ap30": (52.21, 67.46, 75.76, 46.69, 68.58, 56.23, 62.53, 69.51),
        },
    },
    "table_5_3": {
        "pre-trained": {
            "ap50": (_, 11.87, 30.44, 0.76, 33.07, 0.50, _, 41.60),
            "ap30": (_, 15.61, 40.59, 0.76, 36.86, 0.50, _, 41.60),
        },
        "SbM fine-tuned": {
            "ap50": (_, 25.81, 26.33, 5.59, 44.47, 0.00, _, 43.82),
            "ap30": (_, 20.48, 36.99, 5.59, 64.55, 0.00, _, 57.99),
        },
        "GT fine-tuned": {
            "ap50": (_, 57.86, 53.47, 5.31, 89.92, 46.46, _, 87.20),
            "ap30": (_, 62.22, 57.09, 5.31, 93.48, 50.28, _, 88.38),
        },
    },
    "table_5_4": {
        "SbM labels": {
            "ap50": (7.03, 22.65, 34.15, 0.14, 16.26, 26.49, 3.72, 31.39),
            "ap30": (19.39, 33.03, 36.74, 0.14, 38.20, 30.97, 7.18, 38.57),
        },
        "SbM labels of the fine-tuned detector": {
            "ap50": (9.12, 25.10, 42.20, 0.01, 11.75, 21.84, 0.27, 40.47),
            "ap30": (36.08, 38.83, 54.56, 0.01, 38.74, 26.03, 0.47, 57.50),
        },
    },
    "table_a_1": {
        "SbM with consistency": {
            "ap50": (_, 4.78, 40.10, 1.08, 69.68, 0.00, _, 19.20),
            "ap30": (_, 7.21, 46.91, 1.08, 69.68, 0.00, _, 27.22),
        },
    },
    "table_a_2": {
        "SbM-ws labels": {"ap50": (66.92, 49.36, 43.72, 75.74), "ap30": (75.68, 65.16, 65.82, 87.90)},
    },
}
"""By category, in the order of ``ROOM_CATEGORIES`` or, for ``table_a_2``, of ``NOVEL_CATEGORIES``; None where it says
nothing."""

BOXES_3D = {"LDLS": 44.03, "SbM F-PointNet": 64.39, "supervised F-PointNet": 85.06}
"""AP of 3-D boxes at .25, streets. Source: table 5.5."""


def of_category(table: str, row: str, figure: str, category: str) -> float | None:
    """What the thesis reports of one category, if anything."""
    names = NOVEL_CATEGORIES if table == "table_a_2" else ROOM_CATEGORIES
    values = PER_CLASS.get(table, {}).get(row, {}).get(figure)
    return None if values is None or category not in names else values[names.index(category)]
