"""The page of the thesis' tables in our worlds."""

from collections.abc import Mapping, Sequence
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from experiments.cache.episode_pool import BEGUN_AGAIN
from experiments.cache.worlds import WORLDS
from experiments.figures.result_values import (
    LOOP_GAP,
    MEANS,
    gap_interval,
    gap_share,
    gap_shares,
    loop_error_counts,
    loop_errors,
    loop_table,
    loop_values,
    of_category,
    share_interval,
    thesis_gap_share,
    values,
)
from experiments.pages.boxes import MASK_SOURCES, boxes_section
from experiments.pages.fine_tuning import error_rows
from experiments.pages.markdown import Pictures, mean_std, plural, points, read_result, render, table
from experiments.pages.origin import origins
from experiments.pages.summary import summary_table
from labeling.core.errors import SbmError
from sbm_gym.worlds.splits import ENDLESS

PAGE = "results.md"
TITLES = {
    "table_5_1": "Table 5.1: detectors in unseen streets",
    "table_5_1_wide": "Table 5.1 in more towns",
    "table_5_1_final": "Table 5.1 in towns set aside for the end",
    "table_5_1_new_models": "Table 5.1 with vehicles that no training town shows",
    "table_5_2": "Table 5.2: labels in rooms",
    "table_5_3": "Table 5.3: detectors in unseen rooms",
    "table_5_3_wide": "Table 5.3 in more homes",
    "table_5_3_pooled": "Table 5.3 in all these homes",
    "table_5_3_final": "Table 5.3 in homes set aside for the end",
    "table_5_3_command": "Table 5.3 as `labeling.finetune` fine-tunes without options",
    "table_5_3_doubts": "Table 5.3 where doubts are ignored, and where they are background",
    "table_5_3_unfitted": "Table 5.3 without anything fitted to ground truth",
    "table_5_3_new_models": "Table 5.3 with furniture that no training home shows",
    "table_5_4": "Table 5.4: labels of the fine-tuned detector",
    "table_a_1": "Table A.1: the consistency filter",
    "table_a_2": "Table A.2: labels of novel categories",
    "table_a_3": "Table A.3: detectors of novel categories",
    "table_a_3_homes": "Table A.3, every episode in a home of its own",
    "label_modes": "Presets of the label generator, and what they teach",
    "never_ending_parts": "What the loop gains by going round, and by new homes",
}
LOOPS = {
    "never_ending": "The never-ending loop: rooms",
    "never_ending_again": "The never-ending loop, in the same homes again",
    "never_ending_streets": "The never-ending loop: streets",
}
BOXES = {
    "table_5_5": "Table 5.5: boxes in three dimensions",
    "table_5_5_rooms": "Table 5.5 in rooms",
}
PRESETS = "rooms: labels of each preset, and detectors fine-tuned on them, in 40 unseen interiors"
FEW_INSTANCES = 10
"""Figures of a category with fewer instances say little. Source: thesis 5.1."""
LABEL_COLUMNS = (("labels", "detector", "mask_ap50"), ("labels", "pseudo_labels", "mask_ap50"))
"""Where the figures of the views and labels of a round stand in its record."""
DETECTOR_COLUMNS = (
    ("test", "mask_ap50"),
    ("test", "box_ap50"),
    ("test", "own_box_ap50"),
    ("ceiling", "mask_ap50"),
    ("ceiling", "box_ap50"),
    ("ceiling", "own_box_ap50"),
    ("test", "photographs_ap50"),
)
"""Where those of the detectors after it stand."""
OTHER_SHARES = {
    "ap30": "AP30 of masks",
    "ap": "COCO's AP of masks",
    "box_ap50": "AP50 of boxes",
    "box_ap30": "AP30 of boxes",
    "box_ap": "COCO's AP of boxes",
    "own_box_ap50": "AP50 of boxes as detectors give them",
    "own_box_ap": "COCO's AP of these",
}
"""Figures whose share of the gap stands beside that in AP50 of masks."""
LABEL_NAMES = {"sbm": "SbM labels", "shared": "shared SbM labels"}
"""What the detector of pictures before and after was fine-tuned on."""
SUBSETS = {
    "learn": ("training scenes", "to learn from"),
    "choose": ("training scenes", "to choose the best network by"),
    "dev": ("dev scenes", "of unseen scenes that decisions are made in"),
    "test": ("unseen test scenes", "of unseen scenes to test on"),
    "wide": ("more unseen scenes", "of more unseen scenes to test on"),
    "pooled": ("unseen test scenes and more", "of unseen test scenes and of more"),
    "final": ("scenes set aside", "of scenes to test on that were set aside for the end"),
}
"""Where the views of a subset of episodes are, and what it is for."""
Contents = Mapping[str, Mapping[str, Any]]


