"""The report of an evaluation: one HTML file that needs nothing but a browser."""

import json
from collections.abc import Callable, Iterable
from html import escape
from pathlib import Path
from typing import Any

from labeling.evaluation.compare import FIGURES, Evaluation, categories_by_presence
from labeling.evaluation.records import EpisodeRecords
from labeling.evaluation.report.pictures import picture_store
from labeling.evaluation.report.style import CSS
from labeling.evaluation.report.view_strips import Strips, draw_strips
from labeling.io.formats.atomic import atomic_file

MAX_EPISODE_ROWS = 300
MAX_PROVENANCE_LETTERS = 20_000

UNDEFINED = "\N{EN DASH}"
"""Stands where a figure has no value."""

HEADINGS = {
    "mask_ap50": "mask AP50",
    "mask_ap30": "mask AP30",
    "box_ap50": "box AP50",
    "box_ap30": "box AP30",
    "mean_iou": "mean IoU",
}


def write_report(
    path: Path,
    evaluation: Evaluation,
    max_strips: int = 40,
    max_worst: int = 12,
    progress: Callable[[Iterable[EpisodeRecords]], Iterable[EpisodeRecords]] = iter,
) -> None:
    """Writes the report, atomically.

    Args:
        path: the HTML file.
        evaluation: what to report.
        max_strips: views shown at most.
        max_worst: of those, how many for the worst cases.
        progress: wraps the sequence of episodes, to draw a progress bar.
    """
    page = render_report(evaluation, draw_strips(evaluation, max_strips, max_worst, progress))
    with atomic_file(path) as temporary:
        # JSON can hold halves of characters that are no Unicode; they are shown as their codes.
        temporary.write_text(page, encoding="utf-8", errors="backslashreplace")


def render_report(evaluation: Evaluation, strips: Strips) -> str:
    """The page as text. Whatever comes from files is escaped: a category may be called ``<script>``."""
    metrics = evaluation.metrics
    name = Path(metrics["dataset"]).resolve().name
    counts = metrics["counts"]
    body = [
        picture_store(strips.pictures),
        "<main><header>",
        f"<h1>Pseudo-labels against ground truth: {escape(name)}</h1>",
        f'<p class="soft">{plural(counts["episodes"], "episode")}, {plural(counts["views"], "view")}, '
        f"{plural(counts['ground_truth_instances'], 'ground-truth instance')}"
        f"{_ignored(counts['ignored_instances'])}; {plural(counts['detections'], 'detection')}, "
        f"{plural(counts['pseudo_labels'], 'pseudo-label')}.</p></header>",
        _key_figures(metrics),
        "".join(f'<div class="note">{escape(note)}</div>' for note in metrics["notes"]),
        _summary(metrics),
        _bars(metrics),
        _worst(strips),
        _episodes(evaluation, strips),
        _protocol(metrics),
        _provenance(metrics),
        "</main>",
    ]
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        # Nothing in the page may run or be fetched, whatever the label set holds.
        "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; style-src 'unsafe-inline'; "
        'img-src data:">'
        f"<title>Pseudo-labels: {escape(name)}</title><style>{CSS}</style></head>\n<body>"
        + "\n".join(body)
        + "</body></html>\n"
    )


def _number(value: float | None) -> str:
    return UNDEFINED if value is None else f"{value:.3f}"


def plural(count: int, noun: str) -> str:
    """A count and its noun, such as "1 view" and "2 views"."""
    return f"{count:,} {noun}" + ("" if count == 1 else "s")


def _ignored(count: int) -> str:
    return f" ({count:,} more ignored)" if count else ""


def _change(before: float | None, after: float | None) -> str:
    """The difference, coloured; green is up because every figure here is better when higher."""
    if before is None or after is None:
        return UNDEFINED
    change = after - before
    kind = "up" if change > 0.0005 else "down" if change < -0.0005 else "soft"
    return f'<span class="{kind}">{change:+.3f}</span>'


