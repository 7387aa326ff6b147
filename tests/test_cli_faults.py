"""Tests of the lines of faults: the commands that read a skin print them alike."""

import re
from dataclasses import replace

import numpy as np
import pytest

from eskin.calibration import CalibrationGuide
from eskin.cli.calibrate import CalibrationDialogue
from eskin.cli.guided import guide_person
from eskin.cli.record import LabelWriter, record_attempts
from eskin.cli.terminal import SkinPrinter, TerminalPrinter
from eskin.drivers import Event, ManualClock, SourceInfo
from eskin.recording.guided import RecordingGuide
from eskin.skin import mount_skin
from eskin.stream import Context, FaultReporter
from eskin.touch import Fault
from helpers.cli import call_json
from helpers.guided import (
    CALIBRATION,
    MOUNTED,
    RATE,
    SKIN,
    make_scans,
    press,
    press_counts,
    record,
    rest,
)
from helpers.live import model_of, network

LINE = re.compile(
    r"^ *(?P<seconds>[\d.]+)s  (?P<text>(fault|mended) .*)$", re.MULTILINE
)
DEAD = (SKIN.patch_index == 0) & (SKIN.columns == 5)
OTHER = SKIN.patch_index == 1
SECONDS = 100
PRESSED = (9, 18, 27)


def spoil(scans, dead_from=8.0, flaps=True):
    """Yield scans with a dead column, and a patch that sends off and on."""
    for scan in scans:
        seconds = scan.stamp * 1e-9
        if seconds >= dead_from:
            scan = replace(scan, counts=np.where(DEAD, 0, scan.counts))
        is_loose = 20 <= seconds < 32 or seconds >= SECONDS - 6
        if flaps and is_loose and seconds % 3 < 1.5:
            scan = replace(scan, received=scan.received & ~OTHER)
        yield scan


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("faults")


@pytest.fixture(scope="module")
def model(folder):
    model_of(network()).save(folder / "m.safetensors")
    return folder / "m.safetensors"


def build_recording(path, **options):
    above = rest(7 * RATE) + [scan for taxel in PRESSED for scan in press(taxel)]
    above += rest(SECONDS * RATE - len(above))
    return record(path, spoil(make_scans(above), **options))


@pytest.fixture(scope="module")
def recording(folder):
    return build_recording(folder / "a.mcap")


def find_lines(printed):
    return [found["text"] for found in LINE.finditer(printed)]


def build_words(command, recording, folder, model):
    """Return a command that reads a recording to its end."""
    source = f"replay:{recording}"
    return {
        "replay": ("replay", recording, "--model", model),
        "run": ("run", "--source", source, "--model", model, "--pace", "inf"),
        "record": (
            "record",
            source,
            "--out",
            recording.with_suffix(".own.mcap"),
            "--gestures",
            "knock",
            "none",
            "--times",
            "9",
        ),
        "calibrate": ("calibrate", source, "--out", folder / "c.json"),
    }[command]


@pytest.mark.parametrize("command", ["run", "record", "calibrate"])
def test_commands_print_the_same_lines_of_faults(
    command, recording, folder, model, capsys
):
    words = build_words("replay", recording, folder, model)
    expected = find_lines(call_json(capsys, *words)[1])
    kinds = [line.split()[0] for line in expected]
    assert kinds == ["fault", "fault", "fault", "mended", "fault", "fault"]
    assert "column 5 of 0 to 7 of patch 'p0'" in expected[0]
    assert all("patch 'p1'" in line for line in expected[1:])
    assert "3 times in 60 s" in expected[2]
    # What is not told yet is told at the end.
    assert "2 times in 6 s" in expected[5]
    words = build_words(command, recording, folder, model)
    assert find_lines(call_json(capsys, *words)[1]) == expected


@pytest.mark.parametrize("command", ["replay", "run", "record", "calibrate"])
def test_column_that_is_dead_from_the_start_is_told_once(
    command, folder, model, capsys
):
    recording = build_recording(folder / f"{command}.mcap", dead_from=0.0, flaps=False)
    words = build_words(command, recording, folder, model)
    printed = call_json(capsys, *words)[1]
    [line] = find_lines(printed)
    assert "column 5 of 0 to 7 of patch 'p0' is faulty and not used" in line
    if command == "calibrate":
        assert "\nleft out: column 5 of 0 to 7 of patch 'p0'" in printed


def test_stream_and_scans_have_one_form_of_line(capsys):
    fault = Fault("column", "p0", None, 5, None, 0)
    [event] = FaultReporter(SKIN).report_faults(7_000_000_000, [fault])
    info = SourceInfo("test:", mount_skin(SKIN, "table"), CALIBRATION, float(RATE))
    stream = TerminalPrinter()
    stream.start(Context(info, ManualClock(0), lambda _: None))
    stream.on_message(event)
    scans = SkinPrinter(SKIN)
    scans.print_reading(0, [])
    scans.print_reading(7_000_000_000, [fault])
    _, one, other = capsys.readouterr().out.splitlines()
    assert one == other and LINE.match(one)


class ToldSource:
    """A source of scans at rest that tells once that lines are damaged."""

    def __init__(self):
        self.events = [Event(0, "damaged", "3 lines are not read", None)]

    def __iter__(self):
        return iter(make_scans(rest(150)))

    def take_events(self):
        events = self.events
        self.events = []
        return events


class NoWriter:
    """A writer that writes nothing."""

    def write(self, scan):
        pass


@pytest.mark.parametrize("command", ["record", "calibrate"])
def test_what_the_source_tells_is_printed_while_a_person_is_guided(command, capsys):
    source = ToldSource()
    if command == "record":
        guide = RecordingGuide(MOUNTED, CALIBRATION, ("knock", "none"), 1)
        writer = NoWriter()
        printer = SkinPrinter(SKIN)
        record_attempts(source, guide, writer, printer, LabelWriter(writer))
    else:
        dialogue = CalibrationDialogue(CalibrationGuide(MOUNTED, CALIBRATION))
        guide_person(source, dialogue, 30.0, None, source.take_events)
    lines = capsys.readouterr().out.splitlines()
    assert sum("3 lines are not read" in line for line in lines) == 1


def test_calibration_tells_what_was_felt_last_after_ten_seconds(capsys):
    dialogue = CalibrationDialogue(CalibrationGuide(MOUNTED, CALIBRATION))
    brief = [press_counts(19)] * 2
    guide_person(make_scans(rest(120) + brief + rest(290)), dialogue, 30.0)
    told = [line for line in capsys.readouterr().out.splitlines() if "felt" in line]
    assert told[0].startswith("nothing was felt for 10 s; ")
    assert "; last felt: 0.05 s, " in told[0]
    assert "of patch 'p0', " in told[0] and "0.5 N for 0.15 s" in told[0]