def compose(results: Path) -> tuple[str, Pictures]:
    """The page and its pictures, from the results of some of the tables."""
    from experiments.figures.results import draw_boxes_3d, draw_categories, draw_loop

    contents, pictures = read_results(results), {}
    for name, content in contents.items():
        if name in BOXES:
            pictures[picture_name(name)] = partial(draw_boxes_3d, content, MASK_SOURCES)
        elif name in LOOPS:
            pictures[picture_name(name)] = partial(draw_loop, content)
        elif name in TITLES:
            pictures[picture_name(name)] = partial(draw_categories, content, categories_of(content))
    return page(contents), pictures


def read_results(results: Path) -> dict[str, dict[str, Any]]:
    """The contents of the files that are there, by name: tables, loops, and records of pictures.

    Raises:
        SbmError: if there are no tables and no loops, or a file is damaged.
    """
    files = [*TITLES, *LOOPS, *BOXES]
    pictures = [f"{kind}_{world}" for kind in ("before_after", "boxes") for world in WORLDS]
    read = {name: read_result(results / f"{name}.json") for name in (*files, *pictures)}
    found = {name: content for name, content in read.items() if content is not None}
    presets = found.pop("label_modes", {})
    if "taught" in presets:
        found["label_modes"] = {**presets, "description": PRESETS, **presets["taught"]}
    if not any(name in found for name in files):
        raise SbmError(f"{results}: no figures of any table; python -m experiments.run table_5_3 makes some")
    return found


def picture_name(table: str) -> str:
    """File name of a table's picture."""
    return f"results_{table}.png"


def page(contents: Contents) -> str:
    """The text of the page.

    Args:
        contents: of the results, by name.
    """
    from experiments.figures.before_after import CONFIDENT, MIN_IOU

    pictured = [world for world in WORLDS if f"boxes_{world}" in contents]
    made = origins(contents)
    before_after = {world: contents.get(f"before_after_{world}") for world in WORLDS}
    return render(
        "results.md.jinja",
        made=made,
        summary=summary_table(contents),
        tables={name: _section(name, title, contents, table_section) for name, title in TITLES.items()},
        boxes={name: _boxes(name, title, contents, pictured) for name, title in BOXES.items()},
        before_after={world: record for world, record in before_after.items() if record},
        loops={name: _section(name, title, contents, loop_section) for name, title in LOOPS.items()},
        label_names=LABEL_NAMES,
        confident=CONFIDENT,
        min_iou=MIN_IOU,
        few_instances=FEW_INSTANCES,
    )


def _section(name: str, title: str, contents: Contents, section: Any) -> dict[str, Any]:
    content = contents.get(name)
    found = {} if content is None else {**section(name, content), "picture": picture_name(name)}
    return {"title": title, "content": content, **found}


def _boxes(name: str, title: str, contents: Contents, pictured: Sequence[str]) -> dict[str, Any]:
    content = contents.get(name)
    found = {} if content is None else {**boxes_section(content, pictured), "picture": picture_name(name)}
    return {"title": title, "content": content, **found}


def _again(pool: Mapping[str, Any]) -> str:
    """How many episodes were begun again elsewhere, where results tell."""
    count = pool.get(BEGUN_AGAIN)
    return "" if not count else f" ({count} of them begun again elsewhere, as the detector was sure of nothing)"


# Tables --------------------------------------------------------------------------------------------------------------


