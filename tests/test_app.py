"""A source by its URI: each kind, what it needs, and what is refused."""

import socket
import subprocess
import sys

import numpy as np
import pytest

from eskin.app import CALIBRATION, SourceConfig, nominal_calibration, open_source
from eskin.drivers import DeviceSource, PlayedSource, SerialTransport, UdpTransport
from eskin.drivers.virtual import PtyPort
from eskin.errors import DeviceError, EskinError, RecordingError
from eskin.sim.constants import load_constants
from eskin.sim.sensor.build import build_nominal_sensor
from eskin.skin import SKIN_PRESETS, load_skin, save_skin
from eskin.touch import Calibration
from helpers.devices import small_skin
from helpers.live import mounted, record, scans
from test_device_command import StillSimulator

RATE = 50.0
with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
    free.bind(("127.0.0.1", 0))
    UDP = f"udp://127.0.0.1:{free.getsockname()[1]}"


def config(**more):
    return SourceConfig(skin=small_skin(), robot="table", rate=RATE, **more)


def test_a_recording_is_played_anew_with_its_own_skin_and_calibration(tmp_path):
    stream = scans(mounted(), [], 50, 0.2)
    path = record(tmp_path / "a.mcap", mounted(), stream)
    with open_source(f"replay:{path}", config=SourceConfig(pace=np.inf)) as source:
        played = list(source)
    assert isinstance(source, PlayedSource)
    assert source.info.skin.count == mounted().skin.count
    assert source.info.calibration.full_scale == 4000
    assert len(played) == len(stream)
    assert played[0].stamp > stream[-1].stamp


def test_a_simulation_has_the_electronics_of_its_build(monkeypatch):
    monkeypatch.setattr("eskin.sim.dataset.Simulator", StillSimulator)
    with open_source("sim:ur5", config=SourceConfig(pace=np.inf, seed=3)) as source:
        assert source.info.uri == "sim:ur5" and source.info.robot_name == "table"
        assert source.info.calibration.full_scale == 4095
        scan = source.read(1.0)
    assert scan is not None and (scan.counts == 7).all()


def test_a_network_port_is_listened_to():
    with open_source(UDP, config=config()) as source:
        assert isinstance(source, DeviceSource)
        assert isinstance(source.transport, UdpTransport)
        assert source.info.rate == RATE and source.info.robot_name == "table"
        assert source.info.uri == UDP


def test_several_serial_ports_are_one_source():
    with PtyPort() as one, PtyPort() as other:
        with open_source(one.uri, other.uri, config=config()) as source:
            assert isinstance(source.transport, SerialTransport)
            assert len(source.transport.ports) == 2


def test_counters_stay_when_a_serial_source_is_closed():
    with PtyPort() as line:
        with open_source(line.uri, config=config()) as source:
            line.send([b"abc\0"])
            source.read(0.2)
        counted = source.counters()
    assert (counted["bytes"], counted["broken"] + counted["frames"]) == (4, 1)
    assert source.read(0.0) is None


def test_the_skin_may_be_named_beside_the_configuration():
    more = SourceConfig(robot="table", rate=RATE)
    with open_source(UDP, skin=small_skin(), config=more) as source:
        assert source.info.skin.name == "small"


def test_a_calibration_is_given_or_lies_beside_the_skin_or_is_nominal(tmp_path):
    skin = small_skin()
    save_skin(skin, tmp_path / "skin")

    def found(**more):
        more = SourceConfig(skin=tmp_path / "skin", robot="table", rate=RATE, **more)
        with open_source(UDP, config=more) as source:
            return source.info.calibration

    nominal = nominal_calibration(skin)
    assert found().to_bytes() == nominal.to_bytes()
    beside = Calibration.uniform(skin.count, 1000, 50.0)
    (tmp_path / "skin" / CALIBRATION).write_bytes(beside.to_bytes())
    assert found().full_scale == 1000
    given = Calibration.uniform(skin.count, 2000, 50.0)
    (tmp_path / "given.json").write_bytes(given.to_bytes())
    assert found(calibration=tmp_path / "given.json").full_scale == 2000
    assert found(calibration=given) is given


