"""This module maps names to the modules that implement them, and finds extras.

It is the only module of the product that names its leaves. Commands are named here;
drivers, arms, exporters and recognisers are entry points of installed packages, those
of eskin too:

- `eskin.drivers`: a `Driver`, by the kind of its URIs
- `eskin.arms`: an `ArmDriver`, by the kind of its URI
- `eskin.exporters`: an `Exporter`, by the name of its format
- `eskin.recognisers`: a class derived from `eskin.live.TouchClassifier`, by the name of
  the package that has it

A module is imported when its name is used.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import (
    EntryPoint,
    PackageNotFoundError,
    distribution,
    entry_points,
)
from types import ModuleType
from typing import Any, Literal

from eskin.errors import EskinError, ExtraError

DRIVERS = "eskin.drivers"
ARMS = "eskin.arms"
EXPORTERS = "eskin.exporters"
RECOGNISERS = "eskin.recognisers"
GROUPS = (DRIVERS, ARMS, EXPORTERS, RECOGNISERS)
"""Groups of entry points."""


@dataclass(frozen=True)
class Entry:
    """An entry describes one command."""

    target: str
    """Module and name of its function, which takes the command's dataclass."""

    summary: str
    """What the command does, for the overview."""

    extra: str | None = None
    """Extra of eskin that installs the packages which it needs beyond the core."""


@dataclass(frozen=True)
class Driver:
    """A driver opens the sources of one kind of URI."""

    open: Callable[..., Any]
    """Function of the URIs, an `eskin.app.SourceConfig` and a clock, which returns a
    `Source`; `eskin.app.open_samples` makes one of a `SampleDevice`."""

    form: str
    """Form of its URIs, for messages, such as `serial:PATH`."""

    touches: Literal["cable", "network", "simulated", "recorded"] = "network"
    """Origin of the touches. A real robot is not commanded by those of a network
    without a key, which any sender can fake, nor by simulated or recorded ones."""

    takes_several: bool = False
    """Whether several URIs are the ports of one source."""

    takes_key: bool = False
    """Whether its packets may be sealed with a key."""

    @property
    def is_device(self) -> bool:
        """Return whether somebody touches it now."""
        return self.touches in ("cable", "network")


@dataclass(frozen=True)
class ArmDriver:
    """An arm driver opens the arms of one kind of URI."""

    open: Callable[..., Any]
    """Function of the URI, a clock or None, the gripper's output, and, if the arm has
    `outputs`, the one that shows a question or None. It returns an `Arm`."""

    form: str
    """Form of its URI, for messages, such as `ur://HOST`."""

    is_real: bool = True
    """Whether a person can be near it."""

    outputs: int = 0
    """Number of its digital outputs, which can show a question; they count from 0."""


@dataclass(frozen=True)
class Exporter:
    """An exporter writes a model or recordings in one format."""

    write: Callable[..., dict[str, Any]]
    """Function of a `Model`, or of a list of `Recording`, and of the path to write. It
    returns what was written, as names with numbers."""

    takes: Literal["model", "recordings"] = "recordings"
    """What it writes."""


