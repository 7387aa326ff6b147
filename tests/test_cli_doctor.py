"""Tests of `eskin doctor`. They come first, since it compiles what other tests call."""

import threading
import time
from dataclasses import replace
from itertools import count

import pytest

from eskin.cli import doctor
from eskin.drivers import HostClock, SerialPortInfo, SourceInfo, UdpTransport
from eskin.errors import ModelError
from eskin.sim.virtual import parse_fault
from eskin.skin import mount_skin, save_skin
from helpers.cli import assert_refused, call, call_json
from helpers.devices import calibration_of, playing, scans_of, small_skin, udp_skin
from test_drivers_devices import Pad, matrix_skin

pytestmark = pytest.mark.slow

SKIN = small_skin()
SOURCE = SourceInfo("test:", mount_skin(SKIN, "table"), calibration_of(SKIN), 50.0)


def test_doctor_passes_and_leaves_nothing_to_compile(capsys):
    result, out = call_json(capsys, "doctor")
    for line, check in zip(out.splitlines(), result["checks"], strict=False):
        assert check["ok"] and line.startswith("ok")
        assert check["name"] in line and check["found"] in line
    assert "weights ur5: recognises" in out
    assert "compiled code was ready" in call(capsys, "doctor")[1].splitlines()[-1]


@pytest.mark.parametrize("rate", [0.5, 2.0, 3.0, 50.0])
def test_patch_at_its_rate_is_in_order_and_one_that_is_late_or_seldom_is_not(rate):
    info = replace(SOURCE, rate=rate)
    assert doctor.check_patch("left", rate, 1.0 / rate, info).ok
    assert not doctor.check_patch("left", 0.5 * rate, 1.0 / rate, info).ok
    assert not doctor.check_patch("left", rate, 4.0 / rate + 0.5, info).ok


def test_doctor_names_what_is_wrong_and_what_may_be_missing(capsys, monkeypatch):
    def fail(_model):
        raise ModelError("file is torn")

    monkeypatch.setattr(doctor, "check_model", fail)
    monkeypatch.setattr(doctor, "TRAINING_PACKAGES", ("not-there",))
    lines = assert_refused(capsys, "doctor", part="weights ur5").splitlines()
    assert any("WRONG weights ur5: file is torn" in line for line in lines)
    [training] = [line for line in lines if "for training" in line]
    assert training.startswith("ok") and "pip install" in training


def test_doctor_tells_how_to_be_allowed_to_use_a_port():
    [nothing] = doctor.check_ports([])
    usable, locked = doctor.check_ports(
        [
            SerialPortInfo("/dev/ttyACM0", "patch 1234", usable=True),
            SerialPortInfo("/dev/ttyACM1", "patch 1235", usable=False),
        ]
    )
    assert nothing.ok and usable.ok and not locked.ok
    assert usable.found == "patch 1234"
    assert "/dev/ttyACM1" in locked.name and "dialout" in locked.found


def test_doctor_listens_to_every_patch(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(doctor, "run_checks", lambda: ())
    save_skin(SKIN, tmp_path / "skin")
    transport = UdpTransport(HostClock())
    port = transport.port
    transport.close()
    device = udp_skin(SKIN, port, faults=[parse_fault("unplug:left", SKIN)])
    words = ["doctor", "--source", f"udp://127.0.0.1:{port}", "--robot-urdf", "table"]
    with playing(device, scans_of(SKIN, 1000), HostClock()):
        words += ["--skin", tmp_path / "skin"]
        lines = assert_refused(capsys, *words, part="patch left")
    *_, driver, left, middle, right = lines.splitlines()
    assert driver.startswith("ok    driver")
    assert left.startswith("WRONG patch left: no scans")
    assert middle.startswith("ok") and right.startswith("ok")
    assert "scans a second" in right


def test_doctor_says_that_a_board_sends_lines_where_packets_are_read(
    tmp_path, capsys, monkeypatch
):
    monkeypatch.setattr(doctor, "run_checks", lambda: ())
    save_skin(matrix_skin(), tmp_path / "skin")
    pad = Pad(tmp_path, timed=False)
    port = tmp_path / "port"
    stop = threading.Event()

    def send():
        number = 0
        while not stop.wait(0.005):
            pad.send(time.time_ns(), number)
            number += 1

    sender = threading.Thread(target=send)
    sender.start()
    try:
        words = ["--skin", tmp_path / "skin", "--robot-urdf", "table"]
        out = assert_refused(
            capsys, "doctor", "--source", f"serial:{port}", *words, part="data"
        )
    finally:
        stop.set()
        sender.join()
        pad.close()
    assert f"csv:{port} reads lines of numbers" in out


@pytest.mark.parametrize("rate", [2.0, 10.0])
def test_doctor_listens_to_a_slow_matrix_and_tells_what_an_arm_needs(
    rate, tmp_path, capsys, monkeypatch
):
    monkeypatch.setattr(doctor, "run_checks", lambda: ())
    save_skin(matrix_skin(), tmp_path / "skin")
    pad = Pad(tmp_path, timed=False)
    stop = threading.Event()

    def send():
        for number in count():
            pad.send(time.time_ns(), number)
            if stop.wait(1.0 / rate):
                return

    sender = threading.Thread(target=send)
    sender.start()
    try:
        words = ["--skin", tmp_path / "skin", "--robot-urdf", "table"]
        code, out, err = call(capsys, "doctor", "--source", pad.uri, *words)
    finally:
        stop.set()
        sender.join()
        pad.close()
    assert (code, err) == (0, "")
    assert "below the 20 that an arm needs" in out and "--baud" in out
    assert out.splitlines()[-1].startswith("ok    patch")
