"""Skins on a cable: the device protocol, and where scans come from."""

from eskin.drivers.clock import Clock, HostClock, ManualClock
from eskin.drivers.device_source import DeviceSource
from eskin.drivers.events import Event
from eskin.drivers.packet import Data, Hello, Packet, Status, decode, encode
from eskin.drivers.played_source import STEPPED, PlayedSource, replay_source
from eskin.drivers.serial_transport import SerialTransport
from eskin.drivers.source import FixedJoints, Joints, Source, SourceInfo
from eskin.drivers.transport import Delivery, Transport
from eskin.drivers.udp_transport import UdpTransport

__all__ = [
    "STEPPED",
    "Clock",
    "Data",
    "Delivery",
    "DeviceSource",
    "Event",
    "FixedJoints",
    "Hello",
    "HostClock",
    "Joints",
    "ManualClock",
    "Packet",
    "PlayedSource",
    "SerialTransport",
    "Source",
    "SourceInfo",
    "Status",
    "Transport",
    "UdpTransport",
    "decode",
    "encode",
    "replay_source",
]
