"""Tests of lines of numbers: what may mean two things is asked for, never guessed."""

import json
import re
import shlex
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eskin.drivers.csv_lines import END, LineDeframer, LineForm
from eskin.drivers.csv_matrix import MatrixLine
from eskin.drivers.sampled_source import estimate_rate
from test_drivers_devices import COLUMNS, JSON, ROWS, format_line, matrix_skin
from test_firmware import COMPILER, FIRMWARE, STRICT, run_program

MS = 1_000_000
SECOND = 1_000_000_000
COUNTS = [300 + 7 * n for n in range(ROWS * COLUMNS)]


def open_line(options="", missing=()):
    """Open the line of a matrix that lacks the taxels of some cells."""
    skin = matrix_skin()
    keep = np.delete(np.arange(skin.count), missing)
    fields = ("patch_index", "rows", "columns", "positions", "normals", "areas")
    parts = {name: getattr(skin, name)[keep] for name in (*fields, "tangents")}
    form = LineForm.parse(f"pad{options}")
    skin = replace(skin, **parts)
    return MatrixLine(form, skin, 0)


def read_lines(line, lines, period=20 * MS):
    """Return the samples of lines that arrive one a period."""
    line.deframer.push_chunk(b"\n")
    samples = []
    now = 0
    for each in lines:
        now += period
        line.empty_at = now - MS
        samples += line.push_lines(line.deframer.push_chunk(each), now)
    return samples


def join(values, separator=","):
    return separator.join(map(str, values)).encode()


ROWS_OF = [COUNTS[n : n + COLUMNS] for n in range(0, len(COUNTS), COLUMNS)]
READABLE = {
    "plain": join(COUNTS) + b"\n",
    "carriage returns": join(COUNTS) + b"\r",
    "both, turned": join(COUNTS) + b"\n\r",
    "byte order mark": b"\xef\xbb\xbf" + join(COUNTS) + b"\n",
    "brackets": b"[" + join(COUNTS, ", ") + b"]\n",
    "tabs": join(COUNTS, "\t") + b"\n",
    "last separator": join(COUNTS, ";") + b";\n",
    "decimals": join([f"{v}.00" for v in COUNTS]) + b"\n",
    "rows": b"".join(join(row) + b"\n" for row in ROWS_OF) + b"\n",
    "rows that end in CRLF": b"".join(join(row) + b"\r\n" for row in ROWS_OF) + b"\r\n",
    "rows after a word": b"START\n" + b"".join(join(row) + b"\n" for row in ROWS_OF),
    "rows before a rule": b"".join(join(row) + b"\n" for row in ROWS_OF) + b"=====\n",
    "rows on a cleared screen": b"\x1b[2J\x1b[H"
    + b"".join(join(row) + b"\n" for row in ROWS_OF)
    + b"\n",
    "JSON object": b'{"t": 123, "v": [' + join(COUNTS) + b'], "ok": true}\n',
    "JSON object with other lists": b'{"imu": [1, 2.5, null], "v": ['
    + join(COUNTS)
    + b"]}\n",
    "JSON object of named rows": json.dumps(
        {f"row{n}": row for n, row in enumerate(ROWS_OF)}
    ).encode()
    + b"\n",
    "JSON object of cells": json.dumps(
        {f"s{n}": v for n, v in enumerate(COUNTS)}
    ).encode()
    + b"\n",
    "JSON object of rows": b'{"v": ' + str(ROWS_OF).encode() + b', "n": 7}\n',
    "JSON list of rows": str(ROWS_OF).encode() + b"\n",
    "printed array": b"["
    + b"\n ".join(b"[" + join(row, " ") + b"]" for row in ROWS_OF)
    + b"]\n",
}


@pytest.mark.parametrize("text", READABLE.values(), ids=READABLE)
def test_every_clear_form_gives_the_same_counts(text):
    samples = read_lines(open_line(), [text] * 40)
    assert [sample.counts.tolist() for sample in samples[1:]] == [COUNTS] * (
        len(samples) - 1
    )
    assert len(samples) >= 39


