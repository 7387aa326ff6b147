"""This module holds what commands share that guide a person, in terminal and page."""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from itertools import dropwhile
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Generic, Literal, TypeVar, final

import tyro

from eskin.cli.checks import POSITIVE_OR_INF, Range
from eskin.errors import DeviceError
from eskin.units import NS_PER_S, format_count, format_duration

if TYPE_CHECKING:
    from eskin.app import SourceConfig
    from eskin.calibration import GuideEvent, PressGuide, PressRequest
    from eskin.drivers import Event, Source
    from eskin.page import GuideBoard, PressPlace
    from eskin.page.viewer import CalibrationViewer
    from eskin.registry import Driver
    from eskin.skin import MountedSkin, Skin
    from eskin.touch import Fault, Scan, TouchState

PATIENCE = 10.0
"""Longest wait for the first byte of a device [s]."""
WAIT_SECONDS = 10.0
"""Time after which a person who is waited for is told what was felt last [s]."""
APART = 0.5
"""Time without contact after which contact is another touch [s]."""


@dataclass(frozen=True, kw_only=True)
class SourceCommand:
    """The options that say which skin is read, and how."""

    source: tuple[str, ...]
    """Source of the scans."""

    skin: str | None = None
    """Skin of the device: a preset's name or a skin's folder. Recordings and
    simulations have their own."""

    robot_urdf: str | None = None
    """Robot that wears the skin: a URDF file or a preset's name; by default the skin's
    own."""

    calibration: Path | None = None
    """Calibration file of the electronics, as eskin calibrate writes it. By default it
    is that of the recording, or calibration.json in the skin's folder, else a nominal
    calibration."""

    falling: bool = False
    """The sensor's counts become smaller when it is pressed, as with a pull-up
    resistor. The calibration file of eskin calibrate says so itself."""

    bits: Annotated[int | None, Range(8, 16)] = None
    """Bits of the converter, as 10 of an Arduino Uno; 12 where nothing says so. The
    calibration file of eskin calibrate says so itself."""

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
    that were not signed with this key are refused."""

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
            falling=self.falling,
            bits=self.bits,
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

    def check_page_options(self) -> None:
        """Raise if an option is out of range.

        Raises:
            ValueError: for --wait or --port.
        """
        if not 1.0 <= self.wait < math.inf:
            raise ValueError(f"--wait is {self.wait:g}; allowed are 1 and above")
        if self.port is not None and not self.view:
            raise ValueError(
                "--port is given without --view; allowed is both; ask for the page"
            )


Guide = TypeVar("Guide", bound="PressGuide[Any]")


class Dialogue(ABC, Generic[Guide]):
    """A dialogue puts what a guide asks for, and what it has felt, into words."""

    def __init__(self, guide: Guide) -> None:
        """Put a guide into words."""
        self.guide = guide

    def describe_request(self) -> str:
        """Describe what to do now; empty where nothing is to be done."""
        guide = self.guide
        request = self.guide.request
        if guide.phase == "rest":
            return f"hands off for {guide.rest_seconds:g} s"
        if guide.phase == "done" or request is None:
            return ""
        return self.describe_press(request)

    @abstractmethod
    def describe_press(self, request: "PressRequest") -> str:
        """Describe where to press."""

    @abstractmethod
    def describe_skip(self, request: "PressRequest") -> str:
        """Describe that a press is left out."""

    def describe_progress(self) -> str:
        """Describe what the presses have told so far; empty for nothing."""
        return ""

    def describe_event(self, event: "GuideEvent") -> str:
        """Describe what a scan has led to; empty where there is nothing to say."""
        if event.kind == "touched":
            return f"{event.text}: hands off, rest begins again"
        if event.kind == "awaited":
            return f"{event.text}: keep your hands off until it is measured"
        if event.kind == "rested":
            if self.guide.phase == "done":
                return "rest is measured"
            return (
                "rest is measured; now press with one fingertip, firmly, for about a "
                "second"
            )
        if event.kind == "turned":
            return f"{event.text}: they are read so from now on, also those of rest"
        if event.taxel is None:
            return ""
        place = describe_taxel(self.guide.skin, event.taxel)
        if event.kind == "refused":
            return f"  {event.text}: not used, {place}"
        return f"  felt on {place}{self.describe_progress()}"

    def list_faults(self) -> "Sequence[Fault]":
        """List the faults of the skin now."""
        return () if self.guide.state is None else self.guide.state.faults

    def build_board(self) -> "GuideBoard":
        """Build what the page shows of the guide."""
        from eskin.page import GuideBoard

        guide = self.guide
        request = self.guide.request
        place = None
        if guide.phase == "press" and request is not None:
            place = build_place(request, guide.mounted)
        count = len(guide.presses)
        return GuideBoard(self.describe_request(), guide.progress, place, presses=count)


def describe_taxel(skin: "Skin", taxel: int) -> str:
    """Describe where a taxel is: patch, link, row and column."""
    patch = skin.patches[int(skin.patch_index[taxel])]
    cell = patch.describe_cell(int(skin.rows[taxel]), int(skin.columns[taxel]))
    return f"patch '{patch.id}' on {patch.link}, {cell}"


def build_place(request: "PressRequest", mounted: "MountedSkin") -> "PressPlace":
    """Build the place that the page marks for a request."""
    from eskin.page import PressPlace

    x, y, z = mounted.skin.normals[request.taxel].tolist()
    link = int(mounted.taxel_link_index[request.taxel])
    return PressPlace(request.name, link, request.p_link, (x, y, z))


def open_guided_source(
    command: SourceCommand, stack: ExitStack
) -> "tuple[Source, MountedSkin]":
    """Open a device or a recording, and print which skin it has.

    Code is compiled or loaded before: a device sends at any time, and whoever is asked
    to touch it does not wait.

    Args:
        command: command with the options of the source and the skin.
        stack: what closes it.

    Returns:
        The source, and its skin on its robot.

    Raises:
        DeviceError: the source is neither.
    """
    from eskin.app import open_joints, open_source
    from eskin.skin import mount_skin
    from eskin.touch import warm_up_touches

    driver = check_source(command)
    if driver.touches == "simulated":
        raise DeviceError(
            f"source is '{' '.join(command.source)}'; allowed are devices and "
            "recordings"
        )
    if command.skin is None and driver.is_device:
        raise DeviceError(
            f"{command.source[0]} is given without --skin; allowed is a preset's name "
            "or a skin's folder; say whose patches they are"
        )
    is_shown = isinstance(command, PressCommand) and command.view
    config = command.build_config(1.0 if is_shown else math.inf)
    if driver.is_device:
        say(f"{' '.join(command.source)}: is opened, wait a few seconds")
    if command.skin is not None:
        mounted = mount_skin(command.skin, command.robot_urdf)
        warm_up_touches(mounted)
        if command.joints is not None:
            joints = open_joints(
                command.joints, mounted.robot, None, command.allow_remote
            )
            config = replace(config, joints=stack.enter_context(joints))
    source = stack.enter_context(open_source(*command.source, config=config))
    info = source.info
    if command.skin is None:
        warm_up_touches(info.mounted)
    taxels = format_count(info.skin.count, "taxel")
    say(f"{info.uri}: skin '{info.skin.name}', {taxels}")
    say(info.describe_rate())
    return source, info.mounted


def check_source(command: SourceCommand) -> "Driver":
    """Return the driver of a source, and raise if joint positions do not go with it.

    Raises:
        DeviceError: there is no such driver, or --joints is given with --q or with a
            source that has positions of its own.
    """
    from eskin.app import find_driver

    if command.joints is not None and command.q is not None:
        raise DeviceError(
            "--joints is given with --q; allowed is one of them; leave out --q of a "
            "robot that moves"
        )
    driver = find_driver(command.source)
    if command.joints is not None and not driver.is_device:
        raise DeviceError(
            f"--joints is given with {command.source[0]}, which has joint positions of "
            "its own; allowed is --joints with a device; leave it out"
        )
    return driver


def say(line: str, page: "CalibrationViewer | None" = None) -> None:
    """Print a line at once unless it is empty, and add it to the log of the page."""
    if line:
        print(line, flush=True)
    if line and page is not None:
        page.tell(line)


def guide_presses(
    command: PressCommand,
    source: "Source",
    dialogue: Dialogue[Any],
    stack: ExitStack,
) -> "CalibrationViewer | None":
    """Guide through the presses of a source, then close it, and return the page."""
    page = open_page(command, dialogue.guide.mounted, source.info.rate, stack)
    scans = await_page(source, page, command.is_live)
    wait = command.wait if command.is_live else math.inf
    guide_person(scans, dialogue, wait, page, source.take_events)
    source.close()
    return page


def open_page(
    command: PressCommand, mounted: "MountedSkin", rate: float, stack: ExitStack
) -> "CalibrationViewer | None":
    """Start the page where it is asked for, and print its link.

    Raises:
        DeviceError: the port is not available.
    """
    if not command.view:
        return None
    from eskin.page.process import DEFAULT_PORT, describe_link, free_port
    from eskin.page.viewer import CalibrationViewer, ViewerConfig

    say(mounted.robot.describe_lacking_meshes("drawn"))
    port = free_port(DEFAULT_PORT if command.port is None else command.port)
    config = ViewerConfig(port)
    page = CalibrationViewer(mounted, rate, config)
    stack.callback(page.close)
    say(describe_link(config.link))
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
    take_events: "Callable[[], list[Event]]" = list,
) -> None:
    """Push scans until all is measured, and say what to do and what was felt.

    Args:
        scans: scans of the skin.
        dialogue: the guide, with the texts that it says.
        wait: longest time to wait for rest and for each press [s]; infinite for a
            recording, which nobody can be asked for presses.
        page: page that shows the same as the terminal; None without a page.
        take_events: returns the events of the source since the last call.
    """
    from eskin.cli.terminal import SkinPrinter
    from eskin.stream import WAY_TEXTS

    guide = dialogue.guide
    printer = SkinPrinter(guide.skin)
    waiting = WaitReporter(guide.skin, describe_least_press())
    say(dialogue.describe_request())
    since: int | None = None
    for scan in scans:
        since = scan.stamp if since is None else since
        was_rest = guide.phase == "rest"
        event = guide.push(scan)
        # Which way counts go the guide finds out, and says.
        found = [each for each in dialogue.list_faults() if each.kind not in WAY_TEXTS]
        tell_events(printer.print_reading(scan.stamp, found, take_events()), page)
        limit = wait + guide.rest_seconds * was_rest
        # A press that goes on is waited for.
        is_late = scan.stamp - since > limit * NS_PER_S and not guide.is_pressed
        told = ""
        if event is not None:
            told = dialogue.describe_event(event)
        elif is_late and was_rest:
            break
        elif (is_late or is_skipped(guide, page)) and guide.request is not None:
            left_out = dialogue.describe_skip(guide.request)
            told = f"{'nothing felt: ' * is_late}{left_out}"
            guide.skip()
        elif is_withdrawn(guide, page):
            told = "the last press is not used"
            guide.withdraw()
        say(told, page)
        if told and not (event is not None and event.kind in ("touched", "awaited")):
            since = scan.stamp
            if math.isfinite(wait) or event is None:
                say(dialogue.describe_request())
        if guide.state is not None:
            say(waiting.describe_wait(guide.state, find_awaited(guide)), page)
        if page is not None and guide.state is not None and page.wants():
            page.show(guide.state, dialogue.build_board())
        if guide.phase == "done":
            break
    tell_events(printer.finish(), page)


def find_awaited(guide: "PressGuide[Any]") -> "Awaited":
    """Find what a person is waited for now."""
    if guide.phase == "press" and not guide.is_pressed:
        return "touch"
    return "rest" if guide.phase == "rest" else None


def describe_least_press() -> str:
    """Describe what a press has at least."""
    from eskin.touch.touches import MIN_PRESS_FORCE, MIN_PRESS_SECONDS

    return f"a press has {MIN_PRESS_FORCE:g} N for {MIN_PRESS_SECONDS:g} s"


Awaited = Literal["rest", "touch"] | None
"""What a person is waited for; None while nothing is to be done."""


@dataclass
class FeltContact:
    """What was felt last, whether or not it was enough for a touch."""

    patch: str
    """Patch of its strongest contact."""
    first: int
    """Stamp of its first reading [ns since the epoch]."""
    last: int
    """Stamp of its last reading [ns since the epoch]."""
    force: float = 0.0
    """Greatest force [N]."""
    taxels: int = 0
    """Largest number of taxels."""

    def describe(self) -> str:
        """Describe how long, how strong and how large it was, and on which patch."""
        seconds = (self.last - self.first) / NS_PER_S
        taxels = format_count(self.taxels, "taxel")
        lasting = format_duration(seconds)
        return f"{lasting}, {self.force:.1f} N, {taxels} of patch '{self.patch}'"


@final
class WaitReporter:
    """A reporter tells a person who is waited for what was felt last; stateful."""

    def __init__(self, skin: "Skin", needs: str) -> None:
        """Start before the first reading.

        Args:
            skin: skin that is touched.
            needs: what is asked for at least, in words.
        """
        self.skin = skin
        self.needs = needs
        self.awaited: Awaited = None
        self.since = 0
        self.told = 0
        self.highest = 0.0
        self.felt: FeltContact | None = None

    def describe_wait(self, state: "TouchState", awaited: Awaited) -> str:
        """Process a reading, and return what there is to tell; empty for nothing.

        Args:
            state: contacts at the reading.
            awaited: what a person is waited for.
        """
        stamp = state.reading.stamp
        self.note_contact(state)
        if awaited is None or awaited != self.awaited:
            self.awaited = awaited
            self.since = stamp
            self.told = stamp
            self.highest = 0.0
        pressure = state.reading.pressure[state.reading.valid]
        self.highest = max(self.highest, float(pressure.max(initial=0.0)))
        if stamp - self.told < WAIT_SECONDS * NS_PER_S:
            return ""
        before = self.told
        self.told = stamp
        if awaited == "touch":
            return self.describe_silence(state)
        if self.felt is None or self.felt.last < before:
            return ""
        return f"hands off: not at rest yet; last felt: {self.felt.describe()}"

    def note_contact(self, state: "TouchState") -> None:
        """Note the contacts of a reading, where there are any."""
        if not state.contacts:
            return
        stamp = state.reading.stamp
        strongest = max(state.contacts, key=lambda contact: contact.force)
        is_new = self.felt is None or stamp - self.felt.last > APART * NS_PER_S
        if self.felt is None or is_new:
            self.felt = FeltContact(strongest.patch, stamp, stamp)
        felt = self.felt
        felt.last = stamp
        felt.force = max(felt.force, sum(each.force for each in state.contacts))
        felt.taxels = max(felt.taxels, sum(len(each.taxels) for each in state.contacts))

    def describe_silence(self, state: "TouchState") -> str:
        """Describe what was felt in place of a touch, and why that may be."""
        from eskin.stream import describe_places

        stamp = state.reading.stamp
        waited = f"for {(stamp - self.since) / NS_PER_S:.0f} s"
        if self.felt is None or self.felt.last < self.since:
            text = f"nothing was felt {waited}; the highest pressure was "
            text += f"{self.highest:.2g} kPa"
        else:
            text = f"no touch was long or firm enough {waited}"
        if self.felt is not None:
            ago = (stamp - self.felt.last) / NS_PER_S
            text += f"; last felt: {self.felt.describe()}, {ago:.1f} s ago"
        text += f"; {self.needs}"
        if state.faults:
            text += f"; not used: {describe_places(state.faults, self.skin)}"
        return text


def tell_events(events: "Sequence[Event]", page: "CalibrationViewer | None") -> None:
    """Add events that are printed to the log of the page, where there is one."""
    if page is not None:
        for event in events:
            page.tell(event.text)


def is_skipped(guide: "PressGuide[Any]", page: "CalibrationViewer | None") -> bool:
    """Tell whether the person has left out, in the page, what is asked for."""
    if page is None or page.skipped is None or guide.phase != "press":
        return False
    # A click on a previous place is out of date.
    skipped = page.skipped
    page.skipped = None
    return guide.request is not None and guide.request.name == skipped


def is_withdrawn(guide: "PressGuide[Any]", page: "CalibrationViewer | None") -> bool:
    """Tell whether the person wants, in the page, to repeat the last press."""
    if page is None or page.repeated is None:
        return False
    # A click after a previous press is out of date.
    repeated = page.repeated
    page.repeated = None
    return guide.phase == "press" and 0 < repeated == len(guide.presses)


def show_result(
    page: "CalibrationViewer | None", guide: "PressGuide[Any]", lines: Sequence[str]
) -> None:
    """Print the result, and show it in the page until it is closed, or by Ctrl-C."""
    from eskin.page import GuideBoard

    for line in lines:
        say(line)
    if page is not None and guide.state is not None:
        page.show(guide.state, GuideBoard("finished", 1.0, None, tuple(lines)))
        with suppress(KeyboardInterrupt):
            page.wait_closed()
