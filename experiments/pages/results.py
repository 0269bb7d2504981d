"""The page of the thesis' tables in our worlds."""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from experiments.cache.worlds import WORLDS
from experiments.figures.result_values import gap_share, gap_shares, loop_values, thesis_gap_share, values
from experiments.figures.thesis_values import MEANS, of_category
from experiments.pages import boxes_section
from experiments.pages.label_report import SCALES
from labeling.core.errors import SbmError

TITLES = {
    "table_5_1": "Table 5.1: streets",
    "table_5_1_wide": "Table 5.1 in more towns",
    "table_5_2": "Table 5.2: labels in rooms",
    "table_5_3": "Table 5.3: detectors in unseen rooms",
    "table_5_3_wide": "Table 5.3 in more homes",
    "table_5_4": "Table 5.4: labels of the fine-tuned detector",
    "table_a_1": "Table A.1: the consistency filter",
    "table_a_2": "Table A.2: labels of novel categories",
    "table_a_3": "Table A.3: detectors of novel categories",
    "label_modes": "Presets of the label generator, and what they teach",
}


FEW_INSTANCES = 10
"""Figures of a category with fewer instances say little. Source: thesis 5.1."""


LOOPS = {
    "never_ending": "The never-ending loop: rooms",
    "never_ending_streets": "The never-ending loop: streets",
}


LOOP_FIGURES = (
    ("labels", "detector", "mask_ap50"),
    ("labels", "pseudo_labels", "mask_ap50"),
    ("test", "mask_ap50"),
    ("test", "mask_ap30"),
    ("test", "photographs_ap50"),
)
"""Where the columns of the loop's table stand in the record of a round."""


PAIR_LABELS = {"sbm": "SbM labels", "shared": "shared SbM labels"}
"""What taught the detector of pictures before and after."""


FIGURES = {"ap50": "AP50", "ap30": "AP30"}


SEEN_ON = {
    "learn": "training scenes",
    "choose": "training scenes",
    "test": "unseen test scenes",
    "wide": "more unseen scenes",
}


NOT_YET = "Has not been run yet; `python -m experiments.run {}` does it."


INTRODUCTION = (
    "# The thesis' tables, in our worlds\n\n"
    "Written by `python -m experiments.results_page` from `experiments/results/`; do not edit by hand. "
    "`python -m experiments.run NAME --scale quick --seeds 3` makes a table anew; `run list` names them all.\n\n"
    "AP of masks in points, ranked by confidence, mean over the categories that all rows of a table know; "
    "± is the standard deviation over seeds of "
    "label generation and training. Beside each figure stands the thesis' own: its worlds, its detector and its way of "
    "reckoning AP are others, so differences and shares of gaps compare, figures do not. Nobody has learnt from test "
    "scenes, nor from labels of them."
)


def write_page(results: Path, docs: Path) -> list[Path]:
    """Writes the page and its pictures.

    Args:
        results: folder with the results of some of the tables.
        docs: folder for the page.

    Returns:
        The files written.

    Raises:
        SbmError: if there are no figures at all.
    """
    from experiments.figures.results_drawing import draw_categories, draw_loop
    from labeling.io.formats.atomic import atomic_file

    contents = read_results(results)
    pairs, boxes = read_pairs(results), boxes_section.read_boxes(results)
    written = [docs / PAGE]
    if boxes is not None:
        with atomic_file(docs / PICTURES / boxes_section.PICTURE) as temporary:
            boxes_section.draw(boxes.content, temporary)
        written.append(docs / PICTURES / boxes_section.PICTURE)
    for name, content in contents.items():
        picture = docs / PICTURES / picture_name(name)
        with atomic_file(picture) as temporary:
            if name in LOOPS:
                draw_loop(content, temporary)
            else:
                draw_categories(content, categories_of(content), temporary)
        written.append(picture)
    with atomic_file(docs / PAGE) as temporary:
        temporary.write_text(page(contents, pairs, boxes), encoding="utf-8")
    return written


