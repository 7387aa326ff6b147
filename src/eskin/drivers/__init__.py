"""This package implements the device protocol and the sources of scans."""

from eskin.drivers.assembler import Assembler
from eskin.drivers.clock import Clock, HostClock, ManualClock
from eskin.drivers.csv_matrix import CsvMatrix
from eskin.drivers.device_source import DeviceSource
from eskin.drivers.events import Event, EventLog
from eskin.drivers.joints import (
    CalledJoints,
    FixedJoints,
    JointHistory,
    JointSource,
    UdpJoints,
)
from eskin.drivers.packet import (
    Data,
    Deframer,
    Echo,
    Hello,
    Packet,
    Request,
    Status,
    decode_packet,
    encode_frame,
    encode_packet,
)
from eskin.drivers.played_source import STEPPED, PlayedSource, replay_source
from eskin.drivers.sampled_source import PatchSample, SampleDevice, SampledSource
from eskin.drivers.serial_transport import (
    SerialPortInfo,
    SerialTransport,
    list_serial_ports,
)
from eskin.drivers.sessions import HostSessions, SessionSeal, read_key
from eskin.drivers.source import ReceivedPacket, Source, SourceInfo, Transport
from eskin.drivers.source_checks import Observation, check_source, observe_source
from eskin.drivers.timeline import ScanRateMeter
from eskin.drivers.udp_transport import UdpTransport, check_udp_host

__all__ = [
    "STEPPED",
    "Assembler",
    "CalledJoints",
    "Clock",
    "CsvMatrix",
    "Data",
    "Deframer",
    "DeviceSource",
    "Echo",
    "Event",
    "EventLog",
    "FixedJoints",
    "Hello",
    "HostClock",
    "HostSessions",
    "JointHistory",
    "JointSource",
    "ManualClock",
    "Observation",
    "Packet",
    "PatchSample",
    "PlayedSource",
    "ReceivedPacket",
    "Request",
    "SampleDevice",
    "SampledSource",
    "ScanRateMeter",
    "SerialPortInfo",
    "SerialTransport",
    "SessionSeal",
    "Source",
    "SourceInfo",
    "Status",
    "Transport",
    "UdpJoints",
    "UdpTransport",
    "check_source",
    "check_udp_host",
    "decode_packet",
    "encode_frame",
    "encode_packet",
    "list_serial_ports",
    "observe_source",
    "read_key",
    "replay_source",
]
