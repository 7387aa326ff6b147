"""This package simulates devices: virtual patches on real transports."""

from eskin.drivers.virtual.fault import DeviceFault
from eskin.drivers.virtual.fault_kinds import FAULT_KINDS
from eskin.drivers.virtual.fault_parser import parse_fault
from eskin.drivers.virtual.patch import VirtualPatch
from eskin.drivers.virtual.ports import PtyPort, UdpPort, VirtualPort
from eskin.drivers.virtual.skin import VirtualSkin, resample_scans

__all__ = [
    "FAULT_KINDS",
    "DeviceFault",
    "PtyPort",
    "UdpPort",
    "VirtualPatch",
    "VirtualPort",
    "VirtualSkin",
    "resample_scans",
    "parse_fault",
]
