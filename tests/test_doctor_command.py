"""`eskin doctor`: all is well where all is well, and what is not has a name."""

import json

import pytest

from eskin.cli import doctor
from eskin.cli.main import run
from eskin.errors import ModelError


def test_a_whole_installation_is_well(capsys):
    assert run(["doctor", "--json"]) == 0
    *lines, last = capsys.readouterr().out.splitlines()
    checks = json.loads(last)["checks"]
    assert all(check["ok"] for check in checks)
    assert len(lines) == len(checks)
    for line, check in zip(lines, checks, strict=True):
        assert line.startswith("ok")
        assert check["name"] in line
        assert check["found"] in line
    assert any("weights ur5" in line and "recognises" in line for line in lines)


def test_after_it_nothing_is_left_to_compile(capsys):
    assert run(["doctor"]) == 0
    assert run(["doctor"]) == 0
    assert "compiled code was ready" in capsys.readouterr().out.splitlines()[-1]


def test_what_is_wrong_is_named_and_everything_else_looked_at(capsys, monkeypatch):
    def broken(_model):
        raise ModelError("weights ur5 are torn; allowed are whole ones")

    monkeypatch.setattr(doctor, "recognises", broken)
    assert run(["doctor"]) == 2
    out, err = capsys.readouterr()
    assert "WRONG weights ur5: weights ur5 are torn" in out
    assert err.count("\n") == 1
    assert "weights ur5" in err


def test_what_only_training_needs_may_be_missing(monkeypatch):
    monkeypatch.setattr(doctor, "FOR_TRAINING", ("not-there",))
    [found] = [c for c in doctor.every_check() if c.name == "for training"]
    assert found.ok
    assert "pip install" in found.found


@pytest.mark.parametrize("package", ["numpy", "numba"])
def test_versions_are_those_installed(package):
    module = pytest.importorskip(package)
    [line] = doctor.versions((package,))
    assert line == f"{package} {module.__version__}"
