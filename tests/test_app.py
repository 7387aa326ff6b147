"""Tests of sources by their URI: each kind, what it needs, and what is refused."""

import itertools
import re
import socket
import subprocess
import sys

import numpy as np
import pytest

from eskin.app import (
    SourceConfig,
    choose_joints,
    nominal_calibration,
    open_source,
)
from eskin.arms import SimulatedArm
from eskin.drivers import (
    DeviceSource,
    ManualClock,
    PlayedSource,
    SerialTransport,
    UdpTransport,
)
from eskin.errors import ArmError, DeviceError, EskinError, RecordingError
from eskin.recording.records import CALIBRATION_NAME
from eskin.robot import load_robot
from eskin.robot.presets import read_preset_urdf
from eskin.sim.constants import load_constants
from eskin.sim.sensor.build import build_nominal_sensor
from eskin.sim.virtual import PtyPort
from eskin.skin import SKIN_PRESETS, load_skin, mount_skin, save_skin
from eskin.touch import Calibration
from helpers.devices import StillSimulator, small_skin
from helpers.live import mounted, record, scans

RATE = 50.0
with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
    free.bind(("127.0.0.1", 0))
    UDP = f"udp://127.0.0.1:{free.getsockname()[1]}"


def config(**options):
    given = {"skin": small_skin(), "robot": "table", "rate": RATE} | options
    return SourceConfig(**given)


def test_recording_is_played_with_its_skin_and_calibration(tmp_path):
    stream = scans(mounted(), [], 50, 0.2)
    path = record(tmp_path / "a.mcap", mounted(), stream)
    with open_source(f"replay:{path}", config=SourceConfig(pace=np.inf)) as source:
        played = list(source)
    assert isinstance(source, PlayedSource)
    assert source.info.skin.count == mounted().skin.count
    assert source.info.calibration.full_scale == 4000
    assert len(played) == len(stream) and played[0].stamp > stream[-1].stamp


def test_simulation_has_electronics_of_its_build(monkeypatch):
    monkeypatch.setattr("eskin.sim.interactive.player.Simulator", StillSimulator)
    with open_source("sim:ur5", config=SourceConfig(pace=np.inf, seed=3)) as source:
        assert source.info.uri == "sim:ur5" and source.info.robot_name == "table"
        assert source.info.calibration.full_scale == 4095
        assert (source.read(1.0).counts == 7).all()


def test_udp_source_has_given_skin_robot_and_rate():
    with open_source(UDP, skin=small_skin(), config=config(skin=None)) as source:
        assert isinstance(source, DeviceSource)
        assert isinstance(source.transport, UdpTransport)
        assert source.info.rate == RATE and source.info.robot_name == "table"
        assert (source.info.uri, source.info.skin.name) == (UDP, "small")


def test_serial_ports_are_one_source_that_keeps_its_counters():
    with PtyPort() as one, PtyPort() as other:
        with open_source(one.uri, other.uri, config=config()) as source:
            assert isinstance(source.transport, SerialTransport)
            assert len(source.transport.ports) == 2
            one.send([b"abc\0"])
            source.read(0.2)
        counters = source.counters()
    assert (counters["bytes"], counters["broken"] + counters["frames"]) == (4, 1)
    assert source.read(0.0) is None


def test_joints_stand_where_given():
    q = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6)
    with open_source(UDP, config=config(skin="ur5", robot=None, q=q)) as source:
        assert tuple(source.read(1.0).q) == q


GRIPPER = """<link name="finger"/><joint name="finger_joint" type="prismatic">
<parent link="tool0"/><child link="finger"/><axis xyz="0 0 1"/>
<limit lower="0.01" upper="0.05" effort="1" velocity="1"/></joint>"""


def write_ur5(folder, change):
    """Write a URDF of the ur5 with a gripper, after a change of its text."""
    path = folder / "own.urdf"
    path.write_text(change(read_preset_urdf("ur5").replace("</robot>", ""), GRIPPER))
    return path


@pytest.mark.parametrize(
    "change",
    [
        lambda arm, more: f"{arm}{more}</robot>",
        lambda arm, more: arm.replace("<joint", f"{more}<joint", 1) + "</robot>",
        lambda arm, more: f"{arm}{more}</robot>".replace(
            '<joint name="', '<joint name="a_'
        ),
    ],
    ids=["last", "first", "prefix"],
)
def test_joints_of_an_arm_are_found_by_name_and_others_told(tmp_path, change, caplog):
    """For any robot that holds the arm: its links are where those of the arm are."""
    arm = SimulatedArm(clock=ManualClock())
    mounted = mount_skin("ur5", write_ur5(tmp_path, change))
    q = choose_joints(SourceConfig("ur5", joints=arm), mounted).q_at(arm.time)
    (told,) = caplog.messages
    assert "finger_joint" in told and "elbow" not in told
    names = mounted.robot.joint_names
    finger = told.rpartition(" ")[2]
    assert len(q) == 7 and q[names.index(finger)] == 0.01
    ur5 = mount_skin("ur5", None)
    got = mounted.kinematics.poses(q)
    for link, pose in enumerate(ur5.kinematics.poses(arm.q_at(arm.time))):
        own = mounted.robot.link_index(ur5.robot.link_names[link])
        np.testing.assert_allclose(got[own], pose, atol=1e-12)


