"""This package computes touches from counts: calibration, faults, contacts, tracks."""

from eskin.touch.adjacency import Adjacency
from eskin.touch.calibration import MAX_CALIBRATION_BYTES, Calibration
from eskin.touch.calibration_kernels import SILENCE_SECONDS, CalibrationConfig
from eskin.touch.calibrator import Calibrator, CrosstalkCompensator
from eskin.touch.faults import Fault, FaultConfig, FaultDetector
from eskin.touch.pipeline import LinkPoseCache, PipelineConfig, TouchPipeline
from eskin.touch.reading import Reading, Scan
from eskin.touch.records import (
    NO_CONTACT,
    NO_TOUCHES,
    ContactConfig,
    ContactRecord,
    TouchConfig,
    TouchRecord,
    TrackingResult,
)
from eskin.touch.touches import Contact, PressDetector, Touch, TouchState, Track

__all__ = [
    "NO_CONTACT",
    "NO_TOUCHES",
    "SILENCE_SECONDS",
    "Adjacency",
    "Calibration",
    "MAX_CALIBRATION_BYTES",
    "CalibrationConfig",
    "Calibrator",
    "Contact",
    "ContactConfig",
    "ContactRecord",
    "CrosstalkCompensator",
    "Fault",
    "FaultConfig",
    "FaultDetector",
    "LinkPoseCache",
    "PipelineConfig",
    "PressDetector",
    "Reading",
    "Scan",
    "Touch",
    "TouchConfig",
    "TouchPipeline",
    "TouchRecord",
    "TouchState",
    "Track",
    "TrackingResult",
]
