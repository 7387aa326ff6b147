"""Wrong sources, ports, keys and faults are refused, each in one line that says why.

What a port refuses without being lost, and messages of joints, are tested with them.
"""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from eskin.app import SourceConfig, open_joints, open_source
from eskin.drivers import (
    Assembler,
    CalledJoints,
    DeviceSource,
    EventLog,
    FixedJoints,
    HostClock,
    ManualClock,
    UdpTransport,
    read_key,
    replay_source,
)
from eskin.drivers.csv_lines import LineForm
from eskin.errors import DeviceError, RecordingError, SkinError, SkinMismatchError
from eskin.robot import load_robot
from eskin.sim.virtual import UdpPort, VirtualSkin, parse_fault
from eskin.skin import MountedSkin
from eskin.touch import Scan
from helpers.devices import RATE, MemoryPort, small_skin
from helpers.modules import SKIN, ScriptedTransport
from helpers.refusals import REFUSALS, check_refusal, refusal
from helpers.streams import make_scans, played
from helpers.touch import START, build_grid_skin, calibration_of, one_link_robot

UR5 = load_robot("ur5")
CONFIG = SourceConfig(skin=build_grid_skin(), robot="table")
CALIBRATION = calibration_of(SKIN)
SQUARE = calibration_of(build_grid_skin(2, 2))


def form(text, part):
    """Return the row of options of a CSV source, and the part that names them."""
    return refusal(
        f"options {text}",
        DeviceError,
        lambda folder: LineForm.parse(text),
        f"options of csv:x are {part};",
        "allowed are time=ns",
        " decimal=comma",
    )


def source(*uris, part):
    """Return the row of a source that cannot be opened."""

    def call(folder):
        open_source(*uris, config=CONFIG)

    return refusal(f"source {' '.join(uris)}", DeviceError, call, part)


def device(error, part, calibration=CALIBRATION, **options):
    """Return the row of a device with wrong options."""

    def call(folder):
        clock = ManualClock(START)
        DeviceSource(
            ScriptedTransport(clock, []),
            MountedSkin(SKIN, one_link_robot()),
            calibration,
            FixedJoints(np.zeros(0)),
            clock,
            "test:",
            **options,
        )

    return refusal(f"device whose {part}", error, call, part)


def joints(uri, robot, part):
    """Return the row of an address from which joint positions would come."""
    return refusal(
        f"joints of {robot.name} from {uri}",
        DeviceError,
        lambda folder: open_joints(uri, robot),
        part,
    )


def called_joints(given, part):
    """Return the row of a function that returns wrong joint positions."""
    return refusal(
        f"function that returns {given}",
        DeviceError,
        lambda folder: CalledJoints(lambda stamp: given, UR5).q_at(START),
        "function of joint positions: ",
        part,
        "allowed",
    )


def pace(value):
    """Return the row of a pace at which nothing can be played."""
    return refusal(
        f"pace {value}",
        ValueError,
        lambda folder: played(make_scans(2), value),
        f"{value}",
        "positive",
    )


def address(part, **arguments):
    """Return the row of an address that cannot be bound."""
    name = json.dumps(arguments)
    return refusal(
        name, DeviceError, lambda folder: UdpTransport(HostClock(), **arguments), part
    )


def key(name, text, mode, remedy):
    """Return the row of a file of a key, with its permissions."""

    def call(folder):
        path = folder / "key"
        path.write_text(text, encoding="utf-8")
        path.chmod(mode)
        read_key(path)

    return refusal(name, DeviceError, call, remedy)


def fault(text, *parts):
    """Return the row of a text of a fault."""
    return refusal(
        f"fault {text!r}",
        ValueError,
        lambda folder: parse_fault(text, small_skin()),
        *parts,
    )


def scan(size, count, *parts):
    """Return the row of a scan that a virtual skin cannot send."""

    def call(folder):
        counts = np.full(size, count, np.int32)
        sent = Scan(1, counts, np.ones(size, bool), np.zeros(0))
        VirtualSkin(small_skin(), [MemoryPort()]).send(sent)

    return refusal(f"{size} counts of {count}", DeviceError, call, *parts)