def read_results(results: Path) -> dict[str, dict[str, Any]]:
    """The contents of the files that are there, by table; those of loops too.

    Raises:
        SbmError: if there are none, or one is damaged.
    """
    from labeling.io.formats.checked_json import read_json

    files = {name: results / f"{name}.json" for name in (*TITLES, *LOOPS)}
    found = {name: dict(read_json(file).mapping()) for name, file in files.items() if file.is_file()}
    if MODES in found:
        modes = found.pop(MODES)
        if "taught" in modes:
            found[MODES] = {**modes, "description": TAUGHT, **modes["taught"]}
    if not found and not (results / "table_5_5.json").is_file():
        raise SbmError(f"{results}: no figures of any table; python -m experiments.run table_5_3 makes some")
    return found


def picture_name(table: str) -> str:
    """File name of a table's picture."""
    return f"results_{table}.png"


def read_pairs(results: Path) -> dict[str, dict[str, Any]]:
    """The records of pictures of views before and after, by world."""
    from experiments.figures.before_after import NAME
    from labeling.io.formats.checked_json import read_json

    files = {world: results / f"{NAME.format(world)}.json" for world in WORLDS}
    return {world: dict(read_json(file).mapping()) for world, file in files.items() if file.is_file()}


def page(
    contents: Mapping[str, Mapping[str, Any]],
    pairs: Mapping[str, Mapping[str, Any]] | None = None,
    boxes: boxes_section.Boxes | None = None,
) -> str:
    """The text of the page.

    Args:
        contents: of the results, by table.
        pairs: of the records of pictures, by world.
        boxes: of 3-D boxes.
    """
    parts = [INTRODUCTION]
    for name, title in TITLES.items():
        parts.append(f"## {title}")
        if name in contents:
            parts += section(name, contents[name])
        else:
            parts.append(NOT_YET.format(name))
    parts.append(f"## {boxes_section.TITLE}")
    if boxes is None:
        parts.append(NOT_YET.format(boxes_section.NAME))
    else:
        parts += boxes_section.boxes_section(boxes.content, boxes.views)
    for world, record in (pairs or {}).items():
        parts += pairs_section(world, record)
    for name, title in LOOPS.items():
        parts.append(f"## {title}")
        parts += loop_section(name, contents[name]) if name in contents else [NOT_YET.format(name)]
    return "\n\n".join(parts) + "\n"


def section(name: str, content: Mapping[str, Any]) -> list[str]:
    """One table: what it is about, means, the gap that is closed, and categories."""
    seeds = len(content["seeds"])
    description = content["description"][0].upper() + content["description"][1:]
    about = (
        f"{description}. Scale `{content['scale']}` ({SCALES[content['scale']]}), {seeds} "
        f"{'seed' if seeds == 1 else 'seeds'}; {_episodes(content['pools'])}."
    )
    if any(row["teacher"] is not None for row in content["rows"]):
        about += f" Fine-tuned on at most {_batches(content)}."
    parts = [about, _means_table(name, content)]
    parts += gap_sentences(name, content)
    parts += [above_sentence(content, higher, lower) for higher, lower in content.get("above", ())]
    categories = categories_of(content)
    parts += [
        f"![AP50 of each category]({PICTURES}/{picture_name(name)})",
        "AP50 by category, with how many instances; in brackets the thesis' figure:",
        _categories_table(name, content, categories),
    ]
    return parts


def gap_sentences(name: str, content: Mapping[str, Any]) -> list[str]:
    """What self-supervision closes of the gap to ground truth."""
    parts = []
    for gap in content["gaps"]:
        share, theirs = gap_share(content, gap), thesis_gap_share(name, gap)
        if share is None:
            continue
        before, ours, ceiling = gap
        by_seed = ", ".join("no gap" if one is None else f"{one:.2f}" for one in gap_shares(content, gap))
        parts.append(
            f"Share of the gap between {before} and {ceiling} that {ours} closes, AP50, of means over seeds: "
            f"**{share:.2f}**{'' if theirs is None else f' (thesis: {theirs:.2f})'}. By seed: {by_seed}."
        )
    return parts


