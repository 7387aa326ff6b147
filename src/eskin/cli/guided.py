"""This module holds what commands share that guide a person, in terminal and page."""

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from itertools import dropwhile
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Generic, TypeVar

import numpy as np
import tyro
from jaxtyping import Float

from eskin.cli.checks import POSITIVE_OR_INF
from eskin.errors import DeviceError

if TYPE_CHECKING:
    from eskin.app import SourceConfig
    from eskin.calibration import GuideEvent, PressGuide
    from eskin.drivers import Source
    from eskin.page import GuideBoard, PressPlace
    from eskin.page.calibration_viewer import CalibrationViewer
    from eskin.skin import MountedSkin
    from eskin.touch import Scan

PATIENCE = 10.0
"""Longest wait for the first byte of a device [s]."""
GUIDED_KINDS = {"serial", "csv", "udp", "xela", "replay"}
"""Schemes of the sources that a person can be guided with."""


@dataclass(frozen=True, kw_only=True)
class SourceCommand:
    """The options that say which skin is read, and how."""

    source: tuple[str, ...]
    """Source of the scans."""

    skin: str | None = None
    """Skin of the device: a preset's name or a skin's folder. Recordings and
    simulations have their own."""

    robot_urdf: str | None = None
    """Robot that the skin is mounted on: a URDF file or a preset's name. Preset skins
    have their own."""

    calibration: Path | None = None
    """Calibration file of the electronics, as eskin calibrate writes it. By default it
    is that of the recording, or calibration.json in the skin's folder, else a nominal
    calibration."""

    q: Annotated[tuple[float, ...] | None, tyro.conf.arg(metavar="RAD...")] = None
    """Joint positions [rad] of a robot that does not move; zeros by default."""

    joints: str | None = None
    """Address to which the joint positions of a robot are sent as JSON,
    udp://HOST:PORT."""

    rate: Annotated[float | None, POSITIVE_OR_INF] = None
    """Rate of the devices' scans [1/s]; by default the one that they announce."""

    baud: int | None = None
    """Baud rate of serial ports, 1,000,000 for serial: and 115,200 for csv: by default;
    ignored by ports that are USB only."""

    allow_remote: bool = False
    """Accept UDP packets from other computers, although UDP does not authenticate the
    sender. With --key they are accepted anyway."""

    key: Path | None = None
    """Key file of the patches: 64 hexadecimal digits that only you may read. Packets
    without a valid seal are refused."""

    def build_config(self, pace: float) -> "SourceConfig":
        """Build the configuration of the source.

        Args:
            pace: seconds of a recording or simulation that are played in a second.

        Raises:
            DeviceError: the key cannot be used.
        """
        from eskin.app import SourceConfig
        from eskin.drivers import read_key

        return SourceConfig(
            skin=self.skin,
            robot=self.robot_urdf,
            calibration=self.calibration,
            q=self.q,
            rate=self.rate,
            pace=pace,
            patience=PATIENCE,
            baud=self.baud,
            allow_remote=self.allow_remote,
            key=None if self.key is None else read_key(self.key),
        )


@dataclass(frozen=True, kw_only=True)
class GuidedCommand(SourceCommand):
    """The options of commands that guide a person."""

    source: tyro.conf.Positional[tuple[str, ...]]
    """Device, serial:PATH or csv:PATH (one or several), udp://HOST:PORT or
    xela://HOST:PORT; or replay:FILE."""

    @property
    def pace(self) -> float:
        """Seconds of a recording that are played in a second."""
        return math.inf


@dataclass(frozen=True, kw_only=True)
class PressCommand(GuidedCommand):
    """The options of commands that ask for presses, in the browser too."""

    wait: float = 30.0
    """Longest time to wait for what is asked for before it is left out [s]."""

    view: bool = False
    """Guide in the browser too, where the place to press is marked on the robot. It
    begins once the page is opened; a recording is then played as fast as it was made.
    """

    port: int | None = None
    """TCP port of the page on this computer, 8080 by default; 0 takes any free one."""

    @property
    def is_live(self) -> bool:
        """Whether somebody can be asked for presses, unlike by a recording."""
        return not (self.source and self.source[0].startswith("replay:"))

    @property
    def pace(self) -> float:
        """Seconds of a recording that are played in a second."""
        return 1.0 if self.view else math.inf

    def check_page_options(self) -> None:
        """Raise if an option is out of range.

        Raises:
            ValueError: for --wait or --port.
        """
        if not 1.0 <= self.wait < math.inf:
            raise ValueError(
                f"--wait is {self.wait:g}; allowed are 1 and above; change it"
            )
        if self.port is not None and not self.view:
            raise ValueError(
                "--port is given without --view; allowed is both; ask for the page"
            )


