"""Tests of joint positions: by UDP and by a function, in time or not at all."""

import json
import socket
import time

import numpy as np
import pytest

from eskin.app import SourceConfig, open_source
from eskin.cli.run import RunCommand, check_options
from eskin.drivers import CalledJoints, DeviceSource, ManualClock, UdpJoints
from eskin.drivers.joints import ReceivedJoints
from eskin.errors import DeviceError, EskinError, JointsError
from eskin.robot import load_robot
from eskin.skin import MountedSkin
from helpers.cli import assert_refused
from helpers.modules import MS, SKIN, ScriptedTransport, encode_arrivals, stream_all
from helpers.touch import SECOND, START, calibration_of, one_link_robot

ROBOT = load_robot("ur5")
NAMES = list(ROBOT.joint_names)
Q = [0.1, -0.2, 0.3, -0.4, 0.5, -0.6]
HERE = ("127.0.0.1", 1)
THERE = ("127.0.0.1", 2)
MOUNTED = MountedSkin(SKIN, one_link_robot())


def encode(position=Q, **fields):
    return json.dumps({"position": position} | fields).encode()


@pytest.fixture
def joints():
    with UdpJoints(ROBOT, clock=ManualClock(START)) as opened:
        yield opened


def test_positions_are_taken_in_the_robots_order_whatever_theirs_is(joints):
    names = ["finger", *NAMES[::-1]]
    joints.push_datagram(encode([9.0, *Q[::-1]], name=names), HERE, START)
    assert joints.q_at(START).tolist() == Q
    joints.push_datagram(encode(), HERE, START + MS)
    assert joints.q_at(START + MS).tolist() == Q and joints.received.accepted == 2


def test_positions_are_interpolated_between_arrivals(joints):
    joints.push_datagram(encode([0.0] * 6), HERE, START)
    joints.push_datagram(encode([1.0] * 6), HERE, START + 20 * MS)
    np.testing.assert_allclose(joints.q_at(START + 5 * MS), 0.25)


@pytest.mark.parametrize("ms", [101, 5_000, -101])
def test_positions_of_another_time_are_refused(joints, ms):
    joints.push_datagram(encode(), HERE, START)
    assert joints.q_at(START + (99 if ms > 0 else -99) * MS).tolist() == Q
    with pytest.raises(JointsError, match=r"for 0\.1 s") as error:
        joints.q_at(START + ms * MS)
    assert error.value.q.tolist() == Q


@pytest.mark.parametrize("late", range(6))
def test_positions_are_as_old_as_those_of_the_joint_that_came_first(late):
    """Messages of some joints, as several publishers of ROS 2 send them."""
    received = ReceivedJoints(ROBOT)
    first = dict(zip(NAMES, Q, strict=True))
    del first[NAMES[late]]
    received.merge_positions(first, START)
    with pytest.raises(JointsError, match=f"'{NAMES[late]}'"):
        received.q_at(START)
    received.merge_positions({NAMES[late]: Q[late]}, START + 50 * MS)
    assert received.q_at(START + 99 * MS).tolist() == Q
    received.merge_positions({NAMES[late]: Q[late]}, START + 90 * MS)
    with pytest.raises(JointsError, match=r"for 0\.1 s"):
        received.q_at(START + 101 * MS)


def test_second_sender_is_refused_while_the_first_sends(joints):
    joints.push_datagram(encode(), HERE, START)
    joints.push_datagram(encode([0.0] * 6), THERE, START + SECOND)
    assert joints.received.refused == 1 and joints.q_at(START).tolist() == Q
    joints.push_datagram(encode([0.0] * 6), THERE, START + 3 * SECOND)
    assert joints.q_at(START + 3 * SECOND).tolist() == [0.0] * 6


