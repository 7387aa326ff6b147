"""Tests of ROS 2: another process, without eskin, hears and is heard."""

import json
import os
import subprocess
import sys
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from eskin.bus import COMMAND_EVENT, Publisher, compute_type_hash
from eskin.bus.messages import OK, STALE, WARN
from eskin.bus.ros2 import Ros2Bus, Ros2Joints, Ros2Node, wrap_message
from eskin.cli.run import (
    RunCommand,
    describe_doubts,
    is_without_joints,
    subscribe_joints,
)
from eskin.drivers import HostClock, ManualClock
from eskin.errors import DeviceError, JointsError
from eskin.live import Recognizer
from eskin.recording.messages import (
    DETECTION,
    JOINT_STATES,
    READING,
    pack_joint_state,
)
from eskin.registry import advise_install
from eskin.robot import load_robot
from eskin.stream import Context, Recognition, Stream
from helpers.cli import assert_refused, call_json
from helpers.live import (
    VOCABULARY,
    Press,
    calibration_of,
    mounted,
    record,
    say_always,
    scans,
)
from helpers.questions import DECISIONS
from helpers.ros2 import start_when_heard, wait_until
from helpers.streams import INFO, played

pytestmark = pytest.mark.slow

PEER = Path(__file__).parent / "helpers" / "ros2_peer.py"


@pytest.fixture
def stack(domain):
    """Close what is entered at the end of a test."""
    with ExitStack() as opened:
        yield opened


def test_another_process_hears_every_reading_and_moves_the_joints(domain, stack):
    on = mounted()
    stream = scans(on, [Press(2.3, 2.7, 65, 65)], 50, 3.5)
    source = played(stream)
    source.info = replace(INFO, mounted=on)
    recognizer = Recognizer(say_always("poke"), on, calibration_of(on.skin))
    environment = {"PATH": os.environ["PATH"]} | {
        name: os.environ[name] for name in ("CYCLONEDDS_URI", "ROS_DOMAIN_ID")
    }
    with subprocess.Popen(
        [sys.executable, PEER, str(len(stream))],
        stdout=subprocess.PIPE,
        text=True,
        env=environment,
    ) as peer:
        assert peer.stdout is not None and peer.stdout.readline() == "ready\n"
        node = Ros2Node()
        bus = Ros2Bus(node, reliable=True)
        joints = stack.enter_context(Ros2Joints(node, load_robot("ur5"), HostClock()))
        recognition = Recognition(recognizer, drop="never")
        publisher = Publisher(bus, on, VOCABULARY, joints.diagnose, "never")
        running = Stream(source, [recognition, publisher])
        publisher.start = start_when_heard(publisher.start, bus, (READING, DETECTION))
        with running:
            running.wait()
        heard = json.loads(peer.stdout.read().splitlines()[-1])
    stamps = [1_000_000_000 * sec + nanosec for sec, nanosec in heard["stamps"]]
    assert stamps == [scan.stamp for scan in stream]
    assert heard["counts"] == [scan.counts.tolist() for scan in stream]
    assert heard["skin"] == [on.skin.name] and heard["gestures"] == ["poke"]
    for topic in (READING, DETECTION):
        stated = heard["hashes"][f"rt{topic.name}"]
        assert stated == f"typehash={compute_type_hash(topic)};"
    assert bus.unsent == 0
    with pytest.raises(JointsError) as error:
        joints.q_at(joints.clock.now())
    assert error.value.q.tolist() == [0.0, 0.0, -0.5, 0.0, 0.75, 0.0]
    status = joints.diagnose()
    assert status.level == WARN and "shoulder_lift_joint" in status.message


def test_run_publishes_to_ros2_and_foxglove(domain, tmp_path, capsys):
    on = mounted()
    path = record(tmp_path / "a.mcap", on, scans(on, [], 50, 1.0))
    words = ("run", "--source", f"replay:{path}", "--pace", 5)
    words += ("--ros2", "--foxglove", "--foxglove-port", 0)
    result, out = call_json(capsys, *words)
    assert "ws://127.0.0.1:" in out
    for name in ("ros2", "foxglove"):
        count = result["queues"][name]
        assert count["given"] == count["taken"] >= 2 * result["readings"]


@pytest.mark.parametrize(
    ("options", "subscribes"),
    [
        ({}, True),
        ({"q": (0.0,) * 6}, False),
        ({"robot": "sim:ur5"}, False),
        ({"source": ("sim:ur5",)}, False),
        ({"source": ("replay:a.mcap",)}, False),
    ],
)
def test_joint_states_are_used_where_nothing_else_tells_the_joints(options, subscribes):
    command = RunCommand(("serial:/dev/ttyACM0",), skin="ur5", ros2=True)
    assert is_without_joints(replace(command, **options)) == subscribes


