"""What may go wrong with a virtual skin, on request."""

from eskin.drivers.virtual.fault import Fault, Order
from eskin.drivers.virtual.fault_parser import KINDS, parse_fault

__all__ = ["KINDS", "Fault", "Order", "parse_fault"]
