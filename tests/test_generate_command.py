"""These tests check `eskin generate` with a stand-in for the simulator."""

import json

import pytest

import eskin.sim.commands.generate as command
from eskin.cli.main import run
from eskin.sim.dataset import generate
from helpers.simulation import Failing, StandIn, read_files


@pytest.fixture
def call_generate(monkeypatch, capsys):
    """Return a function that runs the command with a stand-in, in this process."""

    def call(*words, factory=StandIn):
        def generate_here(folder, settings, workers, on_progress, write):
            return generate(folder, settings, 0, factory, on_progress)

        monkeypatch.setattr(command, "generate", generate_here)
        code = run(["generate", *(str(word) for word in words)])
        return code, *capsys.readouterr()

    return call


def test_command_prints_what_it_made(call_generate, tmp_path):
    words = (tmp_path, "--set", "val", "--clips", 12, "--subjects", 2, "--json")
    for made in (12, 0):
        code, out, err = call_generate(*words)
        assert (code, err) == (0, "")
        result = json.loads(out.splitlines()[-1])
        seconds = result.pop("seconds")
        rate = result.pop("clips_per_minute")
        assert result == {"clips": 12, "made": made, "recordings": 2}
        assert rate * seconds == pytest.approx(60 * made, rel=0.2)
    assert len(list(tmp_path.glob("*.mcap"))) == 2


@pytest.mark.parametrize(
    ("words", "part"),
    [
        ((), "PATH"),
        (("OUT", "--set", "all"), "set"),
        (("OUT", "--skin", "sleeve"), "skin"),
        (("OUT", "--clips", "0"), "0 clips requested for set 'train'"),
        (("OUT", "--clips", "3", "--subjects", "4"), "4 people requested"),
        (("OUT", "--seed", "-1"), "seed is -1"),
        (("OUT", "--workers", "0"), "--workers is 0"),
        (("OUT", "--difficulty", "-1"), "difficulty is -1.0"),
        (("OUT", "--difficulty", "nan"), "difficulty is nan"),
        (("OUT", "--set", "recorded"), "without recorded touches"),
        (("OUT", "--set", "recorded", "--recorded", "GONE"), "no file or folder"),
        (("OUT", "--set", "recorded", "--recorded", "."), "no recorded touches"),
        (("OUT", "--people", "0"), "--people is given without --recorded"),
        (("FILE", "--clips", "3"), "cannot write to"),
        (("FILE/below", "--clips", "3"), "cannot write to"),
    ],
)
def test_command_refuses_bad_input_in_one_line(call_generate, tmp_path, words, part):
    (tmp_path / "FILE").write_text("mine")
    words = [tmp_path / word if word[:1].isupper() else word for word in words]
    code, out, err = call_generate(*words)
    assert (code, out, len(err.strip().splitlines())) == (2, "", 1)
    assert part in err
    assert read_files(tmp_path) == {"FILE": b"mine"}
    assert not (tmp_path / "OUT").exists()


def test_command_fails_in_one_line_and_keeps_files(call_generate, tmp_path):
    words = (tmp_path, "--clips", 12, "--subjects", 2)
    code, out, err = call_generate(*words, factory=Failing)
    assert (code, out, len(err.strip().splitlines())) == (2, "", 1)
    assert "ZeroDivisionError: no force" in err
    before = read_files(tmp_path)
    assert len(list(tmp_path.glob("*.mcap*"))) == 1
    code, out, err = call_generate(*words, "--difficulty", 0.5)
    assert (code, out, len(err.strip().splitlines())) == (2, "", 1)
    assert "difficulty 1.5, not 0.5" in err
    assert read_files(tmp_path) == before
