"""Tests of the progress of long commands, where the output is no terminal."""

from contextlib import contextmanager
from threading import enumerate as enumerate_threads

import pytest
from hypothesis import given
from hypothesis import strategies as st

import eskin.progress
from eskin.exports.lerobot import write_lerobot
from eskin.learn.dataset import prepare
from eskin.progress import PERIOD, describe_progress, show_progress, track_progress
from eskin.recording import (
    Label,
    Metadata,
    RecordingWriter,
    read_recording,
    write_all,
)
from helpers.cli import call
from helpers.guided import CALIBRATION, SKIN, make_scans, record, rest
from helpers.guided import PERIOD as PERIOD_NS


def test_line_tells_what_is_done_and_what_time_is_left():
    assert describe_progress("clips", 40, 100, 20, 10.0) == (
        "clips: 40 of 100, about 30 s left"
    )


@pytest.mark.parametrize(
    ("done", "total", "line"),
    [
        (20, 100, "clips: 20 of 100"),
        (100, 100, "clips: 100 of 100"),
        (7, None, "clips: 7"),
    ],
)
def test_time_that_is_left_is_not_guessed(done, total, line):
    assert describe_progress("clips", done, total, 20, 10.0) == line


@given(st.integers(0, 50), st.integers(1, 50), st.integers(1, 50), st.floats(0.1, 1e4))
def test_time_that_is_left_is_that_of_the_rest_at_the_same_rate(
    begun, more, left, seconds
):
    done = begun + more
    line = describe_progress("clips", done, done + left, begun, seconds)
    assert line.endswith(f", about {seconds / more * left:.0f} s left")


def test_lines_are_printed_while_the_first_takes_long(capsys, monkeypatch):
    monkeypatch.setattr(eskin.progress, "PERIOD", 0.001)
    printed = ""
    with show_progress("clips", 3):
        while "\n" not in printed:
            printed += capsys.readouterr().err
    assert printed.startswith("clips: 0 of 3\n")
    capsys.readouterr()
    assert capsys.readouterr().err == ""


@pytest.fixture
def shown(monkeypatch):
    """Return the names of what is counted on stderr, as they come."""
    names = []

    @contextmanager
    def remember(what, total, begun):
        names.append(what)
        yield lambda number: None

    monkeypatch.setattr(eskin.progress, "print_progress", remember)
    return names


LONG = {
    "parquet": ("export", "{recording}", "--parquet", "{out}"),
    "lerobot": ("export", "{recording}", "--lerobot", "{out}"),
    "rosbag": ("export", "{recording}", "--rosbag", "{out}"),
    "report": ("report", "{recording}", "--out", "{out}"),
    "label": ("label", "{labelled}", "--out", "{out}"),
    "convert": (
        "convert",
        "table",
        "{table}",
        "{out}",
        "--rows",
        "2",
        "--columns",
        "2",
    ),
}
"""Commands that may take minutes, and print nothing else meanwhile."""


def write_labelled(path):
    """Write a recording of a second with one label."""
    label = Label(20 * PERIOD_NS, 40 * PERIOD_NS, "poke")
    with RecordingWriter(path, "table", SKIN, CALIBRATION, Metadata()) as writer:
        write_all(writer, make_scans(rest(50)), [label])


@pytest.mark.parametrize("words", LONG.values(), ids=LONG)
def test_commands_that_may_take_minutes_show_progress(words, shown, tmp_path, capsys):
    places = {
        "recording": record(tmp_path / "a.mcap", make_scans(rest(50))),
        "labelled": tmp_path / "b.mcap",
        "table": tmp_path / "t.csv",
        "out": tmp_path / "out",
    }
    write_labelled(places["labelled"])
    lines = ["gesture,a,b,c,d", *["poke,1,2,3,4"] * 50]
    places["table"].write_text("\n".join(lines))
    filled = [word.format(**places) for word in words]
    if words[0] == "convert":
        filled += ["--label", "gesture", "--rate", "50"]
    call(capsys, *filled)
    assert shown


def fail(*_, **__):
    raise ValueError("disk full")


def take_one_and_fail(graphs, *_):
    fail(next(iter(graphs)))


def export(path, folder):
    write_lerobot([read_recording(path)], folder / "out")


def prepare_one(path, folder):
    prepare([path])


@pytest.mark.parametrize(
    ("work", "part", "failing"),
    [
        (export, "eskin.exports.lerobot.list_frames", fail),
        (prepare_one, "eskin.learn.dataset.join_graphs", take_one_and_fail),
    ],
)
def test_no_line_is_printed_after_an_error_that_is_kept(
    work, part, failing, tmp_path, monkeypatch
):
    """A notebook keeps the last traceback, and with it all that its frames name."""
    path = tmp_path / "a.mcap"
    write_labelled(path)
    monkeypatch.setattr(part, failing)
    with pytest.raises(ValueError, match="disk full") as kept:
        work(path, tmp_path)
    assert "eskin progress" not in [thread.name for thread in enumerate_threads()]
    assert kept.value.__traceback__ is not None


@pytest.mark.parametrize("quiet", [True, False])
def test_short_and_quiet_commands_print_nothing(quiet, capsys):
    with show_progress("clips", 3, quiet=quiet) as update:
        update(1)
    assert list(track_progress("abc", "letters", 3)) == ["a", "b", "c"]
    assert capsys.readouterr() == ("", "") and PERIOD == 10.0
