"""`eskin generate`, as it is called."""

import json

import pytest

import eskin.cli.generate as command
from eskin.cli.main import run
from eskin.sim.constants import load_constants
from eskin.sim.dataset import generate
from eskin.sim.dataset.sets import SETS, load_set
from helpers.simulation import Failing, StandIn


@pytest.fixture
def quick(monkeypatch):
    """The command with a stand-in for the simulator, in this process."""

    def stand_in(folder, settings, workers, on_progress):
        return generate(folder, settings, 0, StandIn, on_progress)

    monkeypatch.setattr(command, "generate", stand_in)


def call(capsys, *argv):
    code = run(["generate", *(str(word) for word in argv)])
    out, err = capsys.readouterr()
    return code, out, err


def last_json(out):
    return json.loads(out.strip().splitlines()[-1])


def test_generate_says_what_it_made(quick, tmp_path, capsys):
    argv = (tmp_path / "out", "--set", "val", "--clips", 12, "--subjects", 2, "--json")
    code, out, err = call(capsys, *argv)
    assert (code, err) == (0, "")
    result = last_json(out)
    assert set(result) == {
        "clips",
        "made",
        "recordings",
        "seconds",
        "clips_per_minute",
    }
    assert (result["clips"], result["made"], result["recordings"]) == (12, 12, 2)
    assert result["clips_per_minute"] == pytest.approx(720 / result["seconds"], rel=0.2)
    assert len(list((tmp_path / "out").glob("*.mcap"))) == 2
    result = last_json(call(capsys, *argv)[1])
    assert (result["clips"], result["made"], result["clips_per_minute"]) == (12, 0, 0)


def test_generate_of_bad_input_is_one_line_and_leaves_nothing(quick, tmp_path, capsys):
    out = tmp_path / "out"
    taken = tmp_path / "file"
    taken.write_text("mine")
    for argv, message in (
        ((), "PATH"),
        ((out, "--set", "all"), "set"),
        ((out, "--skin", "sleeve"), "skin"),
        ((out, "--clips", "0"), "0 clips asked of set 'train'"),
        ((out, "--clips", "3", "--subjects", "4"), "4 people asked"),
        ((out, "--seed", "-1"), "seed is -1"),
        ((out, "--workers", "0"), "--workers is 0; allowed are 1 and above"),
        ((out, "--difficulty", "-1"), "difficulty is -1.0"),
        ((taken, "--clips", "3"), "cannot write to"),
        ((taken / "below", "--clips", "3"), "cannot write to"),
    ):
        code, shown, err = call(capsys, *argv)
        assert (code, shown) == (2, ""), argv
        assert message in err
        assert len(err.strip().splitlines()) == 1
        assert not out.exists()
    assert taken.read_text() == "mine"


def test_generate_with_other_settings_leaves_what_is_there(quick, tmp_path, capsys):
    call(capsys, tmp_path, "--clips", 10)
    before = sorted((p.name, p.read_bytes()) for p in tmp_path.iterdir())
    code, out, err = call(capsys, tmp_path, "--clips", 10, "--difficulty", 0.5)
    assert (code, out) == (2, "")
    assert "was generated with difficulty 1.5, not 0.5" in err
    assert len(err.strip().splitlines()) == 1
    assert sorted((p.name, p.read_bytes()) for p in tmp_path.iterdir()) == before


def test_a_clip_that_cannot_be_made_is_one_line(monkeypatch, tmp_path, capsys):
    def failing(folder, settings, workers, on_progress):
        return generate(folder, settings, 0, Failing, on_progress)

    monkeypatch.setattr(command, "generate", failing)
    code, out, err = call(capsys, tmp_path / "out", "--clips", 12, "--subjects", 2)
    assert (code, out) == (2, "")
    assert "ZeroDivisionError: no force" in err
    assert len(err.strip().splitlines()) == 1
    assert len(list((tmp_path / "out").glob("*.mcap*"))) == 1


def test_every_set_can_be_asked_for(quick, tmp_path, capsys):
    for name in SETS:
        clips = 5 if load_set(name, load_constants()).classes else 2
        argv = (tmp_path / name, "--set", name, "--clips", clips, "--json")
        code, out, err = call(capsys, *argv)
        assert (code, err) == (0, "")
        assert last_json(out)["clips"] == clips
