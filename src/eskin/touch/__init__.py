"""From counts to touches: calibration, faults, contacts, tracks, touches."""

from eskin.touch.calibration import Calibration, CalibrationConfig, Calibrator
from eskin.touch.contacts import Contact, ContactConfig, ContactFinder
from eskin.touch.fault import Fault, FaultKind
from eskin.touch.faults import FaultConfig, FaultFinder
from eskin.touch.reading import Reading, Scan

__all__ = [
    "Calibration",
    "CalibrationConfig",
    "Calibrator",
    "Contact",
    "ContactConfig",
    "ContactFinder",
    "Fault",
    "FaultConfig",
    "FaultFinder",
    "FaultKind",
    "Reading",
    "Scan",
]
