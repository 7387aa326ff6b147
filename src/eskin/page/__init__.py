"""This package serves the page in the browser, in a process of its own.

It imports no recogniser.
"""

from eskin.page.messages import (
    ArmSummary,
    ContactMarker,
    CorrectionOrder,
    GuideBoard,
    LinkMesh,
    LogEntry,
    OpenTouch,
    Order,
    PageOrder,
    PaintOrder,
    PressPlace,
    QuestionBoard,
    RecordingState,
    SceneDescription,
    TouchOrder,
    TouchRule,
    ViewUpdate,
)

__all__ = [
    "ArmSummary",
    "ContactMarker",
    "CorrectionOrder",
    "GuideBoard",
    "Order",
    "PageOrder",
    "PaintOrder",
    "PressPlace",
    "QuestionBoard",
    "RecordingState",
    "ViewUpdate",
    "LogEntry",
    "SceneDescription",
    "LinkMesh",
    "OpenTouch",
    "TouchOrder",
    "TouchRule",
]