COMMANDS = {
    "run": Entry("cli.run:run", "recognise live: devices, a recording, a simulation"),
    "demo": Entry(
        "sim.commands.demo:run", "touch a simulated arm at work in the browser"
    ),
    "record": Entry("cli.record:run", "record and label gestures of your own"),
    "replay": Entry("cli.replay:run", "recognise a recording as if live"),
    "view": Entry(
        "labelling.commands.view:run", "play and label a recording in the browser"
    ),
    "label": Entry("labelling.commands.label:run", "label touches by their pressure"),
    "train": Entry(
        "learn.commands.train:run", "train the recogniser on recordings", "train"
    ),
    "evaluate": Entry(
        "learn.commands.evaluate:run", "score a model on labelled recordings", "train"
    ),
    "generate": Entry(
        "sim.commands.generate:run", "generate recordings of simulated people"
    ),
    "convert": Entry("sets.commands.convert:run", "convert a public data set"),
    "export": Entry(
        "cli.export:run", "write a model as ONNX, recordings as bag or tables", "export"
    ),
    "report": Entry(
        "exports.commands.report:run", "report force and pressure of each touch"
    ),
    "calibrate": Entry("cli.calibrate:run", "measure rest, noise and gain of a skin"),
    "device": Entry(
        "sim.commands.device:run", "act as a skin: send simulated or recorded touches"
    ),
    "skin show": Entry(
        "design.commands.show:run",
        "describe and draw a skin",
        "train",
    ),
    "skin check": Entry("design.commands.check:run", "check a skin's files"),
    "skin design": Entry(
        "design.commands.design:run",
        "lay a skin on a robot, and draw its patches",
        "design",
    ),
    "skin place": Entry(
        "design.commands.place:run", "lay a ready-made matrix on a link", "design"
    ),
    "skin convert": Entry(
        "design.commands.convert:run", "from and to URDF, iCub, GenTact"
    ),
    "skin pose": Entry("design.commands.pose:run", "measure where patches are mounted"),
    "skin points": Entry(
        "design.commands.pose:run_points", "choose where to press for that"
    ),
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

LEARNING = "eskin.learn.commands.models"
"""Module of the functions that train and score models from Python."""


def load_function(target: str) -> Callable[..., Any]:
    """Import the function of an entry.

    Args:
        target: module of eskin and name of the function, as `cli.run:run`.
    """
    module, function = target.split(":")
    return getattr(import_module(f"eskin.{module}"), function)


def load_learning(name: str) -> Callable[..., Any]:
    """Import a name of eskin by which models are trained or scored.

    Raises:
        ExtraError: torch is not installed.
    """
    module = find_package(LEARNING, "torch", "train", f"eskin.{name}")
    return getattr(module, name)


def find_plugins(group: str) -> dict[str, EntryPoint]:
    """Return the entry points of a group by their names, in alphabetic order.

    Raises:
        EskinError: two packages have one name, or eskin is not installed as it is now.
    """
    found: dict[str, EntryPoint] = {}
    for entry in sorted(entry_points(group=group), key=lambda each: each.name):
        other = found.setdefault(entry.name, entry)
        if other.value != entry.value:
            raise EskinError(
                f"'{entry.name}' of {group} is {other.value} of {name_package(other)} "
                f"and {entry.value} of {name_package(entry)}; allowed is one; "
                "uninstall one of the packages"
            )
    if not found:
        raise EskinError(
            f"no entry point of {group} is installed, not even of eskin; allowed "
            f"is an eskin installed as it is now; install it again: {advise_install()}"
        )
    return found


def load_plugin(group: str, name: str) -> Any:  # noqa: ANN401
    """Import what an entry point names; None where the group has no such name.

    Raises:
        EskinError: a package other than eskin fails while it is imported.
    """
    entry = find_plugins(group).get(name)
    if entry is None:
        return None
    try:
        return entry.load()
    except Exception as error:
        if isinstance(error, EskinError) or entry.module.startswith("eskin."):
            raise
        raise EskinError(
            f"'{name}' of {group} cannot be loaded from {name_package(entry)} "
            f"({type(error).__name__}: {error}); allowed is a package that can be "
            "imported; install it again, or uninstall it"
        ) from error


def list_forms(group: str) -> str:
    """Return the forms of the URIs of all drivers or arms, for messages."""
    forms = []
    for name in find_plugins(group):
        try:
            forms.append(load_plugin(group, name).form)
        except (EskinError, ImportError, AttributeError):
            forms.append(f"{name}:")
    return ", ".join(forms[:-1]) + f" or {forms[-1]}"


def name_package(entry: EntryPoint) -> str:
    """Return name and version of the package that has an entry point."""
    return "?" if entry.dist is None else f"{entry.dist.name} {entry.dist.version}"


def advise_install(extra: str = "") -> str:
    """Return the command that installs eskin with an extra.

    The command names the clone in which it is run where eskin was installed from one,
    and else the package.
    """
    try:
        origin = distribution("eskin").read_text("direct_url.json") or "{}"
    except PackageNotFoundError:
        origin = '{"dir_info": {}}'
    what = "." if "dir_info" in json.loads(origin) else "eskin"
    return f"pip install '{what}[{extra}]'" if extra else f"pip install {what}"


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
            f"installed; {advise_install(extra)}"
        ) from error
