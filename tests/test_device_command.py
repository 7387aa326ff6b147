"""`eskin device`: a skin that is not there, on a port that is."""

import json
import signal
import subprocess
import sys

import numpy as np
import pytest
from serial import Serial

from eskin.cli import device as command
from eskin.cli.main import run
from eskin.drivers import Data, decode_packet
from eskin.recording import Metadata, RecordingWriter
from eskin.robot import load_robot
from eskin.sim.dataset import ClipGenerator
from eskin.sim.dataset.clip import SimulatedClip
from eskin.skin import MountedSkin, build_grid_skin, save_skin
from eskin.touch import Calibration
from helpers.devices import (
    PATIENCE,
    listening,
    read_packets,
    scans_of,
    small_skin,
)

SCANS = 30


@pytest.fixture
def recorded(tmp_path):
    """A skin as a folder, and a recording of it."""
    skin = small_skin()
    save_skin(skin, tmp_path / "skin")
    path = tmp_path / "touched.mcap"
    calibration = Calibration.uniform(skin.count, 4095, 100.0)
    metadata = Metadata("own", "p1", "s1", "paper")
    with RecordingWriter(path, "table", skin, calibration, metadata) as writer:
        for scan in scans_of(skin, SCANS):
            writer.write(scan)
    return tmp_path / "skin", path


def test_a_recording_is_sent_as_datagrams_and_counted(recorded, capsys):
    skin, path = recorded
    with listening() as (heard, port):
        where = f"127.0.0.1:{port}"
        words = ["device", str(skin), "--udp", where, "--play", str(path), "--json"]
        assert run([*words, "--rate", "100", "--fault", "lose=0.2", "--seed", "3"]) == 0
        out = capsys.readouterr().out
        result = json.loads(out.splitlines()[-1])
        lost = result["faults"][0]["count"]
        packets = [heard.recv(2048) for _ in range(result["packets"] - lost)]
    assert f"udp://{where}" in out
    assert "Ctrl-C ends it" in out
    # Held twice each but for the last.
    assert result["scans"] == 2 * (SCANS - 1) + 1
    assert result["bytes"] == sum(len(packet) for packet in packets)
    assert result["unheard"] == 0
    assert result["faults"][0]["fault"] == "lose=0.2"
    sent = {tuple(p.counts) for p in map(decode_packet, packets) if isinstance(p, Data)}
    true = {tuple(s.counts[:12]) for s in scans_of(small_skin(), SCANS)}
    assert len(sent & true) > SCANS * 0.7


def test_a_pseudo_terminal_is_read_until_ctrl_c(recorded, tmp_path):
    skin, path = recorded
    link = tmp_path / "port"
    words = ["device", str(skin), "--link", str(link), "--play", str(path), "--json"]
    process = subprocess.Popen(
        [
            sys.executable,
            "-m",
            "eskin.cli.main",
            *words,
            "--rate",
            "2",
            "--fault=noisy",
        ],
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
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


class StillSimulator(ClipGenerator):
    """Somebody who only rests, of a small skin."""

    def __init__(self, name):
        self.robot_name = "table"
        self.mounted = MountedSkin(small_skin(), load_robot("table"))

    def calibration(self, build):
        return Calibration.uniform(self.mounted.skin.count, 4095, 100.0)

    def make(self, plan):
        counts = np.full((50, self.mounted.skin.count), 7, np.int32)
        received = np.ones(counts.shape, dtype=bool)
        return SimulatedClip(counts, received, np.zeros((50, 0)), (), 0, {})


def test_a_simulated_person_plays_until_it_is_time(recorded, capsys, monkeypatch):
    monkeypatch.setattr("eskin.sim.dataset.Simulator", StillSimulator)
    skin, _ = recorded
    words = ["device", str(skin), "--pty", "--ports", "3", "--seconds", "0.1", "--json"]
    assert run(words) == 0
    out = capsys.readouterr().out
    assert out.count("serial:") == 3
    result = json.loads(out.splitlines()[-1])
    assert result["scans"] == 5
    assert result["packets"] == result["unheard"] == 3 * (5 + 2)


def test_what_its_electronics_are_is_written_before_anything_is_sent(
    recorded, capsys, monkeypatch, tmp_path
):
    monkeypatch.setattr("eskin.sim.dataset.Simulator", StillSimulator)
    skin, path = recorded
    kept = tmp_path / "calibration.json"
    words = ["device", str(skin), "--seconds", "0.05", "--calibration", str(kept)]
    for play in ([], ["--play", str(path)]):
        assert run([*words, *play]) == 0
        found = Calibration.from_bytes(kept.read_bytes())
        assert (found.full_scale, len(found.gain)) == (4095, small_skin().count)
        kept.unlink()
    words[-1] = str(tmp_path / "no" / "a" / "folder")
    (tmp_path / "no").write_text("a file")
    assert run(words) == 2
    assert "cannot write" in capsys.readouterr().err


def test_that_it_leaves_the_computer_is_said(recorded, capsys, monkeypatch):
    skin, path = recorded
    sent = []
    monkeypatch.setattr(
        "eskin.drivers.virtual.UdpPort.send", lambda _, c: sent.append(c)
    )
    words = ["device", str(skin), "--play", str(path), "--rate", "1000"]
    assert run([*words, "--udp", "192.0.2.1:9750"]) == 0
    assert "leaves this computer" in capsys.readouterr().out
    assert sent
    assert command.is_loopback("localhost")
    assert command.is_loopback("127.0.0.2")
    assert not command.is_loopback("robot.local")


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["nose"], "no skin 'nose'"),
        (["ur5", "--fault", "explode"], "of no known kind"),
        (["ur5", "--fault", "lose:nose"], "upper_arm_front"),
        (["ur5", "--rate", "0"], "--rate is 0"),
        (["ur5", "--seconds", "nan"], "--seconds is nan"),
        (["ur5", "--seed", "-1"], "--seed is -1"),
        (["ur5", "--pty", "--udp", "127.0.0.1:9750"], "one transport"),
        (["ur5", "--play", "nowhere.mcap"], "no recording at nowhere.mcap"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(words, complaint, capsys):
    assert run(["device", *words]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert complaint in err
    assert err.count("\n") == 1


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (["--udp", "127.0.0.1"], "allowed is HOST:PORT"),
        (["--udp", "127.0.0.1:99999"], "allowed is HOST:PORT"),
        (["--udp", "127.0.0.1:0"], "allowed is HOST:PORT"),
        (["--udp", "a/b:1"], "allowed is HOST:PORT"),
        (["--ports", "4"], "--ports is 4; allowed are 1 to 3"),
        (["--link", "/nowhere/port"], "cannot open a pseudo-terminal"),
    ],
)
def test_bad_ports_are_one_line_and_exit_code_2(recorded, words, complaint, capsys):
    skin, path = recorded
    assert run(["device", str(skin), "--play", str(path), *words]) == 2
    err = capsys.readouterr().err
    assert complaint in err
    assert err.count("\n") == 1


def test_a_recording_of_another_skin_is_refused(recorded, capsys, tmp_path):
    _, path = recorded
    save_skin(
        build_grid_skin(2, small_skin().count // 2, name="long"), tmp_path / "long"
    )
    assert run(["device", str(tmp_path / "long"), "--play", str(path)]) == 2
    assert "is of skin 'small', not of 'long'" in capsys.readouterr().err
    assert run(["device", "ur5", "--play", str(path)]) == 2
    assert "is of skin 'small', not of 'ur5'" in capsys.readouterr().err