Guide = TypeVar("Guide", bound="PressGuide[Any]")


class Dialogue(ABC, Generic[Guide]):
    """A dialogue puts what a guide asks for, and what it has felt, into words."""

    guide: Guide

    def describe_request(self) -> str:
        """Describe what to do now; empty where nothing is to be done."""
        guide = self.guide
        if guide.phase == "rest":
            return f"hands off for {guide.rest_seconds:g} s"
        return self.describe_press() if guide.phase == "press" else ""

    @abstractmethod
    def describe_press(self) -> str:
        """Describe where to press now; empty where nothing is to be pressed."""

    @abstractmethod
    def describe_event(self, event: "GuideEvent") -> str:
        """Describe what a scan has led to; empty where there is nothing to say."""

    @abstractmethod
    def describe_skip(self) -> str:
        """Describe that what is asked for is left out."""

    @abstractmethod
    def find_place(self) -> "PressPlace | None":
        """Find the place to press now; None where none is to be pressed."""

    def build_board(self) -> "GuideBoard":
        """Build what the page shows of the guide."""
        from eskin.page import GuideBoard

        guide = self.guide
        place = self.find_place() if guide.phase == "press" else None
        count = len(guide.presses)
        return GuideBoard(self.describe_request(), guide.progress, place, presses=count)


def build_place(
    name: str, mounted: "MountedSkin", taxel: int, p_link: Float[np.ndarray, "3"]
) -> "PressPlace":
    """Build a place to press, with link and normal of a taxel there.

    Args:
        name: name by which the page asks to leave it out.
        mounted: the skin on its robot.
        taxel: taxel there.
        p_link: the place in the frame of the taxel's link [m].
    """
    from eskin.page import PressPlace

    (x, y, z), (nx, ny, nz) = p_link.tolist(), mounted.skin.normals[taxel].tolist()
    link = int(mounted.taxel_link_index[taxel])
    return PressPlace(name, link, (x, y, z), (nx, ny, nz))


def open_guided_source(command: GuidedCommand, stack: ExitStack) -> "Source":
    """Open a device, or a recording.

    Args:
        command: what is opened.
        stack: what closes it.

    Raises:
        DeviceError: the source is neither.
    """
    from eskin.app import open_joints, open_source
    from eskin.live import mount_skin

    check_joints(command.joints, command.q, command.source)

    kinds = {uri.partition(":")[0] for uri in command.source}
    if not command.source or not kinds <= GUIDED_KINDS:
        raise DeviceError(
            f"source is '{' '.join(command.source)}'; allowed are serial:PATH, "
            "csv:PATH, udp://HOST:PORT, xela://HOST:PORT and replay:FILE; correct it"
        )
    if command.skin is None and "replay" not in kinds:
        raise DeviceError(
            f"{command.source[0]} is given without --skin; allowed is a preset's name "
            "or a skin's folder; say whose patches they are"
        )
    config = command.build_config(command.pace)
    if command.skin is not None and command.joints is not None:
        robot = mount_skin(command.skin, command.robot_urdf).robot
        joints = open_joints(command.joints, robot, None, command.allow_remote)
        config = replace(config, joints=stack.enter_context(joints))
    return stack.enter_context(open_source(*command.source, config=config))


def check_joints(
    joints: str | None, q: tuple[float, ...] | None, sources: tuple[str, ...]
) -> None:
    """Raise if joint positions are given twice, or to a source that has its own.

    Raises:
        DeviceError: for --joints or --q.
    """
    if joints is not None and q is not None:
        raise DeviceError(
            "--joints is given with --q; allowed is one of them; leave out --q of a "
            "robot that moves"
        )
    played = [uri for uri in sources if uri.startswith(("replay:", "sim:"))]
    if joints is not None and played:
        raise DeviceError(
            f"--joints is given with {played[0]}, which has joint positions of its "
            "own; allowed is --joints with a device; leave it out"
        )


