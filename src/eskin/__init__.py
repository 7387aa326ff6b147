"""Touch gestures from a robot's electronic skin.

The names below are imported when they are first used, so that `import eskin` is quick.
"""

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from eskin.app import SourceConfig, open_source
    from eskin.drivers import Source
    from eskin.errors import EskinError
    from eskin.learn.commands.models import cross_validate as cross_validate
    from eskin.learn.commands.models import evaluate as evaluate
    from eskin.learn.commands.models import train as train
    from eskin.learn.config import TrainConfig as TrainConfig
    from eskin.live import (
        DecisionConfig,
        Detection,
        Model,
        ModelCard,
        Recognizer,
        load_model,
    )
    from eskin.notebook import find_touches, measure_pressures, plot_skin, show_skin
    from eskin.recording import (
        Recording,
        RecordingWriter,
        find_recordings,
        read_recording,
    )
    from eskin.robot import Robot, load_robot
    from eskin.skin import MountedSkin, Skin, load_skin
    from eskin.stream import Stream
    from eskin.touch import Calibration, Reading, Scan

EXPORTS = {
    "app": "SourceConfig open_source",
    "drivers": "Source",
    "errors": "EskinError",
    "notebook": "find_touches measure_pressures plot_skin show_skin",
    "live": "DecisionConfig Detection Model ModelCard Recognizer load_model",
    "recording": "Recording RecordingWriter find_recordings read_recording",
    "robot": "Robot load_robot",
    "skin": "MountedSkin Skin load_skin",
    "stream": "Stream",
    "touch": "Calibration Reading Scan",
}
LEARNING = ("TrainConfig", "cross_validate", "evaluate", "train")
"""Public names that need the packages of training, so that `import *` omits them."""
PACKAGES = {
    name: package for package, names in EXPORTS.items() for name in names.split()
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
    "find_recordings",
    "find_touches",
    "load_model",
    "load_robot",
    "load_skin",
    "measure_pressures",
    "open_source",
    "plot_skin",
    "read_recording",
    "show_skin",
]


def __getattr__(name: str) -> object:
    """Import a name from its package when it is first used."""
    if name == "__version__":
        return importlib.import_module("importlib.metadata").version("eskin")
    if name in LEARNING:
        return importlib.import_module("eskin.registry").load_learning(name)
    if name not in PACKAGES:
        raise AttributeError(f"module 'eskin' has no attribute '{name}'")
    importlib.import_module("eskin.errors").check_platform()
    value = getattr(importlib.import_module(f"eskin.{PACKAGES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """Return the public names, whether or not they have been imported."""
    return [*__all__, *LEARNING, "__version__"]