def _key_figures(metrics: dict[str, Any]) -> str:
    cards = []
    for key in FIGURES:
        before, after = metrics["detector"][key], metrics["pseudo_labels"][key]
        cards.append(
            f'<div class="card"><div class="name">{HEADINGS[key]}, pseudo-labels</div>'
            f'<div class="value">{_number(after)}</div>'
            f'<div class="from">detector {_number(before)} &nbsp; {_change(before, after)}</div></div>'
        )
    return f'<div class="cards">{"".join(cards)}</div>'


def _summary(metrics: dict[str, Any]) -> str:
    """All figures: both methods over all categories, then per category."""
    detector, labels = metrics["detector"], metrics["pseudo_labels"]
    head = "".join(f"<th>{HEADINGS[key]}</th>" for key in FIGURES)
    rows = [
        f"<tr><td><b>{title}</b></td>{''.join(f'<td><b>{_number(record[key])}</b></td>' for key in FIGURES)}"
        f"<td>{record['predictions']:,}</td></tr>"
        for title, record in (("Detector", detector), ("Pseudo-labels", labels))
    ]
    changes = "".join(f"<td>{_change(detector[key], labels[key])}</td>" for key in FIGURES)
    rows.append(f"<tr><td>Change</td>{changes}<td></td></tr>")
    extra = ""
    if labels["amodal_mask_ap50"] is not None:
        extra = (
            "<p>Whole-object (amodal) masks of the pseudo-labels: "
            f"AP50 <b>{_number(labels['amodal_mask_ap50'])}</b>, AP30 <b>{_number(labels['amodal_mask_ap30'])}</b>, "
            f"mean IoU <b>{_number(labels['amodal_mean_iou'])}</b>.</p>"
        )
    more = (
        f"<p class='soft'>COCO mask AP (IoU .50:.95): detector {_number(detector['mask_ap'])}, pseudo-labels "
        f"{_number(labels['mask_ap'])}. Mean IoU of the instances that were found at all: detector "
        f"{_number(detector['mean_iou_matched'])}, pseudo-labels {_number(labels['mean_iou_matched'])}.</p>"
    )
    return (
        f'<h2>Summary</h2><div class="card"><div class="scroll"><table><thead><tr><th></th>{head}<th>predictions</th>'
        f"</tr></thead><tbody>{''.join(rows)}</tbody></table></div>{extra}{more}</div>"
    )


def _bars(metrics: dict[str, Any]) -> str:
    """Bars per category, detector above pseudo-labels."""
    shown = ("mask_ap50", "mask_ap30", "mean_iou")
    detector, labels = metrics["detector"]["per_class"], metrics["pseudo_labels"]["per_class"]
    cells = ['<div class="head">Category</div>', *(f'<div class="head">{HEADINGS[key]}</div>' for key in shown)]
    for name in categories_by_presence(metrics)[0]:
        count = (labels.get(name) or detector[name])["ground_truth_instances"]
        cells.append(f'<div class="class">{escape(name)}<small>{plural(count, "instance")}</small></div>')
        for key in shown:
            bars = "".join(
                _bar(records[name][key] if name in records else None, kind, HEADINGS[key])
                for records, kind in ((detector, "detector"), (labels, "labels"))
            )
            cells.append(f"<div>{bars}</div>")
    legend = (
        '<div class="legend"><span><i class="detector"></i>Detector</span>'
        '<span><i class="labels"></i>Pseudo-labels</span></div>'
    )
    return f'<h2>Per category</h2><div class="card">{legend}<div class="bars">{"".join(cells)}</div></div>'


def _bar(value: float | None, kind: str, name: str) -> str:
    width = 0.0 if value is None else 100.0 * min(max(value, 0.0), 1.0)
    return (
        f'<div class="bar" data-name="{name}"><div class="track"><div class="fill {kind}" style="width:{width:.1f}%">'
        f'</div></div><span class="number">{_number(value)}</span></div>'
    )


