"""Tests of the lines on the terminal: nothing is lost, and no line hides another."""

import sys
from dataclasses import replace

import numpy as np
import pytest

from eskin.cli.terminal import TerminalPrinter, describe_where
from eskin.drivers import Event, ManualClock, SourceInfo
from eskin.live import Detection
from eskin.skin import mount_skin
from eskin.stream import CommandEvent, Context
from eskin.touch import Scan
from eskin.units import format_count
from helpers.questions import GRAB, QUESTION
from helpers.touch import build_grid_skin, calibration_of

MS = 1_000_000
SKIN = build_grid_skin(2, 2)
ZERO = np.zeros(3)
DETECTION = Detection(0, 1, "tap", 0.9, 0, 0, "p0", "p0", ZERO, ZERO, ZERO, 1.0)
INFO = SourceInfo("test:", mount_skin(SKIN, "table"), calibration_of(SKIN), 50.0)


def print_events(capsys, events, closes=True):
    """Return the lines of some events, without the titles."""
    printer = TerminalPrinter()
    printer.start(Context(INFO, ManualClock(0), lambda _: None))
    for event in events:
        printer.on_message(event)
    if closes:
        printer.close()
    return capsys.readouterr().out.splitlines()[1:]


def silence(count, start=0, kind="silent"):
    return [
        Event(start + n * MS, kind, f"patch 'p{n}' is {kind}", f"p{n}")
        for n in range(count)
    ]


@pytest.mark.parametrize("count", [1, 3, 4, 43])
def test_of_many_patches_at_once_three_are_printed_and_all_are_counted(capsys, count):
    lines = print_events(capsys, silence(count))
    assert len(lines) == min(count, 4)
    if count > 3:
        assert lines[-1].strip() == f"and {format_count(count - 3, 'patch')} more"


def test_patch_with_several_events_is_counted_once(capsys):
    lines = print_events(capsys, [Event(n, "late", f"{n}", "p0") for n in range(8)])
    assert len(lines) == 8 and not any("more" in line for line in lines)
    again = silence(6) + silence(6, 10 * MS)[3:]
    lines = print_events(capsys, again)
    assert len(lines) == 4 and lines[-1].endswith("and 3 patches more")


def test_count_is_printed_once_time_has_passed(capsys):
    def scan(ms):
        received = np.ones(SKIN.count, bool)
        return Scan(ms * MS, np.zeros(SKIN.count, np.int32), received, np.zeros(0))

    for last, count in ((400, 3), (505, 4), (900, 4)):
        scans = [scan(ms) for ms in range(100, last, 20)]
        lines = print_events(capsys, silence(5) + scans + [scan(last)], closes=False)
        assert len(lines) == count


def test_patches_at_another_time_or_of_another_kind_are_printed(capsys):
    events = silence(5) + silence(2, 600 * MS) + silence(2, 603 * MS, "returned")
    lines = print_events(capsys, events)
    assert ["and 2 patches more" in line for line in lines].count(True) == 1
    assert len(lines) == 3 + 1 + 2 + 2


@pytest.mark.parametrize("kind", ["damaged", "silent"])
def test_events_that_are_not_of_patches_are_all_printed(capsys, kind):
    events = [Event(n * MS, kind, f"port {n}") for n in range(8)]
    assert len(print_events(capsys, events)) == 8


@pytest.mark.parametrize("rings", [True, False])
def test_question_is_a_line_that_rings_the_bell_of_a_terminal(
    capsys, monkeypatch, rings
):
    monkeypatch.setattr(sys.stdout, "isatty", lambda: rings)
    events = [
        CommandEvent(3210 * MS, "ask", 4, "grab", True, QUESTION),
        CommandEvent(4000 * MS, "resume", 4, "grab", True, GRAB),
    ]
    asked, resumed = print_events(capsys, events)
    assert asked.split("\a") == [asked.strip("\a"), ""][: 1 + rings]
    assert asked.strip("\a").split() == ["3.21s", "ask", *str(QUESTION).split()]
    assert resumed.endswith("done: grab on forearm")


@pytest.mark.parametrize(("patch", "taxel"), [("p0", 3), ("p0", None), ("other", 3)])
def test_place_of_a_touch_says_more_than_one_name_twice(patch, taxel):
    found = replace(DETECTION, patch=patch, link="p0", taxel=taxel)
    where = describe_where(found, SKIN)
    if patch == "p0" and taxel is not None:
        assert where == "p0, row 1 of 0 to 1, column 1 of 0 to 1"
    else:
        assert where == f"{patch} on p0"