@pytest.mark.parametrize(
    "change",
    [
        lambda arm, more: arm.replace("elbow_joint", "joint_3") + f"{more}</robot>",
        lambda arm, _: re.sub(r'joint name="\w*"', count_joints(), arm) + "</robot>",
    ],
    ids=["one renamed", "all renamed"],
)
def test_robot_whose_joints_are_not_those_of_the_arm_is_refused_at_once(
    tmp_path, change
):
    """Also one with as many joints: their order says nothing."""
    arm = SimulatedArm(clock=ManualClock())
    given = config(skin="ur5", robot=write_ur5(tmp_path, change), joints=arm)
    with pytest.raises(ArmError, match=r"joint_3.*elbow_joint.*rename") as error:
        open_source(UDP, config=given)
    assert "\n" not in str(error.value)


def count_joints():
    """Return a function that names joints by their number."""
    numbers = itertools.count(1)
    return lambda _: f'joint name="joint_{next(numbers)}"'


def test_arm_commands_for_a_skin_that_is_not_on_it(caplog):
    """The table under the skin has no joints."""
    arm = SimulatedArm(clock=ManualClock())
    mounted = mount_skin(small_skin(), load_robot("table"))
    joints = choose_joints(SourceConfig(small_skin(), joints=arm), mounted)
    assert joints.q_at(arm.time).shape == (0,) and not caplog.messages


def test_calibration_is_given_or_beside_skin_or_nominal(tmp_path):
    skin = small_skin()
    save_skin(skin, tmp_path / "skin")

    def open_calibration(**options):
        options = config(skin=tmp_path / "skin", **options)
        with open_source(UDP, config=options) as source:
            return source.info.calibration

    assert open_calibration().to_bytes() == nominal_calibration(skin).to_bytes()
    beside = Calibration.uniform(skin.count, 1000, 50.0)
    (tmp_path / "skin" / CALIBRATION_NAME).write_bytes(beside.to_bytes())
    assert open_calibration().full_scale == 1000
    given = Calibration.uniform(skin.count, 2000, 50.0)
    (tmp_path / "given.json").write_bytes(given.to_bytes())
    assert open_calibration(calibration=tmp_path / "given.json").full_scale == 2000
    assert open_calibration(calibration=given) is given


@pytest.mark.parametrize("name", SKIN_PRESETS)
def test_nominal_calibration_is_that_of_simulator(name):
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


@pytest.mark.slow
def test_device_without_calibration_needs_no_simulator():
    words = ["run", "--source", UDP, "--skin", "ur5", "--rate", "50"]
    done = subprocess.run(
        [sys.executable, "-c", WITHOUT_SIMULATOR, *words, "--seconds", "0.1"],
        capture_output=True,
        text=True,
    )
    assert done.returncode == 2
    for part in (UDP, "no byte within 0.1 s", "allowed is a device", "check its cable"):
        assert part in done.stderr


@pytest.mark.parametrize(
    ("uris", "options", "part"),
    [
        (["can:1"], {}, "csv:PATH, replay:FILE, serial:PATH, sim:SKIN"),
        ([], {}, "serial:PATH"),
        ([UDP, "serial:/dev/x"], {}, "several serial ports"),
        (["sim:"], {}, "source is 'sim:'"),
        ([UDP, "udp://127.0.0.1:9752"], {}, "several serial"),
        (["udp://127.0.0.1"], {}, "udp://HOST:PORT"),
        (["udp://127.0.0.1:0"], {}, "udp://HOST:PORT"),
        (["udp://127.0.0.1:99999"], {}, "udp://HOST:PORT"),
        (["udp:9751"], {}, "udp://HOST:PORT"),
        (["udp://127.0.0.1:9751/x"], {}, "udp://HOST:PORT"),
        (["udp://0.0.0.0:9751"], {}, "loopback"),
        (["udp://nose:9751"], {}, "IP address"),
        (["serial:/dev/nowhere"], {}, "/dev/nowhere"),
        (["serial:"], {}, "serial port"),
        (["replay:nowhere.mcap"], {}, "nowhere.mcap"),
        (["replay:"], {}, "source is 'replay:'"),
        (["sim:nose"], {}, "nose"),
        ([UDP], {"skin": None}, "without a skin"),
        ([UDP], {"robot": None}, "without a robot"),
        ([UDP], {"q": (1.0,)}, "0 finite numbers"),
        ([UDP], {"rate": 1e9}, "rate is 1000000000.0"),
        ([UDP], {"calibration": Calibration.uniform(3, 10, 1.0)}, "has 3 taxels"),
    ],
)
def test_invalid_source_is_refused_in_one_line(uris, options, part):
    with pytest.raises((EskinError, ValueError), match=part) as error:
        open_source(*uris, config=config(**options))
    assert "\n" not in str(error.value)


def test_unreadable_calibration_is_refused_and_port_freed(tmp_path):
    path = tmp_path / "a.json"
    with pytest.raises(DeviceError, match=r"a\.json"):
        open_source(UDP, config=config(calibration=path))
    path.write_text("{}")
    with pytest.raises(RecordingError, match=r"a\.json"):
        open_source(UDP, config=config(calibration=path))
    open_source(UDP, config=config()).close()
