"""`eskin doctor`: all is well where all is well, and what is not has a name."""

import json

import pytest

from eskin.cli import doctor
from eskin.cli.main import run
from eskin.drivers import HostClock, SerialPortInfo, UdpTransport
from eskin.drivers.virtual import parse_fault
from eskin.errors import ModelError
from eskin.skin import save_skin
from helpers.devices import playing, scans_of, small_skin, udp_skin


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

    monkeypatch.setattr(doctor, "check_model", broken)
    assert run(["doctor"]) == 2
    out, err = capsys.readouterr()
    assert "WRONG weights ur5: weights ur5 are torn" in out
    assert err.count("\n") == 1
    assert "weights ur5" in err


def test_what_only_training_needs_may_be_missing(monkeypatch):
    monkeypatch.setattr(doctor, "TRAINING_PACKAGES", ("not-there",))
    [found] = [c for c in doctor.run_checks() if c.name == "for training"]
    assert found.ok
    assert "pip install" in found.found


@pytest.mark.parametrize("package", ["numpy", "numba"])
def test_versions_are_those_installed(package):
    module = pytest.importorskip(package)
    [line] = doctor.list_versions((package,))
    assert line == f"{package} {module.__version__}"


def test_a_port_that_may_not_be_used_says_how_to_be_allowed():
    ports = [
        SerialPortInfo("/dev/ttyACM0", "patch 1234", usable=True),
        SerialPortInfo("/dev/ttyACM1", "patch 1235", usable=False),
    ]
    well, ill = doctor.check_ports(ports)
    assert (well.ok, well.found) == (True, "patch 1234")
    assert not ill.ok
    assert "dialout" in ill.found
    assert "/dev/ttyACM1" in ill.name


def test_a_computer_without_serial_ports_is_well():
    [check] = doctor.check_ports([])
    assert check.ok


def test_patches_are_listened_to_one_by_one(tmp_path, capsys):
    skin = small_skin()
    save_skin(skin, tmp_path)
    transport = UdpTransport(HostClock())
    port = transport.port
    transport.close()
    device = udp_skin(skin, port, faults=[parse_fault("unplug:left", skin)])
    command = doctor.Command((f"udp://127.0.0.1:{port}",), str(tmp_path), "table")
    with playing(device, scans_of(skin, 1000), HostClock()):
        left, middle, right = doctor.check_patches(command)
    assert (left.name, left.ok) == ("patch left", False)
    assert "no scans received" in left.found
    assert middle.ok
    assert right.ok
    assert "scans a second" in right.found