def pairs_section(world: str, record: Mapping[str, Any]) -> list[str]:
    """Views before and after."""
    from experiments.figures.before_after import NAME, OVERLAP, SURE

    counts = record["all_views"]
    return [
        f"## Before and after: {world}",
        f"Detections with a confidence of {SURE} or more, of the pre-trained detector and of the one fine-tuned on "
        f"{PAIR_LABELS[record['labels']]} (seed {record['seed']}, scale `{record['scale']}`), in unseen scenes. In "
        f"brackets: objects found rightly (IoU of {OVERLAP} or more) minus false finds, after minus before. Shown are "
        "the views with the greatest gain, one of each episode, and the one with the greatest loss; of all views "
        f"{counts['gained']} gained, {counts['same']} stayed and {counts['lost']} lost. Colours are those of the "
        "objects that masks fit; grey ones fit none.",
        f"![Detections before and after]({PICTURES}/{NAME.format(world)}.png)",
    ]


def loop_section(name: str, content: Mapping[str, Any]) -> list[str]:
    """The never-ending loop, round by round."""
    size, seeds = content["size"], len(content["loops"])
    description = content["description"][0].upper() + content["description"][1:]
    about = (
        f"{description}. In each round the detector of the round before guides the policy `{content['policy']}` "
        f"through {size['learn']} episodes {_loop_lesson(content)}, in {_batches(content)}. Photographs are mixed in. "
        f"Scale `{content['scale']}` ({SCALES[content['scale']]}), {seeds} {'seed' if seeds == 1 else 'seeds'}; "
        f"{content['test']['episodes']} episodes of unseen scenes to test on."
    )
    headings = (
        "| round | pre-trained, in all views so far | labels of these views | detector after it, unseen scenes | AP30 "
        "| photographs |"
    )
    lines = [headings, "|---" * 6 + "|"]
    before = content["before"]
    cells = [f"{100 * before[name]:.1f}" for name in ("mask_ap50", "mask_ap30", "photographs_ap50")]
    lines.append(f"| 0 (pre-trained) | - | - | {' | '.join(cells)} |")
    for number in range(1, size["rounds"] + 1):
        cells = [_spread(found) for found in (loop_values(content, number, *place) for place in LOOP_FIGURES)]
        if any(cell != "-" for cell in cells):
            lines.append(f"| {number} | {' | '.join(cells)} |")
    stopped = [
        f"The loop of seed {loop['seed']} stopped itself: {loop['stopped']}."
        for loop in content["loops"]
        if loop["stopped"]
    ]
    return [
        about,
        f"![AP50 by round]({PICTURES}/{picture_name(name)})",
        "AP50 but for one column:",
        "\n".join(lines),
        *loop_sentences(content),
        *stopped,
    ]


def _batches(content: Mapping[str, Any]) -> str:
    """How much is learnt at a time."""
    train = content["settings"]["train"]
    return f"{train['iterations']} batches of {train['batch_size']} at a learning rate of {train['learning_rate']:g}"


def _loop_lesson(content: Mapping[str, Any]) -> str:
    """Where the rounds of a loop are, and what is learnt there."""
    repeated = content["episodes_per_scene"]
    where = (
        f"in homes it has not been in, {repeated} in each" if content["split"] == "endless" else "of training scenes"
    )
    return (
        f"{where}; labels are made of what the pre-trained detector finds in the views, and shared by the episodes of "
        "a scene; the detector of the round before then goes on to learn, from the labels of all rounds so far"
    )


