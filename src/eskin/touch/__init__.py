"""This package computes touches from counts: rest, faults, contacts, tracks."""

from eskin.touch.adjacency import Adjacency
from eskin.touch.calibration import MAX_CALIBRATION_BYTES, Calibration
from eskin.touch.fault_kernels import FaultConfig
from eskin.touch.faults import Fault
from eskin.touch.first_use import warm_up_touches
from eskin.touch.front_end import FrontEnd
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
from eskin.touch.rest_kernels import CalibrationConfig
from eskin.touch.taxel_kernels import SILENCE_SECONDS
from eskin.touch.touches import Contact, PressDetector, Touch, TouchState, Track

__all__ = [
    "NO_CONTACT",
    "NO_TOUCHES",
    "SILENCE_SECONDS",
    "Adjacency",
    "Calibration",
    "MAX_CALIBRATION_BYTES",
    "CalibrationConfig",
    "Contact",
    "ContactConfig",
    "ContactRecord",
    "Fault",
    "FaultConfig",
    "FrontEnd",
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
    "warm_up_touches",
]
