"""From counts to touches: calibration, faults, contacts, tracks, touches."""

from eskin.touch.calibration import Calibration, CalibrationConfig, Calibrator
from eskin.touch.contacts import Contact, ContactConfig, ContactFinder
from eskin.touch.fault import Fault
from eskin.touch.faults import FaultConfig, FaultFinder
from eskin.touch.pipeline import PipelineConfig, TouchPipeline, TouchState
from eskin.touch.reading import Reading, Scan
from eskin.touch.touches import Touch, TouchConfig, TouchGrouper
from eskin.touch.tracks import Track, TrackConfig, Tracker

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
    "PipelineConfig",
    "Reading",
    "Scan",
    "Touch",
    "TouchConfig",
    "TouchGrouper",
    "TouchPipeline",
    "TouchState",
    "Track",
    "TrackConfig",
    "Tracker",
]
