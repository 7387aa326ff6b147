"""Touch gestures from a robot's electronic skin.

The names below are imported when they are first used, so that `import eskin` is quick.
"""

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from eskin.app import SourceConfig, open_source
    from eskin.drivers import Source
    from eskin.errors import EskinError
    from eskin.live import Detection, Recognizer
    from eskin.model import DecisionConfig, Model, ModelCard, load_model
    from eskin.recording import Recording, RecordingWriter, read_recording
    from eskin.robot import Robot, load_robot
    from eskin.skin import MountedSkin, Skin, load_skin
    from eskin.stream import Stream
    from eskin.touch import Calibration, Reading, Scan

HOMES = {
    "Calibration": "touch",
    "DecisionConfig": "model",
    "Detection": "live",
    "EskinError": "errors",
    "Model": "model",
    "ModelCard": "model",
    "MountedSkin": "skin",
    "Reading": "touch",
    "Recognizer": "live",
    "Recording": "recording",
    "RecordingWriter": "recording",
    "Robot": "robot",
    "Scan": "touch",
    "Skin": "skin",
    "Source": "drivers",
    "SourceConfig": "app",
    "Stream": "stream",
    "load_model": "model",
    "load_robot": "robot",
    "load_skin": "skin",
    "open_source": "app",
    "read_recording": "recording",
}

__all__ = [
    "Calibration",
    "DecisionConfig",
    "Detection",
    "EskinError",
    "Model",
    "ModelCard",
    "MountedSkin",
    "Reading",
    "Recognizer",
    "Recording",
    "RecordingWriter",
    "Robot",
    "Scan",
    "Skin",
    "Source",
    "SourceConfig",
    "Stream",
    "load_model",
    "load_robot",
    "load_skin",
    "open_source",
    "read_recording",
]


def __getattr__(name: str) -> object:
    """Import a name from its package when it is first asked for."""
    if name not in HOMES:
        raise AttributeError(f"module 'eskin' has no attribute '{name}'")
    found = getattr(importlib.import_module(f"eskin.{HOMES[name]}"), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    """The names that can be had."""
    return sorted([*globals(), *__all__])
