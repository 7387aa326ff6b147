"""From counts to touches: calibration, faults, contacts, tracks, touches."""

from eskin.touch.calibration import Calibration, CalibrationConfig, Calibrator
from eskin.touch.contacts import Contact, ContactConfig
from eskin.touch.fault import Fault
from eskin.touch.faults import FaultConfig, FaultFinder
from eskin.touch.pipeline import PipelineConfig, TouchPipeline
from eskin.touch.reading import Reading, Scan
from eskin.touch.records import TouchRecords
from eskin.touch.state import TouchState
from eskin.touch.touches import Touch, TouchConfig
from eskin.touch.tracks import Track, TrackConfig

__all__ = [
    "Calibration",
    "CalibrationConfig",
    "Calibrator",
    "Contact",
    "ContactConfig",
    "Fault",
    "FaultConfig",
    "FaultFinder",
    "PipelineConfig",
    "Reading",
    "Scan",
    "Touch",
    "TouchConfig",
    "TouchPipeline",
    "TouchRecords",
    "TouchState",
    "Track",
    "TrackConfig",
]
