"""Presses asked for on a live skin, and what their answers tell."""

from importlib import resources

import numpy as np
import pytest

import eskin.app
from eskin.cli.main import run
from eskin.cli.skin import TARE_S, tare
from eskin.drivers import STEPPED, ManualClock, PlayedSource, SourceInfo
from eskin.robot import load_robot
from eskin.skin import MountedSkin, save_skin
from eskin.skin.wiring import choose_press_targets
from eskin.touch import Calibration, Scan, TouchPipeline
from helpers.devices import PERIOD, small_skin

REST, PRESSED = 200, 1200
BETWEEN, LENGTH = 40, 20
FIRST = 170
"""Scans before the first press, for taring."""


def presses(skin, answering):
    """Every spot pressed in the order in which it is asked for."""
    spots = [answering(spot.taxel) for spot in choose_press_targets(skin)]
    everywhere = np.ones(skin.count, bool)
    for number in range(FIRST + BETWEEN * (len(spots) + 3)):
        counts = np.full(skin.count, REST, np.int32)
        counts += (np.arange(skin.count) + number) % 2
        place, phase = divmod(number - FIRST, BETWEEN)
        if 0 <= place < len(spots) and phase < LENGTH:
            counts[spots[place]] = PRESSED
        yield Scan(PERIOD * (number + 1), counts, everywhere, np.zeros(0))


@pytest.fixture
def check_live(tmp_path, monkeypatch):
    """The command, on a skin whose taxels answer by a rule."""
    skin = small_skin()
    save_skin(skin, tmp_path)
    calibration = Calibration.uniform(skin.count, 4095, 400.0)

    def check(answering=lambda taxel: taxel, robot="table"):
        name = load_robot(robot).name
        info = SourceInfo("test:", name, (), skin, calibration, 50.0)
        scans = presses(skin, answering)
        source = PlayedSource(info, scans, STEPPED, ManualClock())
        monkeypatch.setattr(eskin.app, "open_source", lambda *_, **__: source)
        arguments = ["--robot", str(robot), "--live", "--source", "test:"]
        return run(["skin", "check", str(tmp_path), *arguments])

    return check


def test_a_skin_as_its_file_says_answers_every_press(check_live, capsys):
    assert check_live() == 0
    out = capsys.readouterr().out
    assert out.count("felt at") == 9
    assert "every patch answered where it was pressed" in out


def test_a_robot_of_ones_own_is_taken_from_its_file(check_live, tmp_path, capsys):
    table = resources.files("eskin.robot") / "presets" / "table.urdf"
    mine = tmp_path / "mine.urdf"
    mine.write_text(table.read_text().replace('name="table"', 'name="mine"', 1))
    assert load_robot(mine).name == "mine"
    assert check_live(robot=mine) == 0
    assert capsys.readouterr().out.count("felt at") == 9


def test_a_touch_does_not_end_taring():
    skin = small_skin()
    calibration = Calibration.uniform(skin.count, 4095, 400.0)
    info = SourceInfo("test:", "table", (), skin, calibration, 50.0)
    scans = list(presses(skin, lambda taxel: taxel))[FIRST - 60 :]
    source = PlayedSource(info, scans, STEPPED, ManualClock())
    tare(source, TouchPipeline(MountedSkin(skin, load_robot("table")), calibration))
    assert source.counters()["readings"] == TARE_S * 50 + 1


def test_exchanged_plugs_are_named(check_live, capsys):
    skin = small_skin()
    left, right = skin.find_taxels("left").tolist(), skin.find_taxels("right").tolist()
    exchanged = dict(zip(left + right, right + left, strict=True))
    assert check_live(lambda taxel: exchanged.get(taxel, taxel)) == 2
    out, err = capsys.readouterr()
    assert "where patch 'left' was pressed, 'right' responded" in out
    assert "where patch 'right' was pressed, 'left' responded" in out
    assert err.count("\n") == 1


def test_a_patch_that_answers_for_another_is_named(check_live, capsys):
    middle = small_skin().find_taxels("middle").tolist()
    nobody = small_skin().find_taxels("right")[-1]
    assert check_live(lambda taxel: nobody if taxel in middle else taxel) == 2
    assert "where patch 'middle' was pressed, 'right' responded" in (
        capsys.readouterr().out
    )


def test_it_needs_to_know_where_the_patches_are(tmp_path, capsys):
    save_skin(small_skin(), tmp_path)
    arguments = ["skin", "check", str(tmp_path), "--robot", "table", "--live"]
    assert run(arguments) == 2
    assert "--source" in capsys.readouterr().err