@pytest.mark.parametrize("name", SKIN_PRESETS)
def test_the_nominal_calibration_is_that_of_the_simulator(name):
    skin = load_skin(name)
    simulated = build_nominal_sensor(skin, load_constants()).calibration(skin)
    assert nominal_calibration(skin).to_bytes() == simulated.to_bytes()


WITHOUT_SIMULATOR = """
import sys

class Refusal:
    def find_spec(name, path, target=None):
        if name.split(".")[:2] == ["eskin", "sim"]:
            raise ImportError(f"{name} is imported")

sys.meta_path.insert(0, Refusal)
from eskin.cli.main import run
sys.exit(run(sys.argv[1:]))
"""


@pytest.mark.parametrize("kind", ["serial", "udp"])
def test_a_device_without_a_calibration_needs_no_simulator(kind):
    with PtyPort() as line:
        words = ["run", "--source", line.uri if kind == "serial" else UDP]
        words += ["--skin", "ur5", "--rate", "50", "--seconds", "0.1", "--json"]
        done = subprocess.run(
            [sys.executable, "-c", WITHOUT_SIMULATOR, *words],
            capture_output=True,
            text=True,
        )
    assert (done.returncode, done.stderr) == (0, "")


def test_joints_stand_where_they_are_said_to_be():
    more = SourceConfig(skin="ur5", rate=RATE, q=(0.1, 0.2, 0.3, 0.4, 0.5, 0.6))
    with open_source(UDP, config=more) as source:
        scan = source.read(1.0)
    assert scan is not None and scan.q.tolist() == [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]


@pytest.mark.parametrize(
    ("uris", "more", "said"),
    [
        (("can:1",), {}, "allowed is one of serial:PATH, udp://HOST:PORT, replay:FILE"),
        ((), {}, "allowed is one of serial:PATH"),
        ((UDP, "serial:/dev/x"), {}, "or several serial ports"),
        ((UDP, "udp://127.0.0.1:9752"), {}, "or several serial"),
        (("udp://127.0.0.1",), {}, "allowed is udp://HOST:PORT"),
        (("udp://127.0.0.1:0",), {}, "allowed is udp://HOST:PORT"),
        (("udp://127.0.0.1:99999",), {}, "allowed is udp://HOST:PORT"),
        (("udp:9751",), {}, "allowed is udp://HOST:PORT"),
        (("udp://127.0.0.1:9751/x",), {}, "allowed is udp://HOST:PORT"),
        (("udp://0.0.0.0:9751",), {}, "allowed is loopback"),
        (("udp://nose:9751",), {}, "allowed is an IP address"),
        (("serial:/dev/nowhere",), {}, "cannot open serial port /dev/nowhere"),
        (("serial:",), {}, "cannot open serial port"),
        (("replay:nowhere.mcap",), {}, "no recording at nowhere.mcap"),
        (("replay:",), {}, "recording"),
        (("sim:nose",), {}, "nose"),
        ((UDP,), {"skin": None}, "given without a skin"),
        ((UDP,), {"robot": None}, "given without a robot"),
        ((UDP,), {"q": (1.0,)}, "allowed are 0 finite numbers"),
        ((UDP,), {"rate": 1e9}, "rate is 1000000000.0; allowed"),
        (
            (UDP,),
            {"calibration": Calibration.uniform(3, 10, 1.0)},
            "calibration has 3 taxels",
        ),
    ],
)
def test_what_is_no_source_is_refused_in_one_line(uris, more, said):
    given = {"skin": small_skin(), "robot": "table", "rate": RATE} | more
    with pytest.raises((EskinError, ValueError), match=said) as caught:
        open_source(*uris, config=SourceConfig(**given))
    assert "\n" not in str(caught.value)


def test_a_calibration_that_cannot_be_read_is_named(tmp_path):
    path = tmp_path / "a.json"
    with pytest.raises(DeviceError, match="a.json cannot be read"):
        open_source(UDP, config=config(calibration=path))
    path.write_text("{}")
    with pytest.raises(RecordingError, match="a.json: calibration cannot be read"):
        open_source(UDP, config=config(calibration=path))
    # The port is free again.
    open_source(UDP, config=config()).close()
