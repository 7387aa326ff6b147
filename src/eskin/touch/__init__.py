"""From counts to touches: calibration, faults, contacts, tracks, touches."""

from eskin.touch.calibration import Calibration, CalibrationConfig, Calibrator
from eskin.touch.reading import Reading, Scan

__all__ = [
    "Calibration",
    "CalibrationConfig",
    "Calibrator",
    "Reading",
    "Scan",
]
