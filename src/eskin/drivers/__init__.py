"""This package implements the device protocol and the sources of scans."""

from eskin.drivers.clock import Clock, HostClock, ManualClock
from eskin.drivers.device_source import DeviceSource
from eskin.drivers.events import Event
from eskin.drivers.packet import (
    Data,
    Hello,
    Packet,
    Status,
    decode_packet,
    encode_packet,
)
from eskin.drivers.played_source import STEPPED, PlayedSource, replay_source
from eskin.drivers.serial_transport import SerialTransport
from eskin.drivers.source import FixedJoints, JointSource, Source, SourceInfo
from eskin.drivers.transport import ReceivedPacket, Transport
from eskin.drivers.udp_transport import UdpTransport

__all__ = [
    "STEPPED",
    "Clock",
    "Data",
    "ReceivedPacket",
    "DeviceSource",
    "Event",
    "FixedJoints",
    "Hello",
    "HostClock",
    "JointSource",
    "ManualClock",
    "Packet",
    "PlayedSource",
    "SerialTransport",
    "Source",
    "SourceInfo",
    "Status",
    "Transport",
    "UdpTransport",
    "decode_packet",
    "encode_packet",
    "replay_source",
]