def table_section(name: str, content: Mapping[str, Any]) -> dict[str, Any]:
    """One table: means, the gap that is closed, and categories."""
    pools = content["pools"].items()
    return {
        "episodes": [f"{plural(pool['episodes'], 'episode')} {SUBSETS[part][1]}{_again(pool)}" for part, pool in pools],
        "fine_tuned": any(row["teacher"] is not None for row in content["rows"]),
        "means": _means(name, content),
        "has_boxes": _has_boxes(content),
        "has_coco_ap": _has_coco_ap(content),
        "has_own_boxes": _has_own_boxes(content),
        "gaps": [one for gap in content["gaps"] if (one := _gap(name, content, gap))],
        "above": [compare_categories(content, *pair) for pair in content.get("above", ())],
        "photographs": _on_photographs(content),
        "categories": _categories_table(name, content, "ap50"),
        "box_categories": _categories_table(name, content, "box_ap50") if _has_boxes_by_category(content) else None,
    }


def _means(name: str, content: Mapping[str, Any]) -> list[list[str]]:
    rows = []
    for row in content["rows"]:
        thesis = MEANS.get(name, {}).get(row["name"], {})
        cells = [row["name"], _where(content, row["part"])]
        for figure in ("ap50", "ap30"):
            cells += [mean_std(values(row, figure)), f"{thesis[figure]:.1f}" if figure in thesis else "-"]
        if _has_boxes(content):
            cells += [mean_std(values(row, figure)) for figure in ("box_ap50", "box_ap30")]
        if _has_coco_ap(content):
            cells += [mean_std(values(row, figure)) for figure in ("ap", "box_ap")]
        if _has_own_boxes(content):
            cells += [mean_std(values(row, figure)) for figure in ("own_box_ap50", "own_box_ap")]
        rows.append(cells)
    return rows


def _where(content: Mapping[str, Any], part: str) -> str:
    """Where the views of a row are."""
    is_endless = content["pools"].get(part, {}).get("split") == ENDLESS
    return "endless scenes that are learnt from" if is_endless and part != "dev" else SUBSETS[part][0]


def _on_photographs(content: Mapping[str, Any]) -> list[str]:
    """AP50 of each detector on photographs held out, told once; nothing where none is fine-tuned."""
    found: dict[str | None, str] = {}
    for row in content["rows"]:
        known = [100.0 * run["photographs_ap50"] for run in row["runs"] if run.get("photographs_ap50") is not None]
        if known and row["labels"] is None:
            found.setdefault(row["teacher"], f"{row['name']} {mean_std(known)}")
    return list(found.values()) if any(row["teacher"] is not None for row in content["rows"]) else []


def _has_boxes(content: Mapping[str, Any]) -> bool:
    """Whether a table tells AP of boxes; some of before do not."""
    return any(values(row, "box_ap50") for row in content["rows"])


def _has_boxes_by_category(content: Mapping[str, Any]) -> bool:
    """Whether AP of boxes is told of each category; tables of before have its mean only."""
    return all(run.get("per_class_box_ap50") for row in content["rows"] for run in row["runs"])


def _has_coco_ap(content: Mapping[str, Any]) -> bool:
    """Whether a table tells COCO's AP of its detectors; those of before do not."""
    return any(values(row, "ap") for row in content["rows"])


def _has_own_boxes(content: Mapping[str, Any]) -> bool:
    """Whether a table tells AP of boxes as detectors give them; those of before have boxes around masks alone."""
    return any(values(row, "own_box_ap50") for row in content["rows"])


def _gap(name: str, content: Mapping[str, Any], gap: Sequence[str]) -> dict[str, Any] | None:
    """What self-supervision closes of a gap to ground truth, or that none is shown; None where there is none."""
    share, width = gap_share(content, gap), gap_interval(content, gap)
    if share is None and width is None:
        return None
    by_seed = ["no gap" if one is None else f"{one:.2f}" for one in gap_shares(content, gap)]
    names = dict(zip(("before", "ours", "ceiling"), gap, strict=True))
    others = {called: gap_share(content, gap, figure) for figure, called in OTHER_SHARES.items()}
    known = {
        called: f"{others[called]:.2f}{_between(share_interval(content, gap, figure))}"
        for figure, called in OTHER_SHARES.items()
        if others[called] is not None
    }
    return {
        **names,
        "share": share,
        "between": _between(share_interval(content, gap)),
        "width": None if width is None else "[{:.1f}, {:.1f}]".format(*width),
        "thesis": thesis_gap_share(name, gap),
        "by_seed": by_seed,
        "others": known,
    }


def _between(interval: tuple[float, float] | None) -> str:
    return "" if interval is None else " [{:.2f}, {:.2f}]".format(*interval)