@pytest.mark.parametrize(
    ("data", "part"),
    [
        (b"", "no JSON"),
        (b"\xff", "no JSON"),
        (b"[" * 5000, "no JSON"),
        (b"{" + b" " * 20_000, "16384 bytes"),
        (b"3", "no list 'position'"),
        (b'{"position": 3}', "no list 'position'"),
        (encode(Q[:5]), "5 of them; allowed is one finite number for each of shoulder"),
        (encode([*Q[:5], None]), "'None'"),
        (encode([*Q[:5], True]), "'True'"),
        (encode([*Q[:5], "1.0"]), "'1.0'"),
        (encode([*Q[:5], float("nan")]), "'nan'"),
        (encode([*Q[:5], 10**400]), "'1000000"),
        (encode([*Q[:5], 90.0]), "'wrist_3_joint' is 90; allowed is -6.28 to 6.28 rad"),
        (encode(name=3), "no list of names"),
        (encode(name=NAMES[:5]), "5 names for 6 positions"),
        (encode(name=[*NAMES[:5], NAMES[0]]), "every name once"),
        (encode(name=[*NAMES[:5], "nose"]), "'wrist_3_joint' is missing"),
    ],
)
def test_what_is_no_position_of_every_joint_is_refused_and_said(joints, data, part):
    joints.push_datagram(data, HERE, START)
    assert (joints.received.accepted, joints.received.refused) == (0, 1)
    with pytest.raises(JointsError) as error:
        joints.q_at(START)
    assert part in str(error.value) and error.value.q.tolist() == [0.0] * 6


def test_datagrams_are_received_and_their_absence_is_an_error():
    with UdpJoints(ROBOT) as joints:
        with pytest.raises(DeviceError) as error:
            joints.wait(0.01)
        for part in (joints.uri, "within 0.01 s", '"name": ["shoulder', "start what"):
            assert part in str(error.value)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            sender.sendto(encode(), ("127.0.0.1", int(joints.uri.split(":")[-1])))
        joints.wait(10.0)
        assert joints.q_at(time.time_ns()).tolist() == Q


class Switched:
    """Joint positions that are known from 2 to 3 s on."""

    def __call__(self, stamp):
        return [] if 2 * SECOND <= stamp - START < 3 * SECOND else None


def test_taxels_are_not_used_while_joint_positions_are_missing_and_that_is_said():
    transport = ScriptedTransport(ManualClock(START), encode_arrivals(stream_all(0, 5)))
    source = DeviceSource(
        transport,
        MOUNTED,
        calibration_of(SKIN),
        CalledJoints(Switched(), MOUNTED.robot),
        transport.clock,
        "test:",
        50.0,
    )
    events = []
    with source:
        while source.clock.now() < START + 4 * SECOND:
            scan = source.read(0.1)
            events += source.take_events()
            if scan is not None and START + SECOND < scan.stamp < START + 4 * SECOND:
                posed = 2 * SECOND <= scan.stamp - START < 3 * SECOND
                assert scan.received.all() == posed and scan.received.any() == posed
    kinds = [event.kind for event in events if "posed" in event.kind]
    assert kinds == ["unposed", "posed", "unposed"]
    [first, *_] = [event.text for event in events if event.kind == "unposed"]
    assert "no taxel is used" in first and "check what sends them" in first


def test_function_gives_the_joint_positions_of_a_source():
    config = SourceConfig(skin="ur5", rate=50.0, joints=lambda stamp: Q)
    with open_source("udp://127.0.0.1:9751", config=config) as source:
        scan = source.read(1.0)
    assert scan is not None and scan.q.tolist() == Q


def test_joints_are_given_once_and_only_where_a_source_has_none(capsys):
    device = ("udp://127.0.0.1:1",)
    played = ("replay:a.mcap",)
    joints = "udp://127.0.0.1:9760"
    for command, part in (
        (RunCommand(device, joints=joints, q=(0.0,)), "--q"),
        (RunCommand(played, joints=joints), "of its own"),
    ):
        with pytest.raises(EskinError, match=part) as error:
            check_options(command)
        assert "--joints" in str(error.value) and "allowed" in str(error.value)
    words = "calibrate replay:a.mcap --out a.json --joints udp://127.0.0.1:9".split()
    assert_refused(capsys, *words, part="of its own")
