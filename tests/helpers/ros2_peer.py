"""A program on the same ROS 2 domain that uses nothing of eskin.

It subscribes to topics of eskin, publishes `/joint_states`, and prints what it received
as JSON: `python ros2_peer.py READINGS`. The types are those of `msg/` and of ROS 2.
"""

import json
import os
import sys
import time
from dataclasses import dataclass

from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import (
    float32,
    float64,
    int16,
    int32,
    sequence,
    uint16,
    uint32,
)
from cyclonedds.pub import DataWriter
from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

READING = "rt/eskin/reading"
DETECTION = "rt/eskin/detection"
JOINTS = ("wrist_2_joint", "gripper", "elbow_joint")
PATIENCE = 30.0
POSITIONS = (0.75, 9.0, -0.5)


@dataclass
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    sec: int32
    nanosec: uint32


@dataclass
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    stamp: Time
    frame_id: str


@dataclass
class Reading(IdlStruct, typename="eskin_msgs::msg::dds_::Reading_"):
    header: Header
    counts: sequence[uint16]
    received: sequence[bool]
    shear: sequence[int16]


@dataclass
class Vector(IdlStruct, typename="geometry_msgs::msg::dds_::Vector3_"):
    x: float64
    y: float64
    z: float64


@dataclass
class Point(IdlStruct, typename="geometry_msgs::msg::dds_::Point_"):
    x: float64
    y: float64
    z: float64


@dataclass
class Detection(IdlStruct, typename="eskin_msgs::msg::dds_::Detection_"):
    header: Header
    gesture: str
    confidence: float32
    onset: Time
    end: Time
    link: str
    patch: str
    point: Point
    normal: Vector
    direction: Vector
    peak_force: float32


@dataclass
class JointState(IdlStruct, typename="sensor_msgs::msg::dds_::JointState_"):
    header: Header
    name: sequence[str]
    position: sequence[float64]
    velocity: sequence[float64]
    effort: sequence[float64]


def main(count):
    domain = DomainParticipant(int(os.environ["ROS_DOMAIN_ID"]))
    cdr = Policy.DataRepresentation(use_cdrv0_representation=True)
    reliable = Qos(
        Policy.Reliability.Reliable(duration(seconds=1)), Policy.History.KeepAll, cdr
    )
    joints = DataWriter(domain, Topic(domain, "rt/joint_states", JointState), reliable)
    found = BuiltinDataReader(domain, BuiltinTopicDcpsPublication)
    sys.stdout.write("ready\n")
    sys.stdout.flush()
    end = time.monotonic() + PATIENCE
    # What is sent before a reader knows the writer is lost, so writers come first.
    hashes = {}
    while time.monotonic() < end and not {READING, DETECTION} <= hashes.keys():
        for endpoint in found.take(100):
            data = endpoint.qos[Policy.Userdata] if endpoint.qos else None
            if data is not None and data.data:
                hashes[endpoint.topic_name] = data.data.decode()
        time.sleep(0.01)
    readings = DataReader(domain, Topic(domain, READING, Reading), reliable)
    detections = DataReader(domain, Topic(domain, DETECTION, Detection), reliable)
    received = []
    said = []
    while time.monotonic() < end and (len(received) < count or not said):
        now = Time(*divmod(time.time_ns(), 1_000_000_000))
        joints.write(JointState(Header(now, ""), JOINTS, POSITIONS, (), ()))
        received += [r for r in readings.take(100) if isinstance(r, Reading)]
        said += [d for d in detections.take(100) if isinstance(d, Detection)]
        time.sleep(0.01)
    result = {
        "stamps": [(r.header.stamp.sec, r.header.stamp.nanosec) for r in received],
        "counts": [list(r.counts) for r in received],
        "skin": sorted({r.header.frame_id for r in received}),
        "gestures": [d.gesture for d in said],
        "points": [(d.point.x, d.point.y, d.point.z) for d in said],
        "hashes": hashes,
    }
    sys.stdout.write(json.dumps(result))


if __name__ == "__main__":
    main(int(sys.argv[1]))
