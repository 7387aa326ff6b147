"""From counts to touches: calibration, faults, contacts, tracks, touches."""

from eskin.touch.calibration import Calibration, CalibrationConfig, Calibrator
from eskin.touch.faults import Fault, FaultConfig, FaultDetector
from eskin.touch.pipeline import PipelineConfig, TouchPipeline
from eskin.touch.reading import Reading, Scan
from eskin.touch.records import TouchRecords
from eskin.touch.touches import (
    Contact,
    ContactConfig,
    Touch,
    TouchConfig,
    TouchState,
    Track,
    TrackConfig,
)

__all__ = [
    "Calibration",
    "CalibrationConfig",
    "Calibrator",
    "Contact",
    "ContactConfig",
    "Fault",
    "FaultConfig",
    "FaultDetector",
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