def print_line(line: str) -> None:
    """Print a line at once, unless it is empty."""
    if line:
        print(line, flush=True)


def open_page(
    command: PressCommand, mounted: "MountedSkin", rate: float, stack: ExitStack
) -> "CalibrationViewer | None":
    """Start the page where it is asked for, and print its link.

    Raises:
        DeviceError: the port is not available.
    """
    if not command.view:
        return None
    from eskin.page.calibration_viewer import CalibrationViewer
    from eskin.page.link import DEFAULT_PORT, free_port
    from eskin.page.viewer import ViewerConfig

    port = free_port(DEFAULT_PORT if command.port is None else command.port)
    config = ViewerConfig(port)
    page = CalibrationViewer(mounted, rate, config)
    stack.callback(page.close)
    print(f"see {config.link}", flush=True)
    return page


def await_page(
    source: "Source", page: "CalibrationViewer | None", is_live: bool
) -> "Iterable[Scan]":
    """Return the scans from the time on at which a browser has opened the page.

    A recording begins then. Scans of a device do not wait, and are dropped until then.
    """
    if page is None:
        return source
    if not is_live:
        page.wait_opened()
    return dropwhile(lambda scan: not page.is_opened, source)


def guide_person(
    scans: "Iterable[Scan]",
    dialogue: Dialogue[Any],
    wait: float,
    page: "CalibrationViewer | None" = None,
) -> None:
    """Push scans until all is measured, and say what to do and what was felt.

    Args:
        scans: scans of the skin.
        dialogue: what is said of the guide.
        wait: longest time to wait for rest and for each press [s]; infinite for a
            recording, which nobody can be asked for presses.
        page: page that shows the same as the terminal; None without a page.
    """
    from eskin.units import NS_PER_S

    guide = dialogue.guide
    asks = math.isfinite(wait)
    print_line(dialogue.describe_request())
    since: int | None = None
    for scan in scans:
        since = scan.stamp if since is None else since
        was_rest, event = guide.phase == "rest", guide.push(scan)
        limit = wait + guide.rest_seconds * was_rest
        # A press that goes on is waited for.
        is_late = scan.stamp - since > limit * NS_PER_S and not guide.is_pressed
        told = ""
        if event is not None:
            told = dialogue.describe_event(event)
        elif is_late and was_rest:
            return
        elif is_late or is_skipped(dialogue, page):
            told = f"{'nothing felt: ' * is_late}{dialogue.describe_skip()}"
            guide.skip()
        elif takes_back(guide, page):
            told = "the last press is not used"
            guide.withdraw()
        say(told, page)
        if told and not (event is not None and event.kind == "touched"):
            since = scan.stamp
            if asks or event is None:
                print_line(dialogue.describe_request())
        if page is not None and guide.state is not None and page.wants():
            page.show(guide.state, dialogue.build_board())
        if guide.phase == "done":
            return


def is_skipped(dialogue: Dialogue[Any], page: "CalibrationViewer | None") -> bool:
    """Tell whether the person has left out, in the page, what is asked for."""
    if page is None or page.skipped is None or dialogue.guide.phase != "press":
        return False
    # What was asked of an earlier place is out of date.
    skipped, page.skipped = page.skipped, None
    place = dialogue.find_place()
    return place is not None and place.name == skipped


def takes_back(guide: "PressGuide[Any]", page: "CalibrationViewer | None") -> bool:
    """Tell whether the person wants, in the page, to repeat the last press."""
    if page is None or page.repeated is None:
        return False
    # What was asked of an earlier press is out of date.
    repeated, page.repeated = page.repeated, None
    return guide.phase == "press" and 0 < repeated == len(guide.presses)


def show_result(
    page: "CalibrationViewer | None", guide: "PressGuide[Any]", lines: list[str]
) -> None:
    """Show the result in the page until the person closes it there, or by Ctrl-C."""
    from eskin.page import GuideBoard

    if page is None:
        return
    assert guide.state is not None
    page.show(guide.state, GuideBoard("finished", 1.0, None, tuple(lines)))
    with suppress(KeyboardInterrupt):
        page.wait_closed()


def say(line: str, page: "CalibrationViewer | None" = None) -> None:
    """Print a line unless it is empty, and add it to the log of the page."""
    print_line(line)
    if line and page is not None:
        page.tell(line)