def compare_categories(content: Mapping[str, Any], higher: str, lower: str) -> dict[str, Any]:
    """On which categories with enough instances one row is not above another, by means over seeds."""
    rows = {row["name"]: row for row in content["rows"]}
    counted = [name for name in categories_of(content) if _instances(rows[higher], name) >= FEW_INSTANCES]
    not_above = []
    for name in counted:
        ours, theirs = (values(rows[row], "ap50", name) for row in (higher, lower))
        if not ours or not theirs or np.mean(ours) <= np.mean(theirs):
            not_above.append(name)
    return {"higher": higher, "lower": lower, "counted": len(counted), "not_above": not_above}


def categories_of(content: Mapping[str, Any]) -> list[str]:
    """Categories of which there is at least one instance somewhere, in alphabetical order."""
    return sorted({name for row in content["rows"] for name in row["runs"][0]["instances"] if _instances(row, name)})


def _instances(row: Mapping[str, Any], category: str) -> int:
    return int(row["runs"][0]["instances"].get(category) or 0)


def _categories_table(name: str, content: Mapping[str, Any], figure: str) -> str:
    headings, categories = [""], categories_of(content)
    for category in categories:
        counts = dict.fromkeys(_instances(row, category) for row in content["rows"])
        headings.append(f"{category} ({'/'.join(map(str, counts))})")
    rows = []
    for row in content["rows"]:
        cells = [row["name"]]
        for category in categories:
            thesis = of_category(name, row["name"], figure, category)
            cells.append(mean_std(values(row, figure, category)) + ("" if thesis is None else f" [{thesis:.1f}]"))
        rows.append(cells)
    return table(headings, rows)


# Loops ---------------------------------------------------------------------------------------------------------------


def loop_section(name: str, content: Mapping[str, Any]) -> dict[str, Any]:
    """The never-ending loop, round by round."""
    before = content["before"]
    pretrained = (_points(before.get(place[-1])) for place in DETECTOR_COLUMNS)
    rows = [["0 (pre-trained)", *["-"] * (len(LABEL_COLUMNS) + 2), *pretrained, "-"]]
    for number in range(1, content["size"]["rounds"] + 1):
        labels, detectors = (
            [mean_std(loop_values(content, number, *place)) for place in places]
            for places in (LABEL_COLUMNS, DETECTOR_COLUMNS)
        )
        if any(cell != "-" for cell in (*labels, *detectors)):
            errors = map(mean_std, loop_errors(content, number))
            rows.append([str(number), *labels, *errors, *detectors, _shares_of(loop_table(content, number))])
    last = loop_table(content)
    gap = None if last is None else _gap(name, last, LOOP_GAP)
    errors = error_rows(loop_error_counts(content))
    return {"rounds": rows, "errors": errors, "trend": loop_trend(content), "gap": gap}


def _shares_of(of_round: Mapping[str, Any] | None) -> str:
    """Of the gap of a round, in masks, boxes around them, and boxes as the detector gives them."""
    if of_round is None:
        return "-"
    found = [gap_share(of_round, LOOP_GAP, figure) for figure in ("ap50", "box_ap50", "own_box_ap50")]
    return " / ".join("-" if one is None else f"{one:.2f}" for one in found)


def _points(value: float | None) -> str:
    return "-" if value is None else points(value)


def loop_trend(content: Mapping[str, Any]) -> dict[str, float] | None:
    """Whether the detector rises from round to round, by means over the seeds that come so far; None before the second.

    Returns:
        In how many of how many rounds it rises, and points of AP50 in the end: on unseen scenes above where it stood
        after the first and before it, and on photographs above the pre-trained detector.
    """
    found = [loop_values(content, number, "test", "mask_ap50") for number in range(1, content["size"]["rounds"] + 1)]
    means = [100.0 * content["before"]["mask_ap50"], *(float(np.mean(one)) for one in found if one)]
    if len(means) < 3:
        return None
    photographs = np.mean(loop_values(content, len(means) - 1, "test", "photographs_ap50"))
    return {
        "rises": sum(after > before for before, after in pairwise(means)),
        "rounds": len(means) - 1,
        "from_first": means[-1] - means[1],
        "from_pretrained": means[-1] - means[0],
        "photographs": float(photographs) - 100.0 * content["before"]["photographs_ap50"],
    }
