"""Tests of what is told of faults: each once, and all of them in few lines."""

import re
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from eskin.skin import Patch, Plane, TaxelGrid, build_skin
from eskin.stream import FaultReporter, describe_places
from eskin.stream.faults import CHECK, LISTED, REPEAT, SETTLE
from eskin.touch import Fault
from helpers.streams import SECOND, START

GRID = TaxelGrid(10, 100, 0.005, 0.005)
FLAT = Plane(np.eye(4))
SKIN = build_skin(
    "many",
    [
        (Patch(name, "table", address, GRID.rows, GRID.columns), GRID, FLAT)
        for address, name in enumerate("abcdefgh")
    ],
)
MINUTES = 10
END = MINUTES * 60


def fault(kind, row=None, column=None, taxel=None, patch="a"):
    return Fault(kind, patch, row, column, taxel, START)


def find_taxel(number, patch="a", kind="stuck"):
    return fault(kind, number // 100, number % 100, number, patch)


TAXEL = fault("stuck", 1, 2, 17)
ROW = fault("row", row=1)
PATCH = fault("patch")
COLUMN = fault("column", column=2)


def report(faults_at, seconds, rate=20, ends=True):
    """Return the events of the faults at each of some seconds."""
    reporter = FaultReporter(SKIN)
    events = []
    for n in range(round(seconds * rate)):
        stamp = START + round(n * SECOND / rate)
        events += reporter.report_faults(stamp, faults_at(n / rate))
    return events + (reporter.finish() if ends else [])


def alternate(found, period, share=0.5):
    """Return a function of the time that has a fault for a share of each period."""
    return lambda t: [found] if t % period < share * period else []


def list_places(events):
    return [(e.kind, e.patch, e.row, e.column, e.taxel) for e in events]


def count_times(events):
    """Return how often something came, as the texts say."""
    times = [re.search(r"(\d+) times? in", event.text) for event in events]
    faults = sum(event.kind == "fault" for event in events)
    repeated = [int(found[1]) for found in times if found]
    return sum(repeated) + faults - len(repeated)


@pytest.mark.parametrize("found", [TAXEL, ROW, COLUMN, PATCH])
def test_fault_is_told_as_it_begins_and_once_it_is_over(found):
    events = report(lambda t: [found] if 10 <= t < 100 else [], 200, ends=False)
    place = found.patch, found.row, found.column, found.taxel
    assert list_places(events) == [("fault", *place), ("mended", *place)]
    begun, over = ((event.stamp - START) / SECOND for event in events)
    assert begun == 10 and 100 + SETTLE / SECOND <= over < 101 + SETTLE / SECOND


@pytest.mark.parametrize("found", [TAXEL, COLUMN, PATCH])
@pytest.mark.parametrize("period", [0.2, 1.0, 7.0, 24.0, 50.0])
def test_fault_that_comes_and_goes_is_told_in_few_events_that_count_all(found, period):
    events = report(alternate(found, period), END)
    assert 2 <= len(events) <= 3 + MINUTES
    assert count_times(events) == np.ceil(END / period)
    later = [event.stamp for event in events[3:]]
    assert all(np.diff(later[:-1]) >= REPEAT)


def test_fault_that_comes_and_goes_is_over_once_it_has_stayed_away():
    def find(t):
        return alternate(COLUMN, 2.0)(t) if t < 90 else []

    events = report(find, 300, ends=False)
    assert [event.kind for event in events] == ["fault", "fault", "fault", "mended"]
    assert "31 times" in events[1].text or "30 times" in events[1].text
    # A later one is new.
    again = report(lambda t: find(t) or [COLUMN] * (t > 290), 300, ends=False)
    assert [event.kind for event in again[4:]] == ["fault"]
    assert "time" not in again[-1].text and "again" not in again[-1].text


def test_another_part_is_told_at_once_while_one_comes_and_goes():
    other = fault("column", column=7)

    def find(t):
        return alternate(COLUMN, 1.0)(t) + [other] * (t >= 20)

    events = [event for event in report(find, 100) if event.column == 7]
    assert [(e.kind, e.stamp) for e in events] == [("fault", START + 20 * SECOND)]


def test_kind_of_a_taxels_fault_that_changes_is_told_later():
    noisy = replace(TAXEL, kind="noisy")
    events = report(lambda t: [noisy if t < 1 else TAXEL], 100, ends=False)
    assert ["jumping" in event.text for event in events] == [True, False]
    assert "frozen" in events[1].text
    assert events[1].stamp - events[0].stamp >= REPEAT
    events = report(lambda t: [noisy if t < 1 else TAXEL], 10)
    assert ["frozen" in event.text for event in events] == [False, True]


@pytest.mark.parametrize(
    ("other", "covers"),
    [
        (ROW, True),
        (COLUMN, True),
        (PATCH, True),
        (fault("row", row=2), False),
        (fault("patch", patch="b"), False),
    ],
)
def test_part_of_a_larger_fault_is_not_over(other, covers):
    events = report(lambda t: [TAXEL] if t < 1 else [other], 20)
    mended = [("mended", "a", 1, 2, 17)] * (not covers)
    place = "fault", other.patch, other.row, other.column, None
    assert list_places(events[1:]) == [place, *mended]


def test_part_that_is_not_told_yet_is_told_by_a_larger_fault():
    taxels = [find_taxel(100 * row + 2) for row in range(10)]

    def find(t):
        return taxels[: int(t) + 1] if t < 12 else [COLUMN]

    events = report(find, 150)
    assert [event.taxel for event in events[:LISTED]] == [2, 102, 202]
    assert list_places(events[LISTED:]) == [
        ("fault", "a", None, None, None),
        ("fault", "a", None, 2, None),
    ]


def test_larger_part_in_order_again_names_what_is_still_faulty_in_it():
    def find(t):
        return [PATCH] if 20 <= t < 40 else [COLUMN]

    events = report(find, 100)
    assert list_places(events) == [
        ("fault", "a", None, 2, None),
        ("fault", "a", None, None, None),
        ("mended", "a", None, None, None),
    ]
    assert events[-1].text.endswith(", except column 2 of 0 to 99 of patch 'a'")


@pytest.mark.parametrize("count", [1, LISTED, LISTED + 1, 200])
def test_of_many_taxels_at_once_one_event_of_a_patch_is_told(count):
    def find(t):
        here = [find_taxel(n) for n in range(count)]
        return [*here, find_taxel(1000, "b")] if 5 <= t < 50 else []

    events = report(find, 100)
    own = [event for event in events if event.patch == "a"]
    assert [e.kind for e in events if e.patch == "b"] == ["fault", "mended"]
    told = count if count <= LISTED else 1
    assert [event.kind for event in own] == ["fault"] * told + ["mended"] * told
    if count > LISTED:
        assert f"{count} taxels of patch 'a' are faulty" in own[0].text
        assert f"{count} taxels of patch 'a' are in order again" in own[1].text
        assert {(e.row, e.column, e.taxel) for e in own} == {(None, None, None)}


def test_of_many_taxels_one_after_the_other_few_events_are_told():
    def find(t):
        return [find_taxel(n) for n in range(min(int(10 * t), 300))]

    events = report(find, 150)
    assert [event.taxel for event in events[:LISTED]] == [0, 1, 2]
    assert f"{LISTED + 1} taxels of patch 'a'" in events[LISTED].text
    assert len(events) == LISTED + 2 and "300 taxels" in events[-1].text


def test_many_patches_at_once_are_one_event():
    def find(t):
        return [fault("patch", patch=f"p{n}") for n in range(12)] if t >= 5 else []

    [event] = report(find, 20)
    assert event.patch is None
    assert event.text.startswith("12 patches ('p0', 'p1', 'p2' and 9 more) are faulty")


@pytest.mark.parametrize("seed", range(5))
def test_events_are_few_and_end_with_the_truth_whatever_fails(seed):
    rng = np.random.default_rng(seed)
    parts = [find_taxel(n, patch) for patch in "ab" for n in range(20)]
    parts += [fault("column", column=n) for n in range(30, 36)]
    parts += [fault("patch", patch=name) for name in "cdefgh"]
    period = rng.choice([0.3, 3.0, 30.0, 200.0], len(parts))
    phase = rng.uniform(0, 1, len(parts))
    is_faulty = rng.random(len(parts)) < 0.5

    def find(t):
        on = (t / period + phase) % 1.0 < 0.5 if t < END else is_faulty
        return [part for part, is_on in zip(parts, on, strict=True) if is_on]

    events = report(find, END + 200, rate=10, ends=False)
    kinds = Counter(event.kind for event in events)
    groups = 4  # Taxels of two patches, columns of one, and patches.
    most = groups * (LISTED + 1) * (MINUTES + 4)
    assert kinds["fault"] <= most and kinds["mended"] <= most
    assert not report_again(find, END + 200)


def report_again(find, seconds):
    """Return what a reporter has still to tell when nothing has changed for long."""
    reporter = FaultReporter(SKIN)
    for n in range(10 * seconds):
        reporter.report_faults(START + n * SECOND // 10, find(n / 10))
    return reporter.finish()


@pytest.mark.parametrize(
    ("found", "parts"),
    [
        (TAXEL, ("taxel 17 (row 1 of 0 to 9, column 2 of 0 to 99 of", "frozen")),
        (ROW, ("row 1 of 0 to 9 of patch 'a'", "lines")),
        (COLUMN, ("column 2 of 0 to 99 of patch 'a'", "lines")),
        (PATCH, ("patch 'a'", "silent")),
    ],
)
def test_text_of_a_fault_says_what_where_since_when_and_what_to_do(found, parts):
    event, over = report(lambda t: [found] if 12 <= t < 40 else [], 60)
    assert all(part in event.text for part in (*parts, " for 12 s; check its "))
    assert over.text == f"{event.text.split(' is ')[0]} is in order again after 40 s"
    assert "\n" not in event.text


@given(st.data())
def test_place_of_a_fault_is_that_in_the_skin_from_0(data):
    rows = data.draw(st.integers(1, 6))
    columns = data.draw(st.integers(1, 6))
    present = data.draw(arrays(bool, (rows, columns)).filter(np.any))
    grid = TaxelGrid(rows, columns, 0.005, 0.005, present=present)
    patches = [Patch(name, "table", n, rows, columns) for n, name in enumerate("ab")]
    skin = build_skin("two", [(patch, grid, FLAT) for patch in patches])
    i = data.draw(st.integers(0, skin.count - 1))
    row = int(skin.rows[i])
    column = int(skin.columns[i])
    name = skin.patches[skin.patch_index[i]].id
    cell = rf"row {row} of 0 to {rows - 1}, column {column} of 0 to {columns - 1}"
    found = [
        Fault("stuck", name, row, column, i, START),
        Fault("row", name, row, None, None, START),
        Fault("column", name, None, column, None, START),
    ]
    taxel, *lines = (describe_places([each], skin) for each in found)
    assert taxel == f"taxel {i} ({cell} of patch '{name}')"
    assert lines == [f"{part} of patch '{name}'" for part in cell.split(", ")]
    assert skin.describe_taxel(i) == f"{cell} of patch '{name}'"


def test_places_of_many_faults_are_counted():
    taxels = [find_taxel(n) for n in range(LISTED + 1)]
    text = "column 2 of 0 to 99 of patch 'a', 4 taxels of patch 'a', patch 'b'"
    assert describe_places([COLUMN, *taxels, fault("patch", patch="b")], SKIN) == text
    assert describe_places([], SKIN) == ""


def test_memory_of_faults_ends():
    reporter = FaultReporter(SKIN)
    for n in range(1000):
        reporter.report_faults(START + n * SECOND, [find_taxel(n)])
    assert len(reporter.parts) <= 2 * REPEAT // SECOND + CHECK
