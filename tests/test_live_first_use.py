"""Tests of the warm-up: nothing is compiled once a person is asked for something."""

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import helpers.guided
from eskin.drivers import HostClock, UdpTransport
from eskin.recording import Metadata, RecordingWriter, write_all
from eskin.skin import save_skin
from eskin.skin.wiring import choose_press_targets, find_nearest_taxel
from eskin.touch import Scan
from helpers.devices import PERIOD, playing, small_skin, udp_skin
from helpers.guided import CALIBRATION, SKIN, press, record, rest

pytestmark = pytest.mark.slow

PLACES = ((0.2, 0.2), (0.2, 0.8), (0.8, 0.2), (0.8, 0.8), (0.5, 0.5))


def find_late(*words):
    """Run a command in a process of its own; return what it compiles too late."""
    paths = (str(Path(__file__).parent), os.environ.get("PYTHONPATH", ""))
    done = subprocess.run(
        [sys.executable, "-m", "helpers.first_use", *map(str, words)],
        env=os.environ | {"PYTHONPATH": os.pathsep.join(paths)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Write recordings of rest and presses, of counts that rise and that fall."""
    folder = tmp_path_factory.mktemp("pressed")
    taxels = [
        find_nearest_taxel(SKIN, patch.id, place)
        for patch in SKIN.patches
        for place in PLACES
    ]
    above = rest(110) + [counts for taxel in taxels for counts in press(taxel)]
    asked = [target.taxel for target in choose_press_targets(SKIN)]
    wired = rest(70) + [counts for taxel in asked for counts in press(taxel)]
    record(folder / "wired.mcap", helpers.guided.make_scans(wired))
    save_skin(SKIN, folder / "skin")
    for name, falls in (("rise", False), ("fall", True)):
        metadata = Metadata("test", "nobody", "one")
        with RecordingWriter(
            folder / f"{name}.mcap", "table", SKIN, CALIBRATION, metadata
        ) as writer:
            scans = helpers.guided.make_scans(above)
            if falls:
                turn = CALIBRATION.turn_counts
                scans = (replace(scan, counts=turn(scan.counts)) for scan in scans)
            write_all(writer, scans, [])
    lines = ["patch,x_mm,y_mm,z_mm"]
    for taxel in taxels:
        patch = SKIN.patches[SKIN.patch_index[taxel]].id
        x, y, z = (1e3 * SKIN.positions[taxel]).tolist()
        lines.append(f"{patch},{x},{y},{z}")
    (folder / "points.csv").write_text("\n".join(lines) + "\n")
    return folder


@pytest.mark.parametrize("options", [(), ("--bits", "10"), ("--falling",)])
def test_calibration_compiles_nothing_after_its_first_request(options, folder):
    name = "fall" if options == ("--falling",) else "rise"
    out = folder / "c.json"
    source = f"replay:{folder / name}.mcap"
    assert find_late("calibrate", source, "--out", out, *options) == []


def test_calibration_of_counts_that_turn_compiles_nothing_either(folder):
    source = f"replay:{folder / 'fall'}.mcap"
    words = ("--presses", "4", "--out", folder / "c.json")
    assert find_late("calibrate", source, *words) == []


def test_guided_recording_compiles_nothing_after_its_first_request(folder):
    words = ("--gestures", "a", "none", "--times", "2", "--out", folder / "own.mcap")
    assert find_late("record", f"replay:{folder / 'rise'}.mcap", *words) == []


def test_pose_of_a_patch_compiles_nothing_after_its_first_request(folder):
    words = ("--points", folder / "points.csv", "--out", folder / "corrected")
    source = f"replay:{folder / 'rise'}.mcap"
    assert find_late("skin", "pose", source, *words) == []


def test_check_of_the_wiring_compiles_nothing_after_its_first_request(folder):
    words = ("--live", "--source", f"replay:{folder / 'wired.mcap'}")
    own = (folder / "skin", "--robot-urdf", "table")
    assert find_late("skin", "check", *own, *words) == []


@pytest.mark.parametrize(
    "options",
    [
        ("--source", "REPLAY", "--pace", "inf"),
        ("--source", "sim:ur5", "--robot", "sim:ur5", "--record", "RECORD"),
    ],
)
def test_run_compiles_nothing_once_touches_count(options, folder, tmp_path):
    names = {"REPLAY": f"replay:{folder / 'rise'}.mcap", "RECORD": tmp_path / "r.mcap"}
    words = [names.get(word, word) for word in options]
    late = find_late("run", *words, "--seconds", "6")
    assert [name for name in late if not name.startswith("eskin.sim.")] == []


def make_untouched(skin):
    """Yield scans of a skin at rest."""
    received = np.ones(skin.count, bool)
    for number in range(5000):
        counts = 100 + (np.arange(skin.count, dtype=np.int32) + number) % 2
        yield Scan(PERIOD * (number + 1), counts, received, np.zeros(0))


@pytest.mark.parametrize(
    "words",
    [
        ("calibrate", "DEVICE", "--presses", "0", "--seconds", "1", "--out", "FILE"),
        ("run", "--source", "DEVICE", "--seconds", "2", "--record", "FILE"),
    ],
)
def test_scans_of_a_device_do_not_wait_for_the_compiler(words, tmp_path):
    skin = small_skin()
    save_skin(skin, tmp_path / "skin")
    transport = UdpTransport(HostClock())
    port = transport.port
    transport.close()
    names = {"DEVICE": f"udp://127.0.0.1:{port}", "FILE": tmp_path / "file.mcap"}
    own = ("--skin", tmp_path / "skin", "--robot-urdf", "table")
    with playing(udp_skin(skin, port), make_untouched(skin), HostClock()):
        assert find_late(*(names.get(word, word) for word in words), *own) == []


@pytest.mark.long
@pytest.mark.parametrize("skin", ["ur5", "ur5-shapes"])
def test_demonstration_compiles_nothing_once_it_can_be_touched(skin):
    words = ("--skin", skin, "--port", "0", "--seconds", "12")
    assert find_late("demo", *words) == []
