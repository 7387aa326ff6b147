"""Receive detections over ROS 2 in a program that uses nothing of eskin.

    eskin run --source sim:ur5 --ros2 &
    python examples/06_ros2_subscriber.py

It needs only Eclipse Cyclone DDS (`pip install cyclonedds`), no ROS: the type of the
messages is discovered from the publisher. In a workspace of ROS 2, a node of rclpy
subscribes to `/eskin/detection` as to any other topic.
"""

import os
import time
from dataclasses import dataclass

import tyro
from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication
from cyclonedds.core import DDSException
from cyclonedds.domain import DomainParticipant
from cyclonedds.dynamic import get_types_for_typeid
from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

TOPIC = "rt/eskin/detection"
"""Name that ROS 2 gives to the topic `/eskin/detection` in DDS."""
QOS = Qos(
    Policy.Reliability.Reliable(duration(seconds=1)),
    Policy.DataRepresentation(use_cdrv0_representation=True),
)


@dataclass(frozen=True)
class Example:
    """Receive detections over ROS 2."""

    count: int = 10
    """Number of detections after which to end."""


def discover_type(participant: DomainParticipant) -> type:
    """Return the type of the messages, once somebody publishes them."""
    publications = BuiltinDataReader(participant, BuiltinTopicDcpsPublication)
    while True:
        for publication in publications.read(1000):
            if getattr(publication, "topic_name", None) != TOPIC:
                continue
            wait = duration(seconds=5)
            try:
                return get_types_for_typeid(participant, publication.type_id, wait)[0]
            except DDSException as error:
                # A publisher that does not answer in time is asked again.
                if error.code != DDSException.DDS_RETCODE_TIMEOUT:
                    raise
        time.sleep(0.05)


def main(example: Example) -> None:
    """Print detections as they come."""
    participant = DomainParticipant(int(os.environ.get("ROS_DOMAIN_ID", "0")))
    topic = Topic(participant, TOPIC, discover_type(participant))
    detections = DataReader(participant, topic, QOS).take_iter()
    for _, found in zip(range(example.count), detections, strict=False):
        print(f"{found.gesture} {found.confidence:.0%} on {found.link}", flush=True)


if __name__ == "__main__":
    main(tyro.cli(Example))
