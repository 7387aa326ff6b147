"""Patches that are not there: the device protocol on real transports."""

from eskin.drivers.virtual.faults import KINDS, Fault, parse_fault
from eskin.drivers.virtual.pace import at_rate
from eskin.drivers.virtual.patch import VirtualPatch
from eskin.drivers.virtual.port import Port
from eskin.drivers.virtual.pty_port import PtyPort
from eskin.drivers.virtual.skin import VirtualSkin
from eskin.drivers.virtual.udp_port import UdpPort

__all__ = [
    "KINDS",
    "Fault",
    "Port",
    "PtyPort",
    "UdpPort",
    "VirtualPatch",
    "VirtualSkin",
    "at_rate",
    "parse_fault",
]