def test_joints_of_a_device_come_from_ros2_in_the_order_of_its_robot(domain, stack):
    command = RunCommand(("serial:/dev/ttyACM0",), skin="ur5", ros2=True)
    joints = subscribe_joints(load_robot("ur5"), Ros2Node(), ManualClock())
    assert joints is not None
    stack.enter_context(joints)
    assert joints.robot.joint_names == load_robot("ur5").joint_names
    doubts = describe_doubts(command, calibration_of(mounted("ur5").skin))
    assert any("/joint_states" in doubt for doubt in doubts)


def hear(joints, names, q):
    """Let joints receive a message of a publisher."""
    data = pack_joint_state(1, names, np.array(q))
    joints.push_message(wrap_message(joints.reader.topic.data_type, data))


def test_joint_states_are_taken_by_name_and_broken_ones_refused(domain, stack):
    robot = load_robot("ur5")
    clock = ManualClock()
    joints = stack.enter_context(Ros2Joints(Ros2Node(), robot, clock))
    assert joints.diagnose().level == WARN
    q = np.arange(6) / 10
    hear(joints, robot.joint_names[::-1], q[::-1])
    assert joints.q_at(clock.now()).tolist() == q.tolist()
    assert joints.diagnose().level == OK
    hear(joints, robot.joint_names[:2], [1.0])
    hear(joints, robot.joint_names[:2], [1.0, np.nan])
    hear(joints, robot.joint_names[:2], [1.0, 90.0])
    joints.push_message(wrap_message(joints.reader.topic.data_type, b"\0\1\0\0\7"))
    assert joints.q_at(clock.now()).tolist() == q.tolist()
    assert joints.received.refused == 4
    clock.sleep(0.02)
    hear(joints, ("elbow_joint", "lid"), [-1.0, 5.0])
    assert joints.q_at(clock.now()).tolist() == [0.0, 0.1, -1.0, 0.3, 0.4, 0.5]
    clock.sleep(0.09)
    assert joints.diagnose().level == STALE
    with pytest.raises(JointsError, match=r"for 0\.1 s \(4 messages refused"):
        joints.q_at(clock.now())


def test_joint_states_count_from_their_arrival_whenever_they_are_asked_for(
    domain, stack
):
    robot = load_robot("ur5")
    clock = ManualClock()
    joints = stack.enter_context(Ros2Joints(Ros2Node(), robot, clock))
    bus = Ros2Bus(Ros2Node())
    bus.open((JOINT_STATES,))
    wait_until(lambda: bus.wants(JOINT_STATES))
    stamps = []
    for number in range(2):
        q = np.full(6, float(number))
        bus.send(JOINT_STATES, 1, pack_joint_state(1, robot.joint_names, q))
        wait_until(lambda number=number: joints.received.accepted == number + 1)
        stamps.append(clock.now())
        clock.sleep(0.08)
    middle = joints.q_at((stamps[0] + stamps[1]) // 2)
    assert middle == pytest.approx(np.full(6, 0.5))
    clock.sleep(0.4)
    with pytest.raises(JointsError, match=r"for 0\.1 s"):
        joints.q_at(clock.now())


def test_subscriber_hears_question_and_how_it_ended(domain):
    bus = Ros2Bus(Ros2Node())
    heard = []
    publisher = Publisher(bus, mounted(), VOCABULARY)
    publisher.start(Context(INFO, ManualClock(), heard.append))
    reader = Ros2Node().create_reader(COMMAND_EVENT)
    wait_until(lambda: bus.wants(COMMAND_EVENT))

    def hear_all():
        heard.extend(COMMAND_EVENT.unpack(one.encoded) for one in reader.take(9))
        return len(heard) == len(DECISIONS)

    for decision in DECISIONS:
        publisher.on_message(decision)
    wait_until(hear_all)
    assert [(action, accepted, why) for _, action, accepted, why, *_ in heard] == [
        (each.action, each.accepted, each.why) for each in DECISIONS
    ]


@pytest.mark.parametrize("number", ["-1", "233", "two"])
def test_domain_that_is_none_is_refused(monkeypatch, number):
    monkeypatch.setenv("ROS_DOMAIN_ID", number)
    with pytest.raises(DeviceError, match="ROS_DOMAIN_ID"):
        Ros2Node()


def test_without_cyclone_dds_one_line_says_what_to_install(monkeypatch, capsys):
    monkeypatch.delitem(sys.modules, "eskin.bus.ros2", raising=False)
    monkeypatch.setitem(sys.modules, "cyclonedds.core", None)
    words = ("run", "--source", "sim:ur5", "--ros2")
    assert_refused(capsys, *words, part=advise_install("ros2"))
