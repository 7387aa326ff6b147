"""Tests of the files that a reading passes: none are counted where nothing came."""

import sys
import threading

import pytest

import eskin
from eskin.touch import Calibration
from lab import reading_path

SKIN = eskin.load_skin("ur5")
CALIBRATION = Calibration.uniform(SKIN.count, 4095, 100.0)


def refuse(capsys):
    """Return the line with which the program fails; it prints no count."""
    assert reading_path.main() == 1
    out, err = capsys.readouterr()
    assert out == ""
    (line,) = err.splitlines()
    return line


@pytest.mark.parametrize(
    ("code", "is_calibrated", "part"),
    [("import time; time.sleep(9)", True, "udp://"), ("pass", False, "calibration")],
    ids=["silent", "ended"],
)
def test_sender_that_sends_nothing_fails(
    monkeypatch, capsys, code, is_calibrated, part
):
    def build_sender(path):
        if is_calibrated:
            path.write_bytes(CALIBRATION.to_bytes())
        return [sys.executable, "-c", code]

    monkeypatch.setattr(reading_path, "build_sender", build_sender)
    monkeypatch.setattr(reading_path, "PATIENCE", 0.2)
    line = refuse(capsys)
    assert line.startswith("error: ") and part in line


@pytest.mark.parametrize(("count", "found"), [(0, 0), (1551, 0), (1551, 4)])
def test_too_few_detections_fail(monkeypatch, capsys, count, found):
    def receive_sent(profiler):
        profiler.lengths = [30] * count
        return found

    monkeypatch.setattr(reading_path, "receive_sent", receive_sent)
    assert f"got {found} detections in {count} profiled readings" in refuse(capsys)


def test_files_are_counted_for_each_reading():
    profiler = reading_path.Profiler()
    try:
        profiler.on = True
        assert SKIN.count > 0
        profiler.end_reading()
        profiler.end_reading()
    finally:
        sys.setprofile(None)
        threading.setprofile(None)
    assert profiler.lengths == [1, 0]