def _worst(strips: Strips) -> str:
    if not strips.worst:
        return ""
    cards = "".join(
        f'<section class="card"><h3><span class="rank">{rank}</span>{escape(case.category)} in {escape(case.view[0])}, '
        f'view {case.view[1]} <span class="tally">· pseudo-label IoU <b>{case.pseudo_label_iou:.2f}</b>, '
        f"detector IoU {case.detector_iou:.2f}</span></h3>{strips.html[case.view]}</section>"
        for rank, case in enumerate(strips.worst, start=1)
    )
    return (
        "<h2>Worst cases</h2><p class='soft'>The objects whose pseudo-labels agree least with ground truth, one per "
        "view, the largest first among equals. An object has one colour in all three panels; dashed grey outlines "
        "stand for no object of their category, or for ignored ones. Hover over a mask for its IoU.</p>" + cards
    )


def _episodes(evaluation: Evaluation, strips: Strips) -> str:
    """A table of all episodes, then a section with strips for each episode shown."""
    views: dict[str, list[dict]] = {episode.name: [] for episode in evaluation.episodes}
    for record in evaluation.metrics["views"]:
        views[record["episode"]].append(record)
    tallies = {name: _tally(records) for name, records in views.items()}
    listed = list(views)[:MAX_EPISODE_ROWS]
    rows = "".join(
        f"<tr><td>{escape(name)}</td><td>{len(views[name])}</td><td>{count}</td><td>{_number(before)}</td>"
        f"<td>{_number(after)}</td><td>{_change(before, after)}</td></tr>"
        for name in listed
        for count, before, after in (tallies[name],)
    )
    more = f"<p class='soft'>{len(views) - len(listed):,} more in metrics.json.</p>" if len(views) > len(listed) else ""
    sections = "".join(
        f'<h3 style="margin-top:26px">{escape(name)} <span class="tally">· {plural(len(views[name]), "view")}, '
        f"mean IoU: detector {_number(tallies[name][1])}, pseudo-labels {_number(tallies[name][2])}</span></h3>"
        + "".join(f'<section class="card"><h3>View {view[1]}</h3>{strips.html[view]}</section>' for view in shown)
        for name, shown in strips.of_episode.items()
    )
    return (
        '<h2>Episodes</h2><div class="card"><div class="scroll"><table><thead><tr><th>Episode</th><th>views</th>'
        "<th>instances</th><th>mean IoU, detector</th><th>mean IoU, pseudo-labels</th><th>change</th></tr></thead>"
        f"<tbody>{rows}</tbody></table></div>{more}</div>{sections}"
    )


def _tally(records: list[dict]) -> tuple[int, float | None, float | None]:
    """Instances of an episode, and their mean IoU by detector and pseudo-labels."""
    count = sum(record["ground_truth_instances"] for record in records)
    if count == 0:
        return 0, None, None
    before, after = (
        sum((record[key] or 0.0) * record["ground_truth_instances"] for record in records) / count
        for key in ("detector_mean_iou", "pseudo_label_mean_iou")
    )
    return count, before, after


def _protocol(metrics: dict[str, Any]) -> str:
    entries = "".join(
        f"<dt>{escape(key.replace('_', ' ').capitalize())}</dt><dd>{escape(text)}</dd>"
        for key, text in metrics["protocol"].items()
    )
    return f'<h2>How it is evaluated</h2><div class="card"><dl>{entries}</dl></div>'


def _provenance(metrics: dict[str, Any]) -> str:
    """Which settings and versions made the labels and the figures."""
    content = {"dataset": metrics["dataset"], "evaluated_with": metrics["versions"], "label_set": metrics["label_set"]}
    text = json.dumps(content, indent=2, ensure_ascii=False)
    if len(text) > MAX_PROVENANCE_LETTERS:
        text = text[:MAX_PROVENANCE_LETTERS] + "\n… (the rest is in metrics.json)"
    return f'<h2>Provenance</h2><div class="card"><pre>{escape(text)}</pre></div>'
