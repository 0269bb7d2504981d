"""Long work says where it is, to whoever listens on its thread."""

import io
import threading

from tqdm import tqdm

from labeling.generator.propagate import propagate
from labeling.io.episodes import read_episode, write_episode
from labeling.runtime.cli import showing_stages
from labeling.runtime.progress import progress_reported_to, report_progress, view_counter

from ..synthetic_room import make_episode


def test_reading_writing_and_labelling_tell_where_they_are(tmp_path) -> None:
    episode = make_episode(3, num_views=3, size=(48, 64), num_objects=2, confident_share=2.0)
    told: list[str] = []
    with progress_reported_to(told.append):
        write_episode(tmp_path / "room", episode)
        read = read_episode(tmp_path / "room")
    assert told == [f"{what} {k}/3 views" for what in ("writing", "reading") for k in (1, 2, 3)]
    told.clear()
    with progress_reported_to(told.append):
        labels = propagate(read, read.detections)
    assert [line.split()[0] for line in told] == ["comparing", "fusing", "segmenting", "drawing"]
    report_progress("nobody listens")
    assert len(told) == 4
    unheard = propagate(read, read.detections)
    assert [one.confidence for one in unheard.labels] == [one.confidence for one in labels.labels]


def test_what_other_threads_do_beside_it_is_no_news() -> None:
    told: list[str] = []
    with progress_reported_to(told.append):
        other = threading.Thread(target=report_progress, args=("reading the next",))
        other.start()
        other.join()
        with progress_reported_to(lambda stage: told.append(f"inner {stage}")):
            view_counter("detecting in", 5)(2)
        report_progress("outer")
    assert told == ["inner detecting in 2/5 views", "outer"]


def test_a_bar_shows_the_stage_once_it_is_there_itself() -> None:
    shown = {}
    for delay_s in (1e-9, 1e9):
        file = io.StringIO()
        with tqdm(total=1, file=file, delay=delay_s, mininterval=0, desc="labelling") as bar, showing_stages(bar):
            report_progress("reading 1/500 views")
            shown[delay_s] = file.getvalue()
    assert "reading 1/500 views" in shown[1e-9]
    assert shown[1e9] == ""
    with tqdm(total=1, disable=True) as bar, showing_stages(bar):
        report_progress("no bar")
