"""This package simulates patches that speak the device protocol, and their faults."""

from eskin.sim.virtual.fault_kinds import FAULT_KINDS
from eskin.sim.virtual.fault_parser import parse_fault
from eskin.sim.virtual.patch import VirtualPatch
from eskin.sim.virtual.ports import PtyPort, UdpPort, VirtualPort
from eskin.sim.virtual.skin import VirtualSkin, resample_scans

__all__ = [
    "FAULT_KINDS",
    "PtyPort",
    "UdpPort",
    "VirtualPatch",
    "VirtualPort",
    "VirtualSkin",
    "parse_fault",
    "resample_scans",
]
