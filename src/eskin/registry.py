"""This module maps names to the modules that implement them, and finds extras.

It is the only module of the product that names the leaves `eskin.sim`, `eskin.learn`
and `eskin.design`. A module is imported when its name is used.
"""

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from types import ModuleType
from typing import Any

from eskin.errors import ExtraError


@dataclass(frozen=True)
class Entry:
    """An entry describes one command."""

    target: str
    """Module and name of its function, which takes the command's dataclass."""

    summary: str
    """What the command does, for the overview."""

    extra: str | None = None
    """Extra of eskin that installs the packages which it needs beyond the core."""


COMMANDS = {
    "run": Entry("cli.run:run", "recognise live: devices, a recording, a simulation"),
    "demo": Entry(
        "sim.commands.demo:run", "touch a simulated arm at work in the browser"
    ),
    "record": Entry("cli.record:run", "record and label gestures of your own"),
    "replay": Entry("cli.recordings:run_replay", "recognise a recording as if live"),
    "view": Entry(
        "cli.recordings:run_view", "play and label a recording in the browser"
    ),
    "label": Entry("cli.recordings:run_label", "label touches by their pressure"),
    "train": Entry(
        "learn.commands.train:run", "train the recogniser on recordings", "train"
    ),
    "evaluate": Entry(
        "learn.commands.evaluate:run", "score a model on labelled recordings", "train"
    ),
    "generate": Entry(
        "sim.commands.generate:run", "generate recordings of simulated people"
    ),
    "convert": Entry("learn.commands.convert:run", "convert a public data set"),
    "export": Entry(
        "cli.export:run", "write a model as ONNX, recordings as bag or tables", "export"
    ),
    "calibrate": Entry("cli.calibrate:run", "measure rest, noise and gain of a skin"),
    "device": Entry(
        "sim.commands.device:run", "act as a skin: send simulated or recorded touches"
    ),
    "skin show": Entry(
        "cli.skin:run_show", "describe and draw a skin, or what it feels", "train"
    ),
    "skin check": Entry("cli.skin:run_check", "check a skin's files"),
    "skin design": Entry(
        "design.commands.design:run",
        "lay a skin on a robot, and draw its patches",
        "design",
    ),
    "skin place": Entry(
        "design.commands.place:run", "lay a ready-made matrix on a link", "design"
    ),
    "skin convert": Entry("cli.skin:run_convert", "from and to URDF, iCub, GenTact"),
    "skin pose": Entry("cli.pose:run", "measure where patches are mounted"),
    "skin points": Entry("cli.pose:run_points", "choose where to press for that"),
    "skin paint": Entry(
        "design.commands.paint:run",
        "paint in the browser where skin is to lie",
        "design",
    ),
    "bench latency": Entry(
        "sim.commands.bench:run_latency", "time one step of the recogniser"
    ),
    "bench throughput": Entry(
        "sim.commands.bench:run_throughput", "recognise at a rate"
    ),
    "doctor": Entry("cli.doctor:run", "check the installation, compile all code"),
}
"""Entries of the commands, by name."""

MOVED = {
    "compare": "python -m lab.compare",
    "demo --same-touch": "python -m lab.same_touch",
    "study": "python -m lab.study of commit 6f03fd1",
}
"""Commands and options that belong to the laboratory, with their commands there."""

SOURCES = {"sim": "sim.interactive.player:open_simulation"}
"""Functions that open the sources of leaves, by the kind of their URI."""

ARMS = {"sim": "sim.arm:SimulatedArm"}
"""Arms of leaves, by the kind of their URI."""

EXPORTS = {"onnx": "learn.onnx_export:export_onnx"}
"""Functions that write a model, by format."""


def load_function(target: str) -> Callable[..., Any]:
    """Import the function of an entry.

    Args:
        target: module of eskin and name of the function, as `cli.run:run`.
    """
    module, function = target.split(":")
    return getattr(import_module(f"eskin.{module}"), function)


def find_mujoco(what: str) -> ModuleType:
    """Import the simulator MuJoCo, of the extra `sim`.

    Args:
        what: feature that needs it, for the message.

    Raises:
        ExtraError: MuJoCo is not installed.
    """
    return find_package("mujoco", "MuJoCo", "sim", what)


def find_package(module: str, name: str, extra: str, what: str) -> Any:  # noqa: ANN401
    """Import a module of an optional package, without its types.

    Args:
        module: module to import.
        name: name of the package, for the message.
        extra: extra of eskin that installs it.
        what: feature that needs it, for the message.

    Raises:
        ExtraError: The package is not installed.
    """
    try:
        return import_module(module)
    except ImportError as error:
        raise ExtraError(
            f"{what} needs {name}, which is not installed; allowed is with it "
            f"installed; pip install '.[{extra}]'"
        ) from error