def loop_sentences(content: Mapping[str, Any]) -> list[str]:
    """Whether the detector rises from round to round, by means over the seeds that come so far."""
    found = [loop_values(content, number, "test", "mask_ap50") for number in range(1, content["size"]["rounds"] + 1)]
    means = [100.0 * content["before"]["mask_ap50"], *(float(np.mean(one)) for one in found if one)]
    if len(means) < 3:
        return []
    rises = sum(after > before for before, after in pairwise(means))
    forgotten = loop_values(content, len(means) - 1, "test", "photographs_ap50")
    return [
        f"On unseen scenes the detector rises in {rises} of {len(means) - 1} rounds, and ends "
        f"**{means[-1] - means[1]:+.1f}** points from where it stood after the first ({means[-1] - means[0]:+.1f} from "
        "the pre-trained one); on photographs it ends "
        f"{np.mean(forgotten) - 100.0 * content['before']['photographs_ap50']:+.1f} points from the pre-trained one."
    ]


def categories_of(content: Mapping[str, Any]) -> list[str]:
    """Categories of which there is at least one instance somewhere, in alphabetical order."""
    return sorted({name for row in content["rows"] for name in row["runs"][0]["instances"] if _instances(row, name)})


def above_sentence(content: Mapping[str, Any], higher: str, lower: str) -> str:
    """On which categories with enough instances one row is above another, by means over seeds."""
    rows = {row["name"]: row for row in content["rows"]}
    counted = [name for name in categories_of(content) if _instances(rows[higher], name) >= FEW_INSTANCES]
    not_above = []
    for name in counted:
        ours, theirs = (values(rows[row], "ap50", name) for row in (higher, lower))
        if not ours or not theirs or np.mean(ours) <= np.mean(theirs):
            not_above.append(name)
    sentence = (
        f"{higher} are above {lower} on {len(counted) - len(not_above)} of {len(counted)} categories with "
        f"{FEW_INSTANCES} instances or more"
    )
    return sentence + (f" (not on {', '.join(not_above)})." if not_above else ".")


def _instances(row: Mapping[str, Any], category: str) -> int:
    return int(row["runs"][0]["instances"].get(category) or 0)


def _episodes(pools: Mapping[str, Mapping[str, Any]]) -> str:
    words = {
        "learn": "to learn from",
        "choose": "to choose the best network by",
        "test": "of unseen scenes to test on",
        "wide": "of more unseen scenes to test on",
    }
    counts = [(pool["episodes"], words[part]) for part, pool in pools.items()]
    return ", ".join(f"{count} {'episode' if count == 1 else 'episodes'} {purpose}" for count, purpose in counts)


def _means_table(name: str, content: Mapping[str, Any]) -> str:
    lines = ["| | on | AP50 | thesis | AP30 | thesis |", "|---|---|---|---|---|---|"]
    for row in content["rows"]:
        theirs = MEANS.get(name, {}).get(row["name"], {})
        cells = []
        for figure in FIGURES:
            cells += [_spread(values(row, figure)), f"{theirs[figure]:.1f}" if figure in theirs else "-"]
        lines.append(f"| {row['name']} | {SEEN_ON[row['part']]} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _categories_table(name: str, content: Mapping[str, Any], categories: Sequence[str]) -> str:
    counted = {category: [_instances(row, category) for row in content["rows"]] for category in categories}
    headings = [
        f"{category} ({'/'.join(str(n) for n in dict.fromkeys(counts))})" for category, counts in counted.items()
    ]
    lines = [f"| | {' | '.join(headings)} |", "|---" * (len(categories) + 1) + "|"]
    for row in content["rows"]:
        cells = []
        for category in categories:
            theirs = of_category(name, row["name"], "ap50", category)
            ours = _spread(values(row, "ap50", category))
            cells.append(ours if theirs is None else f"{ours} [{theirs:.1f}]")
        lines.append(f"| {row['name']} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _spread(found: Sequence[float]) -> str:
    if not found:
        return "-"
    mean = f"{np.mean(found):.1f}"
    return mean if len(found) == 1 else f"{mean} ± {np.std(found, ddof=1):.1f}"


PAGE, PICTURES = "results.md", "pictures"


MODES, TAUGHT = "label_modes", "rooms: labels of each preset, and detectors fine-tuned on them, in 40 unseen interiors"
