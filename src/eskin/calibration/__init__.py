"""This package estimates the calibration of a skin from rest and a few presses."""

from eskin.calibration.gains import (
    FingertipPress,
    GainEstimate,
    estimate_gains,
)
from eskin.calibration.guide import (
    CalibrationGuide,
    CalibrationResult,
    GuideConfig,
    GuideEvent,
    PressGuide,
    PressRefusal,
    PressRequest,
)
from eskin.calibration.rest import RestEstimate, estimate_rest

__all__ = [
    "CalibrationGuide",
    "CalibrationResult",
    "GainEstimate",
    "GuideConfig",
    "GuideEvent",
    "FingertipPress",
    "PressGuide",
    "PressRefusal",
    "PressRequest",
    "RestEstimate",
    "estimate_gains",
    "estimate_rest",
]
