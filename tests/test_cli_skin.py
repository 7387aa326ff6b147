"""Tests of `eskin skin check --live`: presses asked for, and the answers to them."""

from dataclasses import replace
from importlib import resources
from itertools import islice

import numpy as np
import pytest

import eskin.app
from eskin.calibration.wiring_guide import WiringGuide
from eskin.cli.guided import guide_person
from eskin.cli.main import run
from eskin.design.commands.check import WiringDialogue
from eskin.drivers import STEPPED, ManualClock, PlayedSource, SourceInfo
from eskin.skin import mount_skin, save_skin
from eskin.skin.wiring import choose_press_targets
from eskin.touch import Calibration, Scan
from eskin.units import NS_PER_S
from helpers.devices import PERIOD, RATE, mounted_small, small_skin

pytestmark = pytest.mark.slow

SKIN = small_skin()
LEFT, MIDDLE, RIGHT = (
    SKIN.find_taxels(name).tolist() for name in ("left", "middle", "right")
)
CALIBRATION = Calibration.uniform(SKIN.count, 4095, 400.0)
REST = 200
PRESSED = 1000
"""Counts at rest, and those that a press adds."""
UNTOUCHED = 155
"""Scans before the first press, for taring."""
INTERVAL = 36
LENGTH = 10
"""Scans from press to press, and of each."""
RISE = 3
"""Scans in which a finger lands."""


def make_scans(respond=int):
    """Press every target as it is asked for; `respond` gives the taxel that answers."""
    taxels = [respond(target.taxel) for target in choose_press_targets(SKIN)]
    for number in range(UNTOUCHED + INTERVAL * (len(taxels) + 1)):
        counts = REST + (np.arange(SKIN.count, dtype=np.int32) + number) % 2
        press, phase = divmod(number - UNTOUCHED, INTERVAL)
        if 0 <= press < len(taxels) and phase < LENGTH:
            counts[taxels[press]] += round(PRESSED * min(1.0, (phase + 1) / RISE))
        received = np.ones(SKIN.count, bool)
        yield Scan(PERIOD * (number + 1), counts, received, np.zeros(0))


def play(scans, robot="table"):
    info = SourceInfo("test:", mount_skin(SKIN, robot), CALIBRATION, RATE)
    return PlayedSource(info, scans, STEPPED, ManualClock())


@pytest.fixture
def check(tmp_path, monkeypatch, capsys):
    """Run the command on a skin, and return its exit code and output."""
    save_skin(SKIN, tmp_path)

    def check(respond=int, robot="table", length=None):
        scans = islice(make_scans(respond), length)
        source = play(scans, robot)
        monkeypatch.setattr(eskin.app, "open_source", lambda *_, **__: source)
        arguments = ["--robot-urdf", str(robot), "--live", "--source", "udp://a:1"]
        code = run(["skin", "check", str(tmp_path), *arguments])
        return code, *capsys.readouterr()

    return check


def test_skin_wired_as_its_file_says_passes(check, tmp_path):
    """Also on a robot that has a file of its own."""
    table = resources.files("eskin.robot") / "presets" / "table.urdf"
    robot = tmp_path / "mine.urdf"
    robot.write_text(table.read_text().replace('name="table"', 'name="mine"', 1))
    code, out, _ = check(robot=robot)
    assert code == 0
    assert out.count("felt on") == 9
    assert "every patch answered" in out


@pytest.mark.parametrize(
    ("answers", "wrong"),
    [
        (
            dict(zip(LEFT + RIGHT, RIGHT + LEFT, strict=True)),
            [("left", "right"), ("right", "left")],
        ),
        (dict.fromkeys(MIDDLE, RIGHT[-1]), [("middle", "right")]),
    ],
    ids=["exchanged plugs", "patch that answers for another"],
)
def test_wrong_wiring_is_named(check, answers, wrong):
    code, out, err = check(lambda taxel: answers.get(taxel, taxel))
    assert code == 2
    for pressed, responded in wrong:
        assert f"'{pressed}' was pressed, '{responded}' responded" in out
    assert err.count("\n") == 1


def test_press_that_does_not_come_is_told_after_ten_seconds(capsys):
    [rest, *_] = make_scans()
    scans = [
        replace(rest, stamp=PERIOD * number) for number in range(1, round(16 * RATE))
    ]
    guide = WiringGuide(mounted_small(), CALIBRATION)
    guide_person(scans, WiringDialogue(guide), 12.0)
    out = capsys.readouterr().out
    assert "nothing was felt for 10 s; " in out and "0.5 N for 0.15 s" in out
    assert out.count("nothing felt: the press is left out") == 1
    assert [answer.taxel for answer in guide.finish()] == [None] * 9


def test_touch_does_not_end_the_time_at_rest():
    guide = WiringGuide(mounted_small(), CALIBRATION)
    scans = list(make_scans())[UNTOUCHED - 60 :]
    number = 0
    while guide.phase == "rest":
        guide.push(scans[number])
        number += 1
    passed = scans[number - 1].stamp - scans[0].stamp
    assert passed == guide.rest_seconds * NS_PER_S


def test_skin_that_sends_too_little_is_refused_in_one_line(check):
    code, _, err = check(length=20)
    assert code == 2
    assert (
        err.startswith("error: the skin was not at rest for 3 s")
        and err.count("\n") == 1
    )


def test_live_check_needs_a_source(tmp_path, capsys):
    save_skin(SKIN, tmp_path)
    assert run(["skin", "check", str(tmp_path), "--robot", "table", "--live"]) == 2
    assert "--source" in capsys.readouterr().err
