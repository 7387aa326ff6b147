"""Tests of the commands about devices: `device` and `bench throughput`."""

import json
import signal
import subprocess
import sys

import pytest
from serial import Serial

from eskin.cli.main import run
from eskin.drivers import Data, decode_packet
from eskin.recording import Metadata, RecordingWriter
from eskin.robot import load_robot
from eskin.sim.bench import throughput
from eskin.sim.commands import device
from eskin.skin import build_grid_skin, save_skin
from eskin.touch import Calibration
from helpers.devices import (
    PATIENCE,
    StillSimulator,
    calibration_of,
    open_receiver,
    read_packets,
    scans_of,
    small_skin,
)

pytestmark = pytest.mark.slow

SCANS = 30
SKIN = small_skin()


@pytest.fixture
def skin(tmp_path):
    """Return the folder of a skin and its robot."""
    save_skin(SKIN, tmp_path / "skin", load_robot("table"))
    return str(tmp_path / "skin")


@pytest.fixture
def recording(tmp_path):
    path = tmp_path / "touched.mcap"
    metadata = Metadata("own", "p1", "s1", "paper")
    with RecordingWriter(path, "table", SKIN, calibration_of(SKIN), metadata) as writer:
        for scan in scans_of(SKIN, SCANS):
            writer.write(scan)
    return str(path)


@pytest.fixture
def still_person(monkeypatch):
    monkeypatch.setattr("eskin.sim.dataset.Simulator", StillSimulator)


def read_result(capsys):
    """Return the JSON of the last line, and the lines before."""
    *lines, last = capsys.readouterr().out.splitlines()
    return json.loads(last), lines


def check_refusal(capsys, words, *parts):
    """Check that a command exits with code 2 and one line that names what is wrong."""
    assert run(words) == 2
    out, err = capsys.readouterr()
    assert all(part in err for part in parts)
    assert err.count("\n") == 1
    return out


def test_recording_is_sent_as_datagrams_and_counted(skin, recording, capsys):
    with open_receiver() as (receiver, port):
        address = f"127.0.0.1:{port}"
        words = ["device", skin, "--udp", address, "--play", recording, "--json"]
        assert run([*words, "--rate", "100", "--fault", "lose=0.2", "--seed", "3"]) == 0
        result, lines = read_result(capsys)
        [fault] = result["faults"]
        count = result["packets"] - fault["count"]
        packets = [receiver.recv(2048) for _ in range(count)]
    assert any(f"udp://{address}" in line for line in lines)
    # Each is sent twice but for the last.
    assert result["scans"] == 2 * (SCANS - 1) + 1
    assert result["bytes"] == sum(len(packet) for packet in packets)
    assert (result["unheard"], fault["fault"]) == (0, "lose=0.2")
    sent = {tuple(p.counts) for p in map(decode_packet, packets) if isinstance(p, Data)}
    true = {tuple(scan.counts[:12]) for scan in scans_of(SKIN, SCANS)}
    assert len(sent & true) > SCANS * 0.7


