"""This package shows a stream in the browser and accepts touches by the mouse."""

from eskin.page import PageOrder, TouchOrder
from eskin.viewer.calibration import CalibrationViewer
from eskin.viewer.painting import PaintViewer
from eskin.viewer.viewer import Viewer, ViewerConfig

__all__ = [
    "CalibrationViewer",
    "PageOrder",
    "PaintViewer",
    "TouchOrder",
    "Viewer",
    "ViewerConfig",
]