@pytest.mark.parametrize("word", ["nan", "NaN", "", "-nan"])
def test_cell_that_is_no_number_is_missing(word):
    text = join([word if n == 4 else v for n, v in enumerate(COUNTS)]) + b"\n"
    (sample,) = read_lines(open_line(), [text])
    assert np.flatnonzero(~sample.received).tolist() == [4]
    assert np.delete(sample.counts, 4).tolist() == COUNTS[:4] + COUNTS[5:]


def timed(values, per_second, mark=""):
    """Return a function of the time [ns] that gives a line with it."""
    return lambda now: (
        mark.encode() + join([5000 + now * per_second // SECOND, *values]) + b"\n"
    )


UNCLEAR = {
    "time and all cells": ((), timed(COUNTS, 1000)),
    "time in us and all cells": ((), timed(COUNTS, 10**6)),
    "time and all but one cell": ((), timed(COUNTS[1:], 1000)),
    "time and the taxels": ((29,), timed(COUNTS[:-1], 1000)),
    "all cells": ((29,), lambda now: join(COUNTS) + b"\n"),
    "marked time in ms": ((), timed(COUNTS, 1000, "@")),
    "marked time in ns": ((), timed(COUNTS, 10**9, "@")),
    "marked time that stands": ((), timed(COUNTS, 0, "@")),
    "decimal commas": (
        (),
        lambda now: join([f"{v},5" for v in COUNTS], ";") + b"\n",
    ),
    "pairs": ((), lambda now: join([f"{v},5" for v in COUNTS[:15]], ";") + b"\n"),
    "label": ((), lambda now: b"S1: " + join(COUNTS) + b"\n"),
    "volts": ((), lambda now: join([v / 1000 for v in COUNTS]) + b"\n"),
    "below zero": ((), lambda now: join([v - 310 for v in COUNTS]) + b"\n"),
    "beyond the range": ((), lambda now: join([300 * v for v in COUNTS]) + b"\n"),
}


@pytest.mark.parametrize(("missing", "line_at"), UNCLEAR.values(), ids=UNCLEAR)
def test_unclear_lines_are_refused_and_the_remedy_reads_them(missing, line_at):
    lines = [line_at(n * 20 * MS) for n in range(1, 100)]
    unclear = open_line(missing=missing)
    refused = 99 - len(read_lines(unclear, lines))
    # It takes half a second to tell a time from a count.
    assert refused > 60 and lines[-1][:40].decode().strip() in unclear.why
    remedies = re.findall(r"csv:pad(\S*?)(?=[ ;]|$)", unclear.why)
    assert remedies
    if line_at is UNCLEAR["time and all but one cell"][1]:
        # Two forms are possible: a skin that lacks the cell, or a count that rises.
        assert remedies == [",time=none"] and "leaves 29 counts" in unclear.why
    counts = [len(read_lines(open_line(one, missing), lines)) for one in remedies]
    assert max(counts) > 90, dict(zip(remedies, counts, strict=True))


def vary(n, rises):
    """Return counts of a scan: some rise with each scan, or they are noise at rest."""
    noise = np.random.default_rng(n).integers(0, 40, len(COUNTS))
    return [c + n if rises else c + int(d) for c, d in zip(COUNTS, noise, strict=True)]


def as_rows(values, before=lambda row: "", after="\n"):
    rows = [values[n : n + COLUMNS] for n in range(0, len(values), COLUMNS)]
    lines = [before(n).encode() + join(row) + b"\n" for n, row in enumerate(rows)]
    return b"".join(lines) + after.encode()


def minutes(n):
    return f"12:{n // 1500:02d}:{n // 25 % 60:02d}.{n % 25 * 40:03d}"


SKETCHES = {
    "number of the row": lambda n, v: as_rows(v, lambda row: f"{row},"),
    "number of the row, from 1": lambda n, v: as_rows(v, lambda row: f"{row + 1},"),
    "name of the row": lambda n, v: as_rows(v, lambda row: f"R{row}: "),
    "names of the rows in JSON": lambda n, v: (
        b'{\n"mat": {\n' + as_rows(v, lambda row: f'"row{row}": ', "}\n}\n")
    ),
    "time of day": lambda n, v: f"{minutes(n)} -> ".encode() + join(v) + b"\n",
    "coloured log": lambda n, v: (
        f"\x1b[0;32mI ({40 * n}) mat: ".encode() + join(v) + b"\x1b[0m\n"
    ),
    "number of the scan first": lambda n, v: join([n, *v]) + b"\n",
    "number of the scan last": lambda n, v: join([*v, n]) + b"\n",
    "time in us last": lambda n, v: join([*v, 40_000 * n]) + b"\n",
    "board first": lambda n, v: join([7, *v]) + b"\n",
    "board last": lambda n, v: join([*v, 7]) + b"\n",
    "label, time and number": lambda n, v: (
        b"DATA: " + join([40 * n, *v, n % 200]) + b"\n"
    ),
    "label and others": lambda n, v: (
        b"DATA: " + join(v) + b"\n" + (b"T: 25\n" if n % 5 == 0 else b"")
    ),
    "label and comma": lambda n, v: b"DATA," + join(v) + b"\n",
    "two sensors": lambda n, v: (
        b"S1: " + join(v) + b"\n" + b"S2: " + join(v[::-1]) + b"\n"
    ),
    "missing cell": lambda n, v: join([*v[:-1], -1]) + b"\n",
    "hexadecimal": lambda n, v: join([f"{c:03X}" for c in v], " ") + b"\n",
    "hexadecimal with 0x": lambda n, v: join([hex(c) for c in v], " ") + b"\n",
    "hexadecimal of 0 to 9": lambda n, v: (
        join([f"{0x100 + (c + n) % 10:03X}" for c in COUNTS], " ") + b"\n"
    ),
    "hexadecimal that looks like powers": lambda n, v: (
        join([f"{0x1E0 + c % 10:03X}" for c in v], " ") + b"\n"
    ),
    "NMEA": lambda n, v: b"$" + format_line(v, None, True),
    "separators of letters": lambda n, v: b"z" + join(v, "x") + b"\n",
    "names of cells": lambda n, v: join([f"s{k}:{c}" for k, c in enumerate(v)]) + b"\n",
    "a cell a line": lambda n, v: b"".join(
        f"{k},{c}\n".encode() for k, c in enumerate(v)
    ),
    "two scans a line": lambda n, v: join([*v, *v]) + b"\n",
    "rows without an end": lambda n, v: as_rows(v, after=""),
    "UTF-16": lambda n, v: join(v).decode().encode("utf-16-le") + b"\n\0",
}


@pytest.mark.parametrize("rises", [False, True], ids=["at rest", "all rise"])
@pytest.mark.parametrize("sketch", SKETCHES.values(), ids=SKETCHES)
def test_hints_read_what_was_refused(sketch, rises):
    """Nothing is read wrongly without a hint, and the right one is among the hints."""
    scans = [vary(n, rises) for n in range(60)]
    texts = [sketch(n, values) for n, values in enumerate(scans)]
    wanted = {tuple(values) for values in scans}
    if sketch is SKETCHES["missing cell"]:
        wanted = {(*values[:-1], 0) for values in scans}
    elif sketch is SKETCHES["hexadecimal of 0 to 9"]:
        wanted = {tuple(0x100 + (c + n) % 10 for c in COUNTS) for n in range(60)}
    elif sketch is SKETCHES["hexadecimal that looks like powers"]:
        wanted = {tuple(0x1E0 + c % 10 for c in values) for values in scans}
    line = open_line()
    assert not read_lines(line, texts, 40 * MS) and line.unread
    assert "allowed are 30 counts a line" in line.why
    hints = [LineForm.parse(each) for each in find_hints(line.why)]
    found = [read_lines(open_line_of(hint), texts, 40 * MS) for hint in hints]
    right = [
        len(samples)
        for samples in found
        if all(tuple(sample.counts.tolist()) in wanted for sample in samples)
    ]
    known = len(hints) == 1 or line.why.count(" if ") == len(hints)
    assert not hints or (max(right, default=0) >= 50 and known), line.why
    unreadable = [*SKETCHES][[*SKETCHES].index("separators of letters") :]
    assert bool(hints) == (sketch not in [SKETCHES[name] for name in unreadable])


def find_hints(why):
    """Return the addresses in a message, without `csv:`, as a shell would take them."""
    words = shlex.split(why.partition("; give ")[2].replace(", or ", " "))
    return [word.removeprefix("csv:") for word in words if word.startswith("csv:")]


def open_line_of(form):
    return MatrixLine(form, matrix_skin(), 0)


@pytest.mark.parametrize("last", [False, True])
def test_option_that_leaves_out_the_wrong_end_is_refused(last):
    """Of two numbers at the ends of lines, the one that rises is no count."""
    scans = [vary(n, False) for n in range(200)]
    lines = [join([*v, n] if last else [n, *v]) + b"\n" for n, v in enumerate(scans)]
    wrong = ",time=ignore"
    right = ",last=ignore"
    if not last:
        wrong, right = right, wrong
    line = open_line(wrong)
    # It takes two seconds to tell such a number from a count.
    assert len(read_lines(line, lines, 40 * MS)) <= 55 and right in line.why
    assert len(read_lines(open_line(right), lines, 40 * MS)) == 200


@pytest.mark.parametrize("end", [0, -1])
@pytest.mark.parametrize("step", [4, 13])
def test_cell_that_is_pressed_from_the_start_is_read(end, step):
    """A count rises with a press, but not by the same step for two seconds."""
    scans = [vary(n, False) for n in range(200)]
    for n, values in enumerate(scans):
        values[end] = 300 + step * min(n, 40)
    option = ",last=ignore" if end == 0 else ",time=ignore"
    lines = [join([*v, 7] if end == 0 else [7, *v]) + b"\n" for v in scans]
    samples = read_lines(open_line(option), lines, 40 * MS)
    assert [sample.counts.tolist() for sample in samples] == scans


def test_lines_are_read_again_once_a_number_no_longer_rises():
    """What was taken for the number of the line was a count."""
    scans = [vary(n, False) for n in range(400)]
    for n, values in enumerate(scans):
        values[-1] = 300 + 4 * min(n, 100)
    line = open_line(",time=ignore")
    samples = read_lines(line, [join([7, *v]) + b"\n" for v in scans], 40 * MS)
    assert line.refused
    assert [sample.counts.tolist() for sample in samples[-200:]] == scans[-200:]


DAMAGED = {
    "two letters": lambda v: join(["c00", *v[1:-1], "3e4"]),
    "letters alone": lambda v: b"bad bed fee cab ace",
    "power": lambda v: join([*v[:-1], "3e4"]),
    "checksum": lambda v: join(v) + b"*00",
    "other size": lambda v: join([*v, 5, 6]),
    "below zero": lambda v: join([-5, *v[1:]]),
    "beyond the range": lambda v: join([99_999, 88_888, *v[2:]]),
    "semicolons": lambda v: join(v[:9]) + b";" + join(v[9:]),
    "label": lambda v: b"S1: " + join(v),
    "object": lambda v: b'{"v": [1, 2]}',
    "equal numbers of another width": lambda v: join([1000 + n % 2 for n in v]),
}


@pytest.mark.parametrize("count", [1, 40])
@pytest.mark.parametrize("damage", DAMAGED.values(), ids=DAMAGED)
def test_nothing_that_comes_later_stops_good_lines_from_being_read(damage, count):
    good = [join(vary(n, False)) + b"\n" for n in range(200)]
    bad = [damage(vary(n, False)) + b"\n" for n in range(count)]
    line = open_line()
    before = read_lines(line, good)
    line.note_reported()
    line.begin(0)
    read_lines(line, bad)
    after = read_lines(line, good)
    assert len(before) == 200 and len(after) >= 199
    assert [sample.counts.tolist() for sample in after[-199:]] == [
        sample.counts.tolist() for sample in before[-199:]
    ]


@pytest.mark.parametrize("first", [[100] * len(COUNTS), COUNTS])
def test_base_is_no_longer_doubted_in_a_running_session(first):
    line = open_line()
    assert len(read_lines(line, [join(first) + b"\n"] * 60)) == 60
    line.note_reported()
    noise = [[100 + (c + n) % 10 for c in COUNTS] for n in range(60)]
    samples = read_lines(line, [join(values) + b"\n" for values in noise])
    assert [sample.counts.tolist() for sample in samples] == noise


def test_no_options_are_searched_for_in_a_running_session(monkeypatch):
    line = open_line()
    read_lines(line, [join(vary(n, False)) + b"\n" for n in range(60)])
    line.note_reported()
    monkeypatch.setattr(MatrixLine, "try_form", None)
    read_lines(line, [join([n, *COUNTS]) + b"\n" for n in range(200)])
    assert line.refused == 200 and "it has 31 numbers" in line.why


@pytest.mark.parametrize("empty", [(), (0,), (4,), (0, 1), (29,), (0, 29)])
@pytest.mark.parametrize("label", ["DATA", "DATA:", "S*:"])
@pytest.mark.parametrize("ends", [b"", b","])
@pytest.mark.parametrize("options", ["", ",time=ignore", ",last=ignore", ",time=ms"])
@pytest.mark.parametrize("by_rows", [False, True])
def test_empty_cell_after_a_label_is_missing(empty, label, ends, options, by_rows):
    """A separator ends the label only where a line has a number too many."""
    line = open_line(f",label={label}{options}")
    start = label.replace("*", "7").encode() + ends

    def write(values, n):
        before = [20 * n + 7] if "time" in options else []
        after = [5] if "last" in options else []
        return start + join([*before, *values, *after]) + b"\n"

    by_rows = by_rows and options != ",time=ms"
    scans = [["" if k in empty else c for k, c in enumerate(COUNTS)]] * 80
    texts = [write(values, n) for n, values in enumerate(scans)]
    if by_rows:
        parts = [slice(k, k + COLUMNS) for k in range(0, len(COUNTS), COLUMNS)]
        rows = [
            b"".join(write(v[part], n) for part in parts) for n, v in enumerate(scans)
        ]
        texts = [text + b"END\n" for text in rows]
    samples = read_lines(line, texts)
    last = COLUMNS - 1 if by_rows else len(COUNTS) - 1
    if ends and {last, 29} & {*empty} and "last" not in options:
        # Either the last cell is missing, or the first.
        assert not samples and line.refused
    else:
        assert len(samples) > 60
    wanted = [0 if k in empty else c for k, c in enumerate(COUNTS)]
    for sample in samples:
        assert np.flatnonzero(~sample.received).tolist() == [*empty]
        assert sample.counts.tolist() == wanted


@pytest.mark.parametrize("label", ["", "DATA"])
@pytest.mark.parametrize("missing", [(), (3,), (3, 9)])
def test_separator_at_the_end_is_no_cell(label, missing):
    values = np.delete(COUNTS, missing).tolist()
    line = open_line(f",label={label}", missing)
    (sample,) = read_lines(line, [label.encode() + join(values) + b",\n"])
    assert sample.received.all() and sample.counts.tolist() == values


def test_line_whose_first_or_last_cell_is_missing_is_refused():
    line = open_line(",label=DATA")
    assert not read_lines(line, [b"DATA," + join(COUNTS[1:]) + b",\n"])
    assert "first or its last cell is missing" in line.why
    assert "send nan" in line.why


@pytest.mark.parametrize("others", [1, 49])
def test_lines_of_a_busy_neighbour_are_left_out(others):
    line = open_line(",label=DATA:")
    other = b"".join(b"IMU:%d,2,3\n" % n for n in range(others))
    texts = [other + b"DATA:" + join(COUNTS) + b"\n"] * 60
    assert len(read_lines(line, texts, 50 * MS)) == 60 and not line.refused


@pytest.mark.parametrize(
    ("name", "others"),
    [
        ("time", {"temperature": 25.5}),
        ("millis", {"type": 3, "seq": 1}),
        ("ms", {"touched": 1}),
        ("time_ms", {"temperature": 25.5}),
        ("elapsed", {}),
    ],
)
def test_time_of_an_object_is_known_by_its_name(name, others):
    texts = [
        json.dumps({**others, name: 40 * n, "v": COUNTS}).encode() + b"\n"
        for n in range(1, 80)
    ]
    line = open_line(",time=ms")
    assert len(read_lines(line, texts, 40 * MS)) > 70 and not line.refused


FINITE = st.none() | st.floats(allow_nan=False, allow_infinity=False)


@given(scale=FINITE, offset=FINITE, missing=FINITE, label=st.sampled_from(["", "a.0"]))
def test_address_of_a_form_is_read_back_as_that_form(scale, offset, missing, label):
    form = LineForm("pad", "ms", "ignore", "point", "16", label, scale, offset, missing)
    (address,) = shlex.split(form.format())
    assert LineForm.parse(address.removeprefix("csv:")) == form


def test_object_with_several_numbers_of_which_none_is_named_as_a_time_is_refused():
    text = json.dumps({"temperature": 25.5, "n": 4, "v": COUNTS}).encode() + b"\n"
    line = open_line(",time=ms")
    assert not read_lines(line, [text] * 40)
    assert "which of its numbers is its time is not known: 'temperature', 'n'" in (
        line.why
    )


@pytest.mark.parametrize("word", ["1_0", "nan", "x", "1e999", "\u0661"])
def test_text_that_is_no_number_is_refused_in_a_list(word):
    text = json.dumps({"v": [word, *COUNTS[1:]]}).encode() + b"\n"
    assert not read_lines(open_line(), [text])
    good = json.dumps({"v": [str(c) for c in COUNTS]}).encode() + b"\n"
    assert len(read_lines(open_line(), [good])) == 1


@settings(max_examples=40, deadline=None)
@given(
    st.sampled_from([b"x", b"S1: ", b"7,", b",", b"0x", b"1E", b'{"a":']),
    st.integers(0, 60),
    st.sampled_from([20 * MS, 200 * MS]),
)
def test_line_that_is_damaged_gives_no_hint(damage, at, period):
    """An option that reads the damaged line alone is not one that reads the lines."""
    line = open_line()
    texts = [join(vary(n, False)) + b"\n" for n in range(30)]
    texts[20] = texts[20][:at] + damage + texts[20][at:]
    assert len(read_lines(line, texts, period)) >= 29
    assert "; give " not in line.why


def test_star_in_a_text_of_an_object_is_no_checksum():
    text = json.dumps({"unit": "a*b", "v": COUNTS}).encode() + b"\n"
    assert len(read_lines(open_line(), [text] * 3)) == 3


def test_label_with_which_no_line_begins_any_more_is_told():
    line = open_line(",label=12:00:00.000 ->")
    texts = [SKETCHES["time of day"](n, COUNTS) for n in range(60)]
    assert len(read_lines(line, texts)) == 1
    assert line.refused and "'csv:pad,label=* ->'" in line.why


def test_hexadecimal_lines_are_told_once_they_have_letters():
    """At rest the digits may be those of decimal numbers of several tens."""
    line = open_line()
    rest = [f"{0x100 + 16 * (n % 3) + n % 9:03X}" for n in range(len(COUNTS))]
    touched = [*rest[2:], "1FA", "2BC"]
    assert len(read_lines(line, [join(rest) + b"\n"] * 9)) == 9
    several = [join(touched) + b"\n"] * 20 + [join(rest) + b"\n"]
    assert not read_lines(line, several)
    assert "hexadecimal" in line.why and ",base=16" in line.why
    line.note_reported()
    assert len(read_lines(line, [join(COUNTS) + b"\n"] * 60)) >= 39


@given(st.binary(max_size=60))
def test_no_line_raises(body):
    for options in ("", ",time=ms", ",base=16", ",label=a*", ",last=ignore"):
        line = open_line(options)
        read_lines(line, [body + b"\n", b'{"t":' + body + b"}\n"])
        assert line.why.isprintable()


@given(JSON)
def test_no_object_raises(value):
    line = open_line(",time=ms")
    read_lines(line, [json.dumps({"t": 1, "v": value}).encode() + b"\n"])


@pytest.mark.parametrize("unit", ["us", "ms", "s"])
@pytest.mark.parametrize("name", ["time", "unit"])
def test_time_of_an_object_is_used_in_its_unit(unit, name):
    name = {"us": "us", "ms": "ms", "s": "t"}[unit] if name == "unit" else name
    per_second = {"us": 10**6, "ms": 1000, "s": 1}[unit]
    texts = [
        json.dumps({"seq": n, name: n * per_second / 25, "v": ROWS_OF}).encode()
        for n in range(1, 80)
    ]
    line = open_line(f",time={unit}")
    samples = read_lines(line, [text + b"\n" for text in texts], 40 * MS)
    assert len(samples) > 70 and not line.refused
    assert np.diff([sample.stamp for sample in samples]) == pytest.approx(40 * MS, 0.02)


@pytest.mark.parametrize("size", range(ROWS * COLUMNS * 2 + 3))
def test_line_of_another_size_is_never_read(size):
    line = open_line(missing=(3, 9))
    samples = read_lines(line, [join(range(400, 400 + size)) + b"\n"] * 9)
    assert bool(samples) == (size in (ROWS * COLUMNS - 2, ROWS * COLUMNS))
    assert samples or size == 0 or line.refused


def test_line_that_lost_a_separator_is_not_taken_for_the_other_form():
    line = open_line(missing=(3, 9))
    good, short = (join([400 + n for n in range(size)]) + b"\n" for size in (30, 28))
    assert len(read_lines(line, [good, good, short, good, good])) == 4


@given(st.lists(st.floats(0.5, 1.5), min_size=16, max_size=60), st.floats(-0.3, 3.3))
@settings(max_examples=50)
def test_rate_is_that_of_the_typical_interval(steps, power):
    period = SECOND / 10**power
    even = np.cumsum(np.full(len(steps), period))
    jitter = 0.3 * period * (np.array(steps) - 1)
    assert estimate_rate((even + jitter).astype(int).tolist()) == pytest.approx(
        10**power, rel=0.1
    )


def test_lines_that_lay_unread_are_not_used():
    line = open_line()
    read_lines(line, [])
    line.empty_at = 0
    lines = [join(COUNTS)] * 20
    assert {sample.stamp for sample in line.push_lines(lines, SECOND)} == {0}
    assert not line.refused
    assert [sample.stamp for sample in line.push_lines(lines[:1], SECOND + MS)] == [
        SECOND + MS
    ]


@pytest.mark.parametrize("rate", [20, 50, 200])
@pytest.mark.parametrize("in_pieces", [False, True])
def test_lines_of_a_burst_are_stamped_when_they_were_made(rate, in_pieces):
    line = open_line()
    errors = []
    made = np.arange(1, 5 * rate) * SECOND // rate
    arrived = -(-made // (160 * MS)) * 160 * MS
    for at in np.unique(arrived).tolist():
        due = made[arrived == at].tolist()
        for k, part in enumerate([[one] for one in due] if in_pieces else [due]):
            samples = line.push_lines([join(COUNTS)] * len(part), at + k * MS // 10)
            errors += [abs(s.stamp - m) for s, m in zip(samples, part, strict=True)]
    # After a second the interval is known.
    assert max(errors[rate:]) <= SECOND // rate + 20 * MS


@given(
    st.lists(
        st.tuples(
            st.text("0123,;", max_size=30).map(str.encode),
            st.sampled_from((b"\n", b"\r\n", b"\n\r", b"\r")),
        ),
        max_size=8,
    ),
    st.integers(1, 7),
)
def test_lines_are_found_however_bytes_are_cut(parts, size):
    data = b"".join(part + end for part, end in parts)
    whole = LineDeframer()
    cut = LineDeframer()
    found = [
        line
        for at in range(0, len(data), size)
        for line in cut.push_chunk(data[at : at + size])
    ]
    assert whole.push_chunk(data) == found == END.split(data)[1:-1]


@pytest.fixture
def line():
    """The line of a matrix at a port that sends nothing."""
    return open_line()


def test_line_with_checksum_is_refused_when_any_byte_is_changed(line):
    counts = list(range(0, 3000, 100))
    good = format_line(counts, 1_020_000, True).strip()
    time, found, _ = line.parse(good)
    assert (time, found.tolist()) == (1_020_000, counts)
    for at in range(len(good)):
        for flipped in (1, 2, 16, 128):
            bad = bytearray(good)
            bad[at] ^= flipped
            result = line.parse(bytes(bad))
            assert result is None or result[1].tolist() == counts, bytes(bad)


def test_line_without_checksum_is_refused_after_one_with(line):
    counts = list(range(40, 70))
    plain = format_line(counts).strip()
    assert line.parse(plain) is not None
    assert line.parse(format_line(counts, 5, True).strip()) is not None
    assert line.parse(plain) is None


@pytest.mark.parametrize(
    "bad",
    [
        b"1,2,3",
        b"1," * 29 + b"x",
        b"1," * 29 + b"70000",
        b"-1," * 30,
        b"1e999," * 30,
        b"@1",
    ],
)
def test_line_that_is_no_scan_is_refused_and_counted(line, bad):
    assert line.parse(bad) is None and line.counts["damaged"] == 1


def test_line_holds_all_cells_or_the_taxels_alone():
    counts = np.arange(40, 40 + ROWS * COLUMNS)
    keep = np.delete(counts, [4, 9])
    for text in (format_line(counts), format_line(keep)):
        found = open_line(missing=(4, 9)).parse(text.strip())
        assert found.counts.tolist() == keep.tolist()


@pytest.mark.skipif(COMPILER is None, reason="no C compiler: cc, gcc, clang")
@pytest.mark.parametrize("words", [(), ("bare",)], ids=["timed", "bare"])
def test_firmware_sends_the_scans_of_a_simulated_matrix(tmp_path, line, words):
    sources = [FIRMWARE / "eskin_matrix.c", FIRMWARE / "matrix_main.c"]
    program = tmp_path / "matrix"
    run_program(COMPILER, *STRICT, f"-I{FIRMWARE}", *sources, "-o", program)
    rng = np.random.default_rng(0)
    counts = rng.integers(0, 65_536, (20, ROWS * COLUMNS))
    times = rng.integers(0, 2**32, 20)
    given = "\n".join(
        f"{t} {' '.join(map(str, c))}" for t, c in zip(times, counts, strict=True)
    )
    size = (str(ROWS), str(COLUMNS))
    out = run_program(program, *size, *words, given=given.encode())
    parsed = [line.parse(text) for text in out.splitlines()]
    assert [one.counts.tolist() for one in parsed] == counts.tolist()
    assert [one.time for one in parsed] == ([None] * 20 if words else times.tolist())
    assert line.has_checksum == (not words)