def test_pseudo_terminal_is_open_until_ctrl_c(skin, recording, tmp_path):
    link = tmp_path / "port"
    words = ["device", skin, "--link", str(link), "--play", recording, "--json"]
    process = subprocess.Popen(
        [sys.executable, "-m", "eskin.cli.main", *words, "--rate=2", "--fault=noisy"],
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        with process.stdout as out:
            while f"serial:{link}" not in out.readline():
                assert process.poll() is None
            with Serial(str(link), timeout=PATIENCE) as line:
                packets = read_packets(line, 3)
                process.send_signal(signal.SIGINT)
                *_, last = out.read().splitlines()
        assert process.wait(PATIENCE) == 0
    finally:
        process.kill()
        process.wait()
    assert {packet.address for packet in packets} <= {1, 2, 3}
    assert json.loads(last)["scans"] > 0
    assert not link.is_symlink()


def test_simulated_person_plays_for_some_seconds(skin, capsys, still_person):
    words = ["device", skin, "--pty", "--ports", "3", "--seconds", "0.1", "--json"]
    assert run(words) == 0
    result, lines = read_result(capsys)
    assert sum("serial:" in line for line in lines) == 3
    assert result["scans"] == 5
    assert result["packets"] == result["unheard"] == 3 * (5 + 2)


def test_calibration_is_written(skin, recording, tmp_path, capsys, still_person):
    path = tmp_path / "calibration.json"
    words = ["device", skin, "--seconds", "0.05", "--calibration"]
    for play in ([], ["--play", recording]):
        assert run([*words, str(path), *play]) == 0
        found = Calibration.from_bytes(path.read_bytes())
        assert (found.full_scale, len(found.gain)) == (4095, SKIN.count)
        path.unlink()
    (tmp_path / "no").write_text("a file")
    capsys.readouterr()
    check_refusal(capsys, [*words, str(tmp_path / "no/a/file")], "no/a")


def test_packets_that_leave_the_computer_are_announced(
    skin, recording, capsys, monkeypatch
):
    sent = []
    monkeypatch.setattr(
        "eskin.sim.virtual.UdpPort.send", lambda _, chunks: sent.append(chunks)
    )
    words = ["device", skin, "--play", recording, "--rate", "1000"]
    assert run([*words, "--udp", "192.0.2.1:9750"]) == 0
    assert "leaves this computer" in capsys.readouterr().out
    assert sent
    hosts = "localhost", "127.0.0.2", "robot.local"
    assert [device.is_loopback(host) for host in hosts] == [True, True, False]


@pytest.mark.parametrize(
    ("words", "part"),
    [
        (["device", "nose"], "'nose'"),
        (["device", "ur5", "--fault", "explode"], "explode"),
        (["device", "ur5", "--fault", "lose:nose"], "upper_arm_front"),
        (["device", "ur5", "--rate", "0"], "--rate is 0"),
        (["device", "ur5", "--seconds", "nan"], "--seconds is nan"),
        (["device", "ur5", "--seed", "-1"], "--seed is -1"),
        (["device", "ur5", "--pty", "--udp", "127.0.0.1:9750"], "--udp"),
        (["device", "ur5", "--play", "nowhere.mcap"], "nowhere.mcap"),
        (["bench", "throughput", "--rate", "0"], "--rate is 0"),
        (["bench", "throughput", "--seconds", "-1"], "--seconds is -1"),
        (["bench", "throughput", "--over", "radio"], "radio"),
    ],
)
def test_invalid_option_is_refused(words, part, capsys):
    assert check_refusal(capsys, words, part) == ""


@pytest.mark.parametrize(
    ("words", "parts"),
    [
        (["--udp", "127.0.0.1"], ["HOST:PORT"]),
        (["--udp", "127.0.0.1:99999"], ["HOST:PORT"]),
        (["--udp", "127.0.0.1:0"], ["HOST:PORT"]),
        (["--udp", "a/b:1"], ["HOST:PORT"]),
        (["--ports", "4"], ["--ports is 4", "1 to 3"]),
        (["--link", "/nowhere/port"], ["/nowhere/port"]),
    ],
)
def test_invalid_port_is_refused(skin, recording, words, parts, capsys):
    check_refusal(capsys, ["device", skin, "--play", recording, *words], *parts)


def test_recording_of_another_skin_is_refused(recording, capsys, tmp_path):
    # It has as many taxels.
    save_skin(build_grid_skin(2, SKIN.count // 2, name="long"), tmp_path / "long")
    for name, skin in (("long", str(tmp_path / "long")), ("ur5", "ur5")):
        words = ["device", skin, "--play", recording]
        check_refusal(capsys, words, "'small'", f"'{name}'")


@pytest.mark.parametrize("over", ["udp", "serial"])
def test_throughput_is_measured(over, capsys, monkeypatch):
    monkeypatch.setattr(throughput, "SETTLE_S", 0.5)
    words = ["--rate", "50", "--seconds", "0.5", "--over", over, "--json"]
    assert run(["bench", "throughput", *words]) == 0
    result, _ = read_result(capsys)
    assert set(result) == {"rate_hz", "dropped", "cpu", "rows"}
    assert result["cpu"] > 0
    [row] = result["rows"]
    assert (row["over"], row["asked_hz"]) == (over, 50.0)


def test_limit_of_throughput_is_where_readings_first_drop(monkeypatch):
    tried = []

    def measure(over, rate, seconds):
        tried.append(rate)
        return throughput.ThroughputResult(
            over, rate, rate, int(rate > 3100), 0.5, 1.0, 1.0, 1.0, 0.3, 1, {}
        )

    monkeypatch.setattr(throughput, "measure_throughput", measure)
    assert 3100 < throughput.find_limit("udp", 1000.0) <= 3250
    assert tried[:3] == [1000.0, 2000.0, 4000.0] and len(tried) == 7
