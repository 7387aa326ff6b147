"""This package estimates the calibration of a skin from rest and a few presses."""

from eskin.calibration.gains import (
    FingertipPress,
    GainEstimate,
    GainPrior,
    estimate_gains,
)
from eskin.calibration.guide import (
    CalibrationGuide,
    CalibrationResult,
    GuideConfig,
    GuideEvent,
    PressGuide,
    PressRequest,
)
from eskin.calibration.rest import RestEstimate, RestRecord, estimate_rest

__all__ = [
    "CalibrationGuide",
    "CalibrationResult",
    "GainEstimate",
    "GainPrior",
    "GuideConfig",
    "GuideEvent",
    "FingertipPress",
    "PressGuide",
    "PressRequest",
    "RestEstimate",
    "RestRecord",
    "estimate_gains",
    "estimate_rest",
]
