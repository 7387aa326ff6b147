"""`eskin run` from bytes or files to its last line, on a tiny budget."""

import json
import signal
import socket
import subprocess
import sys
import time

import pytest

from eskin.cli.main import run
from eskin.drivers import HostClock, PlayedSource
from eskin.errors import DeviceError
from eskin.recording import read_recording
from eskin.skin import save_skin
from helpers.devices import PATIENCE, RATE, playing, scans_of, small_skin, udp_skin
from helpers.live import Press, mounted, record, scans
from test_device_command import StillSimulator

KEYS = {"readings", "dropped", "detections", "commands"}


def call(capsys, *argv):
    code = run(["run", *map(str, argv)])
    out, err = capsys.readouterr()
    return code, out, err


@pytest.fixture
def touched(tmp_path):
    """A recording of one press."""
    stream = scans(mounted(), [Press(2.3, 2.7, 65, 65)], 50, 3.5)
    return record(tmp_path / "touched.mcap", mounted(), stream), len(stream)


def test_a_recording_is_recognised_and_counted(touched, capsys):
    path, count = touched
    code, out, err = call(capsys, "--source", f"replay:{path}", "--pace", 10, "--json")
    assert (code, err) == (0, "")
    result = json.loads(out.splitlines()[-1])
    assert set(result) >= KEYS
    assert (result["readings"], result["dropped"], result["commands"]) == (count, 0, 0)
    assert result["detections"] == 1
    assert "where" in out and f"{count} readings, 0 dropped" in out
    assert result["source"] == {"readings": count}
    assert result["queues"]["recognition"]["taken"] == count


def test_what_is_streamed_is_recorded_with_its_detections(touched, capsys, tmp_path):
    path, count = touched
    kept = tmp_path / "kept.mcap"
    words = ("--source", f"replay:{path}", "--pace", 10, "--record", kept)
    assert call(capsys, *words)[0] == 0
    recording = read_recording(kept)
    assert recording.count == count and not recording.truncated
    assert len(recording.detections) == 1
    assert recording.metadata.session == f"replay:{path}"


def test_a_simulated_person_plays_until_it_is_time(capsys, monkeypatch):
    monkeypatch.setattr("eskin.sim.dataset.Simulator", StillSimulator)
    code, out, _ = call(capsys, "--source", "sim:ur5", "--seconds", 0.5, "--json")
    result = json.loads(out.splitlines()[-1])
    assert code == 0 and 10 <= result["readings"] <= 60 and result["detections"] == 0


def test_patches_are_heard_over_udp(capsys, tmp_path):
    skin = small_skin()
    save_skin(skin, tmp_path / "skin")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    words = ("--skin", tmp_path / "skin", "--robot-urdf", "table", "--seconds", 1)
    with playing(udp_skin(skin, port), scans_of(skin, 10_000), HostClock()):
        code, out, err = call(
            capsys, "--source", f"udp://127.0.0.1:{port}", *words, "--json"
        )
    assert (code, err) == (0, "")
    result = json.loads(out.splitlines()[-1])
    assert set(result) >= KEYS
    assert result["source"]["datagrams"] > RATE and result["source"]["used"] > 0


def test_ctrl_c_finishes_the_recording(touched, tmp_path):
    path, count = touched
    kept = tmp_path / "kept.mcap"
    words = ["run", "--source", f"replay:{path}", "--pace", "0.5", "--json"]
    with subprocess.Popen(
        [sys.executable, "-m", "eskin.cli.main", *words, "--record", str(kept)],
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout is not None
        while "where" not in process.stdout.readline():
            assert process.poll() is None
        time.sleep(1.0)
        process.send_signal(signal.SIGINT)
        *_, last = process.stdout.read().splitlines()
        assert process.wait(PATIENCE) == 0
    result = json.loads(last)
    assert 0 < result["readings"] < count
    recording = read_recording(kept)
    assert recording.count == result["readings"] and not recording.truncated


def test_a_stream_that_fails_is_one_line_and_exit_code_1(touched, capsys, monkeypatch):
    path, _ = touched

    def lost(source, timeout=None):
        raise DeviceError("port is lost\nfor good")

    monkeypatch.setattr(PlayedSource, "read", lost)
    code, _, err = call(capsys, "--source", f"replay:{path}")
    assert code == 1
    assert "port is lost for good" in err and err.count("\n") == 1


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--source", "replay:nowhere.mcap"], "no recording at nowhere.mcap"),
        (["--source", "udp://127.0.0.1:9750"], "given without a skin"),
        (["--source", "can:0"], "allowed is one of serial:PATH"),
        (["--source", "sim:nose"], "nose"),
        (["--source", "sim:ur5", "--model", "nose"], "nose"),
        (["--source", "sim:ur5", "--seconds", "0"], "--seconds is 0.0; allowed"),
        (["--source", "sim:ur5", "--pace", "nan"], "--pace is nan; allowed"),
        (["--source", "sim:ur5", "--piece-mb", "1"], "without --record"),
        ([], "--source"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(words, said, capsys):
    code, out, err = call(capsys, *words)
    assert (code, out) == (2, "")
    assert said in err and err.count("\n") == 1


def test_a_recording_that_cannot_be_written_is_bad_input(touched, capsys, tmp_path):
    path, _ = touched
    words = ("--source", f"replay:{path}", "--record", tmp_path / "no" / "a.mcap")
    code, _, err = call(capsys, *words)
    assert code == 2 and err.count("\n") == 1
