"""Subscribe to topics as a program that uses nothing of eskin; print what arrived.

    python lab/ros2_listener.py SECONDS

Types are discovered from the publishers, by DDS. Every message is decoded, after the
stream, since that takes longer in Python than in C++; its latency is the time of its
arrival minus the stamp of its header.
"""

import json
import os
import sys
import time

from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication
from cyclonedds.core import InstanceState as Instance
from cyclonedds.core import ReadCondition, SampleState, ViewState, WaitSet
from cyclonedds.domain import DomainParticipant
from cyclonedds.dynamic import get_types_for_typeid
from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

TOPICS = {
    f"rt/{name}"
    for name in (
        "eskin/reading",
        "eskin/pressure",
        "eskin/contacts",
        "eskin/detection",
        "eskin/markers",
        "joint_states",
        "diagnostics",
    )
}
START_SECONDS = 60.0
"""Longest time until the first message [s]."""
QUIET_SECONDS = 3.0
"""Time without a message after which listening ends [s]."""


class Encoded:
    """A message as it arrived; it is decoded when the stream is over."""

    def __init__(self, data: bytes) -> None:
        """Keep the bytes."""
        self.data = data


def discover(domain: DomainParticipant) -> dict[str, type]:
    """Return the types of the topics, once all are published."""
    endpoints = BuiltinDataReader(domain, BuiltinTopicDcpsPublication)
    types: dict[str, type] = {}
    while types.keys() < TOPICS:
        for endpoint in endpoints.take(100):
            name = getattr(endpoint, "topic_name", None)
            if name in TOPICS and name not in types:
                wait = duration(seconds=5)
                types[name], _ = get_types_for_typeid(domain, endpoint.type_id, wait)
        time.sleep(0.05)
    return types


def main(seconds: float) -> None:
    """Listen until nothing comes any more; print counts and latencies as JSON."""
    domain = DomainParticipant(int(os.environ.get("ROS_DOMAIN_ID", "0")))
    qos = Qos(
        Policy.Reliability.Reliable(duration(seconds=1)),
        Policy.History.KeepAll,
        Policy.DataRepresentation(use_cdrv0_representation=True),
    )
    waitset, readers = WaitSet(domain), {}
    types = discover(domain)
    for name, data_type in types.items():
        data_type.deserialize = classmethod(lambda cls, data, **_: Encoded(data))
        reader = DataReader(domain, Topic(domain, name, data_type), qos)
        state = SampleState.Any | ViewState.Any | Instance.Any
        waitset.attach(ReadCondition(reader, state))
        readers[name] = reader
    raw: list[tuple[str, int, bytes]] = []
    end, last = time.monotonic() + seconds + START_SECONDS, None
    while time.monotonic() < (end if last is None else last + QUIET_SECONDS):
        waitset.wait(duration(milliseconds=100))
        for name, reader in readers.items():
            arrived = time.time_ns()
            for message in reader.take(1000):
                if isinstance(message, Encoded):
                    raw.append((name, arrived, message.data))
                    last = time.monotonic()
    stamps: dict[str, list[int]] = {name: [] for name in readers}
    late: dict[str, list[float]] = {name: [] for name in readers}
    for name, arrived, data in raw:
        message = types[name].__idl__.deserialize(data)
        first = message.markers[0] if name.endswith("markers") else message
        stamp = first.header.stamp
        stamps[name].append(stamp.sec * 1_000_000_000 + stamp.nanosec)
        late[name].append((arrived - stamps[name][-1]) / 1e6)
    print(json.dumps({"stamps": stamps, "latency_ms": late}))


if __name__ == "__main__":
    main(float(sys.argv[1]))