def virtual(ports, rate, part):
    """Return the row of a virtual skin with some ports and a rate [Hz]."""
    return refusal(
        f"{ports} ports at {rate} Hz",
        ValueError,
        lambda folder: VirtualSkin(small_skin(), [MemoryPort()] * ports, rate),
        part,
    )


def share_address(folder):
    """Assemble readings of a skin with two patches at one address."""
    patches = (SKIN.patches[0], replace(SKIN.patches[1], address=0), SKIN.patches[2])
    Assembler(replace(SKIN, patches=patches), FixedJoints(np.zeros(0)), EventLog())


ROWS = [
    form("x,tim=ms", "tim=ms"),
    form("x,time=h", "time=h"),
    form("x,scale=nan", "scale=nan"),
    form("x,scale=1_0", "scale=1_0"),
    form("x,label=a,scale=b", "scale=b,label=a"),
    source("csv:/nowhere/port", part="cannot open"),
    source("xela://127.0.0.1:1", part="cannot open"),
    source("csv:a", "csv:b", part="one port a patch"),
    device(SkinMismatchError, "calibration has 4", calibration=SQUARE),
    device(DeviceError, "rate is 0.0", rate=0.0),
    device(DeviceError, "rate is nan", rate=float("nan")),
    device(DeviceError, "rate is 1000000.0", rate=1e6),
    refusal("shared address", SkinError, share_address, "3 patches at 2 addresses"),
    joints("tcp://127.0.0.1:1", UR5, "udp://HOST:PORT"),
    joints("udp://127.0.0.1", UR5, "udp://HOST:PORT"),
    joints("udp://0.0.0.0:9760", UR5, "loopback"),
    joints("udp://127.0.0.1:9760", load_robot("table"), "no moving joint"),
    called_joints([0.0], "it has 1 of them"),
    called_joints([float("nan")] * 6, "position 'nan'"),
    called_joints(np.full(6, 99.0), "is 99; "),
    *map(pace, (0.0, -1.0, math.nan)),
    refusal(
        "missing recording",
        RecordingError,
        lambda folder: replay_source(folder / "gone.mcap"),
        "gone.mcap",
    ),
    address("loopback", host="0.0.0.0"),
    address("loopback", host="192.0.2.1"),
    address("loopback", host="::"),
    address("IP address", host="nowhere"),
    address("allowed is a free port", host="192.0.2.1", allow_remote=True),
    address("allowed is a free port", port=70_000),
    refusal(
        "missing key",
        DeviceError,
        lambda folder: read_key(folder / "key"),
        "allowed is a file of 64 hexadecimal digits",
    ),
    key("key that others read", "00" * 32, 0o640, "chmod 600"),
    key("short key", "00" * 31, 0o600, "openssl rand"),
    key("key of letters", "zz" * 32, 0o600, "openssl rand"),
    key("key of other letters", "é" * 32, 0o600, "openssl rand"),
    key("empty key", "", 0o600, "openssl rand"),
    fault("", "''"),
    fault("lose=", "'lose='"),
    fault("lose@-1", "'lose@-1'"),
    fault("lose=nan", "'lose=nan'"),
    fault("explode", "unplug, replace"),
    fault("lose:nose", "left, middle, right"),
    fault("dead:left/x", "PATCH/rROW"),
    fault("dead:left/r7", "rows 0 to 2 and columns 0 to 3"),
    fault("lose:left,right", "2 patches; ", " 1"),
    fault("swap", "0 patches; ", " 2"),
    fault("swap:left", "1 patches; ", " 2"),
    fault("swap:left,left", "twice"),
    fault("reboot@1-2", "at an instant", "@FROM"),
    fault("unplug@5-3", "ends at 3 s", "later"),
    fault("stall=3", "=3"),
    fault("lose=1.5", "1.5; ", " 0 to 1"),
    scan(5, 0, "5 counts", " 34"),
    scan(34, 70_000, "0 to 65535"),
    virtual(4, RATE, "4 ports"),
    virtual(1, 0.0, "rate is 0.0"),
    refusal(
        "unknown computer",
        DeviceError,
        lambda folder: UdpPort("no.such.computer.invalid", 9750),
        "no.such.computer.invalid",
    ),
]


@pytest.mark.parametrize(REFUSALS, ROWS)
def test_wrong_source_is_refused_in_one_line(error, call, parts, tmp_path):
    check_refusal(error, call, parts, tmp_path)
