"""Patches that are not there: the device protocol on real transports."""

from eskin.drivers.virtual.fault import Fault
from eskin.drivers.virtual.fault_parser import KINDS, parse_fault
from eskin.drivers.virtual.patch import VirtualPatch
from eskin.drivers.virtual.ports import Port, PtyPort, UdpPort
from eskin.drivers.virtual.skin import VirtualSkin, at_rate

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
