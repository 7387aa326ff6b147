"""Patches that are not there: the device protocol on real transports."""

from eskin.drivers.virtual.fault import DeviceFault
from eskin.drivers.virtual.fault_parser import FAULT_KINDS, parse_fault
from eskin.drivers.virtual.patch import VirtualPatch
from eskin.drivers.virtual.ports import Port, PtyPort, UdpPort
from eskin.drivers.virtual.skin import VirtualSkin, resample_scans

__all__ = [
    "FAULT_KINDS",
    "DeviceFault",
    "Port",
    "PtyPort",
    "UdpPort",
    "VirtualPatch",
    "VirtualSkin",
    "resample_scans",
    "parse_fault",
]
